"""The attributes of palpate.Settings."""

import textwrap

from setting_list import Setting, one_of, sentence, text_of, values_of

HEAD = '''"""The list of settings. Written by proto/generate from palpate/v1/render.proto: change that."""

from palpate._enums import {enums}
from palpate._setting_kinds import Setting, choice
from palpate._values import number, switch


class SettingList:
    """An attribute for each setting."""

    __slots__ = ()
'''


def attributes(settings: list[Setting]) -> str:
    enums = sorted({setting.enum for setting in settings if setting.enum})
    return HEAD.format(enums=", ".join(enums)) + "".join(map(attribute, settings))


def values(setting: Setting) -> str:
    """What it may be, and where it begins."""
    if setting.kind == "flag":
        return f"True or False; default {setting.default}"
    if setting.kind == "choice":
        words = one_of([f'"{word}"' for word in setting.words])
        return f'{words}; default "{setting.default}"'
    if setting.minimum is None:
        return values_of(setting)
    return f"{values_of(setting)}; default {text_of(setting.default)}"


def attribute(setting: Setting) -> str:
    parse = {"number": "number", "flag": "switch", "choice": f"choice({setting.enum})"}
    lines = textwrap.wrap(f"{sentence(setting.help)} {setting.details}", 84)
    text = "".join(f"        {line + chr(10)!r}\n" for line in lines)
    return (f"\n    {setting.key} = Setting(\n        {parse[setting.kind]},\n"
            f"{text}        {values(setting)!r})\n")
