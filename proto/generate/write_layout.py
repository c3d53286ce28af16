"""RecordedTick in a constant layout: an encoder of C++."""

import collections.abc

from value_list import Field, File, Value

ROOT = "RecordedTick"
# Bytes of a varint, which continues with zero bits up to there. A greater value takes more.
WIDTHS = {"uint64": 6, "int64": 9, "uint32": 5}
HEAD = '''// Written by proto/generate from palpate/v1/recorded.proto: change that.
//
// Every scalar is written, also 0, and varints have a constant width, so that most ticks of a
// recording have their numbers at the same places: readers view them as arrays.
#pragma once

#include "common/contract/recorded.h"
#include "server/recording/constant_layout.h"

namespace palpate {
'''


def layout(files: list[File]) -> dict[str, str]:
    """server/recording/tick_layout.h."""
    values = {value.name: value for file in files for value in file.values}
    written = dict.fromkeys(_within(values[ROOT], values)) if ROOT in values else ()
    text = "".join(map(_encoder, written))
    return {"server/recording/tick_layout.h": f"{HEAD}{text}\n}}  // namespace palpate\n"}


def _within(value: Value, values: dict[str, Value]) -> collections.abc.Iterator[Value]:
    """None before one that it has as a field."""
    for field in value.fields:
        if field.type in values:
            yield from _within(values[field.type], values)
    yield value


def _encoder(value: Value) -> str:
    lines = "".join(f"  {_line(field)}\n" for field in value.fields)
    return (f"\ninline void Put(const {value.name}& value, ConstantLayout& layout) {{\n{lines}}}\n")


def _line(field: Field) -> str:
    condition = f"if (value.{field.name}) " if field.optional else ""
    one = f"{'*' if field.optional else ''}value.{field.name}"
    if field.kind == "message":
        return (f"{condition}layout.Message({field.number}, [&] "
                f"{{ Put({one}, layout); }});")
    if field.kind == "double":
        return f"{condition}layout.Double({field.number}, {one});"
    width = WIDTHS.get(field.kind, 1)
    if field.kind == "int64" and not field.name.endswith("_ns"):
        width = WIDTHS["uint64"]
    return f"{condition}layout.Varint({field.number}, {one}, {width});"
