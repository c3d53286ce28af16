"""Recordings of the haptic loop, on the daemon's machine."""

import dataclasses
import os

from palpate._link import Link
from palpate.v1 import recording_pb2, recording_pb2_grpc


@dataclasses.dataclass(frozen=True)
class RecordingState:
    """What is being recorded, or was last.

    lost_ticks: ticks that the disk was too slow for
    error: why it ended early; empty: it did not
    left_out: why some of its ticks cannot be computed again; empty: all can
    """

    running: bool
    path: str
    ticks: int
    lost_ticks: int
    size_bytes: int
    error: str
    left_out: str = ""


def _state_of(recording: recording_pb2.RecordingState) -> RecordingState:
    return RecordingState(recording.running, recording.path, recording.ticks, recording.lost_ticks,
                          recording.size_bytes, recording.error, recording.left_out)


class Recording:
    """Records every tick, every scene and every changed voxel; Connection.recording.

    Errors: Conflict, InvalidArgument, NotFound, PermissionDenied, Unavailable.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stub = link.stub(recording_pb2_grpc.RecordingServiceStub)

    def start(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> RecordingState:
        """Records to a file on the daemon's machine, until stopped.

        path: absolute, or relative as in VolumeAccess.load. Conflict where the file is there,
        or another recording or a replay runs.
        """
        request = recording_pb2.StartRecordingRequest(path=self._link.path(path),
                                                      overwrite=overwrite)
        return _state_of(self._link.call(self._stub.StartRecording, request).recording)

    def stop(self) -> RecordingState:
        """Ends it, the file being whole. Conflict when nothing is recorded."""
        request = recording_pb2.StopRecordingRequest()
        return _state_of(self._link.call(self._stub.StopRecording, request).recording)

    def state(self) -> RecordingState:
        """What is being recorded, or was last."""
        request = recording_pb2.GetRecordingRequest()
        return _state_of(self._link.call(self._stub.GetRecording, request).recording)

    def mark(self, text: str) -> int:
        """Puts a marker into the recording; returns its time_ns, of Poses' clock.

        text: 1 to 4096 bytes of UTF-8. Conflict when nothing is recorded.
        """
        return int(self._link.call(self._stub.Mark, recording_pb2.MarkRequest(text=text)).time_ns)
