"""A copy of the daemon's volume, put together from the bricks that it streams."""

import contextlib
import dataclasses
import math
import typing

import grpc
import numpy as np
import numpy.typing as npt
import xxhash
import zstandard

from palpate._errors import Internal, TooLarge
from palpate._geometry import array_of_vector, matrix_of_map
from palpate._link import AcknowledgedCall, Link
from palpate.v1 import volume_stream_pb2

_EDGE = 8
_BRICK_BYTES = 4 * _EDGE**3
_MAX_UNACKNOWLEDGED = 8
# The contract says 64 bricks; a later daemon may send more, but not any number.
_MOST_BRICKS = 4096
_HALF = 1 << 64
# 8 GiB: sparse volumes may have more places than a computer has memory.
_MOST_VOXELS = 1 << 31


@dataclasses.dataclass(frozen=True, eq=False)
class Volume:
    """A volume with its voxels.

    values: (nx, ny, nz), indexed [x, y, z], data units
    spacing_mm: (3,) along x, y, z, mm
    world_from_index: (4, 4) voxel index (x, y, z, 1) to world: mm, LPS as in DICOM
    device_from_index: (4, 4) voxel index (x, y, z, 1) to the device frame: mm
    value_min: least value at load, data units
    value_max: greatest value at load, data units
    unit: of the values, as the file states it; may be empty
    source: path, builtin name or "upload:NAME" that it was loaded from
    volume_revision: of which this is a copy
    """

    values: npt.NDArray[np.float32]
    spacing_mm: npt.NDArray[np.float64]
    world_from_index: npt.NDArray[np.float64]
    device_from_index: npt.NDArray[np.float64]
    value_min: float
    value_max: float
    unit: str
    source: str
    volume_revision: int


class _Copy:
    """What of one volume has come so far. ValueError for a message that makes no sense."""

    def __init__(self, lattice: volume_stream_pb2.VolumeLattice) -> None:
        self.lattice = lattice
        self._size = np.array([lattice.size_x, lattice.size_y, lattice.size_z])
        if not self._size.all():
            raise ValueError("a volume without voxels")
        self._counts = -(-self._size // _EDGE)
        if math.prod(int(count) * _EDGE for count in self._counts) > _MOST_VOXELS:
            raise TooLarge(f"the volume has {lattice.size_x} x {lattice.size_y} x "
                           f"{lattice.size_z} voxels; a copy has at most {_MOST_VOXELS}")
        self._background = np.float32(
            lattice.background if lattice.HasField("background") else lattice.value_min)
        self._voxels = np.full(self._counts * _EDGE, self._background)
        # Axes: the brick's place, then the voxel's place in it.
        a, b, c = self._counts
        self._bricks = self._voxels.reshape(a, _EDGE, b, _EDGE, c, _EDGE).transpose(
            0, 2, 4, 1, 3, 5)
        self._hashes: dict[int, int] = {}

    def put(self, message: volume_stream_pb2.VolumeBricks) -> None:
        numbers = np.array(message.brick_numbers, dtype=np.uint64)
        if not 0 < len(numbers) <= _MOST_BRICKS or numbers.max() >= self._counts.prod():
            raise ValueError("bricks outside of the volume")
        wanted = len(numbers) * _BRICK_BYTES
        if zstandard.frame_content_size(message.zstd_values) != wanted:
            raise ValueError("bricks of another size")
        data = zstandard.ZstdDecompressor().decompress(message.zstd_values)
        place = np.unravel_index(numbers.astype(np.int64), self._counts)
        self._bricks[place] = np.frombuffer(data, "<f4").reshape(-1, _EDGE, _EDGE, _EDGE)
        view = memoryview(data)
        for n, number in enumerate(message.brick_numbers):
            brick = view[n * _BRICK_BYTES:(n + 1) * _BRICK_BYTES]
            self._hashes[number] = xxhash.xxh3_128_intdigest(brick, number)

    def check(self, complete: volume_stream_pb2.VolumeComplete) -> None:
        """Equal to the daemon's? Bricks that did not come are background."""
        background = np.full(_EDGE**3, self._background, "<f4").tobytes()
        high = low = 0
        for number in range(int(self._counts.prod())):
            digest = self._hashes.get(number)
            if digest is None:
                digest = xxhash.xxh3_128_intdigest(background, number)
            high += digest >> 64
            low += digest % _HALF
        if (high % _HALF, low % _HALF) != (complete.content_hash_high, complete.content_hash_low):
            raise ValueError("the voxels are not the daemon's")

    def values(self) -> npt.NDArray[np.float32]:
        x, y, z = self._size
        return np.ascontiguousarray(self._voxels[:x, :y, :z])


class _Fetch:
    """Takes the messages of a stream up to the first complete copy."""

    def __init__(self) -> None:
        self._copy: _Copy | None = None
        self._device_from_index: npt.NDArray[np.float64] | None = None

    def take(self, message: volume_stream_pb2.StreamVolumeResponse) -> Volume | None:
        event = message.WhichOneof("event")
        if event == "lattice":
            # Another volume was loaded meanwhile: what came of the last one is void.
            self._copy = _Copy(message.lattice)
        elif event == "placement":
            self._device_from_index = matrix_of_map(message.placement.device_from_index)
        elif event == "bricks":
            self._known().put(message.bricks)
        elif event == "complete":
            return self._volume(message.complete)
        return None

    def _known(self) -> _Copy:
        if self._copy is None:
            raise ValueError("bricks before the lattice")
        return self._copy

    def _volume(self, complete: volume_stream_pb2.VolumeComplete) -> Volume:
        copy = self._known()
        copy.check(complete)
        if self._device_from_index is None:
            raise ValueError("no placement")
        lattice = copy.lattice
        return Volume(
            values=copy.values(), spacing_mm=array_of_vector(lattice.spacing_mm),
            world_from_index=matrix_of_map(lattice.world_from_index),
            device_from_index=self._device_from_index, value_min=lattice.value_min,
            value_max=lattice.value_max, unit=lattice.unit, source=lattice.source,
            volume_revision=complete.revision.volume_revision)


def fetch_volume(link: Link, stub: typing.Any) -> Volume:
    """One complete copy. Errors: Internal, Unavailable."""
    link.check_open()
    start = volume_stream_pb2.StreamVolumeStart(max_unacknowledged=_MAX_UNACKNOWLEDGED)
    call = AcknowledgedCall(stub.StreamVolume, volume_stream_pb2.StreamVolumeRequest(start=start))
    fetch = _Fetch()
    try:
        with contextlib.closing(iter(call)) as messages:
            for message in messages:
                if (volume := fetch.take(message)) is not None:
                    return volume
    except grpc.RpcError as failed:
        raise link.error_of_end(failed) from None
    except (ValueError, zstandard.ZstdError) as damaged:
        raise Internal(f"the stream of the volume makes no sense: {damaged}") from None
    raise link.error_of_end(None)
