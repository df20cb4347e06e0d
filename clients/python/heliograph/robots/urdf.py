"""URDF files: links, joints and what is to be seen of them. Used by robots.py.

Source: the URDF XML specification of ROS (wiki.ros.org/urdf/XML, version 1.0).
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from .._wire.arrays import NdArray
from ..errors import InvalidArgument, NotFound, Unimplemented
from ..values.pose import rotation_of_euler
from . import _xml

ONE_AXIS = ("revolute", "continuous", "prismatic")
KINDS = (*ONE_AXIS, "fixed", "floating", "planar")
_SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}


@dataclass(frozen=True)
class Look:
    """A material: color RGBA as it is shown (sRGB), and the file of a texture."""

    name: str
    color: tuple[float, ...] | None = None
    texture: Path | None = None


@dataclass(frozen=True, eq=False)
class Visual:
    """What is to be seen of a link. shape: "box" (x, y, z), "cylinder" (radius, length), "sphere"
    (radius,) or "mesh" (scale in x, y, z). origin: (4, 4) link_from_visual."""

    shape: str
    size: tuple[float, ...]
    origin: NdArray
    file: Path | None = None
    look: Look | None = None


@dataclass(frozen=True)
class Mimic:
    """value = multiplier * value of `joint` + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """origin: (4, 4) parent_from_joint. axis: (3,) unit, in the joint's frame. lower, upper:
    radians or metres."""

    name: str
    kind: str
    parent: str
    child: str
    origin: NdArray
    axis: NdArray
    lower: float = -math.inf
    upper: float = math.inf
    mimic: Mimic | None = None


@dataclass(frozen=True, eq=False)
class Urdf:
    """A robot as its file describes it. links: names, parents first; joints in the file's order."""

    name: str
    links: list[str]
    visuals: dict[str, list[Visual]]
    joints: list[Joint]
    warnings: list[str] = field(default_factory=list)


def read(path: str | os.PathLike[str], packages: Mapping[str, str | os.PathLike[str]]) -> Urdf:
    """Parses a file. packages: folders by the names in package:// references."""
    return _Reader(Path(path), packages).robot()


