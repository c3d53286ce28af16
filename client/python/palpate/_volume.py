"""The volume under the stylus: its description, load, upload and download."""

import dataclasses
import os
import pathlib

import numpy as np
import numpy.typing as npt

from palpate._errors import InvalidArgument, NotFound, PermissionDenied
from palpate._follow import LiveVolume
from palpate._geometry import (Quadruple, Triple, array_of_vector, matrix_of_map, numbers_of,
                               three)
from palpate._held import held_in
from palpate._html import numbers, table
from palpate._link import Link
from palpate._load_options import Changes, Raw, load_options
from palpate._nrrd import nrrd_of
from palpate._placement import Placement, Turn, place, update_of
from palpate._progress import Progress, result_of
from palpate._upload import send_volume
from palpate._value_list import SuggestedIsovalue
from palpate._values import path_text, switch, text_of
from palpate._volume_copy import fetch_volume
from palpate._voxels import Volume
from palpate.v1 import volume_pb2, volume_pb2_grpc


@dataclasses.dataclass(frozen=True, eq=False)
class VolumeInfo:
    """The volume under the stylus, without its voxels.

    source: path, builtin name or "upload:NAME" from which it was loaded
    volume_revision: rises with each change of the voxels; Poses.volume_revision has the same
        numbers
    loaded_revision: revision of the load; later revisions are edits and frames
    shape: voxels along x, y, z
    spacing_mm: (3,) along x, y, z, mm
    value_min: least value at load, data units
    value_max: greatest value at load, data units
    unit: of the values, as the file states it, such as "HU"; may be empty
    original_type: scalar type of the file, such as "uint8"
    world_from_index: (4, 4) voxel index (x, y, z, 1) to world: mm; see patient_axes
    device_from_index: (4, 4) voxel index (x, y, z, 1) to the device frame: mm
    device_mm_per_volume_mm: millimetres of device motion per millimetre of the volume
    patient_axes: where +x, +y and +z of the world point in the patient: "LPS" if the file states
        an orientation, or what somebody answered (VolumeAccess.place), such as "RAS"; "": unknown
    patient_axes_answered: True if somebody answered them, False if the file states them
    memory_bytes: memory of the voxels on the daemon's machine, bytes
    frames: frames of the source file; this volume is one of them
    unsaved_edits: edits since the voxels were loaded or saved
    replayed: a recording is replayed: the voxels and the place are the recorded ones
    is_level_set: values are signed distances from a surface at 0, negative inside
    warnings: what the import assumed or left out, one line each, such as a spacing that the
        file does not state
    applied_tick: of a load or an upload: first tick that used the volume; Poses.tick has the same
        numbers. None: nothing was loaded
    """

    source: str
    volume_revision: int
    loaded_revision: int
    shape: tuple[int, int, int]
    spacing_mm: npt.NDArray[np.float64]
    value_min: float
    value_max: float
    unit: str
    original_type: str
    world_from_index: npt.NDArray[np.float64]
    device_from_index: npt.NDArray[np.float64]
    device_mm_per_volume_mm: float
    patient_axes: str
    patient_axes_answered: bool
    memory_bytes: int
    frames: int
    unsaved_edits: int
    replayed: bool
    is_level_set: bool
    warnings: tuple[str, ...]
    applied_tick: int | None = None

    def _repr_html_(self) -> str:
        return table("palpate volume", (
            ("source", self.source), ("voxels", numbers(self.shape)),
            ("spacing", numbers(self.spacing_mm) + " mm"),
            ("values", f"{self.value_min:g} to {self.value_max:g} {self.unit}".strip()),
            ("type", self.original_type), ("orientation", self.patient_axes or "unknown"),
            ("revision", self.volume_revision),
            ("1 mm of the volume", f"{self.device_mm_per_volume_mm:.6g} mm of the device"),
            *([("not saved", f"{self.unsaved_edits} edits")] if self.unsaved_edits else []),
            *([("shows", "a replay")] if self.replayed else []),
            *(("warning", warning) for warning in self.warnings)))


