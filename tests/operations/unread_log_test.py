"""A log that nobody reads stops nothing."""

import fcntl
import os
import pathlib
import select
import signal
import subprocess
import tempfile
import unittest

from palpate.v1 import render_pb2
from crash import end_in_order
from support import CALL_S, PALPATED, PATIENCE_S, Client, wait_until

F_SETPIPE_SZ = 1031
RELOADS = 120


class UnreadDaemon:
    """A palpated whose stderr is a pipe of two pages, read to the line of readiness."""

    def __init__(self, folder):
        self.config = folder / "palpated.toml"
        self.socket = str(folder / "palpated.sock")
        self.config.write_text("")
        self.read_end, self.write_end = os.pipe()
        os.set_blocking(self.read_end, False)
        fcntl.fcntl(self.write_end, F_SETPIPE_SZ, 8192)
        self.process = subprocess.Popen(
            [PALPATED, "--volume", "builtin:sphere:16", "--socket", self.socket,
             "--config", str(self.config), "--state-folder", str(folder / "state")],
            stdout=subprocess.DEVNULL, stderr=self.write_end)
        said = []
        if not wait_until(lambda: said.append(self.drain()) or "ready on" in "".join(said)):
            raise RuntimeError("".join(said))

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


class UnreadLog(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="palpate-operations-")
        self.addCleanup(folder.cleanup)
        self.daemon = UnreadDaemon(pathlib.Path(folder.name))
        self.addCleanup(self.daemon.close)
        self.faults = 0
        self.assertTrue(wait_until(lambda: self.reload_faulty() or self.daemon.is_full()))

    def reload_faulty(self):
        """The log names another line each time: none is left out as a repeat."""
        self.faults += 1
        self.daemon.reload(-1.0, lines_before=self.faults)

    def test_it_ends_in_order(self):
        self.daemon.process.terminate()
        self.assertEqual(self.daemon.process.wait(PATIENCE_S), 0)

    def test_calls_and_reloads_go_on_and_what_was_dropped_is_counted(self):
        for _ in range(RELOADS):
            self.reload_faulty()
        with Client(self.daemon) as client:
            def stiffness_n_per_mm():
                settings = client.render.GetSettings(render_pb2.GetSettingsRequest(),
                                                     timeout=CALL_S).settings
                return settings.stiffness_n_per_mm

            self.daemon.reload(0.625)
            self.assertTrue(wait_until(lambda: stiffness_n_per_mm() == 0.625))
        said = []

        def is_counted():
            self.reload_faulty()
            said.append(self.daemon.drain())
            return "of the log dropped: nobody read it" in "".join(said)

        self.assertTrue(wait_until(is_counted), said)


if __name__ == "__main__":
    unittest.main()
