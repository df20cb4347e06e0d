"""Components of entities: cameras, lights, visibility; and textures that drive parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._wire._proto import scene_pb2 as scene
from .._wire._proto import types_pb2 as types
from .._wire.arrays import NdArray, checked, from_message
from ..errors import InvalidArgument
from .checks import number_of, whole_of

if TYPE_CHECKING:
    from .ray_table import RayTable
    from .sensors import DepthSensor, RgbSensor


_PROJECTIONS = ("perspective", "orthographic", "fisheye", "equirectangular", "ray_table")
_INTRINSICS = ("fx", "fy", "cx", "cy")
_NUMBERS = (
    *_INTRINSICS,
    *("aperture", "focus_distance", "blade_rotation", "near"),
)


def _middle(width: int, height: int) -> tuple[float, float]:
    """cx and cy of the image's centre."""
    return 0.5 * width - 0.5, 0.5 * height - 0.5


def _positive(value: Any, field: str) -> float:
    number = number_of(value, field)
    if not number > 0:
        raise InvalidArgument(f"{field}: {number} is not above 0", field=field)
    return number


@dataclass(frozen=True)
class Camera:
    """A camera: OpenCV intrinsics at the calibrated size, lens, clipping. docs/cameras.md.

    width, height: pixels. fx, fy: pixels (orthographic: pixels a metre; equirectangular: pixels a
    radian). cx, cy: principal point, where integers are pixel centres. The camera looks down its -Z
    axis, +Y is up in the image.
    projection: "perspective", "orthographic", "fisheye", "equirectangular", or "ray_table", which
    has `rays` in place of fx, fy, cx and cy: from_rays() makes it.
    distortion: OpenCV's coefficients: k1 k2 p1 p2 [k3 [k4 k5 k6]] of a perspective camera, k1 k2 k3
    k4 of a fisheye.
    aperture: diameter of a thin lens, metres; 0: a pinhole. focus_distance: metres along the
    optical axis. blades: corners of the aperture, 0 for a round one; blade_rotation: radians, of a
    corner from +X towards +Y. Planes of fold `centre` have no blur.
    near, far: where rays start and end, metres along the optical axis (fisheye, equirectangular:
    along the ray).
    shutter: (open, close) seconds relative to the frame's time, within [-1000, 1000]; both 0: no
    motion blur. rolling: seconds from the first row's opening to the last one's. docs/motion.md.
    rgb_sensor, depth_sensor: hg.RgbSensor and hg.DepthSensor, for the planes sensor_rgb,
    sensor_mosaic and sensor_depth.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    projection: str = "perspective"
    distortion: Any = ()
    aperture: float = 0.0
    focus_distance: float = 0.0
    blades: int = 0
    blade_rotation: float = 0.0
    near: float = 0.0
    far: float = math.inf
    shutter: tuple[float, float] = (0.0, 0.0)
    rolling: float = 0.0
    rgb_sensor: RgbSensor | None = None
    depth_sensor: DepthSensor | None = None
    rays: RayTable | None = None

    @classmethod
    def from_intrinsics(cls, K: Any, width: int, height: int, **fields: Any) -> Camera:
        """From a (3, 3) matrix of OpenCV; K read back equals K. fields: any others of a Camera."""
        k = checked(K, "K", "f8", (3, 3))
        if k[0, 1] or k[1, 0] or (k[2] != (0, 0, 1)).any():
            raise InvalidArgument(
                "K: needs [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; skew is not modelled", field="K"
            )
        fx, fy, cx, cy = (float(x) for x in (k[0, 0], k[1, 1], k[0, 2], k[1, 2]))
        return cls(width, height, fx, fy, cx, cy, **fields)

    @classmethod
    def from_fov(
        cls,
        fov: float,
        width: int,
        height: int,
        *,
        axis: str = "x",
        degrees: bool = False,
        **fields: Any,
    ) -> Camera:
        """From the full angle of view along the image's width (`axis="x"`) or height ("y");
        radians unless `degrees`. fields: any others of a Camera."""
        angle = math.radians(fov) if degrees else float(fov)
        if not 0 < angle < math.pi:
            raise InvalidArgument(
                f"fov: {fov} is not between 0 and 180 degrees; radians unless degrees=True",
                field="fov",
            )
        if axis not in ("x", "y"):
            raise InvalidArgument(f'axis: "x" or "y", not {axis!r}', field="axis")
        focal = 0.5 * (width if axis == "x" else height) / math.tan(0.5 * angle)
        return cls(width, height, focal, focal, *_middle(width, height), **fields)

    @classmethod
    def from_focal_length(
        cls,
        focal_length: float,
        width: int,
        height: int,
        *,
        sensor_width: float = 36.0,
        f_number: float | None = None,
        **fields: Any,
    ) -> Camera:
        """From a lens as photographers name it: focal length and the sensor's width, both in
        millimetres (50 on 36). f_number: makes it a thin lens of aperture focal_length / f_number
        and needs focus_distance=, metres. fields: any others of a Camera."""
        focal = _positive(focal_length, "focal_length")
        pixels = focal / _positive(sensor_width, "sensor_width") * width
        if f_number is not None:
            fields["aperture"] = 1e-3 * focal / _positive(f_number, "f_number")
        return cls(width, height, pixels, pixels, *_middle(width, height), **fields)

    @classmethod
    def orthographic(
        cls, pixels_per_metre: float, width: int, height: int, **fields: Any
    ) -> Camera:
        """Parallel rays; one metre is `pixels_per_metre` pixels at any distance."""
        scale = (pixels_per_metre, pixels_per_metre)
        return cls(width, height, *scale, *_middle(width, height), "orthographic", **fields)

    @classmethod
    def fisheye(
        cls, fov: float, width: int, height: int, *, degrees: bool = False, **fields: Any
    ) -> Camera:
        """An equidistant lens, `distortion` aside: the full angle of view along the image's width,
        up to 360 degrees; radians unless `degrees`."""
        angle = _positive(math.radians(fov) if degrees else fov, "fov")
        scale = (width / angle, width / angle)
        return cls(width, height, *scale, *_middle(width, height), "fisheye", **fields)

    @classmethod
    def equirectangular(
        cls,
        width: int,
        height: int,
        *,
        fov: tuple[float, float] = (2 * math.pi, math.pi),
        **fields: Any,
    ) -> Camera:
        """Longitude along x, latitude along y; what lies ahead is in the middle. fov: radians seen
        along the width and the height."""
        wide, high = (_positive(angle, "fov") for angle in fov)
        scale = (width / wide, height / high)
        return cls(width, height, *scale, *_middle(width, height), "equirectangular", **fields)

    @classmethod
    def from_rays(
        cls, rays: Any, *, times: Any = None, interpolated: bool = False, **fields: Any
    ) -> Camera:
        """A ray for each pixel: a scanner, or a lens that no model describes.

        rays: (H, W, 6) float32, origin in metres and direction, zeros where a pixel sees nothing,
        in the OpenCV camera frame (x right, y down, z forward). times: (H, W) float32 seconds in
        [0, 1000], how much later than the shutter's opening a pixel opens, and than the frame its
        labels are. interpolated: samples spread over a pixel by the filter, along rays between
        those of its neighbours, as a lens bends them; otherwise all go along the pixel's ray, as a
        scanner's beams. fields: any others of a Camera but fx, fy, cx, cy, aperture and rolling.

        Such a camera is rendered at its own size. It cannot map a point to its image: flow in
        pixels, disparity, tracks, and keypoints where a mesh has some, are refused, and
        corners_image is nan."""
        from .ray_table import RayTable

        table = RayTable.of(rays, times, interpolated)
        height, width = table.rays.shape[:2]
        return cls(width, height, 0, 0, *_middle(width, height), "ray_table", rays=table, **fields)

    @property
    def K(self) -> NdArray:
        """(3, 3) float64; of a ray table without focal lengths."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    def to_message(self) -> scene.Camera:
        """Without the arrays of `rays`."""
        if self.projection not in _PROJECTIONS:
            raise InvalidArgument(
                f"projection: one of {', '.join(_PROJECTIONS)}", field="projection"
            )
        projection: Any = scene.Camera.Projection.Value(f"PROJECTION_{self.projection.upper()}")
        message = scene.Camera(
            width=whole_of(self.width, "camera.width", 1),
            height=whole_of(self.height, "camera.height", 1),
            projection=projection,
            blades=whole_of(self.blades, "camera.blades"),
            distortion=checked(self.distortion, "camera.distortion", "f8", (None,)),
        )
        for name in _NUMBERS:
            if self.rays is None or name not in _INTRINSICS:
                setattr(message, name, number_of(getattr(self, name), f"camera.{name}"))
        if self.far != math.inf:
            message.far = number_of(self.far, "camera.far")
        if self.rgb_sensor is not None:
            message.rgb_sensor.CopyFrom(self.rgb_sensor.to_message())
        if self.depth_sensor is not None:
            message.depth_sensor.CopyFrom(self.depth_sensor.to_message())
        opens, closes = checked(self.shutter, "camera.shutter", "f8", (2,))
        rolling = number_of(self.rolling, "camera.rolling")
        if opens or closes or rolling:
            message.shutter.CopyFrom(scene.Shutter(open=opens, close=closes, rolling=rolling))
        return message

    @classmethod
    def from_message(cls, message: scene.Camera, read: Callable[..., Any] | None = None) -> Camera:
        """read: answers the fields of its entity; without it a ray table is left out."""
        from .ray_table import RayTable
        from .sensors import DepthSensor, RgbSensor

        name = scene.Camera.Projection.Name(message.projection or 1)
        fields: dict[str, Any] = {name: getattr(message, name) for name in _NUMBERS}
        if message.HasField("rays"):
            fields["cx"], fields["cy"] = _middle(message.width, message.height)
            if read:
                rays, times = read("camera.rays", "camera.times")
                fields["rays"] = RayTable(rays, times, message.rays.interpolated)
        if message.HasField("rgb_sensor"):
            fields["rgb_sensor"] = RgbSensor.from_message(message.rgb_sensor)
        if message.HasField("depth_sensor"):
            fields["depth_sensor"] = DepthSensor.from_message(message.depth_sensor)
        return cls(
            width=message.width,
            height=message.height,
            projection=name[len("PROJECTION_") :].lower(),
            blades=message.blades,
            distortion=tuple(message.distortion),
            far=message.far or math.inf,
            shutter=(message.shutter.open, message.shutter.close),
            rolling=message.shutter.rolling,
            **fields,
        )


