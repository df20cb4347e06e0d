"""The randomizers under the names that scripts use: hd.scatter(...), hd.orbit(...)."""

from __future__ import annotations

from .joints import RandomJoints as random_joints
from .lighting import RandomDome as random_dome
from .lighting import RandomLights as random_lights
from .lighting import bundled_domes
from .ranges import Choice as choice
from .ranges import HsvColor as hsv_color
from .ranges import LogUniform as log_uniform
from .scatter import InVolume as in_volume
from .scatter import Scatter as scatter
from .scatter import Shell as shell
from .viewpoints import LookAtJitter as look_at_jitter
from .viewpoints import Orbit as orbit

__all__ = [
    "bundled_domes",
    "choice",
    "hsv_color",
    "in_volume",
    "log_uniform",
    "look_at_jitter",
    "orbit",
    "random_dome",
    "random_joints",
    "random_lights",
    "scatter",
    "shell",
]
