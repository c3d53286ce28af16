"""palpated starts, ends and reloads; what it tells systemd, and what it says when it cannot."""

import ctypes
import os
import pathlib
import re
import select
import signal
import socket
import subprocess
import tempfile
import time
import unittest

import grpc

import palpate
from crash import end_in_order
from free_port import free_port
from palpate.v1 import device_pb2, device_pb2_grpc
from support import PALPATED, PATIENCE_S, wait_until

SMALL = ("--volume", "builtin:sphere:16")
CONFLICT, INVALID, NOT_FOUND, PERMISSION = 7, 3, 4, 5


class Palpated:
    """palpated as a service: without a terminal. Its log is a file."""

    def __init__(self, test, *arguments, prefix=(), more_environment=None):
        self.folder = pathlib.Path(test.enterContext(
            tempfile.TemporaryDirectory(prefix="palpate-service-")))
        self.socket = str(self.folder / "s.sock")
        self._log = self.folder / "log"
        with open(self._log, "wb") as log:
            self.process = subprocess.Popen(
                [*prefix, PALPATED, "--state-folder", "", "--socket", self.socket,
                 *map(str, arguments)],
                stderr=log, stdout=log, start_new_session=True,
                env=os.environ | (more_environment or {}))
        test.addCleanup(self.end)

    def log(self):
        return self._log.read_text()

    def ready(self):
        wait_until(lambda: "ready on" in self.log() or self.process.poll() is not None, 120)
        if "ready on" not in self.log():
            raise RuntimeError("palpated did not start: " + self.log())
        return self

    def end(self, number=signal.SIGTERM):
        if self.process.poll() is None:
            self.process.send_signal(number)
        return end_in_order(self.process, PATIENCE_S, [self.log()])

    def servo(self):
        with grpc.insecure_channel("unix:" + self.socket) as channel:
            return device_pb2_grpc.DeviceServiceStub(channel).GetDevice(
                device_pb2.GetDeviceRequest()).servo

    def setting(self, name):
        with palpate.connect(self.socket) as conn:
            return getattr(conn.settings, name)


def run(*arguments):
    """palpated that is to end by itself: its exit code, and what it said. Its socket is one of its
    own, unless it is told another one."""
    with tempfile.TemporaryDirectory(prefix="palpate-service-") as folder:
        ended = subprocess.run([PALPATED, "--state-folder", "", *map(str, arguments)],
                               capture_output=True, text=True, timeout=PATIENCE_S,
                               start_new_session=True, check=False,
                               env=os.environ | {"PALPATE_SOCKET": f"{folder}/s.sock"})
    return ended.returncode, ended.stdout, ended.stderr


class ServiceTest(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(self.enterContext(
            tempfile.TemporaryDirectory(prefix="palpate-service-")))
        self.config = self.folder / "palpated.toml"

    def configure(self, text, source="builtin:sphere:16"):
        """A file whose text begins in line 3."""
        self.config.write_text(f'[volume]\nsource = "{source}"\n{text}')

    def assert_complaint(self, code, word, *arguments):
        """It ends so, with one line of its own that has this word."""
        status, _, said = run(*arguments)
        complaint = said[said.find("palpated: "):]
        self.assertEqual(status, code, said)
        self.assertEqual(complaint.count("\n"), 1, said)
        self.assertIn(word, complaint)


class Lifecycle(ServiceTest):
    def test_ends_in_order_on_each_signal(self):
        # Without a configuration a hangup ends it, too.
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGQUIT, signal.SIGHUP):
            daemon = Palpated(self, *SMALL).ready()
            with palpate.connect(daemon.socket) as conn, conn.poses(1000) as stream:
                next(stream)
                conn.edit.sphere((5, 5, 5), 2, "set", 0.9, frame="index")
                self.assertEqual(daemon.end(number), 0)
            self.assertIn("ended after", daemon.log())
            self.assertIn("not saved", daemon.log())
            self.assertFalse(os.path.exists(daemon.socket))

    def test_bad_starts_give_one_line_and_a_code(self):
        """Faults of a file are config_check_test's: here those of the command line."""
        kept = self.folder / "my.data"
        kept.write_text("precious")
        for code, word, arguments in (
                (NOT_FOUND, "absent.nrrd", ("--volume", self.folder / "absent.nrrd")),
                (INVALID, "isovalue", (*SMALL, "--isovalue", "5")),
                (INVALID, "isovalue", (*SMALL, "--normalized-isovalue", "-1")),
                (INVALID, "--stiffness-n-per-mm", ("--stiffness-n-per-mm", "50")),
                (INVALID, "phantom", ("--device", "phantom")),
                (INVALID, "replay_file", ("--device", "replay")),
                (NOT_FOUND, "OpenHaptics", ("--device", "openhaptics")),
                (INVALID, "mc33", ("--method", "mc33")),
                (INVALID, "0.0.0.0:7400", (*SMALL, "--listen", "0.0.0.0:7400")),
                (INVALID, str(kept), ("--socket", kept))):
            with self.subTest(word):
                self.assert_complaint(code, word, *arguments)
        self.assertEqual(kept.read_text(), "precious")
        self.assertEqual(run("--no-such-flag")[0], 2)
        self.assertEqual(run("--help")[0], 0)
        self.assertEqual(run("--socket", "/proc/none/s.sock")[0], PERMISSION)

    @unittest.skipIf(os.geteuid() != 0, "needs root, to give the rights up")
    def test_without_realtime_rights_it_says_so_and_goes_on(self):
        # Without capabilities and with the limits of an ordinary user.
        daemon = Palpated(self, *SMALL, prefix=(
            "/usr/bin/setpriv", "--bounding-set=-all", "--inh-caps=-all", "/usr/bin/prlimit",
            "--rtprio=0", "--memlock=65536")).ready()
        self.assertTrue(wait_until(lambda: daemon.servo().ticks > 300, 120))
        servo = daemon.servo()
        self.assertEqual((servo.realtime_scheduling, servo.memory_locked), (False, False))
        self.assertGreaterEqual(len(servo.warnings), 2)
        self.assertIn("no real-time scheduling", daemon.log())

    def test_it_takes_its_configuration_and_its_flags(self):
        self.configure("normalized_isovalue = 0.25\n[haptics]\nstiffness_n_per_mm = 0.7\n"
                       'force_shading = true\nfree_side = "above"\n', "builtin:gyroid:16")
        daemon = Palpated(self, "--config", self.config, "--damping-n-s-per-m", "2").ready()
        with palpate.connect(daemon.socket) as conn:
            settings = conn.settings.all()
        self.assertAlmostEqual(settings["normalized_isovalue"], 0.25)
        for name, value in (("stiffness_n_per_mm", 0.7), ("damping_n_s_per_m", 2.0),
                            ("force_shading", True), ("passivity_control", False),
                            ("free_side", "above")):
            self.assertEqual(settings[name], value, name)


