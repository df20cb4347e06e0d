"""Labels drawn on a frame's picture, one function a layer. Called by Frame.annotated."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire.arrays import NdArray
from ..errors import InvalidArgument, Unimplemented
from . import tonemap
from ._canvas import Canvas, Color
from .picture import Picture

if TYPE_CHECKING:
    from ..render.frame import Frame

DEFAULT_LAYERS = ("boxes", "names")
_AXES = ((236, 72, 62), (76, 187, 76), (72, 128, 248))  # x, y, z
# Edges of a box between corners i and i | 1 << axis.
_EDGES = [(i, axis) for axis in range(3) for i in range(8) if not i >> axis & 1]


@dataclass(frozen=True)
class Row:
    """An instance that is drawn: its place in the label columns, id, texts and colour."""

    index: int
    label: int
    name: str
    category: str
    color: Color


class Drawing:
    """State that the layers share: the frame, the canvas, and the chosen instances."""

    def __init__(self, frame: Frame, canvas: Canvas, only: Any, skeleton: Sequence[Any]) -> None:
        self.frame = frame
        self.canvas = canvas
        self.skeleton = [_edge_of(edge) for edge in skeleton]
        self._only = None if only is None else _chosen(only)

    def column(self, layer: str, name: str, remedy: str) -> Any:
        """A label column. InvalidArgument, with the remedy, where it is missing."""
        if name not in self.frame.labels:
            raise InvalidArgument(
                f"{layer}: the frame has no labels {name!r}; render with {remedy}", field=layer
            )
        return self.frame.labels[name]

    def plane(self, layer: str, name: str) -> NdArray:
        if name not in self.frame:
            raise InvalidArgument(
                f"{layer}: needs the plane {name!r}; render with planes=[..., {name!r}]",
                field=layer,
            )
        return self.frame[name]

    def rows(self, layer: str) -> list[Row]:
        """The instances chosen, far ones first where the frame knows how far they are."""
        labels = self.column(layer, "label", "labels=True")
        names, classes = self.frame.labels["name"], self.frame.labels.get("category", labels * 0)
        colors = tonemap.colors_of_ids(labels)
        rows = []
        for i, label in enumerate(labels):
            category = self.frame.categories.get(int(classes[i]), "")
            rows.append(Row(i, int(label), names[i] or f"#{label}", category, _color(colors[i])))
        if self._only is not None:
            rows = [r for r in rows if {r.label, r.name, r.category} & self._only]
        poses = self.frame.labels.get("camera_from_object_cv")
        if poses is None:
            return rows
        return sorted(rows, key=lambda row: -float(poses[row.index, 2, 3]))


def annotated(frame: Frame, layers: Sequence[str], base: Picture, options: Any) -> Picture:
    """See Frame.annotated; base: the picture beneath; options: only, skeleton, scale."""
    unknown = [name for name in layers if name not in LAYERS]
    if unknown:
        raise InvalidArgument(
            f"layers: {unknown[0]!r} is none of {', '.join(LAYERS)}", field="layers"
        )
    scale = options["scale"]
    if scale not in range(1, 17):
        raise InvalidArgument(f"scale: a whole number, 1 to 16, not {scale!r}", field="scale")
    rgb = np.asarray(base)
    rgb = np.repeat(rgb[..., None], 3, axis=2) if rgb.ndim == 2 else rgb[..., :3]
    canvas = Canvas(rgb, int(scale))
    drawing = Drawing(frame, canvas, options["only"], options["skeleton"])
    for name, draw in LAYERS.items():  # areas first, text last, whatever the order given
        if name in layers:
            draw(drawing)
    return canvas.finished()


# ---------------------------------------------------------------- areas


def _masks(d: Drawing) -> None:
    ids = d.plane("masks", "instance")
    chosen = np.isin(ids, [row.label for row in d.rows("masks")])
    d.canvas.blend(chosen, tonemap.colors_of_ids(ids), 0.5)


def _outlines(d: Drawing) -> None:
    ids = d.plane("outlines", "instance")
    for row in d.rows("outlines"):
        d.canvas.outline(ids == row.label, row.color)


def _amodal(d: Drawing) -> None:
    """Edge of the whole silhouette; its hidden part is tinted where the plane instance is there."""
    d.column("amodal", "amodal_masks", 'labels={"amodal_masks": True}')
    for row in d.rows("amodal"):
        mask = d.frame.amodal_mask(row.label)
        if "instance" in d.frame:
            d.canvas.blend(mask & (d.frame["instance"] != row.label), row.color, 0.3)
        d.canvas.outline(mask, row.color)


# ---------------------------------------------------------------- boxes


def _boxes(d: Drawing) -> None:
    boxes = d.column("boxes", "bbox_visible", "labels=True")
    for row in d.rows("boxes"):
        if _has_area(boxes[row.index]):
            d.canvas.rectangle(boxes[row.index], row.color)


def _amodal_boxes(d: Drawing) -> None:
    boxes = d.column("amodal_boxes", "bbox_amodal", "labels=True")
    for row in d.rows("amodal_boxes"):
        if _has_area(boxes[row.index]):
            d.canvas.dashes(boxes[row.index], row.color)


def _has_area(box: NdArray) -> bool:
    return bool(box[2] > box[0] and box[3] > box[1])


def _cuboids(d: Drawing) -> None:
    """3D boxes; edges behind the box are thin. They are straight between the corners, which is
    exact for lenses without distortion."""
    image = d.column("cuboids", "corners_image", "labels=True").astype("f8")
    camera = d.frame.labels["corners_camera"].astype("f8")
    for row in d.rows("cuboids"):
        points = _corners_in_front(d.frame, camera[row.index], image[row.index])
        seen = _faces_seen(camera[row.index])
        for (i, axis), ends in points.items():
            others = [a for a in range(3) if a != axis]
            front = any(seen[a, i >> a & 1] for a in others)
            d.canvas.path(list(ends + 0.5), row.color, 1.15 if front else 0.5)


def _faces_seen(corners: NdArray) -> NdArray:
    """(3, 2) bool: is the lower and the upper face of each axis turned towards the camera."""
    seen = np.zeros((3, 2), dtype=bool)
    for axis in range(3):
        upper = np.array([i >> axis & 1 for i in range(8)], dtype=bool)
        low, high = corners[~upper].mean(axis=0), corners[upper].mean(axis=0)
        seen[axis] = [np.dot(high - low, low) > 0, np.dot(high - low, high) < 0]
    return seen


def _corners_in_front(
    frame: Frame, camera: NdArray, image: NdArray
) -> dict[tuple[int, int], NdArray]:
    """(corner, axis) -> the (2, 2) ends of that edge in the image, cut where it leaves the half
    space in front of a pinhole camera; edges that lie behind are not there."""
    out = {}
    for i, axis in _EDGES:
        pair = [i, i | 1 << axis]
        ends = image[pair].copy()
        seen = np.asarray(np.isfinite(ends).all(axis=1))
        if not seen.any():
            continue
        if not seen.all():
            inner, outer = pair if seen[0] else pair[::-1]
            if not _is_pinhole(frame, camera[inner], image[inner]):
                continue
            near = 0.02 * camera[inner, 2]
            share = (camera[inner, 2] - near) / (camera[inner, 2] - camera[outer, 2])
            cut = camera[inner] + share * (camera[outer] - camera[inner])
            ends[0 if outer == pair[0] else 1] = _project(frame, cut[None])[0]
        out[i, axis] = ends
    return out


def _project(frame: Frame, points: NdArray) -> NdArray:
    """(N, 2) K coordinates of points (N, 3) in the OpenCV camera, by K alone."""
    homogeneous = points @ frame.K.T
    return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])


def _is_pinhole(frame: Frame, camera: NdArray, image: NdArray) -> bool:
    """Does K alone put a point where the camera has it."""
    error = np.abs(_project(frame, np.atleast_2d(camera)) - np.atleast_2d(image))
    return bool(np.nanmax(error) < 0.5)


def _axes(d: Drawing) -> None:
    """The object frame's axes at its origin: x red, y green, z blue."""
    poses = d.column("axes", "camera_from_object_cv", "labels=True")
    image, camera = d.frame.labels["corners_image"], d.frame.labels["corners_camera"]
    for row in d.rows("axes"):
        seen = np.asarray(np.all(np.isfinite(image[row.index]), axis=1))
        pose, half = poses[row.index], d.frame.labels["box_half_extents"][row.index]
        tips = pose[:3, 3] + 1.15 * float(half.max()) * np.vstack([np.zeros(3), pose[:3, :3].T])
        if not seen.any() or tips[:, 2].min() <= 1e-6:
            continue
        if not _is_pinhole(d.frame, camera[row.index][seen], image[row.index][seen]):
            raise Unimplemented(
                "axes: this camera is no pinhole, and only K is known to the client; choose "
                '"cuboids", whose corners have their exact places'
            )
        points = _project(d.frame, tips) + 0.5
        for axis in np.argsort(-tips[1:, 2]):
            d.canvas.arrow(points[0], points[1 + axis], _AXES[axis], 1.5)


