"""What one client changes, the others see within 100 ms; series, recordings, forces.

p99 within a round: a neighbour that takes the machine for a second spoils its round, and
the best of three counts.
"""

import json
import re
import subprocess
import threading
import time
import unittest

import numpy as np

import palpate
from excuse import busy_machine_may_explain
from support import PALPATE, DaemonTest, nrrd, pattern, wait_until

CHANGES = 150
ROUNDS = 3
BOUND_MS = 100.0


def isovalues(number):
    """Of a round: none of them comes twice."""
    return [0.2 + 0.6 * (n / CHANGES + number / 1e6) for n in range(CHANGES)]


def latencies_ms(conn, seen, number):
    """Milliseconds from before each change until seen(isovalue), which is its time, s."""
    found = []
    for n, isovalue in enumerate(isovalues(number)):
        begun = time.monotonic()
        conn.settings.isovalue = isovalue
        at = seen(isovalue)
        found.append((at - begun) * 1e3)
        # Not in step with the samples.
        time.sleep(0.003 * (n % 7))
    return found


class Arrivals:
    """When each isovalue was first seen, s of the monotonic clock."""

    def __init__(self):
        self._first = {}
        self._changed = threading.Condition()

    def put(self, isovalue):
        with self._changed:
            if self._first.setdefault(isovalue, time.monotonic()):
                self._changed.notify_all()

    def wait(self, isovalue):
        with self._changed:
            if not self._changed.wait_for(lambda: isovalue in self._first, 20):
                raise TimeoutError(f"the isovalue {isovalue} was never seen")
            return self._first[isovalue]


class IsovalueInOtherClients(DaemonTest):
    def judge(self, way, measure):
        """measure(number of the round) returns milliseconds."""
        for number in range(ROUNDS):
            p50, p99 = np.percentile(measure(number), [50, 99])
            print(f"isovalue, {way}: p50 {p50:.1f} ms, p99 {p99:.1f} ms of {CHANGES}")
            if p99 < BOUND_MS:
                return
        with busy_machine_may_explain():
            self.fail(f"p99 was never below {BOUND_MS} ms")

    def test_python_to_python(self):
        arrivals = Arrivals()

        def watch(stream):
            for poses in stream:
                arrivals.put(float(poses.isovalue[-1]))

        with self.daemon.connect() as other, other.poses(rate_hz=250) as stream:
            thread = threading.Thread(target=watch, args=(stream,))
            thread.start()
            self.judge("Python to Python",
                       lambda number: latencies_ms(self.conn, arrivals.wait, number))
            stream.close()
            thread.join()

    def test_python_to_cpp(self):
        arrivals = Arrivals()
        watcher = subprocess.Popen(
            [PALPATE, "watch", "--json", "--rate-hz", "250", "--socket", self.daemon.socket],
            stdout=subprocess.PIPE, text=True)

        def watch():
            for line in watcher.stdout:
                arrivals.put(json.loads(line)["isovalue"])

        thread = threading.Thread(target=watch)
        thread.start()
        try:
            arrivals.wait(self.conn.settings.isovalue)
            self.judge("Python to C++",
                       lambda number: latencies_ms(self.conn, arrivals.wait, number))
        finally:
            watcher.terminate()
            watcher.wait(60)
            thread.join()
            watcher.stdout.close()

    def test_cpp_to_python(self):
        def measure(number):
            with self.conn.poses(rate_hz=1000, batch=4, waiting=1000) as stream:
                return [self.from_cpp_ms(stream, isovalue) for isovalue in isovalues(number)]

        self.judge("C++ to Python", measure)

    def from_cpp_ms(self, stream, isovalue):
        """From the daemon's receipt on: starting the program takes longer than the change."""
        setter = subprocess.Popen(
            [PALPATE, "set", "isovalue", repr(isovalue), "--socket", self.daemon.socket],
            stdout=subprocess.PIPE, text=True)
        for poses in stream:
            arrived_ns = time.monotonic_ns()
            self.assertIn(setter.poll(), (None, 0))
            at = np.flatnonzero(poses.isovalue == isovalue)
            if len(at):
                felt_ns = int(poses.time_ns[at[0]])
                break
        answer, _ = setter.communicate(timeout=60)
        receipt_ms = float(re.search(r"([0-9.]+) ms after receipt", answer)[1])
        return receipt_ms + (arrived_ns - felt_ns) / 1e6


