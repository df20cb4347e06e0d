"""edit.import_mjcf(): the scene and the robots of an MJCF file; docs/mjcf.md."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ...errors import InvalidArgument
from ...values.checks import whole_of

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ...client.edit import Edits
    from ...scene import patches
    from .robot import MjcfRobot


_GROUPS = 6  # mjNGROUP
_LARGEST = 16384  # pixels


class MjcfEdits:
    """The part of Edits that reads MJCF files."""

    def import_mjcf(
        self,
        path: str | os.PathLike[str] | MjcfRobot | Any,
        *,
        name: str | None = None,
        groups: Sequence[int] = (0, 1, 2),
        sites: bool = False,
        lights: bool = True,
        size: tuple[int, int] = (640, 480),
        keypoints: Sequence[str] | None = None,
        **components: Unpack[patches.Components],
    ) -> MjcfRobot:
        """Reads a scene or a robot from an MJCF file, by MuJoCo's compiler, and places it: entities
        `name`, and "<name>/<body>". Units are metres, +Z is up in both.

        path: a file; a mujoco.MjModel or MjSpec; or another MjcfRobot, which is placed again, with
        the same meshes and materials.
        groups: of geoms, sites, tendons and skins to show; MuJoCo shows 0, 1 and 2. sites: True
        shows them. lights: False leaves out the file's lights and its sky.
        size: width and height of cameras whose resolution the file leaves open, pixels.
        keypoints: names of the joints that labels report, by default the first one of each body.
        components: of the root, as edit.entity() takes them; but label, category, group and
        attributes go to each body beneath the world, which by default is an instance. `warnings`
        names what is left out. InvalidArgument for files that MuJoCo refuses; Unimplemented without
        the package mujoco.
        """
        from .building import Wanted, placed

        wanted = Wanted(
            _whole(groups, "groups", (0, _GROUPS - 1)), sites, lights, _size(size), keypoints
        )
        return placed(cast("Edits", self), path, name, wanted, components)


def _whole(values: Any, field: str, bounds: tuple[int, int]) -> tuple[int, ...]:
    if np.ndim(values) != 1:
        raise InvalidArgument(f"{field}: needs whole numbers, not {values!r}", field=field)
    return tuple(whole_of(value, field, *bounds) for value in values)


def _size(size: Any) -> tuple[int, int]:
    numbers = _whole(size, "size", (1, _LARGEST))
    if len(numbers) != 2:
        raise InvalidArgument(f"size: width and height, not {size!r}", field="size")
    return numbers[0], numbers[1]
