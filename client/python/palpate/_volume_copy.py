"""A copy of the daemon's volume, made from the streamed bricks."""

import collections.abc
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
from palpate._html import numbers, picture_of, table
from palpate._link import AcknowledgedCall, Link
from palpate._progress import Progress, tell
from palpate._tables import package
from palpate.v1 import volume_pb2, volume_stream_pb2

_EDGE = 8
_BRICK_BYTES = 4 * _EDGE**3
_MAX_UNACKNOWLEDGED = 8
# The contract says 64 bricks. A later daemon may send more, but this is the limit.
_MOST_BRICKS = 4096
_HALF = 1 << 64
# 8 GiB. A sparse volume may have more voxels than fit into memory.
_MOST_VOXELS = 1 << 31

# The most that an axis along the world's may lean, in parts of the longest step.
_PARALLEL = 1e-6

# Numbers of bricks, (n,), and their voxels, (n, 8, 8, 8).
Bricks = tuple[npt.NDArray[np.int64], npt.NDArray[np.float32]]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Volume:
    """A volume with its voxels.

    values: (nx, ny, nz), indexed [x, y, z], data units
    spacing_mm: (3,) along x, y, z, mm
    world_from_index: (4, 4) voxel index (x, y, z, 1) to world: mm, LPS as in DICOM
    device_from_index: (4, 4) voxel index (x, y, z, 1) to the device frame: mm
    value_min: least value at load, data units
    value_max: greatest value at load, data units
    unit: of the values, as the file states it; may be empty
    source: path, builtin name or "upload:NAME" from which it was loaded
    volume_revision: revision of this copy; VolumeInfo.volume_revision has the same numbers
    Example: conn.volume.download().values[10, 20, 30]
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

    def to_xarray(self) -> typing.Any:
        """Returns an xarray.DataArray along "x", "y" and "z", with coordinates in mm.

        The attribute "coordinates_frame" says of which frame the coordinates are:
        "world": LPS as in DICOM, if the volume's axes lie along those of the world. Where an axis
        is mirrored, its coordinates fall.
        "volume": from the first voxel along the volume's own axes, if the volume is oblique.
        The attribute "world_from_index" maps voxel indices to the world in both cases.
        Errors: FailedPrecondition (xarray is not installed).
        Example: conn.volume.download().to_xarray().sel(z=40, method="nearest")
        """
        axes = ("x", "y", "z")
        linear = self.world_from_index[:3, :3]
        steps_mm = np.diag(linear)
        first_mm = self.world_from_index[:3, 3]
        along_world = np.abs(linear - np.diag(steps_mm)).max() <= _PARALLEL * np.abs(linear).max()
        if not along_world:
            steps_mm, first_mm = self.spacing_mm, np.zeros(3)
        coordinates = {
            axis: (axis, first_mm[n] + np.arange(self.values.shape[n]) * steps_mm[n],
                   {"units": "mm"})
            for n, axis in enumerate(axes)}
        attributes = {"units": self.unit, "source": self.source,
                      "coordinates_frame": "world" if along_world else "volume",
                      "volume_revision": self.volume_revision,
                      "world_from_index": self.world_from_index,
                      "device_from_index": self.device_from_index}
        return package("xarray").DataArray(self.values, coordinates, axes, attrs=attributes)

    def __repr__(self) -> str:
        # Without the arrays, which would fill the screen.
        return (f"<palpate volume: {self.source}, {numbers(self.values.shape)} voxels, revision "
                f"{self.volume_revision}>")

    def _repr_html_(self) -> str:
        x, y, z = self.values.shape
        extent_mm = np.array((x, y)) * self.spacing_mm[:2]
        picture = picture_of(self.values[:, :, z // 2], self.value_min, self.value_max,
                             (float(extent_mm[0]), float(extent_mm[1])),
                             f"slice {z // 2} of {z} along z: x to the right, y down")
        return table("palpate volume", (
            ("source", self.source), ("voxels", numbers(self.values.shape)),
            ("spacing", numbers(self.spacing_mm) + " mm"),
            ("values", f"{self.value_min:g} to {self.value_max:g} {self.unit}".strip()),
            ("revision", self.volume_revision)), picture)


class VolumeCopy:
    """The received part of one volume. ValueError for a message that makes no sense.

    The hashes cover all received bricks. The voxels are those of bricks given to put().
    """

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
        # Axes: the place of the brick, then the place of the voxel in the brick.
        a, b, c = self._counts
        self._bricks = self._voxels.reshape(a, _EDGE, b, _EDGE, c, _EDGE).transpose(
            0, 2, 4, 1, 3, 5)
        # Hashes of bricks by number, and their sums. check() adds bricks that were not sent.
        self._hashes: dict[int, int] = {}
        self._high = self._low = 0

    @property
    def brick_count(self) -> int:
        return int(self._counts.prod())

    def bricks_of(self, message: volume_stream_pb2.VolumeBricks) -> Bricks:
        """Returns the bricks of a message and stores their hashes. put() stores the voxels."""
        numbers = np.array(message.brick_numbers, dtype=np.uint64)
        if not 0 < len(numbers) <= _MOST_BRICKS or numbers.max() >= self.brick_count:
            raise ValueError("bricks outside of the volume")
        wanted = len(numbers) * _BRICK_BYTES
        if zstandard.frame_content_size(message.zstd_values) != wanted:
            raise ValueError("bricks of another size")
        data = zstandard.ZstdDecompressor().decompress(message.zstd_values)
        view = memoryview(data)
        for n, number in enumerate(message.brick_numbers):
            brick = view[n * _BRICK_BYTES:(n + 1) * _BRICK_BYTES]
            self._note(number, xxhash.xxh3_128_intdigest(brick, number))
        return (numbers.astype(np.int64),
                np.frombuffer(data, "<f4").reshape(-1, _EDGE, _EDGE, _EDGE))

    def put(self, bricks: Bricks) -> None:
        numbers, values = bricks
        self._bricks[np.unravel_index(numbers, self._counts)] = values

    def _note(self, number: int, digest: int) -> None:
        old = self._hashes.get(number, 0)
        self._high += (digest >> 64) - (old >> 64)
        self._low += digest % _HALF - old % _HALF
        self._hashes[number] = digest

    def check(self, complete: volume_stream_pb2.VolumeComplete) -> None:
        """Checks that the copy equals the daemon's. Bricks that were not sent are background."""
        if len(self._hashes) < self.brick_count:
            background = np.full(_EDGE**3, self._background, "<f4").tobytes()
            for number in range(self.brick_count):
                if number not in self._hashes:
                    self._note(number, xxhash.xxh3_128_intdigest(background, number))
        sums = (self._high % _HALF, self._low % _HALF)
        if sums != (complete.content_hash_high, complete.content_hash_low):
            raise ValueError("the voxels are not the daemon's")

    def fill(self, values: npt.NDArray[np.float32]) -> None:
        """Stores all voxels: an array of the volume's shape."""
        x, y, z = self._size
        self._voxels[:x, :y, :z] = values

    def content_hash(self) -> tuple[int, int]:
        """Returns the hash of all voxels, as in VolumeComplete."""
        bricks = np.ascontiguousarray(self._bricks, "<f4").reshape(self.brick_count, -1)
        digests = [xxhash.xxh3_128_intdigest(brick, number)
                   for number, brick in enumerate(bricks)]
        return (sum(digest >> 64 for digest in digests) % _HALF,
                sum(digest % _HALF for digest in digests) % _HALF)

    def view(self) -> npt.NDArray[np.float32]:
        """The voxels themselves, read-only; put() changes them."""
        x, y, z = self._size
        view = self._voxels[:x, :y, :z]
        view.flags.writeable = False
        return view

    def volume(self, values: npt.NDArray[np.float32], volume_revision: int,
               device_from_index: npt.NDArray[np.float64]) -> Volume:
        lattice = self.lattice
        return Volume(
            values=values, spacing_mm=array_of_vector(lattice.spacing_mm),
            world_from_index=matrix_of_map(lattice.world_from_index),
            device_from_index=device_from_index, value_min=lattice.value_min,
            value_max=lattice.value_max, unit=lattice.unit, source=lattice.source,
            volume_revision=volume_revision)


