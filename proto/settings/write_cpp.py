"""The headers that the daemon and the client library make of the list. Neither knows protobuf."""

from setting_list import Fault, Setting, values_of

HEAD = "// Written by proto/settings from palpate/v1/render.proto: change that.\n#pragma once\n\n"
# Enumerations of the contract by the header that declares them, for the client library.
ENUMS = ("FreeSide", "DecompositionMethod")


def camel(word: str) -> str:
    """kTpbccPublished of "tpbcc-published"."""
    return "k" + "".join(part.capitalize() for part in word.split("-"))


def quoted(text: str) -> str:
    return f'"{text}"'


def value(setting: Setting) -> str:
    """The default, in C++."""
    if setting.kind == "number":
        return repr(setting.default)
    if setting.kind == "flag":
        return str(setting.default).lower()
    if setting.enum not in ENUMS:
        raise Fault(f"{setting.key}: proto/settings/write_cpp.py does not know {setting.enum}")
    return f"{setting.enum}::{camel(setting.default)}"


def type_of(setting: Setting) -> str:
    return {"number": "double", "flag": "bool", "choice": setting.enum}[setting.kind]


def member(setting: Setting) -> str:
    return (f"  // {setting.help}: {values_of(setting)}\n"
            f"  {type_of(setting)} {setting.key} = {value(setting)};\n")


def daemon(settings: list[Setting]) -> str:
    """server/haptics: the settings of the renderer, and tables of numbers and flags."""
    haptic = [setting for setting in settings if setting.is_haptic]
    numbers = [setting for setting in haptic if setting.kind == "number"]
    flags = [setting for setting in haptic if setting.kind == "flag"]
    # How cells are cut is the scene's; other choices are used by name: see settings.h.
    sides = [setting for setting in haptic if setting.enum == "FreeSide"]
    text = HEAD + '#include <array>\n\n#include "server/haptics/setting_kinds.h"\n\n'
    text += "namespace palpate {\n\nstruct HapticSettings {\n"
    text += "".join(map(member, numbers + flags + sides)) + "};\n\n"
    text += f"inline constexpr std::array<NumberSetting, {len(numbers)}> kNumberSettings = {{{{\n"
    for setting in numbers:
        unit = f" {setting.unit}" if setting.unit else ""
        text += (f'    {{"{setting.key}", &HapticSettings::{setting.key}, {setting.minimum!r}, '
                 f'{setting.maximum!r}, "{unit}"}},\n')
    text += "}};\n\n"
    text += f"inline constexpr std::array<FlagSetting, {len(flags)}> kFlagSettings = {{{{\n"
    for setting in flags:
        text += f'    {{"{setting.key}", &HapticSettings::{setting.key}}},\n'
    return text + "}};\n\n}  // namespace palpate\n"


def client(settings: list[Setting]) -> str:
    """client/sdk: Settings, SettingsUpdate and the table over them."""
    # A new member comes last, whatever its place in the list: initialisers by name stay valid.
    by_number = sorted(settings, key=lambda setting: setting.number)
    text = HEAD + ("#include <array>\n#include <bitset>\n#include <cstdint>\n#include <limits>\n"
                   "#include <optional>\n#include <string_view>\n\n"
                   '#include "client/sdk/setting.h"\n\n')
    text += "namespace palpate::client {\n\nstruct Settings {\n" + "".join(map(member, by_number))
    text += f"""
  // Rises with every change of settings, of where the volume lies, and with every
  // volume that is loaded; begins anew with every start of the daemon.
  std::uint64_t revision = 0;
  // Bit n: the daemon has no kSettings[n], or a value of it that this library does not know.
  // The member has the default then.
  std::bitset<{len(settings)}> unknown;
}};

// What is to change, all at one tick; what is absent stays. Of isovalue and normalized_isovalue
// at most one.
struct SettingsUpdate {{
"""
    text += "".join(f"  std::optional<{type_of(setting)}> {setting.key}{{}};\n"
                    for setting in by_number)
    text += """
  // Refuse with ErrorKind::kConflict unless the settings are at this revision.
  std::optional<std::uint64_t> expected_revision{};
};

"""
    for enum in {setting.enum: setting for setting in settings if setting.enum}.values():
        text += words(enum)
    text += "// All, in the order in which they are shown; the isovalue's two come first.\n"
    text += f"inline constexpr std::array<Setting, {len(settings)}> kSettings = {{{{\n"
    return text + "".join(map(entry, settings)) + "}};\n\n}  // namespace palpate::client\n"


def words(setting: Setting) -> str:
    """The enumerators of a choice, and their words, in the contract's order."""
    count, enum = len(setting.words), setting.enum
    value(setting)  # its fault
    enumerators = ", ".join(f"{enum}::{camel(word)}" for word in setting.words)
    return (f"inline constexpr std::array<std::string_view, {count}> k{enum}Words = {{\n    "
            f"{', '.join(map(quoted, setting.words))}}};\n"
            f"inline constexpr std::array<{enum}, {count}> k{enum}Values = {{\n"
            f"    {enumerators}}};\n\n")


def entry(setting: Setting) -> str:
    members = f"&Settings::{setting.key}, &SettingsUpdate::{setting.key}"
    if setting.kind == "number":
        limits = [f"{side}std::numeric_limits<double>::infinity()" for side in ("-", "")]
        if setting.minimum is not None:
            limits = [repr(setting.minimum), repr(setting.maximum)]
        kind = f"NumberSetting{{{members}, {', '.join(limits)}, {value(setting)}}}"
    elif setting.kind == "flag":
        kind = f"FlagSetting{{{members}, {value(setting)}}}"
    else:
        default = setting.words.index(setting.default)
        kind = (f"MakeChoice<&Settings::{setting.key}, &SettingsUpdate::{setting.key}, "
                f"k{setting.enum}Values>(k{setting.enum}Words, {default})")
    texts = [setting.key, setting.name, setting.label, setting.unit, setting.help,
             setting.shown_with]
    rows = ",\n     ".join([", ".join(map(quoted, texts[:4])), quoted(texts[4]), quoted(texts[5])])
    return f"    {{{rows},\n     {kind}}},\n"
