"""The parameters of a material as one table, and the methods that it makes."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

from .checks import number
from .glm.vectors import floats, vec3


class Parameter(NamedTuple):
    """name; default: a number, or 3 of them; argument: of its setter."""

    name: str
    default: Any
    argument: str

    @property
    def is_color(self) -> bool:
        return isinstance(self.default, tuple)

    def value(self, given: Any) -> Any:
        """A number or a tuple of 3; RuntimeError for anything else."""
        if self.is_color:
            return floats(given, 3, self.name)
        return number(self.name, given)


# Parameters in the order of material.create.
PARAMETERS = (
    Parameter("base_color", (0.8, 0.8, 0.8), "color"),
    Parameter("roughness", 0.5, "roughness"),
    Parameter("metallic", 0.0, "metallic"),
    Parameter("specular", 0.5, "specular"),
    Parameter("specular_tint", 0.0, "specular_tint"),
    Parameter("transmission", 0.0, "transmission"),
    Parameter("transmission_roughness", 0.0, "transmission_roughness"),
    Parameter("ior", 1.45, "ior"),
    Parameter("alpha", 1.0, "alpha"),
    Parameter("subsurface_radius", (1.0, 0.2, 0.1), "subsurface_radius"),
    Parameter("subsurface_color", (0.8, 0.8, 0.8), "color"),
    Parameter("subsurface", 0.0, "subsurface"),
    Parameter("anisotropic", 0.0, "anisotropic"),
    Parameter("anisotropic_rotation", 0.0, "anisotropic_rotation"),
    Parameter("sheen", 0.0, "sheen"),
    Parameter("sheen_tint", 0.5, "sheen_tint"),
    Parameter("clearcoat", 0.0, "clearcoat"),
    Parameter("clearcoat_roughness", 0.03, "clearcoat_roughness"),
)


def add_methods(cls: type) -> type:
    """Class decorator: set_P, get_P, set_P_texture and clear_P_texture of every parameter, over
    the instance's `_values` {name: value} and `_bind(name, texture, channel)`."""
    for parameter in PARAMETERS:
        for verb, method in _methods(parameter).items():
            method.__name__ = verb.format(parameter.name)
            method.__qualname__ = f"{cls.__name__}.{method.__name__}"
            setattr(cls, method.__name__, method)
    return cls


def _methods(parameter: Parameter) -> dict[str, Callable[..., Any]]:
    name = parameter.name

    def put(self: Any, value: Any) -> None:
        self._values[name] = parameter.value(value)
        self.mark_dirty()

    def read(self: Any) -> Any:
        value = self._values[name]
        return vec3(*value) if parameter.is_color else value

    def bind_color(self: Any, texture: Any) -> None:
        self._bind(name, texture, 0)

    def bind_scalar(self: Any, texture: Any, channel: int = 0) -> None:
        self._bind(name, texture, channel)

    def unbind(self: Any) -> None:
        self._bind(name, None, 0)

    bind = bind_color if parameter.is_color else bind_scalar
    put.__doc__ = f"Sets {name} to {'3 numbers' if parameter.is_color else 'a number'}."
    read.__doc__ = f"The constant {name}, also while a texture drives it."
    bind.__doc__ = f"A texture drives {name} in place of the constant."
    unbind.__doc__ = f"The constant {name} counts again."
    return {
        "set_{}": _renamed(put, parameter.argument),
        "get_{}": read,
        "set_{}_texture": bind,
        "clear_{}_texture": unbind,
    }


def _renamed(method: Callable[[Any, Any], None], argument: str) -> Callable[..., None]:
    """The method with its value called `argument`."""

    def put(self: Any, *values: Any, **named: Any) -> None:
        bound = signature.bind(self, *values, **named)
        method(self, bound.arguments[argument])

    own = [
        inspect.Parameter(key, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        for key in ("self", argument)
    ]
    signature = inspect.Signature(own)
    put.__signature__ = signature  # type: ignore[attr-defined]
    put.__doc__ = method.__doc__
    return put
