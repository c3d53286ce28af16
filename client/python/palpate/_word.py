"""The base of the enumerations. _enums.py, generated from the contract, uses it."""

import enum
import typing


class Word(enum.IntEnum):
    """An enumeration. A member's str() is its word on the command line, and it equals that word.

    The numbers are for arrays, such as Poses.mode. The hash is the number's: a dictionary finds a
    member by its number, but not by its word.
    """

    def __str__(self) -> str:
        return self.name.lower().replace("_", "-")

    def __format__(self, spec: str) -> str:
        return format(str(self), spec)

    def __eq__(self, other: object) -> bool:
        return str(self) == other if isinstance(other, str) else int.__eq__(self, other)

    def __ne__(self, other: object) -> bool:
        return str(self) != other if isinstance(other, str) else int.__ne__(self, other)

    __hash__ = int.__hash__


def numbers_by_word(kind: type[Word]) -> dict[str, typing.Any]:
    """For messages of the contract."""
    return {str(one): int(one) for one in kind}
