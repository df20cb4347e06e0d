"""Frame: the planes and labels of one camera at one time; and its common base with frames of many
worlds. Made by Scene.render."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire._proto import render_pb2 as pb
from .._wire.arrays import Columns, NdArray, bytes_of, from_message
from .._wire.device import DeviceArray
from ..errors import FailedPrecondition, InvalidArgument
from ..image import tonemap
from ..image.picture import Picture, contact_sheet
from ..values.checks import color_of

if TYPE_CHECKING:
    from typing_extensions import Self

_CV_TO_GL = np.diag([1.0, -1.0, -1.0, 1.0])


class Rendered:
    """Planes and labels of one job: a Frame, or a WorldFrame."""

    def __init__(self, header: pb.FrameHeader, arrays: Sequence[NdArray | DeviceArray]) -> None:
        self._header = header
        self._planes: dict[str, NdArray | DeviceArray] = {}
        self.units: dict[str, str] = {}
        for info, array in zip(header.planes, arrays):
            name = f"{info.name}:{info.argument}" if info.argument else info.name
            if info.plane == pb.PLANE_BEAUTY_GROUP:
                name = f"beauty:{info.argument}"
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
            self._planes[name] = array
            self.units[name] = info.unit
        self.index = int(header.frame)  # over the request's cameras
        self.scene = int(header.scene)
        self.revision = int(header.revision)
        self.width, self.height = int(header.width), int(header.height)
        self.time = float(header.time)
        self.label_time = float(header.label_time)
        self.seed, self.samples = int(header.seed), int(header.samples)
        self.noise = float(header.noise)
        self.is_final = bool(header.final)
        self.backend, self.cpu_features = str(header.backend), str(header.cpu_features)
        self.manifest = str(header.manifest)
        self.warnings = list(header.warnings)
        self.render_seconds, self.rays = float(header.render_seconds), int(header.rays)
        self.categories = {int(c.id): str(c.name) for c in header.categories}

    def __getitem__(self, plane: str) -> NdArray:
        found = self._find(plane)
        if isinstance(found, DeviceArray):
            raise FailedPrecondition(
                f"{plane}: lies in the GPU's memory; frame.torch({plane!r}) is a tensor there, "
                f"frame.on_device({plane!r}) an array for other libraries, frame.cpu() a frame "
                "on the host"
            )
        return found

    def on_device(self, plane: str) -> DeviceArray:
        """A plane of a frame with device="cuda", for any library that takes arrays on a GPU."""
        found = self._find(plane)
        if isinstance(found, DeviceArray):
            return found
        raise FailedPrecondition(f"{plane}: lies on the host; render with device='cuda'")

    def torch(self, plane: str) -> Any:
        """A plane as a torch.Tensor, without a copy: with device="cuda" on the GPU, else on the
        CPU.

        The plane stays as it is while the tensor lives, its views included. It is for reading:
        clone() it before an operation in place, as the memory of a frame on the host may be such
        that a write ends the process.
        """
        import warnings

        import torch

        found = self._find(plane)
        if isinstance(found, DeviceArray):
            return found.torch()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*not writable.*")
            return torch.from_numpy(found)

    def cpu(self) -> Self:
        """Copies a frame on the GPU to the host; returns a frame on the host itself."""
        if all(isinstance(array, np.ndarray) for array in self._planes.values()):
            return self
        arrays = [a.numpy() if isinstance(a, DeviceArray) else a for a in self._planes.values()]
        return type(self)(self._header, arrays)

    def _find(self, plane: str) -> NdArray | DeviceArray:
        found = self._planes.get(plane)
        if found is None:  # "disparity" without its camera, where there is one only
            near = [name for name in self._planes if name.partition(":")[0] == plane]
            if len(near) != 1 or plane == "beauty":
                raise KeyError(
                    f"no plane {plane!r}; this frame has {', '.join(self._planes) or 'none'}: ask "
                    "for it with planes=[...]"
                )
            found = self._planes[near[0]]
        return found

    def __contains__(self, plane: object) -> bool:
        return plane in self._planes

    def __iter__(self) -> Iterator[str]:
        return iter(self._planes)

    @cached_property
    def sha256(self) -> bytes:
        """(32 bytes) of its pixels and labels: of the planes in order, then of each label column's
        name, data and strings. Recordings have it."""
        digest = hashlib.sha256()
        for plane in self._planes:
            digest.update(bytes_of(self[plane]))
        for column in self._header.labels:
            digest.update(column.name.encode())
            digest.update(column.data)
            for text in column.strings:
                digest.update(text.encode())
        return digest.digest()

    @property
    def planes(self) -> list[str]:
        """The names of its planes."""
        return list(self._planes)

    @cached_property
    def K(self) -> NdArray:
        return from_message(self._header.k)

    @cached_property
    def camera_from_world_cv(self) -> NdArray:
        return from_message(self._header.camera_from_world_cv)

    @property
    def camera_from_world_gl(self) -> NdArray:
        return _CV_TO_GL @ self.camera_from_world_cv

    @cached_property
    def labels(self) -> Columns:
        """Columns over the instances, ordered by label; docs/python.md lists them."""
        remedy = "; ask for more with labels=True or labels={'amodal_masks': True}"
        return Columns.of(self._header.labels, remedy)

    def __reduce__(self) -> Any:
        host = self.cpu()
        arrays = [np.asarray(host[name]) for name in host]
        return _unpickled, (type(self), self._header.SerializeToString(), arrays)


class Frame(Rendered):
    """Planes and labels of one camera at one revision and one time, from one job.

    frame["depth"]: (H, W) or (H, W, C), read-only, valid as long as anybody refers to it;
    frame.torch("depth"): the same as a tensor. A frame with device="cuda" has its planes in the
    GPU's memory: use torch() and on_device() there; cpu() copies it.
    K: (3, 3) float64 at the rendered size. camera_from_world_cv: (4, 4), OpenCV camera (x right,
    y down, z forward); camera_from_world_gl: OpenGL camera (y up, looks down -z).
    time, label_time: seconds; shutter: (open, close) relative to time. With a rolling shutter row y
    is seen rolling * y / (H - 1) later; poses are those at the middle of the rows (see row_times).
    """

    def __init__(self, header: pb.FrameHeader, arrays: Sequence[NdArray | DeviceArray]) -> None:
        super().__init__(header, arrays)
        self.camera = str(header.camera)
        self.shutter = (float(header.shutter.open), float(header.shutter.close))
        self.rolling = float(header.shutter.rolling)

    @property
    def row_times(self) -> NdArray:
        """(H,) seconds: time of each row. The frame's poses are those at their mean."""
        steps = np.arange(self.height) / max(1, self.height - 1)
        return np.asarray(self.label_time + self.rolling * steps)

    @property
    def instances(self) -> dict[int, str]:
        """Label to name. Needs labels."""
        labels = self.labels
        return {int(k): str(v) for k, v in zip(labels["label"], labels["name"])}

    def amodal_mask(self, label: int) -> NdArray:
        """(H, W) bool: the whole silhouette of an instance, also where it is hidden.

        Needs labels={"amodal_masks": True}.
        """
        packed = self.labels["amodal_masks"]
        row = np.flatnonzero(self.labels["label"] == label)
        if row.size != 1:
            raise KeyError(f"no instance has label {label}")
        bits = np.unpackbits(packed[row[0]])
        return bits[: self.width * self.height].reshape(self.height, self.width).astype(bool)

    # ------------------------------------------------------------ pictures

    def image(self, *, exposure: float | str = 0.0, view: str = "standard") -> Picture:
        """(H, W, 3) uint8 sRGB of the beauty. exposure: stops, or "auto". view: "standard",
        "filmic" or "agx"."""
        beauty = self["beauty"]
        rgb = beauty[..., :3]
        return Picture.of(tonemap.to_srgb8(rgb, self.stops(exposure), view))

    def relight(self, factors: Mapping[str, Any]) -> NdArray:
        """Beauty (H, W, 4) float32 with the light groups scaled by `factors`.

        factors: {group: number or (3,)}, >= 0; groups that are not named stay as they are. Needs
        the planes "beauty" and "beauty:GROUP" of each. Light is linear, so this is the picture of
        the same paths with lights of those strengths, within rounding of the beauty. A new render
        chooses its lights by the new strengths: it agrees in the mean, not in the noise.
        """
        out = self["beauty"].astype(np.float64)
        for group, factor in factors.items():
            color = color_of(factor, f"factors[{group!r}]")
            scale = np.array([color.x, color.y, color.z])
            if scale.min() < 0:
                raise InvalidArgument(f"factors[{group!r}]: {factor!r} is below 0", field="factors")
            out[..., :3] += (scale - 1) * self[f"beauty:{group}"]
        out[..., :3] = out[..., :3].clip(0)
        return out.astype(np.float32)

    def stops(self, exposure: float | str) -> float:
        """Stops of an exposure: a number, or "auto" for stops that suit the beauty."""
        if exposure == "auto":
            beauty = self["beauty"]
            weight = beauty[..., 3]
            if "depth" in self:
                hit = np.isfinite(self["depth"])
                weight = hit if hit.any() else weight
            return tonemap.auto_exposure(beauty[..., :3], weight)
        if isinstance(exposure, str):
            raise InvalidArgument('exposure: stops, or "auto"', field="exposure")
        return float(exposure)

    def picture(
        self, plane: str = "", *, exposure: float | str = 0.0, view: str = "standard"
    ) -> Picture:
        """(H, W) or (H, W, 3) uint8 to look at: any plane, with ids in colours, near bright.

        plane: default the beauty, or the first one of a frame without it. Radiance is exposed and
        viewed as the beauty; directions map [-1, 1] to [0, 255]; flow is coloured as Baker et al.
        2011 do, full colour where it is longest.
        """
        plane = plane or ("beauty" if "beauty" in self else next(iter(self), "beauty"))
        return Picture.of(self._pixels_of(plane, exposure, view))

    def _pixels_of(self, plane: str, exposure: float | str, view: str) -> NdArray:
        data = self[plane]
        if data.dtype == np.uint32:
            return tonemap.colors_of_ids(data)
        if data.dtype == np.uint8:
            return data * np.uint8(255)
        unit = self.units.get(plane, "")
        if unit.startswith("W "):
            stops = self.stops(exposure) if "beauty" in self or exposure != "auto" else 0.0
            return tonemap.to_srgb8(data[..., :3], stops, view)
        if plane == "sensor_depth":  # shown as infinitely far where nothing was measured
            data = np.where(data > 0, data, np.inf)
        if data.ndim == 2:
            if unit in ("m", "px", "rays") or plane == "variance":
                return tonemap.grey_of(data)
            return np.asarray((np.clip(np.nan_to_num(data), 0, 1) * 255 + 0.5).astype(np.uint8))
        if plane in ("flow_forward", "flow_backward"):
            return tonemap.colors_of_flow(data)
        return _picture_of_vectors(plane, np.nan_to_num(data), unit)

    def show(self, *planes: str, exposure: float | str = "auto", view: str = "standard") -> None:
        """Shows planes, by default the beauty: in a notebook, else in a window.

        Several are shown beside each other. FailedPrecondition on a machine without a screen.
        """
        wanted = planes or ("",)
        shown = {name: self.picture(name, exposure=exposure, view=view) for name in wanted}
        first = next(iter(shown.values()))
        (first if len(shown) == 1 else contact_sheet(shown)).show()

    def annotated(
        self,
        *layers: str,
        plane: str = "",
        only: Any = None,
        skeleton: Sequence[tuple[Any, Any]] = (),
        scale: int = 1,
        exposure: float | str = 0.0,
        view: str = "standard",
    ) -> Picture:
        """Picture (H, W, 3) uint8 of a plane, default the beauty, with its labels drawn on it.

        layers: default boxes and names. Visible pixels: "masks", "outlines", "boxes"; whole
        silhouettes: "amodal", "amodal_boxes"; in 3D: "cuboids", "axes"; "keypoints", with lines
        between the pairs of names or numbers in `skeleton`; motion as arrows, "flow", or the key of
        its colours, "wheel"; text: "names", "categories". InvalidArgument names the planes and
        labels that a layer needs. only: labels, names or categories to draw, default all. scale:
        factor by which the picture is enlarged, so that names fit on small ones.
        """
        from ..image import annotate

        base = self.picture(plane, exposure=exposure, view=view)
        options = {"only": only, "skeleton": skeleton, "scale": scale}
        return annotate.annotated(self, layers or annotate.DEFAULT_LAYERS, base, options)

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        exposure: float | str = 0.0,
        view: str = "standard",
    ) -> list[Path]:
        """Writes by the name's ending; the files written.

        .exr: all planes as they are, one part each, with units, manifest and camera in the header.
        .png, .jpg: pictures; "out.png" is the beauty, "out.depth.png" and so on the other planes.
        .npz: all planes, labels and camera as they are. .json: the manifest.
        """
        target = Path(path)
        kind = target.suffix.lower()
        if kind == ".exr":
            from ..image import exr

            exr.write(target, self)
            return [target]
        if kind in (".png", ".jpg", ".jpeg"):
            return self._save_pictures(target, exposure, view)
        if kind == ".npz":
            arrays: Any = {name: self[name] for name in self}
            arrays |= {f"labels.{name}": np.asarray(self.labels[name]) for name in self.labels}
            arrays |= {f"camera.{name}": np.asarray(value) for name, value in self.shot.items()}
            np.savez_compressed(target, **arrays)
            return [target]
        if kind == ".json":
            target.write_text(json.dumps(json.loads(self.manifest), indent=1))
            return [target]
        raise InvalidArgument(
            f"path: {target.name!r} ends in none of .exr .png .jpg .npz .json", field="path"
        )

    @property
    def shot(self) -> dict[str, Any]:
        """Name, size, time, K and pose of its camera, as JSON has them."""
        return {
            "name": self.camera,
            "width": self.width,
            "height": self.height,
            "time": self.time,
            "rolling": self.rolling,
            "K": self.K.tolist(),
            "camera_from_world_cv": self.camera_from_world_cv.tolist(),
        }

    def _save_pictures(self, target: Path, exposure: float | str, view: str) -> list[Path]:
        written = []
        for plane in self._planes:
            path = target
            if plane != "beauty":
                path = target.with_suffix(f".{plane.replace(':', '_')}{target.suffix}")
            self.picture(plane, exposure=exposure, view=view).save(path)
            written.append(path)
        return written

    def _repr_html_(self) -> str:
        from ..image import notebook

        return notebook.html_of_frame(self)

    def __repr__(self) -> str:
        planes = ", ".join(self._planes)
        return (
            f"<Frame {self.width}x{self.height} of {self.camera!r}, {self.samples} spp: {planes}>"
        )


def _unpickled(kind: type[Rendered], header: bytes, arrays: list[NdArray]) -> Rendered:
    return kind(pb.FrameHeader.FromString(header), arrays)


def _picture_of_vectors(plane: str, data: NdArray, unit: str) -> NdArray:
    """uint8 RGB of a (H, W, 2..4) plane that is not radiance."""
    if data.shape[2] == 2:
        data = np.concatenate([data, np.zeros_like(data[..., :1])], axis=2)
    data = data[..., :3]
    if "normal" in plane or plane == "tangent":
        hit = np.any(data != 0, axis=2, keepdims=True)
        return np.asarray(np.where(hit, data * 127.5 + 128, 0).clip(0, 255).astype(np.uint8))
    if unit == "1":
        if plane in ("base_color", "sensor_rgb"):
            return tonemap.to_srgb8(data, 0.0, "standard")
        return np.asarray((np.clip(data, 0, 1) * 255 + 0.5).astype(np.uint8))
    reach = float(np.abs(data).max()) or 1.0
    return np.asarray((data / reach * 127.5 + 128).clip(0, 255).astype(np.uint8))
