"""The volume's place in the device's workspace."""

import collections.abc
import dataclasses
import math
import typing

import numpy as np
import numpy.typing as npt

from palpate._errors import InvalidArgument
from palpate._geometry import Quadruple, Triple, array_of_vector, quaternion_of, vector_of
from palpate._link import Link
from palpate._values import (number, number_or_none, switch, text_of, warn_if_not_kept,
                             whole)
from palpate.v1 import geometry_pb2, registration_pb2, registration_pb2_grpc

# An axis of the device, "x", "y" or "z", and degrees.
Turn = tuple[str, float]


@dataclasses.dataclass(frozen=True, eq=False)
class Placement:
    """The volume's place in the device frame: mm, x right, y up, z towards the user.

    center_mm: (3,) the volume's centre, mm
    rotation_wxyz: (4,) unit quaternion w, x, y, z: the world's axes to the device's
    device_mm_per_volume_mm: millimetres of device motion per millimetre of the volume
    device_mm_per_voxel: the same per shortest edge of a voxel; 1 mm is 1 / this many cells
    settings_revision: of the settings with this placement
    replayed: a recording is replayed: this is the recorded place
    applied_tick: first tick that used the placement; None: nothing was changed
    not_kept: as in Applied
    """

    center_mm: npt.NDArray[np.float64]
    rotation_wxyz: npt.NDArray[np.float64]
    device_mm_per_volume_mm: float
    device_mm_per_voxel: float
    settings_revision: int
    replayed: bool
    applied_tick: int | None
    not_kept: str = ""


def update_of(*, reset: bool = False, center_mm: Triple | None = None,
              rotation_wxyz: Quadruple | None = None,
              device_mm_per_volume_mm: float | None = None,
              device_mm_per_voxel: float | None = None, cells_per_mm: float | None = None,
              move_mm: Triple | None = None, turn_deg: Turn | None = None,
              scale_by: float | None = None, face: str = "",
              head: str = "") -> registration_pb2.UpdateRegistrationRequest:
    """Makes the request for VolumeAccess.place(). Errors: InvalidArgument."""
    given = [scale for scale in (device_mm_per_volume_mm, device_mm_per_voxel, cells_per_mm)
             if scale is not None]
    if len(given) > 1:
        raise InvalidArgument("give one of device_mm_per_volume_mm, device_mm_per_voxel and "
                              "cells_per_mm")
    if cells_per_mm is not None:
        cells_per_mm = number("cells_per_mm", cells_per_mm)
        if not cells_per_mm > 0:
            raise InvalidArgument(f"cells_per_mm is above 0, not {cells_per_mm:g}")
        device_mm_per_voxel = 1.0 / cells_per_mm
    request = registration_pb2.UpdateRegistrationRequest(
        reset=switch("reset", reset), scale_by=number_or_none("scale_by", scale_by),
        device_mm_per_volume_mm=number_or_none("device_mm_per_volume_mm",
                                               device_mm_per_volume_mm),
        device_mm_per_voxel=number_or_none("device_mm_per_voxel", device_mm_per_voxel))
    if center_mm is not None:
        request.center_mm.CopyFrom(vector_of("center_mm", center_mm))
    if rotation_wxyz is not None:
        request.rotation.CopyFrom(quaternion_of("rotation_wxyz", rotation_wxyz))
    if move_mm is not None:
        request.translate_mm.CopyFrom(vector_of("move_mm", move_mm))
    if turn_deg is not None:
        request.rotate.CopyFrom(_turn(turn_deg))
    if face or head:
        request.facing.face = text_of("face", face)
        request.facing.head = text_of("head", head)
    return request


def place(link: Link, request: registration_pb2.UpdateRegistrationRequest,
          expected_revision: int | None) -> Placement:
    """Moves the volume. A request without a change only asks for its place."""
    stub = link.stub(registration_pb2_grpc.RegistrationServiceStub)
    if request.ByteSize() > 0:
        if expected_revision is not None:
            request.expected_revision = whole("expected_revision", expected_revision)
        answer = link.call(stub.UpdateRegistration, request)
        warn_if_not_kept(answer.not_kept)
        return dataclasses.replace(_placement(answer, replayed=False,
                                              applied_tick=answer.applied_tick),
                                   not_kept=answer.not_kept)
    if expected_revision is not None:
        raise InvalidArgument("expected_revision is for a change: name one")
    answer = link.call(stub.GetRegistration, registration_pb2.GetRegistrationRequest())
    return _placement(answer, replayed=answer.replayed, applied_tick=None)


def _placement(answer: typing.Any, *, replayed: bool, applied_tick: int | None) -> Placement:
    placed, turn = answer.registration, answer.registration.rotation
    return Placement(array_of_vector(placed.center_mm),
                     np.array([turn.w, turn.x, turn.y, turn.z]), placed.device_mm_per_volume_mm,
                     placed.device_mm_per_voxel, answer.settings_revision, replayed, applied_tick)


def _turn(turn_deg: Turn) -> geometry_pb2.Quaternion:
    if not isinstance(turn_deg, (tuple, list)) or len(turn_deg) != 2 or (
            turn_deg[0] not in ("x", "y", "z")):
        raise InvalidArgument('turn_deg is an axis and degrees, as in ("y", 90), not '
                              f"{turn_deg!r}")
    half = math.radians(number("turn_deg[1]", turn_deg[1])) / 2
    if not math.isfinite(half):
        raise InvalidArgument(f"turn_deg has a number of degrees, not {turn_deg[1]!r}")
    return geometry_pb2.Quaternion(w=math.cos(half), **{turn_deg[0]: math.sin(half)})
