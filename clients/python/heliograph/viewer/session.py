"""Session of one open page: its wishes, the stream of frames for it, and the latest picture."""

from __future__ import annotations

import io
import math
import threading
import time
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire.arrays import NdArray
from ..errors import HeliographError, InvalidArgument
from ..image import annotate
from ..image.picture import Picture
from ..values.components import Camera
from ..values.pose import look_at

if TYPE_CHECKING:
    from ..client.scene import Scene
    from ..render.frame import Frame
    from ..render.live import Live

CAMERA = "viewer/camera"  # of the overlay; the scene never has it
PLANES = (
    "beauty", "denoised", "depth", "normal", "instance", "semantic", "part", "material",
    "base_color", "roughness", "metallic", "emission", "uv", "object_coordinates", "nocs",
)  # fmt: skip
LAYERS = (
    "boxes", "names", "categories", "masks", "outlines", "amodal", "amodal_boxes", "cuboids",
    "axes", "keypoints",
)  # fmt: skip
_NEEDS_INSTANCE = {"masks", "outlines", "amodal"}
_LARGEST = 4096  # pixels a side


@dataclass(frozen=True)
class Wish:
    """Wish of a page. camera: one of the scene, or "" for the free one at eye, which looks at
    target and is fov degrees high. width, height: pixels of the free one."""

    camera: str = ""
    eye: tuple[float, ...] = (0.0, -1.0, 0.0)
    target: tuple[float, ...] = (0.0, 0.0, 0.0)
    fov: float = 35.0
    width: int = 640
    height: int = 360
    plane: str = "beauty"
    layers: tuple[str, ...] = ()
    exposure: float | str = "auto"
    view: str = "standard"

    @classmethod
    def of(cls, given: Any, before: Wish) -> Wish:
        """Wish from JSON: fields that are not given stay as before. InvalidArgument."""
        names = {field.name for field in fields(cls)}
        if not isinstance(given, dict) or not set(given) <= names:
            raise InvalidArgument(f"wish: an object with some of {', '.join(sorted(names))}")
        for name, value in given.items():
            given[name] = _checked(name, value)
        wish = replace(before, **given)
        if wish.eye == wish.target:
            raise InvalidArgument("eye: is where the target is; move one of them", field="eye")
        return wish

    def same_frame(self, other: Wish) -> bool:
        """Does the same frame serve both, shown in another way."""
        mine, its = (replace(w, layers=(), exposure=0.0, view="") for w in (self, other))
        return mine == its and self.needs() == other.needs()

    def needs(self) -> dict[str, Any]:
        """The planes and labels to render."""
        chosen = set(self.layers)
        planes = [self.plane]
        if chosen & _NEEDS_INSTANCE and self.plane != "instance":
            planes.append("instance")
        labels = {
            "boxes": bool(chosen),
            "amodal": "amodal_boxes" in chosen,
            "amodal_masks": "amodal" in chosen,
            "keypoints": "keypoints" in chosen,
        }
        return {"planes": planes, "labels": labels if chosen else False}


def _checked(name: str, value: Any) -> Any:
    if name in ("eye", "target"):
        numbers = isinstance(value, list) and len(value) == 3
        if not numbers or not all(_is_finite(v) for v in value):
            raise InvalidArgument(f"{name}: three numbers, not {value!r}", field=name)
        return tuple(float(v) for v in value)
    if name in ("width", "height"):
        if not _is_finite(value) or not 16 <= value <= _LARGEST:
            raise InvalidArgument(f"{name}: 16 to {_LARGEST} pixels, not {value!r}", field=name)
        return int(value)
    if name == "fov":
        if not _is_finite(value) or not 1 <= value <= 160:
            raise InvalidArgument(f"fov: 1 to 160 degrees, not {value!r}", field=name)
        return float(value)
    if name == "exposure":
        if value != "auto" and not (_is_finite(value) and abs(value) <= 32):
            raise InvalidArgument(f'exposure: -32 to 32 stops or "auto", not {value!r}', field=name)
        return value
    if name == "layers":
        if not isinstance(value, list) or not set(map(str, value)) <= set(annotate.LAYERS):
            raise InvalidArgument(f"layers: some of {', '.join(LAYERS)}, not {value!r}", field=name)
        return tuple(value)
    if not isinstance(value, str):
        raise InvalidArgument(f"{name}: a text, not {value!r}", field=name)
    return value


def _is_finite(value: Any) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)


