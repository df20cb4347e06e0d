"""heliograph dataset: makes a labelled data set of one of the paper's scenes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ._daemon import add_connection, connect

_LABEL_PLANES = ("depth", "normal", "instance", "semantic")


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "dataset",
        help="make a labelled data set: dome, mesh or fat",
        description="Makes a labelled data set of a scene that is random in every image. dome: "
        "objects under HDR domes among flying distractors. mesh: a thousand random meshes that "
        "move, with backward flow. fat: objects fall onto a textured plane. Run again after a "
        "kill, it makes what is missing.",
    )
    parser.add_argument("scene", choices=("dome", "mesh", "fat"))
    parser.add_argument("--out", metavar="DIR", help="where the data set goes")
    parser.add_argument("--count", type=int, default=100, metavar="N", help="images; default 100")
    parser.add_argument("--seed", type=int, default=0, help="of all draws; default 0")
    parser.add_argument("--spp", type=int, default=64, help="samples per pixel; default 64")
    parser.add_argument("--size", metavar="WxH", help="pixels; default 640x480")
    parser.add_argument(
        "--format",
        choices=("coco", "yolo", "ndds", "bop", "exr", "parquet"),
        default="coco",
        help="default coco; exr: beauty, depth, normal, instance, semantic, of mesh backward flow, "
        "and all label columns",
    )
    parser.add_argument(
        "--labels-only",
        action="store_true",
        help="shade nothing: planes of labels and columns, of the format exr or parquet",
    )
    parser.add_argument("--config", metavar="FILE", help="settings of the scene, TOML")
    parser.add_argument(
        "--print-config", action="store_true", help="print all settings as TOML, and end"
    )
    add_connection(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    import heliograph.datasets as hd

    from ..datasets.scenes import make_scene, read_settings, settings_text
    from ..errors import InvalidArgument

    settings = read_settings(arguments.config) if arguments.config else {}
    if arguments.size:
        settings["width"], settings["height"] = _size_of(arguments.size)
    made = make_scene(arguments.scene, **settings)
    if arguments.print_config:
        print(settings_text(made), end="")
        return 0
    if not arguments.out:
        raise InvalidArgument("--out: say where the data set goes", field="out")
    writer = _writer(arguments)
    client: Any = connect(arguments)
    with client, client.create_scene() as scene:
        camera, randomizer = made.build(scene)
        done = hd.generate(
            scene,
            camera,
            randomizer,
            count=arguments.count,
            writer=writer,
            spp=arguments.spp,
            seed=arguments.seed,
            **made.options,
        )
    rate = f", {60 * done.images / done.seconds:.1f} a minute" if done.images else ""
    print(f"{arguments.out}: {done.images} images made, {done.skipped} were there{rate}")
    return 0


def _size_of(text: str) -> tuple[int, int]:
    from ..errors import InvalidArgument

    width, cross, height = text.partition("x")
    if not (cross and width.isdigit() and height.isdigit()):
        raise InvalidArgument(f"--size: {text!r} is not like 640x480", field="size")
    return int(width), int(height)


def _writer(arguments: argparse.Namespace) -> Any:
    """The writer of the format, with flow where the scene moves."""
    import heliograph.datasets as hd

    from ..errors import InvalidArgument

    out, name = Path(arguments.out), arguments.format
    flow = ("flow_backward", "flow_backward_valid") if arguments.scene == "mesh" else ()
    if arguments.labels_only:
        if name not in ("exr", "parquet"):
            raise InvalidArgument(
                f"--labels-only: {name} has pictures; give --format exr or parquet",
                field="labels_only",
            )
        planes = (*_LABEL_PLANES, *flow)
        return hd.Exr(out, planes=planes) if name == "exr" else hd.Parquet(out)
    if name == "exr":
        return hd.Exr(out, planes=("beauty", *_LABEL_PLANES, *flow), picture="png")
    writers = {"coco": hd.Coco, "yolo": hd.Yolo, "ndds": hd.Ndds, "bop": hd.Bop}
    writers["parquet"] = hd.Parquet
    return writers[name](out)
