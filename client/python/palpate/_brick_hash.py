"""The content hash of bricks, as in VolumeComplete: sums, modulo 2^64, of hashes by halves."""

import collections.abc
import itertools
import typing

import numpy as np
import numpy.typing as npt
import xxhash

from palpate._brick_pool import BRICK_VOXELS

# The high and the low half.
Halves = npt.NDArray[np.uint64]
# Python's other threads wait for so many hashes: half a millisecond.
_BATCH = 1024


def hash_of_bricks(numbers: npt.NDArray[np.int64], values: npt.NDArray[typing.Any]) -> Halves:
    """values: (n, 512) of any type."""
    halves = np.zeros(2, np.uint64)
    for begin in range(0, len(numbers), _BATCH):
        part = slice(begin, begin + _BATCH)
        halves += _sum(np.ascontiguousarray(values[part], "<f4"), numbers[part])
    return halves


def hash_of_constant(numbers: npt.NDArray[np.int64], value: np.float32) -> Halves:
    """Of bricks with one value throughout."""
    brick = np.full(BRICK_VOXELS, value, "<f4").tobytes()
    halves = np.zeros(2, np.uint64)
    for begin in range(0, len(numbers), _BATCH):
        halves += _sum(itertools.repeat(brick), numbers[begin:begin + _BATCH])
    return halves


def _sum(bricks: collections.abc.Iterable[typing.Any], numbers: npt.NDArray[np.int64]) -> Halves:
    # No loop in Python, and no integers of 128 bits.
    digests = b"".join(map(xxhash.xxh3_128_digest, bricks, numbers.tolist()))
    halves: Halves = np.frombuffer(digests, ">u8").reshape(-1, 2).sum(axis=0, dtype=np.uint64)
    return halves
