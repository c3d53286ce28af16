"""What is felt, as attributes that the daemon holds."""

import collections.abc
import contextlib
import dataclasses
import typing

import numpy as np
from google.protobuf import field_mask_pb2

from palpate._enums import DecompositionMethod, FreeSide, Word
from palpate._errors import InvalidArgument
from palpate._link import Link
from palpate._values import number
from palpate.v1 import render_pb2, render_pb2_grpc

T = typing.TypeVar("T")
E = typing.TypeVar("E", bound=Word)


@dataclasses.dataclass(frozen=True)
class Applied:
    """When a change of the settings was first felt.

    settings_revision: revision that has the change; Poses.settings_revision names it
    applied_tick: first tick that used it; Poses.tick counts the same
    """

    settings_revision: int
    applied_tick: int


class _Setting(typing.Generic[T]):
    """An attribute of Settings: each access asks the daemon, or tells it."""

    def __init__(self, parse: collections.abc.Callable[[str, typing.Any], T], doc: str) -> None:
        self.parse = parse
        self.__doc__ = doc

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @typing.overload
    def __get__(self, settings: None, owner: type) -> "_Setting[T]": ...

    @typing.overload
    def __get__(self, settings: "Settings", owner: type) -> T: ...

    def __get__(self, settings: "Settings | None", owner: type) -> "T | _Setting[T]":
        if settings is None:
            return self
        return typing.cast(T, settings.all()[self._name])

    def __set__(self, settings: "Settings", value: T) -> None:
        change: dict[str, typing.Any] = {self._name: value}
        settings.update(**change)


def _switch(name: str, value: typing.Any) -> bool:
    # Not bool(): that of "off" is True.
    if not isinstance(value, (bool, np.bool_)):
        raise InvalidArgument(f"{name} is True or False, not {value!r}")
    return bool(value)


def _choice(kind: type[E]) -> collections.abc.Callable[[str, typing.Any], E]:
    def parse(name: str, value: typing.Any) -> E:
        with contextlib.suppress(KeyError, ValueError):
            if isinstance(value, str):
                return kind[value.upper().replace("-", "_")]
            if not isinstance(value, (bool, np.bool_)):
                return kind(value)
        raise InvalidArgument(f"{name} is one of {', '.join(map(str, kind))}, not {value!r}")
    return parse


class Settings:
    """The daemon's settings, the same for all clients.

    Reading an attribute asks the daemon; setting one changes what is felt and returns
    when a tick has used it. Forces and lengths are those of the device. An attribute
    that is none of these is an AttributeError. A choice reads as a member of its enumeration,
    which equals its word: conn.settings.method == "tpbcc". The member and the word set it.
    Errors: InvalidArgument (out of range), Unavailable.
    """

    __slots__ = ("_link", "_stub")

    isovalue = _Setting(number, "Which surface is felt, data units (HU, intensity).")
    normalized_isovalue = _Setting(
        number, "The same over the range fixed at load: 0 its minimum, 1 its maximum.")
    stiffness_n_per_mm = _Setting(number, "Force per motion into the surface, N/mm, 0 to 3.")
    damping_n_s_per_m = _Setting(
        number, "Against motion along the surface's normal in contact, N·s/m, 0 to 5.")
    method = _Setting(_choice(DecompositionMethod), "How cells are cut into tetrahedra.")
    static_friction = _Setting(number, "Tangential per normal force at rest, 0 to 2.")
    dynamic_friction = _Setting(number, "The same while sliding, 0 to 2.")
    viscosity_n_s_per_m = _Setting(number, "Drag on all motion of the stylus, N·s/m, 0 to 5.")
    pop_force_n = _Setting(
        number, "Spring force at which the stylus pops through, N, 0 to 3.3; 0: never.")
    magnet_force_n = _Setting(
        number, "Greatest pull of the surface on a stylus near it, N, 0 to 1.5; 0: none.")
    magnet_range_mm = _Setting(number, "Distance up to which it pulls, mm, 0 to 10.")
    force_shading = _Setting(_switch, "Force along a normal that varies smoothly.")
    passivity_control = _Setting(_switch, "The surface gives off no more energy than it took in.")
    free_side = _Setting(_choice(FreeSide), "Side of the isovalue on which the stylus is free.")
    carve_tool = _Setting(_switch, "The stylus carves while its button 0 is held.")
    carve_radius_mm = _Setting(number, "Of the sphere that it carves, mm, 0.1 to 20.")
    carve_rate_per_s = _Setting(
        number, "Share of the range of values taken away per second, -20 to 20; negative: added.")
    clutch_tool = _Setting(
        _switch, "The stylus moves the volume while its button 1 is held, forces off.")

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stub = link.stub(render_pb2_grpc.RenderServiceStub)

    def all(self) -> dict[str, typing.Any]:
        """All settings of one moment, by name, in the units of the attributes."""
        answer = self._link.call(self._stub.GetSettings, render_pb2.GetSettingsRequest())
        return {name: setting.parse(name, getattr(answer.settings, name))
                for name, setting in _SETTINGS.items()}

    def update(self, *, expected_revision: int | None = None, **changes: typing.Any) -> Applied:
        """Changes several settings, by name and in their units, all at one tick.

        expected_revision: refuse with Conflict unless the settings are at this one.
        Errors: AttributeError (no such setting), InvalidArgument (out of range; nothing
        changes then), Unavailable.
        """
        request = render_pb2.UpdateSettingsRequest(
            update_mask=field_mask_pb2.FieldMask(paths=list(changes)),
            expected_revision=expected_revision)
        for name, value in changes.items():
            if name not in _SETTINGS:
                raise AttributeError(f"there is no setting {name!r}", name=name, obj=self)
            setattr(request.settings, name, _SETTINGS[name].parse(name, value))
        answer = self._link.call(self._stub.UpdateSettings, request)
        return Applied(answer.settings_revision, answer.applied_tick)

    def __dir__(self) -> list[str]:
        return [*_SETTINGS, "all", "update"]

    def __repr__(self) -> str:
        return f"<palpate settings: {', '.join(_SETTINGS)}>"


_SETTINGS: dict[str, _Setting[typing.Any]] = {
    name: held for name, held in vars(Settings).items() if isinstance(held, _Setting)}
