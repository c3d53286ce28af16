"""Boxes of bricks that have one value."""

import numpy as np
import numpy.typing as npt

from palpate._bricks import EDGE, Bricks, Numbers

# (n, 6): the first brick and the one after the last, along x, y and z.
Boxes = npt.NDArray[np.int64]
Values = npt.NDArray[np.float32]


def tiles_of(bricks: Bricks) -> tuple[Boxes, Values]:
    """Returns voxel boxes, in few pieces, and their values; background has none."""
    boxes: list[Boxes] = [np.empty((0, 6), np.int64)]
    values: list[Values] = [np.empty(0, np.float32)]
    for numbers, held in bricks.constant():
        begins, ends = _runs(numbers, held, bricks.counts[2])
        low, high = (np.stack(np.unravel_index(numbers[at], bricks.counts), axis=1)
                     for at in (begins, ends))
        boxes.append(np.hstack((low, high + 1)))
        values.append(held[begins])
    joined = np.concatenate(boxes), np.concatenate(values)
    for axis in (2, 1, 0):
        joined = _merged(*joined, axis)
    return np.minimum(EDGE * joined[0], np.tile(bricks.size, 2)), joined[1]


def _runs(numbers: Numbers, values: Values, row: int
          ) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Returns where runs of one value along z begin, and their last places."""
    bits = values.view(np.uint32)
    cuts = np.flatnonzero((np.diff(numbers) != 1) | (bits[1:] != bits[:-1])
                          | (numbers[1:] % row == 0))
    if not len(numbers):
        return cuts, cuts
    return np.append(0, cuts + 1), np.append(cuts, len(numbers) - 1)


def _merged(boxes: Boxes, values: Values, axis: int) -> tuple[Boxes, Values]:
    """Merges boxes that touch along the axis and are otherwise equal."""
    others = [n for n in range(6) if n % 3 != axis]
    bits = values.view(np.uint32)
    order = np.lexsort((boxes[:, axis], *boxes[:, others].T, bits))
    boxes, bits = boxes[order], bits[order]
    is_next = ((boxes[1:, others] == boxes[:-1, others]).all(axis=1) & (bits[1:] == bits[:-1])
               & (boxes[1:, axis] == boxes[:-1, axis + 3]))
    begins = np.append(True, ~is_next)[:len(boxes)]
    ends = np.append(~is_next, True)[:len(boxes)]
    merged = boxes[begins]
    merged[:, axis + 3] = boxes[ends, axis + 3]
    return merged, bits[begins].view(np.float32)
