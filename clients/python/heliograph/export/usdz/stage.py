"""The stage as it grows: names of prims, poses, pictures beside it. Needs pxr."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom

from ..._optional import openexr
from ..._version import __version__
from ..._wire.arrays import NdArray
from ...image import png
from ..looks import Picture
from ..motion import Track

FRAMES = 24.0  #: time codes a second
TOP = "/World"
_SHARP = 1024  # texels, of pictures enlarged to stay sharp


class Stage:
    """A stage in a folder, its default prim, and its textures/."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder = folder
        self.stage: Any = Usd.Stage.CreateNew(str(folder / "scene.usdc"))
        self.stage.SetMetadata("metersPerUnit", 1.0)
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.z)
        self.stage.SetTimeCodesPerSecond(FRAMES)
        self.stage.SetFramesPerSecond(FRAMES)
        self.stage.GetRootLayer().documentation = f"Written by Heliograph {__version__}"
        self._names: dict[str, set[str]] = {}
        self._files = 0
        self._codes: set[float] = set()
        top = UsdGeom.Xform.Define(self.stage, TOP).GetPrim()
        top.SetDisplayName(name or "scene")
        self.stage.SetDefaultPrim(top)

    def path(self, parent: str, name: str) -> str:
        """A path below `parent` that is free, as near to the name as identifiers are."""
        taken = self._names.setdefault(parent, set())
        stem = Tf.MakeValidIdentifier(name or "prim")
        found, number = stem, 1
        while found in taken:
            number += 1
            found = f"{stem}_{number}"
        taken.add(found)
        return f"{parent}/{found}"

    def code(self, seconds: float) -> Any:
        """The time code of a key."""
        self._codes.add(float(seconds) * FRAMES)
        return Usd.TimeCode(float(seconds) * FRAMES)

    def save(self) -> Path:
        """The file of the root layer."""
        if self._codes:
            self.stage.SetStartTimeCode(min(self._codes))
            self.stage.SetEndTimeCode(max(self._codes))
        self.stage.GetRootLayer().Save()
        return self.folder / "scene.usdc"

    # ------------------------------------------------------------ pictures

    def picture(self, picture: Picture) -> Any:
        """The asset path of a file with a picture: PNG, or EXR where texels are floats. Grey is
        written as RGB; pictures that are not filtered are enlarged."""
        texels = picture.texels
        if picture.nearest:  # USD has no such filter
            texels = texels.repeat(_SHARP // max(texels.shape[:2]) or 1, 0)
            texels = texels.repeat(len(texels) // len(picture.texels), 1)
        if texels.shape[2] < 3:
            texels = texels[..., [0, 0, 0, 1][: 3 if texels.shape[2] == 1 else 4]]
        name = f"textures/{self._files}.{'png' if picture.has_levels else 'exr'}"
        self._files += 1
        file = self.folder / name
        file.parent.mkdir(exist_ok=True)
        if picture.has_levels:
            file.write_bytes(png.encode(texels))
        else:
            _write_exr(file, texels)
        return Sdf.AssetPath(f"./{name}")

    # ------------------------------------------------------------ poses

    def pose(self, prim: Any, track: Track) -> None:
        """Puts a pose: a matrix, or, for a moving entity, translation, rotation and scale, which
        USD interpolates as we do."""
        xformable = UsdGeom.Xformable(prim)
        if track.moves and not track.is_sheared:
            self._moving(xformable, track)
            return
        if not track.moves and np.array_equal(track.matrices[0], np.eye(4)):
            return
        op = xformable.AddTransformOp()
        for time, matrix in zip(track.times, track.matrices):
            at = (self.code(time),) if track.moves else ()
            op.Set(matrix_of(matrix), *at)

    def _moving(self, xformable: Any, track: Track) -> None:
        move = xformable.AddTranslateOp()
        turn = xformable.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
        scale = xformable.AddScaleOp(UsdGeom.XformOp.PrecisionDouble)
        for k, time in enumerate(track.times):
            code = self.code(time)
            move.Set(Gf.Vec3d(*track.translations[k].tolist()), code)
            turn.Set(Gf.Quatd(*track.rotations[k].tolist()), code)
            scale.Set(Gf.Vec3d(*track.scales[k].tolist()), code)


def matrix_of(matrix: NdArray) -> Any:
    """A Gf.Matrix4d, which is for rows, of (4, 4) for column vectors."""
    return Gf.Matrix4d(np.asarray(matrix, dtype="f8").T.tolist())


def _write_exr(file: Path, texels: NdArray) -> None:
    exr = openexr()
    channels = {"RGBA"[i]: np.ascontiguousarray(texels[..., i]) for i in range(texels.shape[2])}
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    exr.File([exr.Part(header, channels, "picture")]).write(str(file))
