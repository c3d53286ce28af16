"""Ticks of a recording as arrays, without parsing each.

Palpate writes ticks so that most have their numbers at the same places. The first record of a run
tells where: its bytes are walked once. The run ends at the first record that differs in more than
its numbers. Nothing is believed that protobuf would not read the same.
"""

import dataclasses
import operator
import typing

import numpy as np
import numpy.typing as npt
from google.protobuf.descriptor import Descriptor, FieldDescriptor

from palpate._mcap import HEAD, MESSAGE_HEAD, Damaged, parsed
from palpate._pose_columns import RECORDED
from palpate._tables import WORDS
from palpate.v1 import recorded_pb2

_START = HEAD.size + MESSAGE_HEAD.size
_MOST_LAYOUTS = 8
# Fewer records are parsed.
_LEAST_ROWS = 8
_LEAST_BLOCK_ROWS = 1 << 11
# Of a moving hand, in the file.
_TICK_BYTES = 160
# Whatever the size of the file.
_FREE_TICKS = 1000
# After this one, none could come.
_NO_TICK = (1 << 64) - 1
# The greatest number of each word.
_KNOWN = {name: max(map(int, kind)) for name, kind in WORDS.items()}
_VARINT, _FIXED64, _WITHIN, _FIXED32 = 0, 1, 2, 5
_KINDS = {FieldDescriptor.CPPTYPE_DOUBLE: _FIXED64, FieldDescriptor.CPPTYPE_MESSAGE: _WITHIN}

Bytes = npt.NDArray[np.uint8]
Columns = dict[str, npt.NDArray[typing.Any]]


class _Odd(Exception):
    """A record that is better parsed by protobuf."""


@dataclasses.dataclass
class _Layout:
    """Where the numbers of a record are; and the bytes that all records have in common."""

    size: int  # of a record
    varints: dict[str, tuple[int, int]]  # by path: place and width
    doubles: dict[str, int]  # by path: place
    messages: set[str]  # that are there
    mask: Bytes
    common: Bytes

    def count(self, rows: Bytes) -> int:
        """Returns how many of the first rows have this layout."""
        count, step = 0, 1
        while count < len(rows):
            part = rows[count:count + step]
            differs = (part & self.mask) != self.common
            if differs.any():
                return count + int(np.argmax(differs.any(axis=1)))
            # A short run must not cost a look at all rows.
            count, step = count + len(part), 8 * step
        return count


class _Walk:
    """Walks the bytes of one record. Errors: _Odd."""

    def __init__(self, record: bytes) -> None:
        self._record = record
        self.mask = np.zeros(len(record), np.uint8)
        self.mask[:HEAD.size + 2] = 0xff  # opcode, length and channel
        self.varints: dict[str, tuple[int, int]] = {}
        self.doubles: dict[str, int] = {}
        self.messages: set[str] = set()
        self.take(_START, len(record), recorded_pb2.RecordedTick.DESCRIPTOR, "")

    def take(self, at: int, end: int, message: Descriptor, prefix: str) -> None:
        while at < end:
            tag, at = self._fixed_varint(at, end)
            field, kind = message.fields_by_number.get(tag >> 3), tag & 7
            path = prefix + field.name if field else ""
            if not tag >> 3 or (field and kind != _KINDS.get(field.cpp_type, _VARINT)):
                raise _Odd
            if path in self.varints or path in self.doubles or path in self.messages:
                raise _Odd
            begin = at
            if kind == _VARINT:
                at = self._varint_end(at, end)
                self.mask[begin:at] = 0x80
            elif kind in (_FIXED64, _FIXED32):
                at += 8 if kind == _FIXED64 else 4
            elif kind == _WITHIN:
                size, at = self._fixed_varint(at, end)
                if field and at + size <= end:
                    self.messages.add(path)
                    self.take(at, at + size, field.message_type, path + ".")
                at += size
            else:
                raise _Odd
            if at > end:
                raise _Odd
            if field and kind == _VARINT:
                self.varints[path] = begin, at - begin
            elif field and kind == _FIXED64:
                self.doubles[path] = begin

    def _varint_end(self, at: int, end: int) -> int:
        for n in range(at, min(at + 10, end)):
            if self._record[n] < 0x80:
                return n + 1
        raise _Odd

    def _fixed_varint(self, at: int, end: int) -> tuple[int, int]:
        """A tag or a length, which all records have in common, and where it ends."""
        after = self._varint_end(at, end)
        if after - at > 5:
            raise _Odd
        self.mask[at:after] = 0xff
        number = sum((byte & 0x7f) << 7 * n for n, byte in enumerate(self._record[at:after]))
        if number >> 32:  # protobuf drops the upper bits of a tag
            raise _Odd
        return number, after

    def layout(self) -> _Layout:
        return _Layout(len(self._record), self.varints, self.doubles, self.messages, self.mask,
                       np.frombuffer(self._record, np.uint8) & self.mask)


