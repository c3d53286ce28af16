"""The framing of a recording's chunks. server/recording/chunk_frame.h describes the bytes."""

import collections.abc
import dataclasses
import enum
import struct
import typing

import xxhash
import zstandard

from palpate._errors import InvalidArgument

_MAGIC = b"\x89PLPREC\n"
_OLDEST_VERSION, _VERSION = 2, 6
# The first version with created_monotonic_ns.
_CLOCK_VERSION = 6
_MOST_PAYLOAD_BYTES = 16 << 20
# More than zstd can need for a payload of the greatest size.
_MOST_STORED_BYTES = _MOST_PAYLOAD_BYTES + (_MOST_PAYLOAD_BYTES >> 8)
_MOST_PROGRAM_BYTES = 256
_HEADER = struct.Struct("<8sIIq")
_CHUNK = struct.Struct("<QQHHII")
_CHECKSUM = struct.Struct("<Q")
_CLOCK = struct.Struct("<q")


class Damaged(Exception):
    """The bytes are not a valid part of a recording; the message says why."""


class Kind(enum.IntEnum):
    SAMPLES = 1
    SCENE = 2
    EDIT = 3
    MARKER = 4
    GAP = 5
    KEYFRAME = 6
    END = 7


@dataclasses.dataclass(frozen=True)
class Header:
    version: int
    created_unix_ns: int
    created_monotonic_ns: int | None
    program: str


class Reader:
    """Reads numbers and texts from bytes, one after the other. Errors: Damaged."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def get(self, layout: str) -> tuple[typing.Any, ...]:
        """layout: a format of struct, little endian."""
        layout = "<" + layout
        return struct.unpack(layout, self.get_bytes(struct.calcsize(layout)))

    def get_bytes(self, count: int) -> bytes:
        if count > len(self._data) - self._at:
            raise Damaged("too short")
        self._at += count
        return self._data[self._at - count:self._at]

    def get_text(self) -> str:
        return self.get_bytes(self.get("I")[0]).decode(errors="replace")

    @property
    def at_end(self) -> bool:
        return self._at == len(self._data)

    def expect_end(self) -> None:
        if not self.at_end:
            raise Damaged("too long")


def read_header(stream: typing.BinaryIO, name: str) -> Header:
    """Errors: InvalidArgument; the text names the file."""
    start = stream.read(_HEADER.size)
    if len(start) < _HEADER.size or not start.startswith(_MAGIC):
        raise InvalidArgument(f"{name} is no recording of Palpate")
    _, version, program_bytes, created_unix_ns = _HEADER.unpack(start)
    if not _OLDEST_VERSION <= version <= _VERSION:
        raise InvalidArgument(f"{name} is a recording of version {version}, or damaged; this "
                              f"package reads versions {_OLDEST_VERSION} to {_VERSION}")
    if program_bytes > _MOST_PROGRAM_BYTES:
        raise InvalidArgument(f"{name} has a damaged header")
    has_clock = version >= _CLOCK_VERSION
    checked_bytes = program_bytes + (_CLOCK.size if has_clock else 0)
    rest = stream.read(checked_bytes + _CHECKSUM.size)
    if len(rest) < checked_bytes + _CHECKSUM.size:
        raise InvalidArgument(f"{name} ends within its header")
    checked, checksum = rest[:checked_bytes], rest[checked_bytes:]
    if _CHECKSUM.unpack(checksum)[0] != xxhash.xxh3_64_intdigest(start + checked):
        raise InvalidArgument(f"{name} has a damaged header")
    return Header(version, created_unix_ns,
                  _CLOCK.unpack(checked[program_bytes:])[0] if has_clock else None,
                  checked[:program_bytes].decode(errors="replace"))


def read_chunks(stream: typing.BinaryIO) -> collections.abc.Iterator[tuple[Kind, bytes]]:
    """Yields payloads, still packed by zstd, for unpack(). Errors: Damaged, for the next one."""
    number = 0
    while start := stream.read(_CHUNK.size):
        if len(start) < _CHUNK.size:
            raise Damaged("cut")
        checksum, stored_number, kind, flags, raw_bytes, stored_bytes = _CHUNK.unpack(start)
        if raw_bytes > _MOST_PAYLOAD_BYTES or stored_bytes > _MOST_STORED_BYTES:
            raise Damaged("damaged: its length is beyond the limits")
        packed = stream.read(stored_bytes)
        if len(packed) < stored_bytes:
            raise Damaged("cut")
        if checksum != xxhash.xxh3_64_intdigest(start[_CHECKSUM.size:] + packed):
            raise Damaged("damaged: its checksum does not fit")
        if stored_number != number:
            raise Damaged("out of order")
        if flags != 0 or kind not in Kind.__members__.values():
            raise Damaged("of a kind that this package does not know")
        # zstd allocates the size in its own header, so that size must be the same as ours.
        try:
            if zstandard.frame_content_size(packed) != raw_bytes:
                raise Damaged("damaged: of another size")
        except zstandard.ZstdError:
            raise Damaged("damaged: it does not unpack") from None
        yield Kind(kind), packed
        number += 1


def unpack(packed: bytes) -> bytes:
    """Errors: Damaged."""
    try:
        return zstandard.ZstdDecompressor().decompress(packed)
    except zstandard.ZstdError:
        raise Damaged("damaged: it does not unpack") from None
