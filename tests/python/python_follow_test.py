"""A live copy is always the daemon's volume of one revision, whatever happens meanwhile."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
import unittest

import numpy as np

import palpate
from support import PATIENCE_S, Daemon, DaemonTest, nrrd, wait_until


def edit_at_random(conn, random, count):
    """The revision after the last of so many edits."""
    shape = np.array(conn.volume.info().shape)
    revision = 0
    for _ in range(count):
        center = random.uniform(0, shape)
        kind = random.integers(5)
        if kind == 0:
            revision = conn.edit.sphere(center, random.uniform(1, 12), "add",
                                        random.uniform(-1, 1), frame="index", falloff=2)
        elif kind == 1:
            corner = np.minimum(center + random.uniform(1, 9, 3), shape - 1)
            revision = conn.edit.box(np.minimum(center, corner), corner, "set",
                                     random.uniform(0, 1), frame="index")
        elif kind == 2:
            size = np.minimum(random.integers(1, 9, 3), shape)
            first = random.integers(0, shape - size + 1)
            revision = conn.edit.block(tuple(map(int, first)), random.uniform(0, 1, size))
        elif kind == 3:
            revision = conn.edit.sphere(center, 7, "smooth", frame="index")
        else:
            try:
                revision = conn.edit.undo()
            except palpate.Conflict:
                continue
        revision = revision.volume_revision
    return revision


class Follow(DaemonTest):
    volume = "builtin:sphere:64"

    def setUp(self):
        self.other = self.enterContext(self.daemon.connect())
        self.other.volume.load(self.volume)
        self.live = self.enterContext(self.conn.volume.follow())

    def check(self):
        """That the copy, at the daemon's revision, equals a download."""
        volume = self.other.volume.download()
        self.live.wait(volume.volume_revision, PATIENCE_S)
        copy = self.live.snapshot()
        for name in ("volume_revision", "source", "unit", "value_min", "value_max"):
            self.assertEqual(getattr(copy, name), getattr(volume, name), name)
        for name in ("values", "spacing_mm", "world_from_index", "device_from_index"):
            np.testing.assert_array_equal(getattr(copy, name), getattr(volume, name), name)
        self.assertEqual(copy.values.dtype, np.float32)
        return copy

    def test_random_edits_of_another(self):
        self.live.wait(timeout_s=PATIENCE_S)
        random = np.random.default_rng(3)
        for _ in range(5):
            revision = edit_at_random(self.other, random, 20)
            self.assertGreaterEqual(self.live.wait(revision, PATIENCE_S), revision)
            self.check()
        self.assertIsNone(self.live.lost)

    def test_a_snapshot_is_never_half_of_an_edit(self):
        # Each edit sets every voxel: all of a snapshot has one value.
        self.check()
        done = threading.Event()

        def edit():
            for n in range(40):
                self.other.edit.box((0, 0, 0), (63, 63, 63), "set", n % 10 / 10, frame="index")
            done.set()

        thread = threading.Thread(target=edit)
        before = self.live.volume_revision
        seen = set()
        thread.start()
        while not done.is_set() or len(seen) < 2:
            copy = self.live.snapshot()
            if copy.volume_revision > before:
                self.assertEqual(copy.values.min(), copy.values.max(), copy.volume_revision)
                seen.add(copy.volume_revision)
            with self.live.held() as volume:
                if volume.volume_revision > before:
                    self.assertEqual(volume.values.min(), volume.values.max())
        thread.join()
        self.check()

    def test_values_are_a_read_only_view_that_changes(self):
        self.check()
        values = self.live.values
        copy = self.live.snapshot()
        with self.assertRaises(ValueError):
            values[0, 0, 0] = 3
        result = self.other.edit.box((0, 0, 0), (3, 3, 3), "set", 0.7, frame="index")
        self.live.wait(result.volume_revision, PATIENCE_S)
        self.assertIs(self.live.values.base, values.base)
        self.assertAlmostEqual(float(values[3, 3, 3]), 0.7)
        self.assertNotAlmostEqual(float(copy.values[3, 3, 3]), 0.7)
        copy.values[0, 0, 0] = 3  # its holder's own

    def test_another_volume_and_another_place(self):
        self.check()
        for shape in ((9, 40, 17), (64, 64, 64), (2, 2, 2)):
            values = np.random.default_rng(1).uniform(-5, 5, shape).astype(np.float32)
            self.other.volume.upload(values, (0.5, 1, 2), unit="HU")
            np.testing.assert_array_equal(self.check().values, values)
        self.other.volume.place(move_mm=(1, 2, 3), turn_deg=("y", 20))
        moved = self.other.volume.info().device_from_index
        self.assertTrue(wait_until(lambda: np.array_equal(
            self.live.snapshot().device_from_index, moved)))
        self.check()

    def test_after_a_loss_only_what_changed_is_sent(self):
        self.check()
        follower = self.live._follower
        before = follower._copy
        for n in range(5):
            follower._call.cancel()
            edit_at_random(self.other, np.random.default_rng(n), 5)
            self.check()
        # Not another lattice: it has resumed.
        self.assertIs(follower._copy, before)
        self.assertIsNone(self.live.lost)

    def test_each_frame_of_a_series_that_plays_is_whole(self):
        paths = []
        for n in range(3):
            # Of one value, but for a voxel: a volume of one value is none.
            values = np.full((40, 40, 40), n, np.float32)
            values[0, 0, 0] = 9
            paths.append(self.daemon.folder / f"frame{n}.nrrd")
            paths[-1].write_bytes(nrrd(values, np.eye(3).tolist(), [0.0, 0.0, 0.0]))
        self.other.series.load(paths)
        begun = self.live.wait(self.other.volume.info().volume_revision, PATIENCE_S)
        self.other.series.configure(loop=True)
        self.other.series.play(30)
        seen = set()
        while self.live.volume_revision < begun + 40:
            values = self.live.snapshot().values.ravel()[1:]
            self.assertEqual(values.min(), values.max())
            seen.add(float(values[0]))
        self.other.series.pause()
        self.assertGreater(len(seen), 1)
        # It answers at once: a frame may still be on its way.
        paused = -1
        while paused != self.other.volume.info().volume_revision:
            paused = self.other.volume.info().volume_revision
            time.sleep(0.2)
        self.check()

    def test_waiting_has_an_end(self):
        self.live.wait(timeout_s=PATIENCE_S)
        begun = time.monotonic()
        with self.assertRaisesRegex(palpate.Unavailable, "within 0.3 s"):
            self.live.wait(1 << 60, 0.3)
        self.assertLess(time.monotonic() - begun, 20)

    def test_it_ends_when_nobody_holds_it(self):
        def runs():
            return [t for t in threading.enumerate() if t.name == "palpate volume"]
        self.live.close()
        self.assertTrue(wait_until(lambda: not runs()))
        live = self.conn.volume.follow()
        live.wait(timeout_s=PATIENCE_S)
        self.assertTrue(runs())
        del live
        gc.collect()
        self.assertTrue(wait_until(lambda: not runs()))

    def test_after_close_the_copy_stays(self):
        copy = self.check()
        self.live.close()
        self.assertRegex(str(self.live.lost), "closed")
        np.testing.assert_array_equal(self.live.snapshot().values, copy.values)
        with self.assertRaisesRegex(palpate.Unavailable, "closed"):
            self.live.wait(copy.volume_revision + 1)
        self.live.close()

    def test_a_closed_connection(self):
        with self.daemon.connect() as conn:
            live = conn.volume.follow()
            live.wait(timeout_s=PATIENCE_S)
        with self.assertRaisesRegex(palpate.Unavailable, "closed"):
            live.wait(1 << 60)
        with self.assertRaises(palpate.Unavailable):
            conn.volume.follow()

    def test_the_real_volume_with_many_bricks(self):
        path = os.path.join(os.environ["PALPATE_DATA_DIR"], "classic/tooth_103x94x161_uint8.nhdr")
        if not os.path.exists(path):
            self.skipTest("no real volumes")
        self.other.volume.load(path)
        edit_at_random(self.other, np.random.default_rng(4), 5)
        self.check()


