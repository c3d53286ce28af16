"""A copy of a volume, made of messages without a daemon: random changes, and damage."""

import os
import pathlib
import queue
import struct
import subprocess
import sys
import unittest

import numpy as np
import xxhash
import zstandard

import palpate
from palpate._follow import LiveVolume
from palpate._volume_copy import VolumeCopy
from palpate.v1 import volume_pb2, volume_stream_pb2
from support import PATIENCE_S, wait_until

TYPES = {np.dtype("u1"): volume_pb2.VOXEL_TYPE_UINT8, np.dtype("<i2"): volume_pb2.VOXEL_TYPE_INT16,
         np.dtype("<u2"): volume_pb2.VOXEL_TYPE_UINT16,
         np.dtype("<f4"): volume_pb2.VOXEL_TYPE_FLOAT32}
HALF = 1 << 64
PLACE = volume_stream_pb2.VolumePlacement()
PLACE.device_from_index.linear.extend([2, 0, 0, 0, 3, 0, 0, 0, 4])


def lattice_of(size, dtype, background=None, value_min=0.0):
    lattice = volume_stream_pb2.VolumeLattice(
        size_x=size[0], size_y=size[1], size_z=size[2], voxel_type=TYPES[np.dtype(dtype)],
        value_min=value_min, value_max=value_min + 100, background=background, source="made")
    lattice.world_from_index.linear.extend([1, 0, 0, 0, 1, 0, 0, 0, 1])
    return lattice


def bricks_of(numbers=(), values=None, tiles=()):
    """values: (n, 512)"""
    message = volume_stream_pb2.VolumeBricks(brick_numbers=numbers)
    if values is not None:
        message.zstd_values = zstandard.ZstdCompressor().compress(values.tobytes())
        message.voxel_type = TYPES[values.dtype]
    for first, count, value in tiles:
        message.tiles.add(first_brick=first, bricks=count, value=value)
    return message


def hash_of(bricks):
    """As the contract says it, of all bricks (n, 512): (high, low)."""
    digests = [xxhash.xxh3_128_intdigest(brick.astype("<f4").tobytes(), number)
               for number, brick in enumerate(bricks)]
    return sum(d >> 64 for d in digests) % HALF, sum(d % HALF for d in digests) % HALF


