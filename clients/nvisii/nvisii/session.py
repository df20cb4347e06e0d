"""initialize() to deinitialize(): the daemon, the camera, callbacks; and functions of a window."""

from __future__ import annotations

import atexit
import inspect
import os
import warnings
from collections.abc import Callable
from typing import Any

import heliograph as hg

from . import daemon
from .cameras import camera
from .checks import as_runtime_error, whole
from .component import Component, check
from .entities import entity
from .glm.vectors import ivec2, vec2, vec3
from .lights import light
from .materials import material
from .meshes import mesh
from .mirror import Mirror
from .settings import current as settings
from .textures import texture
from .transforms import transform
from .volumes import volume

__all__ = [
    "are_updates_enabled",
    "clear_all",
    "deinitialize",
    "disable_updates",
    "enable_updates",
    "get_cursor_pos",
    "get_scene_aabb_center",
    "get_scene_max_aabb_corner",
    "get_scene_min_aabb_corner",
    "get_window_size",
    "initialize",
    "initialize_headless",
    "initialize_interactive",
    "is_button_held",
    "is_button_pressed",
    "register_callback",
    "register_pre_render_callback",
    "resize_window",
    "set_camera_entity",
    "set_cursor_mode",
    "should_window_close",
    "update_scene_aabb",
]

KINDS: tuple[type[Component], ...] = (
    *(entity, transform, material, texture, mesh, camera, light, volume),
)


class _Session:
    """Between initialize() and deinitialize()."""

    def __init__(self, client: hg.Client) -> None:
        self.client = client
        self.mirror = Mirror(client.create_scene())


_session: _Session | None = None
_camera: entity | None = None
_callback: Callable[[], Any] | None = None
_updates = True
_window = (1280, 720)


def initialize(
    headless: bool = False,
    window_on_top: bool = False,
    lazy_updates: bool = False,
    verbose: bool = False,
    max_entities: int = 10000,
    max_cameras: int = 10,
    max_transforms: int = 10000,
    max_meshes: int = 10000,
    max_materials: int = 10000,
    max_lights: int = 100,
    max_textures: int = 1000,
    max_volumes: int = 1000,
    address: str | None = None,
) -> None:
    """Connects to a daemon: that of `address`, else of $HELIOGRAPH_ADDRESS, else a private one.

    It is always headless, and nothing is limited: the other arguments are accepted.
    """
    global _session
    if _session is not None:
        raise RuntimeError("nvisii is already initialized; call nvisii.deinitialize() before")
    with as_runtime_error():
        found = address or os.environ.get("HELIOGRAPH_ADDRESS") or None
        _session = _Session(daemon.open_client(found))
    settings.dome_changed = True  # the new scene has none yet


def _old_name(name: str, headless: bool, *left_out: str) -> Callable[..., None]:
    """initialize() by an older name, without some of its arguments."""
    signature = inspect.signature(initialize)
    taken = [p for p in signature.parameters.values() if p.name not in left_out]
    signature = signature.replace(parameters=taken)

    def old(*args: Any, **named: Any) -> None:
        given = signature.bind(*args, **named).arguments
        text = f"nvisii.{name} is deprecated: use nvisii.initialize"
        warnings.warn(text, DeprecationWarning, 2)
        initialize(headless=headless, **given)

    old.__name__ = old.__qualname__ = name
    old.__doc__ = f"The old name of initialize(headless={headless})."
    vars(old)["__signature__"] = signature
    return old


_NEW = ("headless", "lazy_updates", "address")  # arguments that the old names lack
initialize_interactive = _old_name("initialize_interactive", False, *_NEW)
initialize_headless = _old_name("initialize_headless", True, *_NEW, "window_on_top")


def deinitialize() -> None:
    """Removes everything and leaves the daemon; without initialize() it does nothing more."""
    global _session
    clear_all()
    register_callback(None)
    _session = None
    daemon.close_client()


atexit.register(deinitialize)


def session() -> _Session:
    """Session that render() uses. RuntimeError before initialize()."""
    if _session is None:
        raise RuntimeError(daemon.NOT_INITIALIZED)
    return _session


def clear_all() -> None:
    """Removes all components, and the camera entity. The dome, clamps, depths, intervals and the
    denoiser stay as they are."""
    set_camera_entity(None)
    for kind in KINDS:
        kind.clear_all()


# ---------------------------------------------------------------- the camera and callbacks


def set_camera_entity(camera_entity: entity | None) -> None:
    """Sets the entity whose camera sees. Later changes of it count."""
    global _camera
    check("camera_entity", entity, camera_entity)
    _camera = camera_entity


def camera_entity() -> entity | None:
    return _camera if _camera is not None and _camera._alive else None


def register_callback(callback: Callable[[], Any] | None) -> None:
    """A function without arguments that is called before each picture, by the thread that asks for
    it; None: none."""
    global _callback
    if callback is not None and not callable(callback):
        raise RuntimeError(f"callback: {callback!r} is no function")
    _callback = callback


def register_pre_render_callback(callback: Callable[[], Any] | None) -> None:
    """The old name of register_callback."""
    register_callback(callback)


def call_back() -> None:
    """Calls the registered callback, before a picture."""
    if _callback is not None:
        _callback()


# ---------------------------------------------------------------- what a window would be


def enable_updates() -> None:
    """Pictures always show what is there; it is remembered."""
    global _updates
    _updates = True


def disable_updates() -> None:
    """Pictures always show what is there; it is remembered."""
    global _updates
    _updates = False


def are_updates_enabled() -> bool:
    return _updates


def resize_window(width: int, height: int) -> None:
    """Kept for get_window_size()."""
    global _window
    _window = (whole("width", width), whole("height", height))


def get_window_size() -> Any:
    """ivec2."""
    return ivec2(*_window)


def is_button_pressed(button: str) -> bool:
    """False: there is no window."""
    return False


def is_button_held(button: str) -> bool:
    """False: there is no window."""
    return False


def get_cursor_pos() -> Any:
    """vec2(0, 0): there is no window."""
    return vec2(0, 0)


def set_cursor_mode(mode: str) -> None:
    """ "NORMAL", "HIDDEN" or "DISABLED"; there is no cursor."""
    if mode not in ("NORMAL", "HIDDEN", "DISABLED"):
        raise RuntimeError(f'mode: "NORMAL", "HIDDEN" or "DISABLED", not {mode!r}')


def should_window_close() -> bool:
    """True: there is no window, so that loops about it end."""
    return True


# ---------------------------------------------------------------- where everything is


def get_scene_min_aabb_corner() -> Any:
    """Lower corner of the box about all shown entities, in the world."""
    return _scene_box()[0]


def get_scene_max_aabb_corner() -> Any:
    return _scene_box()[1]


def get_scene_aabb_center() -> Any:
    low, high = _scene_box()
    return (low + high) * 0.5


def update_scene_aabb(entity: entity) -> None:
    """The scene's box is always that of its entities."""


def _scene_box() -> tuple[Any, Any]:
    shown = [e._aabb() for e in entity.get_renderable_entities() if e._mesh or e._volume]
    if not shown:
        return vec3(0, 0, 0), vec3(0, 0, 0)
    low = [min(float(box[0][k]) for box in shown) for k in range(3)]
    return vec3(*low), vec3(*(max(float(box[1][k]) for box in shown) for k in range(3)))
