"""The options of loads, uploads and series."""

import collections.abc
import dataclasses
import typing

from palpate._enums import VoxelType
from palpate._errors import InvalidArgument
from palpate._geometry import Triple, vector_of
from palpate._settings import put_changes
from palpate._values import number_or_none, switch, text_of, whole_or_none
from palpate._word import numbers_by_word
from palpate.v1 import volume_pb2

_TYPES = numbers_by_word(VoxelType)
_MOST_FRAMES = (1 << 32) - 1

Changes = collections.abc.Mapping[str, typing.Any]


@dataclasses.dataclass(frozen=True)
class Raw:
    """Describes a file that holds only voxels, x fastest.

    size: voxels along x, y, z
    type: "int8", "uint8", "int16", "uint16", "int32", "uint32", "float32" or "float64"
    big_endian: the high byte of each voxel comes first
    offset_bytes: bytes before the first voxel
    Example: conn.volume.load("head.raw", raw=palpate.Raw((256, 256, 113), "uint16"))
    """

    size: tuple[int, int, int]
    type: str
    big_endian: bool = False
    offset_bytes: int = 0


def _raw_of(raw: Raw) -> volume_pb2.RawVoxels:
    if not isinstance(raw, Raw):
        raise InvalidArgument(f"raw is a palpate.Raw, not {raw!r}")
    if raw.type not in _TYPES:
        raise InvalidArgument(f"the type of raw voxels is one of {', '.join(_TYPES)}, not "
                              f"{raw.type!r}")
    try:
        x, y, z = raw.size
        return volume_pb2.RawVoxels(
            size_x=x, size_y=y, size_z=z, type=_TYPES[raw.type],
            big_endian=switch("big_endian", raw.big_endian), offset_bytes=raw.offset_bytes)
    except (TypeError, ValueError, OverflowError):
        raise InvalidArgument("a raw file has a size of three whole numbers and an offset, not "
                              f"{raw.size!r} and {raw.offset_bytes!r}") from None


def load_options(isovalue: float | None = None, normalized_isovalue: float | None = None,
                 device_mm_per_volume_mm: float | None = None, spacing_mm: Triple | None = None,
                 frame: int | None = None, grid: str = "", component: str = "",
                 raw: Raw | None = None, discard_edits: bool = False,
                 settings: Changes | None = None) -> volume_pb2.LoadVolumeRequest:
    """Errors: InvalidArgument, AttributeError (no such setting)."""
    if isovalue is not None and normalized_isovalue is not None:
        raise InvalidArgument("name the isovalue or the normalised one, not both")
    request = volume_pb2.LoadVolumeRequest(
        isovalue=number_or_none("isovalue", isovalue),
        normalized_isovalue=number_or_none("normalized_isovalue", normalized_isovalue),
        device_mm_per_volume_mm=number_or_none("device_mm_per_volume_mm",
                                               device_mm_per_volume_mm),
        frame=whole_or_none("frame", frame, _MOST_FRAMES), grid=text_of("grid", grid or ""),
        component=text_of("component", component or ""),
        raw=None if raw is None else _raw_of(raw),
        discard_edits=switch("discard_edits", discard_edits),
        spacing_mm=None if spacing_mm is None else vector_of("spacing_mm", spacing_mm))
    if not isinstance(settings or {}, collections.abc.Mapping):
        raise InvalidArgument(f"settings are names and values, not {settings!r}")
    put_changes(request, settings or {})
    return request