class Manager:
    """systemd's end of the notification socket."""

    def __init__(self, test, watchdog_us):
        path = test.folder / "notify"
        self._socket = test.enterContext(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
        self._socket.bind(str(path))
        self.environment = {"NOTIFY_SOCKET": str(path), "WATCHDOG_USEC": str(watchdog_us)}

    def next(self, patience_s=PATIENCE_S):
        """Empty: nothing came."""
        if not select.select([self._socket], [], [], patience_s)[0]:
            return ""
        return self._socket.recv(4096).decode()

    def hears(self, text):
        """Waits for a message that begins so."""
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            if self.next(1.0).startswith(text):
                return True
        return False

    def forget(self):
        while self.next(0):
            pass


class SystemdService(ServiceTest):
    def start(self, *arguments, watchdog_us=10_000_000):
        self.manager = Manager(self, watchdog_us)
        return Palpated(self, *arguments, more_environment=self.manager.environment)

    def reload(self, daemon):
        self.manager.forget()
        daemon.process.send_signal(signal.SIGHUP)
        self.assertTrue(self.manager.hears("RELOADING=1\nMONOTONIC_USEC="))
        self.assertTrue(self.manager.hears("READY=1"))

    def test_it_is_ready_once_it_serves_and_feeds_the_watchdog(self):
        daemon = self.start(*SMALL, watchdog_us=400_000)
        self.assertEqual(self.manager.next(), "STATUS=loading builtin:sphere:16, 0 %")
        self.assertTrue(self.manager.hears("READY=1"))
        daemon.ready()
        self.assertTrue(self.manager.hears("STATUS=simulated, forces "))
        for _ in range(5):
            self.assertTrue(self.manager.hears("WATCHDOG=1"))
        self.assertEqual(daemon.end(), 0)
        self.assertTrue(self.manager.hears("STOPPING=1"))

    def test_a_servo_that_is_stuck_starves_the_watchdog(self):
        """The daemon answers as ever, but does not tick: systemd is to end it."""
        daemon = self.start(*SMALL, watchdog_us=400_000).ready()
        self.assertTrue(self.manager.hears("WATCHDOG=1"))
        servo, = (int(task.name) for task in pathlib.Path(
            f"/proc/{daemon.process.pid}/task").iterdir()
            if (task / "comm").read_text() == "palpate-rt\n")
        ptrace = ctypes.CDLL(None, use_errno=True).ptrace
        seize, interrupt, detach, wait_for_threads = 0x4206, 0x4207, 17, 0x40000000
        if ptrace(seize, servo, None, None) != 0:
            self.skipTest("may not trace")
        self.assertEqual(ptrace(interrupt, servo, None, None), 0)
        os.waitpid(servo, wait_for_threads)
        ticks = daemon.servo().ticks
        self.manager.forget()
        # At most what was on its way when it stopped. A slow machine makes it no more.
        said = [self.manager.next(0.1) for _ in range(20)]
        self.assertLessEqual(said.count("WATCHDOG=1"), 1)
        self.assertEqual(daemon.servo().ticks, ticks)
        self.assertEqual(ptrace(detach, servo, None, None), 0)
        self.assertTrue(self.manager.hears("WATCHDOG=1"))

    def test_a_reload_takes_over_what_changed_in_a_good_file_and_nothing_else(self):
        self.configure("[haptics]\nstiffness_n_per_mm = 0.5\nviscosity_n_s_per_m = 1\n")
        daemon = self.start("--config", self.config).ready()
        with palpate.connect(daemon.socket) as conn:
            conn.settings.viscosity_n_s_per_m = 3.0
        ticks = daemon.servo().ticks
        # The last is fit for a file, but not for this volume: its values go from 0 to 1.
        for text in ("[haptics]\nstiffness_n_per_mm = 0.8\npop_force_n = 99\n", "[haptics\n",
                     "isovalue = 7\n[haptics]\nstiffness_n_per_mm = 0.8\n"):
            self.configure(text)
            self.reload(daemon)
            self.assertEqual(daemon.setting("stiffness_n_per_mm"), 0.5, text)
        self.assertEqual(daemon.log().count(f"stays as it is: {self.config}:"), 3)
        # What is right again counts from what runs, not from what was refused.
        self.configure("[haptics]\nviscosity_n_s_per_m = 1.0\nstiffness_n_per_mm = 0.8\n"
                       "[realtime]\ncpu = 0\n")
        self.reload(daemon)
        self.assertEqual(daemon.setting("stiffness_n_per_mm"), 0.8)
        # A client's, whose line in the file is as it was.
        self.assertEqual(daemon.setting("viscosity_n_s_per_m"), 3.0)
        self.assertGreater(daemon.servo().ticks, ticks)
        self.assertRegex(daemon.log(), "haptics.stiffness_n_per_mm taken over")
        self.assertRegex(daemon.log(), "realtime.cpu .*restart")

    def test_a_check_a_start_and_a_reload_name_the_same_faults(self):
        # Of a key, of a file that one names, of two together, of an address.
        faulty = ("[haptics]\nstiffness_n_per_mm = 9\n[tls]\ncertificate = \"/no/such.pem\"\n"
                  "[metrics]\nlisten = \"0.0.0.0:9464\"\n")
        expected = [("4", "haptics.stiffness_n_per_mm"), ("6", "tls.certificate"),
                    ("6", "tls.certificate"), ("8", "metrics.listen")]

        def faults(text):
            return sorted(re.findall(rf"{self.config}:(\d+): ([a-z0-9_.]+):? ", text))
        self.configure("")
        self.assertEqual(run("--check-config", "--config", self.config),
                         (0, f"{self.config}: ok\n", ""))
        daemon = self.start("--config", self.config).ready()
        self.configure(faulty)
        for more in ((), ("--check-config",)):
            code, output, said = run("--config", self.config, *more)
            self.assertEqual((code, output, faults(said)), (INVALID, "", expected))
            self.assertEqual(said.count("\n"), 4, said)
        self.reload(daemon)
        self.assertEqual(faults(daemon.log()), expected)

    def test_what_shows_late_names_its_line_too(self):
        # What another program has; what the volume refuses; no volume.
        first = Palpated(self, *SMALL).ready()
        with socket.create_server(("127.0.0.1", free_port())) as taken:
            address = f'listen = "127.0.0.1:{taken.getsockname()[1]}"\n'
            for code, line, key, text, source in (
                    (CONFLICT, 4, "server.listen", "[server]\n" + address, "builtin:sphere:16"),
                    (CONFLICT, 4, "metrics.listen", "[metrics]\n" + address, "builtin:sphere:16"),
                    (CONFLICT, 4, "server.socket", f'[server]\nsocket = "{first.socket}"\n',
                     "builtin:sphere:16"),
                    (INVALID, 3, "volume.isovalue", "isovalue = 0.99\n", "builtin:cylinder"),
                    (PERMISSION, 2, "volume.source", "", self.config)):
                self.configure(text, source)
                self.assert_complaint(code, f"{self.config}:{line}: {key}: ", "--config",
                                      self.config)
        self.assertGreater(first.servo().rate_hz, 0)  # none the worse

    def test_the_journal_reads_levels(self):
        daemon = Palpated(self, *SMALL, "--log-to-journal").ready()
        self.assertTrue("<6>loading builtin:sphere:16\n" in daemon.log(), daemon.log())
        self.assertNotIn("\x1b", daemon.log())
        self.assertIn("<3>palpated: ", run("--log-to-journal", "--volume", "builtin:cube")[2])


if __name__ == "__main__":
    unittest.main()
