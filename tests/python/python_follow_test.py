"""A live copy is always the daemon's volume of one revision, whatever happens meanwhile."""

import gc
import gzip
import os
import subprocess
import threading
import time

import numpy as np

import palpate
from palpate._nrrd import nrrd_of
from support import PATIENCE_S, DaemonTest, wait_until

TYPES = ("u1", "<i2", "<u2", "<f4")


def noise(shape, kind, seed=1):
    """Values over much of the type's range, and a part of one value."""
    low, high = {"u1": (0, 256), "<i2": (-2000, 3000), "<u2": (0, 65536), "<f4": (-9, 9)}[kind]
    random = np.random.default_rng(seed)
    values = (random.uniform if kind == "<f4" else random.integers)(low, high, shape).astype(kind)
    values[:shape[0] // 2, 8:24] = low + 1
    return values


def edit_at_random(conn, random, count):
    """Blocks of noise, some of them undone; the revision after the last one. A copy gets bricks,
    whatever changed them."""
    info = conn.volume.info()
    shape, most = np.array(info.shape), min(1.0, info.value_max)
    for _ in range(count):
        size = np.minimum(random.integers(1, 20, 3), shape)
        first = random.integers(0, shape - size + 1)
        edit = conn.edit.block(tuple(map(int, first)), random.uniform(0, most, size))
        if random.integers(5) == 0:
            edit = conn.edit.undo()
    return edit.volume_revision


class FollowTest(DaemonTest):
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
        self.assertEqual(copy.values.dtype, volume.values.dtype)
        first = np.random.default_rng(volume.volume_revision).integers(0, copy.shape)
        box = tuple(slice(n, n + 11) for n in first)
        np.testing.assert_array_equal(self.live[box], volume.values[box])
        return copy


class Follow(FollowTest):
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

    def test_values_are_an_array_of_one_revision(self):
        copy = self.check()
        values = self.live.values
        self.assertIs(self.live.values, values)
        with self.assertRaises(ValueError):
            values[0, 0, 0] = 3
        before = values.copy()
        result = self.other.edit.box((0, 0, 0), (3, 3, 3), "set", 0.7, frame="index")
        self.live.wait(result.volume_revision, PATIENCE_S)
        np.testing.assert_array_equal(values, before)
        np.testing.assert_array_equal(copy.values, before)
        self.assertIsNot(self.live.values, values)
        self.assertAlmostEqual(float(self.live.values[3, 3, 3]), 0.7)
        self.assertAlmostEqual(float(self.live[3, 3, 3]), 0.7)
        # Those of a snapshot, and parts, are their holder's own.
        copy.values[0, 0, 0] = 3
        self.live[:4, :4, :4][:] = 3
        self.assertEqual(values[0, 0, 0], before[0, 0, 0])
        self.assertAlmostEqual(float(self.live[3, 3, 3]), 0.7)

    def test_bad_waits_are_refused_at_the_call(self):
        for arguments in (("3",), (True,), (-1,), (1.5,), (0, -1), (0, float("nan")), (0, "1")):
            with self.subTest(arguments), self.assertRaises(palpate.InvalidArgument):
                self.live.wait(*arguments)

    def test_held_is_still(self):
        self.check()
        with self.live.held() as volume:
            edit = self.other.edit.box((0, 0, 0), (3, 3, 3), "set", 0.7, frame="index")
            time.sleep(0.3)
            self.assertLess(self.live.volume_revision, edit.volume_revision)
            np.testing.assert_array_equal(self.live.values, volume.values)
        self.live.wait(edit.volume_revision, PATIENCE_S)

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


class Typed(FollowTest):
    """Volumes of each type of voxels, which edits may change."""

    def upload(self, values, **more):
        info = self.other.volume.upload(values, discard_edits=True, **more)
        self.live.wait(info.volume_revision, PATIENCE_S)

    def test_random_edits_of_another(self):
        for kind in TYPES:
            with self.subTest(kind):
                self.upload(noise((50, 33, 64), kind))
                revision = edit_at_random(self.other, np.random.default_rng(3), 10)
                self.live.wait(revision, PATIENCE_S)
                self.check()

    def test_each_type_is_that_of_the_source(self):
        for kind in TYPES:
            for shape in ((64, 40, 33), (2, 9, 100)):
                with self.subTest(kind=kind, shape=shape):
                    values = noise(shape, kind)
                    self.upload(values)
                    copy = self.check()
                    self.assertEqual((copy.dtype, copy.values.dtype), (values.dtype, values.dtype))
                    np.testing.assert_array_equal(copy.values, values)
                    self.assertTrue(copy.values.flags.c_contiguous)

    def test_an_edit_that_changes_the_type_of_a_brick_and_undo(self):
        for kind in TYPES[:3]:
            with self.subTest(kind):
                values = noise((40, 40, 40), kind)
                self.upload(values)
                changed = values.astype(np.float32)
                changed[3:10, 4:20, 5:30] = 10.5
                edit = self.other.edit.box((3, 4, 5), (9, 19, 29), "set", 10.5, frame="index")
                self.live.wait(edit.volume_revision, PATIENCE_S)
                copy = self.check()
                self.assertEqual(copy.dtype, changed.dtype)
                np.testing.assert_array_equal(copy.values, changed)
                # The part far from it is of the same type.
                np.testing.assert_array_equal(self.live[30:, 30:, 30:], changed[30:, 30:, 30:])
                # Who comes only now has the same type in the end.
                with self.conn.volume.follow() as late:
                    self.assertEqual(late.snapshot().dtype, changed.dtype)
                    undo = self.other.edit.undo()
                    late.wait(undo.volume_revision, PATIENCE_S)
                    self.assertEqual(late.snapshot().dtype, values.dtype)
                self.live.wait(undo.volume_revision, PATIENCE_S)
                again = self.check()
                self.assertEqual(again.dtype, values.dtype)
                np.testing.assert_array_equal(again.values, values)
                np.testing.assert_array_equal(copy.values, changed)

    def test_a_filter(self):
        self.upload(noise((40, 30, 20), "<i2"))
        result = self.other.edit.filter("median", width=1)
        self.live.wait(result.volume_revision, PATIENCE_S)
        self.check()

    def test_a_snapshot_is_never_half_of_an_edit(self):
        # Each edit adds to every voxel: the difference to the first values has one value. The
        # first voxel only lets the volume's range be wide enough.
        for kind in TYPES:
            base = noise((64, 64, 64), "u1") // 3
            base[0, 0, 0] = 255
            self.upload(base.astype(kind))
            before, seen = self.live.volume_revision, set()
            done = threading.Event()

            def edit():
                for _ in range(40):
                    self.other.edit.box((0, 0, 0), (63, 63, 63), "add", 4, frame="index")
                done.set()

            thread = threading.Thread(target=edit)
            thread.start()
            while not done.is_set() or not seen:
                copy = self.live.snapshot()
                added = (copy.values.astype(float) - base)[1:]
                self.assertEqual(added.min(), added.max(), copy.volume_revision)
                part = self.live[5:60, 3, 9:50]
                added = part.astype(float) - base[5:60, 3, 9:50]
                self.assertEqual(added.min(), added.max())
                if copy.volume_revision > before:
                    seen.add(copy.volume_revision)
            thread.join()
            self.check()

    def test_frames_of_a_series(self):
        frames = [noise((40, 24, 17), "<i2", n) for n in range(3)]
        for n, frame in enumerate(frames):
            (self.daemon.folder / f"frame{n}.nrrd").write_bytes(
                b"".join(nrrd_of(frame, np.eye(4), "")))
        self.other.series.load(self.daemon.folder / "frame*.nrrd")
        for n in (2, 0, 1):
            self.other.series.seek(n)
            self.assertTrue(wait_until(lambda: np.array_equal(self.live.values, frames[n])))
            self.assertEqual(self.live.values.dtype, np.int16)
        self.other.volume.load(self.volume, discard_edits=True)

    def test_a_sparse_volume(self):
        for kind, seed in (("sphere", 1), ("cloud", 2)):
            with self.subTest(kind):
                path = self.daemon.folder / f"{kind}.vdb"
                subprocess.run([os.environ["PALPATE_VDB_TOOL"], "make", kind, "64", path],
                               check=True)
                info = self.other.volume.load(path, discard_edits=True)
                self.live.wait(info.volume_revision, PATIENCE_S)
                volume = self.check()
                saved = self.daemon.folder / f"{kind}.nrrd"
                self.other.volume.save(saved, overwrite=True)
                voxels = gzip.decompress(saved.read_bytes().partition(b"\n\n")[2])
                np.testing.assert_array_equal(
                    volume.values, np.frombuffer(voxels, "<f4").reshape(info.shape, order="F"))
                random = np.random.default_rng(seed)
                for _ in range(50):
                    first = random.integers(0, info.shape)
                    last = random.integers(first, np.array(info.shape) + 1)
                    box = tuple(map(slice, first, last))
                    np.testing.assert_array_equal(self.live[box], volume.values[box])
                self.assert_parts(volume)
                edit_at_random(self.other, random, 10)
                self.assert_parts(self.check())

    def assert_parts(self, volume):
        """That bricks and tiles are all that is not background, each once."""
        left = volume.values != volume.background
        bricks = 0
        for corners, values in volume.active_bricks():
            bricks += len(corners)
            for corner, brick in zip(corners, values):
                place = tuple(slice(n, n + 8) for n in corner)
                held = volume.values[place]
                np.testing.assert_array_equal(held, brick[tuple(map(slice, held.shape))])
                left[place] = False
        for begin, end, value in zip(*volume.tiles()):
            place = tuple(map(slice, begin, end))
            self.assertTrue((volume.values[place] == value).all())
            left[place] = False
        self.assertFalse(left.any())
        self.assertLess(bricks, volume.values.size // 512)
