"""heliograph rerender: renders a frame again from its manifest, to the same bytes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from . import add_connection, connect


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "rerender",
        help="render a frame again from its manifest and scene file",
        description="Renders a frame again from its manifest. The same daemon version and CPU "
        "feature level give the same bytes.",
    )
    parser.add_argument("manifest", help="manifest as .json (frame.save), or an .exr that has one")
    parser.add_argument("scene", help="scene file (scene.save) of the frame's revision")
    parser.add_argument("-o", "--output", required=True, metavar="FILE")
    add_connection(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    path = Path(arguments.manifest)
    if path.suffix.lower() == ".exr":
        from .. import exr

        text = exr.read_manifest(path)
    else:
        text = path.read_text()
    client: Any = connect(arguments)
    with client, client.load_scene(arguments.scene) as scene:
        frame = scene.rerender(text)
    for written in frame.save(arguments.output):
        print(written)
    return 0
