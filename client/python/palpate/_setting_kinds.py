"""The kinds of settings. _setting_list.py, generated from the contract, uses them."""

import collections.abc
import contextlib
import typing

import numpy as np

from palpate._errors import InvalidArgument
from palpate._word import Word

T = typing.TypeVar("T")
E = typing.TypeVar("E", bound=Word)


class Held(typing.Protocol):
    """The object with all settings: palpate.Settings."""

    def all(self) -> dict[str, typing.Any]: ...

    def update(self, **changes: typing.Any) -> typing.Any: ...


class Setting(typing.Generic[T]):
    """An attribute of Settings. Reading asks the daemon; setting tells the daemon."""

    def __init__(self, parse: collections.abc.Callable[[str, typing.Any], T], doc: str) -> None:
        self.parse = parse
        self.__doc__ = doc

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @typing.overload
    def __get__(self, settings: None, owner: type) -> "Setting[T]": ...

    @typing.overload
    def __get__(self, settings: "Held", owner: type) -> T: ...

    def __get__(self, settings: "Held | None", owner: type) -> "T | Setting[T]":
        if settings is None:
            return self
        return typing.cast(T, settings.all()[self._name])

    def __set__(self, settings: "Held", value: T) -> None:
        change: dict[str, typing.Any] = {self._name: value}
        settings.update(**change)


def choice(kind: type[E]) -> collections.abc.Callable[[str, typing.Any], E]:
    def parse(name: str, value: typing.Any) -> E:
        with contextlib.suppress(KeyError, ValueError):
            if isinstance(value, str):
                return kind[value.upper().replace("-", "_")]
            if not isinstance(value, (bool, np.bool_)):
                return kind(value)
        raise InvalidArgument(f"{name} is one of {', '.join(map(str, kind))}, not {value!r}")
    return parse
