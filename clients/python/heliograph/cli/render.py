"""heliograph render: a picture of a model file, framed, lit and exposed by itself."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InvalidArgument
from ..image.tonemap import VIEWS
from ..render.frame import Frame
from ..scene import studio
from ..scene.assets import USD_ENDINGS
from ..usd.asset import UsdAsset
from ..values import components, framing
from ._daemon import add_connection, connect


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "render",
        help="render a model file",
        description="Renders a model (glTF, GLB, DAE, OBJ, PLY, STL, USD). The camera frames it; a "
        "model without a light stands in the bundled studio.",
    )
    parser.add_argument("model", help="the model file")
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="FILE",
        help=".png or .jpg: pictures, out.depth.png and so on beside it; .exr: all planes, as they "
        "are, in one file; .npz: planes and labels",
    )
    parser.add_argument("--size", type=parse_size, default=(960, 540), metavar="WxH")
    parser.add_argument("--spp", type=int, metavar="N", help="samples per pixel; default 128")
    parser.add_argument("--seconds", type=float, help="stop after this long")
    parser.add_argument("--noise", type=float, help="stop below this relative error, e.g. 0.02")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--planes", default="", metavar="A,B", help="planes besides beauty: depth,normal,instance"
    )
    add_view(parser)
    _add_picture(parser)
    add_connection(parser)
    parser.set_defaults(run=run)


def add_view(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("scene")
    group.add_argument("--camera", metavar="NAME", help="a camera of the model")
    group.add_argument("--fov", type=float, default=35.0, help="degrees across; default 35")
    group.add_argument("--azimuth", type=float, default=35.0, help="degrees around; default 35")
    group.add_argument("--elevation", type=float, default=18.0, help="degrees above; default 18")
    group.add_argument("--dome", metavar="FILE", help="a lat-long EXR or HDR instead of the studio")
    group.add_argument(
        "--floor",
        action=argparse.BooleanOptionalAction,
        help="stand it on a floor; default: where the model has no light",
    )
    add_model(group)
    group.add_argument("--time", type=float, metavar="SECONDS", help="default 0")


def add_model(group: Any) -> None:
    """Adds the options for reading a model file."""
    group.add_argument("--up", default="", choices=["x", "y", "z"], help="for formats without one")
    group.add_argument("--units", type=float, default=0.0, help="metres per unit, likewise")
    group.add_argument(
        "--folder", action="append", default=[], help="a further one that has the model's textures"
    )
    group.add_argument("--variant", default="", metavar="NAME", help="of a glTF that has several")
    group.add_argument("--surface", action="store_true", help="of a volume: level sets as a mesh")
    group.add_argument("--strict", action="store_true", help="refuse a model that lacks textures")
    group.add_argument("--animation", metavar="NAME", help="a clip to bind")


def _add_picture(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("picture")
    group.add_argument("--exposure", default="auto", metavar="STOPS", help='stops, or "auto"')
    group.add_argument("--view", default="standard", choices=VIEWS)


def parse_size(text: str) -> tuple[int, int]:
    """ "960x540"."""
    width, cross, height = text.lower().partition("x")
    if not (cross and width.isdigit() and height.isdigit()):
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, e.g. 960x540")
    return int(width), int(height)


def run(arguments: argparse.Namespace) -> int:
    _check_output(Path(arguments.output))
    exposure = _exposure_of(arguments.exposure)
    planes = ["beauty"]
    planes += [p.strip() for p in arguments.planes.split(",") if p.strip() not in ("", "beauty")]
    options: dict[str, Any] = {"planes": planes, "seed": arguments.seed, "size": arguments.size}
    for name in ("spp", "seconds", "noise", "time"):
        if getattr(arguments, name) is not None:
            options[name] = getattr(arguments, name)
    if not any(name in options for name in ("spp", "seconds", "noise")):
        options["spp"] = 128
    client: Any = connect(arguments)
    with client, client.create_scene() as scene:
        camera = build(scene, arguments)
        frame = scene.render(camera, **options)
    for warning in frame.warnings:
        print(f"heliograph: {warning}", file=sys.stderr)
    written = frame.save(arguments.output, exposure=exposure, view=arguments.view)
    _report(frame, written)
    return 0


def _check_output(path: Path) -> None:
    if path.suffix.lower() not in (".png", ".jpg", ".jpeg", ".exr", ".npz"):
        raise InvalidArgument(f"-o {path}: needs one of .png .jpg .exr .npz", field="output")
    if not path.parent.is_dir():
        raise InvalidArgument(f"-o {path}: there is no folder {path.parent}", field="output")


def _exposure_of(text: str) -> float | str:
    if text == "auto":
        return text
    try:
        return float(text)
    except ValueError:
        raise InvalidArgument(f'--exposure {text!r}: stops, or "auto"', field="exposure") from None


def build(scene: Any, arguments: argparse.Namespace) -> Any:
    """Imports the model, lights it where it has no light, and places the camera."""
    with scene.edit() as edit:
        asset = imported(edit, arguments)
    for warning in asset.warnings:
        print(f"heliograph: {arguments.model}: {warning}", file=sys.stderr)
    bounds = np.asarray(_bounds(asset), dtype="f8")
    has_light = _has_light(asset)
    with scene.edit() as edit:
        if arguments.dome:
            edit.dome(arguments.dome)
        elif not has_light:
            edit.dome(studio.dome())
        if arguments.floor or (arguments.floor is None and not has_light):
            _add_floor(edit, bounds)
        if arguments.camera:
            return _camera_named(asset, arguments.camera)
        width, height = arguments.size
        lens = components.Camera.from_fov(arguments.fov, width, height, degrees=True)
        pose = framing.frame_box(
            bounds, lens, azimuth=arguments.azimuth, elevation=arguments.elevation
        )
        return edit.entity("render/camera", camera=lens, transform=pose)


def imported(edit: Any, arguments: argparse.Namespace) -> Any:
    """The asset of a model file."""
    if Path(arguments.model).suffix.lower() not in USD_ENDINGS:
        return edit.import_file(
            arguments.model,
            up=arguments.up,
            units=arguments.units,
            variant=arguments.variant,
            surface=arguments.surface,
            folders=arguments.folder,
            strict=arguments.strict,
            animation=arguments.animation,
        )
    for name in ("up", "variant", "surface", "animation", "folder", "strict"):
        if getattr(arguments, name):
            raise InvalidArgument(f"--{name}: USD files have their own; leave it out", field=name)
    times = None if arguments.time is None else "all"
    return edit.import_usd(arguments.model, units=arguments.units, times=times)


def _bounds(asset: Any) -> Any:
    if isinstance(asset, UsdAsset) or asset.bounds is None:
        return asset.root.aabb
    return asset.bounds


def _has_light(asset: Any) -> bool:
    if isinstance(asset, UsdAsset):
        return bool(asset.lights) or asset.model.dome is not None
    return any(entity.light is not None for entity in asset.entities)


def _camera_named(asset: Any, name: str) -> Any:
    cameras = asset.cameras.values() if isinstance(asset, UsdAsset) else asset.cameras
    for camera in cameras:
        if camera.name.rpartition("/")[2] == name or camera.name == name:
            return camera
    have = ", ".join(c.name.rpartition("/")[2] for c in cameras) or "none"
    raise InvalidArgument(f"--camera {name!r}: the model has {have}", field="camera")


def _add_floor(edit: Any, bounds: Any) -> None:
    """Under the box, and wide enough for its horizon to lie far behind it."""
    size = float(np.linalg.norm(bounds[1] - bounds[0]))
    middle = 0.5 * (bounds[0] + bounds[1])
    below = float(bounds[0][2]) - 1e-4 * size
    studio.add_floor(edit, 60 * size, (float(middle[0]), float(middle[1]), below))


def _report(frame: Frame, written: list[Path]) -> None:
    rate = frame.rays / max(frame.render_seconds, 1e-9) * 1e-6
    took = f"{frame.samples} samples per pixel in {frame.render_seconds:.2f} s, {rate:.1f} Mrays/s"
    print(f"{', '.join(str(path) for path in written)} ({took})")
