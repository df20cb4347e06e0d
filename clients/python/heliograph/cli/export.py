"""heliograph export: a scene or a model as a GLB or USDZ file."""

from __future__ import annotations

import argparse
import contextlib
import sys
import warnings
from pathlib import Path
from typing import Any

from ..export.write import checked_path
from ._daemon import add_connection, check_source, connect
from .render import add_model, imported


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "export",
        help="write a scene or a model as .glb or .usdz",
        description="Writes a scene for other programs, with its motion. Features that the "
        "format lacks are named on the standard error.",
    )
    parser.add_argument(
        "model",
        nargs="?",
        metavar="FILE",
        help="a scene file (.helio) or a model (glTF, GLB, DAE, OBJ, PLY, STL, USD)",
    )
    parser.add_argument("--scene", metavar="NAME", help="a scene of the daemon at --address")
    parser.add_argument(
        "-o", "--output", required=True, metavar="FILE", help=".glb (glTF 2.0) or .usdz"
    )
    add_model(parser.add_argument_group("model"))
    parser.set_defaults(time=0.0)  # of USD files the motion, too
    add_connection(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    check_source(arguments, "export")
    output = checked_path(arguments.output)
    client: Any = connect(arguments)
    with client, contextlib.ExitStack() as stack:
        scene = _scene(client, stack, arguments)
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            scene.export(output)
    for warning in found:
        print(f"heliograph: {warning.message}", file=sys.stderr)
    print(f"{output} ({output.stat().st_size / 1e6:.1f} MB)")
    return 0


def _scene(client: Any, stack: contextlib.ExitStack, arguments: argparse.Namespace) -> Any:
    if arguments.scene is not None:
        return client.open_scene(arguments.scene)
    if Path(arguments.model).suffix.lower() == ".helio":
        return stack.enter_context(client.load_scene(arguments.model))
    scene = stack.enter_context(client.create_scene(Path(arguments.model).stem))
    with scene.edit() as edit:
        asset = imported(edit, arguments)
    for warning in asset.warnings:
        print(f"heliograph: {arguments.model}: {warning}", file=sys.stderr)
    return scene
