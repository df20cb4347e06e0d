"""nvisii.material: how surfaces look; 18 parameters by constant or texture, and a normal map."""

from __future__ import annotations

from typing import Any

from .component import Component, check
from .glm.vectors import Numbers
from .parameters import PARAMETERS, add_methods
from .textures import texture

_BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}


@add_methods
class material(Component):
    """A principled BSDF. For each parameter P of create(): set_P(value), get_P(),
    set_P_texture(texture, channel) and clear_P_texture()."""

    _missing_raises = True

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._values = {parameter.name: parameter.default for parameter in PARAMETERS}
        self._textures: dict[str, tuple[texture, int]] = {}
        self._normal_map: texture | None = None

    @classmethod
    def create(
        cls,
        name: str,
        base_color: Numbers = (0.8, 0.8, 0.8),
        roughness: float = 0.5,
        metallic: float = 0.0,
        specular: float = 0.5,
        specular_tint: float = 0.0,
        transmission: float = 0.0,
        transmission_roughness: float = 0.0,
        ior: float = 1.45,
        alpha: float = 1.0,
        subsurface_radius: Numbers = (1.0, 0.2, 0.1),
        subsurface_color: Numbers = (0.8, 0.8, 0.8),
        subsurface: float = 0.0,
        anisotropic: float = 0.0,
        anisotropic_rotation: float = 0.0,
        sheen: float = 0.0,
        sheen_tint: float = 0.5,
        clearcoat: float = 0.0,
        clearcoat_roughness: float = 0.03,
    ) -> material:
        """A new material. Colours are linear; lengths of subsurface_radius are metres."""
        given: dict[str, Any] = locals()
        values = {key: _BY_NAME[key].value(given[key]) for key in _BY_NAME}
        made = cls(name)
        made._values.update(values)
        return made

    def set_normal_map_texture(self, texture: texture) -> None:
        """A tangent-space normal map: linear, +Y up in the picture."""
        self._use("_normal_map", _texture, texture)

    def clear_normal_map_texture(self) -> None:
        self._use("_normal_map", _texture, None)

    def _bind(self, name: str, image: Any, channel: int) -> None:
        if image is not None and channel not in (0, 1, 2, 3):
            raise RuntimeError(f"set_{name}_texture: channel is 0, 1, 2 or 3, not {channel!r}")
        check(f"set_{name}_texture", texture, image)
        old = self._textures.pop(name, (None, 0))[0]
        if image is not None:
            self._textures[name] = (image, int(channel))
        self._swap(old, image)

    def _used(self) -> list[Component]:
        bound: list[Component] = [image for image, _ in self._textures.values()]
        return bound if self._normal_map is None else [*bound, self._normal_map]

    def _lose(self, used: Component) -> None:
        self._textures = {k: v for k, v in self._textures.items() if v[0] is not used}
        if self._normal_map is used:
            self._normal_map = None
        self.mark_dirty()

    def _release(self) -> None:
        for image in self._used():
            image._users.pop(self, None)


_texture = texture
