"""palpated and the importer that it starts, as the system sees them: what other processes may read
of the one, and what the other may still do."""

import os
import pathlib
import subprocess
import threading
import time
import unittest

import numpy as np

import palpate
from support import PATIENCE_S, SANITIZED, Daemon, wait_until

# Without it root may read the memory of every process.
WITHOUT_PTRACE = (["setpriv", "--inh-caps=-sys_ptrace", "--bounding-set=-sys_ptrace"]
                  if os.geteuid() == 0 else [])


def may_read(pid):
    """Whether another process of the same account may read this one: one rule for its memory, its
    environment, and which program it is."""
    return subprocess.run([*WITHOUT_PTRACE, "readlink", f"/proc/{pid}/exe"],
                          capture_output=True, timeout=PATIENCE_S, check=False).returncode == 0


def filters(pid):
    """The number of filters of system calls on a process; none if it has ended."""
    try:
        status = pathlib.Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    except OSError:
        return 0
    return int(dict(line.split(":", 1) for line in status.splitlines())["Seccomp_filters"])


class Processes(unittest.TestCase):
    @unittest.skipIf(SANITIZED, "the leak checker reads its own process")
    def test_no_other_process_reads_the_daemons_memory(self):
        with Daemon(wrapper=WITHOUT_PTRACE) as daemon:
            other = self.enterContext(subprocess.Popen([*WITHOUT_PTRACE, "sleep", "600"]))
            self.addCleanup(other.kill)
            self.assertTrue(wait_until(lambda: may_read(other.pid)))
            self.assertFalse(may_read(daemon.pid))

    @unittest.skipIf(SANITIZED, "a sanitized importer has no filter")
    def test_the_importer_confines_itself(self):
        with Daemon() as daemon, daemon.connect() as conn:
            edge = 400
            path = daemon.folder / "noise.raw"
            np.random.default_rng(1).integers(0, 255, edge**3, np.uint8).tofile(path)
            tasks = pathlib.Path(f"/proc/{daemon.pid}/task")
            before = filters(daemon.pid)
            load = threading.Thread(target=conn.volume.load, args=(path,),
                                    kwargs={"raw": palpate.Raw((edge,) * 3, "uint8")})
            load.start()
            most = 0
            while load.is_alive():
                for children in tasks.glob("*/children"):
                    most = max([most, *map(filters, children.read_text().split())])
                time.sleep(0.002)
            load.join()
            self.assertGreater(most, before)


if __name__ == "__main__":
    unittest.main(verbosity=2)
