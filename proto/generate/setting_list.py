"""The list of settings, as render.proto has it, for what is written from it."""

import dataclasses
import typing

from google.protobuf import descriptor_pb2

import enumeration_list
from contract import Fault, comments, option

MESSAGE = "RenderSettings"
# They belong to the volume: what is felt of it begins after them.
ISOVALUES = ("isovalue", "normalized_isovalue")
# No numbers, flags or choices: whoever shows or takes them has code of its own.
MESSAGES = ("layers", "tool")

Kind = descriptor_pb2.FieldDescriptorProto


@dataclasses.dataclass(frozen=True)
class Setting:
    """One setting. kind: "number", "flag" or "choice"."""

    key: str
    number: int  # of the field
    kind: str
    default: typing.Any
    label: str
    help: str
    unit: str
    minimum: float | None
    maximum: float | None
    whole: bool
    shown_with: str
    refused_with_tool: bool
    idle_with_tool: bool
    of_layers: bool
    details: str  # the comment above the field
    enum: str  # of a choice, "FreeSide"
    words: tuple[str, ...]  # of a choice, in the contract's order, which begins at 1

    @property
    def name(self) -> str:
        """The key without its unit."""
        return self.key.removesuffix(suffix_of(self.unit))

    @property
    def is_haptic(self) -> bool:
        return self.key not in ISOVALUES


def suffix_of(unit: str) -> str:
    """"_n_s_per_m" of "N·s/m", "_per_s" of "1/s"."""
    if not unit:
        return ""
    return "_" + unit.lower().replace("1/", "per_").replace("/", "_per_").replace("·", "_")


def text_of(number: float) -> str:
    """3 for 3.0, 3.3 for 3.3."""
    return str(int(number)) if number == int(number) else repr(number)


def values_of(setting: Setting) -> str:
    """What it may be, in words: "0 to 3 N/mm", "on or off", "below or above"."""
    if setting.kind == "flag":
        return "on or off"
    if setting.kind == "choice":
        return one_of(setting.words)
    if setting.minimum is None:
        return "a number"
    if setting.whole:
        return one_of(list(map(str, range(int(setting.minimum), int(setting.maximum) + 1))))
    unit = f" {setting.unit}" if setting.unit else ""
    return f"{text_of(setting.minimum)} to {text_of(setting.maximum)}{unit}"


def one_of(words: typing.Sequence[str]) -> str:
    """"a, b or c"."""
    return " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


def sentence(text: str) -> str:
    """Help as a sentence."""
    return text[:1].upper() + text[1:] + "."


def read(request: typing.Any) -> list[Setting]:
    """The settings of a CodeGeneratorRequest, in the order of their fields. Errors: Fault."""
    says = option(request, "FieldOptions", "setting")
    words = {enum.name: tuple(one.word for one in enum.known)
             for enum in enumeration_list.read(request)}
    for file in request.proto_file:
        for index, message in enumerate(file.message_type):
            if message.name == MESSAGE:
                details = comments(file)
                found = [_setting(field, says(field), words, details.get((4, index, 2, n), ""))
                         for n, field in enumerate(message.field) if field.name not in MESSAGES]
                _check(found)
                return found
    raise Fault(f"there is no message {MESSAGE}")


def _setting(field: typing.Any, says: typing.Any, words: dict[str, tuple[str, ...]],
             details: str) -> Setting:
    if says is None:
        raise Fault(f"{field.name} has no option (setting)")
    kinds = {Kind.TYPE_DOUBLE: "number", Kind.TYPE_BOOL: "flag", Kind.TYPE_ENUM: "choice"}
    if field.type not in kinds or not field.proto3_optional:
        raise Fault(f"{field.name} must be an optional double, bool or enum")
    kind = kinds[field.type]
    enum = field.type_name.rsplit(".", 1)[-1]
    return Setting(
        key=field.name, number=field.number, kind=kind, label=says.label, help=says.help,
        default={"number": says.default_number, "flag": says.default_flag,
                 "choice": says.default_choice}[kind],
        unit=says.unit, minimum=says.minimum if says.HasField("minimum") else None,
        maximum=says.maximum if says.HasField("maximum") else None, whole=says.whole,
        shown_with=says.shown_with, refused_with_tool=says.refused_with_tool,
        idle_with_tool=says.idle_with_tool, of_layers=says.of_layers, details=details, enum=enum, words=words.get(enum, ()))


def _check(settings: list[Setting]) -> None:
    if tuple(setting.key for setting in settings[:2]) != ISOVALUES:
        raise Fault(f"the first fields of {MESSAGE} are {' and '.join(ISOVALUES)}")
    switches = [setting.key for setting in settings if setting.kind != "choice"]
    for setting in settings:
        for fault in _faults(setting, switches):
            raise Fault(f"{setting.key}: {fault}")


def _faults(setting: Setting, switches: list[str]) -> typing.Iterator[str]:
    for text in (setting.label, setting.help):
        if not text or '"' in text or "\\" in text or "%" in text:
            yield "label and help are needed, without quotes, backslashes and percent signs"
    if setting.help[:1].isupper() or setting.help.endswith("."):
        yield "help begins with a small letter and has no full stop"
    if setting.name == setting.key and setting.unit:
        yield f"the name ends with the unit: ...{suffix_of(setting.unit)}"
    if setting.shown_with and setting.shown_with not in switches:
        yield f"shown_with: {setting.shown_with} is no flag or number"
    if setting.refused_with_tool and setting.default:
        yield "refused_with_tool: the default is 0 or off"
    if setting.kind == "choice" and setting.default not in setting.words:
        yield f"default_choice is one of {', '.join(setting.words)}"
    if setting.kind != "number" or setting.key == "isovalue":
        return
    if setting.minimum is None or setting.maximum is None:
        yield "a number needs minimum and maximum"
    elif not setting.minimum <= setting.default <= setting.maximum:
        yield "default_number is not from minimum to maximum"