class Model:
    """What the daemon has: all voxels as float32, in bricks, by number."""

    def __init__(self, size, background):
        self.size = size
        self.counts = [-(-s // 8) for s in size]
        self.bricks = np.full((int(np.prod(self.counts)), 512), background, np.float32)
        self.background_hash = hash_of(self.bricks)

    def values(self):
        a, b, c = self.counts
        dense = self.bricks.reshape(a, b, c, 8, 8, 8).transpose(0, 3, 1, 4, 2, 5)
        return dense.reshape(8 * a, 8 * b, 8 * c)[tuple(map(slice, self.size))].copy()

    def complete(self, revision=1):
        high, low = hash_of(self.bricks)
        message = volume_stream_pb2.VolumeComplete(
            content_hash_high=high, content_hash_low=low,
            background_hash_high=self.background_hash[0],
            background_hash_low=self.background_hash[1])
        message.revision.volume_revision = revision
        return message


def spread(volume):
    """A dense array, put together from the volume's bricks and tiles."""
    padded = np.full([-(-s // 8) * 8 for s in volume.shape], volume.background, volume.dtype)
    taken = np.zeros(padded.shape, bool)
    for corners, values in volume.active_bricks():
        for (x, y, z), brick in zip(corners, values):
            padded[x:x + 8, y:y + 8, z:z + 8] = brick
            taken[x:x + 8, y:y + 8, z:z + 8] = True
    for (x, y, z), (x1, y1, z1), value in zip(*volume.tiles()):
        assert value != volume.background and not taken[x:x1, y:y1, z:z1].any()
        padded[x:x1, y:y1, z:z1] = value
        taken[x:x1, y:y1, z:z1] = True
    return padded[tuple(map(slice, volume.shape))]


class Attack(unittest.TestCase):
    def setUp(self):
        self.random = np.random.default_rng(5)

    def begin(self):
        dtype = np.dtype(self.random.choice(["u1", "<i2", "<u2", "<f4"]))
        self.size = tuple(int(s) for s in self.random.integers(1, 50, 3))
        background = float(self.random.integers(0, 5))
        given = {"background": background} if self.random.integers(2) else {
            "value_min": background}
        self.copy = VolumeCopy(lattice_of(self.size, dtype, **given))
        self.model = Model(self.size, background)

    def change(self):
        """Takes a message with bricks and tiles; bricks may come twice before a `complete`."""
        count = len(self.model.bricks)
        numbers = np.sort(self.random.choice(count, self.random.integers(count + 1), False))
        dtype = self.random.choice(list(TYPES))
        values = self.random.integers(0, 250, (len(numbers), 512)).astype(dtype)
        tiles, end = [], 0
        while end < count and self.random.integers(3):
            first = int(self.random.integers(end, count))
            end = int(self.random.integers(first, count)) + 1
            if not np.isin(range(first, end), numbers).any():
                value = float(self.random.choice([0, 1, 2, -7, 300, 0.5, 70000, -0.0]))
                tiles.append((first, end - first, value))
                self.model.bricks[first:end] = value
        self.model.bricks[numbers] = values
        self.copy.take(bricks_of(numbers.tolist(), values if len(numbers) else None, tiles))

    def check(self, volume, expected):
        np.testing.assert_array_equal(volume.values, expected)
        self.assertEqual(volume.values.dtype, volume.dtype)
        self.assertTrue(volume.values.flags.c_contiguous)
        np.testing.assert_array_equal(spread(volume), expected)
        for _ in range(3):
            first = self.random.integers(0, self.size)
            box = tuple(map(slice, first, self.random.integers(first, np.array(self.size) + 1)))
            part = volume[box]
            np.testing.assert_array_equal(part, expected[box])
            self.assertEqual((part.dtype, part.shape), (volume.dtype, expected[box].shape))

    def test_every_revision_is_that_of_the_daemon_and_stays(self):
        for _ in range(12):
            self.begin()
            seen = []
            for revision in range(8):
                for _ in range(self.random.integers(1, 4)):
                    self.change()
                if revision and self.random.integers(4) == 0:
                    # What came after the last `complete` is forgotten.
                    self.copy.go_back()
                    self.model.bricks[:] = seen[-1][2]
                volume = self.copy.complete(self.model.complete(revision), PLACE)
                self.assertEqual(volume.volume_revision, revision)
                seen.append((volume, self.model.values(), self.model.bricks.copy()))
            for volume, expected, _ in seen:
                self.check(volume, expected)

    def test_the_type_is_the_file_s_or_the_smallest_that_holds_all(self):
        for of_file, more, expected in (
                ("u1", [], "u1"), ("u1", ["u1"], "u1"), ("<i2", ["u1"], "<i2"),
                ("u1", ["<i2"], "<i2"), ("u1", ["<u2"], "<u2"), ("<u2", ["<i2"], "<f4"),
                ("u1", ["<f4"], "<f4"), ("u1", [255.0], "u1"), ("u1", [256.0], "<i2"),
                ("u1", [40000.0], "<u2"), ("u1", [-1.0, 40000.0], "<f4"), ("<i2", [0.5], "<f4"),
                ("<i2", [-0.0], "<f4"), ("<f4", ["u1"], "<f4")):
            with self.subTest(of_file=of_file, more=more):
                copy, model = VolumeCopy(lattice_of((16, 16, 16), of_file)), Model((16,) * 3, 0)
                for number, held in enumerate(more):
                    if isinstance(held, str):
                        values = np.arange(512).reshape(1, -1).astype(held)
                        copy.take(bricks_of([number], values))
                        model.bricks[number] = values
                    else:
                        copy.take(bricks_of(tiles=[(number, 1, held)]))
                        model.bricks[number] = held
                volume = copy.complete(model.complete(), PLACE)
                self.assertEqual(volume.dtype, np.dtype(expected))
                self.assertEqual(volume.values.tobytes(),
                                 model.values().astype(expected).tobytes())
                # When all is background again, the type is the file's.
                copy.take(bricks_of(tiles=[(0, 8, 0.0)]))
                model.bricks[:] = 0
                self.assertEqual(copy.complete(model.complete(), PLACE).dtype, np.dtype(of_file))


class Parts(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        size = (19, 26, 11)
        model = Model(size, 0)
        values = np.random.default_rng(2).integers(0, 255, model.bricks.shape).astype(np.uint8)
        copy = VolumeCopy(lattice_of(size, "u1"))
        copy.take(bricks_of(range(len(values)), values))
        model.bricks[:] = values
        cls.volume = copy.complete(model.complete(), PLACE)

    def test_indices_are_those_of_an_array(self):
        values = self.volume.values
        for key in ((3, 4, 5), (-1, -26, 0), (slice(None), 3, slice(2, 9)), 7, slice(3, 5),
                    (slice(-4, -1), slice(20, 99), -2), (slice(5, 5),), (slice(9, 3), 0, 0),
                    (np.int64(4), slice(np.int32(1), None, 1)), (slice(None),) * 3):
            with self.subTest(key):
                part = self.volume[key]
                np.testing.assert_array_equal(part, values[key])
                self.assertEqual((np.shape(part), part.dtype), (np.shape(values[key]), np.uint8))
        part = self.volume[2:6, 3, :]
        part[:] = 7
        np.testing.assert_array_equal(self.volume[2:6, 3, :], values[2:6, 3, :])

    def test_other_indices_are_refused(self):
        for key in (slice(None, None, 2), slice(None, None, -1), (0, 0, 0, 0), 1.0, "x", None,
                    Ellipsis, [1, 2], (slice(0, 2.5),), np.arange(3)):
            with self.subTest(key), self.assertRaises(palpate.InvalidArgument) as caught:
                self.volume[key]
            self.assertNotIn("\n", str(caught.exception))
        for key in (19, (0, -27, 0), (0, 0, 11)):
            with self.subTest(key), self.assertRaises(IndexError):
                self.volume[key]


class Damage(unittest.TestCase):
    def setUp(self):
        self.copy, self.model = VolumeCopy(lattice_of((20, 20, 20), "<i2")), Model((20,) * 3, 0)

    def refused(self, message):
        with self.assertRaises((ValueError, zstandard.ZstdError)):
            self.copy.take(message)

    def test_lattices_that_cannot_be(self):
        for size in ((0, 8, 8), (8, 8, 0)):
            with self.assertRaises(ValueError):
                VolumeCopy(lattice_of(size, "u1"))
        for size in ((1 << 32) - 1,) * 3, (4097, 4096, 4096), (1 << 31, 1 << 6, 1):
            with self.assertRaisesRegex(palpate.TooLarge, "voxels"):
                VolumeCopy(lattice_of(size, "u1"))
        for voxel_type in (volume_pb2.VOXEL_TYPE_UNSPECIFIED, volume_pb2.VOXEL_TYPE_INT8,
                           volume_pb2.VOXEL_TYPE_FLOAT64, 77):
            lattice = lattice_of((8, 8, 8), "u1")
            lattice.voxel_type = voxel_type
            with self.assertRaises(palpate.FailedPrecondition):
                VolumeCopy(lattice)

    def test_bricks_that_make_no_sense(self):
        values = np.ones((2, 512), np.int16)
        good = bricks_of([3, 5], values)
        for change in (lambda m: m.brick_numbers.append(6), lambda m: m.brick_numbers.pop(),
                       lambda m: m.ClearField("zstd_values"),
                       lambda m: setattr(m, "zstd_values", m.zstd_values[:-1]),
                       lambda m: setattr(m, "zstd_values", b"\x28\xb5\x2f\xfd"),
                       lambda m: setattr(m, "voxel_type", volume_pb2.VOXEL_TYPE_UINT8),
                       lambda m: m.tiles.add(first_brick=2, bricks=2, value=1),
                       lambda m: m.tiles.add(first_brick=5, bricks=1, value=1)):
            message = volume_stream_pb2.VolumeBricks()
            message.CopyFrom(good)
            change(message)
            self.refused(message)
        for other in (volume_pb2.VOXEL_TYPE_INT32, volume_pb2.VOXEL_TYPE_UNSPECIFIED):
            message.CopyFrom(good)
            message.voxel_type = other
            with self.assertRaises(palpate.FailedPrecondition):
                self.copy.take(message)
        for numbers in ([5, 3], [3, 3], [3, 27], [3, HALF - 1]):
            self.refused(bricks_of(numbers, values))
        self.refused(bricks_of(range(4097), np.ones((4097, 512), np.int16)))
        for tiles in ([(27, 1, 1)], [(0, 28, 1)], [(26, HALF - 1, 1)], [(3, 0, 1)],
                      [(3, 2, 1), (4, 1, 1)], [(3, 1, 1), (2, 1, 1)], [(HALF - 1, 2, 1)]):
            self.refused(bricks_of(tiles=tiles))
        # A size that zstd would allocate before it fails.
        good.zstd_values = struct.pack("<IBQ", 0xfd2fb528, 0xe0, 1 << 50) + b"\x03\x00\x00"
        self.refused(good)
        # Nothing of these is in the copy.
        self.assertEqual(self.copy.complete(self.model.complete(), PLACE).values.any(), False)

    def test_other_voxels_than_the_daemon_s(self):
        values = np.ones((1, 512), np.int16)
        self.model.bricks[3] = 1
        self.copy.take(bricks_of([3], values))
        before = self.copy.complete(self.model.complete(), PLACE)
        for message in (bricks_of([4], values), bricks_of([3], values + 1),
                        bricks_of([3], values.astype("<f4") * -0.0),
                        bricks_of(tiles=[(3, 1, 2)]), bricks_of(tiles=[(7, 4, 1)])):
            self.copy.take(message)
            with self.assertRaisesRegex(ValueError, "not the daemon's"):
                self.copy.complete(self.model.complete(), PLACE)
            self.copy.go_back()
        good = self.model.complete()
        for name in ("content_hash_high", "content_hash_low", "background_hash_high",
                     "background_hash_low"):
            damaged = volume_stream_pb2.VolumeComplete()
            damaged.CopyFrom(good)
            setattr(damaged, name, getattr(good, name) ^ 1 << 40)
            with self.assertRaises(ValueError):
                self.copy.complete(damaged, PLACE)
        np.testing.assert_array_equal(before.values, self.model.values())
        self.copy.complete(good, PLACE)


class Calls:
    """Stands in for the stub: each call takes messages from a queue, and lets go at None."""

    def __init__(self):
        self.messages = queue.SimpleQueue()
        self.starts = []

    def StreamVolume(self, requests):  # noqa: N802
        self.starts.append(next(requests).start)
        return self

    def __iter__(self):
        return iter(self.messages.get, None)

    def cancel(self):
        pass


class Link:
    def check_open(self):
        pass

    def error_of_end(self, failed):
        return palpate.Unavailable("gone")


class Following(unittest.TestCase):
    def setUp(self):
        self.calls, self.model = Calls(), Model((20, 20, 20), 0)
        self.live = LiveVolume(Link(), self.calls)
        self.addCleanup(self.calls.messages.put, None)
        self.addCleanup(self.live._follower.finish)
        self.send(lattice=lattice_of((20, 20, 20), "u1"))
        self.place = volume_stream_pb2.VolumePlacement()
        self.place.device_from_index.linear.extend([1, 0, 0, 0, 1, 0, 0, 0, 1])
        self.send(placement=self.place)
        self.set(3, 9)
        self.send(complete=self.model.complete(1))
        self.live.wait(1, PATIENCE_S)

    def send(self, **event):
        self.calls.messages.put(volume_stream_pb2.StreamVolumeResponse(**event))

    def set(self, number, value):
        self.model.bricks[number] = value
        self.send(bricks=bricks_of([number], np.full((1, 512), value, np.uint8)))

    def test_damage_leaves_the_copy_and_everything_is_sent_anew(self):
        before, values = self.live.snapshot(), self.model.values()
        for revision, damage in enumerate((
                {"bricks": bricks_of([99], np.ones((1, 512), np.uint8))},
                {"bricks": bricks_of(tiles=[(3, 0, 1.0)])},
                {"complete": self.model.complete(9)}, {"lattice": lattice_of((0, 1, 1), "u1")})):
            self.set(4, 7)
            self.send(**damage)
            self.assertTrue(wait_until(lambda: self.live.lost is not None))
            self.assertIsInstance(self.live.lost, palpate.Internal)
            np.testing.assert_array_equal(self.live.values, values)
            # The next call does not resume.
            self.assertTrue(wait_until(lambda: len(self.calls.starts) == revision + 2))
            self.assertFalse(self.calls.starts[-1].HasField("resume_from"))
            self.model = Model((20, 20, 20), 0)
            self.send(lattice=lattice_of((20, 20, 20), "u1"))
            self.send(placement=self.place)
            self.set(3, 9)
            self.send(complete=self.model.complete(2 + revision))
            self.live.wait(2 + revision, PATIENCE_S)
            self.assertIsNone(self.live.lost)
            np.testing.assert_array_equal(self.live.values, values)
        np.testing.assert_array_equal(before.values, values)

    def test_after_a_loss_it_resumes_from_the_revision_that_is_shown(self):
        shown = self.model.bricks.copy()
        self.set(4, 7)
        self.calls.messages.put(None)
        self.assertTrue(wait_until(lambda: len(self.calls.starts) == 2))
        self.assertEqual(self.calls.starts[1].resume_from.volume_revision, 1)
        # What came without a `complete` was undone meanwhile: nothing names that brick again.
        self.model.bricks[:] = shown
        self.set(6, 5)
        self.send(complete=self.model.complete(3))
        self.live.wait(3, PATIENCE_S)
        np.testing.assert_array_equal(self.live.values, self.model.values())

    def test_nothing_is_shown_before_it_is_complete(self):
        before = self.model.values()
        self.set(3, 1)
        self.set(5, 2)
        other = volume_stream_pb2.VolumePlacement()
        other.CopyFrom(self.place)
        other.device_from_index.translation.x = 5
        self.send(placement=other)
        # The place is shown at once, so the bricks before it have been taken.
        self.assertTrue(wait_until(
            lambda: self.live.snapshot().device_from_index[0, 3] == 5))
        np.testing.assert_array_equal(self.live.snapshot().values, before)
        self.assertEqual((self.live[8, 8, 0], self.live.volume_revision), (before[8, 8, 0], 1))
        self.send(complete=self.model.complete(2))
        self.live.wait(2, PATIENCE_S)
        np.testing.assert_array_equal(self.live.values, self.model.values())


MEMORY = """
import os, sys
import numpy as np
from python_copy_test import bricks_of, lattice_of, resident_bytes
from palpate._volume_copy import VolumeCopy
kind, edge, bricks = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
copy = VolumeCopy(lattice_of((8, 8, 8), kind))
copy.take(bricks_of([0], np.ones((1, 512), kind)))
before = resident_bytes()
copy = VolumeCopy(lattice_of((edge,) * 3, kind))
values = np.random.default_rng(1).integers(0, 99, (64, 512)).astype(kind)
step = copy.brick_count // bricks
for first in range(0, bricks, 64):
    copy.take(bricks_of(range(first * step, (first + 64) * step, step), values))
shown = copy._bricks.share()
print(resident_bytes() - before)
"""


def resident_bytes():
    pages = int(pathlib.Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGESIZE")


class Memory(unittest.TestCase):
    def used(self, *arguments):
        return int(subprocess.run([sys.executable, "-c", MEMORY, *map(str, arguments)], check=True,
                                  capture_output=True, text=True).stdout)

    def test_a_brick_takes_its_voxels_and_little_else(self):
        # Beside the voxels: 4 bytes a brick, and what the allocator keeps.
        for kind in ("u1", "<i2", "<f4"):
            voxels = 32768 * 512 * np.dtype(kind).itemsize
            self.assertLess(self.used(kind, 256, 32768), 1.1 * voxels + (2 << 20), kind)

    def test_an_empty_place_takes_nothing(self):
        # 2^36 voxels, and a brick in 64 of its pages of bricks.
        self.assertLess(self.used("<f4", 4096, 64), 16 << 20)


class Vast(unittest.TestCase):
    """A lattice of 2^36 voxels with two bricks and a tile."""

    @classmethod
    def setUpClass(cls):
        cls.copy = VolumeCopy(lattice_of((4096, 4096, 4096), "<i2", value_min=-5.0))
        cls.last = 512**3 - 1
        cls.values = np.random.default_rng(4).integers(0, 99, (2, 512)).astype(np.int16)
        cls.copy.take(bricks_of([0, cls.last], cls.values, [(600, 3, 42.0)]))
        # Without a hash over 134 million bricks of background.
        complete = volume_stream_pb2.VolumeComplete()
        for name, half in zip(("high", "low"), cls.copy._bricks.hash.tolist()):
            setattr(complete, f"content_hash_{name}", half)
        cls.volume = cls.copy.complete(complete, PLACE)

    def test_parts_and_bricks(self):
        volume, cubes = self.volume, self.values.reshape(2, 8, 8, 8)
        np.testing.assert_array_equal(volume[:8, :8, :8], cubes[0])
        np.testing.assert_array_equal(volume[-8:, -8:, -8:], cubes[1])
        np.testing.assert_array_equal(volume[4:9, 3, 7:9],
                                      [[cubes[0][x, 3, 7] if x < 8 else -5, -5]
                                       for x in range(4, 9)])
        (corners, values), = volume.active_bricks()
        np.testing.assert_array_equal(corners, [(0, 0, 0), (4088, 4088, 4088)])
        np.testing.assert_array_equal(values, cubes)
        begins, ends, of_tiles = volume.tiles()
        # Brick 600 is (0, 1, 88).
        np.testing.assert_array_equal((begins[0], ends[0]), [(0, 8, 704), (8, 16, 728)])
        np.testing.assert_array_equal(of_tiles, [42])
        self.assertEqual(volume[3, 9, 720], 42)
        self.assertEqual((volume.dtype, volume.background), (np.int16, -5))

    def test_what_is_too_large_says_what_to_use(self):
        for call in (lambda: self.volume.values, lambda: self.volume[:2000],
                     lambda: self.volume[:]):
            with self.assertRaisesRegex(palpate.TooLarge, r"active_bricks\(\)"):
                call()
        self.assertIn("4096 × 4096 × 4096", repr(self.volume))
        self.assertIn("data:image/png", self.volume._repr_html_())
        self.assertLess(len(self.volume._repr_html_()), 1 << 20)


if __name__ == "__main__":
    unittest.main()
