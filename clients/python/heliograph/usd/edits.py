"""The part of Edits that reads USD. The rest of this folder needs pxr, the package usd-core."""

from __future__ import annotations

import os
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from .._optional import needed
from ..errors import InvalidArgument
from ..scene import companions, patches
from ..values.checks import number_of, refuse_given, text_of, whole_of
from .asset import UsdAsset
from .model import NIT, Options

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from ..client.edit import Edits
    from ..client.scene import Scene


class UsdEdits:
    """The part of Edits that reads USD."""

    def import_usd(
        self,
        path: str | os.PathLike[str] | UsdAsset,
        *,
        name: str | None = None,
        variants: Mapping[str, Mapping[str, str]] | None = None,
        payloads: bool = True,
        purposes: Sequence[str] = ("default", "render"),
        time: float | None = None,
        times: str | Sequence[float] | None = None,
        units: float = 0.0,
        folders: Sequence[str | os.PathLike[str]] = (),
        semantics: str | None = "class",
        nit: float = NIT,
        lights: bool = True,
        camera_width: int = 960,
        subdivision: int = 0,
        keypoints: Sequence[str] | None = None,
        **components: Unpack[patches.Components],
    ) -> UsdAsset:
        """Reads a USD file (.usd, .usda, .usdc, .usdz) and places it: entities `name`, by default
        the file's stem, and "<name>/<prim path>". path: another UsdAsset is placed again, not read
        again, with the same meshes and materials; in another scene with copies of them.

        The file is read in this process by the package usd-core, not in the daemon's sandbox.
        variants: {prim path: {variant set: variant}}, instead of the file's choice. payloads: False
        leaves them out. purposes: of "default", "render", "proxy", "guide". time: seconds at which
        it is read, by default its earliest. times: seconds of the keys of motion, or "all": those
        of the file. units: metres per unit where the file names none (0.01).
        folders: with further textures, besides the file's own folder and those beneath it.
        semantics: the type or taxonomy of labels that become categories; None: none.
        nit: radiance, W sr^-1 m^-2, of 1 cd/m^2 in the file. lights: False leaves out UsdLux.
        camera_width: pixels of its cameras; the height follows from their apertures.
        subdivision: steps of Catmull-Clark, up to 6; 0: the cages of such surfaces are shown.
        keypoints: names of robots' joints that labels report, by default all.
        components: of the root, as edit.entity() takes them: transform, parent, category, ...
        Robots have the same label, category, group and attributes.
        Unimplemented without the package pxr; NotFound and InvalidArgument for the file.
        """
        needed("pxr", "USD files need", "usd")
        from . import build

        edits = cast("Edits", self)
        options = Options(
            variants=_variants(variants or {}),
            payloads=payloads,
            purposes=tuple(purposes),
            time=None if time is None else number_of(time, "time"),
            times=_times(times),
            units=_above_zero(units, "units") if units else 0.0,
            folders=companions.allowed(folders),
            semantics=None if semantics is None else text_of(semantics, "semantics"),
            nit=_above_zero(nit, "nit"),
            lights=lights,
            camera_width=whole_of(camera_width, "camera_width", 1, 16384),
            subdivision=whole_of(subdivision, "subdivision", 0, 6),
        )
        given: Any = components
        asset = _asset(edits.scene, path, name, options)
        return build.Builder(edits, asset, keypoints).build(given)


def _asset(
    scene: Scene, path: str | os.PathLike[str] | UsdAsset, name: str | None, options: Options
) -> UsdAsset:
    """Asset to be placed: read from a file, or another one's model. InvalidArgument for options
    with another asset."""
    if isinstance(path, UsdAsset):
        why = "an asset is placed again as it was read; give it with the file"
        refuse_given(vars(options), vars(Options()), why)
        library = path.library if path.scene.id == scene.id else None
        return UsdAsset(scene, name or path.name, path.model, library)
    from . import stage

    model, files = stage.read(Path(path), options)
    weakref.finalize(scene.client, files.close)  # it may have to send them again
    return UsdAsset(scene, name or model.stem, model, None)


def _times(times: Any) -> Any:
    """None, "all", or seconds."""
    if times is None or (isinstance(times, str) and times == "all"):
        return times
    if isinstance(times, str) or np.ndim(times) != 1 or not len(times):
        raise InvalidArgument(f'times: seconds, [0.0, 0.5], or "all", not {times!r}', field="times")
    return tuple(number_of(time, "times") for time in times)


def _variants(variants: Mapping[str, Mapping[str, str]]) -> Mapping[str, Mapping[str, str]]:
    for path, wanted in variants.items():
        if not isinstance(wanted, Mapping):
            raise InvalidArgument(
                f"variants: {{prim path: {{set: variant}}}}, not {wanted!r} for {path}",
                field="variants",
            )
    return variants


def _above_zero(value: Any, field: str) -> float:
    number = number_of(value, field)
    if not number > 0:
        raise InvalidArgument(f"{field}: a number above 0, not {value!r}", field=field)
    return number
