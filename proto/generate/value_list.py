"""The messages of the contract that are plain values, for what is written from them."""

import dataclasses
import typing

from google.protobuf import descriptor_pb2

from contract import Fault, comments, option

Kind = descriptor_pb2.FieldDescriptorProto
SCALARS = {Kind.TYPE_DOUBLE: "double", Kind.TYPE_FLOAT: "float", Kind.TYPE_BOOL: "bool",
           Kind.TYPE_INT64: "int64", Kind.TYPE_UINT64: "uint64", Kind.TYPE_FIXED64: "uint64",
           Kind.TYPE_UINT32: "uint32", Kind.TYPE_STRING: "string", Kind.TYPE_BYTES: "bytes"}
# Messages of geometry.proto; their values are those of common/geometry.
GEOMETRY = ("Vector3", "Quaternion", "AffineMap")


@dataclasses.dataclass(frozen=True)
class Field:
    number: int
    name: str
    kind: str  # one of SCALARS' words, "enum", "message" or "voxel": NAME_x, NAME_y and NAME_z
    type: str  # of an enum or a message: its name in the contract
    repeated: bool
    optional: bool  # absent is something else than the default
    unit: str  # empty: none, or data units
    details: str  # the comment above it


@dataclasses.dataclass(frozen=True)
class Value:
    name: str
    details: str
    fields: tuple[Field, ...]


@dataclasses.dataclass(frozen=True)
class File:
    name: str  # "pose", of palpate/v1/pose.proto
    values: tuple[Value, ...]  # none before one that it has as a field


def read(request: typing.Any) -> list[File]:
    """Of the files to generate, in their order; only those with values. Errors: Fault."""
    is_value = option(request, "MessageOptions", "is_value")
    unit_of = option(request, "FieldOptions", "unit")
    files = []
    for file in request.proto_file:
        if file.name not in request.file_to_generate:
            continue
        details = comments(file)
        values = [Value(message.name, details.get((4, index), ""),
                        tuple(_fields(message, index, details, unit_of)))
                  for index, message in enumerate(file.message_type) if is_value(message)]
        if values:
            name = file.name.rsplit("/", 1)[-1].removesuffix(".proto")
            files.append(File(name, tuple(_ordered(values))))
    _check(files)
    return files


def _fields(message: typing.Any, index: int,
            details: dict[tuple[int, ...], str],
            unit_of: typing.Callable[[typing.Any], typing.Any]) -> typing.Iterator[Field]:
    voxel = ""  # the rest of NAME_x, NAME_y, NAME_z: whole numbers
    for n, field in enumerate(message.field):
        about = details.get((4, index, 2, n), "")
        stem, axis = field.name[:-2], field.name[-2:]
        parts = [(part.name, part.type) for part in message.field[n:n + 3]]
        if parts == [(f"{stem}_{one}", Kind.TYPE_UINT32) for one in "xyz"]:
            voxel = stem
            yield Field(field.number, stem, "voxel", "", False, False, "", about)
        elif stem == voxel and axis in ("_y", "_z"):
            continue
        else:
            kind = {Kind.TYPE_ENUM: "enum", Kind.TYPE_MESSAGE: "message"}.get(
                field.type, SCALARS.get(field.type))
            if kind is None:
                raise Fault(f"{message.name}.{field.name} has a type that no value has")
            # Of a oneof at most one is there.
            optional = field.proto3_optional or field.HasField("oneof_index")
            yield Field(field.number, field.name, kind, field.type_name.rsplit(".", 1)[-1],
                        field.label == Kind.LABEL_REPEATED, optional, unit_of(field) or "", about)


def _ordered(values: list[Value]) -> list[Value]:
    done: list[Value] = []
    names = {value.name for value in values}
    while len(done) < len(values):
        known = {value.name for value in done}
        more = [value for value in values if value.name not in known
                and all(field.type in known or field.type not in names for field in value.fields)]
        if not more:
            raise Fault(f"{', '.join(sorted(names - known))}: a value cannot hold itself")
        done += more
    return done


def _check(files: list[File]) -> None:
    names = {value.name for file in files for value in file.values} | set(GEOMETRY)
    for value in (value for file in files for value in file.values):
        for field in value.fields:
            if field.kind == "message" and field.type not in names:
                raise Fault(f"{value.name}.{field.name}: {field.type} is no value")
