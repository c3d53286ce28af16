"""The classes of the Python package that are values of the contract."""

import textwrap

from value_list import Field, File, Value

# Those that the package gives as they are, or builds its own upon.
OF_PACKAGE = ("ForceStatus", "ListedDevice", "DeviceHealth", "DeviceDescription",
              "ServoDescription", "LastChange", "RunningReplay", "RecordingState",
              "SuggestedIsovalue", "BallState")
HEAD = '''"""Values of the contract. Written by proto/generate from palpate/v1/*.proto: change those."""

import dataclasses

import numpy as np
import numpy.typing as npt

from palpate._enums import {enums}
'''
TYPES = {"double": "float", "bool": "bool", "int64": "int", "uint64": "int", "uint32": "int",
         "string": "str", "bytes": "bytes", "Vector3": "npt.NDArray[np.float64]"}


def classes(files: list[File]) -> dict[str, str]:
    """palpate/_value_list.py."""
    values = [value for file in files for value in file.values if value.name in OF_PACKAGE]
    enums = sorted({field.type for value in values for field in value.fields
                    if field.kind == "enum"})
    imported = ", ".join(enums)
    if len(imported) > 70:
        imported = "(" + textwrap.fill(imported, 70, subsequent_indent=" " * 28) + ")"
    return {"palpate/_value_list.py":
            HEAD.format(enums=imported) + "".join(map(python_class, values))}


def python_class(value: Value) -> str:
    details = "\n    ".join(textwrap.wrap(value.details, 88))
    about = "".join(f"\n{described(field)}" for field in value.fields)
    members = "".join(f"    {field.name}: {type_of(field)}\n" for field in value.fields)
    # Arrays cannot be compared with ==.
    options = ", eq=False" if any(field.type == "Vector3" for field in value.fields) else ""
    return (f'\n\n@dataclasses.dataclass(frozen=True{options})\nclass {value.name}:\n'
            f'    """{details}\n{about}\n    """\n\n{members}')


def described(field: Field) -> str:
    shape = "(3,) " if field.type == "Vector3" else ""
    text = field.details if field.details[1:2].isupper() else (
        field.details[:1].lower() + field.details[1:])
    text = text.replace("absent:", "None:") if field.optional else text
    if field.kind == "enum":
        text = f"{text.removesuffix('.')}; see help(palpate.{field.type})"
    return "\n".join(textwrap.wrap(f"{field.name}: {shape}{text.removesuffix('.')}", 90,
                                   initial_indent="    ", subsequent_indent="        "))


def type_of(field: Field) -> str:
    name = TYPES.get(field.type, field.type) if field.type else TYPES[field.kind]
    if field.repeated:
        return f"tuple[{name}, ...]"
    return f"{name} | None" if field.optional else name
