"""Rigs of several cameras. Called as hg.stereo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..errors import InvalidArgument
from ..values.checks import number_of
from ..values.components import Camera

if TYPE_CHECKING:
    from ..client.edit import Edits
    from .handles import Entity


class Rig(NamedTuple):
    """Two cameras side by side, and the entity that both are fixed to."""

    root: Entity
    left: Entity
    right: Entity


def stereo(edit: Edits, name: str, *, camera: Camera, baseline: float, **placement: Any) -> Rig:
    """A rectified pair: the entity `name` and its children `name/left` and `name/right`, which both
    carry `camera`, look the same way, and lie `baseline` metres apart along the image's x axis, the
    root in the middle. Moving the root moves both.

    placement: of the root, as edit.entity() takes it: transform=, keys=, parent=.
    With planes=["disparity:NAME/right"] the left camera's disparity is fx * baseline / depth.
    """
    apart = number_of(baseline, "baseline")
    if not apart > 0:
        raise InvalidArgument(f"baseline: {apart} is not above 0 metres", field="baseline")
    root = edit.entity(name, **placement)
    eyes = []
    for side, x in (("left", -0.5 * apart), ("right", 0.5 * apart)):
        pose = np.eye(4)
        pose[0, 3] = x
        eyes.append(edit.entity(f"{name}/{side}", parent=root, camera=camera, transform=pose))
    return Rig(root, *eyes)