class Forces(DaemonTest):
    def test_device_is_told_and_stopped(self):
        info = self.conn.device.info()
        self.assertEqual((info.kind, info.rate_hz), ("simulated", 1000.0))
        self.assertEqual(info.workspace_min_mm.shape, (3,))
        self.assertTrue((info.workspace_min_mm < info.workspace_max_mm).all())
        self.assertIs(info.verification_level, palpate.VerificationLevel.SIMULATED)
        self.assertIs(info.forces.state, palpate.ForceState.ON)
        self.assertRegex(info.version, r"^\d+\.\d+")
        stopped = self.conn.device.stop()
        self.assertIs(stopped.state, palpate.ForceState.STOPPED)
        self.assertIs(stopped.reason, palpate.ForceReason.STOP_CALL)
        with self.conn.poses(1000, 20) as stream:
            poses = next(stream)
        self.assertTrue((poses.force_state == palpate.ForceState.STOPPED).all())
        self.assertTrue((poses.force_n == 0).all())
        self.conn.device.enable()
        self.assertTrue(wait_until(
            lambda: self.conn.device.info().forces.state is palpate.ForceState.ON))
        self.assertIs(self.conn.device.disable().reason, palpate.ForceReason.OPERATOR)
        self.conn.device.enable("simulated")

    def test_devices_are_listed(self):
        listed = self.conn.device.list()
        self.assertEqual([device.kind for device in listed if device.in_use], ["simulated"])

    def test_another_device_is_refused(self):
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.device.enable("falcon")


class SeriesAndRecording(DaemonTest):
    def test_series(self):
        with self.assertRaises(palpate.Conflict):
            self.conn.series.state()
        frames = [pattern((12, 10, 9)) + 1000.0 * n for n in range(3)]
        for n, frame in enumerate(frames):
            path = self.daemon.folder / f"frame{n}.nrrd"
            path.write_bytes(nrrd(frame, np.eye(3).tolist(), (0.0, 0.0, 0.0)))
        state = self.conn.series.load(self.daemon.folder / "frame*.nrrd")
        self.assertEqual((state.frames, state.playing, state.position_frames), (3, False, 0.0))
        for n in (2, 0, 1):
            self.conn.series.seek(n)
            self.assertTrue(wait_until(lambda: np.array_equal(
                self.conn.volume.download().values, frames[n])))
        self.conn.series.configure(loop=True, interpolate=False)
        state = self.conn.series.play(rate_hz=-20)
        self.assertEqual((state.playing, state.rate_hz, state.loop), (True, -20.0, True))
        self.assertEqual(self.conn.series.rate_hz, -20.0)
        revisions = set()
        with self.conn.poses(100) as stream:
            for poses in stream:
                revisions.add(int(poses.volume_revision[0]))
                if len(revisions) > 5:
                    break
        self.assertFalse(self.conn.series.pause().playing)
        # Set while it is paused: it stays so.
        self.conn.series.rate_hz = 12.5
        state = self.conn.series.state()
        self.assertEqual((state.playing, state.rate_hz), (False, 12.5))
        self.assertEqual(self.conn.series.play().rate_hz, 12.5)
        for call in (lambda: self.conn.series.seek(99), lambda: self.conn.series.seek(True),
                     lambda: self.conn.series.play(rate_hz="fast"),
                     lambda: setattr(self.conn.series, "rate_hz", 0.0),
                     lambda: setattr(self.conn.series, "rate_hz", 1001.0),
                     lambda: setattr(self.conn.series, "rate_hz", True)):
            with self.assertRaises(palpate.InvalidArgument):
                call()
        self.assertEqual(self.conn.series.rate_hz, 12.5)

    def test_recording(self):
        path = self.daemon.folder / "trial.palrec"
        with self.assertRaises(palpate.Conflict):
            self.conn.recording.mark("too early")
        self.assertTrue(self.conn.recording.start(path).running)
        with self.conn.poses(100) as stream:
            before = next(stream).time_ns[0]
            marked = self.conn.recording.mark("begun")
            after = [next(stream) for _ in range(30)][-1].time_ns[0]
        self.assertTrue(before <= marked <= after)
        state = self.conn.recording.stop()
        self.assertEqual((state.running, state.error, state.path), (False, "", str(path)))
        self.assertGreater(state.ticks, 100)
        self.assertEqual(path.stat().st_size, state.size_bytes)
        with self.assertRaises(palpate.Conflict):
            self.conn.recording.start(path)
        with self.assertRaises(palpate.InvalidArgument):
            self.conn.recording.start("")


if __name__ == "__main__":
    unittest.main()
