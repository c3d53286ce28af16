"""Vectors and maps of palpate.v1 as NumPy arrays, and back."""

import collections.abc
import typing

import numpy as np
import numpy.typing as npt

from palpate._errors import InvalidArgument
from palpate.v1 import geometry_pb2

# Three numbers: a tuple, a list, an array of shape (3,).
Triple = collections.abc.Sequence[float] | npt.NDArray[typing.Any]
# Four numbers: a unit quaternion w, x, y, z.
Quadruple = collections.abc.Sequence[float] | npt.NDArray[typing.Any]


def array_of_vector(vector: geometry_pb2.Vector3) -> npt.NDArray[np.float64]:
    """(3,)"""
    return np.array([vector.x, vector.y, vector.z])


def vector_of(name: str, values: Triple) -> geometry_pb2.Vector3:
    x, y, z = three(name, values)
    return geometry_pb2.Vector3(x=x, y=y, z=z)


def quaternion_of(name: str, values: Quadruple) -> geometry_pb2.Quaternion:
    array = numbers_of(name, values)
    if array.shape != (4,):
        raise InvalidArgument(f"{name} has four components: w, x, y, z")
    w, x, y, z = map(float, array)
    return geometry_pb2.Quaternion(w=w, x=x, y=y, z=z)


def three(name: str, values: Triple) -> tuple[float, float, float]:
    array = numbers_of(name, values)
    if array.shape != (3,):
        raise InvalidArgument(f"{name} has three components, along x, y and z")
    return float(array[0]), float(array[1]), float(array[2])


def numbers_of(name: str, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Errors: InvalidArgument."""
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidArgument(f"{name} consists of numbers, not {values!r}") from None


def matrix_of_map(affine: geometry_pb2.AffineMap) -> npt.NDArray[np.float64]:
    """(4, 4): maps the column (x, y, z, 1)."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(affine.linear).reshape(3, 3)
    matrix[:3, 3] = array_of_vector(affine.translation)
    return matrix
