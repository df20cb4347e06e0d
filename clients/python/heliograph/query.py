"""Spatial queries in packed arrays. Called by Scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import grpc
import numpy as np

from ._arrays import Columns, NdArray, checked, inline
from ._connection import to_error
from ._proto import service_pb2 as service
from ._proto import types_pb2 as types
from .components import whole_of
from .errors import InvalidArgument
from .handles import Handle, Named, flatten

if TYPE_CHECKING:
    from .scene import Scene

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
    replies = [scene.client.connection.call("Query", requests[0])]
    link = scene.client.connection.link
    ask = link.method("Query").future
    flying: list[Any] = []
    for request in [*requests[1:], *[None] * _IN_FLIGHT]:
        if request is not None:
            request.revision = replies[0].revision
            flying.append(ask(request, metadata=link.metadata))
        if flying and (request is None or len(flying) == _IN_FLIGHT):
            try:
                replies.append(flying.pop(0).result())
            except BaseException as error:
                for call in flying:
                    call.cancel()
                if isinstance(error, grpc.RpcError):
                    raise to_error(error) from None
                raise
    return replies


def _joined(replies: list[service.QueryReply]) -> Columns:
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
