"""A copy of the daemon's volume, made from the streamed bricks."""

import collections.abc
import contextlib
import typing

import grpc
import numpy as np
import numpy.typing as npt
import zstandard

from palpate._brick_pool import BRICK_VOXELS
from palpate._bricks import TYPES, Bricks, Numbers
from palpate._errors import FailedPrecondition, Internal
from palpate._geometry import array_of_vector, matrix_of_map
from palpate._link import AcknowledgedCall, Link
from palpate._progress import Progress, tell
from palpate._voxels import Volume, Voxels
from palpate.v1 import volume_pb2, volume_stream_pb2, voxel_type_pb2

_MAX_UNACKNOWLEDGED = 8
# Far more than a daemon sends in a message.
_MOST_BRICKS = 4096
_MOST_TILES = 1 << 16
_MOST_TILE_BRICKS = 1 << 20
# Bricks of tiles taken at a time, to keep memory small.
_TILE_BATCH = 1 << 15

_TYPE_OF = dict(zip((voxel_type_pb2.VOXEL_TYPE_UINT8, voxel_type_pb2.VOXEL_TYPE_INT16,
                     voxel_type_pb2.VOXEL_TYPE_UINT16, voxel_type_pb2.VOXEL_TYPE_FLOAT32), TYPES))


def _dtype_of(voxel_type: voxel_type_pb2.VoxelType) -> np.dtype[typing.Any]:
    if voxel_type not in _TYPE_OF:
        raise FailedPrecondition(
            "palpated sent voxels of a type that this version of the package does not know: install "
            "the package of palpated's version ('palpated --version')")
    return _TYPE_OF[voxel_type]


def values_of(message: volume_stream_pb2.VolumeBricks,
              unpack: zstandard.ZstdDecompressor | None = None) -> Voxels:
    """(n, 512), of one of TYPES. Errors: ValueError, ZstdError, FailedPrecondition."""
    dtype = _dtype_of(message.voxel_type)
    wanted = len(message.brick_numbers) * BRICK_VOXELS * dtype.itemsize
    # zstd allocates the size in its own header, so that size must be the same as ours.
    if zstandard.frame_content_size(message.zstd_values) != wanted:
        raise ValueError("bricks of another size")
    unpacked = (unpack or zstandard.ZstdDecompressor()).decompress(message.zstd_values)
    return np.frombuffer(unpacked, dtype).reshape(-1, BRICK_VOXELS)


class VolumeCopy:
    """The received part of one volume. ValueError for a message that makes no sense."""

    def __init__(self, lattice: volume_stream_pb2.VolumeLattice) -> None:
        self._lattice = lattice
        size = lattice.size_x, lattice.size_y, lattice.size_z
        if not all(size):
            raise ValueError("a volume without voxels")
        background = lattice.background if lattice.HasField("background") else lattice.value_min
        self._bricks = Bricks(size, _dtype_of(lattice.voxel_type), background)
        self._complete = self._bricks.share()
        self._unpack = zstandard.ZstdDecompressor()

    @property
    def brick_count(self) -> int:
        return self._bricks.count

    def take(self, message: volume_stream_pb2.VolumeBricks) -> None:
        """Takes bricks and tiles. complete() shows them."""
        # Checked before anything changes.
        bricks = self._bricks_of(message) if message.brick_numbers else None
        for numbers, value in self._tiles_of(message):
            self._bricks.fill(numbers, value)
        if bricks is not None:
            self._bricks.put(*bricks)

    def _bricks_of(self, message: volume_stream_pb2.VolumeBricks) -> tuple[Numbers, Voxels]:
        if len(message.brick_numbers) > _MOST_BRICKS:
            raise ValueError("too many bricks")
        numbers = np.array(message.brick_numbers, np.uint64)
        if (numbers[1:] <= numbers[:-1]).any() or numbers[-1] >= self.brick_count:
            raise ValueError("bricks outside of the volume, or out of order")
        if message.tiles:
            firsts = np.array([tile.first_brick for tile in message.tiles], np.uint64)
            ends = firsts + np.array([tile.bricks for tile in message.tiles], np.uint64)
            before = np.searchsorted(firsts, numbers, side="right")
            if (numbers[before > 0] < ends[before[before > 0] - 1]).any():
                raise ValueError("a brick within a tile")
        return numbers.astype(np.int64), values_of(message, self._unpack)

    def _tiles_of(self, message: volume_stream_pb2.VolumeBricks) -> collections.abc.Iterator[
            tuple[Numbers, npt.NDArray[np.float32]]]:
        """Yields bricks and their values, in parts."""
        if not message.tiles:
            return
        if len(message.tiles) > _MOST_TILES or (
                sum(tile.bricks for tile in message.tiles) > _MOST_TILE_BRICKS):
            raise ValueError("too many bricks in tiles")
        end = 0
        for tile in message.tiles:
            if not end <= tile.first_brick < tile.first_brick + tile.bricks <= self.brick_count:
                raise ValueError("tiles outside of the volume, or out of order")
            end = tile.first_brick + tile.bricks
        firsts = np.array([tile.first_brick for tile in message.tiles], np.int64)
        ends = np.cumsum([tile.bricks for tile in message.tiles], dtype=np.int64)
        values = np.array([tile.value for tile in message.tiles], np.float32)
        for begin in range(0, ends[-1], _TILE_BATCH):
            places = np.arange(begin, min(begin + _TILE_BATCH, ends[-1]))
            at = np.searchsorted(ends, places, side="right")
            # The brick of a place: its tile's last one, less those that follow.
            yield firsts[at] + places - np.append(0, ends)[at], values[at]

    def complete(self, complete: volume_stream_pb2.VolumeComplete,
                 placement: volume_stream_pb2.VolumePlacement) -> Volume:
        """Returns the volume of this revision. Checks first that it equals the daemon's."""
        background_hash = complete.background_hash_high, complete.background_hash_low
        sums = self._bricks.hash + np.array(background_hash, np.uint64)
        if sums.tolist() != [complete.content_hash_high, complete.content_hash_low]:
            raise ValueError("the voxels are not the daemon's")
        self._complete = self._bricks.share()
        lattice = self._lattice
        return Volume(
            spacing_mm=array_of_vector(lattice.spacing_mm),
            world_from_index=matrix_of_map(lattice.world_from_index),
            value_min=lattice.value_min, value_max=lattice.value_max, unit=lattice.unit,
            source=lattice.source, volume_revision=complete.revision.volume_revision,
            _bricks=self._complete, **place_of(placement))

    def go_back(self) -> None:
        """Forgets what has come since the last complete revision."""
        self._bricks = self._complete.share()


