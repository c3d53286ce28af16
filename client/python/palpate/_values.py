"""Checks values of callers for the daemon."""

import operator
import os
import typing
import warnings

import numpy as np

from palpate._errors import InvalidArgument

_LARGEST = (1 << 64) - 1


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


def whole(name: str, value: typing.Any, least: int = 0, most: int = _LARGEST) -> int:
    """Errors: InvalidArgument."""
    if not isinstance(value, (bool, np.bool_)):
        try:
            held = operator.index(value)
        except TypeError:
            pass
        else:
            if least <= held <= most:
                return held
    limit = f"at least {least}" if most == _LARGEST else f"from {least} to {most}"
    raise InvalidArgument(f"{name} is a whole number, {limit}, not {value!r}")


def whole_or_none(name: str, value: typing.Any, most: int = _LARGEST) -> int | None:
    """Returns None for None. Errors: InvalidArgument."""
    return None if value is None else whole(name, value, 0, most)


def switch(name: str, value: typing.Any) -> bool:
    """Errors: InvalidArgument."""
    # Not bool(): bool("off") is True.
    if not isinstance(value, (bool, np.bool_)):
        raise InvalidArgument(f"{name} is True or False, not {value!r}")
    return bool(value)


def text_of(name: str, value: typing.Any) -> str:
    """Errors: InvalidArgument."""
    if isinstance(value, str):
        try:
            value.encode()
            return value
        except UnicodeEncodeError:
            pass
    raise InvalidArgument(f"{name} is text, not {value!r}")


def path_text(path: str | os.PathLike[str]) -> str:
    """Errors: InvalidArgument (not a path, or empty)."""
    held = os.fspath(path) if isinstance(path, (str, os.PathLike)) else None
    if not isinstance(held, str):
        raise InvalidArgument(f"a path is text or a pathlib.Path, not {path!r}")
    if not held:
        raise InvalidArgument("the path is empty: name a file")
    try:
        held.encode()
    except UnicodeEncodeError:
        raise InvalidArgument(f"{held!r} is not in UTF-8, but perhaps in Latin-1; palpated takes "
                              "UTF-8 alone: rename the file") from None
    return held


def warn_if_not_kept(why: str) -> None:
    """`why`: the daemon could not write a change for its next start; "": it could."""
    if why:
        warnings.warn(f"not kept for palpated's next start: {why}", RuntimeWarning, stacklevel=4)
