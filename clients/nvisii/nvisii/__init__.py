"""NViSII's Python interface over a Heliograph daemon: docs/nvisii.md lists the differences."""

from __future__ import annotations

from heliograph import __version__ as __version__

from . import data as _data
from . import glm as _glm
from . import imports as _imports
from . import rendering as _rendering
from . import session as _session
from . import settings as _settings
from .cameras import camera
from .data import *  # noqa: F403
from .entities import entity
from .glm import *  # noqa: F403
from .imports import *  # noqa: F403
from .imports import scene
from .lights import light
from .materials import material
from .meshes import mesh
from .rendering import *  # noqa: F403
from .session import *  # noqa: F403
from .settings import *  # noqa: F403
from .textures import texture
from .transforms import transform
from .volumes import volume

__all__ = [
    "camera",
    "entity",
    "light",
    "material",
    "mesh",
    "scene",
    "texture",
    "transform",
    "volume",
]
__all__ += _data.__all__
__all__ += _glm.__all__
__all__ += _imports.__all__
__all__ += _rendering.__all__
__all__ += _session.__all__
__all__ += _settings.__all__
