"""Checks values of callers for the daemon."""

import typing

import numpy as np

from palpate._errors import InvalidArgument


def number(name: str, value: typing.Any) -> float:
    """Errors: InvalidArgument."""
    # float() alone would accept True and "1".
    if not isinstance(value, (str, bytes, bytearray, bool, np.bool_)):
        try:
            return float(value)
        except (TypeError, ValueError, OverflowError):
            pass
    raise InvalidArgument(f"{name} is a number, not {value!r}")


def number_or_none(name: str, value: typing.Any) -> float | None:
    """Returns None for None. Errors: InvalidArgument."""
    return None if value is None else number(name, value)


def switch(name: str, value: typing.Any) -> bool:
    """Errors: InvalidArgument."""
    # Not bool(): bool("off") is True.
    if not isinstance(value, (bool, np.bool_)):
        raise InvalidArgument(f"{name} is True or False, not {value!r}")
    return bool(value)
