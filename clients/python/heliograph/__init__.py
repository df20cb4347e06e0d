"""Heliograph: a headless path-tracing render server for training data; this is its Python client.

Importing it is cheap: connect() starts the daemon first and imports the rest while it starts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .errors import (
    Aborted,
    AlreadyExists,
    Cancelled,
    DeadlineExceeded,
    FailedPrecondition,
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
    from collections.abc import Sequence

    from . import materials, shapes
    from ._batch import Job
    from ._progress import Progress
    from .access import TLS
    from .client import Client
    from .components import Camera, Tex, Visibility
    from .edit import Edits
    from .frame import Frame
    from .handles import Asset, Entity, Group, Handle, Material, Mesh, Texture
    from .lights import Light, Portal
    from .picture import Picture, contact_sheet
    from .pose import Pose, look_at, moving
    from .rigs import stereo
    from .robots import Robot
    from .scene import Scene
    from .sensors import DepthSensor, RgbSensor
    from .viewer import Viewer
    from .worlds import WorldFrame, Worlds

__version__ = "0.1.0"

_LAZY = {
    "Asset": "handles",
    "Camera": "components",
    "Change": "_watch",
    "Client": "client",
    "DepthSensor": "sensors",
    "Edits": "edit",
    "Entity": "handles",
    "Frame": "frame",
    "Group": "handles",
    "Handle": "handles",
    "Job": "_batch",
    "Light": "lights",
    "Portal": "lights",
    "Material": "handles",
    "Mesh": "handles",
    "Picture": "picture",
    "Pose": "pose",
    "Progress": "_progress",
    "RgbSensor": "sensors",
    "Robot": "robots",
    "Scene": "scene",
    "TLS": "access",
    "Tex": "components",
    "Texture": "handles",
    "Visibility": "components",
    "Viewer": "viewer",
    "WorldFrame": "worlds",
    "Worlds": "worlds",
    "look_at": "pose",
    "moving": "pose",
    "aio": "",
    "datasets": "",
    "materials": "",
    "shapes": "",
    "contact_sheet": "picture",
    "stereo": "rigs",
    "torch": "",
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
    "Edits",
    "Entity",
    "FailedPrecondition",
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
    "Viewer",
    "Visibility",
    "WorldFrame",
    "Worlds",
    "connect",
    "contact_sheet",
    "look_at",
    "materials",
    "moving",
    "shapes",
    "stereo",
]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module 'heliograph' has no attribute {name!r}")
    import importlib

    home = _LAZY[name]
    module = importlib.import_module(f"{__name__}.{home or name}")
    found = getattr(module, name) if home else module
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
) -> Client:
    """A client of a daemon.

    Without an address: a private heliographd, which ends when nothing refers to the client any
    more, and with this process; `arguments` are more of its flags, `("--threads", "4")`. Otherwise
    "unix:///path/heliograph.sock" or "host:port". `token`: who this client is, or a path to a file
    with it, which may change while the client runs. `tls`: of "host:port", see TLS. `timeout`:
    seconds that connecting may take, by default 30 for a private daemon, else 10. The daemon's
    log goes to logging.getLogger("heliograph").
    """
    if isinstance(arguments, str):
        raise InvalidArgument('arguments: a sequence, ("--threads", "4")', field="arguments")
    from ._start import deadline_of, occupy_standard_streams

    is_private = address is None and tls is None
    deadline = deadline_of(timeout, default=30.0 if is_private else None)
    occupy_standard_streams()
    daemon = None
    if is_private:
        from ._launch import PrivateDaemon

        daemon = PrivateDaemon(arguments)
    try:
        from .access import Access
        from .client import check_arguments, open_client

        check_arguments(address, tls, arguments)
        if daemon is not None and deadline is not None:
            address = daemon.address(deadline)
        assert address is not None
        return open_client(Access(address, token, tls), daemon, deadline)
    except BaseException:
        if daemon is not None:
            daemon.give_up()
        raise
