"""Changes of the volume's voxels."""

import dataclasses
import typing

import numpy as np
import numpy.typing as npt

from palpate._errors import InvalidArgument, TooLarge
from palpate._geometry import Triple, vector_of
from palpate._link import Link
from palpate._progress import Progress, result_of
from palpate._values import number, number_or_none
from palpate.v1 import edit_pb2, volume_pb2_grpc

Operation = typing.Literal["add", "subtract", "set", "smooth", "paint"]
Frame = typing.Literal["world", "index"]
FilterKind = typing.Literal["gaussian", "mean", "median", "offset", "mean-curvature", "resample"]

_OPERATIONS = {"add": edit_pb2.EDIT_OPERATION_ADD, "subtract": edit_pb2.EDIT_OPERATION_SUBTRACT,
               "set": edit_pb2.EDIT_OPERATION_SET, "smooth": edit_pb2.EDIT_OPERATION_SMOOTH,
               "paint": edit_pb2.EDIT_OPERATION_PAINT}
_FRAMES = {"world": edit_pb2.EDIT_FRAME_WORLD, "index": edit_pb2.EDIT_FRAME_INDEX}
_FILTER_KINDS = {"gaussian": edit_pb2.FILTER_KIND_GAUSSIAN, "mean": edit_pb2.FILTER_KIND_MEAN,
                 "median": edit_pb2.FILTER_KIND_MEDIAN, "offset": edit_pb2.FILTER_KIND_OFFSET,
                 "mean-curvature": edit_pb2.FILTER_KIND_MEAN_CURVATURE,
                 "resample": edit_pb2.FILTER_KIND_RESAMPLE}
_MOST_FILTER_NUMBER = 1000  # more than palpated takes
_MOST_BLOCK_VOXELS = 3 * 1024 * 1024 // 4


@dataclasses.dataclass(frozen=True)
class EditResult:
    """The result of an edit.

    volume_revision: of the volume now; the same as before if no voxel changed
    applied_tick: first tick that used the edit
    changed: box around the changed voxels, as an index into Volume.values; None: no voxel
        changed
    undo_steps: how often undo() would work now
    """

    volume_revision: int
    applied_tick: int
    changed_voxels: int
    changed: tuple[slice, slice, slice] | None
    undo_steps: int
    redo_steps: int


