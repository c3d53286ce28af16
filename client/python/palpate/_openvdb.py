"""Volumes as grids of OpenVDB, if its Python module is installed."""

import importlib
import typing

import numpy as np
import numpy.typing as npt

from palpate._bricks import Bricks
from palpate._errors import FailedPrecondition
from palpate._tiles import tiles_of

# Edge of the parts that are copied at once, voxels.
_CUBE = 32


def _module() -> typing.Any:
    """Errors: FailedPrecondition."""
    # OpenVDB 11 has renamed it.
    for name in ("pyopenvdb", "openvdb"):
        try:
            return importlib.import_module(name)
        except ImportError:
            pass
    raise FailedPrecondition("pyopenvdb is not installed: apt-get install python3-openvdb")


def grid_of(bricks: Bricks, world_from_index: npt.NDArray[np.float64],
            is_level_set: bool) -> typing.Any:
    """Returns an openvdb.FloatGrid."""
    openvdb = _module()
    grid = openvdb.FloatGrid(float(bricks.background))
    # OpenVDB's vectors are rows.
    grid.transform = openvdb.createLinearTransform(world_from_index.T.tolist())
    if is_level_set:
        grid.gridClass = openvdb.GridClass.LEVEL_SET
    _copy_bricks(bricks, grid, is_level_set)
    boxes, values = tiles_of(bricks)
    for box, value in zip(boxes.tolist(), values.tolist()):
        # Of a level set, only voxels near the surface are active.
        grid.fill(tuple(box[:3]), tuple(last - 1 for last in box[3:]), value,
                  active=not is_level_set)
    if is_level_set:
        grid.signedFloodFill()
    grid.prune()
    return grid


def _copy_bricks(bricks: Bricks, grid: typing.Any, is_level_set: bool) -> None:
    """Copies cubes with bricks in them: after each copy, OpenVDB looks through the whole grid.

    Voxels deep within a level set become background here, which is not active. A flood fill then
    gives them their sign.
    """
    cubes = [np.empty((0, 3), np.int64)]
    for numbers, _ in bricks.stored():
        cubes.append(bricks.corners(numbers) // _CUBE)
    for cube in np.unique(np.concatenate(cubes), axis=0).tolist():
        x, y, z = (_CUBE * place for place in cube)
        end_x, end_y, end_z = (min(begin + _CUBE, size)
                               for begin, size in zip((x, y, z), bricks.size))
        values = bricks.box((x, y, z), (end_x, end_y, end_z)).astype(np.float32, copy=False)
        if is_level_set:
            values[values == -bricks.background] = bricks.background
        grid.copyFromArray(values, ijk=(x, y, z))
