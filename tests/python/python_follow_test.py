"""A live copy is always the daemon's volume of one revision, whatever happens meanwhile."""

import gc
import threading

import numpy as np

import palpate
from support import PATIENCE_S, DaemonTest, wait_until


def edit_at_random(conn, random, count):
    """Blocks of noise, some of them undone; the revision after the last one. A copy gets bricks,
    whatever changed them."""
    shape = np.array(conn.volume.info().shape)
    for _ in range(count):
        size = np.minimum(random.integers(1, 20, 3), shape)
        first = random.integers(0, shape - size + 1)
        edit = conn.edit.block(tuple(map(int, first)), random.uniform(0, 1, size))
        if random.integers(5) == 0:
            edit = conn.edit.undo()
    return edit.volume_revision


class Follow(DaemonTest):
    volume = "builtin:sphere:64"

    def setUp(self):
        self.other = self.enterContext(self.daemon.connect())
        self.other.volume.load(self.volume, discard_edits=True)
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
        while not done.is_set() or not seen:
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

    def test_bad_waits_are_refused_at_the_call(self):
        for arguments in (("3",), (True,), (-1,), (1.5,), (0, -1), (0, float("nan")), (0, "1")):
            with self.subTest(arguments), self.assertRaises(palpate.InvalidArgument):
                self.live.wait(*arguments)

    def test_another_volume_and_another_place(self):
        self.check()
        for shape in ((9, 40, 17), (64, 64, 64), (2, 2, 2)):
            values = np.random.default_rng(1).uniform(-5, 5, shape).astype(np.float32)
            self.other.volume.upload(values, (0.5, 1, 2), unit="HU", discard_edits=True)
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

    def test_waiting_has_an_end(self):
        self.live.wait(timeout_s=PATIENCE_S)
        with self.assertRaises(palpate.Unavailable):
            self.live.wait(1 << 60, 0.3)

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
