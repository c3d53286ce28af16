"""The program `palpate`: plays transcripts.py, and what needs more than a command line each:
signals, pipes, sockets, a server that hangs."""

import concurrent.futures
import fcntl
import json
import os
import pathlib
import pty
import re
import shlex
import signal
import socket
import struct
import subprocess
import tempfile
import termios
import threading
import unittest

import grpc

import transcripts
from crash import require_no_crash
from free_port import free_port
from palpate.v1 import volume_pb2, volume_pb2_grpc
from secured import SecuredDaemon
from support import PALPATE, PATIENCE_S, Daemon, nrrd, pattern, wait_until


def value_at(held, path):
    """Of a JSON object, by a path such as volume.size.0."""
    for key in path.split("."):
        held = held[int(key) if isinstance(held, list) else key]
    return held


class CommandLine(unittest.TestCase):
    """Runs `palpate`, by default against the socket that PALPATE_SOCKET names."""

    @classmethod
    def setUpClass(cls):
        cls.folder = cls.enterClassContext(tempfile.TemporaryDirectory(prefix="palpate-cli-"))
        cls.words = {"FOLDER": cls.folder, "SOCKET": f"{cls.folder}/absent.sock", "LONG": "x" * 200}

    def filled(self, text):
        return re.sub(r"\$([A-Z]+)", lambda found: str(self.words[found[1]]), text)

    def start(self, line, env=None, stdout=subprocess.PIPE, pipesize=-1):
        bare = line.removeprefix("PALPATE_SOCKET= ")
        env = {"TERM": "xterm", **(env or {})}
        env |= {name: value for name, value in os.environ.items()
                if not name.startswith("PALPATE_") and name not in env}
        if bare == line:
            env["PALPATE_SOCKET"] = self.words["SOCKET"]
        process = subprocess.Popen([PALPATE, *shlex.split(self.filled(bare))], env=env, text=True,
                                   cwd=self.folder, stdout=stdout, stderr=subprocess.PIPE,
                                   pipesize=pipesize)
        self.addCleanup(process.__exit__, None, None, None)
        self.addCleanup(lambda: process.poll() is None and process.kill())
        return process

    def end_of(self, process):
        """Its exit code, and what it printed since somebody read it last."""
        patience = threading.Timer(PATIENCE_S, process.kill)
        patience.start()
        output, errors = process.stdout.read(), process.stderr.read()
        code = process.wait()
        patience.cancel()
        require_no_crash(process, errors.splitlines())
        return code, output, errors

    def run_line(self, line, **how):
        return self.end_of(self.start(line, **how))

    def check_error(self, ended, code, part):
        """One line that begins with the program's name, as all errors do; progress before it."""
        self.assertEqual(ended[0], code, ended)
        self.assertRegex(ended[2], r"\A( *\d+ % .*\n)*palpate: [^\n]*\n\Z")
        self.assertIn(part, ended[2])

    def play(self, steps):
        for step in steps:
            for line in step.run if isinstance(step.run, list) else [step.run]:
                with self.subTest(line):
                    self.check(step, line, self.run_line(line))

    def check(self, step, line, ended):
        code, output, errors = ended
        if step.exit:
            self.check_error(ended, step.exit, self.filled(step.error))
        else:
            self.assertEqual(code, 0, errors)
        for part in step.has:
            self.assertIn(part, output)
        if step.lines:
            self.assertEqual(output.count("\n"), step.lines, output)
        if step.json or step.keys or ("--json" in line and output):
            answer = json.loads(output.partition("\n")[0] if step.lines else output)
            for path, value in step.json.items():
                self.assertEqual(value_at(answer, path), value, path)
            for path in step.keys:
                value_at(answer, path)
            self.words["REVISION"] = answer.get("settings_revision", self.words.get("REVISION"))


def plays(steps_of):
    """Gives a class a test for each of these transcripts."""
    def add(case):
        for name, steps in steps_of.items():
            setattr(case, f"test_{name}", lambda self, steps=steps: self.play(steps))
        return case
    return add


def verdicts(doctor):
    """Verdict of each check, by its name. A verdict that is not ok says what to do."""
    checks = json.loads(doctor)["checks"]
    for check in checks:
        assert (check["verdict"] == "ok") == (check["advice"] == ""), check
    return {check["name"]: check["verdict"] for check in checks}


@plays(transcripts.NO_DAEMON)
class WithoutDaemon(CommandLine):
    def test_sockets_without_palpated_are_told(self):
        for name, listens, part in (("stale", False, "no palpated at"), ("silent", True, "silent")):
            with socket.socket(socket.AF_UNIX) as server:
                server.bind(f"{self.folder}/{name}")
                if listens:
                    server.listen(5)
                self.check_error(self.run_line(f"info --socket {name}"), 8, part)
        (pathlib.Path(self.folder) / "file").touch()
        self.check_error(self.run_line("info --socket file"), 8, "file is not a socket")

    def test_the_doctor_judges_the_machine_alone(self):
        found = verdicts(self.run_line("doctor --json")[1])
        self.assertEqual(found["daemon"], "warn")
        self.assertFalse({"ticks", "device", "forces"} & set(found))


