"""The randomizers under the names that scripts use: hd.scatter(...), hd.orbit(...)."""

from __future__ import annotations

from .flying import Distractors as distractors
from .flying import add_distractors
from .inview import InView as in_view
from .joints import RandomJoints as random_joints
from .lighting import RandomDome as random_dome
from .lighting import RandomLights as random_lights
from .lighting import bundled_domes
from .looks import RandomMaterials as random_materials
from .looks import RandomTextures as random_textures
from .moving import CameraPath as camera_path
from .moving import RandomMotion as random_motion
from .patterns import bundled_textures
from .placing import InVolume as in_volume
from .placing import Scatter as scatter
from .placing import Shell as shell
from .props import random_shape
from .ranges import Choice as choice
from .ranges import HsvColor as hsv_color
from .ranges import LogUniform as log_uniform
from .settling import Settle as settle
from .viewpoints import LookAtJitter as look_at_jitter
from .viewpoints import Orbit as orbit

__all__ = [
    "add_distractors",
    "bundled_domes",
    "bundled_textures",
    "camera_path",
    "choice",
    "distractors",
    "hsv_color",
    "in_view",
    "in_volume",
    "log_uniform",
    "look_at_jitter",
    "orbit",
    "random_dome",
    "random_joints",
    "random_lights",
    "random_materials",
    "random_motion",
    "random_shape",
    "random_textures",
    "scatter",
    "settle",
    "shell",
]
