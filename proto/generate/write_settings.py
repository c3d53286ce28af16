"""The headers that the daemon and the client library make of the list. Neither knows protobuf."""

from setting_list import Setting, values_of
from write_enumerations import camel

HEAD = "// Written by proto/generate from palpate/v1/render.proto: change that.\n#pragma once\n\n"


def quoted(text: str) -> str:
    return f'"{text}"'


def value(setting: Setting) -> str:
    """The default, in C++."""
    if setting.kind == "number":
        return repr(setting.default)
    if setting.kind == "flag":
        return str(setting.default).lower()
    return f"{setting.enum}::{camel(setting.default)}"


def switches(setting: Setting, *names: str) -> str:
    """"true, false" of attributes."""
    return ", ".join(str(getattr(setting, name)).lower() for name in names)


def type_of(setting: Setting) -> str:
    return {"number": "double", "flag": "bool", "choice": setting.enum}[setting.kind]


def member(setting: Setting) -> str:
    return (f"  // {setting.help}: {values_of(setting)}\n"
            f"  {type_of(setting)} {setting.key} = {value(setting)};\n")


def daemon(settings: list[Setting]) -> str:
    """server/haptics: the settings of the renderer, and tables of numbers, flags and choices."""
    haptic = [setting for setting in settings if setting.is_haptic]
    numbers = [setting for setting in haptic if setting.kind == "number"]
    flags = [setting for setting in haptic if setting.kind == "flag"]
    choices = [setting for setting in haptic if setting.kind == "choice"]
    text = HEAD + ('#include <array>\n\n#include "common/contract/render.h"\n'
                   '#include "server/haptics/setting_kinds.h"\n\n')
    text += "namespace palpate {\n\nstruct HapticSettings {\n"
    text += "".join(map(member, numbers + flags + choices))
    text += "  // By ascending isovalue; none: the one surface of the settings above\n"
    text += "  SurfaceLayers layers{};\n"
    text += "  // Without balls: the tip is felt\n  HeldTool tool{};\n};\n\n"
    text += f"inline constexpr std::array<NumberSetting, {len(numbers)}> kNumberSettings = {{{{\n"
    for setting in numbers:
        unit = f" {setting.unit}" if setting.unit else ""
        columns = switches(setting, "whole", "refused_with_tool", "of_layers")
        text += (f'    {{"{setting.key}", &HapticSettings::{setting.key}, {setting.minimum!r}, '
                 f'{setting.maximum!r}, "{unit}", {columns}}},\n')
    text += "}};\n\n"
    text += f"inline constexpr std::array<FlagSetting, {len(flags)}> kFlagSettings = {{{{\n"
    for setting in flags:
        text += (f'    {{"{setting.key}", &HapticSettings::{setting.key}, '
                 f'{switches(setting, "refused_with_tool")}}},\n')
    text += "}};\n\n"
    text += f"inline constexpr std::array<ChoiceSetting, {len(choices)}> kChoiceSettings = {{{{\n"
    for setting in choices:
        text += f'    MakeChoice<&HapticSettings::{setting.key}>("{setting.key}"),\n'
    return text + "}};\n\n}  // namespace palpate\n"


def client(settings: list[Setting]) -> str:
    """client/sdk: Settings, SettingsUpdate and the table over them."""
    # A new member comes last, whatever its place in the list: initialisers by name stay valid.
    by_number = sorted(settings, key=lambda setting: setting.number)
    text = HEAD + ("#include <array>\n#include <bitset>\n#include <cstdint>\n#include <limits>\n"
                   "#include <optional>\n#include <string_view>\n\n"
                   '#include "client/sdk/setting.h"\n#include "common/contract/render.h"\n\n')
    text += "namespace palpate::client {\n\nstruct Settings {\n" + "".join(map(member, by_number))
    text += f"""
  // Rises with every change of settings, of where the volume lies, and with every
  // volume that is loaded; begins anew with every start of the daemon.
  std::uint64_t revision = 0;
  // Bit n: the daemon has no kSettings[n], or a value of it that this library does not know.
  // The member has the default then.
  std::bitset<{len(settings)}> unknown;
  // Felt in place of the one surface, by ascending isovalue; none: the one surface.
  SurfaceLayers layers{{}};
  HeldTool tool{{}};   // felt in place of the tip; without balls: none
  BallState ball{{}};  // what is felt of tool_radius_mm, or of the tool
  // A recording is replayed, and all this is recorded.
  bool replayed = false;
}};

// What is to change, all at one tick; what is absent stays. Of isovalue and normalized_isovalue
// at most one.
struct SettingsUpdate {{
"""
    text += "".join(f"  std::optional<{type_of(setting)}> {setting.key}{{}};\n"
                    for setting in by_number)
    text += """
  std::optional<SurfaceLayers> layers{};  // all of them
  std::optional<HeldTool> tool{};         // all of it
  // Refuse with ErrorKind::kConflict unless the settings are at this revision.
  std::optional<std::uint64_t> expected_revision{};
};

"""
    text += "// All, in the order in which they are shown; the isovalue's two come first.\n"
    text += f"inline constexpr std::array<Setting, {len(settings)}> kSettings = {{{{\n"
    return text + "".join(map(entry, settings)) + "}};\n\n}  // namespace palpate::client\n"


def entry(setting: Setting) -> str:
    members = f"&Settings::{setting.key}, &SettingsUpdate::{setting.key}"
    if setting.kind == "number":
        limits = [f"{side}std::numeric_limits<double>::infinity()" for side in ("-", "")]
        if setting.minimum is not None:
            limits = [repr(setting.minimum), repr(setting.maximum)]
        numbers = ", ".join([*limits, value(setting), str(setting.whole).lower()])
        kind = f"NumberSetting{{{members}, {numbers}}}"
    elif setting.kind == "flag":
        kind = f"FlagSetting{{{members}, {value(setting)}}}"
    else:
        kind = (f"MakeChoice<&Settings::{setting.key}, &SettingsUpdate::{setting.key}>("
                f"{value(setting)})")
    texts = [setting.key, setting.name, setting.label, setting.unit, setting.help,
             setting.shown_with]
    rows = ",\n     ".join([", ".join(map(quoted, texts[:4])), quoted(texts[4]), quoted(texts[5])])
    tips = switches(setting, "refused_with_tool", "idle_with_tool", "of_layers")
    return f"    {{{rows}, {tips},\n     {kind}}},\n"
