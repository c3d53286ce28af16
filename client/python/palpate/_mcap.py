"""The records of an MCAP file (https://mcap.dev/spec). The limits are those of server/recording."""

import collections.abc
import dataclasses
import struct
import typing
import warnings
import zlib

import zstandard
from google.protobuf.message import DecodeError, Message

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, METADATA, DATA_END = 2, 3, 4, 5, 6, 12, 15
# opcode and length; and of a message: channel, sequence, log_time and publish_time
HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = struct.Struct("<HIQQ")
_MOST_CHUNK_BYTES = 16 << 20
_MOST_RECORD_BYTES = 4 << 20
_PART_BYTES = 1 << 20
_MOST_TEXT_BYTES = 16 << 10
_MOST_DECLARATIONS = 4096
_MOST_MESSAGE_BYTES = 512 << 10
# Recordings unpack to less than thirty times their size.
_MOST_UNPACKED, _FREE_BYTES = 64, 16 << 20


class Damaged(Exception):
    """The bytes are not a valid part of a recording; the message says why."""


class Fields:
    """The fields of a record, one after the other. Errors: Damaged."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def get(self, layout: str) -> tuple[typing.Any, ...]:
        """layout: a format of struct, little endian."""
        layout = "<" + layout
        return struct.unpack(layout, self.get_bytes(struct.calcsize(layout)))

    def get_bytes(self, count: int) -> bytes:
        if count > len(self._data) - self._at:
            raise Damaged("damaged: a record is too short")
        self._at += count
        return self._data[self._at - count:self._at]

    def get_text(self, most_bytes: int = _MOST_TEXT_BYTES) -> str:
        size, = self.get("I")
        if size > most_bytes:
            raise Damaged("damaged: a text is too long")
        return self.get_bytes(size).decode(errors="replace")

    def get_texts(self) -> dict[str, str]:
        fields, texts = Fields(self.get_bytes(self.get("I")[0])), {}
        while fields._at < len(fields._data):
            key = fields.get_text()
            texts[key] = fields.get_text(_MOST_RECORD_BYTES)
        return texts

    def expect_end(self) -> None:
        if self._at < len(self._data):
            raise Damaged("damaged: a record is too long")


@dataclasses.dataclass(frozen=True)
class Channel:
    topic: str
    schema: int  # 0: none of protobuf


class McapFile:
    """Reads a file, chunk by chunk. What was declared grows meanwhile. Errors: Damaged.

    metadata: by name. is_complete: it was closed, has been read to its end, and its checksums fit.
    """

    def __init__(self, stream: typing.BinaryIO, size: int) -> None:
        self._stream, self._left = stream, size
        self._unpacked_left = _MOST_UNPACKED * size + _FREE_BYTES
        self._zstd = zstandard.ZstdDecompressor()
        self.schemas: dict[int, str] = {}
        self.channels: dict[int, Channel] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.is_complete = False
        if size < len(MAGIC) or self._read(len(MAGIC)) != MAGIC:
            raise Damaged("no MCAP file")
        self._crc = zlib.crc32(MAGIC)

    def _read(self, count: int) -> bytes:
        if count > self._left:
            raise Damaged("cut")
        data = self._stream.read(count)
        if len(data) < count:
            raise Damaged("cut")
        self._left -= count
        return data

    def _parts(self, count: int) -> collections.abc.Iterator[bytes]:
        if count > self._left:
            raise Damaged("cut")
        while count:
            yield self._read(min(count, _PART_BYTES))
            count -= min(count, _PART_BYTES)

    def chunks(self) -> collections.abc.Iterator[bytes]:
        """Yields records, one after the other; also those that are in no chunk."""
        while self._left:
            head = self._read(HEAD.size)
            opcode, size = HEAD.unpack(head)
            if opcode == DATA_END:
                _check_crc(Fields(self._read(min(size, _MOST_RECORD_BYTES))).get("I")[0], self._crc)
                self._read_summary()
                return
            self._crc = zlib.crc32(head, self._crc)
            if opcode not in (SCHEMA, CHANNEL, MESSAGE, CHUNK, METADATA):
                # The header, indexes, attachments, and records of later versions.
                for part in self._parts(size):
                    self._crc = zlib.crc32(part, self._crc)
                continue
            if size > (_MOST_CHUNK_BYTES if opcode == CHUNK else _MOST_RECORD_BYTES):
                raise Damaged("damaged: a record is too large")
            content = self._read(size)
            self._crc = zlib.crc32(content, self._crc)
            if opcode == CHUNK:
                yield self._unpack(content)
            elif opcode == MESSAGE:
                yield head + content
            else:
                self.declare(opcode, content)

    def declare(self, opcode: int, content: bytes) -> None:
        """Takes a schema, a channel or metadata; ignores other records."""
        fields = Fields(content)
        if opcode == SCHEMA:
            number, = fields.get("H")
            if number and number not in self.schemas:
                self.schemas[number] = fields.get_text()
        elif opcode == CHANNEL:
            number, = fields.get("H")
            if number not in self.channels:
                schema, = fields.get("H")
                topic, encoding, _ = fields.get_text(), fields.get_text(), fields.get_texts()
                self.channels[number] = Channel(topic, schema if encoding == "protobuf" else 0)
        elif opcode == METADATA:
            name = fields.get_text()
            self.metadata.setdefault(name, fields.get_texts())
        if len(self.schemas) + len(self.channels) + len(self.metadata) > _MOST_DECLARATIONS:
            raise Damaged("damaged: it has too many channels")

    def _unpack(self, content: bytes) -> bytes:
        fields = Fields(content)
        size, crc = fields.get("16xQI")
        packing = fields.get_text()
        packed = fields.get_bytes(fields.get("Q")[0])
        fields.expect_end()
        self._unpacked_left -= size
        if size > _MOST_CHUNK_BYTES or self._unpacked_left < 0:
            raise Damaged("damaged: it holds more than a file of its size can")
        if packing not in ("", "zstd"):
            raise Damaged(f"packed by {packing[:16]}, which this package does not read: use zstd")
        data = packed
        if packing:
            # zstd allocates the size in its own header, so that size must be the same.
            try:
                if zstandard.frame_content_size(packed) not in (size, -1):
                    raise Damaged("damaged: a chunk of another size")
                data = self._zstd.decompress(packed, max_output_size=size, allow_extra_data=False)
            except zstandard.ZstdError:
                raise Damaged("damaged: a chunk does not unpack") from None
        if len(data) != size:
            raise Damaged("damaged: a chunk of another size")
        _check_crc(crc, zlib.crc32(data))
        return data

    def _read_summary(self) -> None:
        footer_bytes = HEAD.size + 20 + len(MAGIC)
        if self._left < footer_bytes:
            raise Damaged("cut within its summary")
        crc = 0
        for part in self._parts(self._left - footer_bytes):
            crc = zlib.crc32(part, crc)
        footer = self._read(footer_bytes)
        if not footer.endswith(MAGIC) or footer[0] != FOOTER:
            raise Damaged("cut within its summary")
        end = footer_bytes - len(MAGIC) - 4
        _check_crc(struct.unpack_from("<I", footer, end)[0], zlib.crc32(footer[:end], crc))
        self.is_complete = True


T = typing.TypeVar("T", bound=Message)


def parsed(kind: type[T], data: bytes) -> T:
    """Returns the message. Errors: Damaged."""
    # A message of empty parts takes a hundred times its bytes.
    if len(data) > _MOST_MESSAGE_BYTES:
        raise Damaged("damaged: a message is too large")
    # A stray end-group tag is only a warning, and the rest of the message is lost.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            message: T = kind.FromString(data)
            message.DiscardUnknownFields()  # they take a hundred times their bytes
            return message
        except (DecodeError, RuntimeWarning, SystemError):
            raise Damaged(f"damaged: a {kind.DESCRIPTOR.name} makes no sense") from None


def _check_crc(stored: int, computed: int) -> None:
    # 0: none was stored.
    if stored not in (0, computed):
        raise Damaged("damaged: a checksum does not fit")
