"""Poses: rates, shapes, freshness, and how a stream ends."""

import gc
import os
import signal
import subprocess
import sys
import threading

import numpy as np

import palpate
from support import PATIENCE_S, DaemonTest, wait_until


class Arrays(DaemonTest):
    def test_shapes_kinds_and_units(self):
        with self.conn.poses(rate_hz=500, batch=20) as stream:
            poses = next(stream)
        n = len(poses)
        self.assertEqual(n, 20)
        np.testing.assert_allclose(np.linalg.norm(poses.stylus_orientation, axis=1), 1)
        self.assertFalse(poses.replayed.any())
        self.assertTrue((poses.isovalue == self.conn.settings.isovalue).all())
        self.assertTrue((np.diff(poses.time_ns) > 0).all())
        self.assertRegex(repr(poses), rf"^<palpate poses: 20 samples, ticks {poses.tick[0]} to "
                         rf"{poses.tick[-1]}, \d+ dropped>$")
        self.assertEqual(str(poses), repr(poses))

    def test_what_is_absent_is_nan_and_what_is_there_is_not(self):
        seen = []
        with self.conn.poses(rate_hz=200, batch=50, waiting=100) as stream:
            for poses in stream:
                seen.append(poses)
                both = palpate.Poses.concatenate(seen)
                if len(seen) >= 4 and both.contact.any() and not both.contact.all() \
                        or len(seen) == 1000:
                    break
        self.assertTrue(both.contact.any() and not both.contact.all())
        np.testing.assert_array_equal(np.isnan(both.scp_h_normal).any(axis=1), ~both.contact)
        np.testing.assert_allclose(np.linalg.norm(both.scp_h_normal[both.contact], axis=1), 1)
        self.assertTrue(np.isfinite(both.hip_mm).all() and np.isfinite(both.force_n).all())
        self.assertEqual(len(both), sum(map(len, seen)))

    def test_no_tick_is_lost_unsaid_at_1000_hz(self):
        with self.conn.poses(rate_hz=1000, batch=20, waiting=200) as stream:
            batches = [poses for _, poses in zip(range(50), stream)]
        poses = palpate.Poses.concatenate(batches)
        self.assertEqual(len(poses), 1000)
        gaps = int((np.diff(poses.tick.astype(np.int64)) - 1).sum())
        self.assertEqual(gaps, poses.dropped_samples - batches[0].dropped_samples)

    def test_the_usual_rate_is_60(self):
        with self.conn.poses() as stream:
            batches = [poses for _, poses in zip(range(30), stream)]
        self.assertEqual({len(poses) for poses in batches}, {1})
        # Every 16.7 ticks, missed ones too. On a busy machine some steps are longer, and the next
        # is shorter.
        poses = palpate.Poses.concatenate(batches)
        steps = np.diff((poses.tick + poses.missed_ticks).astype(np.int64))
        self.assertLessEqual(steps.min(), 17)
        self.assertGreater(steps.mean(), 12)

    def test_a_slow_loop_sees_fresh_samples(self):
        dropped = []
        with self.conn.poses(rate_hz=1000, batch=10) as stream, self.conn.poses(100) as clock:
            for _ in range(10):
                dropped.append(next(stream).dropped_samples)
                begin = next(clock).tick[0]
                self.assertTrue(wait_until(lambda: next(clock).tick[0] > begin + 200))
        # One that takes what is waiting in a row would have lost nothing yet.
        self.assertGreater(dropped[-1], 1000)
        self.assertTrue((np.diff(dropped) >= 0).all())

    def test_bad_options_are_refused_at_the_call_with_the_range(self):
        for said, name, values in (
                ("1000", "rate_hz", (0, -1, 1000.5, 10**9, 10**400, float("nan"))),
                ("1 to 256", "batch", (0, -1, 257, 500, 1 << 70, 2.5, True, "8")),
                ("1 to", "waiting", (0, -1, 1.5, True, None)),
                ("number", "rate_hz", (True, "fast", None))):
            for value in values:
                with self.assertRaises(palpate.InvalidArgument, msg=f"{name}={value}") as caught:
                    self.conn.poses(**{name: value})
                self.assertIn(said, str(caught.exception))
                self.assertNotIn("\n", str(caught.exception))
        with self.conn.poses(np.float32(1000), np.int64(256)) as stream:
            self.assertEqual(len(next(stream)), 256)

    def test_joining_nothing_is_refused(self):
        with self.assertRaises(palpate.InvalidArgument):
            palpate.Poses.concatenate([])


