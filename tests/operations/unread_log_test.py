"""A log that nobody reads stops nothing."""

import fcntl
import os
import pathlib
import select
import signal
import subprocess
import tempfile
import unittest

from crash import end_in_order
from support import PALPATED, PATIENCE_S, Client, wait_until

F_SETPIPE_SZ = 1031
RELOADS = 120


class UnreadLog(unittest.TestCase):
    """A palpated whose stderr is a pipe of two pages, read to the line of readiness."""

    def setUp(self):
        folder = pathlib.Path(self.enterContext(
            tempfile.TemporaryDirectory(prefix="palpate-unread-")))
        self.config, self.socket = folder / "palpated.toml", str(folder / "palpated.sock")
        self.config.write_text("")
        self.read_end, self.write_end = os.pipe()
        os.set_blocking(self.read_end, False)
        fcntl.fcntl(self.write_end, F_SETPIPE_SZ, 8192)
        self.process = subprocess.Popen(
            [PALPATED, "--volume", "builtin:sphere:16", "--socket", self.socket,
             "--config", str(self.config), "--state-folder", str(folder / "state")],
            stdout=subprocess.DEVNULL, stderr=self.write_end)
        self.addCleanup(self.close)
        said = []
        self.assertTrue(wait_until(
            lambda: said.append(self.drain()) or "ready on" in "".join(said)), said)
        self.faults = 0
        self.assertTrue(wait_until(lambda: self.reload_faulty() or self.is_full()))

    def close(self):
        if self.process.poll() is None:
            self.process.terminate()
        end_in_order(self.process, PATIENCE_S, [])
        os.close(self.read_end)
        os.close(self.write_end)

    def reload(self, stiffness_n_per_mm, lines_before=0):
        self.config.write_text("\n" * lines_before
                               + f"[haptics]\nstiffness_n_per_mm = {stiffness_n_per_mm}\n")
        self.process.send_signal(signal.SIGHUP)

    def is_full(self):
        return not select.select([], [self.write_end], [], 0)[1]

    def drain(self):
        try:
            return os.read(self.read_end, 1 << 16).decode()
        except BlockingIOError:
            return ""

    def reload_faulty(self):
        """The log names another line each time: none is left out as a repeat."""
        self.faults += 1
        self.reload(-1.0, lines_before=self.faults)

    def test_it_ends_in_order(self):
        self.process.terminate()
        self.assertEqual(self.process.wait(PATIENCE_S), 0)

    def test_calls_and_reloads_go_on_and_what_was_dropped_is_counted(self):
        for _ in range(RELOADS):
            self.reload_faulty()
        with Client(self) as client:
            self.reload(0.625)
            self.assertTrue(wait_until(
                lambda: client.settings().settings.stiffness_n_per_mm == 0.625))
        said = []

        def is_counted():
            self.reload_faulty()
            said.append(self.drain())
            return "of the log dropped" in "".join(said)

        self.assertTrue(wait_until(is_counted), said)


if __name__ == "__main__":
    unittest.main()
