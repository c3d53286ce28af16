"""The columns of palpate.Poses and of palpate.RecordedTicks."""

import re
import textwrap
import typing

from contract import Fault
from value_list import Field, File

HEAD = '''"""The columns of poses and of recorded ticks. Written by proto/generate from palpate/v1/pose.proto
and palpate/v1/recorded.proto: change those."""

import dataclasses

import numpy as np
import numpy.typing as npt
'''
TYPES = {"double": "float64", "bool": "bool_", "int64": "int64", "uint64": "uint64",
         "uint32": "uint32", "enum": "uint8"}
PARTS = {"Vector3": "xyz", "Quaternion": "wxyz"}
UNIT_NAMES = ("mm", "n", "ns")  # at the end of names


def columns(files: list[File]) -> dict[str, str]:
    """palpate/_pose_columns.py."""
    values = {value.name: value.fields for file in files for value in file.values}
    listed = list(_listed(values["PoseSample"], values))
    recorded = list(_listed(values["RecordedTick"][1:], values))  # behind the pose
    units = "".join(_units(listed + recorded))
    sources = "".join(f'    "{name}": ("{path}", {_kind(field)}),\n'
                      for name, path, field in listed)
    within = [(name, f"pose.{path}", field) for name, path, field in listed]
    recorded_sources = "".join(
        f'    "{name}": ("{path}", {_kind(field)}, {field.optional and field.type not in PARTS}),\n'
        for name, path, field in within + recorded)
    text = (f"{HEAD}{_class('PoseColumns', 'sample', 'ABOUT', listed)}"
            f"{_class('RecordedColumns(PoseColumns)', 'recorded tick', 'RECORDED_ABOUT', recorded)}"
            "\n\n# Where a column comes from, and its type, or the parts of what it has.\n"
            f"SOURCES: dict[str, tuple[str, type | str]] = {{\n{sources}}}\n"
            f"# The units of the columns that have one.\nUNITS: dict[str, str] = {{\n{units}}}\n"
            "# The same in a RecordedTick; and whether it is NaN where it is absent.\n"
            f"RECORDED: dict[str, tuple[str, type | str, bool]] = {{\n{recorded_sources}}}\n")
    return {"palpate/_pose_columns.py": text}


def _class(name: str, of: str, about: str, listed: list[tuple[str, str, Field]]) -> str:
    types = "".join(f"    {name}: npt.NDArray[np.{_type(field)}]\n" for name, _, field in listed)
    return (f'\n{about} = """{"".join(map(_about, listed))}"""\n\n\n'
            "@dataclasses.dataclass(frozen=True, eq=False, repr=False)\n"
            f'class {name}:\n    """An array for each field of a {of}."""\n\n{types}')


def _listed(fields: typing.Iterable[Field], values: dict[str, typing.Any]
            ) -> typing.Iterator[tuple[str, str, Field]]:
    """Name, path and field; force_state of forces.state."""
    for field in fields:
        if field.type in values:
            stem = field.name.removesuffix("s")
            for name, path, part in _listed(values[field.type], values):
                yield f"{stem}_{name}", f"{field.name}.{path}", part
        else:
            yield field.name, field.name, field


def _units(listed: list[tuple[str, str, Field]]) -> typing.Iterator[str]:
    for name, _, field in listed:
        suffix = "_" + field.unit.lower().replace(" ", "_") if field.unit else ""
        if not name.endswith(suffix) or (not suffix and name.rpartition("_")[2] in UNIT_NAMES):
            raise Fault(f"{name} is declared in the unit {field.unit!r}, not in that of its name")
        if suffix:
            yield f'    "{name}": "{field.unit}",\n'


def _type(field: Field) -> str:
    return "float64" if field.type in PARTS else TYPES[field.kind]


def _kind(field: Field) -> str:
    return f'"{PARTS[field.type]}"' if field.type in PARTS else f"np.{TYPES[field.kind]}"


def _about(column: tuple[str, str, Field]) -> str:
    name, _, field = column
    text, parts = field.details, PARTS.get(field.type, "")
    if field.optional:
        text = re.sub("[Aa]bsent", "NaN", text) + " NaN where it is absent." * ("bsent" not in text)
    if not text[1:2].isupper():
        text = text[:1].lower() + text[1:]
    words = " ".join([
        f"(n, {len(parts)})" if parts else "(n,)", f"of {field.type}:" * (field.kind == "enum"),
        "w, x, y, z:" * (parts == "wxyz"), text]).split()
    return "\n".join(textwrap.wrap(f"{name}: {' '.join(words).rstrip('.:')}", 94,
                                   initial_indent="    ", subsequent_indent="        ",
                                   break_on_hyphens=False)) + "\n"
