"""Layers: surfaces that are felt one behind the other."""

import dataclasses
import typing

from palpate._errors import InvalidArgument
from palpate._values import number, number_or_none, text_of, whole
from palpate.v1 import render_pb2


@dataclasses.dataclass(frozen=True)
class Layer:
    """A surface among those that are felt one behind the other: conn.settings.layers.

    name: for people, such as "skin"; 1 to 31 bytes, different for each layer
    isovalue: in data units
    stiffness_n_per_mm, damping_n_s_per_m, static_friction, dynamic_friction: as in Settings
    pop_force_n: spring force at which the stylus passes through it inwards, N; 0: never
    pop_out_force_n: the same outwards; None: pop_force_n
    viscosity_n_s_per_m: drag while this is the last layer that the stylus has passed
    id: 1 to 8; a layer that was passed stays passed while its id stays. 0: that of the layer with
        this name, or a free one
    """

    name: str
    isovalue: float
    stiffness_n_per_mm: float = 0.5
    damping_n_s_per_m: float = 0.0
    static_friction: float = 0.0
    dynamic_friction: float = 0.0
    pop_force_n: float = 0.0
    pop_out_force_n: float | None = None
    viscosity_n_s_per_m: float = 0.0
    id: int = 0


def layers_of(name: str, value: typing.Any) -> tuple[Layer, ...]:
    """Layers of a message, or of a caller. Errors: InvalidArgument."""
    if isinstance(value, render_pb2.SurfaceLayers):
        return tuple(_layer_of(message) for message in value.layer)
    try:
        layers = list(value)
    except TypeError:
        layers = [value]
    for layer in layers:
        if not isinstance(layer, Layer):
            raise InvalidArgument(f"{name} are palpate.Layer(\"skin\", -300.0, ...), not {layer!r}")
    return tuple(layers)


def put_layers(layers: tuple[Layer, ...], message: render_pb2.SurfaceLayers) -> None:
    """Errors: InvalidArgument."""
    message.SetInParent()
    for layer in layers:
        values = {field.name: _checked(field.name, getattr(layer, field.name))
                  for field in dataclasses.fields(Layer)}
        message.layer.add(**values)


def _checked(name: str, value: typing.Any) -> typing.Any:
    if name == "id":
        return whole(name, value, 0, 8)
    if name == "name":
        return text_of(name, value)
    return number_or_none(name, value) if name == "pop_out_force_n" else number(name, value)


def _layer_of(message: render_pb2.SurfaceLayer) -> Layer:
    values = {field.name: getattr(message, field.name) for field in dataclasses.fields(Layer)}
    if not message.HasField("pop_out_force_n"):
        values["pop_out_force_n"] = None
    return Layer(**values)
