"""Visuals of the links of a URDF file. Used by urdf.py.

Source: the URDF XML specification of ROS (wiki.ros.org/urdf/XML/visual, version 1.0), and the
capsule of PyBullet.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

from ..errors import HeliographError, Unimplemented
from ._files import Files
from ._notes import FAULTS, Notes
from ._numbers import Numbers
from .description import Look, Visual

_SIZES = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "sphere": ("radius",),
}


_FLAT = 1e-4  # of the largest scale: stands for a scale of 0, as in glTF files
_BRIGHTEST = 2  # a number of a color above it is one of 0 to 255


class Visuals:
    """Materials by their names, and the visuals that have them; a robot without any is seen by
    its collision shapes. left_out: errors of those that are not shown."""

    def __init__(self, notes: Notes, files: Files) -> None:
        self.notes = notes
        self.files = files
        self.numbers = Numbers(notes)
        self.looks: dict[str, Look] = {}
        self.left_out: list[HeliographError] = []

    def define(self, materials: Iterable[Element]) -> None:
        """Materials that visuals may name; the first of a name counts."""
        for material in materials:
            look = self._look(material)
            if look.color is not None or look.texture is not None:
                self.looks.setdefault(look.name, look)

    def of(self, links: Mapping[str, Element]) -> dict[str, list[Visual]]:
        """Visuals of each link that can be shown; collision shapes where the file has no
        <visual>."""
        seen = any(link.find("visual") is not None for link in links.values())
        kind = "visual" if seen else "collision"
        found = {name: self._of(link, kind, f"link {name!r}") for name, link in links.items()}
        if seen and self.left_out and not any(found.values()):
            raise self.left_out[0]
        if not seen and any(found.values()):
            self.notes.warn("has no <visual>; its collision shapes are shown")
        return found

    def _of(self, link: Element, kind: str, where: str) -> list[Visual]:
        found = []
        for element in link.findall(kind):
            try:
                visual = self._visual(element, where)
            except FAULTS as error:
                self.notes.leave_out(error)
                self.left_out.append(error)
                continue
            if visual is not None:
                found.append(visual)
        return found

    def _visual(self, element: Element, where: str) -> Visual | None:
        geometry = element.find("geometry")
        shape = next(iter(geometry), None) if geometry is not None else None
        if shape is None:
            raise self.notes.refusal(f"a <{element.tag}> has no geometry", where)
        origin = self.numbers.origin(element, where)
        visual = Visual(shape.tag, (), origin, look=self._look_of(element))
        if shape.tag == "mesh":
            return self._mesh(shape, visual, where)
        if shape.tag not in _SIZES:
            raise Unimplemented(
                f"{self.notes.path}: {where}: the shape <{shape.tag}> is none of "
                f"{', '.join(_SIZES)}, mesh; use a mesh",
                field="path",
            )
        keys = _SIZES[shape.tag]
        count = 3 if shape.tag == "box" else 1
        size = [n for key in keys for n in self.numbers.several(shape, key, count, where)]
        if min(size) <= 0:
            self.notes.warn(f"{where}: a <{shape.tag}> without size is left out")
            return None
        return replace(visual, size=tuple(size))

    def _mesh(self, mesh: Element, visual: Visual, where: str) -> Visual:
        scale = self._scale(mesh, where)
        if scale.count(0) > 1:
            raise self.notes.refusal("the scale of a mesh is 0 along more than one axis", where)
        x, y, z = (n or _FLAT * max(map(abs, scale)) for n in scale)
        return replace(
            visual, size=(x, y, z), file=self.files.find(mesh.get("filename", ""), where)
        )

    def _scale(self, mesh: Element, where: str) -> list[float]:
        text = mesh.get("scale", "")
        if not text.strip():
            return [1.0, 1.0, 1.0]
        if len(text.replace(",", " ").split()) > 1:
            return self.numbers.several(mesh, "scale", 3, where)
        self.notes.warn(f'{where}: scale="{text}" is taken for all three axes')
        return self.numbers.several(mesh, "scale", 1, where) * 3

    # ------------------------------------------------------------ materials

    def _look_of(self, visual: Element) -> Look | None:
        element = visual.find("material")
        if element is None:
            return None
        look = self._look(element)
        if look.color is not None or look.texture is not None:
            return look
        if look.name and look.name not in self.looks:
            self.notes.warn(f"material {look.name!r} is defined nowhere; it is left out")
        return self.looks.get(look.name)

    def _look(self, element: Element) -> Look:
        name = element.get("name", "")
        where = f"material {name!r}"
        color, texture = element.find("color"), element.find("texture")
        rgba = None if color is None else self._rgba(color, where)
        file = None if texture is None else self._texture(texture, where)
        return Look(name, rgba, file)

    def _texture(self, element: Element, where: str) -> Path | None:
        reference = element.get("filename", "")
        if not reference.strip():  # xacro leaves such, where there is a color alone
            return None
        try:
            return self.files.find(reference, where)
        except FAULTS as error:
            self.notes.leave_out(error)
            return None

    def _rgba(self, color: Element, where: str) -> tuple[float, ...] | None:
        """Within [0, 1], whatever else is written there."""
        text = color.get("rgba", "")
        try:
            if len(text.replace(",", " ").split()) == 3:
                rgba = [*self.numbers.several(color, "rgba", 3, where), 1.0]
            else:
                rgba = self.numbers.several(color, "rgba", 4, where)
        except FAULTS as error:
            self.notes.leave_out(error)
            return None
        *rgb, alpha = rgba
        if max(rgb) > _BRIGHTEST:
            self.notes.warn(f'{where}: rgba="{text}" is taken to go up to 255')
            rgba = [n / 255 for n in (*rgb, alpha if alpha > 1 else 255 * alpha)]
        if min(rgba) < 0 or max(rgba) > 1:
            self.notes.warn(f'{where}: rgba="{text}" has numbers outside [0, 1]; they are clamped')
        return tuple(min(max(n, 0.0), 1.0) for n in rgba)
