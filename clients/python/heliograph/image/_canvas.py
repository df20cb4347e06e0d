"""A picture to draw on, with smooth lines and readable tags. Used by annotate.py.

Points are raster coordinates of the frame: pixel (x, y) covers [x, x + 1) x [y, y + 1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .._wire.arrays import NdArray
from .picture import Picture, font_of

Color = tuple[int, int, int]
Box = tuple[float, float, float, float]
_CASING = (8, 9, 11, 150)  # beneath each line, so that it is seen on any ground


class Canvas:
    """picture: (H, W, 3) uint8, enlarged `scale` times. Lines wait for flush(), or finished()."""

    def __init__(self, picture: NdArray, scale: int) -> None:
        from PIL import Image

        wide = np.repeat(np.repeat(np.asarray(picture), scale, axis=0), scale, axis=1)
        self.scale = scale
        self.base = Image.fromarray(np.ascontiguousarray(wide))
        height, width = wide.shape[:2]
        self._fine = 3 if width * height <= 2_500_000 else 2
        self.stroke = max(1.5, min(width, height) / 240)
        self.line = max(10, min(22, round(min(width, height) / 34)))
        self._font = font_of(self.line)
        self._tags: list[tuple[Box, str, Color]] = []
        self._new_layer()

    def _new_layer(self) -> None:
        from PIL import Image, ImageDraw

        size = (self.base.width * self._fine, self.base.height * self._fine)
        self._layer = Image.new("RGBA", size, (0, 0, 0, 0))
        self._draw = ImageDraw.Draw(self._layer)

    # ------------------------------------------------------------ areas

    def blend(self, mask: NdArray, color: Any, share: float) -> None:
        """Mixes a share of a colour, or of a (H, W, 3) picture of colours, where mask (H, W)."""
        from PIL import Image

        pixels, where = np.array(self.base), self._wide(mask)
        color = np.asarray(color, dtype="f4")
        paint = self._wide(color)[where] if color.ndim == 3 else color
        pixels[where] = (pixels[where] * (1 - share) + paint * share + 0.5).astype(np.uint8)
        self.base = Image.fromarray(pixels)

    def outline(self, mask: NdArray, color: Color) -> None:
        """The inner edge of a mask (H, W)."""
        inside = edge = self._wide(mask)
        for _ in range(max(1, round(self.stroke))):
            padded = np.pad(inside, 1)
            inside = inside & padded[:-2, 1:-1] & padded[2:, 1:-1]
            inside = inside & padded[1:-1, :-2] & padded[1:-1, 2:]
        self.blend_wide(edge & ~inside, color)

    def blend_wide(self, where: NdArray, color: Color) -> None:
        from PIL import Image

        pixels = np.array(self.base)
        pixels[where] = color
        self.base = Image.fromarray(pixels)

    def _wide(self, array: NdArray) -> NdArray:
        return np.repeat(np.repeat(array, self.scale, axis=0), self.scale, axis=1)

    # ------------------------------------------------------------ lines

    def _at(self, point: Any) -> tuple[float, float]:
        k = self.scale * self._fine
        return float(point[0]) * k, float(point[1]) * k

    def _width(self, strokes: float) -> int:
        return max(1, int(strokes * self.stroke * self._fine + 0.5))

    def path(self, points: Sequence[Any], color: Color, strokes: float = 1.0) -> None:
        """An open line, over a dark casing."""
        at = [self._at(p) for p in points]
        self._draw.line(at, _CASING, self._width(strokes) + self._width(0.8), joint="curve")
        self._draw.line(at, (*color, 255), self._width(strokes), joint="curve")

    def rectangle(self, box: Sequence[float], color: Color) -> None:
        """The box [x0, y0, x1, y1); its line lies inside."""
        (x0, y0), (x1, y1) = self._at(box[:2]), self._at(box[2:])
        width, casing = self._width(1.0), self._width(0.4)
        outer = (x0 - casing, y0 - casing, x1 - 1 + casing, y1 - 1 + casing)
        self._draw.rectangle(outer, outline=_CASING, width=width + 2 * casing)
        self._draw.rectangle((x0, y0, x1 - 1, y1 - 1), outline=(*color, 255), width=width)

    def dashes(self, box: Sequence[float], color: Color) -> None:
        """Draws a box with a dashed line."""
        x0, y0, x1, y1 = (float(v) for v in box)
        dash = 5 * self.stroke / self.scale
        for a, b in (((x0, y0), (x1, y0)), ((x1, y0), (x1, y1)),
                     ((x1, y1), (x0, y1)), ((x0, y1), (x0, y0))):  # fmt: skip
            ends = np.array(a), np.array(b)
            length = float(np.linalg.norm(ends[1] - ends[0]))
            for start in np.arange(0, length, 2 * dash):
                piece = np.clip(np.array([start, start + dash]) / max(length, 1e-9), 0, 1)
                self.path([ends[0] + t * (ends[1] - ends[0]) for t in piece], color, 0.9)

    def arrow(self, start: Any, end: Any, color: Color, strokes: float = 1.0) -> None:
        """A line with a head, which is never longer than the line."""
        (x0, y0), (x1, y1) = self._at(start), self._at(end)
        length = math.hypot(x1 - x0, y1 - y0)
        if length < 1e-6:
            return
        head = min(0.6 * length, self._width(4.5 * strokes))
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        neck = (x1 - ux * head, y1 - uy * head)
        side = (-uy * head * 0.42, ux * head * 0.42)
        tip = [(x1, y1), (neck[0] + side[0], neck[1] + side[1]),
               (neck[0] - side[0], neck[1] - side[1])]  # fmt: skip
        casing = self._width(strokes) + self._width(0.8)
        self._draw.line([(x0, y0), neck], _CASING, casing)
        self._draw.line([*tip, tip[0]], _CASING, self._width(0.8), joint="curve")
        self._draw.line([(x0, y0), neck], (*color, 255), self._width(strokes))
        self._draw.polygon(tip, (*color, 255))

    def disc(self, center: Any, color: Color, *, filled: bool, strokes: float = 2.2) -> None:
        """A dot with a white rim, or a ring."""
        x, y = self._at(center)
        radius, rim = self._width(strokes), self._width(0.7)
        for r, paint in ((radius + 2 * rim, _CASING), (radius + rim, (255, 255, 255, 255))):
            self._draw.ellipse((x - r, y - r, x + r, y + r), fill=paint)
        inner = (*color, 255) if filled else (30, 32, 36, 255)
        self._draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=inner)
        if not filled:
            self._draw.ellipse((x - radius, y - radius, x + radius, y + radius),
                               outline=(*color, 255), width=rim)  # fmt: skip

    # ------------------------------------------------------------ text

    def tag(self, box: Sequence[float], text: str, color: Color) -> None:
        """A name at the first free place about a box: above, inside, below; never off the edge.
        Tags lie over all else."""
        x0, y0, x1, y1 = (float(v) * self.scale for v in box)
        wide, high = self._font.getbbox(text)[2] + 0.8 * self.line, 1.32 * self.line
        places = [(x0, y0 - high - 1), (x0, y0), (x0, y1 + 1), (x0, y1 - high), (x1 - wide, y0)]
        fitted = [self._inside(place, (wide, high)) for place in places]
        spots = [(x, y, x + wide, y + high) for x, y in fitted]
        spot = next((s for s in spots if not self._taken(s)), spots[0])
        self._tags.append((spot, text, color))

    def _inside(self, place: tuple[float, float], size: tuple[float, float]) -> tuple[float, float]:
        x = max(0.0, min(place[0], self.base.width - size[0]))
        y = max(0.0, min(place[1], self.base.height - size[1]))
        return round(x), round(y)

    def _taken(self, box: Box) -> bool:
        return any(
            box[0] < t[2] and t[0] < box[2] and box[1] < t[3] and t[1] < box[3]
            for t, _, _ in self._tags
        )

    def flush(self) -> None:
        """Puts the lines on the picture."""
        if self._layer.getbbox() is None:
            return
        smooth = self._layer.reduce(self._fine)
        self.base.paste(smooth, (0, 0), smooth)
        self._new_layer()

    def finished(self) -> Picture:
        """The picture, with its tags."""
        from PIL import ImageDraw

        self.flush()
        k = self._fine
        for (x0, y0, x1, y1), _, color in self._tags:
            corners = (x0 * k, y0 * k, x1 * k - 1, y1 * k - 1)
            radius = 0.22 * self.line * k
            self._draw.rounded_rectangle(corners, radius=radius, fill=(*color, 255))
        self.flush()
        draw = ImageDraw.Draw(self.base)
        for (x0, y0, _, y1), text, color in self._tags:
            bright = np.array(color) @ np.array([0.2126, 0.7152, 0.0722]) > 110
            top, bottom = self._font.getbbox("Hx")[1::2]
            at = (x0 + 0.4 * self.line, (y0 + y1 - top - bottom) / 2)
            draw.text(at, text, (14, 15, 18) if bright else (255, 255, 255), font=self._font)
        return Picture.of(self.base)
