"""The settings, as attributes that the daemon holds."""

import collections.abc
import dataclasses
import time
import typing

from palpate._errors import TooLarge, Unavailable
from palpate._held import held_in
from palpate._layers import Layer, layers_of, put_layers
from palpate._link import Link
from palpate._setting_kinds import Setting
from palpate._setting_list import SettingList
from palpate._tool import Tool, put_tool, tool_of
from palpate._value_list import BallState
from palpate._values import warn_if_not_kept, whole_or_none
from palpate.v1 import render_pb2, render_pb2_grpc, volume_pb2


@dataclasses.dataclass(frozen=True)
class Applied:
    """When a change of the settings was first used.

    In contact, the surface moves to a new isovalue within a fraction of a second, from that tick
    on. Poses.isovalue is the isovalue of each tick.

    settings_revision: revision with the change; Poses.settings_revision has the same numbers
    applied_tick: first tick that used the change; Poses.tick has the same numbers
    not_kept: why the change is not kept for palpated's next start, such as a full disk, which is
        also a RuntimeWarning; "": it is
    """

    settings_revision: int
    applied_tick: int
    not_kept: str = ""


class Settings(SettingList):
    """The daemon's settings, the same for all clients.

    help(palpate.Settings) lists them with their effects, units, ranges and defaults. Reading an
    attribute asks the daemon. Setting an attribute changes the setting and returns when a tick has
    used it. While the stylus touches the surface, a new isovalue is reached by and by, within a
    fraction of a second, so that the surface carries the stylus along; Poses.isovalue has the
    present one. Forces and lengths are those of the device. An unknown attribute is an
    AttributeError. A choice reads as a member of its enumeration, and the member equals its word:
    conn.settings.method == "tpbcc". Set a choice by the member or the word.
    Errors: InvalidArgument (out of range), TooLarge (no memory for the ball), Conflict (a recording is
    replayed), Unavailable.
    Example: conn.settings.isovalue = 300.0
    """

    __slots__ = ("_link", "_stub")

    layers: Setting[tuple[Layer, ...]] = Setting(
        layers_of,
        "Surfaces that are felt one behind the other, in place of the one surface of the other "
        "settings; (): that one surface. Reads by ascending isovalue, as a stylus meets them from "
        "outside. Set all at once, as palpate.Layer. While there are layers, the isovalue, "
        "stiffness, damping, friction and pop force are each layer's own: setting them alone is an "
        "InvalidArgument.\nExample: conn.settings.layers = "
        "[palpate.Layer(\"skin\", -300.0, 0.3, pop_force_n=1.0), palpate.Layer(\"bone\", 300.0)]")

    tool: Setting[Tool | None] = Setting(
        tool_of,
        "A rigid tool in the hand, felt with all of its balls, by force and torque; None: the "
        "stylus's tip. A palpate.Tool. Until the fields of its balls are made, what was in the hand "
        "before is felt; wait_for_tool waits. FailedPrecondition while there are layers, a pop "
        "force, friction, grain, a magnet or force shading, or if the device does not sense how its "
        "stylus is turned.\nExample: conn.settings.tool = palpate.Tool.read(\"drill.toml\")")

    def __init__(self, link: Link) -> None:
        self._link = link
        self._stub = link.stub(render_pb2_grpc.RenderServiceStub)

    def all(self) -> dict[str, typing.Any]:
        """Returns all settings of one moment, by name, in the units of the attributes.

        Errors: Unavailable. Example: before = conn.settings.all()
        """
        answer = self._link.call(self._stub.GetSettings, render_pb2.GetSettingsRequest())
        return values_of(answer.settings)

    def update(self, *, expected_revision: int | None = None, **changes: typing.Any) -> Applied:
        """Changes several settings, by name and in their units, all at one tick.

        changes: names and values, as the attributes take them.
        expected_revision: fail with Conflict unless the settings are at this revision.
        Errors: AttributeError (no such setting), InvalidArgument (out of range; nothing
        changes then), Conflict, Unavailable.
        Example: conn.settings.update(isovalue=300.0, stiffness_n_per_mm=0.8)
        """
        request = render_pb2.UpdateSettingsRequest(
            expected_revision=whole_or_none("expected_revision", expected_revision))
        put_changes(request, changes)
        answer = self._link.call(self._stub.UpdateSettings, request)
        warn_if_not_kept(answer.not_kept)
        return Applied(answer.settings_revision, answer.applied_tick, answer.not_kept)

    @property
    def replayed(self) -> bool:
        """True while a recording is replayed: the settings read are the recorded ones.

        Setting them is a Conflict then. Errors: Unavailable. Example: conn.settings.replayed
        """
        answer = self._link.call(self._stub.GetSettings, render_pb2.GetSettingsRequest())
        return bool(answer.replayed)

    def ball(self) -> BallState:
        """Returns what is felt of tool_radius_mm: the field of a ball is made in the background.

        Errors: Unavailable. Example: conn.settings.ball().felt_radius_mm
        """
        answer = self._link.call(self._stub.GetSettings, render_pb2.GetSettingsRequest())
        return BallState(**held_in(answer.ball))

    def wait_for_tool(self, timeout_s: float = 60.0) -> None:
        """Waits until the tool of the settings is felt.

        Errors: Unavailable (not within timeout_s), TooLarge (no memory for it).
        Example: conn.settings.tool = tool; conn.settings.wait_for_tool()
        """
        self.wait_for_ball(timeout_s)

    def wait_for_ball(self, timeout_s: float = 60.0) -> float:
        """Waits until the ball of tool_radius_mm is felt. Returns its radius in mm.

        Errors: Unavailable (not within timeout_s), TooLarge (no memory for it).
        Example: conn.settings.tool_radius_mm = 2.0; conn.settings.wait_for_ball()
        """
        until = time.monotonic() + timeout_s
        while (ball := self.ball()).is_awaited:
            if time.monotonic() > until:
                raise Unavailable("its fields are still being made; what was felt before, a ball "
                                  f"of {ball.felt_radius_mm:g} mm or a tool, is felt")
            time.sleep(0.05)
        if ball.problem:
            raise TooLarge(ball.problem)
        return ball.felt_radius_mm

    def __dir__(self) -> list[str]:
        return [*_SETTINGS, "all", "ball", "replayed", "update", "wait_for_ball", "wait_for_tool"]

    def __repr__(self) -> str:
        return f"<palpate settings: {', '.join(_SETTINGS)}>"


def values_of(settings: render_pb2.RenderSettings) -> dict[str, typing.Any]:
    """All settings by name, in the units of the attributes."""
    return {name: setting.parse(name, getattr(settings, name))
            for name, setting in _SETTINGS.items()}


def put_changes(request: render_pb2.UpdateSettingsRequest | volume_pb2.LoadVolumeRequest,
                changes: collections.abc.Mapping[str, typing.Any]) -> None:
    """Puts settings, by name, into a request. Errors: AttributeError, InvalidArgument."""
    for name, value in changes.items():
        if name not in _SETTINGS:
            raise AttributeError(f"there is no setting {name!r}", name=name, obj=Settings)
        parsed = _SETTINGS[name].parse(name, value)
        if name == "layers":
            put_layers(parsed, request.settings.layers)
        elif name == "tool":
            put_tool(parsed, request.settings.tool)
        else:
            setattr(request.settings, name, parsed)
        request.update_mask.paths.append(name)


_SETTINGS: dict[str, Setting[typing.Any]] = {
    name: held for kind in (SettingList, Settings) for name, held in vars(kind).items()
    if isinstance(held, Setting)}
