"""Ticks as tables of pandas and data sets of xarray, if these packages are installed."""

import dataclasses
import importlib
import os
import typing

import numpy as np
import numpy.typing as npt

from palpate._enums import (DeviceStatus, ForceCommand, ForceReason, ForceState, FreeSide,
                            ProxyMode)
from palpate._errors import FailedPrecondition, InvalidArgument
from palpate._html import table
from palpate._pose_columns import UNITS
from palpate._word import Word

WORDS: dict[str, type[Word]] = {
    "mode": ProxyMode, "free_side": FreeSide, "force_state": ForceState,
    "force_reason": ForceReason, "force_command": ForceCommand, "device_status": DeviceStatus}


def package(name: str) -> typing.Any:
    """Errors: FailedPrecondition if the package is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise FailedPrecondition(f"{name} is not installed: apt-get install python3-{name}, or "
                                 f"pip install {name}") from None


# unix_ns is computed here, so the contract does not declare it.
_UNIT_OF = {**UNITS, "unix_ns": "ns"}


def _parts(name: str) -> list[str]:
    """Returns the column names of a vector, as in `palpate-lab export`."""
    if name.endswith("_orientation"):
        return [f"{name.removesuffix('_orientation')}_{axis}" for axis in "wxyz"]
    unit = f"_{UNITS[name].lower().replace(' ', '_')}" if name in UNITS else ""
    return [f"{name.removesuffix(unit)}_{axis}{unit}" for axis in "xyz"]


def words_of(name: str) -> str:
    """Returns what the numbers of a field mean; empty: they are numbers."""
    return ", ".join(f"{int(word)}: {word}" for word in WORDS.get(name, ()))


def write_hdf5(path: str | os.PathLike[str],
               groups: dict[str, dict[str, npt.NDArray[typing.Any]]]) -> None:
    """Without enumerations, compounds and texts of variable length, so that MATLAB reads it."""
    h5py = package("h5py")
    with h5py.File(path, "w") as file:
        for group, arrays in groups.items():
            for name, array in arrays.items():
                plain = array.astype(np.uint8) if array.dtype == np.bool_ else array
                held = file.create_dataset(f"{group}/{name}", data=plain, maxshape=(
                    None, *plain.shape[1:]), compression="gzip" if len(plain) else None)
                for attribute, text in (("unit", _UNIT_OF.get(name, "")), ("words", words_of(name))):
                    if text:
                        held.attrs[attribute] = np.bytes_(text)


T = typing.TypeVar("T", bound="Table")


class Table:
    """A dataclass of arrays with a row per tick."""

    def _arrays(self) -> dict[str, typing.Any]:
        fields = dataclasses.fields(typing.cast(typing.Any, self))
        arrays = {field.name: getattr(self, field.name) for field in fields}
        return {name: held for name, held in arrays.items() if isinstance(held, np.ndarray)}

    def __getitem__(self: T, rows: slice | npt.ArrayLike) -> T:
        """Returns some of the rows as a table of its own.

        rows: a slice, a mask (one truth value per row), or numbers of rows.
        Errors: InvalidArgument (a single number, a mask of another length, a row that is not there)
        Example: pressed = ticks[ticks.contact]
        """
        chosen: typing.Any = rows
        try:
            if not isinstance(rows, slice):
                chosen = np.asarray(rows)
                if chosen.ndim != 1:
                    raise IndexError("rows are a slice, a mask, or a list of numbers")
                if len(chosen) == 0:
                    chosen = chosen.astype(np.intp)
            arrays = {name: array[chosen] for name, array in self._arrays().items()}
        except IndexError as error:
            raise InvalidArgument(f"no such rows: {error}") from None
        return typing.cast(T, dataclasses.replace(typing.cast(typing.Any, self), **arrays))

    def _repr_html_(self) -> str:
        arrays = self._arrays()
        rows: list[tuple[str, object]] = [("samples", len(arrays["tick"]))]
        if len(arrays["tick"]):
            seconds = (int(arrays["time_ns"][-1]) - int(arrays["time_ns"][0])) * 1e-9
            force_n = np.linalg.norm(arrays["force_n"], axis=1).max()
            rows += [("ticks", f"{arrays['tick'][0]} to {arrays['tick'][-1]}"),
                     ("time", f"{seconds:.3f} s"),
                     ("in contact", f"{arrays['contact'].mean():.1%} of them"),
                     ("greatest force", f"{force_n:.3f} N"),
                     ("isovalue", f"{arrays['isovalue'][-1]:g} at the end")]
            if "lost_ticks" in arrays and (lost := arrays["lost_ticks"][-1]):
                rows.append(("missing", f"{lost} ticks before the last one"))
        if (dropped := getattr(self, "dropped_samples", 0)):
            rows.append(("dropped", dropped))
        return table("palpate ticks", rows)

    def to_pandas(self) -> typing.Any:
        """Returns a pandas.DataFrame: a row per sample, by tick.

        The columns have the names of `palpate-lab export`: hip_x_mm, force_z_n, stylus_w ...
        Enumerations are their words. Errors: FailedPrecondition (pandas is not
        installed).
        Example: next(conn.poses(1000, 100)).to_pandas()["force_z_n"].mean()
        """
        pandas = package("pandas")
        columns: dict[str, typing.Any] = {}
        for name, array in self._arrays().items():
            if name in WORDS:
                # Not categories, which to_hdf does not write.
                words = np.array([np.nan, *map(str, WORDS[name])], dtype=object)
                columns[name] = words[array]
            elif array.ndim == 1:
                columns[name] = array
            else:
                columns.update({part: array[:, n] for n, part in enumerate(_parts(name))})
        # Signed, because to_hdf writes no other index.
        index = pandas.Index(columns.pop("tick").astype(np.int64), name="tick")
        return pandas.DataFrame(columns, index=index)

    def to_xarray(self) -> typing.Any:
        """Returns an xarray.Dataset: a variable per field, along "tick", and "axis" or "part".

        Units are in the attribute "units". Enumerations are numbers, with their words in the
        attribute "words". Its to_netcdf() needs python3-netcdf4.
        Errors: FailedPrecondition (xarray is not installed).
        Example: recording.ticks.to_xarray().force_n.sel(axis="z").max()
        """
        xarray = package("xarray")
        variables = {}
        for name, array in self._arrays().items():
            more = () if array.ndim == 1 else ("axis" if array.shape[1] == 3 else "part",)
            attributes: dict[str, typing.Any] = {}
            if unit := _UNIT_OF.get(name):
                attributes["units"] = unit
            if words := words_of(name):
                attributes["words"] = words
            variables[name] = (("tick", *more), array, attributes)
        coordinates = {"tick": variables.pop("tick"), "axis": list("xyz"), "part": list("wxyz")}
        return xarray.Dataset(variables, coordinates)
