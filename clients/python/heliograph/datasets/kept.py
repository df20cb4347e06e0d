"""Image of an existing data set, rendered again from the data set's own records. Used by
`heliograph rerender` and `heliograph open`."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._wire._proto import scene_pb2 as pb
from ..errors import NotFound
from ..render import call
from .folder import NAME, Folder
from .uploads import Kept
from .writer import Picture

if TYPE_CHECKING:
    from ..client.client import Client
    from ..client.scene import Scene
    from ..render.frame import Frame


class KeptImage:
    """Image `index` of the data set in DIR.

    attempt: how many draws were rejected for it. picture: how its picture was made, None where the
    format has none.
    """

    def __init__(self, directory: str | os.PathLike[str], index: int) -> None:
        self.folder, self.index = Folder(directory), index
        record = self.folder.record(index)
        self.attempt, self.split = int(record["attempt"]), str(record["split"])
        self._sha256 = str(record["sha256"])

    @classmethod
    def find(cls, path: str | os.PathLike[str]) -> KeptImage:
        """Image of "DIR/000123", or of a file of one image, such as DIR/images/000123.png.
        NotFound."""
        whole = Path(path).absolute()
        for directory in whole.parents:
            if (directory / NAME).is_dir():
                index = _index_of(Folder(directory), whole.relative_to(directory))
                if index is None:
                    break
                return cls(directory, index)
        raise NotFound(
            f"path: {os.fspath(path)!r} is no image of a data set that generate() made; name one "
            "as DIR/000123",
            field="path",
        )

    @property
    def picture(self) -> Picture | None:
        found = self.folder.description["writer"].get("picture")
        return Picture(**found) if found else None

    @property
    def overlay(self) -> pb.Transaction:
        """Overlay of the image: the edits of its randomizers."""
        kept = self.folder.overlay(self.index)
        if kept is not None:
            return pb.Transaction.FromString(kept)
        from google.protobuf.json_format import ParseDict

        request = json.loads(self.folder.manifest(self.index))["request"]
        return ParseDict(request.get("overlay", {}), pb.Transaction())

    @contextmanager
    def opened(self, client: Client) -> Iterator[Scene]:
        """Opens the scene as it was before the randomizers in a daemon, with the uploads that the
        overlay names. Deletes it at the end."""
        with client.load_scene(self.folder.scene_path) as scene:
            Kept(self.folder, client).bring(self.overlay)
            yield scene

    def render(self, client: Client) -> Frame:
        """The frame again: all its planes and labels."""
        with self.opened(client) as scene:
            return self._run(scene, self._request(scene))

    def render_labelled(self, client: Client) -> Frame:
        """Renders the same view with the planes beauty and instance and all labels, to look at."""
        with self.opened(client) as scene:
            request = self._request(scene)
            wanted = call.make_request(
                scene, ["camera"], {"planes": ["beauty", "instance"], "labels": True}
            )
            del request.planes[:]
            request.planes.extend(wanted.planes)
            request.labels.CopyFrom(wanted.labels)
            if not request.HasField("spp"):
                request.spp = wanted.spp
            return self._run(scene, request)

    def _run(self, scene: Scene, request: Any) -> Frame:
        kept = Kept(self.folder, scene.client)
        frame: Frame = kept.complete(lambda: call.run(scene, request, {}))[0]
        return frame

    def _request(self, scene: Scene) -> Any:
        from google.protobuf.json_format import MessageToDict

        manifest: dict[str, Any] = json.loads(self.folder.manifest(self.index))
        if "overlay" in manifest:
            overlay = MessageToDict(self.overlay, preserving_proto_field_name=True)
            manifest["request"]["overlay"] = overlay
        return call.request_of_manifest(scene, json.dumps(manifest))

    def is_same(self, frame: Frame) -> bool:
        """True if a frame has the bytes of the one that was written: planes and labels."""
        return frame.sha256.hex() == self._sha256

    def why_not(self, frame: Frame) -> str:
        """Explains how a frame may differ from the one that was written: versions, CPU features,
        backend."""
        old = json.loads(self.folder.manifest(self.index))
        new = json.loads(frame.manifest)
        names = ("version", "backend", "cpu_features", "denoiser")
        changes = [
            f"{name} was {old.get(name)}, is {new.get(name)}"
            for name in names
            if old.get(name) != new.get(name)
        ]
        return "; ".join(changes) or "the daemon and the CPU are the same"


def _index_of(folder: Folder, inside: Path) -> int | None:
    """Index of the image that DIR/inside names or is a file of; None: of no image."""
    number = re.match(r"\d+", inside.name)
    if number is None or inside.suffix == ".tar":  # a shard is of many images
        return None
    description = folder.description
    scene_draws = description["writer"].get("scene_draws")
    if scene_draws is None or len(inside.parts) == 1:
        return int(number[0])
    return _index_in_scene(folder, inside, scene_draws * len(description["cameras"]))


def _index_in_scene(folder: Folder, inside: Path, scene_images: int) -> int | None:
    """Index for SPLIT/000001/rgb/000000.png of Bop, where numbers begin anew in each scene."""
    found = re.fullmatch(r"([^/]+)/(\d+)/[^/]+/(\d+)[^/]*", inside.as_posix())
    if found is None:
        return None
    split, scene, image = found[1], int(found[2]), int(found[3])
    index = scene * scene_images + image
    made = folder.record(index)["record"]
    return index if (made["split"], made["scene"], made["image"]) == (split, scene, image) else None
