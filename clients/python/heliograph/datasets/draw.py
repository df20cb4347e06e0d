"""Draw, the argument of a randomizer, and Compose. Made by generate(), used by every randomizer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire.arrays import NdArray, from_message
from ..errors import InvalidArgument
from ..scene.handles import Handle, Named, flatten
from ..values.pose import matrices_of
from .bodies import Bodies

if TYPE_CHECKING:
    from .._wire._proto import scene_pb2 as pb
    from .._wire._proto import types_pb2 as types
    from ..client.edit import Edits
    from ..client.scene import Scene
    from ..robots.robot import Robot

_DRAW, _RENDER = 0, 1  # first number of a key: the purpose of the numbers


class Draw:
    """Draw from the randomizers: an overlay under way, and the numbers to draw it from.

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
        self._rngs: dict[tuple[int, ...], np.random.Generator] = {}
        self._path: tuple[int, ...] = ()
        self.rng = self._rng(self._path)
        self._base = base
        self._placed: dict[Any, NdArray | None] = {}  # relative to the parent; None: not known
        self._parents: dict[Any, Any] = {}  # that the overlay gave
        self._followed = 0  # how many of its edits these two know
        self._made: dict[str, int] = {}

    @property
    def camera(self) -> Handle:
        return self.cameras[0]

    def _rng(self, path: tuple[int, ...]) -> np.random.Generator:
        """Generator of a path, one per draw: a second call of the path goes on with its numbers."""
        if path not in self._rngs:
            key = (_DRAW, self.index, self.attempt, *path)
            sequence = np.random.SeedSequence(self.seed, spawn_key=key)
            self._rngs[path] = np.random.default_rng(sequence)
        return self._rngs[path]

    @contextmanager
    def within(self, position: int) -> Iterator[None]:
        """Within the block, makes rng one of its own, keyed by (seed, index, attempt, position); in
        a Compose within another, by both positions. The next block goes on with its numbers."""
        path, rng = self._path, self.rng
        self._path = (*path, position)
        self.rng = self._rng(self._path)
        try:
            yield
        finally:
            self._path, self.rng = path, rng

    def pose(self, entity: Named) -> NdArray:
        """(4, 4) float64 world_from_local as drawn so far: set by place(), set_joints(), and
        transform= and parent= of edits, else the scene's.

        For the scene's own entities, keys= and set_transforms() of edits are not seen.
        InvalidArgument for an entity made with keys= or more than 1 MiB of transforms=: place() it.
        """
        self._follow()
        return self._world(self._key(entity), {}).copy()

    def place(self, entities: Any, poses: Any) -> None:
        """Sets world poses: (N, 4, 4), or a sequence of hg.Pose and 4x4, for as many entities."""
        listed = flatten(entities, "entities")
        matrices = np.asarray(matrices_of(poses, "poses"), dtype="f8")
        if len(listed) != len(matrices):
            raise InvalidArgument(
                f"poses: {len(matrices)} for {len(listed)} entities; give as many", field="poses"
            )
        if listed:
            self._set(listed, self.locals(listed, matrices))

    def set_joints(self, robot: Robot, values: Any, *, clamp: bool = False) -> None:
        """Moves the joints of a robot, as edit.set_joints() with all values, (C,); pose() of its
        links knows."""
        self._set(robot.moving, robot.transforms(values, clamp=clamp))

    def locals(self, entities: Sequence[Named], poses: Any) -> NdArray:
        """(N, 4, 4) poses relative to the parents, of world poses; a parent that is not among the
        entities is where it was drawn so far."""
        self._follow()
        keys = [self._key(entity) for entity in entities]
        self._base.learn(key for key in keys if isinstance(key, int))
        worlds = dict(zip(keys, poses))
        return np.stack([self._local(key, pose, worlds) for key, pose in zip(keys, poses)])

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
        """State of the draw so far, for rewind()."""
        drawn = dict(self._placed), dict(self._parents), dict(self._made)
        return len(self.edit.transaction.edits), self._followed, drawn

    def rewind(self, mark: Any) -> None:
        """Takes back all that was drawn since that mark(), but for the numbers of rng."""
        edits, self._followed, drawn = mark
        del self.edit.transaction.edits[edits:]
        self._placed, self._parents, self._made = map(dict, drawn)

    def _set(self, entities: Sequence[Handle | str], relative: Any) -> None:
        self._follow()
        self._placed.update(zip(map(self._key, entities), relative))
        self.edit.set_transforms(entities, relative)
        self._followed = len(self.edit.transaction.edits)

    def _parent(self, key: Any) -> Any:
        """Its key; 0: none."""
        return self._parents.get(key, self._base.of(key)[1])

    def _world(self, key: Any, worlds: Mapping[Any, NdArray]) -> NdArray:
        """(4, 4) world pose; `worlds` holds the poses known already."""
        if key in worlds:
            return worlds[key]
        local = self._placed.get(key, self._base.of(key)[0])
        if local is None:
            raise InvalidArgument(
                f"entity: {key!r} was made with keys= or more than 1 MiB of transforms=, so that "
                "its pose is not known here; place() it",
                field="entity",
            )
        parent = self._parent(key)
        return np.asarray(self._world(parent, worlds) @ local) if parent else local

    def _local(self, key: Any, world: NdArray, worlds: Mapping[Any, NdArray]) -> NdArray:
        parent = self._parent(key)
        return np.asarray(np.linalg.inv(self._world(parent, worlds)) @ world) if parent else world

    # ------------------------------------------------------------ contents of the overlay

    def _follow(self) -> None:
        """Notes the parents and poses of the edits that came since the last time."""
        edits = self.edit.transaction.edits
        for index in range(self._followed, len(edits)):
            edit = edits[index]
            action = edit.WhichOneof("action")
            if action in ("entity", "instantiate"):
                self._note(self._key_of(index), getattr(edit, action))
            elif action == "instances":
                array = edit.instances.matrices
                poses = _matrices(array) if array.inline else [None] * array.shape[0]
                for i, pose in enumerate(poses):
                    key = f"{edit.target.name}/{i}"
                    self._note(key, edit.instances.prototype)
                    self._placed[key] = pose
        self._followed = len(edits)

    def _note(self, key: Any, given: pb.Entity | pb.Instantiate) -> None:
        if given.HasField("parent"):
            self._parents[key] = self._named(given.parent)
        if given.HasField("pose"):
            if not given.pose.HasField("times"):
                self._placed[key] = _matrices(given.pose.matrices)
            elif not isinstance(key, int):
                self._placed.setdefault(key, None)
        cleared = getattr(given, "clear", ())
        if "parent" in cleared:
            self._parents[key] = 0
        if "pose" in cleared:
            self._placed[key] = np.eye(4)

    def _key_of(self, index: int) -> Any:
        """Key of the object that an edit makes or changes."""
        return self._named(self.edit.transaction.edits[index].target) or f"edits[{index}]"

    def _named(self, ref: types.Ref) -> Any:
        """Key of the object that a Ref names; 0: none."""
        if ref.HasField("created_by_edit"):
            return self._key_of(ref.created_by_edit)
        return self._base.ids.get(ref.name, ref.name) if ref.name else ref.id

    def _key(self, entity: Named) -> Any:
        """The id of an entity of the scene; of one that this draw made its name, or the edit."""
        if isinstance(entity, str):
            return self._base.scene[entity].id
        if not isinstance(entity, Handle):
            raise InvalidArgument(
                f"entity: needs a handle or a name, not {type(entity).__name__}", field="entity"
            )
        if entity._edits is self.edit:
            return self._named(entity.ref(self.edit))
        return entity.id


