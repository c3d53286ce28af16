"""The voxels of a volume: bricks of 8³ voxels in their own types, and bricks of one value.

A place of a brick takes four bytes, and a brick its voxels. Copies share both until one of them is
changed.
"""

import collections.abc
import functools
import math
import typing

import numpy as np
import numpy.typing as npt

from palpate._brick_hash import Halves, hash_of_bricks, hash_of_constant
from palpate._brick_pool import BRICK_VOXELS, BrickPool, Voxels, equal_runs
from palpate._errors import TooLarge

EDGE = 8
# The types of bricks. A float32 holds the values of all others.
TYPES = tuple(np.dtype(name) for name in ("u1", "<i2", "<u2", "<f4"))
# As in the daemon.
_MOST_VOXELS = 1 << 36
_MOST_DENSE_VOXELS = 1 << 31
# Bricks handed out at a time: at most 8 MiB.
_BATCH = 4096
# Bricks read at a time: few enough for the caches of a processor.
_BLOCK = 512

# A brick's code: the number of its constant; or its type + 1, and its slot.
_SLOT_BITS = 29
_SLOT = np.uint32((1 << _SLOT_BITS) - 1)
_PAGE_BITS = 14
_PAGE_CODES = 1 << _PAGE_BITS

Numbers = npt.NDArray[np.int64]
Codes = npt.NDArray[np.uint32]
Corner = tuple[int, int, int]


def _holds(dtype: np.dtype[typing.Any], values: npt.NDArray[np.float32]) -> bool:
    """Returns whether the type holds all these values, bit by bit: no integer is -0."""
    if dtype.kind == "f":
        return True
    limits = np.iinfo(dtype)
    if not ((values >= limits.min) & (values <= limits.max)).all():
        return False
    return values.astype(dtype).astype(np.float32).tobytes() == values.tobytes()


