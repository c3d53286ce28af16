"""Finding the daemon, losing it, and finding it again: calls, streams and live copies."""

import os
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import unittest.mock

import numpy as np

import palpate
from support import PATIENCE_S, Daemon, DaemonTest, wait_until


class Finding(unittest.TestCase):
    def refused(self, kind, address, text="."):
        with self.assertRaisesRegex(kind, text) as caught:
            palpate.connect(address)
        self.assertNotIn("\n", str(caught.exception))

    def test_the_users_own_socket(self):
        if os.path.isdir("/run/palpate"):
            self.skipTest("there is a system's socket")
        with tempfile.TemporaryDirectory() as folder:
            environment = {"PALPATE_SOCKET": "", "XDG_RUNTIME_DIR": folder}
            with unittest.mock.patch.dict(os.environ, environment):
                self.refused(palpate.Unavailable, None, f"{folder}/palpate/palpated.sock")

    def test_nobody_is_there(self):
        with tempfile.TemporaryDirectory() as name:
            folder = pathlib.Path(name)
            (folder / "file").write_text("")
            with socket.socket(socket.AF_UNIX) as dead, socket.socket(socket.AF_UNIX) as silent:
                dead.bind(str(folder / "dead.sock"))
                silent.bind(str(folder / "silent.sock"))
                silent.listen()
                for path in ("no.sock", "file", "dead.sock", "silent.sock"):
                    self.refused(palpate.Unavailable, str(folder / path), path)

    def test_bad_addresses(self):
        for address in ("", "localhost", "localhost:", "localhost:0", "localhost:99999", "a b:1",
                        "::1:7400", "/tmp/a b.sock", "/" + "x" * 200, "-x:7", 7400, b"a:1"):
            self.refused(palpate.InvalidArgument, address)


class Losing(unittest.TestCase):
    def setUp(self):
        self.daemon = self.enterContext(Daemon("builtin:sphere:32"))
        self.conn = self.enterContext(self.daemon.connect())

    def refused(self, call):
        with self.assertRaises(palpate.Unavailable) as caught:
            call()
        self.assertNotIn("\n", str(caught.exception))

    def test_everything_says_so_and_works_again(self):
        conn = self.conn
        live = self.enterContext(conn.volume.follow())
        for number in (signal.SIGTERM, signal.SIGKILL):
            edited = conn.edit.sphere((16, 16, 16), 5, "set", 0.1, frame="index").volume_revision
            self.assertTrue(wait_until(lambda: live.volume_revision == edited, PATIENCE_S))
            values = live.snapshot().values
            stream = conn.poses(100)
            next(stream)
            self.daemon.end(number)
            with self.assertRaises(palpate.Unavailable):
                for _ in stream:
                    pass
            # Once more: it stays so.
            self.refused(lambda: next(stream))
            stream.close()
            for call in (conn.volume.info, conn.volume.download, conn.device.stop,
                         lambda: conn.settings.isovalue, lambda: next(conn.poses())):
                self.refused(call)
            self.assertTrue(wait_until(lambda: live.lost is not None, PATIENCE_S))
            self.assertIsInstance(live.lost, palpate.Unavailable)
            self.assertIn("lost", repr(live))
            # What came stays.
            np.testing.assert_array_equal(live.snapshot().values, values)
            self.daemon.start()
            self.assertTrue(wait_until(self.answers, PATIENCE_S))
            self.assertEqual(len(next(conn.poses(100))), 1)
            original = conn.volume.download()
            self.assertTrue((original.values != values).any())
            self.assertTrue(wait_until(
                lambda: live.lost is None and live.volume_revision == original.volume_revision,
                PATIENCE_S))
            np.testing.assert_array_equal(live.snapshot().values, original.values)

    def answers(self):
        try:
            return self.conn.settings.isovalue is not None
        except palpate.Unavailable:
            return False

    def test_calls_while_it_ends_say_so(self):
        # gRPC tells some of these calls that they were cancelled.
        def change(raised):
            try:
                while True:
                    self.conn.settings.isovalue = 0.4
            except palpate.Error as error:
                raised.append(error)

        for _ in range(4):
            raised = []
            threads = [threading.Thread(target=change, args=(raised,)) for _ in range(8)]
            for thread in threads:
                thread.start()
            time.sleep(0.1)
            self.daemon.end()
            for thread in threads:
                thread.join()
            self.assertEqual({type(error) for error in raised}, {palpate.Unavailable}, raised)
            self.daemon.start()

    def test_who_tries_again_and_again_finds_it_again_soon(self):
        for down_s in (0.5, 4.0):
            self.daemon.end()
            end = time.monotonic() + down_s
            while time.monotonic() < end:
                self.assertFalse(self.answers())
                time.sleep(0.02)
            self.daemon.start()
            begin = time.monotonic()
            self.assertTrue(wait_until(self.answers))
            # Without help, gRPC takes up to 5 s.
            self.assertLess(time.monotonic() - begin, 2.5)

    def test_a_daemon_that_stands_still_holds_nothing(self):
        stream = self.conn.poses(100)
        live = self.conn.volume.follow()
        next(stream)
        live.wait(timeout_s=PATIENCE_S)
        self.daemon.stand_still()
        try:
            stream.close()
            live.close()
            self.refused(self.daemon.connect)
        finally:
            self.daemon.process.send_signal(signal.SIGCONT)

    def test_a_copy_of_one_that_is_away_when_it_begins(self):
        self.daemon.end()
        with self.conn.volume.follow() as live:
            with self.assertRaises(palpate.Unavailable):
                live.wait(timeout_s=0.5)
            self.daemon.start()
            live.wait(timeout_s=PATIENCE_S)
            self.assertEqual(live.values.shape, (32, 32, 32))