class TickReader:
    """Collects ticks. Errors: Damaged, when all ticks before the damage are taken."""

    def __init__(self, file_bytes: int) -> None:
        self._layouts: list[_Layout] = []
        self._blocks: list[Columns] = []
        # Of the last block, and those with ticks; each block has twice as many. Most recordings fit
        # into the first one: to join them costs a sixth of the time.
        self._rows = self._used = max(_LEAST_BLOCK_ROWS, file_bytes // _TICK_BYTES) // 2
        self.last: int | None = None  # tick that came, or was lost
        # The index of messages alone has 16 bytes for each tick.
        self._left = file_bytes // 8 + _FREE_TICKS
        self.gaps: list[tuple[int, int]] = []  # the first and the last tick that are missing

    def start_at(self, tick: int) -> None:
        """What comes next begins with this tick. Errors: Damaged."""
        if tick >= _NO_TICK or (self.last is not None and tick <= self.last):
            raise Damaged("damaged: its ticks go back")
        if self.last is not None and tick > self.last + 1:
            self.gaps.append((self.last + 1, tick - 1))
        self.last = tick - 1

    def take(self, chunk: bytes, at: int) -> int:
        """Takes the records that begin at `at`, and are like the first one. Returns their end."""
        size: int = HEAD.size + HEAD.unpack_from(chunk, at)[1]
        end = at + (len(chunk) - at) // size * size
        rows = np.frombuffer(chunk, np.uint8)[at:end].reshape(-1, size)
        layout = self._layout_of(rows)
        count = layout.count(rows) if layout else 0
        if layout and count >= _LEAST_ROWS:
            self._keep(_columns(layout, rows[:count]), count)
            return at + count * size
        self._keep(_parsed(chunk[at + _START:at + size]), 1)
        return at + size

    def _layout_of(self, rows: Bytes) -> _Layout | None:
        for layout in self._layouts:
            if layout.size == rows.shape[1] and layout.count(rows[:1]):
                return layout
        if len(self._layouts) == _MOST_LAYOUTS or len(rows) < _LEAST_ROWS:
            return None
        try:
            layout = _Walk(rows[0].tobytes()).layout()
        except _Odd:
            return None
        self._layouts.append(layout)
        return layout

    def _keep(self, run: Columns, count: int) -> None:
        whole, why = self._whole(run, count)
        if whole:
            self._add({name: column[:whole] for name, column in run.items()}, whole)
        if why:
            raise Damaged(f"damaged: {why}")

    def _whole(self, run: Columns, count: int) -> tuple[int, str]:
        """Returns how many of the first ticks make sense, and why the next one does not, or ""."""
        ticks, ends = run["tick"], [(count, "")]
        if count > self._left:
            ends.append((max(self._left, 0), "it holds more than a file of its size can"))
        self._left -= count
        back = (ticks[1:] <= ticks[:-1]) | (ticks[1:] >= _NO_TICK)
        if self.last is not None and int(ticks[0]) <= self.last or int(ticks[0]) >= _NO_TICK:
            ends.append((0, "its ticks go back"))
        elif back.any():
            ends.append((1 + int(np.argmax(back)), "its ticks go back"))
        for name, known in _KNOWN.items():
            if run[name].min() < 1 or run[name].max() > known:
                odd = (run[name] < 1) | (run[name] > known)
                ends.append((int(np.argmax(odd)),
                             f"a tick has a {name} that this package does not know"))
        return min(ends)

    def _add(self, run: Columns, count: int) -> None:
        ticks = run["tick"]
        self.start_at(int(ticks[0]))
        for n in np.flatnonzero(ticks[1:] - ticks[:-1] > 1):
            self.gaps.append((int(ticks[n]) + 1, int(ticks[n + 1]) - 1))
        self.last = int(ticks[-1])
        begin = 0
        while begin < count:
            if self._used == self._rows:
                # Large blocks: NumPy then asks for large pages.
                self._rows *= 2
                self._blocks.append(_empty(self._rows))
                self._used = 0
            length = min(count - begin, self._rows - self._used)
            for name, column in run.items():
                self._blocks[-1][name][self._used:self._used + length] = column[begin:begin + length]
            self._used += length
            begin += length

    def columns(self) -> Columns:
        """All ticks. Call it once, at the end."""
        if not self._blocks:
            return _empty(0)
        last = self._blocks[-1]
        self._blocks[-1] = {name: column[:self._used] for name, column in last.items()}
        if len(self._blocks) == 1:
            return self._blocks[0]
        # Each column makes room for the next one.
        return {name: np.concatenate([block.pop(name) for block in self._blocks])
                for name in RECORDED}


def _empty(rows: int) -> Columns:
    return {name: np.empty((rows, len(kind)) if isinstance(kind, str) else rows,
                           np.float64 if isinstance(kind, str) else kind)
            for name, (_, kind, _) in RECORDED.items()}


def _view(rows: Bytes, at: int, dtype: str, more: tuple[int, ...] = (),
          apart: tuple[int, ...] = ()) -> npt.NDArray[typing.Any]:
    """The number at this place of each row, which need not be aligned; and `more`, so far apart."""
    return np.ndarray((len(rows), *more), dtype, rows.data, at, rows.strides[:1] + apart)


def _varints(layout: _Layout, rows: Bytes) -> dict[str, npt.NDArray[np.uint64]]:
    """Joins seven bits of each byte, for all varints of a record at once."""
    if not layout.varints:
        return {}
    words = np.empty((len(layout.varints), len(rows)), "<u8")
    for n, (at, width) in enumerate(layout.varints.values()):
        # The eight bytes that end there: a record begins with more.
        words[n] = _view(rows, at + min(width, 8) - 8, "<u8")
    widths = np.array([min(width, 8) for _, width in layout.varints.values()], np.uint64)
    words >>= np.uint64(64) - np.uint64(8) * widths[:, None]
    for mask, bits in ((0x007f007f007f007f, 1), (0x00003fff00003fff, 2), (0x000000000fffffff, 4)):
        upper = words >> np.uint64(8 * bits)
        upper &= np.uint64(mask)
        words &= np.uint64(mask)
        words |= upper << np.uint64(7 * bits)
    for n, (at, width) in enumerate(layout.varints.values()):
        for byte in range(8, width):
            words[n] |= (rows[:, at + byte] & np.uint8(0x7f)).astype(np.uint64) << np.uint64(7 * byte)
    return dict(zip(layout.varints, words))


def _columns(layout: _Layout, rows: Bytes) -> Columns:
    """Some are views of the rows."""
    columns: Columns = {}
    varints = _varints(layout, rows)
    for name, (path, kind, is_optional) in RECORDED.items():
        if isinstance(kind, str):
            columns[name] = _vector(layout, rows, path, kind)
        elif path in layout.doubles:
            columns[name] = _view(rows, layout.doubles[path], "<f8")
        elif path in varints:
            # Words have 32 bits: protobuf leaves out the others.
            columns[name] = varints[path].astype(np.int32) if kind == np.uint8 else varints[path]
        else:
            columns[name] = np.full(len(rows), np.nan if is_optional else 0)
    return columns


def _vector(layout: _Layout, rows: Bytes, path: str, parts: str) -> npt.NDArray[np.float64]:
    if path not in layout.messages:
        return np.full((len(rows), len(parts)), np.nan)
    places = [layout.doubles.get(f"{path}.{part}", 0) for part in parts]
    if places[0] and all(after - before == 9 for before, after in zip(places, places[1:])):
        return _view(rows, places[0], "<f8", (len(parts),), (9,))
    # Of a number that the message lacks: 0.
    return np.stack([_view(rows, at, "<f8") if at else np.zeros(len(rows)) for at in places], axis=1)


def _parsed(message: bytes) -> Columns:
    tick = parsed(recorded_pb2.RecordedTick, message)
    columns: Columns = {}
    for name, (path, kind, is_optional) in RECORDED.items():
        outer, _, leaf = path.rpartition(".")
        holder = operator.attrgetter(outer)(tick) if outer else tick
        parts = kind if isinstance(kind, str) else ""
        held = getattr(holder, leaf)
        if (parts or is_optional) and not holder.HasField(leaf):
            held = [np.nan] * len(parts) if parts else np.nan
        elif parts:
            held = [getattr(held, part) for part in parts]
        dtype = np.float64 if parts else np.int64 if kind == np.uint8 else kind
        columns[name] = np.array([held], dtype)
    return columns