# ---------------------------------------------------------------- points and motion


def _keypoints(d: Drawing) -> None:
    """Dots: filled where visible, rings where hidden; lines by `skeleton`."""
    remedy = 'labels={"keypoints": True}'
    owners = d.column("keypoints", "keypoint_instance", remedy)
    states, names = d.frame.labels["keypoint_state"], d.frame.labels["keypoint_name"]
    points = d.frame.labels["keypoint_image"].astype("f8") + 0.5
    for row in d.rows("keypoints"):
        mine = [i for i in np.flatnonzero(owners == row.label) if np.isfinite(points[i]).all()]
        at = {key: points[i] for k, i in enumerate(mine) for key in (k, names[i])}
        for a, b in d.skeleton:
            if a in at and b in at:
                d.canvas.path([at[a], at[b]], row.color, 1.4)
        for i in mine:
            if states[i] > 0:
                d.canvas.disc(points[i], row.color, filled=bool(states[i] == 3))


def _flow_of(d: Drawing, layer: str) -> NdArray:
    name = "flow_backward" if "flow_backward" in d.frame else "flow_forward"
    flow = np.array(d.plane(layer, name))
    if f"{name}_valid" in d.frame:
        flow[d.frame[f"{name}_valid"] == 0] = np.nan
    return flow


