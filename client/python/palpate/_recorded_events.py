"""Everything in a recording except ticks: palpate/v1/recorded.proto."""

import dataclasses
import typing

import numpy as np
import numpy.typing as npt
import zstandard

from palpate._brick_pool import BRICK_VOXELS
from palpate._errors import FailedPrecondition, InvalidArgument
from palpate._geometry import array_of_vector, matrix_of_map
from palpate._mcap import Damaged
from palpate._settings import Settings
from palpate._volume_copy import values_of
from palpate.v1 import recorded_pb2

# 64 MiB of voxels.
MOST_BRICKS = 1 << 15
_MOST_NUMBER = 1 << 62


@dataclasses.dataclass(frozen=True)
class RecordedMarker:
    """A marker.

    tick: the last recorded tick that began at or before time_ns; the first one if none did
    time_ns: when the marker was set, on the clock of RecordedTicks.time_ns
    text: as it was given to Recording.mark()
    """

    tick: int
    time_ns: int
    text: str


@dataclasses.dataclass(frozen=True)
class RecordedPassing:
    """The stylus passed through a layer.

    tick: in which it did; time_ns: of that tick
    layer: its name
    inwards: False: outwards
    force_n: on the hand in the tick before, N
    """

    tick: int
    time_ns: int
    layer: str
    inwards: bool
    force_n: float


