"""A volume with its voxels."""

import collections.abc
import dataclasses
import functools
import operator
import typing

import numpy as np
import numpy.typing as npt

from palpate._bricks import EDGE, Bricks
from palpate._errors import InvalidArgument
from palpate._html import MOST_PIXELS, numbers, picture_of, table
from palpate._openvdb import grid_of
from palpate._tables import package
from palpate._tiles import tiles_of

# The most that an axis along the world's may lean, in parts of the longest step.
_PARALLEL = 1e-6

Voxels = npt.NDArray[typing.Any]


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Volume:
    """A volume with its voxels, of one revision. It never changes.

    Voxels are of the file's own type: uint8, int16, uint16 or float32. If an edit has made voxels
    that this type does not hold, they are of the smallest of these types that holds all. Integers
    wrap: compute with values.astype(float).

    volume[x0:x1, y0:y1, z0:z1] is a part of it, as of an array, in memory of its own. Steps other
    than 1 are refused.

    A volume takes the memory of its bricks of 8³ voxels. Bricks with one value throughout take
    none, so a sparse volume may be larger than any array.

    shape: voxels along x, y, z
    dtype: of the voxels
    values: (nx, ny, nz), indexed [x, y, z], data units
    spacing_mm: (3,) along x, y, z, mm
    world_from_index: (4, 4) voxel index (x, y, z, 1) to world: mm
    device_from_index: (4, 4) voxel index (x, y, z, 1) to the device frame: mm
    value_min: least value at load, data units
    value_max: greatest value at load, data units
    background: value of all voxels that active_bricks() and tiles() do not name, data units
    unit: of the values, as the file states it; may be empty
    source: path, builtin name or "upload:NAME" from which it was loaded
    volume_revision: revision of this copy; VolumeInfo.volume_revision has the same numbers
    replayed: a recording was replayed: the voxels and the place are the recorded ones
    Example: conn.volume.download().values[10, 20, 30]
    Errors: TooLarge (an array of more than 2³¹ voxels), InvalidArgument (an index that is not as
    above), IndexError (beyond the volume).
    """

    spacing_mm: npt.NDArray[np.float64]
    world_from_index: npt.NDArray[np.float64]
    device_from_index: npt.NDArray[np.float64]
    value_min: float
    value_max: float
    unit: str
    source: str
    volume_revision: int
    replayed: bool
    _bricks: Bricks

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along x, y, z."""
        return self._bricks.size

    @property
    def dtype(self) -> np.dtype[typing.Any]:
        """Type of the voxels: uint8, int16, uint16 or float32."""
        return self._bricks.dtype

    @property
    def background(self) -> float:
        """Value of all voxels that active_bricks() and tiles() do not name, data units."""
        return float(self._bricks.background)

    @property
    def values(self) -> Voxels:
        """All voxels: (nx, ny, nz), indexed [x, y, z], data units, of the type `dtype`.

        Made when it is first asked for, and kept. It is yours: what you write there changes
        nothing else. Errors: TooLarge (more than 2³¹ voxels: take parts).
        """
        return self._dense

    @functools.cached_property
    def _dense(self) -> Voxels:
        return self._bricks.box((0, 0, 0), self.shape)

    def __getitem__(self, key: typing.Any) -> typing.Any:
        return part_of(self._bricks, key)

    def active_bricks(self) -> collections.abc.Iterator[tuple[npt.NDArray[np.int64], Voxels]]:
        """Yields all bricks that have not one value throughout, up to 4096 at a time.

        A batch is (corners, values). corners: (n, 3), the first voxel of each brick. values:
        (n, 8, 8, 8), of the type `dtype`; voxels beyond the volume are background. All other
        voxels are background, or in tiles(). Errors: none.
        Example: total = sum(values.sum(dtype=float) for _, values in volume.active_bricks())
        """
        for places, values in self._bricks.stored():
            yield self._bricks.corners(places), values.reshape(-1, EDGE, EDGE, EDGE)

    def tiles(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Voxels]:
        """Returns boxes of bricks with one value that is not background: (begins, ends, values).

        begins: (n, 3), the first voxel of each box. ends: (n, 3), the voxel after its last one.
        values: (n,). Neighbours with the same value are one box, where that is one. Errors: none.
        Example: for begin, end, value in zip(*volume.tiles()): print(begin, end, value)
        """
        boxes, values = tiles_of(self._bricks)
        return boxes[:, :3], boxes[:, 3:], values.astype(self.dtype)

    def to_openvdb(self) -> typing.Any:
        """Returns an openvdb.FloatGrid, with index and world coordinates as here.

        tiles() are its tiles. It is a level set if the volume is one. Voxels equal to the
        background are inactive. Of a level set, only the voxels of its band are active.
        Errors: FailedPrecondition (pyopenvdb is not installed).
        Example: pyopenvdb.write("head.vdb", conn.volume.download().to_openvdb())
        """
        is_level_set = self.background == np.float32(self.value_max) > np.float32(self.value_min)
        return grid_of(self._bricks, self.world_from_index, bool(is_level_set))

    def to_xarray(self) -> typing.Any:
        """Returns an xarray.DataArray along "x", "y" and "z", with coordinates in mm.

        The attribute "coordinates_frame" says of which frame the coordinates are:
        "world": mm of the world, if the volume's axes lie along those of the world. Where an axis
        is mirrored, its coordinates fall.
        "volume": from the first voxel along the volume's own axes, if the volume is oblique.
        The attribute "world_from_index" maps voxel indices to the world in both cases.
        Errors: FailedPrecondition (xarray is not installed), TooLarge (more than 2³¹ voxels).
        Example: conn.volume.download().to_xarray().sel(z=40, method="nearest")
        """
        axes = ("x", "y", "z")
        linear = self.world_from_index[:3, :3]
        steps_mm = np.diag(linear)
        first_mm = self.world_from_index[:3, 3]
        along_world = np.abs(linear - np.diag(steps_mm)).max() <= _PARALLEL * np.abs(linear).max()
        if not along_world:
            steps_mm, first_mm = self.spacing_mm, np.zeros(3)
        coordinates = {
            axis: (axis, first_mm[n] + np.arange(self.shape[n]) * steps_mm[n], {"units": "mm"})
            for n, axis in enumerate(axes)}
        attributes = {"units": self.unit, "source": self.source,
                      "coordinates_frame": "world" if along_world else "volume",
                      "volume_revision": self.volume_revision,
                      "world_from_index": self.world_from_index,
                      "device_from_index": self.device_from_index}
        return package("xarray").DataArray(self.values, coordinates, axes, attrs=attributes)

    def __repr__(self) -> str:
        # Without the arrays, which would fill the screen.
        return (f"<palpate volume: {self.source}, {numbers(self.shape)} voxels of {self.dtype}, "
                f"revision {self.volume_revision}>")

    def _repr_html_(self) -> str:
        x, y, z = self.shape
        extent_mm = np.array((x, y)) * self.spacing_mm[:2]
        # Line by line: a whole slice may be too large for memory.
        step = max(1, -(-max(x, y) // MOST_PIXELS))
        lines = [self[n, :, z // 2][::step] for n in range(0, x, step)]
        picture = picture_of(np.stack(lines), self.value_min, self.value_max,
                             (float(extent_mm[0]), float(extent_mm[1])),
                             f"slice {z // 2} of {z} along z: x to the right, y down")
        return table("palpate volume", (
            ("source", self.source), ("voxels", numbers(self.shape)), ("type", self.dtype),
            ("spacing", numbers(self.spacing_mm) + " mm"),
            ("values", f"{self.value_min:g} to {self.value_max:g} {self.unit}".strip()),
            ("revision", self.volume_revision)), picture)


def part_of(bricks: Bricks, key: typing.Any) -> typing.Any:
    """Returns what an array of all voxels has at `key`: integers, and slices of steps of 1."""
    keys = key if isinstance(key, tuple) else (key,)
    if len(keys) > 3:
        raise InvalidArgument(f"a volume has three axes, not {len(keys)}")
    keys = (*keys, slice(None), slice(None))[:3]
    x, y, z = (_range_of(part, size) for part, size in zip(keys, bricks.size))
    box = bricks.box((x.start, y.start, z.start), (x.stop, y.stop, z.stop))
    # An integer takes its axis away.
    axes: typing.Any = tuple(slice(None) if isinstance(part, slice) else 0 for part in keys)
    return box[axes]


def _range_of(part: typing.Any, size: int) -> range:
    if isinstance(part, slice):
        if part.step not in (None, 1):
            raise InvalidArgument("parts of a volume have steps of 1: take a step of the result, "
                                  "as in volume[0:80, 0:80, 0:80][::2]")
        try:
            begin, end, _ = part.indices(size)
        except TypeError:
            raise InvalidArgument(f"an index is a whole number, not in {part!r}") from None
        return range(begin, max(begin, end))
    try:
        index = operator.index(part)
    except TypeError:
        raise InvalidArgument("a volume is indexed by whole numbers and slices, as in "
                              f"volume[0:80, 3, -1], not by {part!r}") from None
    if not -size <= index < size:
        raise IndexError(f"the index {index} is beyond {size} voxels")
    return range(index % size, index % size + 1)
