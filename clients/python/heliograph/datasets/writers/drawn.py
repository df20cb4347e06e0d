"""The scene as one image shows it, and that image's lens. Used by writers that ask the daemon."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager

from ..._wire._proto import render_pb2
from ...client.scene import Scene
from ...errors import InvalidArgument
from ...render import call
from ...values.components import Camera
from ..writer import Dataset, Image


def request_of(scene: Scene, image: Image) -> render_pb2.RenderRequest:
    """The request that made an image's frame, with the whole overlay: manifests leave out large
    ones."""
    fields = json.loads(image.frame.manifest)
    fields.pop("overlay", None)
    request = call.request_of_manifest(scene, json.dumps(fields))
    if image.overlay is not None:
        request.overlay.CopyFrom(image.overlay.transaction)
    return request


@contextmanager
def drawn(scene: Scene, image: Image) -> Iterator[Scene]:
    """The scene with the image's overlay applied: a branch of its own, gone at the end."""
    with scene.branch() as branch:
        overlay = image.overlay
        if overlay is not None and overlay.transaction.edits:
            overlay.sources.complete(scene.client, lambda: branch.apply(overlay.transaction))
        yield branch


def camera_of(dataset: Dataset, image: Image) -> Camera:
    """The image's camera at its calibrated size, as the overlay left it; refuses rolling
    shutters."""
    if image.frame.rolling:
        raise InvalidArgument(
            f"{image.frame.camera}: has a rolling shutter, and the format has one pose for all "
            "rows; take rolling off, or write Exr, WebDataset or Parquet, which say how long it is",
            field="camera",
        )
    return dataset.lens_of(image)


def check_pinhole(dataset: Dataset, image: Image, format: str) -> None:
    """Refuses lenses that a format of K alone cannot describe."""
    camera = camera_of(dataset, image)
    if camera.projection != "perspective":
        wrong = f"is {camera.projection}"
    elif any(camera.distortion):
        wrong = f"has the distortion {camera.distortion}"
    else:
        return
    raise InvalidArgument(
        f"{image.frame.camera}: {wrong}, and {format} knows pinholes only; take the distortion "
        "off, or write NerfTransforms or Colmap",
        field="camera",
    )
