"""What breaks around palpated, and what must come of it. tests/operations/README.md
lists every fault with its test, also those that are elsewhere."""

import datetime
import functools
import os
import pathlib
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest

import numpy as np

import palpate
from crowd import Worker
from palpate.v1 import device_pb2, pose_pb2, recording_pb2, volume_stream_pb2
from support import (CALL_S, PATIENCE_S, SANITIZED, Client, Daemon, PoseReader, nrrd, pattern,
                     wait_until)

PALPATE_LAB = os.environ["PALPATE_LAB"]


class ClientFaults(unittest.TestCase):
    """Clients that misbehave, with a good one beside them."""

    def setUp(self):
        self.daemon = self.enterContext(Daemon(listen=True))
        self.client = self.enterContext(Client(self.daemon))
        self.client.servo()
        # Without those that are open for a moment.
        self.files = min(self.daemon.open_files() for _ in range(100))

    def served_as_before(self):
        """A new client is served, the loop goes on, and the files have come back."""
        with Client(self.daemon, tcp=True) as client:
            before = client.servo().ticks
            self.assertTrue(wait_until(lambda: client.servo().ticks > before + 100))
            self.assertEqual(len(client.read_poses(5)), 5)
            answer = client.set_stiffness(0.61)
            self.assertAlmostEqual(answer.settings.stiffness_n_per_mm, 0.61)
        self.assertIsNone(self.daemon.process.poll())
        self.assertTrue(wait_until(lambda: self.daemon.open_files() <= self.files + 2),
                        f"{self.files} files before, {self.daemon.open_files()} now")

    def streaming_child(self):
        """A program that follows poses over TCP."""
        code = ("import sys, time\n"
                "from support import Client, PoseReader, wait_until\n"
                "client = Client(None, target=sys.argv[1])\n"
                "readers = [PoseReader(client, 1000, 10) for _ in range(4)]\n"
                "wait_until(lambda: all(r.samples > 50 for r in readers))\n"
                "print('streaming', flush=True)\n"
                "time.sleep(600)\n")
        child = subprocess.Popen([sys.executable, "-c", code, f"127.0.0.1:{self.daemon.port}"],
                                 stdout=subprocess.PIPE, text=True)
        self.addCleanup(child.stdout.close)
        self.addCleanup(child.wait)
        self.addCleanup(child.kill)
        self.assertEqual(child.stdout.readline(), "streaming\n")
        self.assertGreater(self.daemon.open_files(), self.files)
        return child

    def test_a_client_that_is_killed_in_a_stream_or_stands_still(self):
        # Of one that stands still the connection is there: only asking finds out.
        for number in (signal.SIGKILL, signal.SIGSTOP):
            good = PoseReader(self.client)
            self.streaming_child().send_signal(number)
            seen = good.samples
            self.assertTrue(wait_until(lambda: good.samples > seen + 60))
            self.assertIsNone(good.error)
            good.stop()
            self.served_as_before()

    def test_a_client_that_never_reads(self):
        # It asks for all that there is, and takes none of it.
        good = PoseReader(self.client)
        with Client(self.daemon, tcp=True) as silent:
            start = pose_pb2.StreamPosesRequest()
            start.start.rate_hz = 1000
            start.start.batch = 10
            calls = [silent.poses.StreamPoses(iter([start])) for _ in range(16)]
            more = volume_stream_pb2.StreamVolumeRequest()
            more.start.SetInParent()
            calls += [silent.volume.StreamVolume(iter([more])) for _ in range(16)]
            self.assertTrue(wait_until(lambda: good.samples > 60))
            before, ticks, seen = self.settled(), self.client.servo().ticks, good.samples
            for n in range(99):
                self.client.carve(20 + n % 8, 20, 20)
            self.assertTrue(wait_until(lambda: self.client.servo().ticks > ticks + 12000))
            # 16 streams of 250 bytes a tick would be 48 MB more.
            if not SANITIZED:
                self.assertLess(self.daemon.resident_bytes() - before, 8 << 20)
            self.assertTrue(wait_until(lambda: good.samples > seen + 60))
            self.assertIsNone(good.error)
            for call in calls:
                call.cancel()
        good.stop()
        self.served_as_before()

    def settled(self):
        """The resident set, once the streams have what they get at their start."""
        sizes = [self.daemon.resident_bytes()]

        def stays():
            time.sleep(0.5)
            sizes.append(self.daemon.resident_bytes())
            return sizes[-1] - sizes[-2] < 1 << 18

        self.assertTrue(wait_until(stays))
        return sizes[-1]

    def test_garbage_on_the_port(self):
        random_bytes = random.Random(1).randbytes
        preface = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
        settings = b"\0\0\0\4\0\0\0\0\0"
        attacks = [b"\0" * 4096, b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", preface[:10], preface,
                   b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + random_bytes(500),
                   # Frames that end early, are too long, belong to no stream, or are unknown.
                   preface + settings + b"\xff\xff\xff\1\4\0\0\0\1",
                   preface + settings + b"\0\0\x10\0\0\0\0\0\1" + random_bytes(16),
                   preface + settings + b"\0\0\4\x08\0\0\0\0\0\0\0\0\0" * 50,
                   preface + settings + (b"\0\0\x08\6\0\0\0\0\0" + b"p" * 8) * 5000,
                   preface + settings + b"\0\0\x20\1\4\0\0\0\1" + random_bytes(32)]
        attacks += [random_bytes(n) for n in (1, 3, 9, 100, 10000, 300000)]
        attacks += [preface + settings + random_bytes(n) for n in (9, 100, 10000, 300000)]
        good = PoseReader(self.client)
        for data in attacks * 3:
            for address in (("127.0.0.1", self.daemon.port), self.daemon.socket):
                kind = socket.AF_INET if isinstance(address, tuple) else socket.AF_UNIX
                with socket.socket(kind) as raw:
                    raw.settimeout(5)
                    raw.connect(address)
                    try:
                        raw.sendall(data)
                        raw.shutdown(socket.SHUT_WR)
                        while raw.recv(65536):
                            pass
                    except OSError:
                        pass  # thrown out: what is wanted
        self.assertIsNone(good.error)
        good.stop()
        self.served_as_before()


