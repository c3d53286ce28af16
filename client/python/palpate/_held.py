"""What a message of the contract holds, as Python has it."""

import collections.abc
import inspect
import textwrap
import typing

from palpate import _enums, _value_list
from palpate._geometry import array_of_vector


def held_in(message: typing.Any) -> dict[str, typing.Any]:
    """The fields by their names: for the classes of _value_list, and what is built upon them."""
    return {field.name: _field_of(message, field) for field in message.DESCRIPTOR.fields}


def _field_of(message: typing.Any, field: typing.Any) -> typing.Any:
    value = getattr(message, field.name)
    if isinstance(value, collections.abc.MutableSequence):
        return tuple(_one_of(field, one) for one in value)
    if field.containing_oneof and not message.HasField(field.name):
        return None
    return _one_of(field, value)


def _one_of(field: typing.Any, value: typing.Any) -> typing.Any:
    if field.enum_type:
        return getattr(_enums, field.enum_type.name)(value)
    if not field.message_type:
        return value
    if field.message_type.name == "Vector3":
        return array_of_vector(value)
    return getattr(_value_list, field.message_type.name)(**held_in(value))


def fields_in(kind: type) -> str:
    """What the docstring of a class of _value_list says of its fields."""
    about = inspect.cleandoc(kind.__doc__ or "").partition("\n\n")[2]
    return textwrap.indent(about, "    ").strip()
