"""Distractors: shapes that fly about and are no class. See also Scatter and InVolume."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray
from ...scene.handles import Group, flatten
from ...values.checks import whole_of
from ..bodies import box_of, middle
from ..tries import gave_up
from . import ranges
from .looks import RandomMaterials
from .props import random_shape
from .ranges import LogUniform, Range

if TYPE_CHECKING:
    from ...client.edit import Edits
    from ..draw import Draw

_SIZE = LogUniform(0.03, 0.15)


def add_distractors(edit: Edits, count: int = 24, *, seed: int = 0) -> Group:
    """Entities "distractor/0" ..: bundled shapes 1 m long, each with a material of its own, without
    labels and invisible until Distractors chooses them. The seed determines them."""
    rng = np.random.default_rng(seed)
    made = []
    for i in range(whole_of(count, "count")):
        name = f"distractor/{i}"
        mesh = edit.mesh(f"{name}/mesh", **random_shape(rng, 24))
        material = edit.material(f"{name}/material", base_color=0.5)
        made.append(edit.entity(name, mesh=mesh, material=material, label=0, visible=False))
    return Group(made, "distractor")


class Distractors:
    """Lets some of the distractors fly about a target, with any rotation, size and material.

    things: of add_distractors(), or any entities; the others become invisible. around: a point
    (3,), or entities, for the middle of their box. count: their number, whole or (low, high).
    radius: metres, (inner, outer) of the shell that they are in, uniform by volume. size: metres of
    the longest side of a thing that is 1 m long as it is. clear_of: entities; the balls about
    distractors keep out of their world boxes, and out of each other, and four sizes from the draw's
    cameras: so place those first. materials: parameters of their RandomMaterials.
    """

    def __init__(
        self,
        things: Any,
        around: Any,
        *,
        count: Any = (5, 20),
        radius: tuple[float, float] = (0.1, 1.0),
        size: Range = _SIZE,
        clear_of: Any = (),
        materials: Any = None,
    ) -> None:
        self.things, self.around, self.clear_of = things, around, clear_of
        self.count = ranges.checked_count(count, "count")
        self.radius = ranges.checked_pair(radius, "radius", 0)
        self.size = ranges.checked_range(size, "size", 1e-9)
        self.materials = {} if materials is None else dict(materials)

    def __call__(self, draw: Draw) -> None:
        rng, things = draw.rng, flatten(self.things, "things")
        order = rng.permutation(len(things))
        count = min(ranges.whole(rng, self.count), len(things))
        chosen = [things[i] for i in order[:count]]
        around = middle(draw, self.around, "around")
        kept_clear = draw.bodies.of(self.clear_of, "clear_of")
        boxes = [box_of(body.world(draw.pose(body.root))) for body in kept_clear]
        cameras = [draw.pose(camera)[:3, 3] for camera in draw.cameras]
        balls: list[tuple[NdArray, float]] = []
        poses = []
        for _ in chosen:
            size = ranges.number(rng, self.size)
            place = self._place(rng, around, 0.87 * size, (boxes, cameras, balls))
            balls.append((place, 0.87 * size))  # half the diagonal of a cube
            pose = np.eye(4)
            pose[:3, :3] = size * ranges.rotation(rng)
            pose[:3, 3] = place
            poses.append(pose)
        draw.place(chosen, poses)
        for i, thing in enumerate(things):
            visible = bool((order[:count] == i).any())
            draw.edit.update(thing, visible=visible)
        self._dress(draw, chosen)

    def _dress(self, draw: Draw, chosen: list[Any]) -> None:
        own = [draw.bodies.material_of(thing) for thing in chosen]
        RandomMaterials(
            [thing if material is None else material for thing, material in zip(chosen, own)],
            **self.materials,
        )(draw)

    def _place(
        self, rng: np.random.Generator, around: NdArray, radius: float, taken: Any
    ) -> NdArray:
        boxes, cameras, balls = taken
        inner, outer = self.radius
        for _ in range(1000):
            distance = rng.uniform(inner**3, outer**3) ** (1 / 3)
            point = np.asarray(around + distance * ranges.direction(rng))
            in_box = any(_gap(point, box) < radius for box in boxes)
            in_ball = any(np.linalg.norm(point - p) < radius + r for p, r in balls)
            before = any(np.linalg.norm(point - camera) < 4.6 * radius for camera in cameras)
            if not (in_box or in_ball or before):
                return point
        raise gave_up(
            "distractors: found no free place in 1000 tries; give a larger radius=, or a smaller "
            "size= or count=",
            "count",
            1000,
        )


def _gap(point: NdArray, box: tuple[NdArray, NdArray]) -> float:
    gap = np.maximum(0, np.maximum(box[0] - point, point - box[1]))
    return float(np.linalg.norm(gap))
