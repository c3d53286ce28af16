"""The values in C++: a header for each file of the contract, and how they become messages."""

import itertools

from value_list import GEOMETRY, Field, File, Value
from write_enumerations import comment

HEAD = "// Written by proto/generate from palpate/v1/{}: change {}.\n"
ABOUT = """//
// Fields that are missing get their defaults; enumerators of a later version are kUnknown. Threads:
// any. Errors: kInvalidArgument for a negative number of voxels, one that does not fit an int, and a
// map without nine numbers.
#pragma once

"""
TYPES = {"double": ("double", "0.0"), "float": ("float", "0.0f"), "bool": ("bool", "false"),
         "int64": ("std::int64_t", "0"), "uint64": ("std::uint64_t", "0"),
         "uint32": ("std::uint32_t", "0"), "string": ("std::string", ""),
         "bytes": ("std::string", ""),
         "voxel": ("Vec3i", "Vec3i::Zero()"), "Vector3": ("Vec3", "Vec3::Zero()"),
         "Quaternion": ("UnalignedQuaternion", "UnalignedQuaternion::Identity()")}


def headers(files: list[File]) -> dict[str, str]:
    """common/contract/NAME.h; none knows protobuf."""
    places = {value.name: file.name for file in files for value in file.values}
    return {f"common/contract/{file.name}.h": header(file, places) for file in files}


def header(file: File, places: dict[str, str]) -> str:
    fields = [field for value in file.values for field in value.fields]
    types = {field.type for field in fields}
    system = [name for name, needed in (
        ("cstdint", any("int" in field.kind for field in fields)),
        ("optional", any(field.optional for field in fields)),
        ("string", any(field.kind in ("string", "bytes") for field in fields)),
        ("vector", any(field.repeated for field in fields))) if needed]
    ours = {places[name] for name in types & places.keys()} - {file.name}
    ours |= {"enumerations"} if any(field.kind == "enum" for field in fields) else set()
    included = [f"common/contract/{name}.h" for name in sorted(ours)]
    if types & set(GEOMETRY) or any(field.kind == "voxel" for field in fields):
        included.append("common/geometry/geometry.h")
    blocks = ["".join(f"#include <{name}>\n" for name in system),
              "".join(f'#include "{name}"\n' for name in included)]
    return (HEAD.format(f"{file.name}.proto", "that") + "#pragma once\n\n" + "\n".join(filter(None, blocks))
            + "\nnamespace palpate {\n" + "".join(map(struct, file.values))
            + "\n}  // namespace palpate\n")


def struct(value: Value) -> str:
    members = "".join(f"{comment(field.details, '  ')}  {member(field)}\n"
                      for field in value.fields)
    visits = "".join(f'  visit("{field.name}", value.{field.name});\n' for field in value.fields)
    visitors = "".join(f"template <class Visit>\nvoid VisitFields({const}{value.name}& value, "
                       f"Visit&& visit) {{\n{visits}}}\n" for const in ("const ", ""))
    return (f"\n{comment(value.details, '')}struct {value.name} {{\n{members}"
            f"  friend bool operator==(const {value.name}&, const {value.name}&) = default;\n}};\n"
            + visitors)


def member(field: Field) -> str:
    kind = field.type if field.kind in ("enum", "message") else field.kind
    type_name, default = TYPES.get(kind, (kind, ""))
    if field.kind == "enum":
        default = f"{kind}::kUnknown"
    if field.repeated or field.optional:
        wrapper = "vector" if field.repeated else "optional"
        return f"std::{wrapper}<{type_name}> {field.name}{{}};"
    return f"{type_name} {field.name}" + (f" = {default};" if default else "{};")


def conversions(files: list[File]) -> dict[str, str]:
    """common/wire/values.h and .cpp."""
    values = list(itertools.chain.from_iterable(file.values for file in files))
    ours = "".join(f'#include "common/contract/{file.name}.h"\n' for file in files)
    theirs = "".join(f'#include "palpate/v1/{file.name}.pb.h"\n' for file in files)
    declared = "".join(f"{value.name} FromProto(const v1::{value.name}& message);\n"
                       f"v1::{value.name} ToProto(const {value.name}& value);\n"
                       for value in values)
    return {
        "common/wire/values.h": (
            HEAD.format("*.proto", "those") + ABOUT + ours + theirs
            + f"\nnamespace palpate {{\n\n{declared}\n}}  // namespace palpate\n"),
        "common/wire/values.cpp": (
            HEAD.format("*.proto", "those") + '#include "common/wire/values.h"\n\n'
            '#include "common/error/text.h"\n#include "common/wire/convert.h"\n\nnamespace palpate {\n'
            + "".join(map(conversion, values)) + "\n}  // namespace palpate\n")}


def conversion(value: Value) -> str:
    name = value.name
    taken = "".join(f"  {line}\n" for field in value.fields for line in taking(field))
    given = "".join(f"  {line}\n" for field in value.fields for line in giving(field))
    return (f"\n{name} FromProto(const v1::{name}& message) {{\n  {name} value;\n{taken}"
            f"  return value;\n}}\n\nv1::{name} ToProto(const {name}& value) {{\n"
            f"  v1::{name} message;\n{given}  return message;\n}}\n")


def taking(field: Field) -> list[str]:
    """Lines that set the field of `value`."""
    name = field.name
    if field.kind == "voxel":
        axes = ", ".join(f"FromCount(message.{name}_{axis}())" for axis in "xyz")
        return [f"value.{name} = Vec3i({axes});"]

    def one(taken: str) -> str:
        if field.kind == "enum":
            return f"EnumeratorOf<{field.type}>({taken})"
        if field.type == "Quaternion":
            return f"UnalignedQuaternion(FromProto({taken}))"
        return f"FromProto({taken})" if field.kind == "message" else taken
    if field.repeated and field.kind in ("enum", "message"):
        return [f"for (const auto& one : message.{name}()) value.{name}.push_back({one('one')});"]
    if field.repeated:
        return [f"value.{name}.assign(message.{name}().begin(), message.{name}().end());"]
    condition = f"if (message.has_{name}()) " if field.optional or field.kind == "message" else ""
    return [f"{condition}value.{name} = {one(f'message.{name}()')};"]


def giving(field: Field) -> list[str]:
    """Lines that set the field of `message`."""
    name = field.name
    if field.kind == "voxel":
        return [f"message.set_{name}_{axis}(ToCount(value.{name}.{axis}()));" for axis in "xyz"]

    def one(given: str) -> str:
        if field.kind == "enum":
            return f"static_cast<v1::{field.type}>({given})"
        if field.type == "Quaternion":
            return f"ToProto(Eigen::Quaterniond({given}))"
        if field.kind == "string":
            return f"Utf8({given})"
        return f"ToProto({given})" if field.kind == "message" else given
    if field.repeated and field.kind == "message":
        return [f"for (const auto& one : value.{name}) *message.add_{name}() = {one('one')};"]
    if field.repeated:
        return [f"for (const auto& one : value.{name}) message.add_{name}({one('one')});"]
    condition = f"if (value.{name}) " if field.optional else ""
    given = one(f"{'*' if field.optional else ''}value.{name}")
    if field.kind == "message":
        return [f"{condition}*message.mutable_{name}() = {given};"]
    return [f"{condition}message.set_{name}({given});"]