class DiskFaults(unittest.TestCase):
    def test_a_recording_that_the_disk_does_not_take_ends_alone(self):
        # The kernel would end the process by a signal that it does not expect.
        limit = ["/usr/bin/prlimit", "--fsize=400000"]
        with Daemon("builtin:sphere:16", wrapper=limit) as daemon, \
                Client(daemon) as client, daemon.connect() as conn:
            path = daemon.folder / "r.mcap"
            good = PoseReader(client)
            conn.recording.start(path)
            self.assertTrue(wait_until(lambda: not conn.recording.state().running))
            self.assertTrue(good.samples > 0 and good.error is None)
            self.assertIn("File too large", conn.recording.state().error)
            before, seen = client.servo(), good.samples
            self.assertTrue(wait_until(lambda: client.servo().ticks > before.ticks + 1000
                                       and good.samples > seen + 10))
            self.assertEqual(client.servo().faulty_ticks, before.faulty_ticks)
            good.stop()
            # What is on the disk is a recording.
            self.assertGreater(len(palpate.open_recording(path).ticks), 100)

    def test_a_volume_file_that_is_deleted(self):
        with Daemon() as daemon, daemon.connect() as conn:
            path, values = daemon.folder / "v.nrrd", pattern((32, 32, 32))
            path.write_bytes(nrrd(values))
            conn.volume.load(path)
            path.unlink()
            conn.edit.sphere((16, 16, 16), 3, "set", 5.0, frame="index")
            conn.edit.revert()
            self.assertEqual(len(next(conn.poses(1000, 20))), 20)
            before = conn.volume.info().volume_revision
            with self.assertRaises(palpate.NotFound):
                conn.volume.load(path)
            self.assertEqual(conn.volume.info().volume_revision, before)
            conn.volume.save(daemon.folder / "copy.nrrd")
            conn.volume.load(daemon.folder / "copy.nrrd")
            np.testing.assert_array_equal(conn.volume.download().values, values)