class Ends(DaemonTest):
    def threads(self):
        """Of this process, native ones too."""
        gc.collect()
        return len(os.listdir("/proc/self/task"))

    def test_no_thread_is_left(self):
        def use(kind):
            stream = self.conn.poses(rate_hz=200, batch=4)
            for _ in stream:
                break
            if kind == 0:
                stream.close()
            elif kind == 1:
                with stream:
                    pass
            # Else nobody holds it any more.

        for kind in range(6):
            use(kind % 3)
        python_before, all_before = threading.active_count(), self.threads()
        for kind in range(60):
            use(kind % 3)
        self.assertTrue(wait_until(lambda: threading.active_count() <= python_before))
        # gRPC makes a few more when the machine is busy.
        self.assertTrue(wait_until(lambda: self.threads() <= all_before + 8))

    def test_connections_leave_no_thread(self):
        python_before = threading.active_count()
        for _ in range(10):
            with self.daemon.connect() as conn:
                next(conn.poses(100))
                conn.volume.download()
        self.assertTrue(wait_until(lambda: threading.active_count() <= python_before))

    def test_a_closed_stream_stops(self):
        stream = self.conn.poses(100)
        next(stream)
        stream.close()
        stream.close()
        with self.assertRaises(StopIteration):
            for _ in range(3):
                next(stream)

    def test_close_ends_an_iteration_on_another_thread(self):
        stream = self.conn.poses(0.5)
        begun, ended = threading.Event(), threading.Event()

        def iterate():
            begun.set()
            for _ in stream:
                pass
            ended.set()

        thread = threading.Thread(target=iterate)
        thread.start()
        begun.wait(PATIENCE_S)
        stream.close()
        self.assertTrue(ended.wait(PATIENCE_S))
        thread.join()

    def interrupted(self, script, seconds=0.3):
        """Runs it, sends SIGINT some time after it said "begun"; its code, output and error."""
        child = subprocess.Popen([sys.executable, "-c", script, self.daemon.socket],
                                 stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        self.assertEqual(child.stdout.readline(), "begun\n")
        threading.Event().wait(seconds)
        child.send_signal(signal.SIGINT)
        # Python itself loses the one in a thousand that falls into a __del__, and says so.
        lost = not wait_until(lambda: child.poll() is not None)
        if lost:
            child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=PATIENCE_S)
        if lost:
            self.assertIn("Exception ignored in: <function PoseStream.__del__", err)
        return child.returncode, out, err

    def test_ctrl_c_ends_an_iterator(self):
        # It waits 100 s for its next pose, so that the signal comes while it waits.
        script = ("import palpate, sys, threading, time\n"
                  "conn = palpate.connect(sys.argv[1])\n"
                  "stream = conn.poses(0.01)\n"
                  "try:\n"
                  "    print('begun', flush=True)\n"
                  "    for poses in stream: pass\n"
                  "except KeyboardInterrupt:\n"
                  "    end = time.monotonic() + 100\n"
                  "    while threading.active_count() > 1 and time.monotonic() < end:\n"
                  "        time.sleep(0.02)\n"
                  "    print('ended', threading.active_count())\n")
        code, out, err = self.interrupted(script)
        self.assertEqual((code, out), (0, "ended 1\n"), err)

    def test_ctrl_c_that_nobody_catches_ends_the_program(self):
        begin = ("import palpate, sys\nconn = palpate.connect(sys.argv[1])\n"
                 "print('begun', flush=True)\n")
        # Streams that begin and end all the time: it comes within gRPC as well.
        many = "while True: next(conn.poses(200))\n"
        for body, seconds in (("with conn:\n    for poses in conn.poses(): pass\n", 0.3),
                              (many, 0.05), (many, 0.11), (many, 0.18)):
            code, _, err = self.interrupted(begin + body, seconds)
            self.assertEqual(code, -signal.SIGINT, err)
            self.assertTrue(err.endswith("KeyboardInterrupt\n"), err)
