"""The enumerations of the contract, for what is written from them."""

import dataclasses
import typing

from contract import Fault, comments, option


@dataclasses.dataclass(frozen=True)
class Enumerator:
    name: str  # "STOP_CALL"; "UNKNOWN" for ..._UNSPECIFIED
    says: str  # for people, in a line without a full stop; empty: nothing to say
    advice: str  # what to do, in the same form
    details: str  # the comment above it

    @property
    def word(self) -> str:
        """"stop-call": on command lines, in tables and JSON."""
        return self.name.lower().replace("_", "-")


@dataclasses.dataclass(frozen=True)
class Enumeration:
    name: str  # "ForceReason"
    details: str
    enumerators: tuple[Enumerator, ...]  # by number; 0 is UNKNOWN

    @property
    def known(self) -> tuple[Enumerator, ...]:
        return self.enumerators[1:]


def read(request: typing.Any) -> list[Enumeration]:
    """Of the files to generate, in their order. Errors: Fault."""
    says, advice = (option(request, "EnumValueOptions", name) for name in ("says", "advice"))
    found = []
    for file in request.proto_file:
        if file.name not in request.file_to_generate:
            continue
        details = comments(file)
        for index, enum in enumerate(file.enum_type):
            prefix = enum.value[0].name.removesuffix("UNSPECIFIED")
            if [value.number for value in enum.value] != list(range(len(enum.value))):
                raise Fault(f"{enum.name} is not numbered from 0 on")
            found.append(Enumeration(enum.name, details.get((5, index), ""), tuple(
                Enumerator(value.name.removeprefix(prefix) if number else "UNKNOWN",
                           says(value) or "", advice(value) or "",
                           details.get((5, index, 2, number), ""))
                for number, value in enumerate(enum.value))))
    return found
