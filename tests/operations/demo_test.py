"""deploy/demo.sh, the README's first command, in a tree that is built."""

import os
import pathlib
import subprocess
import tempfile
import unittest

from excuse import busy_machine_may_explain
from support import PATIENCE_S

DEMO = pathlib.Path(__file__).resolve().parents[2] / "deploy/demo.sh"


class Demo(unittest.TestCase):
    def test_the_watch_begins_when_the_daemon_serves(self):
        # Who never sleeps sees the socket before anybody listens on it.
        with tempfile.TemporaryDirectory(prefix="palpate-demo-test-") as folder:
            sleep = pathlib.Path(folder) / "sleep"
            sleep.write_text("#!/bin/sh\n")
            sleep.chmod(0o755)
            environment = os.environ | {"PATH": f"{folder}:{os.environ['PATH']}",
                                        "TMPDIR": folder}
            for _ in range(3):
                run = subprocess.run([DEMO, "--seconds", "3"], env=environment, text=True,
                                     capture_output=True, timeout=PATIENCE_S)
                self.assertEqual(run.returncode, 0, run.stdout + run.stderr)
                self.assertRegex(run.stdout, r"samples +\d+, \d+ dropped")
                with busy_machine_may_explain():
                    self.assertRegex(run.stdout, r"samples +[1-9]\d\d+, \d+ dropped")
            self.assertEqual(os.listdir(folder), ["sleep"])


if __name__ == "__main__":
    unittest.main()
