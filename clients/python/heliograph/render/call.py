"""The Render call: options to a request, parts to frames. Called by Scene.render."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypedDict, TypeVar

import numpy as np

from .._wire import cuda
from .._wire._proto import render_pb2 as render_pb
from .._wire._proto import service_pb2 as service
from .._wire._proto import types_pb2 as types
from .._wire.quick import QUICK_BYTES
from .._wire.uploads import Sources, repeated
from ..errors import InvalidArgument, NotFound
from ..scene.handles import Handle, Named
from ..values.checks import number_of, refuse_unknown, whole_of
from ._assembly import Assembly, frames_of
from .frame import Frame
from .progress import Meter, Progress
from .worlds import WorldFrame, Worlds

if TYPE_CHECKING:
    from ..client.edit import Edits
    from ..client.scene import Scene

_Answer = TypeVar("_Answer")
_DEFAULT_SPP = 64
_LABELS = ("boxes", "amodal", "amodal_masks", "keypoints")
_PLANES: dict[str, Any] = dict(render_pb.Plane.items())


class Options(TypedDict, total=False):
    """Keyword arguments of Scene.render."""

    planes: Sequence[str | tuple[str, Named]]  #: names, default ["beauty"]: docs/planes.md
    half: Sequence[str | tuple[str, Named]]  #: names among `planes` to send as float16
    spp: int  #: samples per pixel, at most
    seconds: float  #: stops after so long
    noise: float  #: stops below this mean relative standard error
    size: tuple[int, int]  #: (width, height) pixels; default the camera's
    time: float  #: seconds, default the scene's
    label_time: float  #: seconds, of the labels; default time
    frame_interval: float  #: seconds to the other end of flow; default the last advance()
    hold: bool  #: entities without keys there stand still
    seed: int  #: of the random numbers, 64 bits; default 0
    labels: bool | Sequence[str] | Mapping[str, Any]  #: True, or names: docs/python.md
    overlay: Edits | None  #: of Scene.overlay()
    revision: int | None  #: exactly this one; default the latest
    max_depth: int  #: edges of a path, at most; default 12
    roulette: bool  #: ends weak paths by chance, the mean stays; default True
    roulette_depth: int  #: edges of a path before that begins; default 3
    clamp: float  #: bounds each contribution, W sr^-1 m^-2; 0: off
    clamp_indirect: float  #: likewise, after three edges or more; 0: off
    regularize: bool  #: rougher lobes behind diffuse ones, against fireflies
    adaptive: bool  #: samples go where noise is; spp is the most
    filter: str  #: "box", "tent", "gaussian", "blackman_harris"
    transparent_background: bool  #: alpha is 0 where the dome is seen
    through_transmission: bool  #: labels look through glass
    vertex: int  #: of a path, that centre planes show; 0, the first surface
    progress: bool | Callable[[Progress], Any] | None  #: None: a bar where one watches
    on_pass: Callable[[Frame], Any] | None  #: called with a frame after each doubling of samples
    timeout: float | None  #: seconds, then DeadlineExceeded
    on_start: Callable[[Callable[[], None]], Any]  #: gets a function that cancels the call
    device: str  #: "cuda": planes stay on the GPU that renders (Frame.torch); "cpu"
    priority: int  #: -100..100, among the jobs of this tenant: higher ones go first, always


def render(scene: Scene, cameras: Sequence[Named], options: Options) -> list[Frame]:
    """Sends one request; returns its final frames in the order of the cameras."""
    return run(scene, make_request(scene, cameras, options), options)


def render_worlds(
    scene: Scene, cameras: Sequence[Named], worlds: Worlds, mask: Any, options: Options
) -> WorldFrame:
    """Sends one request; returns its one frame."""

    def ask() -> WorldFrame:
        request = make_request(scene, cameras, options)
        loan = worlds.put(request.worlds, scene.client.store, mask)
        frame: WorldFrame = _run(scene, request, options)[0]
        del loan  # the daemon has read its arrays
        return frame

    return _completed(scene, [*worlds.sources, *_sources(options)], ask)


def frame_count(request: render_pb.RenderRequest) -> int:
    """Number of final frames that answer a request."""
    return 1 if request.HasField("worlds") else len(request.cameras)


def run(scene: Scene, request: render_pb.RenderRequest, options: Options) -> list[Any]:
    """Sends a request; its final frames, one WorldFrame if it has worlds."""
    return _completed(scene, _sources(options), lambda: _run(scene, request, options))


def _sources(options: Options) -> list[Sources]:
    overlay = options.get("overlay")
    return [] if overlay is None else [overlay.sources]


def _completed(scene: Scene, sources: Sequence[Sources], ask: Callable[[], _Answer]) -> _Answer:
    """The call's answer; each upload that it is refused for is sent again once."""

    def send(digest: bytes) -> bool:
        refusal = NotFound(digest.hex())
        return any([each.bring(scene.client, refusal) for each in sources])

    return repeated(ask, send)