@plays(transcripts.DAEMON)
class WithDaemon(CommandLine):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        server = f"127.0.0.1:{free_port()}"
        cls.daemon = cls.enterClassContext(Daemon("builtin:sphere:32", listen=server))
        cls.words |= {"SOCKET": cls.daemon.socket, "SERVER": server}
        voxels = range(2 * 3 * 4)
        pathlib.Path(cls.folder, "big.raw").write_bytes(b"header" + struct.pack(">24H", *voxels))
        # Two volumes: the second has 10 more in each voxel.
        pathlib.Path(cls.folder, "two.nrrd").write_bytes(
            b"NRRD0004\ntype: uchar\ndimension: 4\nsizes: 2 3 4 2\n"
            b"kinds: domain domain domain time\nencoding: raw\n\n" +
            bytes([*voxels, *(value + 10 for value in voxels)]))

    def test_a_device_is_tested(self):
        """Until enough of it came: on a busy machine, a second may pass without a tick."""
        self.assertTrue(wait_until(
            lambda: json.loads(self.run_line("device test --seconds 1 --json")[1])["passed"],
            PATIENCE_S))

    def test_the_doctor_looks_at_a_running_daemon(self):
        code, output, _ = self.run_line("doctor --json")
        self.assertEqual(code, 0 if json.loads(output)["fit"] else 10)
        found = verdicts(output)
        self.assertEqual((found["daemon"], found["version"], found["device"]), ("ok",) * 3)
        self.assertIn("ticks", found)

    def test_a_socket_of_somebody_else_is_no_permission(self):
        if os.getuid() == 0:
            self.skipTest("root may use every socket")
        os.chmod(self.daemon.socket, 0)
        self.addCleanup(os.chmod, self.daemon.socket, 0o600)
        self.check_error(self.run_line("info"), 5, "permission")

    def watch(self, options, until):
        """`palpate watch` that has printed `until`, and what it has printed."""
        process = self.start(f"watch {options}")
        said = [process.stdout.readline()]
        while until not in said[-1]:
            self.assertTrue(said[-1], said)
            said.append(process.stdout.readline())
        return process, "".join(said)

    def test_a_signal_ends_a_watch_with_its_summary_or_a_whole_line(self):
        process, _ = self.watch("--json --rate-hz 1000", '"tick"')
        process.send_signal(signal.SIGINT)
        code, rest, _ = self.end_of(process)
        self.assertEqual(code, 0)
        for line in rest.splitlines():  # whole ones
            json.loads(line)
        for number in (signal.SIGINT, signal.SIGTERM):
            process, said = self.watch("", "samples/s")
            self.assertIn("isovalue", said)
            process.send_signal(number)
            code, summary, errors = self.end_of(process)
            self.assertEqual((code, errors), (0, ""))
            for part in ("samples  ", "contact  ", "missed  ", "inside surface  "):
                self.assertIn(f"\n{part}", f"\n{summary}")
            self.assertNotIn("\x1b", said + summary)

    def test_a_signal_ends_a_watch_that_nobody_reads(self):
        # A write that the pipe takes whole or not at all, and one of which it takes a part.
        for rate_hz in (100, 1000):
            with self.subTest(rate_hz=rate_hz):
                process = self.start(f"watch --json --rate-hz {rate_hz}",
                                     pipesize=os.sysconf("SC_PAGESIZE"))

                def is_stuck():
                    waiting = fcntl.ioctl(process.stdout, termios.FIONREAD, b"1234")
                    call = pathlib.Path(f"/proc/{process.pid}/syscall").read_text().split()
                    return struct.unpack("i", waiting)[0] > 2048 and call[1:2] == ["0x1"]
                self.assertTrue(wait_until(is_stuck, PATIENCE_S))
                process.send_signal(signal.SIGINT)
                self.assertEqual(process.wait(PATIENCE_S), 0)

    def test_a_closed_output_ends_quietly(self):
        process, _ = self.watch("--json --rate-hz 1000", '"tick"')
        process.stdout.close()
        self.assertEqual(process.wait(PATIENCE_S), 0)
        self.assertEqual(process.stderr.read(), "")

    def test_a_terminal_is_live_and_gets_its_cursor_back(self):
        if not os.path.exists("/dev/pts/ptmx"):
            self.skipTest("there are no terminals here: /dev/pts is not mounted")
        for term in ("xterm", "dumb"):
            ours, theirs = pty.openpty()
            fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("4H", 24, 80, 0, 0))
            process = self.start("watch", stdout=theirs, env={"TERM": term})
            os.close(theirs)
            shown = b""
            # The live view is drawn again and again; a log has lines.
            while shown.count(b"\x1b[J" if term == "xterm" else b"samples/s") < 3:
                shown += os.read(ours, 65536)
            process.send_signal(signal.SIGINT)
            try:
                while more := os.read(ours, 65536):
                    shown += more
            except OSError:
                pass  # so ends a terminal
            os.close(ours)
            self.assertEqual(process.wait(PATIENCE_S), 0)
            if term == "dumb":
                self.assertNotIn(b"\x1b", shown)
                continue
            self.assertIn(b"] of 3.3 N", shown)
            self.assertRegex(shown, rb"\x1b\[\d+A\x1b\[J")
            self.assertGreater(shown.rfind(b"\x1b[?25h"), shown.rfind(b"\x1b[?25l"))


