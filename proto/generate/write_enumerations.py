"""The enumerations in C++, Python and TypeScript."""

import json
import textwrap

from enumeration_list import Enumeration, Enumerator

CPP_HEAD = """// Written by proto/generate from palpate/v1/*.proto: change those.
#pragma once

#include "common/contract/enumeration.h"

namespace palpate {
"""
PYTHON_HEAD = '''"""The enumerations of the contract. Written by proto/generate from palpate/v1/*.proto: change those.

The numbers are those of the contract; 0 is never sent.
"""

import typing

from palpate._word import Word
'''
# Those of a pose are all that the page says.
OF_PAGE = ("ForceState", "ForceReason", "ProxyMode")
TYPESCRIPT_HEAD = """// Written by proto/generate/update.py from palpate/v1/*.proto: change those.
// What is said of each enumerator, by its word, in the order of its number.
"""


def camel(word: str) -> str:
    """kStopCall of "stop-call"."""
    return "k" + "".join(part.capitalize() for part in word.split("-"))


def comment(text: str, indent: str) -> str:
    return "".join(f"{line}\n" for line in textwrap.wrap(
        text, 96, initial_indent=f"{indent}// ", subsequent_indent=f"{indent}// "))


def cpp(enumerations: list[Enumeration]) -> str:
    return CPP_HEAD + "".join(map(cpp_enumeration, enumerations)) + "\n}  // namespace palpate\n"


def cpp_enumeration(enumeration: Enumeration) -> str:
    name, all_of = enumeration.name, enumeration.enumerators
    members = "".join(f"{comment(one.details, '  ')}  {camel(one.word)},\n" for one in all_of)
    rows = "".join(f"    {{{', '.join(map(json.dumps, (one.word, one.says, one.advice)))}}},\n"
                   for one in all_of)
    return (f"\n{comment(enumeration.details, '')}enum class {name} : std::uint8_t {{\n{members}}};\n"
            f"template <>\ninline constexpr std::array<Enumerator, {len(all_of)}> "
            f"kEnumerators<{name}> = {{{{\n{rows}}}}};\n")


def python(enumerations: list[Enumeration]) -> str:
    return PYTHON_HEAD + "".join(map(python_enumeration, enumerations))


def python_enumeration(enumeration: Enumeration) -> str:
    def about(one: Enumerator) -> str:
        text = one.details or one.says
        text = text[:1].lower() + text[1:] if text[1:2].islower() else text
        return "\n".join(textwrap.wrap(f"{one.name}: {text.removesuffix('.')}", 92,
                                       initial_indent="    ", subsequent_indent="        "))
    told = [about(one) for one in enumeration.known if one.details or one.says]
    details = "\n    ".join(textwrap.wrap(enumeration.details, 88))
    members = "".join(f"    {one.name} = {number}\n"
                      for number, one in enumerate(enumeration.known, 1))
    listed = "\n\n" + "\n".join(told) + "\n    " if told else ""
    words = ", ".join(json.dumps(one.word) for one in enumeration.known)
    literal = "\n".join(textwrap.wrap(f"{enumeration.name}Word = typing.Literal[{words}]", 98,
                                      subsequent_indent="    ", break_on_hyphens=False))
    return (f'\n\nclass {enumeration.name}(Word):\n    """{details}{listed}"""\n\n{members}\n\n'
            f"{literal}\n")


def typescript(enumerations: list[Enumeration]) -> str:
    return TYPESCRIPT_HEAD + "".join(
        f"export const k{enumeration.name} = {{\n" + "".join(
            f"  {json.dumps(one.word) if '-' in one.word else one.word}: {json.dumps(one.says)},\n"
            for one in enumeration.enumerators) + "};\n"
        for enumeration in enumerations if enumeration.name in OF_PAGE)
