"""Draw: what a randomizer gets, and Compose. Made by generate(), used by every randomizer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from .._arrays import NdArray
from ..errors import InvalidArgument
from ..handles import Handle, Named, flatten
from ..pose import matrices_of
from .bodies import Bodies

if TYPE_CHECKING:
    from ..edit import Edits
    from ..robots import Robot
    from ..scene import Scene

_DRAW, _RENDER = 0, 1  # first number of a key: what the numbers are for


class Draw:
    """One draw from the randomizers: an overlay under way, and the numbers to draw it from.

    scene: for reading and queries; it stays as it is. edit: the overlay, an hg.Edits.
    rng: a np.random.Generator of this randomizer and draw alone. index: of the draw, from 0: with
    one camera the image's index. attempt: from 0, how many draws of this index were rejected.
    cameras: handles; camera: the first one. seed: the data set's.
    """

    rng: np.random.Generator

    def __init__(
        self, base: BasePoses, cameras: Sequence[Handle], key: tuple[int, int, int], edit: Edits
    ) -> None:
        self.scene: Scene = base.scene
        self.edit = edit
        self.cameras = list(cameras)
        self.seed, self.index, self.attempt = key
        self.rng = self._rng(())
        self._path: tuple[int, ...] = ()
        self._base = base
        self._placed: dict[Any, NdArray] = {}
        self._made: dict[str, int] = {}

    @property
    def camera(self) -> Handle:
        return self.cameras[0]

    def _rng(self, path: tuple[int, ...]) -> np.random.Generator:
        key = (_DRAW, self.index, self.attempt, *path)
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=key))

    @contextmanager
    def within(self, position: int) -> Iterator[None]:
        """While it lasts, rng is one of its own, keyed by (seed, index, attempt, position); of a
        Compose within another by both positions."""
        path, rng = self._path, self.rng
        self._path = (*path, position)
        self.rng = self._rng(self._path)
        try:
            yield
        finally:
            self._path, self.rng = path, rng

    def pose(self, entity: Named) -> NdArray:
        """(4, 4) float64 world_from_local as drawn so far: what place() set, else the scene's.

        What other edits of the overlay did to it is not seen.
        """
        key = self._key(entity)
        local, parent = self._base.of(key)
        local = self._placed.get(key, local)
        return local.copy() if not parent else self.pose(self._base.handle(parent)) @ local

    def place(self, entities: Any, poses: Any) -> None:
        """Sets world poses: (N, 4, 4), or a sequence of hg.Pose and 4x4, for as many entities."""
        listed = flatten(entities, "entities")
        matrices = np.asarray(matrices_of(poses, "poses"), dtype="f8")
        if len(listed) != len(matrices):
            raise InvalidArgument(
                f"poses: {len(matrices)} for {len(listed)} entities; give as many", field="poses"
            )
        if listed:
            relative = self.locals(listed, matrices)
            self._placed.update(zip([self._key(entity) for entity in listed], relative))
            self.edit.set_transforms(listed, relative)

    def set_joints(self, robot: Robot, values: Any, *, clamp: bool = False) -> None:
        """Moves the joints of a robot, as edit.set_joints() with all values, (C,); pose() of its
        links knows."""
        relative = robot.transforms(values, clamp=clamp)
        self._placed.update(zip([self._key(link) for link in robot.moving], relative))
        self.edit.set_transforms(robot.moving, relative)

    def locals(self, entities: Sequence[Named], poses: Any) -> NdArray:
        """(N, 4, 4) poses relative to the parents, as drawn so far, of world poses."""
        keys = [self._key(entity) for entity in entities]
        self._base.learn(key for key in keys if isinstance(key, int))
        return np.stack([self._local(key, pose) for key, pose in zip(keys, poses)])

    def fresh(self, prefix: str) -> str:
        """prefix/0, prefix/1 ...: a name that no other randomizer of this draw gives."""
        number = self._made.get(prefix, 0)
        self._made[prefix] = number + 1
        return f"{prefix}/{number}"

    @property
    def bodies(self) -> Bodies:
        """Shapes of the scene's entities."""
        return self._base.bodies

    def mark(self) -> Any:
        """What was drawn so far, for rewind()."""
        return len(self.edit.transaction.edits), dict(self._placed), dict(self._made)

    def rewind(self, mark: Any) -> None:
        """Takes back all that was drawn since that mark(), but for the numbers of rng."""
        edits, placed, made = mark
        del self.edit.transaction.edits[edits:]
        self._placed, self._made = dict(placed), dict(made)

    def _local(self, key: Any, world: NdArray) -> NdArray:
        _, parent = self._base.of(key)
        if not parent:
            return world
        return np.asarray(np.linalg.inv(self.pose(self._base.handle(parent))) @ world)

    def _key(self, entity: Named) -> Any:
        """The id of an entity of the scene; of one that this draw made, its handle's."""
        if isinstance(entity, str):
            return self._base.scene[entity].id
        if not isinstance(entity, Handle):
            raise InvalidArgument(
                f"entity: needs a handle or a name, not {type(entity).__name__}", field="entity"
            )
        return ("made", id(entity)) if entity._edits is self.edit else entity.id


class BasePoses:
    """Poses of the scene that all draws start from, asked for once. Thread: one at a time."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.bodies = Bodies(scene)
        self._known: dict[Any, tuple[NdArray, int]] = {}

    def of(self, key: Any) -> tuple[NdArray, int]:
        """((4, 4) parent_from_local, id of the parent or 0); of what a draw made, the identity."""
        if not isinstance(key, int):
            return np.eye(4), 0
        self.learn([key])
        return self._known[key]

    def learn(self, keys: Any) -> None:
        """Asks for those that are not known, in one call."""
        unknown = [key for key in dict.fromkeys(keys) if key not in self._known]
        if not unknown:
            return
        rows = self.scene.read([self.handle(key) for key in unknown], ["pose", "entity"])
        for key, (pose, message) in zip(unknown, rows):
            ref = message.entity.parent
            parent = self.scene.resolve(ref.name) if ref.name else int(ref.id)
            self._known[key] = np.asarray(pose, dtype="f8"), parent

    def handle(self, key: int) -> Handle:
        found: Handle = self.scene.handle(key)
        return found


class Compose:
    """Runs randomizers in order, each with an rng of its own: what one of them draws does not
    depend on how many numbers another one took. A randomizer is any callable (draw) -> None."""

    def __init__(self, *randomizers: Callable[[Draw], Any]) -> None:
        for position, randomizer in enumerate(randomizers):
            if not callable(randomizer):
                raise InvalidArgument(
                    f"randomizers[{position}]: {randomizer!r} is no callable (draw) -> None",
                    field=f"randomizers[{position}]",
                )
        self.randomizers = randomizers

    def __call__(self, draw: Draw) -> None:
        for position, randomizer in enumerate(self.randomizers):
            with draw.within(position):
                randomizer(draw)

    def __repr__(self) -> str:
        return f"Compose({', '.join(map(repr, self.randomizers))})"


def render_seed(seed: int, draw: int) -> int:
    """The seed of the pictures of a draw, 64 bits. Cameras share it, as they share the scene."""
    sequence = np.random.SeedSequence(seed, spawn_key=(_RENDER, draw))
    return int(sequence.generate_state(1, np.uint64)[0])
