"""What people read of the list: [haptics] of palpated.toml, and the table of the guide."""

import textwrap

from setting_list import Setting, one_of, sentence, text_of, values_of


def shown(setting: Setting) -> str:
    """The default as `palpate set` takes it."""
    if setting.kind == "number":
        return text_of(setting.default)
    if setting.kind == "flag":
        return "on" if setting.default else "off"
    return str(setting.default)


def toml(settings: list[Setting]) -> str:
    """Every key of [haptics] with its default."""
    return "".join(map(toml_key, (setting for setting in settings if setting.is_haptic)))


def toml_key(setting: Setting) -> str:
    about = " ".join(filter(None, [sentence(setting.help), setting.details]))
    lines = textwrap.wrap(about, 88, break_long_words=False, break_on_hyphens=False)
    if setting.kind == "number":
        lines.append(values_of(setting))
    if setting.kind == "choice":
        lines.append(one_of([f'"{word}"' for word in setting.words]))
    number = text_of(setting.default) if setting.whole else repr(setting.default)
    default = {"number": number, "flag": str(setting.default).lower(),
               "choice": f'"{setting.default}"'}[setting.kind]
    return "".join(f"# {line}\n" for line in lines) + f"{setting.key} = {default}\n"


def table(settings: list[Setting]) -> str:
    text = "| key | unit | range | default | what it does |\n|---|---|---|---|---|\n"
    return text + "".join(map(row, settings))


def row(setting: Setting) -> str:
    unit, values, default = setting.unit, values_of(setting), shown(setting)
    if setting.kind == "number":
        values = values.removesuffix(f" {unit}") if unit else values
    if setting.minimum is None and setting.kind == "number":
        unit, values, default = "the data's", "the volume's", "as suggested"
    about = setting.help + (f". {setting.details}" if setting.details else "")
    return f"| `{setting.key}` | {unit} | {values} | {default} | {about} |\n"
