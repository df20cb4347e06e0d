"""Draws without generate(), for tests of randomizers."""

from contextlib import contextmanager

import numpy as np
from heliograph.datasets import Draw
from heliograph.datasets.draw import BasePoses


def drawn(scene, camera, randomizer, index=0, seed=5):
    """The Draw of that index after the randomizer."""
    edit = scene.overlay()
    with edit:
        draw = Draw(BasePoses(scene), [camera], (seed, index, 0), edit)
        randomizer(draw)
    return draw


@contextmanager
def seen(scene, draw):
    """A branch where it is published."""
    branch = scene.branch()
    try:
        branch.apply(draw.edit.transaction)
        yield branch
    finally:
        branch.delete()


def vertices(draw, thing):
    """(V, 3) world, as drawn."""
    (body,) = draw.bodies.of(thing, "thing")
    return body.world(draw.pose(thing))


def same(a, b):
    """True if two draws made the same edits."""
    return a.edit.transaction.SerializeToString() == b.edit.transaction.SerializeToString()


def meeting(branch, entities, obstacles=()):
    """Pairs that intersect."""
    pairs = branch.overlaps(entities, [*entities, *obstacles])
    pairs[np.arange(len(entities)), np.arange(len(entities))] = False
    return int(pairs.sum())
