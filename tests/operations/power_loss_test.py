"""What a loss of power leaves: tests/support/power_loss.cpp keeps what was synced, and no more."""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

from support import PALPATED, Daemon, wait_until

PRELOAD = os.environ["PALPATE_POWER_LOSS"]


class PowerLoss(unittest.TestCase):
    def setUp(self):
        root = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.watched, self.disk = root / "watched", root / "disk"
        self.names = self.disk / "names"
        for folder in (self.watched, self.names, self.disk / "bytes"):
            folder.mkdir(parents=True)
        self.wrapper = ["env", f"LD_PRELOAD={PRELOAD}", f"PALPATE_WATCHED={self.watched}",
                        f"PALPATE_DISK={self.disk}"]

    def outlives(self, path):
        """Whether a file would be the same after a loss of power."""
        kept = self.names / path.relative_to(self.watched)
        return kept.exists() and kept.read_bytes() == path.read_bytes()

    def assert_outlives(self, path):
        self.assertTrue(wait_until(lambda: path.exists() and self.outlives(path)), path)

    def test_what_is_not_synced_is_lost(self):
        program = ("import os, sys\n"
                   "def write(name, sync):\n"
                   "    with open('new', 'w') as file:\n"
                   "        file.write(name)\n"
                   "        file.flush()\n"
                   "        if sync: os.fsync(file.fileno())\n"
                   "    os.rename('new', name)\n"
                   "write('a', True); write('b', False)\n"
                   "os.fsync(os.open('.', os.O_RDONLY)); write('c', True)\n")
        subprocess.run([*self.wrapper, sys.executable, "-c", program], cwd=self.watched, check=True)
        self.assertTrue(self.outlives(self.watched / "a"))
        self.assertEqual((self.names / "b").read_bytes(), b"")
        self.assertFalse((self.names / "c").exists())

    def test_the_state(self):
        state = self.watched / "deep" / "state"
        with Daemon(folder=self.watched, state=state, wrapper=self.wrapper) as daemon:
            with daemon.connect() as conn:
                conn.settings.stiffness_n_per_mm = 0.625
                conn.volume.place(scale_by=0.75)

                def kept(name, text):
                    return any(text in file.read_text() for file in self.names.rglob(name))
                self.assertTrue(wait_until(lambda: kept("*.toml", "0.625")))
                self.assertTrue(wait_until(lambda: kept("registrations.toml", "builtin:sphere")))
        for file in state.rglob("*.toml"):
            self.assert_outlives(file)
        after = self.names / "deep" / "state"
        with Daemon(folder=self.watched, state=after) as daemon, daemon.connect() as conn:
            self.assertEqual(conn.settings.stiffness_n_per_mm, 0.625)

    def test_what_is_saved_and_recorded(self):
        with Daemon(folder=self.watched, wrapper=self.wrapper) as daemon, daemon.connect() as conn:
            for name in ("a.vdb", "a.nrrd", "a.vdb"):
                conn.edit.sphere((20, 20, 20), 3, "add", 0.01, frame="index")
                conn.volume.save(self.watched / name, overwrite=True)
                self.assertTrue(self.outlives(self.watched / name), name)
            recording = self.watched / "a.mcap"
            conn.recording.start(recording)
            self.assertTrue(wait_until(lambda: conn.recording.state().ticks > 100))
            conn.recording.stop()
            self.assertTrue(self.outlives(recording))

    def test_tokens(self):
        tokens = self.watched / "tokens.toml"
        subprocess.run([*self.wrapper, PALPATED, "token", "add", "--file", tokens, "anna",
                        "--role", "viewer"], check=True, stdout=subprocess.DEVNULL)
        self.assertTrue(self.outlives(tokens))


if __name__ == "__main__":
    unittest.main()
