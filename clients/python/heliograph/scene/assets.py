"""Files to assets: uploads a model and its companions, has them decoded. Used by edits."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from .._wire._proto import scene_pb2 as pb
from .._wire._proto import service_pb2 as service
from .._wire.arrays import inline
from .._wire.uploads import repeated
from ..errors import FailedPrecondition, InvalidArgument, NotFound
from ..values.checks import refuse_unknown, text_of
from ..values.pose import matrix_of
from . import companions
from .handles import Asset, Named
from .patches import entity_message

if TYPE_CHECKING:
    from ..client.client import Client
    from ..client.edit import Edits
    from ..client.scene import Scene

USD_ENDINGS = (".usd", ".usda", ".usdc", ".usdz")
_POINTER = b"version https://git-lfs.github.com/spec/"
_ROUNDS = 64  # of naming missing companions


class Placement(TypedDict, total=False):
    """Options for placing a copy of an asset."""

    transform: Any  #: 4x4 or Pose, relative to the parent
    parent: Named | None  #: whose frame the pose is in
    label: int | str  #: of the copy, as of an entity
    category: str  #: name of its class
    group: bool  #: as of an entity
    materials: Mapping[str, Named]  #: overrides, by the asset's material name
    animation: int | str | None  #: clip to bind, by index or name; None: none


@dataclass(frozen=True)
class Source:
    """Asset to decode: a file here or on the server, and how to read it."""

    path: str | os.PathLike[str] | None
    server_path: str = ""
    up: str = ""
    units: float = 0.0
    folders: Sequence[str | os.PathLike[str]] = ()  #: further ones whose files may be read
    strict: bool = False  #: refuse a model whose companions are not all there
    layer: str = ""  #: of a picture
    variant: str = ""  #: of a glTF
    surface: bool = False  #: of a volume file: its level sets as a mesh

    def request(self) -> service.DecodeAssetRequest:
        if (self.path is None) == (not self.server_path):
            raise InvalidArgument("give path or server_path", field="path")
        if companions.allowed(self.folders) and self.path is None:
            raise InvalidArgument(
                "folders: serve files of this machine; the daemon reads files beneath its asset "
                "root",
                field="folders",
            )
        if Path(self.path or self.server_path).suffix.lower() in USD_ENDINGS:
            raise InvalidArgument("USD files: use edit.import_usd()", field="path")
        if self.up not in ("", "x", "y", "z"):
            raise InvalidArgument(f'up: "x", "y" or "z", not {self.up!r}', field="up")
        try:
            units = float(self.units)
        except (TypeError, ValueError):
            raise InvalidArgument(
                f"units: metres a unit, such as 0.001, not {self.units!r}", field="units"
            ) from None
        up = f"AXIS_{self.up.upper() or 'UNSPECIFIED'}"
        return service.DecodeAssetRequest(
            server_path=self.server_path,
            up=up,
            units=units,
            layer=self.layer,
            variant=text_of(self.variant, "variant"),
            surface=bool(self.surface),
        )


@dataclass(frozen=True)
class Decoding:
    """Decoding by the daemon: its request, and the paths of its files by their names in it."""

    request: service.DecodeAssetRequest
    paths: dict[str, Path] = field(default_factory=dict)

    def send_again(self, client: Client, digest: bytes) -> None:
        """Has the files decoded that the daemon has decoded before."""
        for file in self.request.files:
            if file.sha256:
                _send_file(client, self, file.sha256)
        decode_again(client, digest, self.request)

    def add(self, client: Client, name: str, path: Path | None) -> None:
        """None: there is no such companion."""
        digest = b"" if path is None else client.store.blob(_content(path))
        self.request.files.append(service.BundleFile(path=name, sha256=digest))
        if path is not None:
            self.paths[name] = path.absolute()


def decode(scene: Scene, source: Source, name: str | None) -> Asset:
    """Uploads and decodes; the asset is not placed yet."""
    info = decode_bundle(scene.client, source)
    if info.HasField("texels"):
        raise InvalidArgument(
            f"{source.path or source.server_path} is a picture: use edit.texture() or edit.dome()",
            field="path",
        )
    stem = companions.readable(Path(source.path or source.server_path).stem)
    return Asset(scene, name or stem, stem, info)


def decode_bundle(client: Client, source: Source) -> service.AssetInfo:
    """Calls DecodeAsset, and uploads files that the daemon misses until it misses none."""
    decoding = Decoding(source.request())
    if source.path is not None:
        model = Path(source.path)
        decoding.add(client, companions.readable(model.name), _existing(model))
    for _ in range(_ROUNDS):
        found, missing = repeated(
            lambda: _answer(client, decoding.request),
            lambda digest: _send_file(client, decoding, digest),
        )
        if found is not None:
            client.store.decodings[_digest(found)] = decoding
            return found
        sent = {file.path for file in decoding.request.files}
        new = [name for name in dict.fromkeys(missing) if name not in sent]
        if not new:
            raise NotFound(f"{source.path}: the daemon still misses {', '.join(missing)}")
        for name in new:
            decoding.add(client, name, _companion(source, name))
    raise InvalidArgument(f"{source.path}: names companions in more than {_ROUNDS} rounds")


def _companion(source: Source, name: str) -> Path | None:
    """Path of a companion file; None: it is missing, or may not be read. NotFound if strict."""
    if source.path is not None:
        found = companions.find(Path(source.path).parent, name, source.folders)
        if found is not None:
            return found
    if source.strict:
        raise NotFound(
            f"the model refers to {name!r}, which is neither beneath its folder nor beneath "
            f"folders={[os.fspath(folder) for folder in source.folders]}: put it beside the model, "
            "or give its folder",
            field="folders",
        )
    return None


def decode_again(client: Client, digest: bytes, request: service.DecodeAssetRequest) -> None:
    """Has the files of `digest` decoded again; the daemon has the files by now."""
    found, missing = _answer(client, request)
    if found is None or _digest(found) != digest:
        files = ", ".join(file.path for file in request.files) or request.server_path
        why = f"it misses {', '.join(missing)}" if missing else "to something else"
        raise FailedPrecondition(
            f"this daemon does not decode {files} as the one that rendered it did: {why}"
        )


def _send_file(client: Client, decoding: Decoding, digest: bytes) -> bool:
    """Uploads a file, even if the session had it; False: it is none of these."""
    named = [file.path for file in decoding.request.files if file.sha256 == digest]
    if not named:
        return False
    path = decoding.paths[named[0]]
    data = path.read_bytes() if path.is_file() else b""
    if hashlib.sha256(data).digest() != digest:
        raise FailedPrecondition(
            f"{path} is not what it was when it was decoded, and the daemon needs it again: "
            "import it anew"
        )
    client.store.send_again(digest, data)
    return True


def _answer(
    client: Client, request: service.DecodeAssetRequest
) -> tuple[service.AssetInfo | None, list[str]]:
    """The asset, or names of files that it lacks."""
    missing: list[str] = []
    found: service.AssetInfo | None = None
    for reply in client.connection.stream("DecodeAsset", request):
        missing.extend(reply.missing)
        if reply.HasField("asset"):  # it comes in pieces
            found = found or service.AssetInfo()
            found.MergeFrom(reply.asset)
    return found, missing


def _digest(info: service.AssetInfo) -> bytes:
    """Hash by which edits name the asset: a picture's is that of its texels."""
    return info.texels.blob if info.HasField("texels") else info.sha256