class BasePoses:
    """Poses of the scene that all draws start from, read once. Thread: one at a time."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.bodies = Bodies(scene)
        self._known: dict[Any, tuple[NdArray, int]] = {}

    def of(self, key: Any) -> tuple[NdArray, int]:
        """((4, 4) parent_from_local, id of the parent or 0); the identity for an entity that the
        draw made."""
        if not isinstance(key, int):
            return np.eye(4), 0
        self.learn([key])
        return self._known[key]

    @cached_property
    def ids(self) -> dict[str, int]:
        """Ids of the scene's objects, by name."""
        return {found.name: found.id for found in self.scene.describe(tree=True).objects}

    def learn(self, keys: Any) -> None:
        """Reads poses that are not known yet, in one call."""
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
    """Runs randomizers in order, each with an rng of its own: the draws of one do not depend on how
    many numbers another one took. A randomizer is any callable (draw) -> None."""

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


def _matrices(array: types.Array) -> NdArray:
    return from_message(array).astype("f8")


def render_seed(seed: int, draw: int) -> int:
    """The seed of the pictures of a draw, 64 bits. Cameras share it, as they share the scene."""
    sequence = np.random.SeedSequence(seed, spawn_key=(_RENDER, draw))
    return int(sequence.generate_state(1, np.uint64)[0])