@dataclasses.dataclass(frozen=True)
class RecordedGap:
    """Ticks that were not recorded: first_tick to last_tick, both included."""

    first_tick: int
    last_tick: int


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RecordedScene:
    """The inputs of the ticks from `tick` on, until the next scene.

    tick: first tick of the scene, as RecordedTicks.tick
    settings: by the names of Settings, as in Settings.all(). A missing setting was unknown to the
        program that recorded; the ticks used its default.
    unknown_settings: fields of RenderSettings, by number, that this package does not know
    settings_revision: of the settings
    scene_revision: rises with each scene published to the servo
    volume_source: path, builtin name or "upload:NAME" from which the volume was loaded
    volume_revision: of the volume; loaded_revision: of the volume before all edits
    shape: voxels along x, y, z
    spacing_mm: (3,) along x, y, z, mm
    value_min, value_max: range of the volume, data units
    is_level_set: values are signed distances from a surface at 0, negative inside
    device_from_index: (4, 4) voxel index (x, y, z, 1) to the device frame: mm
    world_from_index: (4, 4) voxel index to world: mm; None: not recorded
    volume_hash: identifies the contents of the volume; equal hashes mean equal volumes
    all_voxels_stored: the recording has all voxels, not only edited ones
    voxels_missing: more voxels had changed than a recording stores
    tick_period_s: length of a tick, s
    forces_off: no forces were computed
    series_position_frames: of the series, as SeriesState; None: the volume is no series
    """

    tick: int
    settings: dict[str, typing.Any]
    unknown_settings: tuple[int, ...]
    settings_revision: int
    scene_revision: int
    volume_source: str
    volume_revision: int
    loaded_revision: int
    shape: tuple[int, int, int]
    spacing_mm: npt.NDArray[np.float64]
    value_min: float
    value_max: float
    is_level_set: bool
    device_from_index: npt.NDArray[np.float64]
    world_from_index: npt.NDArray[np.float64] | None
    volume_hash: int
    all_voxels_stored: bool
    voxels_missing: bool
    tick_period_s: float
    forces_off: bool
    series_position_frames: float | None

    def to_world_mm(self, points_mm: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Returns points of the device frame in world coordinates: mm.

        points_mm: (n, 3) or (3,), mm, such as RecordedTicks.scp_h_mm of ticks of this scene.
        Errors: FailedPrecondition (the recording does not tell it), InvalidArgument (another
        shape).
        Example: recording.scene_at(tick).to_world_mm(recording.ticks.scp_h_mm[0])
        """
        if self.world_from_index is None:
            raise FailedPrecondition("this recording does not say where the volume lay in the "
                                     "world: record with a newer palpated")
        try:
            points = np.asarray(points_mm, np.float64)
        except (TypeError, ValueError):
            points = np.empty(0)
        if points.ndim not in (1, 2) or points.shape[-1] != 3:
            raise InvalidArgument("points_mm is (3,) or (n, 3) numbers")
        for place in (self.world_from_index, self.device_from_index):
            if not np.isfinite(place).all() or not np.linalg.det(place[:3, :3]):
                raise InvalidArgument("the recording's place of the volume is no place")
        world_from_device = self.world_from_index @ np.linalg.inv(self.device_from_index)
        world: npt.NDArray[np.float64]
        world = points @ world_from_device[:3, :3].T + world_from_device[:3, 3]
        return world

    def __repr__(self) -> str:
        isovalue = f", isovalue {self.settings['isovalue']:g}" if "isovalue" in self.settings else ""
        return (f"<palpate recorded scene: from tick {self.tick} on, {self.volume_source}, "
                f"revision {self.volume_revision}{isovalue}>")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RecordedEdit:
    """Changed voxels. All edits before a scene together lead to the scene's volume.

    tick: first tick that used the edit
    base_revision: volume revision that the edits change; 0: none, they have all voxels
    volume_revision: after all edits before the next scene
    brick_count: of changed bricks of 8³ voxels
    is_known: the recording held these voxels before: a frame of a series that comes again
    """

    tick: int
    base_revision: int
    volume_revision: int
    brick_count: int
    is_known: bool
    _message: recorded_pb2.RecordedVoxels

    @property
    def brick_numbers(self) -> npt.NDArray[np.int64]:
        """(n,) Brick (a, b, c) has the number (a·nb + b)·nc + c, with nb and nc = ceil(size / 8) along
        y and z. Example: len(recording.edits[0].brick_numbers)
        """
        numbers = [np.array(self._message.bricks.brick_numbers, np.int64)]
        for run in (*self._message.bricks.tiles, *self._message.known):
            numbers.append(np.arange(run.first_brick, run.first_brick + run.bricks))
        return np.concatenate(numbers)

    def voxels(self) -> npt.NDArray[np.float32]:
        """Returns the voxels of these bricks: (n, 8, 8, 8), data units.

        Errors: FailedPrecondition (is_known: ask RecordingFile.voxels), InvalidArgument (damaged).
        Example: recording.edits[0].voxels()[0].mean()
        """
        if self.is_known:
            raise FailedPrecondition("these voxels came before: RecordingFile.voxels has them")
        try:
            bricks = self._message.bricks
            count = len(bricks.brick_numbers)
            values = np.empty((self.brick_count, BRICK_VOXELS), np.float32)
            if count:
                values[:count] = values_of(bricks)
            lengths = [tile.bricks for tile in bricks.tiles]
            values[count:] = np.repeat([tile.value for tile in bricks.tiles], lengths)[:, None]
        except (ValueError, zstandard.ZstdError) as damage:
            raise InvalidArgument(f"an edit is damaged: {damage}") from None
        return values.reshape(-1, 8, 8, 8)

    def __repr__(self) -> str:
        return (f"<palpate recorded edit: at tick {self.tick}, {self.brick_count} bricks, "
                f"revision {self.base_revision} to {self.volume_revision}>")


def edit_of(message: recorded_pb2.RecordedVoxels) -> RecordedEdit:
    """Errors: Damaged."""
    bricks = message.bricks
    runs = [(number, 1) for number in bricks.brick_numbers]
    runs += [(tile.first_brick, tile.bricks) for tile in bricks.tiles]
    runs += [(run.first_brick, run.bricks) for run in message.known]
    count = sum(length for _, length in runs)
    if not 0 < count <= MOST_BRICKS or not all(
            0 < length and first + length < _MOST_NUMBER for first, length in runs):
        raise Damaged("damaged: of bricks that no volume has")
    return RecordedEdit(message.tick, message.base_revision, message.volume_revision, count,
                        bool(message.known), message)


def scene_of(message: recorded_pb2.RecordedScene) -> RecordedScene:
    """Errors: Damaged."""
    # A message has none of them then.
    settings: dict[str, typing.Any] = {"layers": (), "tool": None}
    for field, value in message.settings.ListFields():
        try:
            settings[field.name] = getattr(Settings, field.name).parse(field.name, value)
        except InvalidArgument:
            raise Damaged(f"damaged: the setting {field.name} cannot be what it is") from None
    try:
        device_from_index = matrix_of_map(message.device_from_index)
        world_from_index = (matrix_of_map(message.world_from_index)
                            if message.HasField("world_from_index") else None)
    except ValueError:
        raise Damaged("damaged: a place is no place") from None
    if max(message.size_x, message.size_y, message.size_z) >= 1 << 31:
        raise Damaged("damaged: of a volume that cannot be")
    position = message.series_position_frames
    return RecordedScene(
        tick=message.tick, settings=settings,
        unknown_settings=tuple(field.field_number for field in message.settings.UnknownFields()),
        settings_revision=message.settings_revision, scene_revision=message.scene_revision,
        volume_source=message.volume_source.decode(errors="replace"),
        volume_revision=message.volume_revision,
        loaded_revision=message.loaded_revision,
        shape=(message.size_x, message.size_y, message.size_z),
        spacing_mm=array_of_vector(message.spacing_mm), value_min=message.value_min,
        value_max=message.value_max, is_level_set=message.is_level_set,
        device_from_index=device_from_index, world_from_index=world_from_index,
        volume_hash=message.volume_hash_high << 64 | message.volume_hash_low,
        all_voxels_stored=message.all_voxels_stored, voxels_missing=message.voxels_missing,
        tick_period_s=message.tick_period_s, forces_off=message.forces_off,
        series_position_frames=position if message.HasField("series_position_frames") else None)
