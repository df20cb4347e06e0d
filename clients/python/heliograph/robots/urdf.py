"""URDF files: links, joints and visuals. Used by robots.py.

Source: the URDF XML specification of ROS (wiki.ros.org/urdf/XML, version 1.0), and PyBullet's
spherical joint.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from .._wire.arrays import NdArray
from . import _mimics, _xacro, _xml
from ._files import Files
from ._notes import Notes
from ._numbers import Numbers
from ._visuals import Visuals
from .description import KINDS, Joint, Mimic, RobotModel


def read(
    path: str | os.PathLike[str],
    packages: Mapping[str, str | os.PathLike[str]],
    strict: bool = False,
) -> RobotModel:
    """Parses a file. packages: folders by the names in package:// references. strict: refuses what
    is warned of otherwise."""
    return _Reader(Notes(Path(path), strict), packages).robot()


class _Reader:
    def __init__(self, notes: Notes, packages: Mapping[str, str | os.PathLike[str]]) -> None:
        self.notes = notes
        self.numbers = Numbers(notes)
        self.files = Files(notes, packages)
        self.visuals = Visuals(notes, self.files)

    def robot(self) -> RobotModel:
        root = _xml.read(self.notes.path)
        _xacro.settle(root, self.notes)
        if root.tag != "robot":
            raise self.notes.refusal(f"the root element is <{root.tag}>, not <robot>; is it URDF?")
        self.visuals.define([*root.findall("material"), *root.findall("link/visual/material")])
        links = self._named(root, "link")
        visuals = self.visuals.of(links)
        found = {name: self._joint(e, name) for name, e in self._named(root, "joint").items()}
        joints = _mimics.settled(found, self.notes)
        order = self._parents_first(list(links), joints)
        name = root.get("name") or self.notes.path.stem
        return RobotModel(name, order, visuals, joints, self.files.roots(), self.notes.warnings)

    def _named(self, root: Element, tag: str) -> dict[str, Element]:
        out: dict[str, Element] = {}
        for element in root.findall(tag):
            name = element.get("name", "")
            if not name or name in out:
                raise self.notes.refusal(
                    f"{name!r} is empty or taken; name each {tag}", f"a <{tag}>"
                )
            out[name] = element
        if tag == "link" and not out:
            raise self.notes.refusal("has no <link>")
        return out

    def _joint(self, element: Element, name: str) -> Joint:
        where = f"joint {name!r}"
        kind = element.get("type", "")
        if kind not in KINDS:
            raise self.notes.refusal(f"type {kind!r} is none of {', '.join(KINDS)}", where)
        ends = []
        for tag in ("parent", "child"):
            end = element.find(tag)
            if end is None or not end.get("link"):
                raise self.notes.refusal(f"has no <{tag} link=...>", where)
            ends.append(end.get("link", ""))
        joint = Joint(
            *(name, kind, ends[0], ends[1]),
            origin=self.numbers.origin(element, where),
            axis=self._axis(element, where),
        )
        if kind in ("revolute", "prismatic"):
            lower, upper = self._limits(element, where)
            joint = replace(joint, lower=lower, upper=upper)
        mimic = element.find("mimic")
        if mimic is None:
            return joint
        multiplier, offset = (
            self.numbers.one(mimic, key, default, where)
            for key, default in (("multiplier", 1), ("offset", 0))
        )
        return replace(joint, mimic=Mimic(mimic.get("joint", ""), multiplier, offset))

    def _axis(self, element: Element, where: str) -> NdArray:
        default = np.array([1.0, 0.0, 0.0])
        axis = element.find("axis")
        if axis is None or element.get("type") in ("fixed", "floating", "spherical"):
            return default
        xyz = np.array(self.numbers.several(axis, "xyz", 3, where))
        length = float(np.linalg.norm(xyz))
        if length == 0:
            raise self.notes.refusal("its axis has length 0", where)
        return np.asarray(xyz / length)

    def _limits(self, element: Element, where: str) -> tuple[float, float]:
        limit = element.find("limit")
        if limit is None or not {"lower", "upper"} & set(limit.keys()):
            self.notes.warn(f"{where} has no limits; it moves without them")
            return -math.inf, math.inf
        lower, upper = (self.numbers.bound(limit, key, where) for key in ("lower", "upper"))
        if lower > upper:
            self.notes.warn(
                f"{where} has a lower limit above its upper one; it moves without limits"
            )
            return -math.inf, math.inf
        return lower, upper

    def _parents_first(self, links: list[str], joints: list[Joint]) -> list[str]:
        above: dict[str, str] = {}
        known = set(links)
        for joint in joints:
            for link in (joint.parent, joint.child):
                if link not in known:
                    raise self.notes.refusal(f"there is no link {link!r}", f"joint {joint.name!r}")
            if joint.child in above:
                raise self.notes.refusal(
                    "has more than one joint above it", f"link {joint.child!r}"
                )
            above[joint.child] = joint.parent
        roots = [link for link in links if link not in above]
        if len(roots) != 1:
            raise self.notes.refusal(f"needs one link without a parent, has {roots or 'a cycle'}")
        below: dict[str, list[str]] = {link: [] for link in links}
        for link in links:
            if link in above:
                below[above[link]].append(link)
        order = list(_from(roots[0], below))
        if len(order) < len(links):
            raise self.notes.refusal("is in a cycle", f"link {min(known.difference(order))!r}")
        return order


def _from(root: str, below: Mapping[str, list[str]]) -> Iterator[str]:
    """A link and all below it, parents first, depth first."""
    waiting = [root]
    while waiting:
        link = waiting.pop()
        yield link
        waiting.extend(reversed(below[link]))
