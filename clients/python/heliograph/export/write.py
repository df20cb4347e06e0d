"""scene.export(): a scene to a file of another format. Called by Scene."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from .._optional import needed
from .._wire._proto import service_pb2 as service
from ..errors import InvalidArgument, NotFound, Unimplemented, warn_of_file
from .world import read

if TYPE_CHECKING:
    from ..client.scene import Scene

ENDINGS = (".glb", ".usdz")


def checked_path(path: str | os.PathLike[str]) -> Path:
    """A path whose ending is that of a format to write, in a folder that is there."""
    found = Path(path)
    if found.suffix.lower() not in ENDINGS:
        raise InvalidArgument(
            f"path: {found} ends neither in .glb nor in .usdz; scene.save() writes .helio files",
            field="path",
        )
    if not found.parent.is_dir():
        raise NotFound(f"path: there is no folder {found.parent}", field="path")
    return found


def export(scene: Scene, to: str | os.PathLike[str], revision: int | None) -> None:
    """Writes a .glb or .usdz file. Names it only once it is complete. Warns of features that the
    format lacks."""
    path = checked_path(to)
    if path.suffix.lower() == ".usdz":
        needed("pxr", "writing .usdz files needs", "usd")
    partial = path.with_name(f"{path.stem}.partial{path.suffix}")
    connection = scene.client.connection
    server = connection.link.server
    if not server.HasField("default_material"):
        raise Unimplemented(f"heliographd {server.version} cannot be exported from; update it")
    request = service.ExportSceneRequest(scene=scene.id, revision=revision)
    chunks = connection.stream("ExportScene", request)
    world = read(scene.name, chunks, server.default_material)
    try:
        if path.suffix.lower() == ".glb":
            from .gltf.write import write as write_glb

            write_glb(world, partial)
        else:
            from .usdz.write import write as write_usdz

            write_usdz(world, partial)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)
    warn_of_file(path, world.notes.texts())