class Ending(DaemonTest):
    """Connections and programs that end at any moment."""

    def test_it_may_be_closed_twice(self):
        conn = self.daemon.connect()
        live, stream = conn.volume.follow(), conn.poses(100)
        live.wait(timeout_s=PATIENCE_S)
        next(stream)
        conn.close()
        conn.close()
        for call in (conn.volume.info, conn.volume.download, conn.edit.undo, conn.volume.follow,
                     conn.poses, lambda: conn.settings.isovalue, lambda: list(stream),
                     lambda: live.wait(1 << 60), lambda: conn.volume.load("builtin:sphere:16")):
            with self.assertRaisesRegex(palpate.Unavailable, "closed"):
                call()

    def test_closed_by_another_thread_it_fails_in_order(self):
        failures = []

        def use(conn):
            try:
                while True:
                    conn.volume.info()
                    try:
                        conn.volume.load("builtin:sphere:16")
                    except palpate.Conflict:
                        pass
            except palpate.Error:
                pass
            except BaseException as error:  # what a user would not expect
                failures.append(error)

        for _ in range(12):
            conn = self.daemon.connect()
            users = [threading.Thread(target=use, args=(conn,)) for _ in range(4)]
            for user in users:
                user.start()
            time.sleep(0.01)
            conn.close()
            for user in users:
                user.join()
        self.assertEqual(failures, [])

    def test_errors_are_of_one_family(self):
        for name in ("InvalidArgument", "NotFound", "PermissionDenied", "TooLarge", "Conflict",
                     "DiskFull", "FailedPrecondition", "Unavailable", "Cancelled", "Internal"):
            self.assertTrue(issubclass(getattr(palpate, name), palpate.Error), name)
        self.assertTrue(issubclass(palpate.Unavailable, ConnectionError))

    def run_script(self, script):
        return subprocess.Popen([sys.executable, "-c", script, self.daemon.socket], text=True,
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def test_a_program_may_end_with_an_open_copy_or_stream(self):
        copy = "live = conn.volume.follow()\nlive.wait()\n"
        stream = "stream = conn.poses(1000)\nnext(stream)\n"
        for body in (copy, copy + "conn.close()", copy + "raise SystemExit", stream):
            with self.run_script("import palpate, sys\n"
                                 "conn = palpate.connect(sys.argv[1])\n" + body) as program:
                _, err = program.communicate(timeout=PATIENCE_S)
                self.assertEqual(program.returncode, 0, err)
        self.assertEqual(err, "")  # of the stream

    def test_it_ends_although_a_thread_is_stopped_within_grpc(self):
        # As any of gRPC's threads may be, at the interpreter's end.
        script = ("import atexit, palpate, sys, threading\n"
                  "def stop_a_thread():\n"
                  "    thread = threading.Thread(target=state.condition.acquire)\n"
                  "    thread.start()\n"
                  "    thread.join()\n"
                  "conn = palpate.connect(sys.argv[1])\n"
                  "live = conn.volume.follow()\n"
                  "live.wait()\n"
                  "state = live._follower._call._call._state\n"
                  "atexit.register(lambda: (live.close(), stop_a_thread()))\n")
        with self.run_script(script) as program:
            try:
                _, err = program.communicate(timeout=PATIENCE_S)
            except subprocess.TimeoutExpired:
                program.kill()
                self.fail("it hangs")
            self.assertEqual(program.returncode, 0, err)

    def test_ctrl_c_at_any_moment_ends_the_program(self):
        script = ("import palpate, sys\n"
                  "try:\n"
                  "    conn = palpate.connect(sys.argv[1])\n"
                  "    live = conn.volume.follow()\n"
                  "    live.wait()\n"
                  "    print('followed', flush=True)\n"
                  "    while True:\n"
                  "        edit = conn.edit.sphere((16, 16, 16), 9, 'add', 0.1, frame='index')\n"
                  "        live.wait(edit.volume_revision)\n"
                  "        live.snapshot()\n"
                  "        conn.edit.revert()\n"
                  "except KeyboardInterrupt:\n"
                  "    sys.exit(7)\n")
        for n in range(5):
            with self.run_script(script) as program:
                self.assertEqual(program.stdout.readline(), "followed\n")
                time.sleep(0.05 + 0.0237 * n)
                program.send_signal(signal.SIGINT)
                _, err = program.communicate(timeout=PATIENCE_S)
                self.assertEqual(program.returncode, 7, err)