class _Fetch:
    """Takes the messages of a stream up to the first complete copy."""

    def __init__(self) -> None:
        self.share = 0.0
        self._copy: VolumeCopy | None = None
        self._device_from_index: npt.NDArray[np.float64] | None = None

    def take(self, message: volume_stream_pb2.StreamVolumeResponse) -> Volume | None:
        event = message.WhichOneof("event")
        if event == "lattice":
            # Another volume was loaded meanwhile. The old one's data are void.
            self._copy = VolumeCopy(message.lattice)
        elif event == "placement":
            self._device_from_index = matrix_of_map(message.placement.device_from_index)
        elif event == "bricks":
            copy = self._known()
            copy.put(copy.bricks_of(message.bricks))
            self.share = max(0.0, 1.0 - message.bricks.bricks_left / copy.brick_count)
        elif event == "complete":
            return self._volume(message.complete)
        return None

    def _known(self) -> VolumeCopy:
        if self._copy is None:
            raise ValueError("bricks before the lattice")
        return self._copy

    def _volume(self, complete: volume_stream_pb2.VolumeComplete) -> Volume:
        copy = self._known()
        copy.check(complete)
        if self._device_from_index is None:
            raise ValueError("no placement")
        return copy.volume(np.array(copy.view(), order="C"), complete.revision.volume_revision,
                           self._device_from_index)


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
        volume_stream_pb2.StreamVolumeResponse, None, None]:
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