def place_of(placement: volume_stream_pb2.VolumePlacement) -> dict[str, typing.Any]:
    """The members of a Volume that come with its place."""
    return {"device_from_index": matrix_of_map(placement.device_from_index),
            "replayed": placement.replayed}


class _Fetch:
    """Takes the messages of a stream up to the first complete copy."""

    def __init__(self) -> None:
        self.share = 0.0
        self._copy: VolumeCopy | None = None
        self._placement: volume_stream_pb2.VolumePlacement | None = None

    def take(self, message: volume_stream_pb2.StreamVolumeResponse) -> Volume | None:
        event = message.WhichOneof("event")
        if event == "lattice":
            # Another volume was loaded meanwhile. The old one's data are void.
            self._copy = VolumeCopy(message.lattice)
        elif event == "placement":
            self._placement = message.placement
        elif event == "bricks":
            copy = self._known()
            copy.take(message.bricks)
            self.share = max(0.0, 1.0 - message.bricks.bricks_left / copy.brick_count)
        elif event == "complete":
            if self._placement is None:
                raise ValueError("no placement")
            return self._known().complete(message.complete, self._placement)
        return None

    def _known(self) -> VolumeCopy:
        if self._copy is None:
            raise ValueError("bricks before the lattice")
        return self._copy


@contextlib.contextmanager
def making_sense() -> collections.abc.Iterator[None]:
    """A message that makes no sense becomes Internal within the block."""
    try:
        yield
    except (ValueError, zstandard.ZstdError) as damaged:
        raise Internal(f"the stream of the volume makes no sense: {damaged}") from None


def volume_call(stub: typing.Any,
                resume_from: volume_stream_pb2.VolumeRevision | None = None) -> AcknowledgedCall:
    start = volume_stream_pb2.StreamVolumeStart(max_unacknowledged=_MAX_UNACKNOWLEDGED,
                                                resume_from=resume_from)
    return AcknowledgedCall(stub.StreamVolume, volume_stream_pb2.StreamVolumeRequest(start=start))


def messages_of(link: Link, call: AcknowledgedCall) -> collections.abc.Generator[
        typing.Any, None, None]:
    """Yields the messages of the stream, which never ends by itself. Errors: palpate.Error."""
    link.check_open()
    try:
        with contextlib.closing(iter(call)) as messages:
            yield from messages
    except grpc.RpcError as failed:
        raise link.error_of_end(failed) from None
    except ValueError:
        # gRPC raises it if another thread closed the channel before the call began.
        link.check_open()
        raise
    raise link.error_of_end(None)


def fetch_volume(link: Link, stub: typing.Any, progress: Progress | None) -> Volume:
    """Returns one complete copy. Errors: Internal, Unavailable; Cancelled by `progress`."""
    link.call(stub.GetVolume, volume_pb2.GetVolumeRequest())  # waits for the first volume
    fetch = _Fetch()
    with contextlib.closing(messages_of(link, volume_call(stub))) as messages:
        for message in messages:
            with making_sense():
                volume = fetch.take(message)
            if volume is not None:
                return volume
            tell(progress, "receiving", fetch.share)
    raise Internal("the stream of the volume has ended")
