"""heliograph rerender: renders a frame, or an image of a data set, again, to the same bytes."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InvalidArgument, NotFound
from ._daemon import EXIT_FAILED, add_connection, with_client

if TYPE_CHECKING:
    from ..client.client import Client


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "rerender",
        help="render a frame, or an image of a data set, again",
        description="Renders a frame again from its manifest and scene file, or an image of a data "
        "set, DIR/000123, which keeps both. The same daemon version and CPU feature level give the "
        "same bytes; of an image that is checked: exit status 1 says that they differ.",
    )
    parser.add_argument(
        "frame", help="DIR/000123; or a manifest as .json (frame.save), or an .exr that has one"
    )
    parser.add_argument(
        "scene", nargs="?", help="scene file (scene.save) of the frame's revision, for a manifest"
    )
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        help=".png, .jpg, .exr, .npz or .json; the .png of an image is the data set's",
    )
    add_connection(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    if arguments.scene is None:
        return _run_image(arguments)
    if arguments.output is None:
        raise InvalidArgument("output: say with -o FILE where the frame goes", field="output")
    text = _manifest_of(Path(arguments.frame))

    def render(client: Client) -> Any:
        with client.load_scene(arguments.scene) as scene:
            return scene.rerender(text)

    frame = with_client(arguments, render)
    for written in frame.save(arguments.output):
        print(written)
    return 0


def _manifest_of(path: Path) -> str:
    if not path.is_file():
        raise NotFound(f"no file {path}", field="frame")
    if path.suffix.lower() == ".exr":
        from ..image import exr

        return exr.read_manifest(path)
    try:
        return path.read_text("utf-8")
    except UnicodeDecodeError:
        raise InvalidArgument(
            f"{path} is no manifest: give a .json (frame.save) or an .exr", field="frame"
        ) from None


def _run_image(arguments: argparse.Namespace) -> int:
    from ..datasets import KeptImage

    try:
        image = KeptImage.find(arguments.frame)
    except NotFound as error:
        path = Path(arguments.frame)
        if error.field == "path" and path.suffix.lower() in (".exr", ".json"):
            raise InvalidArgument(
                f"{path}: give the scene file (scene.save) too", field="scene"
            ) from None
        raise
    frame = with_client(arguments, image.render)
    picture = image.picture
    if arguments.output is not None:
        target = Path(arguments.output)
        if picture is not None and target.suffix == f".{picture.format}":
            target.write_bytes(picture.encode(frame))
            print(target)
        else:
            for written in frame.save(target):
                print(written)
    if image.is_same(frame):
        print("the same bytes")
        return 0
    print(f"other bytes than were written: {image.why_not(frame)}", file=sys.stderr)
    return EXIT_FAILED