class ClockStep(unittest.TestCase):
    def test_ticks_do_not_follow_the_wall_clock(self):
        library = next(pathlib.Path("/usr/lib").glob("*/faketime/libfaketimeMT.so.1"), None)
        self.assertIsNotNone(library, "install the package faketime: deploy/install-packages.sh")
        with tempfile.TemporaryDirectory(prefix="palpate-clock-") as folder:
            step = pathlib.Path(folder) / "step"
            step.write_text("+0\n")
            # The heap is the C library's here: libfaketime and jemalloc call each other at the start.
            wrapper = ["/usr/bin/env", f"LD_PRELOAD={library}:libc.so.6:libstdc++.so.6",
                       f"FAKETIME_TIMESTAMP_FILE={step}", "FAKETIME_NO_CACHE=1", "FAKETIME_DONT_FAKE_MONOTONIC=1"]
            with Daemon(wrapper=wrapper) as daemon, Client(daemon) as client:
                reader = PoseReader(client, 100.0)
                self.assertTrue(wait_until(lambda: reader.samples > 20))
                for seconds in ("-86400", "+0", "+86400"):
                    step.write_text(seconds + "\n")
                    before_ns, ticks = time.monotonic_ns(), client.servo().ticks
                    self.assertTrue(wait_until(lambda: client.servo().ticks > ticks + 1000))
                    seen = reader.samples
                    self.assertTrue(wait_until(lambda: reader.samples > seen + 20))
                    # The daemon's clock of poses is the one that nobody sets.
                    self.assertTrue(before_ns < reader.newest.time_ns < time.monotonic_ns())
                    # Of the wall clock, it would be a day.
                    self.assertLess(client.set_stiffness(0.5).receipt_to_applied_ns, 3600e9)
                    client.record(daemon.folder / f"{seconds}.mcap")
                    client.recording.StopRecording(recording_pb2.StopRecordingRequest(),
                                                   timeout=CALL_S)
                self.assertIsNone(reader.error)
                self.assertEqual(client.servo().faulty_ticks, 0)
                self.assertEqual(client.force_state(), device_pb2.FORCE_STATE_ON)
                reader.stop()
                self.assertEqual(daemon.end(), 0)
                # The steps were real: the log is stamped with the wall clock.
                first, last = (datetime.date.fromisoformat(line[:10])
                               for line in (daemon.said[0], daemon.said[-1]))
                self.assertEqual((last - first).days, 1, daemon.said)


class Endings(unittest.TestCase):
    def test_a_termination_signal_under_load(self):
        def edit(client):
            client.carve(20, 20, 20)

        with Daemon() as daemon, Client(daemon) as client:
            file = daemon.folder / "load.mcap"
            clients = [self.enterContext(Client(daemon)) for _ in range(4)]
            readers = [PoseReader(one, 1000.0, 10) for one in clients for _ in range(4)]
            # They fail when the daemon ends.
            workers = [Worker("calls", 1000, functools.partial(call, one)) for call, one in zip(
                (lambda one: one.set_stiffness(0.5), edit, edit, lambda one: one.read_poses(10)),
                clients)]
            client.record(file)
            self.assertTrue(wait_until(lambda: all(r.samples > 100 for r in readers)))
            self.assertTrue(wait_until(lambda: client.recorded_ticks() > 2000))
            self.assertEqual([worker.error for worker in workers], [None] * 4)
            self.assertEqual(daemon.end(), 0)
            for one in [*workers, *readers]:
                one.stop()
            self.assertFalse(os.path.exists(daemon.socket))
            replay = subprocess.run([PALPATE_LAB, "replay", "--recording", file],
                                    capture_output=True, text=True, timeout=PATIENCE_S)
            # It says there when a recording is cut.
            self.assertEqual((replay.returncode, replay.stderr), (0, ""))


if __name__ == "__main__":
    unittest.main()