@dataclass(frozen=True)
class Visibility:
    """Which rays meet an entity's surface."""

    camera: bool = True
    diffuse: bool = True
    glossy: bool = True
    transmission: bool = True
    shadow: bool = True
    volume: bool = True

    def to_message(self) -> scene.Visibility:
        return scene.Visibility(
            camera=self.camera,
            diffuse=self.diffuse,
            glossy=self.glossy,
            transmission=self.transmission,
            shadow=self.shadow,
            volume=self.volume,
        )


@dataclass(frozen=True)
class Tex:
    """A texture that drives a parameter: (texel[channel] * scale + offset) * factor.

    texture: a handle or a name. factor: the constant it multiplies, number or (3,).
    channel: 0..3, for scalar parameters. uv: (2, 3), applied to (u, v, 1). uv_set: 0 or 1.
    """

    texture: Any
    factor: Any = 1.0
    channel: int = 0
    scale: float = 1.0
    offset: float = 0.0
    uv: Any = None
    uv_set: int = 0

    @classmethod
    def from_message(
        cls, message: scene.TextureUse, handle: Callable[[types.Ref], Any]
    ) -> Tex | None:
        """As the daemon has it, uv in tuples; None without a texture."""
        texture = handle(message.texture)
        if texture is None:
            return None
        uv = tuple(tuple(row) for row in from_message(message.uv_transform).tolist())
        return cls(
            texture,
            channel=message.channel,
            scale=message.scale,
            offset=message.offset,
            uv=None if uv == ((1, 0, 0), (0, 1, 0)) else uv,
            uv_set=message.uv_set,
        )
