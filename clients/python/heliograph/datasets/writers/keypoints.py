"""Keypoints and skeleton of each class, and places of those of an image. Used by writers."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._wire.arrays import NdArray, from_message
from ...errors import FailedPrecondition
from ..writer import Dataset

if TYPE_CHECKING:
    from ...client.scene import Scene

OUTSIDE, VISIBLE = 0, 3  # of the column keypoint_state; between them: hidden by itself or others


@dataclass(frozen=True)
class Skeleton:
    """names: of a class's keypoints, in order; edges: pairs of indices into them."""

    names: tuple[str, ...]
    edges: tuple[tuple[int, int], ...]


def skeletons_of(dataset: Dataset) -> dict[int, Skeleton]:
    """Skeleton of each class with keypoints, by its id. FailedPrecondition where two instances of a
    class have other names, or nothing has keypoints."""
    labels = dataset.scene.render(dataset.cameras[0], planes=[], labels={"keypoints": True}).labels
    found: dict[int, Skeleton] = {}
    points = Keypoints(labels)
    for row, label in enumerate(labels["label"]):
        category = int(labels["category"][row])
        names = points.names(int(label))
        if not names or not category:
            continue
        if category not in found:
            edges = _edges(dataset.scene, int(labels["entity"][row]), names)
            edges += _edges_across(labels["attributes"][row], names)
            found[category] = Skeleton(names, edges)
        _check(names, found[category], str(labels["name"][row]))
    if not found:
        raise FailedPrecondition(
            "no instance with a category has keypoints: give meshes keypoints={name: (3,)}"
        )
    return found


def _check(names: tuple[str, ...], skeleton: Skeleton, instance: str) -> None:
    if names != skeleton.names:
        raise FailedPrecondition(
            f"{instance} has the keypoints {', '.join(names)}, others of its category "
            f"{', '.join(skeleton.names)}: give it a category of its own"
        )


def _edges(scene: Scene, root: int, names: tuple[str, ...]) -> tuple[tuple[int, int], ...]:
    """Edges of the skeletons of the meshes of an entity and its descendants, by the keypoints'
    names."""
    place = {name: i for i, name in enumerate(names)}
    edges = []
    for mesh in _meshes(scene, root):
        message = scene.read([scene.handle(mesh)], ["mesh"])[0][0].mesh
        own = [point.name for point in message.keypoints]
        if message.HasField("skeleton"):
            pairs = from_message(message.skeleton).tolist()
            edges += [(place[own[a]], place[own[b]]) for a, b in pairs]
    return tuple(edges)


def _edges_across(attributes: str, names: tuple[str, ...]) -> tuple[tuple[int, int], ...]:
    """Edges between keypoints of several meshes, by the attribute `skeleton` of an instance: JSON,
    pairs of names. Robots have it. FailedPrecondition."""
    text = json.loads(attributes or "{}").get("skeleton", "[]")
    try:
        return tuple((names.index(a), names.index(b)) for a, b in json.loads(text))
    except (TypeError, ValueError) as error:
        raise FailedPrecondition(
            f'the attribute skeleton is "{text}": it needs pairs of the names of keypoints in JSON'
        ) from error


def _meshes(scene: Scene, root: int) -> Iterator[int]:
    below = {root}
    for found in scene.describe(tree=True).objects:  # parents have no order among their children
        if found.parent in below:
            below.add(found.id)
    entities = sorted(below)
    rows = scene.read([scene.handle(entity) for entity in entities], ["entity"])
    for (message,) in rows:
        ref = message.entity.mesh
        mesh = scene.resolve(ref.name) if ref.name else int(ref.id)
        if mesh:
            yield mesh


class Keypoints:
    """The keypoints of an image, by instance."""

    def __init__(self, labels: Mapping[str, Any]) -> None:
        self._labels = labels
        owners = labels["keypoint_instance"]
        self._rows = {int(label): np.flatnonzero(owners == label) for label in np.unique(owners)}

    def names(self, label: int) -> tuple[str, ...]:
        return tuple(self._labels["keypoint_name"][i] for i in self._rows.get(label, ()))

    def of(self, label: int, skeleton: Skeleton) -> tuple[NdArray, NdArray]:
        """((K, 2) K coordinates, (K,) states) of an instance with that skeleton."""
        _check(self.names(label), skeleton, f"the instance {label}")
        rows = self._rows[label]
        return self._labels["keypoint_image"][rows], self._labels["keypoint_state"][rows]
