"""Bricks of one voxel type, in slots of arrays that copies share until one of them writes."""

import collections.abc
import mmap
import typing

import numpy as np
import numpy.typing as npt

BRICK_VOXELS = 512
# Few enough that a write to a shared array copies little.
_SLOT_BITS = 8
_CHUNK_SLOTS = 1 << _SLOT_BITS

Slots = npt.NDArray[np.uint32]
Voxels = npt.NDArray[typing.Any]


def equal_runs(keys: npt.NDArray[typing.Any]) -> collections.abc.Iterator[tuple[int, slice]]:
    """Yields each key and where it is, for keys that follow each other."""
    if len(keys):
        cuts = ((keys[1:] != keys[:-1]).nonzero()[0] + 1).tolist()
        for begin, end in zip([0, *cuts], [*cuts, len(keys)]):
            yield int(keys[begin]), slice(begin, end)


def _memory(dtype: np.dtype[typing.Any]) -> Voxels:
    """Memory that goes back to the system when it is released, which malloc() does not promise."""
    size = _CHUNK_SLOTS * BRICK_VOXELS * dtype.itemsize
    memory = mmap.mmap(-1, size, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    return np.frombuffer(memory, dtype).reshape(_CHUNK_SLOTS, BRICK_VOXELS)


class BrickPool:
    """Threads: one that writes. A pool that nobody writes may be read on any thread."""

    def __init__(self, dtype: np.dtype[typing.Any]) -> None:
        self.dtype = dtype
        self.count = 0
        self._chunks: list[Voxels | None] = []
        self._used: list[int] = []
        self._gaps: list[int] = []
        # Chunks that no other pool has.
        self._own: set[int] = set()
        self._free = np.empty(0, np.uint32)

    def share(self) -> "BrickPool":
        """Returns a copy. Costs little; a write to either copies the chunk that it changes."""
        copy = BrickPool(self.dtype)
        copy.count, copy._free = self.count, self._free
        copy._chunks, copy._used = list(self._chunks), list(self._used)
        copy._gaps = list(self._gaps)
        self._own = set()
        return copy

    def take(self, count: int) -> Slots:
        while len(self._free) < count:
            self._add_chunk()
        taken, self._free = self._free[:count], self._free[count:]
        self._use(taken, 1)
        return taken

    def release(self, slots: Slots) -> None:
        if not len(slots):
            return
        self._free = np.sort(np.concatenate((self._free, slots)))
        self._use(slots, -1)
        unused = [chunk for chunk in np.unique(slots >> _SLOT_BITS).tolist()
                  if not self._used[chunk]]
        for chunk in unused:
            self._chunks[chunk] = None
            self._gaps.append(chunk)
            self._own.discard(chunk)
        if unused:
            self._free = self._free[~np.isin(self._free >> _SLOT_BITS, unused)]

    def write(self, slots: Slots, values: Voxels) -> None:
        """values: (n, 512)"""
        for chunk, part in equal_runs(slots >> _SLOT_BITS):
            self._owned(chunk)[slots[part] & (_CHUNK_SLOTS - 1)] = values[part]

    def read(self, slots: Slots, out: Voxels, rows: npt.NDArray[np.intp]) -> None:
        """Copies slots into rows of `out`, (n, 512) of any type."""
        order = np.argsort(slots, kind="stable")
        slots, rows = slots[order], rows[order]
        for chunk, part in equal_runs(slots >> _SLOT_BITS):
            held = self._chunks[chunk]
            assert held is not None
            out[rows[part]] = held[slots[part] & (_CHUNK_SLOTS - 1)]

    def _use(self, slots: Slots, times: int) -> None:
        self.count += times * len(slots)
        for chunk, part in equal_runs(slots >> _SLOT_BITS):
            self._used[chunk] += times * (part.stop - part.start)

    def _add_chunk(self) -> None:
        if self._gaps:
            chunk = self._gaps.pop()
        else:
            chunk = len(self._chunks)
            self._chunks.append(None)
            self._used.append(0)
        self._chunks[chunk] = _memory(self.dtype)
        self._own.add(chunk)
        begin = chunk << _SLOT_BITS
        self._free = np.concatenate((self._free, np.arange(begin, begin + _CHUNK_SLOTS,
                                                           dtype=np.uint32)))

    def _owned(self, chunk: int) -> Voxels:
        held = self._chunks[chunk]
        assert held is not None
        if chunk not in self._own:
            mine = _memory(self.dtype)
            mine[:] = held
            held = self._chunks[chunk] = mine
            self._own.add(chunk)
        return held
