"""What a program loses when its network, its interpreter or its process stands still, and what
palpated loses when it is killed: it is said, and nothing else is lost."""

import ctypes
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
import unittest

import palpate
from cable import Cable
from secured import SecuredDaemon
from support import PALPATE, PATIENCE_S, SANITIZED, Daemon, DaemonTest, wait_until


def hold_interpreter(seconds):
    """No thread of Python runs meanwhile."""
    ctypes.PyDLL(None).usleep(int(1e6 * seconds))


class Held(DaemonTest):
    def test_live_samples_wait_as_long_as_was_asked(self):
        # Batches: beside other programs, Python may not keep up with 1000 messages per second.
        with self.conn.poses(1000, 16, waiting=300) as stream:
            for seconds in (0.2, 0.4, 0.8):
                next(stream)
                hold_interpreter(seconds)
                until = self.conn.device.info().ticks
                while next(stream).tick[-1] < until:
                    pass
            self.assertEqual(next(stream).dropped_samples, 0)


class Stalled(unittest.TestCase):
    """The network passes nothing and says nothing."""

    def setUp(self):
        self.daemon = self.enterContext(SecuredDaemon())
        self.way = self.enterContext(Cable(self.daemon.port))

    def connect(self, role):
        return palpate.connect(f"localhost:{self.way.port}", tls_ca=str(self.daemon.authority.ca),
                               token_file=str(self.daemon.tokens[role]))

    def test_each_python_call_ends(self):
        with self.connect("operator") as conn, conn.poses(100) as stream, \
                conn.device.lead() as hand:
            next(stream)
            self.way.flows.clear()
            with self.assertRaises(palpate.Unavailable):
                for _ in stream:
                    pass
            with self.assertRaises(palpate.Unavailable):
                for _ in range(1000):
                    hand.move_to((0, 10, 0))
                    time.sleep(0.1)
            with self.assertRaises(palpate.Unavailable):
                conn.settings.stiffness_n_per_mm = 0.4
            self.way.flows.set()
            # The same connection works again.
            self.assertTrue(wait_until(lambda: self.reaches(conn)))

    @staticmethod
    def reaches(conn):
        try:
            return conn.device.info().ticks > 0
        except palpate.Unavailable:
            return False

    def test_a_program_of_the_cpp_library_ends(self):
        with subprocess.Popen(
                [PALPATE, "watch", "--server", f"localhost:{self.way.port}", "--tls-ca",
                 str(self.daemon.authority.ca), "--token-file", str(self.daemon.tokens["viewer"])],
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as watch:
            self.addCleanup(watch.kill)
            self.assertTrue(watch.stdout.readline())
            self.way.flows.clear()
            _, said = watch.communicate(timeout=PATIENCE_S)
            self.assertNotEqual(watch.returncode, 0)
            self.assertTrue(said)


class Forked(DaemonTest):
    def test_a_child_is_told_to_connect_and_the_parent_goes_on(self):
        with self.conn.poses(100) as stream:
            next(stream)
            child = os.fork()
            if child == 0:
                os._exit(self.in_child(stream))
            self.assertEqual(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), 0)
            for _ in range(20):
                next(stream)
        self.assertGreater(self.conn.device.info().ticks, 0)

    def test_a_child_that_ends_as_programs_do_harms_nothing(self):
        program = """if True:
            import os, sys, palpate
            with palpate.connect(sys.argv[1]) as conn, conn.poses(100) as stream:
                next(stream)
                if os.fork() == 0:
                    sys.exit(0)
                os.wait()
                for _ in range(20):
                    next(stream)
                assert conn.device.info().ticks > 0"""
        subprocess.run([sys.executable, "-c", program, self.daemon.socket], check=True,
                       timeout=PATIENCE_S)

    def in_child(self, stream):
        """The number of the first thing that is wrong."""
        for number, call in enumerate([self.conn.device.info, self.conn.poses, stream.__next__,
                                       self.conn.volume.follow, self.conn.device.lead]):
            try:
                call()
                return number + 1
            except palpate.FailedPrecondition:
                pass
        self.conn.close()
        return 0


class Killed(unittest.TestCase):
    @staticmethod
    def kept(daemon):
        """The stiffness in the files of the session."""
        return [tomllib.loads(file.read_text())["haptics"]["stiffness_n_per_mm"]
                for file in (daemon.folder / "state" / "sessions").glob("*.toml")]

    def test_lost_edits_are_counted_and_the_rest_comes_back(self):
        with Daemon() as daemon:
            for count in (1, 2):
                with daemon.connect() as conn:
                    for number in range(count):
                        conn.edit.sphere((20, 20, 20), 3, "set", 0.3 + 0.1 * number)
                    conn.settings.stiffness_n_per_mm = 0.6 + 0.1 * count
                    # It is written soon after the answer.
                    self.assertTrue(wait_until(lambda: 0.6 + 0.1 * count in self.kept(daemon)))
                daemon.end(signal.SIGKILL)
                daemon.start()
                self.assertTrue(any("lost" in line for line in daemon.said), daemon.said)
                with daemon.connect() as conn:
                    said = " ".join(conn.volume.info().warnings)
                    self.assertIn(f"lost: {count}", said)
                    self.assertIn("lost", daemon.palpate("info").stdout)
                    self.assertAlmostEqual(conn.settings.stiffness_n_per_mm, 0.6 + 0.1 * count)
                    conn.volume.load("builtin:sphere:48")
                    self.assertNotIn("lost", " ".join(conn.volume.info().warnings))

    def test_saved_or_undone_edits_are_not_lost(self):
        with Daemon() as daemon:
            with daemon.connect() as conn:
                conn.edit.sphere((20, 20, 20), 3, "set", 0.3)
                conn.edit.undo()
            daemon.end(signal.SIGKILL)
            daemon.start()
            with daemon.connect() as conn:
                self.assertEqual(conn.volume.info().warnings, ())


@unittest.skipIf(SANITIZED, "sanitizers take address space of their own")
class Starved(unittest.TestCase):
    def test_a_save_without_memory_is_refused_and_the_forces_go_on(self):
        # In the file it is four times as large: the writer needs more than palpated.
        with tempfile.TemporaryDirectory() as name:
            volume = pathlib.Path(name) / "noise.nrrd"
            volume.write_bytes(b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 400 400 400\n"
                               b"spacings: 1 1 1\nencoding: raw\n\n" + os.urandom(400**3))
            with Daemon(volume) as daemon:
                pages = pathlib.Path(f"/proc/{daemon.pid}/statm").read_text().split()[0]
            limit = int(pages) * os.sysconf("SC_PAGESIZE") + (16 << 20)
            with Daemon(volume, wrapper=["prlimit", f"--as={limit}"]) as daemon, \
                    daemon.connect() as conn:
                for _ in range(3):
                    with self.assertRaises(palpate.TooLarge):
                        conn.volume.save(daemon.folder / "a.vdb")
                self.assertEqual(list(daemon.folder.glob("a.vdb*")), [])
                self.assertEqual(conn.device.info().forces.state, palpate.ForceState.ON)
                conn.volume.save(daemon.folder / "a.nrrd")


if __name__ == "__main__":
    unittest.main()
