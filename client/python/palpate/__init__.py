"""Client of palpated: feel an isosurface from Python, change its settings and record it.

    with palpate.connect() as conn:
        conn.settings.isovalue = 300.0
        for poses in conn.poses(rate_hz=1000, batch=50):
            print(poses.force_n[-1])
    recording = palpate.open_recording("trial-7.mcap")     # needs no daemon

Units are in the names, shapes in the docstrings. Volumes are arrays indexed [x, y, z].
"""

from palpate._activity import Activity, ConnectedCaller
from palpate._connection import Connection, connect
from palpate._device import Device, DeviceInfo
from palpate._edits import EditResult, Edits
from palpate._enums import (DecompositionMethod, DeviceConnection, DeviceStatus, ForceCommand,
                            ForceReason, ForceState, FreeSide, ProxyMode, Role,
                            VerificationLevel)
from palpate._errors import (Cancelled, Conflict, DiskFull, Error, FailedPrecondition, Internal,
                             InvalidArgument, NotFound, PermissionDenied, TooLarge, Unavailable)
from palpate._facts import Facts
from palpate._follow import LiveVolume
from palpate._hand import Hand
from palpate._layers import Layer
from palpate._load_options import Raw
from palpate._placement import Placement
from palpate._poses import Poses, PoseStream
from palpate._profiles import Profile, profiles
from palpate._recording import ListedRecording, Recording, ReplayState
from palpate._recorded_events import (RecordedEdit, RecordedGap, RecordedMarker,
                                      RecordedPassing, RecordedScene)
from palpate._recording_file import RecordedTicks, RecordingFile, open_recording
from palpate._series import Series, SeriesState
from palpate._settings import Applied, Settings
from palpate._tool import Tool, ToolBall
from palpate._value_list import (BallState, ForceStatus, LastChange, ListedDevice,
                                 RecordingState, RunningReplay, SuggestedIsovalue)
from palpate._volume import VolumeAccess, VolumeInfo
from palpate._voxels import Volume

__all__ = [
    "Activity", "Applied", "BallState", "Cancelled", "Conflict", "ConnectedCaller", "Connection",
    "DecompositionMethod", "Device", "DeviceConnection", "DeviceInfo", "DeviceStatus", "DiskFull",
    "EditResult", "Edits", "Error", "Facts", "FailedPrecondition", "ForceCommand", "ForceReason",
    "ForceState", "ForceStatus", "FreeSide", "Hand", "Internal", "InvalidArgument", "LastChange",
    "Layer", "ListedDevice", "ListedRecording", "LiveVolume", "NotFound", "PermissionDenied", "Placement",
    "PoseStream", "Poses", "Profile", "ProxyMode", "Raw", "RecordedEdit", "RecordedGap",
    "RecordedMarker", "RecordedPassing", "RecordedScene", "RecordedTicks", "Recording", "RecordingFile",
    "RecordingState", "ReplayState", "Role", "RunningReplay", "Series", "SeriesState", "Settings",
    "SuggestedIsovalue", "TooLarge", "Tool", "ToolBall", "Unavailable", "VerificationLevel", "Volume",
    "VolumeAccess", "VolumeInfo",
    "connect", "open_recording", "profiles",
]