class _Reader:
    def __init__(self, path: Path, packages: Mapping[str, str | os.PathLike[str]]) -> None:
        self.path = path
        self.packages = {name: Path(folder).resolve() for name, folder in packages.items()}
        self.folder = path.parent.resolve()
        self.looks: dict[str, Look] = {}
        self.warnings: list[str] = []

    def robot(self) -> Urdf:
        root = _xml.read(self.path)
        self._refuse_xacro(root)
        if root.tag != "robot":
            raise self._refusal(f"the root element is <{root.tag}>, not <robot>; is it URDF?")
        for material in [*root.findall("material"), *root.findall("link/visual/material")]:
            look = self._look(material)
            if look.color is not None or look.texture is not None:
                self.looks.setdefault(look.name, look)
        links = self._named(root, "link")
        visuals = {name: self._visuals(link, name) for name, link in links.items()}
        joints = [self._joint(e, name) for name, e in self._named(root, "joint").items()]
        order = self._parents_first(list(links), joints)
        self._check_mimics({joint.name: joint for joint in joints})
        name = root.get("name") or self.path.stem
        return Urdf(name, order, visuals, joints, self.warnings)

    def _refusal(self, message: str, where: str = "") -> InvalidArgument:
        at = f"{self.path}: {where}: " if where else f"{self.path}: "
        return InvalidArgument(at + message, field="path")

    def _refuse_xacro(self, root: Element) -> None:
        def is_xacro(element: Element) -> bool:
            macro = element.tag.startswith("xacro:")
            return macro or any("${" in v or "$(" in v for v in element.attrib.values())

        if self.path.suffix == ".xacro" or any(map(is_xacro, root.iter())):
            raise InvalidArgument(
                f"{self.path} is xacro, a template of URDF: expand it first, with "
                f"`xacro {self.path.name} > {self.path.name.split('.')[0]}.urdf`",
                field="path",
            )

    def _named(self, root: Element, tag: str) -> dict[str, Element]:
        out: dict[str, Element] = {}
        for element in root.findall(tag):
            name = element.get("name", "")
            if not name or name in out:
                raise self._refusal(f"{name!r} is empty or taken; name each {tag}", f"a <{tag}>")
            out[name] = element
        if tag == "link" and not out:
            raise self._refusal("has no <link>")
        return out

    # ------------------------------------------------------------ numbers

    def _numbers(self, element: Element | None, key: str, count: int, where: str) -> list[float]:
        text = element.get(key) if element is not None else None
        if text is None:
            raise self._refusal(f"{key} is missing", where)
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            raise self._refusal(f'{key}="{text[:60]}" holds no numbers', where) from None
        if len(numbers) != count or not all(map(math.isfinite, numbers)):
            raise self._refusal(f'{key}="{text[:60]}" needs {count} finite numbers', where)
        return numbers

    def _number(self, element: Element, key: str, default: float, where: str) -> float:
        if element.get(key) is None:
            return default
        return self._numbers(element, key, 1, where)[0]

    def _origin(self, element: Element, where: str) -> NdArray:
        out = np.eye(4)
        origin = element.find("origin")
        if origin is None:
            return out
        if origin.get("xyz") is not None:
            out[:3, 3] = self._numbers(origin, "xyz", 3, where)
        if origin.get("rpy") is not None:
            out[:3, :3] = rotation_of_euler(np.array(self._numbers(origin, "rpy", 3, where)))
        return out

    # ------------------------------------------------------------ what is to be seen

    def _visuals(self, link: Element, name: str) -> list[Visual]:
        where = f"link {name!r}"
        found = [self._visual(element, where) for element in link.findall("visual")]
        return [visual for visual in found if visual is not None]

    def _visual(self, element: Element, where: str) -> Visual | None:
        geometry = element.find("geometry")
        shape = next(iter(geometry), None) if geometry is not None else None
        if shape is None:
            raise self._refusal("a <visual> has no geometry", where)
        visual = Visual(shape.tag, (), self._origin(element, where), look=self._look_of(element))
        if shape.tag == "mesh":
            scale = (1.0, 1.0, 1.0)
            if shape.get("scale") is not None:
                x, y, z = self._numbers(shape, "scale", 3, where)
                scale = (x, y, z)
            if 0 in scale:
                raise self._refusal("the scale of a mesh is 0", where)
            file = self._file(shape.get("filename", ""), where)
            return replace(visual, size=scale, file=file)
        if shape.tag not in _SIZES:
            raise Unimplemented(
                f"{self.path}: {where}: the shape <{shape.tag}> is none of "
                f"{', '.join(_SIZES)}, mesh; use a mesh",
                field="path",
            )
        keys = _SIZES[shape.tag]
        count = 3 if shape.tag == "box" else 1
        size = [n for key in keys for n in self._numbers(shape, key, count, where)]
        if min(size) <= 0:
            self._warn(f"{where}: a <{shape.tag}> without size is left out")
            return None
        return replace(visual, size=tuple(size))

    def _look(self, element: Element) -> Look:
        name = element.get("name", "")
        where = f"material {name!r}"
        color, texture = element.find("color"), element.find("texture")
        rgba = None
        if color is not None:
            rgba = tuple(self._numbers(color, "rgba", 4, where))
            if min(rgba) < 0 or max(rgba) > 1:
                raise self._refusal("rgba has numbers outside [0, 1]", where)
        file = None
        if texture is not None:
            file = self._file(texture.get("filename", ""), where)
        return Look(name, rgba, file)

    def _look_of(self, visual: Element) -> Look | None:
        element = visual.find("material")
        if element is None:
            return None
        look = self._look(element)
        if look.color is not None or look.texture is not None:
            return look
        if look.name and look.name not in self.looks:
            self._warn(f"material {look.name!r} is defined nowhere; it is left out")
        return self.looks.get(look.name)

    def _warn(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)

    # ------------------------------------------------------------ files

    def _file(self, reference: str, where: str) -> Path:
        scheme, _, rest = reference.rpartition("://")
        if not rest:
            raise self._refusal("a filename is missing", where)
        if scheme in ("package", "model"):
            package, _, within = rest.partition("/")
            path = self._package(package, where) / within
        elif scheme in ("", "file"):
            path = self.folder / rest
        else:
            raise self._refusal(f"{reference!r}: only files are read; download it", where)
        path = path.resolve()
        roots = [self.folder, *self.packages.values(), *self._own_package()]
        if not any(root in path.parents for root in roots):
            raise self._refusal(
                f"{reference!r} lies outside the file's own folder and package; allow its folder "
                f'with packages={{"meshes": {str(path.parent)!r}}}',
                where,
            )
        if not path.is_file():
            raise NotFound(f"{self.path}: {where}: no file {path}", field="path")
        return path

    def _own_package(self) -> list[Path]:
        """The ROS package that the file is in."""
        above = (self.folder, *self.folder.parents)
        return [folder for folder in above if (folder / "package.xml").is_file()][:1]

    def _package(self, name: str, where: str) -> Path:
        if name in self.packages:
            return self.packages[name]
        for folder in (self.folder, *self.folder.parents):
            for found in (folder, folder / name):
                if found.name == name and found.is_dir():
                    self.packages[name] = found
                    return found
        raise NotFound(
            f"{self.path}: {where}: where package {name!r} is, is not known: give "
            f'packages={{"{name}": "its folder"}}',
            field="packages",
        )

    # ------------------------------------------------------------ joints

    def _joint(self, element: Element, name: str) -> Joint:
        where = f"joint {name!r}"
        kind = element.get("type", "")
        if kind not in KINDS:
            raise self._refusal(f"type {kind!r} is none of {', '.join(KINDS)}", where)
        ends = []
        for tag in ("parent", "child"):
            end = element.find(tag)
            if end is None or not end.get("link"):
                raise self._refusal(f"has no <{tag} link=...>", where)
            ends.append(end.get("link", ""))
        joint = Joint(
            *(name, kind, ends[0], ends[1]),
            origin=self._origin(element, where),
            axis=self._axis(element, where),
        )
        if kind in ("revolute", "prismatic"):
            lower, upper = self._limits(element, where)
            joint = replace(joint, lower=lower, upper=upper)
        mimic = element.find("mimic")
        if mimic is None:
            return joint
        factors = [self._number(mimic, k, d, where) for k, d in (("multiplier", 1), ("offset", 0))]
        return replace(joint, mimic=Mimic(mimic.get("joint", ""), *factors))

    def _axis(self, element: Element, where: str) -> NdArray:
        axis = element.find("axis")
        if axis is None:
            return np.array([1.0, 0.0, 0.0])
        xyz = np.array(self._numbers(axis, "xyz", 3, where))
        length = float(np.linalg.norm(xyz))
        if length == 0:
            if element.get("type") in ("fixed", "floating"):
                return np.array([1.0, 0.0, 0.0])
            raise self._refusal("its axis has length 0", where)
        return np.asarray(xyz / length)

    def _limits(self, element: Element, where: str) -> tuple[float, float]:
        limit = element.find("limit")
        if limit is None:
            self._warn(f"{where} has no <limit>; it moves without limits")
            return -math.inf, math.inf
        lower, upper = (self._number(limit, key, 0.0, where) for key in ("lower", "upper"))
        if lower > upper:
            self._warn(f"{where} has a lower limit above its upper one; it moves without limits")
            return -math.inf, math.inf
        return lower, upper

    def _parents_first(self, links: list[str], joints: list[Joint]) -> list[str]:
        above: dict[str, str] = {}
        known = set(links)
        for joint in joints:
            for link in (joint.parent, joint.child):
                if link not in known:
                    raise self._refusal(f"there is no link {link!r}", f"joint {joint.name!r}")
            if joint.child in above:
                raise self._refusal("has more than one joint above it", f"link {joint.child!r}")
            above[joint.child] = joint.parent
        roots = [link for link in links if link not in above]
        if len(roots) != 1:
            raise self._refusal(f"needs one link without a parent, has {roots or 'a cycle'}")
        below: dict[str, list[str]] = {link: [] for link in links}
        for link in links:
            if link in above:
                below[above[link]].append(link)
        order = list(_from(roots[0], below))
        if len(order) < len(links):
            raise self._refusal("is in a cycle", f"link {min(known.difference(order))!r}")
        return order

    def _check_mimics(self, joints: Mapping[str, Joint]) -> None:
        for joint in joints.values():
            seen = [joint.name]
            at = joint
            while at.mimic is not None:
                where = f"joint {at.name!r}"
                if at.mimic.joint not in joints:
                    raise self._refusal(f"it mimics {at.mimic.joint!r}, which is no joint", where)
                at = joints[at.mimic.joint]
                if at.name in seen:
                    raise self._refusal(f"mimics itself, by way of {', '.join(seen)}", where)
                seen.append(at.name)
                if at.kind not in ONE_AXIS or joint.kind not in ONE_AXIS:
                    raise self._refusal(f"mimics {at.name!r}: both need one axis", where)


def _from(root: str, below: Mapping[str, list[str]]) -> Iterator[str]:
    """A link and all below it, parents first, depth first."""
    waiting = [root]
    while waiting:
        link = waiting.pop()
        yield link
        waiting.extend(reversed(below[link]))