def _run(scene: Scene, request: render_pb.RenderRequest, options: Options) -> list[Any]:
    connection = scene.client.connection
    if _is_quick(request, options):
        link = connection.link
        with Meter(options.get("progress")) as meter:
            on_progress = meter.update if meter.is_on else None
            reply = link.ask_quickly(service.QuickCall(render=request), on_progress)
        if reply is not None:
            return frames_of(reply.parts, frame_count(request), link.shared)
    stream = connection.stream("Render", request, raw=True, timeout=options.get("timeout"))
    if "on_start" in options:
        options["on_start"](stream.cancel)
    assembly = Assembly(frame_count(request), stream.link.shared)
    on_pass = options.get("on_pass")
    with Meter(options.get("progress")) as meter:
        for data in stream:
            assembly.shared = stream.link.shared  # another one after a restart
            part = assembly.add(data)
            if isinstance(part, render_pb.Progress):
                meter.update(part)
            elif isinstance(part, Frame) and on_pass is not None:
                on_pass(part)
    return assembly.frames()


def _is_quick(request: render_pb.RenderRequest, options: Options) -> bool:
    """True for a small request that needs nothing of gRPC alone: half planes travel as bytes."""
    if any(options.get(name) for name in ("on_start", "on_pass", "timeout", "half")):
        return False
    return request.ByteSize() < QUICK_BYTES


def request_of_manifest(scene: Scene, manifest: str) -> render_pb.RenderRequest:
    """The RenderRequest that a manifest holds, for this scene's latest revision."""
    from google.protobuf.json_format import ParseDict, ParseError

    try:
        fields = json.loads(manifest)
        out = ParseDict(fields["request"], render_pb.RenderRequest())
    except (ValueError, TypeError, KeyError, ParseError) as error:
        raise InvalidArgument(
            f"manifest: is not one of a frame: {error}", field="manifest"
        ) from None
    if fields.get("overlay") and not out.HasField("overlay"):
        raise InvalidArgument(
            "manifest: its frame had an overlay too large to be kept: apply the same edits to the "
            "scene and render as usual",
            field="manifest",
        )
    if fields.get("worlds") and not out.HasField("worlds"):
        raise InvalidArgument(
            "manifest: its worlds were too large to be kept: render them as usual",
            field="manifest",
        )
    out.scene = scene.id
    out.ClearField("revision")
    out.ClearField("min_revision")
    return out


def may_any(scene: Scene, planes: Iterable[render_pb.PlaneRequest], averaged: bool) -> bool:
    """True where the daemon lists one of the planes as `averaged`, or does not list it."""
    averaged_by_plane = scene.client.connection.link.averaged
    return any(averaged_by_plane.get(plane.plane, averaged) == averaged for plane in planes)


def make_request(
    scene: Scene, cameras: Sequence[Named], options: Options
) -> render_pb.RenderRequest:
    """The RenderRequest of some Options."""
    refuse_unknown(options, Options, "render")
    if not cameras:
        raise InvalidArgument("cameras: needs at least one", field="cameras")
    out = render_pb.RenderRequest(
        scene=scene.id, seed=whole_of(options.get("seed", 0), "seed", 0, 2**64 - 1)
    )
    out.cameras.extend(_ref(camera) for camera in cameras)
    planes = options.get("planes", ["beauty"])
    if isinstance(planes, str):
        planes = [planes]
    out.planes.extend(_plane(plane) for plane in planes)
    _put_half(out, list(planes), options.get("half", ()))
    _put_stop_rule(scene, out, options)
    if "size" in options:
        out.width, out.height = _size(options["size"])
    for name in ("time", "label_time", "frame_interval", "clamp", "clamp_indirect"):
        if options.get(name) is not None:
            setattr(out, name, number_of(options[name], name))
    if "max_depth" in options:
        out.max_depth = whole_of(options["max_depth"], "max_depth", 1)
    if "roulette_depth" in options:
        out.roulette_depth = whole_of(options["roulette_depth"], "roulette_depth", 1)
    if "roulette" in options:
        out.roulette = options["roulette"]
    out.vertex = whole_of(options.get("vertex", 0), "vertex", 0)
    for flag in (
        "hold",
        "transparent_background",
        "through_transmission",
        "adaptive",
        "regularize",
    ):
        setattr(out, flag, bool(options.get(flag, False)))
    out.progressive = options.get("on_pass") is not None
    if "filter" in options:
        out.filter = _filter(options["filter"])
    _put_memory(out, options.get("device", "cpu"))
    out.buffers_in_header = True
    out.priority = whole_of(options.get("priority", 0), "priority", -100, 100)
    if options.get("revision"):
        out.revision = whole_of(options["revision"], "revision", 0, 2**64 - 1)
    overlay = options.get("overlay")
    if overlay is not None:
        out.overlay.CopyFrom(overlay.transaction)
    _put_labels(scene, out, options.get("labels"))
    return out


