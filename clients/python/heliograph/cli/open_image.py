"""heliograph open: shows an image of a data set with its labels."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from ..errors import FailedPrecondition
from ._daemon import add_connection, connect


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "open",
        help="show an image of a data set with its labels",
        description="Renders an image of a data set, DIR/000123, again with every label, lists its "
        "instances, and shows the picture with boxes and names, or writes it to a file.",
    )
    parser.add_argument("image", help="DIR/000123, or a file of that image")
    parser.add_argument("-o", "--output", metavar="FILE", help="write it instead: .png or .jpg")
    add_connection(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    from ..datasets import KeptImage

    image = KeptImage.find(arguments.image)
    client: Any = connect(arguments)
    with client:
        frame = image.render_labelled(client)
    print(f"image {image.index} of {image.folder.root}, attempt {image.attempt}: {frame!r}")
    labels = frame.labels
    for row in np.argsort(-labels["visible"].astype(np.int64), kind="stable"):
        category = frame.categories.get(int(labels["category"][row]), "")
        print(
            f"{labels['label'][row]:6d}  {labels['name'][row]:24s} {category:16s} "
            f"{labels['visible'][row]:8d} px  {labels['visibility'][row]:6.1%}  "
            f"{labels['bbox_visible'][row].tolist()}"
        )
    picture = image.picture
    style: dict[str, Any] = {"exposure": picture.exposure, "view": picture.view} if picture else {}
    annotated = frame.annotated(**style)
    if arguments.output is None:
        try:
            annotated.show()
        except FailedPrecondition:
            message = "nothing here shows pictures: write it with -o FILE"
            raise FailedPrecondition(message) from None
    else:
        print(annotated.save(arguments.output))
    return 0
