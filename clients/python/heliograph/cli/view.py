"""heliograph view: a scene in a browser."""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path
from typing import Any

from ._daemon import add_connection, check_source, connect
from .render import add_view, build


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "view",
        help="look at a model or a scene in a browser",
        description="Serves one page on loopback and prints its address, which has a token in it: "
        "anyone who has it sees the scene. Ctrl-C ends it.",
    )
    parser.add_argument(
        "model",
        nargs="?",
        metavar="FILE",
        help="a model (glTF, GLB, DAE, OBJ, PLY, STL) or a scene file (.helio)",
    )
    parser.add_argument("--scene", metavar="NAME", help="a scene of the daemon at --address")
    parser.add_argument("--port", type=int, default=0, help="default: any free one")
    parser.add_argument("--spp", type=int, default=1024, help="samples per pixel; default 1024")
    parser.add_argument("--open", action="store_true", help="open the browser, too")
    parser.set_defaults(size=(960, 540))
    add_view(parser)
    add_connection(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    check_source(arguments, "view")
    client: Any = connect(arguments)
    with client, contextlib.ExitStack() as stack:
        if arguments.scene is not None:
            scene, camera = client.open_scene(arguments.scene), arguments.camera
        elif Path(arguments.model).suffix.lower() == ".helio":
            scene = stack.enter_context(client.load_scene(arguments.model))
            camera = arguments.camera
        else:
            scene = stack.enter_context(client.create_scene(Path(arguments.model).name))
            camera = build(scene, arguments)
        return _serve(scene, camera, arguments)


def _serve(scene: Any, camera: Any, arguments: argparse.Namespace) -> int:
    from ..viewer import Viewer

    with Viewer(scene, camera, port=arguments.port, spp=arguments.spp) as viewer:
        print(viewer.url, flush=True)
        print("Ctrl-C ends it.", file=sys.stderr)
        if arguments.open:
            import webbrowser

            webbrowser.open(viewer.url)
        with contextlib.suppress(KeyboardInterrupt):
            viewer.wait()
    return 0