def _size(size: Any) -> tuple[int, int]:
    if np.shape(size) != (2,):
        raise InvalidArgument(f"size: needs (width, height), not {size!r}", field="size")
    return whole_of(size[0], "size[0]"), whole_of(size[1], "size[1]")


def _ref(thing: Named) -> types.Ref:
    return thing.ref() if isinstance(thing, Handle) else types.Ref(name=thing)


def _plane(plane: str | tuple[str, Named]) -> render_pb.PlaneRequest:
    """ "depth", "disparity:right", ("disparity", camera) or "beauty:GROUP"; "beauty:" is the group
    of lights without one."""
    if isinstance(plane, tuple):
        name, argument = plane
        grouped = name == "beauty"
    else:
        name, colon, argument = plane.partition(":")
        grouped = name == "beauty" and bool(colon)
    wanted = "PLANE_" + ("beauty_group" if grouped else name).upper()
    number = _PLANES.get(wanted)
    if not number:
        import difflib

        known = [key[len("PLANE_") :].lower() for key in list(_PLANES)[1:]]
        near = difflib.get_close_matches(name, known, 3) or known
        raise InvalidArgument(
            f"planes: no plane {name!r}; the nearest are {', '.join(near)}", field="planes"
        )
    out = render_pb.PlaneRequest(plane=number)
    if grouped:
        out.group = str(argument)
    elif argument:
        out.camera.CopyFrom(_ref(argument))
    return out


def _put_half(out: render_pb.RenderRequest, planes: list[Any], half: Any) -> None:
    for plane in [half] if isinstance(half, str) else half:
        if plane not in planes:
            raise InvalidArgument(f"half: {plane!r} is not among planes", field="half")
        out.planes[planes.index(plane)].half = True


def _put_stop_rule(scene: Scene, out: render_pb.RenderRequest, options: Options) -> None:
    if options.get("spp") is not None:
        out.spp = whole_of(options["spp"], "spp", 1)
    for name in ("seconds", "noise"):
        if options.get(name) is not None:
            setattr(out, name, number_of(options[name], name))
    rules = (out.HasField(name) for name in ("spp", "seconds", "noise"))
    if not any(rules) and may_any(scene, out.planes, averaged=True):
        out.spp = _DEFAULT_SPP


def _filter(name: str) -> Any:
    known = [key[len("PIXEL_FILTER_") :].lower() for key in render_pb.PixelFilter.keys()[1:]]
    if name not in known:
        raise InvalidArgument(f"filter: one of {', '.join(known)}, not {name!r}", field="filter")
    return render_pb.PixelFilter.Value(f"PIXEL_FILTER_{name.upper()}")


def _put_memory(out: render_pb.RenderRequest, device: str) -> None:
    if device == "cuda":
        cuda.driver()
        out.memory = render_pb.FRAME_MEMORY_CUDA
    elif device != "cpu":
        raise InvalidArgument(f'device: "cuda" or "cpu", not {device!r}', field="device")


def _put_labels(scene: Scene, out: render_pb.RenderRequest, labels: Any) -> None:
    """None: boxes where a plane looks at first surfaces anyway. True: everything but masks."""
    if labels is None:
        if out.vertex == 0 and may_any(scene, out.planes, averaged=False):
            out.labels.boxes = True
        return
    if labels is False:
        return
    wanted: Mapping[str, Any]
    if labels is True:
        wanted = {"boxes": True, "amodal": True, "keypoints": True}
    elif isinstance(labels, Mapping):
        wanted = labels
    else:
        wanted = dict.fromkeys([labels] if isinstance(labels, str) else labels, True)
    known = render_pb.LabelRequest.DESCRIPTOR.fields_by_name
    for name, value in wanted.items():
        if name not in known:
            raise InvalidArgument(
                f"labels: no {name!r}; there are {', '.join(known)}", field="labels"
            )
        field = f"labels.{name}"
        if known[name].type == known[name].TYPE_FLOAT:
            setattr(out.labels, name, number_of(value, field))
        elif known[name].type == known[name].TYPE_UINT32:
            setattr(out.labels, name, whole_of(value, field, 1))
        else:
            setattr(out.labels, name, bool(value))