class Session:
    """Thread: any. A thread of its own reads the stream; close() ends it."""

    def __init__(self, scene: Scene, spp: int) -> None:
        self._scene = scene
        self._spp = spp
        self._changed = threading.Condition()
        self._wish = Wish()
        self._wanted = False  # a stream has to be opened
        self._closed = False
        self._live: Live | None = None
        self._frame: Frame | None = None
        self._serial = 0
        self._error = ""
        self.seen = time.monotonic()
        self._thread = threading.Thread(target=self._read, name="viewer", daemon=True)
        self._thread.start()

    def want(self, given: Any) -> None:
        """A wish of the page, as JSON."""
        with self._changed:
            wish = Wish.of(given, self._wish)
            same = self._frame is not None and not self._error and wish.same_frame(self._wish)
            self._wish = wish
            if same:  # shown anew, not rendered
                self._serial += 1
            elif self._live is not None:
                self._live.update(**self._settings())
            else:
                self._wanted = True
            self._changed.notify_all()

    def _settings(self) -> dict[str, Any]:
        wish = self._wish
        with self._scene.overlay() as overlay:
            if not wish.camera:
                lens = Camera.from_fov(
                    wish.fov, wish.width, wish.height, axis="y", degrees=True
                )  # fmt: skip
                pose = look_at(wish.eye, wish.target)
                overlay.entity(CAMERA, camera=lens, transform=pose)
        out: dict[str, Any] = {"cameras": wish.camera or CAMERA, "overlay": overlay}
        return {**out, "spp": self._spp, **wish.needs()}

    def _read(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._wanted or self._closed)
                if self._closed:
                    return
                self._wanted = False
            try:
                self._stream()
            except HeliographError as error:
                self._publish(None, str(error))
            finally:
                self._live = None

    def _stream(self) -> None:
        with self._changed:
            live = self._scene.stream(policy="latest", **self._settings())
            self._live = live
        with live:
            for frame in live:
                self._publish(frame, "")
                if self._closed:
                    return

    def _publish(self, frame: Frame | None, error: str) -> None:
        with self._changed:
            if self._closed:
                return
            self._frame = frame or self._frame
            self._error = error
            self._serial += 1
            self._changed.notify_all()

    # ------------------------------------------------------------ what the page gets

    def next(self, after: int, seconds: float) -> tuple[dict[str, Any], bytes] | None:
        """Description and JPEG of the latest picture, if newer than serial `after`; waits up to
        `seconds` for one, else None."""
        with self._changed:
            self.seen = time.monotonic()
            self._changed.wait_for(lambda: self._serial > after or self._closed, seconds)
            if self._serial <= after or self._closed:
                return None
            self.seen = time.monotonic()
            frame, wish, serial, error = self._frame, self._wish, self._serial, self._error
        description: dict[str, Any] = {"serial": serial, "error": error}
        if frame is None:
            return description, b""
        try:
            picture = drawn(frame, wish)
        except (HeliographError, KeyError) as problem:  # the frame of an earlier wish
            description["error"] = error or str(problem)
            return description, b""
        description.update(
            samples=frame.samples, final=frame.is_final, revision=frame.revision,
            width=frame.width, height=frame.height, seconds=round(frame.render_seconds, 3),
            camera=wish.camera, K=frame.K.tolist(), pose=frame.camera_from_world_cv.tolist(),
        )  # fmt: skip
        return description, _jpeg(picture)

    def png(self) -> bytes:
        """PNG of the latest picture; empty when there is none."""
        with self._changed:
            frame, wish = self._frame, self._wish
        return b"" if frame is None else drawn(frame, wish).png()

    def ray(self, x: float, y: float) -> tuple[NdArray, NdArray] | None:
        """Origin and direction, world, through a point of the latest picture, [0, 1] each, of the
        free camera; None before there is a picture."""
        frame = self._frame
        if frame is None:
            return None
        at = np.array([x * frame.width - 0.5, y * frame.height - 0.5, 1.0])
        world = np.linalg.inv(frame.camera_from_world_cv)
        direction = world[:3, :3] @ (np.linalg.inv(frame.K) @ at)
        return world[:3, 3], direction / np.linalg.norm(direction)

    @property
    def camera(self) -> str:
        """The camera of the scene that is looked through, or ""."""
        return self._wish.camera

    def close(self) -> None:
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            live = self._live
        if live is not None:
            live.close()
        self._thread.join(timeout=10)


def drawn(frame: Frame, wish: Wish) -> Picture:
    """The picture of a wish."""
    style: dict[str, Any] = {"exposure": wish.exposure, "view": wish.view}
    if wish.exposure == "auto" and "beauty" not in frame:
        style["exposure"] = 0.0
    if wish.layers:
        return frame.annotated(*wish.layers, plane=wish.plane, **style)
    return frame.picture(wish.plane, **style)


def _jpeg(picture: Picture) -> bytes:
    out = io.BytesIO()
    picture.pil().convert("RGB").save(out, "JPEG", quality=92, subsampling=0)
    return out.getvalue()