def info_of(volume: volume_pb2.VolumeDescription, applied_tick: int | None = None) -> VolumeInfo:
    return VolumeInfo(
        source=volume.source, volume_revision=volume.volume_revision,
        loaded_revision=volume.loaded_revision,
        shape=(volume.size_x, volume.size_y, volume.size_z),
        spacing_mm=array_of_vector(volume.spacing_mm), value_min=volume.value_min,
        value_max=volume.value_max, unit=volume.unit, original_type=volume.original_type,
        world_from_index=matrix_of_map(volume.world_from_index),
        device_from_index=matrix_of_map(volume.device_from_index),
        device_mm_per_volume_mm=volume.device_mm_per_volume_mm,
        patient_axes=volume.patient_axes, patient_axes_answered=volume.patient_axes_answered,
        memory_bytes=volume.memory_bytes, frames=volume.frames,
        unsaved_edits=volume.unsaved_edits, replayed=volume.replayed, is_level_set=volume.is_level_set,
        warnings=tuple(volume.warnings), applied_tick=applied_tick)


class VolumeAccess:
    """The volume under the stylus, the same for all clients; Connection.volume.

    Arrays are indexed [x, y, z]: the element [i, j, k] is the voxel (i, j, k) of world_from_index,
    of edits and of the file. In the file, x is the fastest axis. In NumPy's usual order, z is the
    fastest axis in memory. SimpleITK and pydicom return arrays indexed [z, y, x]: use their .T.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stub = link.stub(volume_pb2_grpc.VolumeServiceStub)

    def info(self) -> VolumeInfo:
        """Returns the description and the place of the volume, without voxels.

        Errors: Unavailable. Example: print(conn.volume.info().spacing_mm)
        """
        answer = self._link.call(self._stub.GetVolume, volume_pb2.GetVolumeRequest())
        return info_of(answer.volume)

    def suggested_isovalues(self) -> tuple[SuggestedIsovalue, ...]:
        """Returns isovalues that show something, the one that a load starts at first.

        Example: conn.settings.isovalue = conn.volume.suggested_isovalues()[0].isovalue
        They are of the volume as loaded: edits do not change them. Errors: Unavailable.
        """
        answer = self._link.call(self._stub.GetVolume, volume_pb2.GetVolumeRequest())
        return tuple(SuggestedIsovalue(**held_in(suggested))
                     for suggested in answer.volume.suggested_isovalues)

    def load(self, source: str | os.PathLike[str], *, isovalue: float | None = None,
             normalized_isovalue: float | None = None, spacing_mm: Triple | None = None,
             device_mm_per_volume_mm: float | None = None, frame: int | None = None,
             grid: str = "", component: str = "", raw: Raw | None = None,
             discard_edits: bool = False, settings: Changes | None = None,
             progress: Progress | None = None) -> VolumeInfo:
        """Replaces the volume by a file of the daemon's machine. Returns when the servo uses it.

        source: path of a file or DICOM folder there, or "builtin:NAME[:N]". Over a socket, a
        relative path is taken from this program's current folder; over TCP it is refused.
        isovalue: the first isovalue, in data units; or normalized_isovalue, 0 to 1 over the new
        range. Neither: the first of suggested_isovalues().
        spacing_mm: (x, y, z) instead of the file's.
        device_mm_per_volume_mm: scale instead of the fitted one.
        frame: for a file with several frames; 0 is the first.
        grid: for a .vdb file with several grids, the name.
        component: for a grid of vectors: "magnitude", "x", "y" or "z".
        raw: for a file that holds only voxels.
        discard_edits: drop edits of the present volume that are not saved.
        settings: changed at the same tick, by name, as Settings.update takes them. If one is
        refused, the volume is not replaced.
        progress: called with the current step, such as "reading", and the share done, 0 to 1. If
        it raises an exception, the load is cancelled and fails with that exception. If it returns
        False, the load is cancelled and fails with Cancelled.
        Errors: InvalidArgument (not a volume), NotFound, PermissionDenied (a folder that the
        daemon does not load from), TooLarge, Conflict (another load runs), FailedPrecondition
        (edits are not saved, and discard_edits is not set), Cancelled, AttributeError (no such
        setting), Unavailable.
        Example: conn.volume.load("/data/head.nrrd", isovalue=300).applied_tick
        """
        request = load_options(isovalue, normalized_isovalue, device_mm_per_volume_mm, spacing_mm,
                               frame, grid, component, raw, discard_edits, settings)
        text = path_text(source)
        request.source = text if text.startswith("builtin:") else self._link.path(text)
        events = self._link.events(self._stub.LoadVolume, request)
        result = result_of(events, progress)
        return info_of(result.volume, result.applied_tick)

    def upload(self, values: npt.ArrayLike, spacing_mm: Triple = (1.0, 1.0, 1.0), *,
               world_from_index: npt.ArrayLike | None = None, patient_axes: str = "",
               unit: str = "",
               name: str = "array", isovalue: float | None = None,
               normalized_isovalue: float | None = None,
               device_mm_per_volume_mm: float | None = None, discard_edits: bool = False,
               settings: Changes | None = None, progress: Progress | None = None) -> VolumeInfo:
        """Replaces the volume by an array. Returns when the servo uses it.

        values: (nx, ny, nz), indexed [x, y, z], data units; integers of at most 32 bits, or
        floats. spacing_mm: along x, y, z. world_from_index: (4, 4), voxel index to world, mm,
        with axes at right angles. It includes the spacing, so spacing_mm is then ignored.
        patient_axes: "LPS" if that world is the patient's LPS; "": the array does not say it.
        unit: of the values, such as "HU". name: VolumeInfo.source is then "upload:NAME.nrrd".
        Other arguments and errors: as load().
        Example: conn.volume.upload(values, (0.5, 0.5, 1.0), unit="HU")
        """
        if world_from_index is None:
            matrix = np.diag([*three("spacing_mm", spacing_mm), 1.0])
        else:
            matrix = numbers_of("world_from_index", world_from_index)
        if matrix.shape != (4, 4):
            raise InvalidArgument("world_from_index is a 4 by 4 matrix")
        header, voxels = nrrd_of(values, matrix, text_of("unit", unit),
                                 is_lps=self._is_lps(patient_axes, world_from_index))
        options = load_options(isovalue, normalized_isovalue, device_mm_per_volume_mm,
                               discard_edits=discard_edits, settings=settings)
        answer = send_volume(self._link, self._stub, f"{name}.nrrd", [header, voxels], options,
                             progress)
        return info_of(answer.volume, answer.applied_tick)

    @staticmethod
    def _is_lps(patient_axes: str, world_from_index: npt.ArrayLike | None) -> bool:
        if patient_axes not in ("", "LPS") or patient_axes and world_from_index is None:
            raise InvalidArgument("patient_axes is \"LPS\", with world_from_index, or empty")
        return patient_axes == "LPS"

    def upload_file(self, path: str | os.PathLike[str], *, isovalue: float | None = None,
                    normalized_isovalue: float | None = None, spacing_mm: Triple | None = None,
                    device_mm_per_volume_mm: float | None = None, frame: int | None = None,
                    grid: str = "", component: str = "", raw: Raw | None = None,
                    discard_edits: bool = False, settings: Changes | None = None,
                    progress: Progress | None = None) -> VolumeInfo:
        """Replaces the volume by a file of this program's machine. Returns when the servo uses it.

        path: a file of any one-file format of load(), or a folder of DICOM or TIFF files. It is
        read into memory as a whole. Other arguments and errors: as load().
        Example: conn.volume.upload_file("head.nrrd")
        """
        options = load_options(isovalue, normalized_isovalue, device_mm_per_volume_mm, spacing_mm,
                               frame, grid, component, raw, discard_edits, settings)
        source = pathlib.Path(path_text(path))
        try:
            files = sorted(f for f in source.iterdir() if f.is_file()) if source.is_dir() else None
            parts = [file.read_bytes() for file in files or [source]]
        except FileNotFoundError:
            raise NotFound(f"there is no file {os.fspath(path)}") from None
        except PermissionError:
            raise PermissionDenied(f"the file {os.fspath(path)} may not be read") from None
        except OSError as failed:
            raise InvalidArgument(f"{os.fspath(path)} cannot be read: {failed.strerror}") from None
        answer = send_volume(self._link, self._stub, source.name or source.resolve().name, parts,
                             options, progress, [file.name for file in files] if files else None)
        return info_of(answer.volume, answer.applied_tick)

    def download(self, *, progress: Progress | None = None) -> Volume:
        """Returns a copy of the present volume, with its edits. Voxels are of the file's own type.

        progress: as in load().
        Errors: Internal (damaged during transfer), TooLarge (more than 2³⁶ voxels), Cancelled,
        Unavailable.
        Example: values = conn.volume.download().values
        """
        return fetch_volume(self._link, self._stub, progress)

    def follow(self) -> LiveVolume:
        """Returns a copy that follows the volume through edits, loads and moves.

        Returns at once; LiveVolume.wait() waits for the first copy. Errors: Unavailable (the
        connection was closed).
        Example: with conn.volume.follow() as live: print(live.snapshot().values.max())
        """
        return LiveVolume(self._link, self._stub)

    def place(self, *, reset: bool = False, center_mm: Triple | None = None,
              rotation_wxyz: Quadruple | None = None,
              device_mm_per_volume_mm: float | None = None,
              device_mm_per_voxel: float | None = None, cells_per_mm: float | None = None,
              move_mm: Triple | None = None, turn_deg: Turn | None = None,
              scale_by: float | None = None, face: str = "", head: str = "",
              expected_revision: int | None = None) -> Placement:
        """Moves the volume in the device's workspace, at one tick. Returns the placement.

        Without arguments it only returns the placement. Given values are applied in this order:
        reset, absolute, relative. The daemon stores the placement for this volume. All values are
        in the device's axes: mm, x right, y up, z towards the user.

        reset: into the middle of the workspace, fitted, without a rotation.
        Absolute:
            center_mm: (x, y, z) of the volume's centre.
            rotation_wxyz: unit quaternion (w, x, y, z) from the world's axes to the device's.
            One of the scales device_mm_per_volume_mm, device_mm_per_voxel (for its shortest edge)
            and cells_per_mm (the number of cells in 1 mm).
        Relative:
            move_mm: (x, y, z).
            turn_deg: an axis through the centre, and degrees, as in ("y", 90).
            scale_by: about the centre.
        Where the patient faces, for a file that states no orientation (patient_axes is empty):
            face, head: the directions of the world in which face and head point, both of "+x",
            "-x", "+y", "-y", "+z", "-z". Left and right follow if the file is not mirrored. The
            daemon keeps the answer for these voxels.
        expected_revision: fail with Conflict unless the settings are at this revision.
        Errors: InvalidArgument, FailedPrecondition (face and head of a file that states its
        orientation), Conflict (another revision, or a recording is replayed), Unavailable.
        Example: conn.volume.place(turn_deg=("y", 90), scale_by=1.5)
        """
        request = update_of(
            reset=reset, center_mm=center_mm, rotation_wxyz=rotation_wxyz,
            device_mm_per_volume_mm=device_mm_per_volume_mm,
            device_mm_per_voxel=device_mm_per_voxel, cells_per_mm=cells_per_mm, move_mm=move_mm,
            turn_deg=turn_deg, scale_by=scale_by, face=face, head=head)
        return place(self._link, request, expected_revision)

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False,
             progress: Progress | None = None) -> int:
        """Writes the present volume to a file of the daemon's machine. Returns its revision.

        path: absolute, or relative as in load(); ends in .nrrd or .vdb. overwrite: replace a file
        that exists. progress: as in load().
        Errors: InvalidArgument, PermissionDenied (a folder that the daemon does not save
        to), NotFound (no such folder), Conflict (the file exists), DiskFull, Cancelled,
        Unavailable.
        Example: conn.volume.save("/data/edited.nrrd", overwrite=True)
        """
        request = volume_pb2.SaveVolumeRequest(path=self._link.path(path),
                                               overwrite=switch("overwrite", overwrite))
        events = self._link.events(self._stub.SaveVolume, request)
        return int(result_of(events, progress).volume_revision)

