"""Recordings of the haptic loop as NumPy arrays, without a daemon."""

import dataclasses
import os
import re
import stat
import typing

import numpy as np
import numpy.typing as npt

from palpate._enums import ProxyMode
from palpate._errors import (Conflict, FailedPrecondition, InvalidArgument, NotFound,
                             PermissionDenied)
from palpate._html import table
from palpate._mcap import (CHANNEL, CHUNK, HEAD, MESSAGE, MESSAGE_HEAD, SCHEMA, Damaged, McapFile,
                           parsed)
from palpate._pose_columns import ABOUT, RECORDED_ABOUT, RecordedColumns
from palpate._recorded_events import (MOST_BRICKS, RecordedEdit, RecordedGap, RecordedMarker,
                                      RecordedPassing, RecordedScene, edit_of, scene_of)
from palpate._recorded_voxels import Step, voxels_of
from palpate._tables import Table, write_hdf5
from palpate._tick_layout import TickReader
from palpate._values import path_text
from palpate.v1 import recorded_pb2

_MOST_MARKER_BYTES = 4096
# Of messages that are no ticks: for each byte of the file, whatever its size, and what each takes
# besides its bytes.
_MOST_HELD, _FREE_BYTES, _BYTES_PER_MESSAGE = 64, 64 << 20, 1 << 10


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RecordedTicks(RecordedColumns, Table):
    __doc__ = f"""n recorded ticks, oldest first; len() is n. Frames and units are as in Poses.

{ABOUT}{RECORDED_ABOUT}    lost_ticks: (n,) ticks before this one that are not recorded. It rises at each gap
    """

    lost_ticks: npt.NDArray[np.uint64]

    def __len__(self) -> int:
        return len(self.tick)

    def __repr__(self) -> str:
        ticks = f", ticks {self.tick[0]} to {self.tick[-1]}" if len(self) else ""
        return f"<palpate recorded ticks: {len(self)}{ticks}>"


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RecordingFile:
    """A recording that open_recording() has read.

    path: the file, as it was given to open_recording()
    program: the program that recorded it, such as "palpated 0.1.0"
    created_unix_ns: when the recording began: UTC, nanoseconds since 1970
    created_monotonic_ns: the same moment on the clock of RecordedTicks.time_ns; None: not recorded
    clock: (n, 2) about once a second: the clock of RecordedTicks.time_ns, and UTC since 1970: ns
    ticks: all ticks, as arrays
    markers: in the order of their times
    scenes: settings, place and volume, each with its first tick
    edits: changes of voxels from scene to scene
    gaps: ticks that were not recorded
    ends_early: one line: why the recording ends early; empty: it is complete
    """

    path: str
    program: str
    created_unix_ns: int
    created_monotonic_ns: int | None
    clock: npt.NDArray[np.int64]
    ticks: RecordedTicks
    markers: tuple[RecordedMarker, ...]
    scenes: tuple[RecordedScene, ...]
    edits: tuple[RecordedEdit, ...]
    gaps: tuple[RecordedGap, ...]
    ends_early: str
    _steps: tuple[Step, ...]

    @property
    def complete(self) -> bool:
        """True if the recording was closed and read completely."""
        return not self.ends_early

    @property
    def lost_ticks(self) -> int:
        """The number of ticks in gaps."""
        return sum(gap.last_tick - gap.first_tick + 1 for gap in self.gaps)

    @property
    def volume_sources(self) -> tuple[str, ...]:
        """Paths, builtin names and "upload:NAME" of all volumes, each once."""
        return tuple(dict.fromkeys(scene.volume_source for scene in self.scenes))

    def scene_at(self, tick: int) -> RecordedScene:
        """Returns the scene of a tick.

        tick: as RecordedTicks.tick. Errors: NotFound (no scene before the tick).
        Example: recording.scene_at(recording.ticks.tick[-1]).settings["isovalue"]
        """
        return self._steps[self._step_at(tick)].scene

    def passings(self) -> list[RecordedPassing]:
        """Returns where the stylus passed through a layer, oldest first.

        Left out: changes of the layers, after which the stylus may be behind more or fewer of
        them, and moments in which it felt nothing.
        Errors: none. Example: [passing.layer for passing in recording.passings()]
        """
        ticks = self.ticks
        passed = ticks.layers_passed.astype(np.int64)
        found = []
        felt = ~np.isin(ticks.mode, (ProxyMode.SUSPENDED, ProxyMode.INSIDE, ProxyMode.FAULT))
        for before in np.flatnonzero(np.diff(passed)):
            now = before + 1
            if not (felt[before] and felt[now]):
                continue
            if (ticks.settings_revision[now] != ticks.settings_revision[before]
                    or ticks.tick[now] != ticks.tick[before] + 1):
                continue
            layers = self.scene_at(int(ticks.tick[now])).settings.get("layers", ())
            number = min(passed[before], passed[now])
            if number < len(layers) and abs(passed[now] - passed[before]) == 1:
                found.append(RecordedPassing(
                    int(ticks.tick[now]), int(ticks.time_ns[now]), layers[number].name,
                    bool(passed[now] > passed[before]),
                    float(np.linalg.norm(ticks.force_n[before]))))
        return found

    def to_unix_ns(self, time_ns: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Returns times of the ticks' clock as UTC: nanoseconds since 1970.

        time_ns: RecordedTicks.time_ns or RecordedMarker.time_ns. The computer's clock is read once,
        when the recording begins. Steps of that clock during the recording make no difference.
        Errors: FailedPrecondition (the recording does not tell it), InvalidArgument (no whole
        numbers).
        Example: recording.to_unix_ns(recording.ticks.time_ns).astype("datetime64[ns]")
        """
        if self.created_monotonic_ns is None:
            raise FailedPrecondition("this recording does not say what time it was: record with a "
                                     "newer palpated")
        times = np.asarray(time_ns)
        if times.dtype.kind not in "iu":
            raise InvalidArgument("time_ns is whole numbers: nanoseconds")
        return np.asarray(times.astype(np.int64) + self.created_unix_ns - self.created_monotonic_ns)

    def voxels(self, tick: int, loaded: npt.ArrayLike | None = None) -> npt.NDArray[np.float32]:
        """Returns the volume of a tick: (nx, ny, nz), indexed [x, y, z], data units.

        tick: as RecordedTicks.tick.
        loaded: voxels of the volume as it was loaded, before all edits, indexed [x, y, z]. Load
        scene_at(tick).volume_source, and take conn.volume.download().values right after the load.
        Needed unless the recording has all voxels: scene_at(tick).all_voxels_stored. The result
        equals the recorded volume, voxel by voxel; its hash is compared.
        Errors: NotFound (no scene before the tick), FailedPrecondition (`loaded` is needed, or
        the recording does not say enough), Conflict (`loaded` is of another volume, or voxels
        are missing), InvalidArgument (another shape; damaged).
        Example: recording.voxels(recording.ticks.tick[-1], conn.volume.download().values)
        """
        last = self._step_at(tick)
        scene = self._steps[last].scene
        first = last
        while first > 0 and self._steps[first - 1].scene.loaded_revision == scene.loaded_revision:
            first -= 1
        try:
            voxels = voxels_of(self._steps[first:last + 1], loaded)
        except Damaged as damage:
            raise InvalidArgument(f"{self.path}: an edit is {damage}") from None
        if voxels is None:
            raise FailedPrecondition(f"the recording does not hold {scene.volume_source} as it was "
                                     "loaded, or does not tell its size: load it again, and give "
                                     "`loaded`, which is conn.volume.download().values right after "
                                     "the load")
        if voxels.volume_hash != scene.volume_hash:
            missing = "; voxels are missing in the recording" if scene.voxels_missing else ""
            raise Conflict(f"another volume was recorded: give {scene.volume_source} as it was "
                           f"loaded then{missing}")
        return voxels.values

    def to_hdf5(self, path: str | os.PathLike[str]) -> None:
        """Writes ticks, markers and gaps as HDF5: plain arrays, which MATLAB reads, too.

        The arrays are ticks/force_n, ticks/unix_ns, markers/text, gaps/first_tick ... Their attribute "unit" is that
        of the contract. Words are their numbers; the attribute "words" names them. Overwrites the
        file.
        Errors: FailedPrecondition (h5py is not installed), OSError.
        Example: palpate.open_recording("trial-7.mcap").to_hdf5("trial-7.h5")
        """
        markers, ticks = self.markers, self.ticks._arrays()
        if self.created_monotonic_ns is not None:
            ticks["unix_ns"] = self.to_unix_ns(self.ticks.time_ns)
        write_hdf5(path, {
            "ticks": ticks,
            "markers": {"tick": np.array([marker.tick for marker in markers], np.uint64),
                        "time_ns": np.array([marker.time_ns for marker in markers], np.int64),
                        "text": np.array([marker.text.encode() for marker in markers], "S")}
            if markers else {},
            "gaps": {name: np.array([getattr(gap, name) for gap in self.gaps], np.uint64)
                     for name in ("first_tick", "last_tick")} if self.gaps else {}})

    def _step_at(self, tick: int) -> int:
        found = [n for n, step in enumerate(self._steps) if step.scene.tick <= tick]
        if not found:
            raise NotFound(f"no scene is recorded for the tick {tick}")
        return found[-1]

    def __repr__(self) -> str:
        early = f", ends early: {self.ends_early}" if self.ends_early else ""
        missing = f" and {self.lost_ticks} missing" if self.gaps else ""
        return (f"<palpate recording {self.path}: {len(self.ticks)} ticks{missing}, "
                f"{len(self.markers)} markers, {len(self.scenes)} scenes{early}>")

    def _repr_html_(self) -> str:
        return table("palpate recording", (
            ("file", self.path), ("by", self.program), ("ticks", len(self.ticks)),
            ("lost ticks", self.lost_ticks), ("volumes", ", ".join(self.volume_sources)),
            ("markers", len(self.markers)), ("scenes", len(self.scenes)),
            ("edits", len(self.edits)),
            ("complete", self.ends_early or "yes")))


class _Contents:
    """Collects the messages, which must come in the writer's order."""

    def __init__(self, file: McapFile, size: int) -> None:
        self.ticks = TickReader(size)
        self.markers: list[RecordedMarker] = []
        self.steps: list[Step] = []
        self.edits: list[RecordedEdit] = []
        self.clock: list[tuple[int, int]] = []
        self._file = file
        self._parts: list[RecordedEdit] = []
        self._bricks = 0  # of these
        self._left = _MOST_HELD * size + _FREE_BYTES  # bytes of messages that are no ticks

    def take(self, chunk: bytes) -> None:
        """Takes the records of a chunk. Errors: Damaged; nothing of that record is taken then."""
        at = 0
        while at < len(chunk):
            if len(chunk) - at < HEAD.size:
                raise Damaged("damaged: a chunk ends within a record")
            opcode, size = HEAD.unpack_from(chunk, at)
            begin = at + HEAD.size
            if size > len(chunk) - begin or (opcode == MESSAGE and size < MESSAGE_HEAD.size):
                raise Damaged("damaged: a record of another length")
            at = begin + size
            if opcode == CHUNK:
                raise Damaged("damaged: a chunk within a chunk")
            if opcode in (SCHEMA, CHANNEL):
                self._file.declare(opcode, chunk[begin:at])
            elif opcode == MESSAGE:
                number = MESSAGE_HEAD.unpack_from(chunk, begin)[0]
                if number not in self._file.channels:
                    raise Damaged("damaged: a message has no channel")
                channel = self._file.channels[number]
                kind = _MESSAGES.get(channel.topic)
                if kind is None or self._file.schemas.get(
                        channel.schema) != kind.DESCRIPTOR.full_name:
                    continue  # of another program
                if channel.topic == "/tick":
                    at = self.ticks.take(chunk, begin - HEAD.size)
                else:
                    self._left -= _BYTES_PER_MESSAGE + at - begin
                    if self._left < 0:
                        raise Damaged("damaged: it holds more than a file of its size can")
                    self._take(parsed(kind, chunk[begin + MESSAGE_HEAD.size:at]))

    def _take(self, message: typing.Any) -> None:
        if isinstance(message, recorded_pb2.RecordedClock):
            self.clock.append((message.time_ns, message.unix_ns))
        elif isinstance(message, recorded_pb2.RecordedScene):
            scene = scene_of(message)
            self.ticks.start_at(message.tick)
            self.steps.append(Step(scene, tuple(self._parts)))
            self._parts, self._bricks = [], 0
        elif isinstance(message, recorded_pb2.RecordedVoxels):
            edit = edit_of(message)
            self._bricks += edit.brick_count
            if self._bricks > MOST_BRICKS:
                raise Damaged("damaged: of too many bricks")
            self.ticks.start_at(message.tick)
            self.edits.append(edit)
            self._parts.append(edit)
        elif isinstance(message, recorded_pb2.RecordedKeyframe):
            self.ticks.start_at(message.tick)
        elif message.marker:
            if len(message.marker.encode()) > _MOST_MARKER_BYTES:
                raise Damaged("damaged: a marker is too long")
            self.ticks.start_at(message.tick)
            self.markers.append(RecordedMarker(message.tick, message.time_ns, message.marker))


_MESSAGES: dict[str, typing.Any] = {
    "/tick": recorded_pb2.RecordedTick, "/scene": recorded_pb2.RecordedScene,
    "/voxels": recorded_pb2.RecordedVoxels, "/keyframe": recorded_pb2.RecordedKeyframe,
    "/event": recorded_pb2.RecordedEvent, "/clock": recorded_pb2.RecordedClock}


def open_recording(path: str | os.PathLike[str]) -> RecordingFile:
    """Reads a recording of palpated on this program's machine, all of it into memory.

    A tick takes about 450 bytes, an hour about 1.6 GB. If the file is cut off or damaged, the
    result has all ticks before that place, and RecordingFile.ends_early says why it ends there.
    path: of a file that Recording.start() wrote, copied here if the daemon is elsewhere.
    Errors: NotFound, PermissionDenied, InvalidArgument (not a recording).
    Example: print(palpate.open_recording("trial-7.mcap").ticks.force_n.max())
    """
    name = path_text(path)
    try:
        # Opening a pipe would wait for a writer.
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise InvalidArgument(f"{name} is no file")
        with open(path, "rb") as stream:
            return _read(stream, name)
    except (FileNotFoundError, NotADirectoryError):
        raise NotFound(f"there is no file {name}") from None
    except PermissionError:
        raise PermissionDenied(f"the file {name} may not be read") from None
    except OSError as failed:
        raise InvalidArgument(f"{name} cannot be read: {failed.strerror}") from None


def _read(stream: typing.BinaryIO, name: str) -> RecordingFile:
    try:
        size = os.fstat(stream.fileno()).st_size
        file = McapFile(stream, size)
    except Damaged as damage:
        raise InvalidArgument(f"{name} is no recording of Palpate: it is {damage}") from None
    contents, why = _Contents(file, size), ""
    try:
        for chunk in file.chunks():
            contents.take(chunk)
    except Damaged as damage:
        why = f"it is {damage}"
    header = file.metadata.get("palpate.recording")
    if header is None:
        raise InvalidArgument(f"{name} is no recording of Palpate, or ends within its header")
    gaps = [RecordedGap(first, last) for first, last in contents.ticks.gaps]
    columns = contents.ticks.columns()
    ticks = RecordedTicks(**columns, lost_ticks=_lost_before(columns["tick"], gaps))
    why = why or _why_not_whole(file, ticks, contents.ticks.last, gaps)
    created, monotonic = (_whole(header, key, -1 << 63, (1 << 63) - 1)
                          for key in ("created_unix_ns", "created_monotonic_ns"))
    if created is None or (monotonic is None and "created_monotonic_ns" in header):
        raise InvalidArgument(f"{name} has a damaged header")
    return RecordingFile(
        path=name, program=header.get("program", ""), created_unix_ns=created,
        created_monotonic_ns=monotonic, clock=np.array(contents.clock, np.int64).reshape(-1, 2),
        ticks=ticks, markers=tuple(contents.markers),
        scenes=tuple(step.scene for step in contents.steps), edits=tuple(contents.edits),
        gaps=tuple(gaps), ends_early=f"{name}: {why}, after {len(ticks)} ticks" if why else "",
        _steps=tuple(contents.steps))


def _lost_before(ticks: npt.NDArray[np.uint64],
                 gaps: list[RecordedGap]) -> npt.NDArray[np.uint64]:
    """Returns for each tick how many ticks of the gaps come before it."""
    ends = np.array([gap.last_tick for gap in gaps], np.uint64)
    sizes = [0, *(gap.last_tick - gap.first_tick + 1 for gap in gaps)]
    return np.cumsum(np.array(sizes, np.uint64))[np.searchsorted(ends, ticks)]


def _whole(texts: dict[str, str], key: str, least: int, most: int) -> int | None:
    """None: it is not there, or no number from `least` to `most`."""
    text = texts.get(key, "")
    sign = "-?" if least < 0 else ""
    number = int(text) if re.fullmatch(sign + "[0-9]{1,40}", text, re.ASCII) else most + 1
    return number if least <= number <= most else None


def _why_not_whole(file: McapFile, ticks: RecordedTicks, last: int | None,
                   gaps: list[RecordedGap]) -> str:
    """Adds the ticks that were lost at the end. Returns why the recording is not whole, or "".

    last: tick that came, or was lost; None: none did
    """
    end = file.metadata.get("palpate.end")
    if not file.is_complete or end is None:
        return "it was not closed"
    count, lost = (_whole(end, key, 0, (1 << 64) - 1) for key in ("ticks", "lost_ticks"))
    missing = (lost or 0) - sum(gap.last_tick - gap.first_tick + 1 for gap in gaps)
    if lost is None or count != len(ticks) or missing < 0 or (missing and last is None) or (
            last is not None and last + missing >= (1 << 64) - 1):
        return "it is damaged: its counts do not fit"
    if missing and last is not None:
        gaps.append(RecordedGap(last + 1, last + missing))
    return ""