def _flow(d: Drawing) -> None:
    """Arrows in true length on a grid, coloured by the wheel; still points are left out."""
    flow = _flow_of(d, "flow")
    step = max(6, round(24 / d.canvas.scale), round(max(d.frame.width, d.frame.height) / 40))
    colors = tonemap.colors_of_flow(flow)
    for y in range(step // 2, d.frame.height, step):
        for x in range(step // 2, d.frame.width, step):
            if np.hypot(*flow[y, x]) >= 0.5:
                start = np.array([x + 0.5, y + 0.5])
                d.canvas.arrow(start, start + flow[y, x], _color(colors[y, x]), 0.8)


def _wheel(d: Drawing) -> None:
    """The key of the colours of flow, in the lower right corner; its rim is the fastest pixel."""
    flow = _flow_of(d, "wheel")
    radius = max(12, min(d.frame.width, d.frame.height) // 9)
    middle = np.array([d.frame.width, d.frame.height]) - radius - max(4, radius // 5)
    ys, xs = np.mgrid[: d.frame.height, : d.frame.width]
    offsets = np.stack([xs - middle[0], ys - middle[1]], axis=2).astype("f4") / radius
    inside = np.hypot(offsets[..., 0], offsets[..., 1]) <= 1
    d.canvas.blend(inside, tonemap.colors_of_flow(offsets, reach=1.0), 1.0)
    fastest = np.nanmax(np.hypot(flow[..., 0], flow[..., 1]), initial=0.0)
    corner = [*(middle - radius), *(middle + radius)]
    d.canvas.tag(corner, f"{fastest:.1f} px", (235, 237, 240))


# ---------------------------------------------------------------- text


def _names(d: Drawing) -> None:
    _tag(d, "names", lambda row: row.name)


def _categories(d: Drawing) -> None:
    _tag(d, "categories", lambda row: row.category)


def _tag(d: Drawing, layer: str, text_of: Any) -> None:
    boxes = d.column(layer, "bbox_visible", "labels=True")
    for row in reversed(d.rows(layer)):  # near ones have the choice of places
        if _has_area(boxes[row.index]) and text_of(row):
            d.canvas.tag(boxes[row.index], text_of(row), row.color)


LAYERS = {
    "masks": _masks,
    "amodal": _amodal,
    "outlines": _outlines,
    "amodal_boxes": _amodal_boxes,
    "boxes": _boxes,
    "flow": _flow,
    "cuboids": _cuboids,
    "axes": _axes,
    "keypoints": _keypoints,
    "wheel": _wheel,
    "names": _names,
    "categories": _categories,
}


def _chosen(only: Any) -> set[Any]:
    listed: Iterable[Any] = [only] if isinstance(only, (str, int, np.integer)) else only
    return {int(item) if isinstance(item, np.integer) else item for item in listed}


def _edge_of(edge: Any) -> tuple[Any, Any]:
    ends = tuple(item if isinstance(item, str) else int(item) for item in edge)
    if len(ends) != 2:
        raise InvalidArgument(
            f"skeleton: edges are pairs of names or numbers of keypoints, not {edge!r}",
            field="skeleton",
        )
    return ends[0], ends[1]


def _color(rgb: NdArray) -> Color:
    return int(rgb[0]), int(rgb[1]), int(rgb[2])
