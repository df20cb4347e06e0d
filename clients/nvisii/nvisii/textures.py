"""nvisii.texture: pictures, and mixes of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from .checks import array, checked, whole
from .component import Component
from .glm.vectors import Numbers, floats, u16vec4, vec4
from .pictures import as_bytes, hsv_of, mixed, read_picture, sampled, to_linear


class texture(Component):
    """An image: 8 bits a channel, or floats (hdr). v = 0 is the bottom of the picture. Bytes that
    are not `linear` are sRGB; floats are linear."""

    def __init__(self, name: str, texels: Any, linear: bool) -> None:
        super().__init__(name)
        self._texels = texels  # (H, W, 4), row 0 at the top, uint8 or float32
        self._linear = linear
        self._scale = (1.0, 1.0)

    @classmethod
    def create_from_file(cls, name: str, path: str, linear: bool = False) -> texture:
        """Reads a picture's file: PNG, JPEG, TGA, BMP, GIF, PSD, PNM, DDS, HDR, EXR. linear: values
        are no colours, as in normal maps; float files always are linear."""
        cls._check_new(name)
        texels = array(path, read_picture(path))
        return cls(name, texels, linear or texels.dtype != np.uint8)

    @classmethod
    def create_from_image(cls, name: str, path: str, linear: bool = False) -> texture:
        """The old name of create_from_file."""
        return cls.create_from_file(name, path, linear)

    @classmethod
    def create_from_data(
        cls, name: str, width: int, height: int, data: Any, linear: bool = True, hdr: bool = False
    ) -> texture:
        """RGBA floats, row 0 at the bottom: 4 * width * height of them. Without hdr they are kept
        as 8 bits a channel, of [0, 1]."""
        if getattr(data, "dtype", None) == np.uint8:
            raise RuntimeError("texture.create_from_data: data are bytes; divide them by 255")
        width, height = whole("width", width, 1), whole("height", height, 1)
        values = array("data", data, "f4")
        if values.size != 4 * width * height:
            raise RuntimeError(
                f"texture.create_from_data: {width}x{height} RGBA are {4 * width * height} floats, "
                f"not {values.size}"
            )
        texels = values.reshape(height, width, 4)[::-1].copy()
        return cls(name, texels if hdr else as_bytes(texels), linear)

    @classmethod
    @checked
    def create_mix(
        cls, name: str, a: texture, b: texture, mix: float = 1.0, hdr: bool = False
    ) -> texture:
        """a where mix is 0, b where it is 1."""
        return cls._baked(name, mixed(a, b, lambda x, y: x + (y - x) * np.float32(mix)), hdr)

    @classmethod
    def create_add(cls, name: str, a: texture, b: texture, hdr: bool = False) -> texture:
        return cls._baked(name, mixed(a, b, np.add), hdr)

    @classmethod
    def create_multiply(cls, name: str, a: texture, b: texture, hdr: bool = False) -> texture:
        return cls._baked(name, mixed(a, b, np.multiply), hdr)

    @classmethod
    @checked
    def create_hsv(
        cls,
        name: str,
        tex: texture,
        hue: float,
        saturation: float,
        value: float,
        mix: float = 1.0,
        hdr: bool = False,
    ) -> texture:
        """Another hue (0.5: as it is; in turns), saturation and value (1: as they are)."""
        old = to_linear(tex)
        new = hsv_of(old, (hue, saturation, value))
        return cls._baked(name, old + (new - old) * np.float32(mix), hdr)

    @classmethod
    def _baked(cls, name: str, texels: Any, hdr: bool) -> texture:
        texels = array(f'texture "{name}"', np.ascontiguousarray(texels, dtype="f4"))
        return cls(name, texels if hdr else as_bytes(texels), True)

    @classmethod
    def _check_new(cls, name: str) -> None:
        """Refuses a name before a file is read for it."""
        if name in cls._named:
            raise RuntimeError(f'texture "{name}" already exists; remove it, or get() it')

    def set_scale(self, scale: Numbers) -> None:
        """Texture coordinates are divided by it: 2 shows the picture twice as large."""
        x, y = floats(scale, 2, "scale")
        if x == 0 or y == 0:
            raise RuntimeError("scale: must not be 0")
        self._scale = (x, y)
        self.mark_dirty()

    def set_linear(self, is_linear: bool) -> None:
        """True: bytes are linear numbers, not sRGB colours."""
        self._linear = bool(is_linear)
        self.mark_dirty()

    def is_linear(self) -> bool:
        return self._linear

    def is_hdr(self) -> bool:
        """True if texels are floats."""
        return bool(self._texels.dtype != np.uint8)

    def get_width(self) -> int:
        return int(self._texels.shape[1])

    def get_height(self) -> int:
        return int(self._texels.shape[0])

    def get_float_texels(self) -> Any:
        """(4 * width * height,) float32, row 0 at the bottom, bytes as [0, 1]."""
        texels = self._texels
        values = texels if self.is_hdr() else texels.astype("f4") / np.float32(255)
        return np.ascontiguousarray(values[::-1]).reshape(-1)

    def get_byte_texels(self) -> Any:
        """(4 * width * height,) uint8, row 0 at the bottom, floats clamped to [0, 1]."""
        texels = as_bytes(self._texels) if self.is_hdr() else self._texels
        return np.ascontiguousarray(texels[::-1]).reshape(-1)

    def sample_float_texels(self, uv: Numbers) -> Any:
        """RGBA at a place, bilinear, repeated."""
        u, v = floats(uv, 2, "uv")
        texels = self._texels.astype("f4") / np.float32(1 if self.is_hdr() else 255)
        return vec4(*sampled(texels, u / self._scale[0], v / self._scale[1]).tolist())

    def sample_byte_texels(self, uv: Numbers) -> Any:
        """RGBA at a place, bilinear, repeated, of [0, 255]."""
        values = np.clip(np.array(self.sample_float_texels(uv)), 0, 1)
        return u16vec4(*np.rint(values * 255).astype(int).tolist())

    def _uv(self) -> Any:
        """The (2, 3) matrix of texture coordinates; None: as they are."""
        if self._scale == (1.0, 1.0):
            return None
        return [[1 / self._scale[0], 0, 0], [0, 1 / self._scale[1], 0]]