class Bricks:
    """Threads: one that writes. Bricks that nobody writes may be read on any thread.

    Brick (a, b, c) has the number (a·nb + b)·nc + c, with nb and nc = ceil(size / 8) along y and
    z. Voxels beyond the lattice are background. Errors: TooLarge for more than 2³⁶ voxels.
    """

    def __init__(self, size: Corner, dtype: np.dtype[typing.Any], background: float) -> None:
        if math.prod(size) > _MOST_VOXELS:
            raise TooLarge(f"the volume has {size[0]} x {size[1]} x {size[2]} voxels; a copy has "
                           "at most 2^36")
        self.size, self.file_dtype = size, dtype
        self.counts: Corner = (-(-size[0] // EDGE), -(-size[1] // EDGE), -(-size[2] // EDGE))
        self.count = math.prod(self.counts)
        # None: background.
        self._pages: list[Codes | None] = [None] * -(-self.count // _PAGE_CODES)
        # Pages that no other object has.
        self._own: set[int] = set()
        self._pools = [BrickPool(held) for held in TYPES]
        # Constant 0 is the background. Copies share these two arrays, which are never changed.
        self._constants = np.array([background], np.float32)
        self._uses = np.zeros(1, np.int64)
        # The sums over all bricks of their hash less that of background.
        self.hash: Halves = np.zeros(2, np.uint64)
        # By the bits of the value: NaN and -0 are values as any others.
        self._code_of = {int(self._constants.view(np.uint32)[0]): 0}

    @property
    def background(self) -> np.float32:
        return typing.cast(np.float32, self._constants[0])

    @property
    def dtype(self) -> np.dtype[typing.Any]:
        """The file's type, or the smallest of TYPES that holds all voxels."""
        held = [self.file_dtype, *(pool.dtype for pool in self._pools if pool.count)]
        constants = self._constants[np.append(True, self._uses[1:] > 0)]
        return next(dtype for dtype in TYPES
                    if all(np.can_cast(other, dtype) for other in held)
                    and _holds(dtype, constants))

    def share(self) -> "Bricks":
        """Returns a copy. Costs little; a later write to either copies what it changes."""
        copy = Bricks(self.size, self.file_dtype, float(self.background))
        copy._pages, self._own = list(self._pages), set()
        copy._pools = [pool.share() for pool in self._pools]
        copy._constants, copy._uses = self._constants, self._uses
        copy._code_of = dict(self._code_of)
        copy.hash = self.hash
        return copy

    # Writing. Numbers ascend.

    def put(self, numbers: Numbers, values: Voxels) -> None:
        """values: (n, 512), of one of TYPES."""
        kind = TYPES.index(values.dtype)
        pool, old = self._pools[kind], self._codes(numbers)
        self.hash = self.hash - self._hash_of(numbers, old) + hash_of_bricks(numbers, values)
        new = old.copy()
        moves = old >> _SLOT_BITS != kind + 1
        new[moves] = pool.take(int(np.count_nonzero(moves))) | np.uint32(kind + 1 << _SLOT_BITS)
        pool.write(new & _SLOT, values)
        self._replace(numbers, old, new)

    def fill(self, numbers: Numbers, values: npt.NDArray[np.float32]) -> None:
        """values: (n,), the one value of each brick."""
        old, new = self._codes(numbers), self._constants_of(values)
        before = self._hash_of(numbers, old)
        self._replace(numbers, old, new)
        self.hash = self.hash - before + self._hash_of(numbers, new)

    def _constants_of(self, values: npt.NDArray[np.float32]) -> Codes:
        distinct, places = np.unique(values.view(np.uint32), return_inverse=True)
        new = [bits for bits in distinct.tolist() if bits not in self._code_of]
        if new:
            unused = (np.flatnonzero(self._uses[1:] == 0) + 1)[:len(new)]
            more = len(new) - len(unused)
            codes = np.append(unused, len(self._uses) + np.arange(more))
            self._constants = np.append(self._constants, np.zeros(more, np.float32))
            self._constants[codes] = np.array(new, np.uint32).view(np.float32)
            self._uses = np.append(self._uses, np.zeros(more, np.int64))
            self._code_of.update(zip(new, codes.tolist()))
        return np.array([self._code_of[bits] for bits in distinct.tolist()], np.uint32)[places]

    def _replace(self, numbers: Numbers, old: Codes, new: Codes) -> None:
        for kind, pool in enumerate(self._pools):
            if pool.count:
                pool.release(old[(old >> _SLOT_BITS == kind + 1) & (old != new)] & _SLOT)
        self._count_constants(old, new)
        for page, part in equal_runs(numbers >> _PAGE_BITS):
            self._owned(page)[numbers[part] & (_PAGE_CODES - 1)] = new[part]

    def _count_constants(self, old: Codes, new: Codes) -> None:
        length = len(self._uses)
        if length == 1:
            return
        ends, begins = (np.bincount(codes[codes < length], minlength=length)
                        for codes in (old, new))
        self._uses = self._uses + begins - ends
        for code in np.flatnonzero((ends > 0) & (self._uses == 0)).tolist():
            if code != 0:
                del self._code_of[int(self._constants[code:code + 1].view(np.uint32)[0])]

    def _owned(self, page: int) -> Codes:
        held = self._pages[page]
        if held is None or page not in self._own:
            held = np.zeros(_PAGE_CODES, np.uint32) if held is None else held.copy()
            self._pages[page] = held
            self._own.add(page)
        return held

    # Reading.

    def _codes(self, numbers: Numbers) -> Codes:
        codes = np.zeros(len(numbers), np.uint32)
        for page, part in equal_runs(numbers >> _PAGE_BITS):
            held = self._pages[page]
            if held is not None:
                codes[part] = held[numbers[part] & (_PAGE_CODES - 1)]
        return codes

    def _read(self, codes: Codes, dtype: np.dtype[typing.Any]) -> Voxels:
        """(n, 512)"""
        values = np.empty((len(codes), BRICK_VOXELS), dtype)
        kinds = codes >> _SLOT_BITS
        rows = np.flatnonzero(kinds == 0)
        values[rows] = self._constants[codes[rows]][:, None].astype(dtype)
        for kind, pool in enumerate(self._pools):
            if pool.count:
                rows = np.flatnonzero(kinds == kind + 1)
                pool.read(codes[rows] & _SLOT, values, rows)
        return values

    def _hash_of(self, numbers: Numbers, codes: Codes) -> Halves:
        halves = np.zeros(2, np.uint64)
        for begin in range(0, len(numbers), _BLOCK):
            part = slice(begin, begin + _BLOCK)
            first = codes[begin]
            if first <= _SLOT and (codes[part] == first).all():
                halves += hash_of_constant(numbers[part], self._constants[first])
            else:
                halves += hash_of_bricks(numbers[part], self._read(codes[part], TYPES[3]))
        return halves

    @functools.cached_property
    def values(self) -> Voxels:
        """All voxels, read-only, of bricks that nobody writes. Errors: as box()."""
        values = self.box((0, 0, 0), self.size)
        values.flags.writeable = False
        return values

    def box(self, begin: Corner, end: Corner) -> Voxels:
        """The voxels from `begin` up to `end`. Errors: TooLarge (more than 2³¹ voxels)."""
        shape = tuple(max(0, last - first) for first, last in zip(begin, end))
        if math.prod(shape) > _MOST_DENSE_VOXELS:
            raise TooLarge(f"an array of {shape[0]} x {shape[1]} x {shape[2]} voxels is too "
                           "large: it has at most 2^31. Take parts, as in volume[0:500, 0:500, "
                           "0:500], or active_bricks() and tiles()")
        out = np.empty(shape, self.dtype)
        if out.size:
            for first, last in self._blocks(begin, end):
                self._copy_block(first, last, begin, out)
        return out

    def _blocks(self, begin: Corner, end: Corner
                ) -> collections.abc.Iterator[tuple[Corner, Corner]]:
        """Yields first and last brick, not included, of parts of at most _BLOCK bricks."""
        low = [first // EDGE for first in begin]
        high = [-(-last // EDGE) for last in end]
        step_c = min(high[2] - low[2], _BLOCK)
        step_b = max(1, _BLOCK // step_c)
        for a in range(low[0], high[0]):
            for b in range(low[1], high[1], step_b):
                for c in range(low[2], high[2], step_c):
                    yield (a, b, c), (a + 1, min(b + step_b, high[1]), min(c + step_c, high[2]))

    def _copy_block(self, first: Corner, last: Corner, begin: Corner, out: Voxels) -> None:
        """Copies the bricks' part of `out`, the voxels from `begin` on."""
        b, c = np.arange(first[1], last[1]), np.arange(first[2], last[2])
        row = first[0] * self.counts[1] + b
        codes = self._codes((row[:, None] * self.counts[2] + c).ravel())
        # Where the bricks' and the array's voxels meet.
        lows = [max(EDGE * place, start) for place, start in zip(first, begin)]
        highs = [min(EDGE * place, start + size)
                 for place, start, size in zip(last, begin, out.shape)]
        place = tuple(slice(low - start, high - start)
                      for low, high, start in zip(lows, highs, begin))
        if not codes.any():
            out[place] = self.background.astype(out.dtype)
            return
        # A row of 8 voxels is copied as one item.
        item = np.dtype((np.void, EDGE * out.dtype.itemsize))
        rows = self._read(codes, out.dtype).view(item).reshape(len(b), len(c), EDGE, EDGE)
        block = np.empty((EDGE, len(b), EDGE, len(c)), item)
        block[:] = rows.transpose(2, 0, 3, 1)
        dense = block.view(out.dtype).reshape(EDGE, EDGE * len(b), EDGE * len(c))
        out[place] = dense[tuple(slice(low - EDGE * brick, high - EDGE * brick)
                                 for low, high, brick in zip(lows, highs, first))]

    def stored(self) -> collections.abc.Iterator[tuple[Numbers, Voxels]]:
        """Yields numbers and voxels, (n, 512), of bricks that have not one value throughout."""
        dtype = self.dtype
        places = [np.flatnonzero(held > _SLOT) + (page << _PAGE_BITS)
                  for page, held in enumerate(self._pages) if held is not None]
        numbers = np.concatenate(places) if places else np.empty(0, np.int64)
        for begin in range(0, len(numbers), _BATCH):
            part = numbers[begin:begin + _BATCH]
            yield part, self._read(self._codes(part), dtype)

    def corners(self, numbers: Numbers) -> npt.NDArray[np.int64]:
        """(n, 3): the first voxel of each brick."""
        return EDGE * np.stack(np.unravel_index(numbers, self.counts), axis=1)

    def constant(self) -> collections.abc.Iterator[tuple[Numbers, npt.NDArray[np.float32]]]:
        """Yields numbers and values of bricks with one value that is not background."""
        for page, held in enumerate(self._pages):
            if held is not None:
                places = np.flatnonzero((held > 0) & (held <= _SLOT))
                yield places + (page << _PAGE_BITS), self._constants[held[places]]
