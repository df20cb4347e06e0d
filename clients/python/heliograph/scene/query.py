"""Spatial queries in packed arrays. Called by Scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import grpc
import numpy as np

from .._wire._proto import service_pb2 as service
from .._wire._proto import types_pb2 as types
from .._wire.arrays import Columns, NdArray, checked, inline
from .._wire.status import to_error
from ..errors import InvalidArgument
from ..values.checks import whole_of
from .handles import Handle, Named, flatten

if TYPE_CHECKING:
    from ..client.scene import Scene

_RAYS = 65536  # a message: 768 KiB of origins, as many of directions
_IN_FLIGHT = 4


def _ref(thing: Named) -> types.Ref:
    return thing.ref() if isinstance(thing, Handle) else types.Ref(name=thing)


def _refs(things: Any, field: str) -> list[types.Ref]:
    refs = [_ref(thing) for thing in flatten(things, field)]
    if not refs:
        raise InvalidArgument(f"{field}: needs at least one entity", field=field)
    return refs


def _ask(scene: Scene, requests: list[service.QueryRequest]) -> list[service.QueryReply]:
    """Sends requests a few at a time, all of the revision that the first one saw."""
    replies = scene.client.connection.call_all("Query", requests[0])
    link = scene.client.connection.link
    ask = link.method("Query")
    flying: list[Any] = []
    for request in [*requests[1:], *[None] * _IN_FLIGHT]:
        if request is not None:
            request.revision = replies[0].revision
            flying.append(ask(request, metadata=link.metadata))
        if flying and (request is None or len(flying) == _IN_FLIGHT):
            try:
                replies.extend(flying.pop(0))
            except BaseException as error:
                for call in flying:
                    call.cancel()
                if isinstance(error, grpc.RpcError):
                    raise to_error(error) from None
                raise
    return replies


def _joined(replies: list[Any]) -> Columns:
    """Joins the rows of several replies."""
    parts = [Columns.of(reply.columns) for reply in replies]
    if len(parts) == 1:
        return parts[0]
    return Columns({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def cast_rays(scene: Scene, origins: Any, directions: Any, limits: tuple[float, bool]) -> Columns:
    """See Scene.cast_rays; limits: (t_max, any_hit)."""
    given = [np.asarray(origins), np.asarray(directions)]
    count = max(len(a) for a in (np.atleast_2d(g) for g in given))
    arrays = []
    for array, field in zip(given, ("origins", "directions")):
        wide = np.broadcast_to(array, (count, 3)) if array.shape in ((3,), (1, 3)) else array
        arrays.append(checked(wide, field, "<f4", (None, 3)))
    if len(arrays[0]) != len(arrays[1]):
        raise InvalidArgument(
            f"directions: {len(arrays[1])} for {len(arrays[0])} origins", field="directions"
        )
    requests = []
    for start in range(0, max(1, count), _RAYS):
        piece = [inline(a[start : start + _RAYS]) for a in arrays]
        rays = service.CastRays(
            origins=piece[0], directions=piece[1], t_max=limits[0], any_hit=limits[1]
        )
        requests.append(service.QueryRequest(scene=scene.id, cast_rays=rays))
    return _joined(_ask(scene, requests))


def pick(scene: Scene, camera: Named, pixels: Any) -> Columns:
    """See Scene.pick."""
    points = checked(np.atleast_2d(np.asarray(pixels)), "pixels", "<f4", (None, 2))
    requests = []
    for start in range(0, max(1, len(points)), _RAYS):
        piece = service.Pick(camera=_ref(camera), pixels=inline(points[start : start + _RAYS]))
        requests.append(service.QueryRequest(scene=scene.id, pick=piece))
    return _joined(_ask(scene, requests))


def visible(scene: Scene, camera: Named, entities: Any) -> Columns:
    """See Scene.visible."""
    question = service.Visible(camera=_ref(camera), entities=_refs(entities, "entities"))
    columns = _joined(_ask(scene, [service.QueryRequest(scene=scene.id, visible=question)]))
    return Columns({**columns, "visible": columns["visible"].astype(bool)})


def overlaps(scene: Scene, a: Any, b: Any) -> NdArray:
    """See Scene.overlaps."""
    question = service.Overlaps(a=_refs(a, "a"), b=_refs(b, "b"))
    columns = _joined(_ask(scene, [service.QueryRequest(scene=scene.id, overlaps=question)]))
    return np.asarray(columns["overlaps"]).astype(bool)


def sample_surface(scene: Scene, entities: Any, count: int, seed: int) -> Columns:
    """See Scene.sample_surface."""
    question = service.SampleSurface(
        entities=_refs(entities, "entities"),
        count=whole_of(count, "count"),
        seed=whole_of(seed, "seed", 0, 2**64 - 1),
    )
    return _joined(_ask(scene, [service.QueryRequest(scene=scene.id, sample_surface=question)]))


_TRACK_ITEMS, _TRACK_TIMES = 65536, 64  # points times times, and times, of a message


def tracks(
    scene: Scene, camera: Named, points: Any, times: Any, through_transmission: bool
) -> Columns:
    """See Scene.tracks."""
    common = service.TracksRequest(
        scene=scene.id, camera=_ref(camera), through_transmission=through_transmission
    )
    arrays = _track_points(points, common)
    instants = checked(np.atleast_1d(np.asarray(times)), "times", "<f8", (None,))
    count = len(next(iter(arrays.values())))
    across = max(1, _TRACK_ITEMS // min(_TRACK_TIMES, max(1, len(instants))))
    rows = []
    for start in range(0, max(1, count), across):
        part = {name: array[start : start + across] for name, array in arrays.items()}
        replies = []
        for first in range(0, max(1, len(instants)), _TRACK_TIMES):
            request = service.TracksRequest()
            request.CopyFrom(common)
            for name, array in part.items():
                getattr(request, name).CopyFrom(inline(array))
            request.times.CopyFrom(inline(instants[first : first + _TRACK_TIMES]))
            pieces = scene.client.connection.call_all("Tracks", request)
            common.revision = pieces[0].revision  # the rest of one revision
            replies.append(_joined(pieces))
        rows.append({n: np.concatenate([r[n] for r in replies], axis=1) for n in replies[0]})
    out = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    return Columns({**out, "visible": out["visible"].astype(bool)})


def _track_points(points: Any, request: service.TracksRequest) -> dict[str, NdArray]:
    """The arrays that place points; puts the entities into the request."""
    if isinstance(points, Mapping):
        missing = [name for name in ("entity", "primitive", "barycentric") if name not in points]
        if missing:
            raise InvalidArgument(f"points: no column {missing[0]!r}", field="points")
        ids = checked(points["entity"], "points.entity", "<u8", (None,))
        if not ids.all():
            where = int(np.flatnonzero(ids == 0)[0])
            raise InvalidArgument(
                f"points.entity[{where}]: nothing was hit there; leave such rows out",
                field="points",
            )
        known, index = np.unique(ids, return_inverse=True)
        request.entities.extend(types.Ref(id=int(i)) for i in known)
        arrays = {
            "entity": index.astype("<u4"),
            "primitive": checked(points["primitive"], "points.primitive", "<u4", (None,)),
            "barycentric": checked(points["barycentric"], "points.barycentric", "<f4", (None, 2)),
        }
    else:
        if not isinstance(points, tuple) or len(points) not in (2, 3):
            raise InvalidArgument(
                "points: columns of pick() or sample_surface(), (entity, vertices), or (entity, "
                "primitive, barycentric)",
                field="points",
            )
        request.entities.append(_ref(points[0]))
        number = np.atleast_1d(np.asarray(points[1]))
        if len(points) == 2:
            return {"vertices": checked(number, "points.vertices", "<u4", (None,))}
        weights = np.atleast_2d(np.asarray(points[2]))
        arrays = {
            "primitive": checked(number, "points.primitive", "<u4", (None,)),
            "barycentric": checked(weights, "points.barycentric", "<f4", (None, 2)),
        }
    lengths = {name: len(array) for name, array in arrays.items()}
    if len(set(lengths.values())) > 1:
        raise InvalidArgument(f"points: columns of different lengths, {lengths}", field="points")
    return arrays
