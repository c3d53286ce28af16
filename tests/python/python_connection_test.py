"""Finding the daemon, losing it, and finding it again."""

import os
import pathlib
import signal
import socket
import tempfile
import threading
import time
import unittest
import unittest.mock

import palpate
from free_port import free_port
from support import Daemon, DaemonTest, wait_until


class Finding(unittest.TestCase):
    def refused(self, kind, address, text):
        with self.assertRaisesRegex(kind, text) as caught:
            palpate.connect(address)
        self.assertNotIn("\n", str(caught.exception))

    def test_by_environment_path_and_port(self):
        port = free_port()
        with Daemon(listen=f"127.0.0.1:{port}") as daemon:
            for address in (daemon.socket, f"127.0.0.1:{port}", f"localhost:{port}",
                            os.path.relpath(daemon.socket)):
                with palpate.connect(address) as conn:
                    self.assertEqual(conn.volume.info().source, "builtin:sphere:48")
                    self.assertEqual(conn.volume.download().values.shape, (48, 48, 48))
            with unittest.mock.patch.dict(os.environ, {"PALPATE_SOCKET": daemon.socket}):
                with palpate.connect() as conn:
                    self.assertEqual(conn.address, f"unix:{daemon.socket}")

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
            self.refused(palpate.Unavailable, str(folder / "no.sock"), "no palpated at")
            (folder / "file").write_text("")
            self.refused(palpate.Unavailable, str(folder / "file"), "not a socket")
            with socket.socket(socket.AF_UNIX) as dead:
                dead.bind(str(folder / "dead.sock"))
            self.refused(palpate.Unavailable, str(folder / "dead.sock"), "no palpated at")
            with socket.socket(socket.AF_UNIX) as silent:
                silent.bind(str(folder / "silent.sock"))
                silent.listen()
                self.refused(palpate.Unavailable, str(folder / "silent.sock"), "palpated")
        self.refused(palpate.Unavailable, f"localhost:{free_port()}", "no palpated at localhost")

    def test_bad_addresses(self):
        for address in ("", "localhost", "localhost:", "localhost:0", "localhost:99999", "a b:1",
                        "::1:7400", "/tmp/a b.sock", "/" + "x" * 200, "-x:7"):
            self.refused(palpate.InvalidArgument, address, ".")


class Losing(unittest.TestCase):
    def test_everything_says_so_and_works_again(self):
        with Daemon() as daemon, daemon.connect() as conn:
            for number in (signal.SIGTERM, signal.SIGKILL):
                stream = conn.poses(100)
                next(stream)
                daemon.end(number)
                with self.assertRaisesRegex(palpate.Unavailable, "went away"):
                    for _ in stream:
                        pass
                # Once more: it stays so.
                with self.assertRaises(palpate.Unavailable):
                    next(stream)
                stream.close()
                for call in (conn.volume.info, conn.volume.download, conn.device.stop,
                             lambda: conn.settings.isovalue, lambda: next(conn.poses())):
                    with self.assertRaises(palpate.Unavailable) as caught:
                        call()
                    self.assertNotIn("\n", str(caught.exception))
                daemon.start()
                self.assertTrue(wait_until(lambda: self.answers(conn)))
                self.assertEqual(len(next(conn.poses(100))), 1)
                self.assertEqual(conn.volume.download().values.shape, (48, 48, 48))

    @staticmethod
    def answers(conn):
        try:
            conn.settings.isovalue
            return True
        except palpate.Unavailable:
            return False

    def test_a_daemon_that_stands_still(self):
        with Daemon() as daemon, daemon.connect() as conn:
            stream = conn.poses(100)
            next(stream)
            daemon.stand_still()
            try:
                begun = time.monotonic()
                stream.close()
                with self.assertRaisesRegex(palpate.Unavailable, "within 3 s"):
                    daemon.connect()
                self.assertLess(time.monotonic() - begun, 30)
            finally:
                daemon.process.send_signal(signal.SIGCONT)


class Using(DaemonTest):
    def test_it_may_be_closed_twice(self):
        conn = self.daemon.connect()
        conn.close()
        conn.close()
        for call in (conn.volume.info, conn.volume.download, conn.edit.undo,
                     lambda: conn.volume.load("builtin:sphere:16")):
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

        for _ in range(30):
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
        for name in ("InvalidArgument", "NotFound", "PermissionDenied", "TooLarge", "Conflict", "DiskFull",
                     "FailedPrecondition", "Unavailable", "Cancelled", "Internal"):
            self.assertTrue(issubclass(getattr(palpate, name), palpate.Error), name)
        with self.assertRaises(ConnectionError):
            palpate.connect("/nowhere/palpated.sock")


if __name__ == "__main__":
    unittest.main()
