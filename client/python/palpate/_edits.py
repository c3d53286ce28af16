"""Changes of the volume's voxels."""

import collections.abc
import dataclasses
import typing

import numpy as np
import numpy.typing as npt

from palpate._enums import (EditFrame, EditFrameWord, EditOperation, EditOperationWord, FilterKind,
                            FilterKindWord)
from palpate._errors import InvalidArgument, TooLarge
from palpate._geometry import Triple, numbers_of, vector_of
from palpate._link import Link
from palpate._progress import Progress, result_of
from palpate._values import number, number_or_none, whole, whole_or_none
from palpate._word import numbers_by_word
from palpate.v1 import edit_pb2, volume_pb2_grpc

_OPERATIONS, _FRAMES, _FILTER_KINDS = map(numbers_by_word, (EditOperation, EditFrame, FilterKind))
_MOST_FILTER_NUMBER = 1000  # more than palpated takes
_MOST_INDEX = (1 << 31) - 1
_MOST_BLOCK_VOXELS = 3 * 1024 * 1024 // 4


@dataclasses.dataclass(frozen=True)
class EditResult:
    """The result of an edit.

    volume_revision: of the volume now; the same as before if no voxel changed
    applied_tick: first tick that used the edit
    changed_voxels: how many voxels have another value than before
    changed: box around the changed voxels, as an index into Volume.values; None: no voxel
        changed
    undo_steps: how often undo() would work now
    redo_steps: how often redo() would work now
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

    Arguments that several edits have:

    operation: one of these words.
    value: in data units, for all operations except "smooth". Results stay within the range of the
        file's type (uint8: 0 to 255), or within the volume's range if it holds floats.
    frame: "world": positions and lengths in mm of the world; "index": in voxels, the first is
        (0, 0, 0).
    falloff: in the frame's unit.
    strength: above 0 to 1, for "smooth" and "paint"; None: 1.
    expected_revision: fail with Conflict unless the volume is at this revision.
    progress: called for more than 16 777 216 voxels only, with the current step and the share
        done, 0 to 1. If it raises an exception or returns False, the edit is cancelled.

    Errors: InvalidArgument, TooLarge (no memory for the change), Conflict (another revision, or
    a recording is replayed), Cancelled, Unavailable.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stub = link.stub(volume_pb2_grpc.VolumeServiceStub)

    def sphere(self, center: Triple, radius: float, operation: EditOperationWord,
               value: float | None = None, *, frame: EditFrameWord = "world", falloff: float = 0.0,
               strength: float | None = None, expected_revision: int | None = None,
               progress: Progress | None = None) -> EditResult:
        """Edits a sphere. Returns when the servo has used the edit.

        center: (x, y, z). radius: above 0. Both in mm, or in voxels with frame="index".
        operation, value, falloff, strength, expected_revision, progress, errors: see
        help(palpate.Edits).
        Example, a hole of 3 mm: conn.edit.sphere((10, -4, 52), 3.0, "set", -1000)
        """
        shape = edit_pb2.SphereShape(center=vector_of("center", center),
                                     radius=number("radius", radius))
        return self._edit(edit_pb2.EditVolumeRequest(sphere=shape), operation, value, frame,
                          falloff, strength, expected_revision, progress)

    def box(self, corner_min: Triple, corner_max: Triple, operation: EditOperationWord,
            value: float | None = None, *, frame: EditFrameWord = "world", falloff: float = 0.0,
            strength: float | None = None, expected_revision: int | None = None,
            progress: Progress | None = None) -> EditResult:
        """Edits a box along the frame's axes. Returns when the servo has used the edit.

        corner_min, corner_max: (x, y, z), both included, in mm, or in voxels with frame="index".
        Others, and errors: see help(palpate.Edits).
        Example: conn.edit.box((0, 0, 0), (31, 31, 31), "smooth", frame="index")
        """
        shape = edit_pb2.BoxShape(min=vector_of("corner_min", corner_min),
                                  max=vector_of("corner_max", corner_max))
        return self._edit(edit_pb2.EditVolumeRequest(box=shape), operation, value, frame, falloff,
                          strength, expected_revision, progress)

    def capsule(self, start: Triple, end: Triple, radius: float, operation: EditOperationWord,
                value: float | None = None, *, frame: EditFrameWord = "world", falloff: float = 0.0,
                strength: float | None = None, expected_revision: int | None = None,
                progress: Progress | None = None) -> EditResult:
        """Edits a stroke: what a sphere sweeps. Returns when the servo has used the edit.

        start, end: (x, y, z) of the sphere's centre. radius: above 0. In mm, or in voxels with
        frame="index". Others, and errors: see help(palpate.Edits).
        Example: conn.edit.capsule((0, 0, 40), (0, 0, 60), 1.5, "paint", 700, strength=0.5)
        """
        shape = edit_pb2.CapsuleShape(**{"from": vector_of("start", start)},
                                      to=vector_of("end", end), radius=number("radius", radius))
        return self._edit(edit_pb2.EditVolumeRequest(capsule=shape), operation, value, frame,
                          falloff, strength, expected_revision, progress)

    def block(self, first: tuple[int, int, int], values: npt.ArrayLike,
              operation: EditOperationWord = "set", *, strength: float | None = None,
              expected_revision: int | None = None) -> EditResult:
        """Edits a block of voxels from index `first` (i, j, k) on, each with a value of its own.

        values: (nx, ny, nz), indexed [x, y, z] as Volume.values, data units. Sent as float32; at
        most 786 432 values (3 MiB). operation: not "smooth".
        strength, expected_revision, errors: see help(palpate.Edits).
        Example: conn.edit.block((20, 10, 30), np.zeros((4, 4, 4)))
        """
        array = numbers_of("values", values).astype("<f4")
        if array.ndim != 3:
            raise InvalidArgument(f"a block has three dimensions, not {array.ndim}")
        if array.size > _MOST_BLOCK_VOXELS:
            raise TooLarge(f"a block has at most {_MOST_BLOCK_VOXELS} voxels, this one has "
                           f"{array.size}: send it in parts")
        i, j, k = _parts("first", first, 3, "(i, j, k)")
        shape = edit_pb2.DenseBlock(
            min_x=whole("first[0]", i, 0, _MOST_INDEX), min_y=whole("first[1]", j, 0, _MOST_INDEX),
            min_z=whole("first[2]", k, 0, _MOST_INDEX), size_x=array.shape[0],
            size_y=array.shape[1], size_z=array.shape[2], values=array.tobytes(order="F"))
        return self._edit(edit_pb2.EditVolumeRequest(block=shape), operation, None, "index", 0.0,
                          strength, expected_revision)

    def filter(self, kind: FilterKindWord, width: int = 1, iterations: int = 1, *,
               distance_mm: float | None = None, spacing_mm: float | Triple | None = None,
               box: tuple[Triple, Triple] | None = None,
               sphere: tuple[Triple, float] | None = None, frame: EditFrameWord = "world",
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
        distance_mm: only for "offset", mm; negative: inwards. spacing_mm: only for "resample", mm.
        box: (least corner, greatest corner), or sphere: (centre, radius), in the frame's unit: the
        voxels to replace, without falloff. Neither: all voxels. frame: see help(palpate.Edits).
        Beyond the volume, voxels count as
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
        Example: conn.edit.filter("median", 2, sphere=((10, -4, 52), 15.0))
        """
        _check_word("kind", kind, _FILTER_KINDS)
        if (distance_mm is None) == (kind == "offset"):
            raise InvalidArgument('distance_mm is for the kind "offset", which needs it')
        if (spacing_mm is None) == (kind == "resample"):
            raise InvalidArgument('spacing_mm is for the kind "resample", which needs it')
        _check_word("frame", frame, _FRAMES)
        if box is not None and sphere is not None:
            raise InvalidArgument("give a box or a sphere, not both")
        request = edit_pb2.FilterVolumeRequest(
            kind=_FILTER_KINDS[kind], width=_count("width", width),
            iterations=_count("iterations", iterations),
            expected_revision=whole_or_none("expected_revision", expected_revision))
        if distance_mm is not None:
            request.distance_mm = number("distance_mm", distance_mm)
        if spacing_mm is not None:
            spacing = (number("spacing_mm", spacing_mm),) * 3 if np.isscalar(spacing_mm) \
                else typing.cast(Triple, spacing_mm)
            request.spacing_mm.CopyFrom(vector_of("spacing_mm", spacing))
        if box is not None:
            corner_min, corner_max = _parts("box", box, 2, "(least corner, greatest corner)")
            request.box.CopyFrom(edit_pb2.BoxShape(min=vector_of("box[0]", corner_min),
                                                   max=vector_of("box[1]", corner_max)))
        if sphere is not None:
            center, radius = _parts("sphere", sphere, 2, "(centre, radius)")
            request.sphere.CopyFrom(edit_pb2.SphereShape(center=vector_of("sphere[0]", center),
                                                         radius=number("sphere[1]", radius)))
        if box is not None or sphere is not None:
            request.frame = _FRAMES[frame]
        events = self._link.events(self._stub.FilterVolume, request)
        return _edit_result(result_of(events, progress))

    def undo(self, expected_revision: int | None = None) -> EditResult:
        """Undoes the last edit of any client. Returns when the servo has used the change.

        expected_revision: see help(palpate.Edits).
        Errors: Conflict (there is none, or another revision), Unavailable.
        Example: conn.edit.undo()
        """
        return self._result(self._stub.UndoEdit, edit_pb2.UndoEditRequest(
            expected_revision=whole_or_none("expected_revision", expected_revision)))

    def redo(self, expected_revision: int | None = None) -> EditResult:
        """Redoes the edit that was undone last. Arguments and errors: as undo().

        expected_revision: see help(palpate.Edits). Example: conn.edit.redo()
        """
        return self._result(self._stub.RedoEdit, edit_pb2.RedoEditRequest(
            expected_revision=whole_or_none("expected_revision", expected_revision)))

    def revert(self, expected_revision: int | None = None) -> EditResult:
        """Undoes all edits since the volume was loaded, as one edit that undo() can undo.

        expected_revision, errors: see help(palpate.Edits). Example: conn.edit.revert()
        """
        return self._result(self._stub.RevertVolume, edit_pb2.RevertVolumeRequest(
            expected_revision=whole_or_none("expected_revision", expected_revision)))

    def _edit(self, request: edit_pb2.EditVolumeRequest, operation: EditOperationWord,
              value: float | None, frame: EditFrameWord, falloff: float, strength: float | None,
              expected_revision: int | None, progress: Progress | None = None) -> EditResult:
        _check_word("operation", operation, _OPERATIONS)
        _check_word("frame", frame, _FRAMES)
        needs_value = operation != "smooth" and not request.HasField("block")
        if needs_value and value is None:
            raise InvalidArgument(f"value is required for {operation!r}")
        if value is not None and not needs_value:
            raise InvalidArgument("value is not for 'smooth'")
        request.MergeFrom(edit_pb2.EditVolumeRequest(
            operation=_OPERATIONS[operation], value=number_or_none("value", value),
            frame=_FRAMES[frame], falloff=number("falloff", falloff),
            strength=number_or_none("strength", strength),
            expected_revision=whole_or_none("expected_revision", expected_revision)))
        try:
            return self._result(self._stub.EditVolume, request)
        except TooLarge:
            if request.HasField("block"):
                raise
        events = self._link.events(self._stub.FilterVolume,
                                   edit_pb2.FilterVolumeRequest(edit=request))
        return _edit_result(result_of(events, progress))

    def _result(self, method: typing.Any, request: typing.Any) -> EditResult:
        return _edit_result(self._link.call(method, request))


def _count(name: str, value: int) -> int:
    # palpated checks the greatest; its error names it.
    return min(whole(name, value, 1), _MOST_FILTER_NUMBER)


def _check_word(name: str, value: typing.Any, words: collections.abc.Iterable[str]) -> None:
    if not isinstance(value, str) or value not in words:
        raise InvalidArgument(f"{name} is one of {', '.join(words)}, not {value!r}")


def _parts(name: str, value: typing.Any, count: int, parts: str) -> typing.Any:
    if not isinstance(value, (tuple, list, np.ndarray)) or len(value) != count:
        raise InvalidArgument(f"{name} is {parts}, not {value!r}")
    return value


def _edit_result(answer: edit_pb2.EditVolumeResponse) -> EditResult:
    changed = None
    if answer.HasField("changed"):
        box = answer.changed
        changed = (slice(box.min_x, box.max_x + 1), slice(box.min_y, box.max_y + 1),
                   slice(box.min_z, box.max_z + 1))
    return EditResult(answer.volume_revision, answer.applied_tick, answer.changed_voxels,
                      changed, answer.undo_steps, answer.redo_steps)