class Edits:
    """Edits of the volume under the stylus, each at one tick; Connection.edit.

    The weight w of a voxel is 1 within the shape and falls smoothly to 0 over `falloff` outside
    of the shape. With the voxel's value v, the operations are

        "add"       v + w·value
        "subtract"  v - w·value
        "set"       value, faded by w
        "smooth"    towards the mean of the 27 voxels around, by w·strength
        "paint"     v + w·strength·(value - v)

    All except "smooth" need `value`. Values are in data units. Results stay within the range
    fixed at load.

    frame "world": positions and lengths in mm, LPS as in DICOM; "index": in voxels. The first
    voxel is (0, 0, 0).

    expected_revision: fail with Conflict unless the volume is at this revision.
    Errors: InvalidArgument, TooLarge (more than 16 777 216 voxels), Conflict, Unavailable.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stub = link.stub(volume_pb2_grpc.VolumeServiceStub)

    def sphere(self, center: Triple, radius: float, operation: Operation,
               value: float | None = None, *, frame: Frame = "world", falloff: float = 0.0,
               strength: float | None = None, expected_revision: int | None = None) -> EditResult:
        """Edits within `radius` of `center` (x, y, z), both in the frame's unit."""
        shape = edit_pb2.SphereShape(center=vector_of("center", center),
                                     radius=number("radius", radius))
        return self._edit(edit_pb2.EditVolumeRequest(sphere=shape), operation, value, frame,
                          falloff, strength, expected_revision)

    def box(self, corner_min: Triple, corner_max: Triple, operation: Operation,
            value: float | None = None, *, frame: Frame = "world", falloff: float = 0.0,
            strength: float | None = None, expected_revision: int | None = None) -> EditResult:
        """Edits a box along the frame's axes, both corners (x, y, z) included."""
        shape = edit_pb2.BoxShape(min=vector_of("corner_min", corner_min),
                                  max=vector_of("corner_max", corner_max))
        return self._edit(edit_pb2.EditVolumeRequest(box=shape), operation, value, frame, falloff,
                          strength, expected_revision)

    def capsule(self, start: Triple, end: Triple, radius: float, operation: Operation,
                value: float | None = None, *, frame: Frame = "world", falloff: float = 0.0,
                strength: float | None = None, expected_revision: int | None = None) -> EditResult:
        """Edits a stroke: what a sphere of `radius` sweeps from `start` to `end` (x, y, z)."""
        shape = edit_pb2.CapsuleShape(**{"from": vector_of("start", start)},
                                      to=vector_of("end", end), radius=number("radius", radius))
        return self._edit(edit_pb2.EditVolumeRequest(capsule=shape), operation, value, frame,
                          falloff, strength, expected_revision)

    def block(self, first: tuple[int, int, int], values: npt.ArrayLike,
              operation: Operation = "set", *, strength: float | None = None,
              expected_revision: int | None = None) -> EditResult:
        """Edits a block of voxels from index `first` (i, j, k) on, each with a value of its own.

        values: (nx, ny, nz), indexed [x, y, z] as Volume.values, data units. Sent as float32; at
        most 786 432 values (3 MiB). Not for "smooth".
        """
        array = np.asarray(values, dtype="<f4")
        if array.ndim != 3:
            raise InvalidArgument(f"a block has three dimensions, not {array.ndim}")
        if array.size > _MOST_BLOCK_VOXELS:
            raise TooLarge(f"a block has at most {_MOST_BLOCK_VOXELS} voxels, this one has "
                           f"{array.size}: send it in parts")
        if min(first) < 0:
            raise InvalidArgument("a block begins at a voxel, from (0, 0, 0) on")
        shape = edit_pb2.DenseBlock(
            min_x=first[0], min_y=first[1], min_z=first[2], size_x=array.shape[0],
            size_y=array.shape[1], size_z=array.shape[2], values=array.tobytes(order="F"))
        return self._edit(edit_pb2.EditVolumeRequest(block=shape), operation, None, "index", 0.0,
                          strength, expected_revision)

    def filter(self, kind: FilterKind, width: int = 1, iterations: int = 1, *,
               distance_mm: float | None = None, spacing_mm: float | Triple | None = None,
               box: tuple[Triple, Triple] | None = None,
               sphere: tuple[Triple, float] | None = None, frame: Frame = "world",
               expected_revision: int | None = None,
               progress: Progress | None = None) -> EditResult:
        """Filters all voxels, or those of a region, with a filter of OpenVDB, as one edit.

        kind, for voxels:
            "gaussian"        four means
            "mean"            of the (2·width + 1)³ voxels around each voxel
            "median"          of the same voxels; slow
        kind, for the whole volume:
            "offset"          moves a level set's surface outwards by distance_mm
            "mean-curvature"  smooths a level set's surface, `iterations` times
            "resample"        to spacing_mm, one number or (x, y, z)
        width: 1 to 8 voxels. iterations: how often; width·iterations is at most 8 for "gaussian",
        and at most 32 for "mean" and "median".
        box: (least corner, greatest corner), or sphere: (centre, radius), in the frame's unit: the
        voxels to replace, without falloff. Neither: all voxels. Beyond the volume, voxels count as
        the least value of its range.
        progress: called with the current step and the share done, 0 to 1. If it raises an
        exception, the filter is cancelled and fails with that exception. If it returns False, the
        filter is cancelled and fails with Cancelled.
        expected_revision: of the volume when the filter begins.

        Other clients can edit meanwhile; their edits are filtered, too. If they edit during a
        filter of the whole volume, that filter begins again, at most three times. "resample", and
        an "offset" that needs room, change the volume's lattice: read its size again.
        Errors: as all edits; also Conflict if another filter runs, or another volume is loaded
        meanwhile.
        """
        if kind not in _FILTER_KINDS:
            raise InvalidArgument(f"kind is one of {', '.join(_FILTER_KINDS)}, not {kind!r}")
        if (distance_mm is None) == (kind == "offset"):
            raise InvalidArgument('distance_mm is for the kind "offset", which needs it')
        if (spacing_mm is None) == (kind == "resample"):
            raise InvalidArgument('spacing_mm is for the kind "resample", which needs it')
        if frame not in _FRAMES:
            raise InvalidArgument(f"frame is one of {', '.join(_FRAMES)}, not {frame!r}")
        if box is not None and sphere is not None:
            raise InvalidArgument("give a box or a sphere, not both")
        request = edit_pb2.FilterVolumeRequest(
            kind=_FILTER_KINDS[kind], width=_count("width", width),
            iterations=_count("iterations", iterations), expected_revision=expected_revision)
        if distance_mm is not None:
            request.distance_mm = number("distance_mm", distance_mm)
        if spacing_mm is not None:
            spacing = (spacing_mm,) * 3 if isinstance(spacing_mm, (int, float)) else spacing_mm
            request.spacing_mm.CopyFrom(vector_of("spacing_mm", spacing))
        if box is not None:
            corner_min, corner_max = box
            request.box.CopyFrom(edit_pb2.BoxShape(min=vector_of("box[0]", corner_min),
                                                   max=vector_of("box[1]", corner_max)))
        if sphere is not None:
            center, radius = sphere
            request.sphere.CopyFrom(edit_pb2.SphereShape(center=vector_of("sphere[0]", center),
                                                         radius=number("sphere[1]", radius)))
        if box is not None or sphere is not None:
            request.frame = _FRAMES[frame]
        events = self._link.events(self._stub.FilterVolume, request)
        return _edit_result(result_of(events, progress))

    def undo(self, expected_revision: int | None = None) -> EditResult:
        """Undoes the last edit of any client. Conflict if there is none."""
        return self._result(self._stub.UndoEdit,
                            edit_pb2.UndoEditRequest(expected_revision=expected_revision))

    def redo(self, expected_revision: int | None = None) -> EditResult:
        """Redoes the edit that was undone last. Conflict if there is none."""
        return self._result(self._stub.RedoEdit,
                            edit_pb2.RedoEditRequest(expected_revision=expected_revision))

    def revert(self, expected_revision: int | None = None) -> EditResult:
        """Undoes all edits since the volume was loaded, as one edit."""
        return self._result(self._stub.RevertVolume,
                            edit_pb2.RevertVolumeRequest(expected_revision=expected_revision))

    def _edit(self, request: edit_pb2.EditVolumeRequest, operation: Operation,
              value: float | None, frame: Frame, falloff: float, strength: float | None,
              expected_revision: int | None) -> EditResult:
        if operation not in _OPERATIONS:
            raise InvalidArgument(f"operation is one of {', '.join(_OPERATIONS)}, not "
                                  f"{operation!r}")
        if frame not in _FRAMES:
            raise InvalidArgument(f"frame is one of {', '.join(_FRAMES)}, not {frame!r}")
        needs_value = operation != "smooth" and not request.HasField("block")
        if needs_value and value is None:
            raise InvalidArgument(f"value is required for {operation!r}")
        if value is not None and not needs_value:
            raise InvalidArgument("value is not for 'smooth'")
        request.MergeFrom(edit_pb2.EditVolumeRequest(
            operation=_OPERATIONS[operation], value=number_or_none("value", value),
            frame=_FRAMES[frame], falloff=number("falloff", falloff),
            strength=number_or_none("strength", strength), expected_revision=expected_revision))
        return self._result(self._stub.EditVolume, request)

    def _result(self, method: typing.Any, request: typing.Any) -> EditResult:
        return _edit_result(self._link.call(method, request))


def _count(name: str, value: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise InvalidArgument(f"{name} is a whole number, not {value!r}")
    # palpated checks the bounds; its error names them.
    return max(0, min(value, _MOST_FILTER_NUMBER))


def _edit_result(answer: edit_pb2.EditVolumeResponse) -> EditResult:
    changed = None
    if answer.HasField("changed"):
        box = answer.changed
        changed = (slice(box.min_x, box.max_x + 1), slice(box.min_y, box.max_y + 1),
                   slice(box.min_z, box.max_z + 1))
    return EditResult(answer.volume_revision, answer.applied_tick, answer.changed_voxels,
                      changed, answer.undo_steps, answer.redo_steps)
