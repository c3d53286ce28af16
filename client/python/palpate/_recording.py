"""Recordings of the haptic loop, on the daemon's machine."""

import collections.abc
import contextlib
import dataclasses
import datetime
import os
import typing

from palpate._errors import InvalidArgument
from palpate._held import held_in
from palpate._link import Link
from palpate._progress import tell
from palpate._value_list import RecordingState
from palpate._values import number, switch, text_of, whole
from palpate.v1 import recording_pb2, recording_pb2_grpc

_MOST_MARKER_BYTES = 4096


@dataclasses.dataclass(frozen=True)
class ReplayState:
    """The progress of a replay.

    ticks: ticks of the recording played so far, and those before first_tick
    lost_ticks: how many ticks before this one the recording does not have
    marker: text of the marker just passed; empty: none
    total_ticks: ticks of the whole recording
    markers: all markers of the recording, as (tick, text), each at its tick; a tick counts from
    the recording's first one
    """

    ticks: int
    lost_ticks: int
    marker: str
    total_ticks: int = 0
    markers: tuple[tuple[int, str], ...] = ()


@dataclasses.dataclass(frozen=True)
class ListedRecording:
    """A recording on the daemon's machine.

    path: absolute, on the daemon's machine
    size_bytes: size of the file, bytes
    modified: when the file was last written, UTC
    """

    path: str
    size_bytes: int
    modified: datetime.datetime


class Recording:
    """Records every tick, every scene and every changed voxel; Connection.recording.

    Errors: Conflict, InvalidArgument, NotFound, PermissionDenied, Unavailable.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stub = link.stub(recording_pb2_grpc.RecordingServiceStub)

    def _state(self, method: typing.Any, request: typing.Any) -> RecordingState:
        return RecordingState(**held_in(self._link.call(method, request).recording))

    def start(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> RecordingState:
        """Records to a file on the daemon's machine, until stopped.

        path: absolute, or relative as in VolumeAccess.load. overwrite: replace a file that exists.
        Errors: Conflict (the file exists, or another recording or a replay runs), NotFound (no
        such folder), PermissionDenied (a folder that the daemon does not save to), DiskFull,
        InvalidArgument, Unavailable.
        Example: conn.recording.start("/data/trial-7.mcap")
        """
        request = recording_pb2.StartRecordingRequest(path=self._link.path(path),
                                                      overwrite=switch("overwrite", overwrite))
        return self._state(self._stub.StartRecording, request)

    def stop(self) -> RecordingState:
        """Ends the recording and completes the file.

        Errors: Conflict (nothing is recorded), Unavailable.
        Example: print(conn.recording.stop().ticks)
        """
        request = recording_pb2.StopRecordingRequest()
        return self._state(self._stub.StopRecording, request)

    def state(self) -> RecordingState:
        """Returns the state of the present recording, or of the last one, and of a replay.

        Errors: Unavailable. Example: conn.recording.state().lost_ticks
        """
        request = recording_pb2.GetRecordingRequest()
        return self._state(self._stub.GetRecording, request)

    def mark(self, text: str) -> int:
        """Puts a marker into the recording. Returns the marker's time_ns, on Poses' clock.

        The recording has it at the last tick that began at or before this time. That tick is not
        known yet: RecordedMarker.tick says it.
        text: 1 to 4096 bytes of UTF-8.
        Errors: InvalidArgument, Conflict (nothing is recorded), Unavailable.
        Example: conn.recording.mark("trial 7 begins")
        """
        if not 0 < len(text_of("text", text).encode()) <= _MOST_MARKER_BYTES:
            raise InvalidArgument(f"a marker has 1 to {_MOST_MARKER_BYTES} bytes of text")
        return int(self._link.call(self._stub.Mark, recording_pb2.MarkRequest(text=text)).time_ns)

    def list(self) -> tuple[ListedRecording, ...]:
        """Returns the recordings in the folders that the daemon saves to, newest first.

        At most 1000. Errors: PermissionDenied, Unavailable.
        Example: conn.recording.replay(conn.recording.list()[0].path)
        """
        response = self._link.call(self._stub.ListRecordings,
                                   recording_pb2.ListRecordingsRequest())
        return tuple(
            ListedRecording(file.path, file.size_bytes,
                            datetime.datetime.fromtimestamp(file.modified_s, datetime.timezone.utc))
            for file in response.recordings)

    def replay(self, path: str | os.PathLike[str], speed: float = 1.0, *, first_tick: int = 0,
               progress: collections.abc.Callable[[ReplayState], object] | None = None
               ) -> ReplayState:
        """Plays a recording to all clients that follow the poses, with forces off.

        Returns the last state when the replay has ended. The recorded volume must be loaded.
        Meanwhile, what viewers are shown is the recorded: poses, settings, place and voxels.
        Nothing live changes, and changing it is a Conflict.
        path: on the daemon's machine, absolute or relative as in VolumeAccess.load.
        speed: multiple of real time, above 0 up to 100.
        first_tick: the first tick to show, counted from the recording's first one. What changed
        before it is applied at once.
        progress: called with a ReplayState some times a second and for each marker. If it raises
        an exception, the replay ends with that exception. If it returns False, the replay ends
        with Cancelled.
        Errors: InvalidArgument (not a recording, or first_tick is beyond its end), NotFound,
        PermissionDenied (a folder that the daemon does not load from), Conflict (another volume is
        loaded; a recording or a replay runs), Cancelled, Unavailable.
        Example: conn.recording.replay("/data/trial-7.mcap", speed=2)
        """
        speed = number("speed", speed)
        # In the contract, 0 means the usual speed. A caller who gives 0 does not mean that.
        if not 0 < speed <= 100:
            raise InvalidArgument(f"speed is above 0 and at most 100, not {speed:g}")
        request = recording_pb2.ReplayRequest(path=self._link.path(path), speed=speed,
                                              first_tick=whole("first_tick", first_tick))
        markers: tuple[tuple[int, str], ...] = ()
        state = ReplayState(0, 0, "")
        with contextlib.closing(self._link.events(self._stub.Replay, request)) as events:
            for event in events:
                markers = markers or tuple((marker.tick, marker.text) for marker in event.markers)
                state = ReplayState(event.ticks, event.lost_ticks, event.marker,
                                    event.total_ticks, markers)
                tell(progress, state)
        return dataclasses.replace(state, marker="")
