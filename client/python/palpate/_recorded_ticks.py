"""The ticks of a recording as NumPy arrays. server/recording/sample_codec.cpp has the format."""

import collections.abc
import dataclasses
import typing

import numpy as np
import numpy.typing as npt

from palpate._enums import (DeviceStatus, ForceCommand, ForceReason, ForceState, FreeSide,
                            ProxyMode)
from palpate._recording_frame import Damaged, Reader
from palpate._tables import Table

_MOST_SAMPLES = 1000


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RecordedTicks(Table):
    """n recorded ticks, oldest first; len() is n.

    The fields of Poses have the same meaning here, but replayed, sent_time_ns and
    dropped_samples are missing. Frames, units and NaN are as in Poses. The further fields are

    input_rejected: (n,) the device gave no position; hip_mm is the last good one
    scene_revision: (n,) rises with each scene published to the servo
    faulty_ticks: (n,) ticks so far with zero force because of a fault
    force_command: (n,) of ForceCommand: the command to the safety stage
    device_status: (n,) of DeviceStatus
    docked: (n,) the stylus is in its place of rest
    calibrated: (n,) the device knows where its stylus is
    """

    tick: npt.NDArray[np.uint64]
    time_ns: npt.NDArray[np.int64]
    hip_mm: npt.NDArray[np.float64]
    scp_h_mm: npt.NDArray[np.float64]
    scp_h_normal: npt.NDArray[np.float64]
    scp_v_mm: npt.NDArray[np.float64]
    scp_v_normal: npt.NDArray[np.float64]
    stylus_orientation: npt.NDArray[np.float64]
    buttons: npt.NDArray[np.uint32]
    force_n: npt.NDArray[np.float64]
    mode: npt.NDArray[np.uint8]
    contact: npt.NDArray[np.bool_]
    density: npt.NDArray[np.float64]
    isovalue: npt.NDArray[np.float64]
    settings_revision: npt.NDArray[np.uint64]
    volume_revision: npt.NDArray[np.uint64]
    update_ns: npt.NDArray[np.int64]
    missed_ticks: npt.NDArray[np.uint64]
    iterations: npt.NDArray[np.uint32]
    capped_ticks: npt.NDArray[np.uint64]
    free_side: npt.NDArray[np.uint8]
    force_state: npt.NDArray[np.uint8]
    force_reason: npt.NDArray[np.uint8]
    force_limit_n: npt.NDArray[np.float64]
    input_rejected: npt.NDArray[np.bool_]
    scene_revision: npt.NDArray[np.uint64]
    faulty_ticks: npt.NDArray[np.uint64]
    force_command: npt.NDArray[np.uint8]
    device_status: npt.NDArray[np.uint8]
    docked: npt.NDArray[np.bool_]
    calibrated: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.tick)

    def __repr__(self) -> str:
        ticks = f", ticks {self.tick[0]} to {self.tick[-1]}" if len(self) else ""
        return f"<palpate recorded ticks: {len(self)}{ticks}>"


# The file's columns in order: type, numbers per tick, and the number of an enumeration's values.
_COLUMNS: dict[str, tuple[str, int, int]] = {
    "tick": ("u8", 1, 0), "time_ns": ("i8", 1, 0), "mode": ("u1", 1, len(ProxyMode)),
    "contact": ("u1", 1, 2), "free_side": ("u1", 1, len(FreeSide)),
    "input_rejected": ("u1", 1, 2), "hip_mm": ("f8", 3, 0), "scp_h_mm": ("f8", 3, 0),
    "scp_h_normal": ("f8", 3, 0), "has_scp_v": ("u1", 1, 2), "scp_v_mm": ("f8", 3, 0),
    "scp_v_normal": ("f8", 3, 0), "force_n": ("f8", 3, 0), "stylus_orientation": ("f8", 4, 0),
    "buttons": ("u4", 1, 0), "density": ("f8", 1, 0), "isovalue": ("f8", 1, 0),
    "scene_revision": ("u8", 1, 0), "settings_revision": ("u8", 1, 0),
    "volume_revision": ("u8", 1, 0), "update_ns": ("i8", 1, 0), "iterations": ("u4", 1, 0),
    "missed_ticks": ("u8", 1, 0), "capped_ticks": ("u8", 1, 0), "faulty_ticks": ("u8", 1, 0),
    "force_state": ("u1", 1, len(ForceState)), "force_reason": ("u1", 1, ForceReason.STOP_BUTTON),
    "force_command": ("u1", 1, len(ForceCommand)), "force_limit_n": ("f8", 1, 0),
    "device_status": ("u1", 1, len(DeviceStatus)), "docked": ("u1", 1, 2),
    "calibrated": ("u1", 1, 2)}
_FLAGS = ("contact", "input_rejected", "has_scp_v", "docked", "calibrated")
_TICK_BYTES = sum(np.dtype(kind).itemsize * width for kind, width, _ in _COLUMNS.values())

Columns = dict[str, npt.NDArray[typing.Any]]


def columns_of(payload: bytes) -> Columns:
    """Returns the columns of a chunk of samples by name, as stored. Errors: Damaged."""
    reader = Reader(payload)
    count, = reader.get("I")
    if not 0 < count <= _MOST_SAMPLES:
        raise Damaged("damaged: too many samples")
    data = np.frombuffer(reader.get_bytes(count * _TICK_BYTES), np.uint8)
    reader.expect_end()
    columns: Columns = {}
    at = 0
    for name, (kind, width, values) in _COLUMNS.items():
        size = np.dtype(kind).itemsize
        parts = []
        for _ in range(width):
            parts.append(_numbers(data[at:at + size * count].reshape(size, count), kind))
            at += size * count
        column = parts[0] if width == 1 else np.stack(parts, axis=1)
        if values and column.max() >= values:
            raise Damaged("damaged: a field is out of its range")
        columns[name] = column
    if np.any(np.diff(columns["tick"]) != 1):
        raise Damaged("damaged: ticks are missing")
    return columns


def _numbers(planes: npt.NDArray[np.uint8], kind: str) -> npt.NDArray[typing.Any]:
    """Decodes an array of (bytes of a number, n). Each number is stored byte by byte, as the
    difference to the number before, with the sign in the lowest bit."""
    size, count = planes.shape
    words = np.zeros((count, 8), np.uint8)
    words[:, :size] = planes.T
    folded = words.view("<u8")[:, 0]
    differences = (folded >> np.uint64(1)) ^ (np.uint64(0) - (folded & np.uint64(1)))
    # Sums are modulo 2^64, and so also modulo every smaller power of two.
    bits = np.cumsum(differences, dtype=np.uint64)
    return bits.astype(f"<u{size}").view("<" + kind)


def ticks_of(chunks: collections.abc.Sequence[Columns]) -> RecordedTicks:
    """Joins the ticks of the chunks, with the contract's enumerations, and NaN for no value."""
    columns: Columns = {}
    for name, (kind, width, values) in _COLUMNS.items():
        column = (np.concatenate([chunk[name] for chunk in chunks]) if chunks else
                  np.empty((0, width) if width > 1 else 0, kind))
        if name in _FLAGS:
            column = column.astype(np.bool_)
        elif values:
            # As in the messages, where enumerations begin at 1.
            column = column + np.uint8(1)
        columns[name] = column
    columns["scp_h_normal"][~columns["contact"]] = np.nan
    has_scp_v = columns.pop("has_scp_v")
    columns["scp_v_mm"][~has_scp_v] = np.nan
    columns["scp_v_normal"][~has_scp_v] = np.nan
    return RecordedTicks(**columns)
