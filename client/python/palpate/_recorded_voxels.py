"""The voxels of a recording: the loaded volume with the recorded edits."""

import collections.abc
import dataclasses
import math
import struct

import numpy as np
import numpy.typing as npt
import xxhash

from palpate._brick_hash import hash_of_bricks
from palpate._errors import InvalidArgument, TooLarge
from palpate._recorded_events import MOST_BRICKS, RecordedEdit, RecordedScene
from palpate._mcap import Damaged

# 8 GiB.
_MOST_VOXELS = 1 << 31
_EDGE = 8


@dataclasses.dataclass(frozen=True)
class Step:
    """A scene, and the edits that lead to its volume."""

    scene: RecordedScene
    edits: tuple[RecordedEdit, ...]


@dataclasses.dataclass(frozen=True)
class Voxels:
    values: npt.NDArray[np.float32]
    volume_hash: int


class _Copy:
    """All voxels of a volume as float32: recorded edits have no other type. Errors: Damaged,
    TooLarge."""

    def __init__(self, scene: RecordedScene) -> None:
        if min(scene.shape) < 2:
            raise Damaged("damaged: of a volume that cannot be")
        background = scene.value_max if scene.is_level_set else scene.value_min
        a, b, c = counts = [-(-size // _EDGE) for size in scene.shape]
        self.brick_count = math.prod(counts)
        if self.brick_count * _EDGE**3 > _MOST_VOXELS:
            raise TooLarge("the recorded volume has more than 2^31 voxels")
        voxels = np.full((a * _EDGE, b * _EDGE, c * _EDGE), background, np.float32)
        self.values = voxels[tuple(map(slice, scene.shape))]
        # Axes: the place of the brick, then the place of the voxel in the brick.
        self._bricks = voxels.reshape(a, _EDGE, b, _EDGE, c, _EDGE).transpose(0, 2, 4, 1, 3, 5)

    def put(self, edit: RecordedEdit) -> None:
        numbers, voxels = edit.brick_numbers, edit.voxels()
        if numbers.max() >= self.brick_count or not np.isfinite(voxels).all():
            raise Damaged("damaged: it does not fit the volume")
        self._bricks[np.unravel_index(numbers, self._bricks.shape[:3])] = voxels

    def content_hash(self) -> tuple[int, int]:
        """As in VolumeComplete."""
        numbers = np.arange(math.prod(self._bricks.shape[1:3]))
        halves = np.zeros(2, np.uint64)
        for layer in self._bricks:
            halves += hash_of_bricks(numbers, layer.reshape(-1, _EDGE**3))
            numbers += len(numbers)
        return int(halves[0]), int(halves[1])


def voxels_of(steps: collections.abc.Sequence[Step], loaded: npt.ArrayLike | None) -> Voxels | None:
    """Returns the voxels of the last scene; None: `loaded` is needed.

    All scenes must be of one volume. Works as server/recording/recorded_scenes.cpp. Errors:
    Damaged, InvalidArgument.
    """
    copy: _Copy | None = None
    last = steps[-1].scene
    if loaded is not None:
        values = _fitting(loaded, last)
        copy = _Copy(last)
        copy.values[:] = values
    for step in _way_to_last(steps):
        scene = step.scene
        if scene.shape != last.shape:
            raise Damaged("damaged: it is of another volume")
        if scene.all_voxels_stored and step.edits:
            # These edits have all voxels.
            if _brick_count(last.shape) > MOST_BRICKS:
                raise Damaged("damaged: of a volume that no recording holds")
            copy = _Copy(last)
        if copy is not None and not scene.voxels_missing:
            for edit in step.edits:
                copy.put(edit)
    return None if copy is None else Voxels(np.array(copy.values, order="C"),
                                            _hash_of(copy, last))


def _way_to_last(steps: collections.abc.Sequence[Step]) -> list[Step]:
    """The steps that lead to the last scene's volume. A frame that comes again has the volume of the
    scene where it came first: the way leads there at once. Errors: Damaged."""
    first: dict[int, int] = {}
    for n, step in enumerate(steps):
        first.setdefault(step.scene.volume_hash, n)
    way, n = [], len(steps) - 1
    while n >= 0:
        step = steps[n]
        if any(edit.is_known for edit in step.edits):
            if first[step.scene.volume_hash] == n:
                raise Damaged("damaged: a frame of the series is missing")
            n = first[step.scene.volume_hash]
        else:
            way.append(step)
            # Edits of all voxels need none before them.
            n = -1 if step.scene.all_voxels_stored and step.edits else n - 1
    return way[::-1]


def _brick_count(shape: tuple[int, int, int]) -> int:
    return math.prod(-(-size // 8) for size in shape)


def _fitting(loaded: npt.ArrayLike, scene: RecordedScene) -> npt.NDArray[np.float32]:
    values = np.asarray(loaded, dtype=np.float32)
    if values.shape != scene.shape:
        raise InvalidArgument(f"the recorded volume has the shape {scene.shape}, `loaded` has "
                              f"{values.shape}")
    return values


def _hash_of(copy: _Copy, scene: RecordedScene) -> int:
    """Computes the hash of server/recording/recording.cpp."""
    data = struct.pack("<3i3d2d", *copy.values.shape, *scene.spacing_mm, scene.value_min,
                       scene.value_max)
    if scene.is_level_set:
        data += b"\1"
    return int(xxhash.xxh3_128_intdigest(data + struct.pack("<2Q", *copy.content_hash())))
