"""The scenes of the NViSII paper (Morrical et al. 2021, section 4) as generators: DOME, MESH, FAT.

Each is a frozen dataclass, its settings, whose build(scene) makes the scene and gives the camera
and the randomizer for generate(). `heliograph dataset dome --count 6000 --out DIR` runs one.
"""

from .dome import DomeScene
from .fat import FatScene
from .mesh import MeshScene
from .settings import make_scene, read_settings, settings_text
from .wares import add_wares

__all__ = [
    "DomeScene",
    "FatScene",
    "MeshScene",
    "add_wares",
    "make_scene",
    "read_settings",
    "settings_text",
]
