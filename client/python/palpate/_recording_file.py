"""Recordings of the haptic loop as NumPy arrays, without a daemon."""

import collections.abc
import dataclasses
import os
import stat
import typing

import numpy as np
import numpy.typing as npt

from palpate._errors import (Conflict, FailedPrecondition, InvalidArgument, NotFound,
                             PermissionDenied)
from palpate._html import table
from palpate._recorded_events import (RecordedEdit, RecordedGap, RecordedMarker, RecordedScene,
                                      edit_of, gap_of, marker_of, scene_of)
from palpate._recorded_ticks import Columns, RecordedTicks, columns_of, ticks_of
from palpate._recorded_voxels import Step, voxels_of
from palpate._recording_frame import (Damaged, Header, Kind, Reader, read_chunks, read_header,
                                      unpack)
from palpate._values import path_text


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RecordingFile:
    """A recording that open_recording() has read.

    path: the file, as it was given to open_recording()
    program: the program that recorded it, such as "palpated 0.1.0"
    created_unix_ns: when the recording began: UTC, nanoseconds since 1970
    created_monotonic_ns: the same moment on the clock of RecordedTicks.time_ns; None: not recorded
        (before version 6)
    version: of the format
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
    version: int
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

    def to_unix_ns(self, time_ns: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Returns times of the ticks' clock as UTC: nanoseconds since 1970.

        time_ns: RecordedTicks.time_ns or RecordedMarker.time_ns. The computer's clock is read once,
        when the recording begins. Steps of that clock during the recording make no difference.
        Errors: FailedPrecondition (recorded by an earlier version), InvalidArgument (no whole
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

    def _step_at(self, tick: int) -> int:
        found = [n for n, step in enumerate(self._steps) if step.scene.tick <= tick]
        if not found:
            raise NotFound(f"no scene is recorded for the tick {tick}")
        return found[-1]

    def __repr__(self) -> str:
        early = f", ends early: {self.ends_early}" if self.ends_early else ""
        return (f"<palpate recording {self.path}: {len(self.ticks)} ticks, "
                f"{len(self.markers)} markers, {len(self.scenes)} scenes{early}>")

    def _repr_html_(self) -> str:
        return table("palpate recording", (
            ("file", self.path), ("by", self.program), ("ticks", len(self.ticks)),
            ("lost ticks", self.lost_ticks), ("volumes", ", ".join(self.volume_sources)),
            ("markers", len(self.markers)), ("scenes", len(self.scenes)),
            ("edits", len(self.edits)),
            ("complete", self.ends_early or "yes")))


class _Contents:
    """Collects the chunks, which must come in the writer's order."""

    def __init__(self) -> None:
        self.columns: list[Columns] = []
        self.markers: list[RecordedMarker] = []
        self.steps: list[Step] = []
        self.edits: list[RecordedEdit] = []
        self.gaps: list[RecordedGap] = []
        self.ticks = 0
        self.is_closed = False
        self._next_tick: int | None = None
        self._parts: list[RecordedEdit] = []

    def take(self, kind: Kind, packed: bytes) -> None:
        """Takes a whole chunk. Errors: Damaged; nothing of the chunk is taken then."""
        if self.is_closed:
            self.is_closed = False
            raise Damaged("behind the end")
        if kind == Kind.SAMPLES:
            columns = columns_of(unpack(packed))
            tick = int(columns["tick"][0])
            self._start_at(tick)
            self._next_tick = tick + len(columns["tick"])
            self.columns.append(columns)
            self.ticks += len(columns["tick"])
        elif kind == Kind.EDIT:
            edit = edit_of(packed)
            self._start_at(edit.tick)
            self.edits.append(edit)
            self._parts.append(edit)
        else:
            reader = Reader(unpack(packed))
            self._take_small(kind, reader)

    def _take_small(self, kind: Kind, reader: Reader) -> None:
        held: typing.Any
        if kind == Kind.SCENE:
            held = scene_of(reader)
            reader.expect_end()
            self._start_at(held.tick)
            self.steps.append(Step(held, tuple(self._parts)))
            self._parts = []
        elif kind == Kind.MARKER:
            held = marker_of(reader)
            reader.expect_end()
            self._start_at(held.tick)
            self.markers.append(held)
        elif kind == Kind.GAP:
            held = gap_of(reader)
            reader.expect_end()
            self._start_at(held.first_tick)
            self._next_tick = held.last_tick + 1
            self.gaps.append(held)
        elif kind == Kind.KEYFRAME:
            # The servo's state. `palpate-lab replay` continues from it.
            tick, = reader.get("Q")
            reader.get_bytes(reader.get("I")[0])
            reader.expect_end()
            self._start_at(tick)
        else:
            self._end(*reader.get("QQ"))
            reader.expect_end()

    def _end(self, ticks: int, lost_ticks: int) -> None:
        lost = sum(gap.last_tick - gap.first_tick + 1 for gap in self.gaps)
        if (ticks, lost_ticks) != (self.ticks, lost):
            raise Damaged("damaged: its counts do not fit")
        self.is_closed = True

    def _start_at(self, tick: int) -> None:
        if self._next_tick is not None and tick != self._next_tick:
            raise Damaged("damaged: ticks are missing")
        self._next_tick = tick


