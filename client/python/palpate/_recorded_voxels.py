"""The voxels of a recording: the loaded volume with the recorded edits."""

import collections.abc
import dataclasses
import math
import struct

import numpy as np
import numpy.typing as npt
import xxhash

from palpate._errors import InvalidArgument
from palpate._recorded_events import RecordedEdit, RecordedScene
from palpate._recording_frame import Damaged
from palpate._volume_copy import VolumeCopy
from palpate.v1 import volume_stream_pb2

# 64 MiB of voxels.
_MOST_STORED_BRICKS = 1 << 15


@dataclasses.dataclass(frozen=True)
class Step:
    """A scene, and the edits that lead to its volume."""

    scene: RecordedScene
    edits: tuple[RecordedEdit, ...]


@dataclasses.dataclass(frozen=True)
class Voxels:
    values: npt.NDArray[np.float32]
    volume_hash: int


def voxels_of(steps: collections.abc.Sequence[Step], loaded: npt.ArrayLike | None) -> Voxels | None:
    """Returns the voxels of the last scene; None: `loaded` is needed.

    All scenes must be of one volume. Works as server/recording/volume_follower.cpp. Errors:
    Damaged, InvalidArgument.
    """
    copy: VolumeCopy | None = None
    last = steps[-1].scene
    if last.shape is None:
        return None
    base_revision = last.loaded_revision
    if loaded is not None:
        values = _fitting(loaded, last)
        copy = _empty(last)
        copy.fill(values)
    for step in steps:
        scene = step.scene
        if scene.shape != last.shape:
            raise Damaged("damaged: it is of another volume")
        if scene.all_voxels_stored and step.edits:
            # These edits have all voxels.
            if _brick_count(last.shape) > _MOST_STORED_BRICKS:
                raise Damaged("damaged: of a volume that no recording holds")
            copy, base_revision = _empty(last), 0
        if not step.edits or copy is None:
            continue
        leads_on = (step.edits[0].base_revision == base_revision
                    and step.edits[0].volume_revision == scene.volume_revision)
        if leads_on and not scene.voxels_missing:
            for edit in step.edits:
                _put(copy, edit)
        base_revision = step.edits[0].volume_revision
    return None if copy is None else Voxels(np.array(copy.view(), order="C"),
                                            _hash_of(copy, last))


def _brick_count(shape: tuple[int, int, int]) -> int:
    return math.prod(-(-size // 8) for size in shape)


def _empty(scene: RecordedScene) -> VolumeCopy:
    """Makes a volume without its voxels. Errors: Damaged."""
    if scene.shape is None or min(scene.shape) < 2 or scene.value_min is None:
        raise Damaged("damaged: of a volume that cannot be")
    x, y, z = scene.shape
    background = scene.value_max if scene.is_level_set else scene.value_min
    return VolumeCopy(volume_stream_pb2.VolumeLattice(size_x=x, size_y=y, size_z=z,
                                                      background=background))


def _fitting(loaded: npt.ArrayLike, scene: RecordedScene) -> npt.NDArray[np.float32]:
    values = np.asarray(loaded, dtype=np.float32)
    if values.shape != scene.shape:
        raise InvalidArgument(f"the recorded volume has the shape {scene.shape}, `loaded` has "
                              f"{values.shape}")
    return values


def _put(copy: VolumeCopy, edit: RecordedEdit) -> None:
    voxels = edit.voxels()
    if edit.brick_numbers[-1] >= copy.brick_count or not np.isfinite(voxels).all():
        raise Damaged("damaged: it does not fit the volume")
    copy.put((edit.brick_numbers, voxels))


def _hash_of(copy: VolumeCopy, scene: RecordedScene) -> int:
    """Computes the hash of server/recording/volume_hash.cpp."""
    lattice = copy.lattice
    data = struct.pack("<3i3d2d", lattice.size_x, lattice.size_y, lattice.size_z,
                       *scene.spacing_mm, scene.value_min, scene.value_max)
    if scene.is_level_set:
        data += b"\1"
    return int(xxhash.xxh3_128_intdigest(data + struct.pack("<2Q", *copy.content_hash())))
