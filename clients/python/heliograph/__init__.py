"""Heliograph: a headless path-tracing render server for training data; this is its Python client.

Importing it is cheap: connect() starts the daemon first and imports the rest while it starts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._version import __version__ as __version__
from .errors import (
    Aborted,
    AlreadyExists,
    Cancelled,
    DeadlineExceeded,
    FailedPrecondition,
    FileWarning,
    HeliographError,
    Internal,
    InvalidArgument,
    NotFound,
    OutOfRange,
    PermissionDenied,
    ResourceExhausted,
    Unauthenticated,
    Unavailable,
    Unimplemented,
)

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Mapping, Sequence

    from ._wire.access import TLS
    from ._wire.device import DeviceArray
    from .client.client import Client
    from .client.edit import Edits
    from .client.scene import Scene
    from .image import tonemap
    from .image.picture import Picture, contact_sheet
    from .render.batch import Job
    from .render.frame import Frame
    from .render.progress import Progress
    from .render.worlds import WorldFrame, Worlds
    from .robots.mjcf.robot import MjcfRobot
    from .robots.robot import Robot
    from .scene import studio
    from .scene.handles import Asset, Entity, Group, Handle, Material, Mesh, Texture
    from .scene.rigs import stereo
    from .usd.asset import UsdAsset
    from .usd.robots import UsdRobot
    from .values import framing, lights, materials, shapes, sky
    from .values.components import Camera, Tex, Visibility
    from .values.curves import smooth_curves
    from .values.lights import Light, Portal
    from .values.pose import Pose, look_at, moving
    from .values.sensors import DepthSensor, RgbSensor
    from .viewer import Viewer


_LAZY = {
    "Asset": "scene.handles",
    "Camera": "values.components",
    "Change": "render.watch",
    "Client": "client.client",
    "DepthSensor": "values.sensors",
    "DeviceArray": "_wire.device",
    "Edits": "client.edit",
    "Entity": "scene.handles",
    "Frame": "render.frame",
    "Group": "scene.handles",
    "Handle": "scene.handles",
    "Job": "render.batch",
    "Light": "values.lights",
    "Portal": "values.lights",
    "Material": "scene.handles",
    "Mesh": "scene.handles",
    "MjcfRobot": "robots.mjcf.robot",
    "Picture": "image.picture",
    "Pose": "values.pose",
    "Progress": "render.progress",
    "RgbSensor": "values.sensors",
    "Robot": "robots.robot",
    "Scene": "client.scene",
    "TLS": "_wire.access",
    "Tex": "values.components",
    "Texture": "scene.handles",
    "UsdAsset": "usd.asset",
    "UsdRobot": "usd.robots",
    "Visibility": "values.components",
    "Viewer": "viewer",
    "WorldFrame": "render.worlds",
    "Worlds": "render.worlds",
    "look_at": "values.pose",
    "moving": "values.pose",
    "aio": "aio",
    "datasets": "datasets",
    "framing": "values.framing",
    "lights": "values.lights",
    "materials": "values.materials",
    "shapes": "values.shapes",
    "smooth_curves": "values.curves",
    "sky": "values.sky",
    "studio": "scene.studio",
    "tonemap": "image.tonemap",
    "contact_sheet": "image.picture",
    "stereo": "scene.rigs",
    "torch": "torch",
}

__all__ = [
    "TLS",
    "Aborted",
    "AlreadyExists",
    "Asset",
    "Camera",
    "Cancelled",
    "Change",
    "Client",
    "DeadlineExceeded",
    "DepthSensor",
    "DeviceArray",
    "Edits",
    "Entity",
    "FailedPrecondition",
    "FileWarning",
    "Frame",
    "Group",
    "Handle",
    "HeliographError",
    "Internal",
    "InvalidArgument",
    "Job",
    "Light",
    "Material",
    "Mesh",
    "MjcfRobot",
    "NotFound",
    "OutOfRange",
    "PermissionDenied",
    "Picture",
    "Portal",
    "Pose",
    "Progress",
    "ResourceExhausted",
    "RgbSensor",
    "Robot",
    "Scene",
    "Tex",
    "Texture",
    "Unauthenticated",
    "Unavailable",
    "Unimplemented",
    "UsdAsset",
    "UsdRobot",
    "Viewer",
    "Visibility",
    "WorldFrame",
    "Worlds",
    "connect",
    "contact_sheet",
    "framing",
    "lights",
    "look_at",
    "materials",
    "moving",
    "shapes",
    "sky",
    "smooth_curves",
    "stereo",
    "studio",
    "tonemap",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'heliograph' has no attribute {name!r}")
    import importlib

    home = _LAZY[name]
    module = importlib.import_module(f"{__name__}.{home}")
    is_module = home.rpartition(".")[2] == name
    found = module if is_module else getattr(module, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*globals(), *_LAZY])


def connect(
    address: str | None = None,
    *,
    token: str | os.PathLike[str] | None = None,
    tls: TLS | None = None,
    arguments: Sequence[str] = (),
    timeout: float | None = None,
    trace: Callable[[], Mapping[str, str] | None] | None = None,
) -> Client:
    """A client of a daemon.

    Without an address: a private heliographd, which ends when nothing refers to the client any
    more, and with this process; `arguments` are more of its flags, `("--threads", "4")`. Otherwise
    "unix:///path/heliograph.sock" or "host:port". `token`: who this client is, or a path to a file
    with it, which may change while the client runs. `tls`: of "host:port", see TLS. `timeout`:
    seconds that connecting may take, by default 30 for a private daemon, else 10. `trace`: called
    before each call, in its thread, for the headers of W3C Trace Context, {"traceparent": ...} and
    perhaps "tracestate", which the daemon's log and the frames' manifests then name. The daemon's
    log goes to logging.getLogger("heliograph").
    """
    if isinstance(arguments, str):
        raise InvalidArgument('arguments: a sequence, ("--threads", "4")', field="arguments")
    from ._wire.start import deadline_of, occupy_standard_streams

    is_private = address is None and tls is None
    deadline = deadline_of(timeout, default=30.0 if is_private else None)
    occupy_standard_streams()
    daemon = None
    if is_private:
        from ._wire.launch import PrivateDaemon

        daemon = PrivateDaemon(arguments)
    try:
        from ._wire.access import Access
        from .client.client import check_arguments, open_client

        check_arguments(address, tls, arguments)
        if daemon is not None and deadline is not None:
            address = daemon.address(deadline)
        assert address is not None
        return open_client(Access(address, token, tls, trace), daemon, deadline)
    except BaseException:
        if daemon is not None:
            daemon.give_up()
        raise
