"""Everything in a recording except ticks. server/recording/chunk_codec.cpp has the format."""

import dataclasses
import typing

import numpy as np
import numpy.typing as npt

from palpate._enums import DecompositionMethod
from palpate._errors import FailedPrecondition, InvalidArgument
from palpate._recording_frame import Damaged, Reader, unpack
from palpate._settings import Settings

_MOST_BRICKS = 4096
BRICK_VOXELS = 512
_FLAGS = {"off": False, "on": True}
# Settings that a scene stores apart from its lines "key=value".
_APART = ("isovalue", "normalized_isovalue", "method")


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
    unknown_settings: settings that this package does not know, by name, as text
    settings_revision: of the settings
    scene_revision: rises with each scene published to the servo
    volume_source: path, builtin name or "upload:NAME" from which the volume was loaded
    volume_revision: of the volume; loaded_revision: of the volume before all edits
    shape: voxels along x, y, z; None: not recorded (version 2)
    spacing_mm: (3,) along x, y, z, mm
    value_min, value_max: range of the volume, data units; None: not recorded (version 2)
    is_level_set: values are signed distances from a surface at 0, negative inside
    device_from_index: (4, 4) voxel index (x, y, z, 1) to the device frame: mm
    world_from_index: (4, 4) voxel index to world: mm; None: not recorded (before
        version 5)
    volume_hash: identifies the contents of the volume; equal hashes mean equal volumes
    all_voxels_stored: the recording has all voxels, not only edited ones
    voxels_missing: more voxels had changed than a recording stores
    tick_period_s: length of a tick, s
    forces_off: no forces were computed
    """

    tick: int
    settings: dict[str, typing.Any]
    unknown_settings: dict[str, str]
    settings_revision: int
    scene_revision: int
    volume_source: str
    volume_revision: int
    loaded_revision: int
    shape: tuple[int, int, int] | None
    spacing_mm: npt.NDArray[np.float64]
    value_min: float | None
    value_max: float | None
    is_level_set: bool
    device_from_index: npt.NDArray[np.float64]
    world_from_index: npt.NDArray[np.float64] | None
    volume_hash: int
    all_voxels_stored: bool
    voxels_missing: bool
    tick_period_s: float
    forces_off: bool

    def to_world_mm(self, points_mm: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Returns points of the device frame in world coordinates: mm.

        points_mm: (n, 3) or (3,), mm, such as RecordedTicks.scp_h_mm of ticks of this scene.
        Errors: FailedPrecondition (recorded by an earlier version), InvalidArgument (another
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
        return (f"<palpate recorded scene: from tick {self.tick} on, {self.volume_source}, "
                f"revision {self.volume_revision}, isovalue {self.settings['isovalue']:g}>")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RecordedEdit:
    """Changed voxels. All edits before a scene together lead to the scene's volume.

    tick: first tick that used the edit
    base_revision: volume revision that the edits change; 0: none, they have all voxels
    volume_revision: after all edits before the next scene
    brick_numbers: (n,) bricks of 8³ voxels; (a, b, c) has the number (a·nb + b)·nc + c, with nb
        and nc = ceil(size / 8) along y and z
    """

    tick: int
    base_revision: int
    volume_revision: int
    brick_numbers: npt.NDArray[np.int64]
    _packed: bytes

    def voxels(self) -> npt.NDArray[np.float32]:
        """Returns the voxels of these bricks: (n, 8, 8, 8), data units.

        Errors: none. Example: recording.edits[0].voxels()[0].mean()
        """
        count = len(self.brick_numbers)
        planes = unpack(self._packed)[-4 * BRICK_VOXELS * count:]
        values = np.frombuffer(planes, np.uint8).reshape(4, -1).T.copy().view("<f4")
        return values.reshape(count, 8, 8, 8)

    def __repr__(self) -> str:
        return (f"<palpate recorded edit: at tick {self.tick}, {len(self.brick_numbers)} bricks, "
                f"revision {self.base_revision} to {self.volume_revision}>")


def edit_of(packed: bytes) -> RecordedEdit:
    """Errors: Damaged."""
    reader = Reader(unpack(packed))
    tick, base_revision, volume_revision, count = reader.get("QQQI")
    if not 0 < count <= _MOST_BRICKS:
        raise Damaged("damaged: too many bricks")
    numbers = np.frombuffer(reader.get_bytes(8 * count), "<u8")
    if np.any(numbers[1:] <= numbers[:-1]):
        raise Damaged("damaged: its bricks are out of order")
    # Beyond any lattice. As a negative number it would index within a lattice.
    if numbers[-1] >= 1 << 62:
        raise Damaged("damaged: a brick outside of any volume")
    reader.get_bytes(4 * BRICK_VOXELS * count)
    reader.expect_end()
    return RecordedEdit(tick, base_revision, volume_revision, numbers.astype(np.int64), packed)


def marker_of(reader: Reader) -> RecordedMarker:
    tick, time_ns = reader.get("Qq")
    return RecordedMarker(tick, time_ns, reader.get_text())


def gap_of(reader: Reader) -> RecordedGap:
    first, last = reader.get("QQ")
    if last < first:
        raise Damaged("damaged: a gap ends before it begins")
    return RecordedGap(first, last)


def scene_of(reader: Reader) -> RecordedScene:
    """Errors: Damaged."""
    (tick, scene_revision, settings_revision, volume_revision, loaded_revision, _, isovalue,
     normalized_isovalue) = reader.get("6Q2d")
    settings: dict[str, typing.Any] = {"isovalue": isovalue,
                                       "normalized_isovalue": normalized_isovalue}
    unknown = _read_settings(reader.get_text(), settings)
    settings["method"] = _method(reader.get_text())
    device_from_index = _map_of(reader)
    high, low = reader.get("2Q")
    source = reader.get_text()
    spacing_mm = np.array(reader.get("3d"))
    missing, tick_period_s = reader.get("Bd")
    # Inputs of the safety stage: its limits, and the buttons for a stop.
    reader.get("7dBBI")
    forces_off, = reader.get("B")
    later = _read_later(reader)
    return RecordedScene(
        tick=tick, settings=settings, unknown_settings=unknown,
        settings_revision=settings_revision, scene_revision=scene_revision, volume_source=source,
        volume_revision=volume_revision, loaded_revision=loaded_revision, spacing_mm=spacing_mm,
        device_from_index=device_from_index, volume_hash=high << 64 | low,
        voxels_missing=bool(missing), tick_period_s=tick_period_s, forces_off=bool(forces_off),
        **later)


def _map_of(reader: Reader) -> npt.NDArray[np.float64]:
    matrix = np.eye(4)
    matrix[:3, :3] = np.reshape(reader.get("9d"), (3, 3), order="F")
    matrix[:3, 3] = reader.get("3d")
    return matrix


def _read_later(reader: Reader) -> dict[str, typing.Any]:
    """Reads the additions of versions 3 to 5."""
    if reader.at_end:
        return {"all_voxels_stored": False, "shape": None, "value_min": None, "value_max": None,
                "is_level_set": False, "world_from_index": None}
    # About the device, and whether loading the source again gives the volume.
    reader.get("3dB")
    stored, x, y, z, value_min, value_max = reader.get("B3i2d")
    is_level_set = False if reader.at_end else bool(reader.get("B")[0])
    return {"all_voxels_stored": bool(stored), "shape": (x, y, z), "value_min": value_min,
            "value_max": value_max, "is_level_set": is_level_set,
            "world_from_index": None if reader.at_end else _map_of(reader)}


def _read_settings(text: str, settings: dict[str, typing.Any]) -> dict[str, str]:
    """Puts the lines "key=value" into `settings`. Returns the unknown settings."""
    unknown: dict[str, str] = {}
    if text and not text.endswith("\n"):
        raise Damaged("damaged: a setting is no line key=value")
    for line in text.split("\n")[:-1]:
        key, equals, value = line.partition("=")
        if not equals:
            raise Damaged("damaged: a setting is no line key=value")
        parse = getattr(getattr(Settings, key, None), "parse", None)
        if parse is None or key in _APART:
            unknown[key] = value
            continue
        try:
            settings[key] = parse(key, _value_of(value))
        except InvalidArgument:
            raise Damaged(f"damaged: the setting {key} cannot be what it is") from None
    return unknown


def _value_of(text: str) -> bool | float | str:
    if text in _FLAGS:
        return _FLAGS[text]
    # float() accepts more than a recording may have: "1_0", "٣" and " 1".
    if text.isascii() and "_" not in text and text == text.strip():
        try:
            return float(text)
        except ValueError:
            pass
    return text


def _method(text: str) -> DecompositionMethod:
    for method in DecompositionMethod:
        if str(method) == text:
            return method
    raise Damaged("of a method that this package does not know")