class Lost(unittest.TestCase):
    def test_a_daemon_that_comes_again(self):
        with Daemon("builtin:sphere:32") as daemon, daemon.connect() as conn, \
                conn.volume.follow() as live:
            revision = conn.edit.sphere((16, 16, 16), 5, "set", 0.1,
                                        frame="index").volume_revision
            live.wait(revision, PATIENCE_S)
            edited = live.snapshot().values
            for _ in range(2):
                daemon.end()
                self.assertTrue(wait_until(lambda: live.lost is not None))
                self.assertIsInstance(live.lost, palpate.Unavailable)
                self.assertIn("lost", repr(live))
                # What came stays.
                np.testing.assert_array_equal(live.snapshot().values, edited)
                daemon.start()
                self.assertTrue(wait_until(lambda: live.lost is None, PATIENCE_S))
                with daemon.connect() as other:
                    result = other.edit.box((0, 0, 0), (9, 9, 9), "set", 0.3, frame="index")
                    self.assertTrue(wait_until(
                        lambda: live.volume_revision == result.volume_revision, PATIENCE_S))
                    edited = other.volume.download().values
                np.testing.assert_array_equal(live.snapshot().values, edited)

    def test_one_that_stands_still_is_left_in_time(self):
        with Daemon("builtin:sphere:32") as daemon, daemon.connect() as conn:
            live = conn.volume.follow()
            live.wait(timeout_s=PATIENCE_S)
            daemon.stand_still()
            begun = time.monotonic()
            live.close()
            self.assertLess(time.monotonic() - begun, 30)
            daemon.process.send_signal(signal.SIGCONT)

    def test_a_program_may_end_with_an_open_copy(self):
        for end in ("", "conn.close()", "raise SystemExit"):
            script = ("import palpate, sys\n"
                      "conn = palpate.connect(sys.argv[1])\n"
                      "live = conn.volume.follow()\n"
                      "live.wait()\n"
                      "print('followed', flush=True)\n" + end)
            with Daemon("builtin:sphere:32") as daemon:
                done = subprocess.run([sys.executable, "-c", script, daemon.socket], text=True,
                                      capture_output=True, timeout=PATIENCE_S, check=False)
                self.assertEqual(done.stdout, "followed\n", done.stderr)
                self.assertEqual(done.returncode, 0, done.stderr)

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
        with Daemon("builtin:sphere:32") as daemon:
            for n in range(10):
                with subprocess.Popen([sys.executable, "-c", script, daemon.socket], text=True,
                                      stdout=subprocess.PIPE, stderr=subprocess.PIPE) as program:
                    self.assertEqual(program.stdout.readline(), "followed\n")
                    time.sleep(0.05 + 0.0137 * n)
                    program.send_signal(signal.SIGINT)
                    _, err = program.communicate(timeout=PATIENCE_S)
                    self.assertEqual(program.returncode, 7, err)

    def test_one_that_is_away_when_it_begins(self):
        with Daemon("builtin:sphere:32") as daemon, daemon.connect() as conn:
            daemon.end()
            with conn.volume.follow() as live:
                with self.assertRaisesRegex(palpate.Unavailable, "did not reach"):
                    live.wait(timeout_s=0.5)
                daemon.start()
                live.wait(timeout_s=PATIENCE_S)
                self.assertEqual(live.values.shape, (32, 32, 32))


if __name__ == "__main__":
    unittest.main()