def open_recording(path: str | os.PathLike[str]) -> RecordingFile:
    """Reads a recording of palpated on this program's machine, all of it into memory.

    A tick takes about 400 bytes, an hour about 1.5 GB. If the file is cut off or damaged, the
    result has all ticks before that place, and RecordingFile.ends_early says why it ends there.
    path: of a file that Recording.start() wrote, copied here if the daemon is elsewhere.
    Errors: NotFound, PermissionDenied, InvalidArgument (not a recording, or of another
    version).
    Example: print(palpate.open_recording("trial-7.palrec").ticks.force_n.max())
    """
    name = path_text(path)
    try:
        # Opening a pipe would wait for a writer.
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise InvalidArgument(f"{name} is no file")
        with open(path, "rb") as stream:
            header = read_header(stream, name)
            contents, why = _read(stream)
    except (FileNotFoundError, NotADirectoryError):
        raise NotFound(f"there is no file {name}") from None
    except PermissionError:
        raise PermissionDenied(f"the file {name} may not be read") from None
    except OSError as failed:
        raise InvalidArgument(f"{name} cannot be read: {failed.strerror}") from None
    early = f"{name}: {why}, after {contents.ticks} ticks" if why else ""
    return _recording_of(name, header, contents, early)


def _read(stream: typing.BinaryIO) -> tuple[_Contents, str]:
    """Returns the recording, and why it ends early."""
    contents = _Contents()
    number = 0
    chunks: collections.abc.Iterator[tuple[Kind, bytes]] = read_chunks(stream)
    try:
        for number, (kind, packed) in enumerate(chunks):
            contents.take(kind, packed)
            number += 1
    except Damaged as damage:
        return contents, f"chunk {number} is {damage}"
    return contents, "" if contents.is_closed else "was not closed"


def _placed(markers: collections.abc.Sequence[RecordedMarker],
            ticks: RecordedTicks) -> tuple[RecordedMarker, ...]:
    """Places the markers by their times. Before version 6, their stored ticks are not exact."""
    if not len(ticks):
        return tuple(markers)
    times = np.array([marker.time_ns for marker in markers], np.int64)
    rows = np.searchsorted(ticks.time_ns, times, side="right") - 1
    return tuple(dataclasses.replace(marker, tick=int(ticks.tick[max(row, 0)]))
                 for marker, row in zip(markers, rows))


def _recording_of(name: str, header: Header, contents: _Contents, early: str) -> RecordingFile:
    ticks = ticks_of(contents.columns)
    return RecordingFile(
        path=name, program=header.program, created_unix_ns=header.created_unix_ns,
        created_monotonic_ns=header.created_monotonic_ns, version=header.version, ticks=ticks,
        markers=_placed(contents.markers, ticks), scenes=tuple(step.scene for step in contents.steps),
        edits=tuple(contents.edits), gaps=tuple(contents.gaps), ends_early=early,
        _steps=tuple(contents.steps))