def _content(path: Path) -> bytes:
    data = path.read_bytes()
    if data.startswith(_POINTER):
        raise InvalidArgument(
            f"{path} is a pointer of Git LFS, not the file itself: fetch it with `git lfs pull`",
            field="path",
        )
    return data


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise NotFound(f"no file {path}", field="path")
    return path


def instantiate_message(edits: Edits, asset: Asset, placement: Placement) -> pb.Instantiate:
    """The Instantiate of an asset at a placement."""
    refuse_unknown(placement, Placement, "a placement")
    out = pb.Instantiate(asset=asset.sha256)
    edits.note_decoding(asset.sha256)
    clip = placement.get("animation")
    if clip is not None:
        out.animation = _animation(asset, clip)
    if placement.get("transform") is not None:
        out.pose.matrices.CopyFrom(inline(matrix_of(placement["transform"])))
    parent = placement.get("parent")
    if parent is not None:
        out.parent.CopyFrom(edits.ref(parent, "parent"))
    label: Any = {k: placement[k] for k in ("label", "category", "group") if k in placement}
    if label:
        out.label.CopyFrom(entity_message(edits, label).label)
    for name, material in placement.get("materials", {}).items():
        if name not in asset.materials:
            have = ", ".join(map(repr, asset.materials)) or "none"
            raise NotFound(f"materials: {asset!r} has no material {name!r}; it has {have}")
        out.materials[name].CopyFrom(edits.ref(material, f"materials[{name!r}]"))
    return out


def _animation(asset: Asset, clip: int | str) -> int:
    if isinstance(clip, str):
        if clip not in asset.animations:
            have = ", ".join(map(repr, asset.animations)) or "none"
            raise NotFound(f"{asset!r} has no animation {clip!r}; it has {have}")
        return asset.animations.index(clip)
    if not 0 <= clip < len(asset.animations):
        raise InvalidArgument(
            f"animation: {clip} is not below {len(asset.animations)}", field="animation"
        )
    return clip