@plays(transcripts.VOLUMES)
class WithVolumes(CommandLine):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.daemon = cls.enterClassContext(Daemon("builtin:sphere:16", config={
            "volume": ["max_upload_mib = 1", f'save_folders = ["{cls.folder}"]']}))
        cls.words["SOCKET"] = cls.daemon.socket
        files = {f"t{8 + n}.nrrd": nrrd(pattern((9, 8, 7)) + n) for n in range(3)} | {
            "sent.nrrd": nrrd(pattern((9, 8, 7))), "empty.nrrd": b"",
            "large.nrrd": bytes((1 << 20) + 1), "b.dat": bytes(range(48)),
            "block.f32": struct.pack("<8f", *[0.125] * 8)}
        for name, content in files.items():
            pathlib.Path(cls.folder, name).write_bytes(content)


class DaemonThatDies(CommandLine):
    def test_it_ends_a_watch(self):
        with Daemon("builtin:sphere:16") as daemon:
            self.words["SOCKET"] = daemon.socket
            for line, until in (("watch", "samples/s"), ("watch --json", '"tick"')):
                process = self.start(line)
                self.assertTrue(any(until in said for said in process.stdout))
                daemon.end(signal.SIGKILL)
                self.check_error(self.end_of(process), 8, daemon.socket)
                daemon.start()


@plays(transcripts.NO_DEVICE)
class WithoutDevice(CommandLine):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        config = pathlib.Path(cls.folder, "palpated.toml")
        config.write_text('[device]\nkind = "falcon"\nusb_port = "99-9"\n')
        cls.daemon = cls.enterClassContext(
            Daemon("builtin:sphere:16", more=["--config", str(config)]))
        cls.words["SOCKET"] = cls.daemon.socket

    def test_the_doctor_says_what_to_do(self):
        code, output, _ = self.run_line("doctor --json")
        self.assertEqual(code, 10)
        self.assertFalse(json.loads(output)["fit"])
        found = verdicts(output)
        self.assertEqual(found["device"], "fail")
        self.assertNotEqual(found["forces"], "ok")


class WithTls(CommandLine):
    def test_the_doctor_gets_an_answer_and_leaves_nothing_in_the_log(self):
        with SecuredDaemon() as daemon:
            self.words["SOCKET"] = daemon.socket
            checks = json.loads(self.run_line("doctor --json")[1])["checks"]
            daemon.end()
        place = f"127.0.0.1:{daemon.port}:"
        self.assertEqual([check["verdict"] for check in checks if place in check["text"]], ["ok"])
        self.assertFalse([check for check in checks if "restart" in check["advice"]])
        self.assertFalse([line for line in daemon.said if "gRPC" in line])


class SlowVolumes(volume_pb2_grpc.VolumeServiceServicer):
    """All that this server has: loads that make progress and never end."""

    def __init__(self):
        self.was_cancelled = threading.Event()

    def LoadVolume(self, request, context):
        context.add_callback(self.was_cancelled.set)
        for percent in range(0, 101, 10):
            yield self.progress(percent)
        while not self.was_cancelled.wait(0.1):
            yield self.progress(100)

    def progress(self, percent):
        return volume_pb2.LoadVolumeResponse(progress=volume_pb2.LoadVolumeProgress(
            stage="reading", fraction=percent / 100))


@plays(transcripts.OTHER_SERVICE)
class WithFakeDaemon(CommandLine):
    def setUp(self):
        self.words["SOCKET"] = f"{self.folder}/fake.sock"
        self.volumes = SlowVolumes()
        self.server = grpc.server(concurrent.futures.ThreadPoolExecutor(4))
        volume_pb2_grpc.add_VolumeServiceServicer_to_server(self.volumes, self.server)
        self.server.add_insecure_port(f"unix:{self.words['SOCKET']}")
        self.server.start()
        self.addCleanup(lambda: self.server.stop(None).wait(PATIENCE_S))

    def load(self):
        """A load that has read all, and what it has printed."""
        process = self.start("load /slow.nrrd")
        said = [process.stderr.readline()]
        while said[-1] and "100 %" not in said[-1]:
            said.append(process.stderr.readline())
        return process, said

    def test_a_signal_cancels_a_load(self):
        process, said = self.load()
        self.assertEqual(len(said), 1, said)  # after 2 s
        process.send_signal(signal.SIGINT)
        self.check_error(self.end_of(process), 9, "cancelled")
        self.assertTrue(self.volumes.was_cancelled.wait(PATIENCE_S))

    def test_a_load_ends_with_its_daemon(self):
        process, _ = self.load()
        self.server.stop(None)
        self.assertEqual(self.end_of(process)[0], 8)


if __name__ == "__main__":
    unittest.main()
