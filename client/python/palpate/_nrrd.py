"""Makes an NRRD file of an array. The daemon accepts uploads in this format."""

import numpy as np
import numpy.typing as npt

from palpate._errors import InvalidArgument

# The types that palpate-import reads.
_TYPES = {"i1": "int8", "u1": "uint8", "i2": "int16", "u2": "uint16", "i4": "int32",
          "u4": "uint32", "f4": "float", "f8": "double"}


def nrrd_of(values: npt.ArrayLike, world_from_index: npt.NDArray[np.float64],
            unit: str, *, is_lps: bool = False) -> tuple[bytes, memoryview]:
    """Returns header and voxels of the file. Copies the voxels only if necessary.

    values: (nx, ny, nz), indexed [x, y, z]; world_from_index: (4, 4), mm; is_lps: the world is
    the patient's LPS, otherwise the file states no orientation.
    """
    array = np.asarray(values)
    if array.ndim != 3 or array.size == 0:
        raise InvalidArgument("a volume has three dimensions, and voxels along each, not the shape "
                              f"{array.shape}")
    if array.dtype == np.bool_:
        array = array.astype(np.uint8)
    kind = array.dtype.str[1:]
    if kind not in _TYPES:
        raise InvalidArgument(f"voxels are integers of at most 32 bits, or floats of 32 or 64, not "
                              f"{array.dtype}: convert them with astype")
    if '"' in unit or not unit.isprintable():
        raise InvalidArgument("the unit is a short word, such as HU")
    # x fastest: the transposed array in NumPy's usual order.
    voxels = np.ascontiguousarray(array.T, dtype="<" + kind)
    return _header(array.shape, _TYPES[kind], world_from_index, unit, is_lps), voxels.data.cast("B")


def _header(shape: tuple[int, ...], type_name: str, world_from_index: npt.NDArray[np.float64],
            unit: str, is_lps: bool) -> bytes:
    def text(vector: npt.NDArray[np.float64]) -> str:
        return "(" + ",".join(repr(float(component)) for component in vector) + ")"

    lines = ["NRRD0004", f"type: {type_name}", "dimension: 3",
             "space: left-posterior-superior" if is_lps else "space dimension: 3",
             f"sizes: {shape[0]} {shape[1]} {shape[2]}",
             "space directions: " + " ".join(text(world_from_index[:3, n]) for n in range(3)),
             f"space origin: {text(world_from_index[:3, 3])}", "endian: little", "encoding: raw"]
    if unit:
        lines.append(f'sample units: "{unit}"')
    return ("\n".join(lines) + "\n\n").encode()
