"""The rows of authz_matrix.py: for each call, the ids that it takes and a request with each."""

from __future__ import annotations

import dataclasses
import hashlib
import struct
from collections.abc import Callable
from typing import Any

from heliograph._wire._proto import render_pb2, scene_pb2, types_pb2
from heliograph._wire._proto import service_pb2 as service

CORNERS = (0, 0, 0, 1, 0, 0, 0, 1, 0)


def sha256(data):
    return hashlib.sha256(data).digest()


def triangle_of(name):
    """Positions of a mesh that is a tenant's own."""
    return struct.pack("<9f", *CORNERS[:8], sum(name.encode()))


def named(name):
    return types_pb2.Ref(name=name)


def array(shape, **source):
    return types_pb2.Array(dtype=types_pb2.D_TYPE_F32, shape=shape, **source)


def mesh(**source):
    indices = types_pb2.Array(
        dtype=types_pb2.D_TYPE_U32, shape=(1, 3), inline=struct.pack("<3I", 0, 1, 2)
    )
    return scene_pb2.Mesh(positions=array((3, 3), **source), indices=indices)


def small_camera():
    return scene_pb2.Camera(width=4, height=4, fx=4, fy=4, cx=1.5, cy=1.5)


def upload_of(data, **fields):
    first = {"sha256": sha256(data), "size": len(data), "chunk": data, **fields}
    return service.UploadBlobRequest(**first)


def decode(blob):
    return service.DecodeAssetRequest(files=[service.BundleFile(path="tri.obj", sha256=blob)])


def render(scene, **fields):
    plane = render_pb2.PlaneRequest(plane=render_pb2.PLANE_DEPTH)
    return render_pb2.RenderRequest(scene=scene, cameras=[named("cam")], planes=[plane], **fields)


def overlay(me, **source):
    """A render request whose overlay uses an array."""
    changes = scene_pb2.Transaction(
        edits=[scene_pb2.Edit(target=named("mesh"), mesh=mesh(**source))]
    )
    return render(me.scene, overlay=changes)


def rays(scene):
    origins, directions = (
        array((1, 3), inline=struct.pack("<3f", *v)) for v in ((0, 0, 5), (0, 0, -1))
    )
    return service.QueryRequest(
        scene=scene, cast_rays=service.CastRays(origins=origins, directions=directions)
    )


def tracks(scene):
    times = types_pb2.Array(dtype=types_pb2.D_TYPE_F64, shape=(1,), inline=struct.pack("<d", 0))
    corner = types_pb2.Array(dtype=types_pb2.D_TYPE_U32, shape=(1,), inline=struct.pack("<I", 0))
    return service.TracksRequest(
        scene=scene, camera=named("cam"), entities=[named("thing")], vertices=corner, times=times
    )


def place(asset):
    return scene_pb2.Edit(instantiate=scene_pb2.Instantiate(asset=asset))


def shaped(**source):
    return scene_pb2.Edit(target=named("mesh"), mesh=mesh(**source))


def file_of(me, blob):
    """A scene file that lists no blob, of a scene that uses one."""
    changes = scene_pb2.Transaction(edits=[shaped(blob=blob)])
    header = service.SceneChunk.Header(format="heliograph.v1", transaction=changes)
    return [service.SceneChunk(header=header)]


@dataclasses.dataclass
class Row:
    """One kind of id that a call takes. `make(caller, id)` gives the requests; the codes are those
    of one's own id, of another's or a guessed one, and of none. ANY: not this table's matter."""

    kind: str
    make: Callable[[Any, Any], list]
    own: str = "OK"
    cross: str = "NOT_FOUND"
    none: str = "NOT_FOUND"


ROWS: dict[str, list[Row]] = {
    "GetServerInfo": [Row("nothing", lambda me, _: [service.GetServerInfoRequest()])],
    "ListSessions": [Row("nothing", lambda me, _: [service.ListSessionsRequest()])],
    "OpenSession": [
        Row(
            "ticket",
            lambda me, id: [service.OpenSessionRequest(ticket=id)],
            cross="UNAUTHENTICATED",
            none="OK",
        )
    ],
    "KeepSession": [Row("nothing", lambda me, _: [service.KeepSessionRequest()])],
    "CloseSession": [Row("nothing", lambda me, _: [service.CloseSessionRequest()])],
    "CreateScene": [
        Row(
            "name",
            lambda me, id: [service.CreateSceneRequest(name=id)],
            own="ALREADY_EXISTS",
            cross="OK",
            none="OK",
        )
    ],
    "OpenScene": [Row("name", lambda me, id: [service.OpenSceneRequest(name=id)])],
    "BranchScene": [Row("scene", lambda me, id: [service.BranchSceneRequest(scene=id)])],
    "DeleteScene": [
        Row(
            "scene",
            lambda me, id: [
                service.DeleteSceneRequest(scene=me.new_scene() if id == me.scene else id)
            ],
        )
    ],
    "ListScenes": [Row("nothing", lambda me, _: [service.ListScenesRequest()])],
    "DescribeScene": [Row("scene", lambda me, id: [service.DescribeSceneRequest(scene=id)])],
    "Apply": [
        Row("scene", lambda me, id: [me.transaction(id)]),
        Row("blob", lambda me, id: [me.transaction(me.scene, shaped(blob=id))]),
        Row("asset", lambda me, id: [me.transaction(me.scene, place(id))]),
        Row("upload", lambda me, id: [me.transaction(me.scene, shaped(upload=id))]),
    ],
    "ApplyStream": [
        Row("scene", lambda me, id: [me.transaction(id)]),
        Row("blob", lambda me, id: [me.transaction(me.scene, shaped(blob=id))]),
    ],
    "UploadBlob": [Row("bytes", lambda me, id: [upload_of(id)], cross="OK", none="OK")],
    "LendBuffer": [
        Row(
            "nothing",
            lambda me, _: [service.LendBufferRequest(size=64)],
            own="FAILED_PRECONDITION",
        )
    ],
    "DecodeAsset": [Row("file", lambda me, id: [decode(id)])],
    "Read": [
        Row(
            "scene",
            lambda me, id: [service.ReadRequest(scene=id, refs=[named("cam")], fields=["pose"])],
        )
    ],
    "ExportScene": [Row("scene", lambda me, id: [service.ExportSceneRequest(scene=id)])],
    "ImportScene": [Row("blob", file_of, own="ANY", cross="ANY", none="ANY")],
    "Query": [Row("scene", lambda me, id: [rays(id)])],
    "Tracks": [Row("scene", lambda me, id: [tracks(id)])],
    "Render": [
        Row("scene", lambda me, id: [render(id)]),
        Row("blob", lambda me, id: [overlay(me, blob=id)]),
    ],
    "Watch": [
        Row(
            "scene",
            lambda me, id: [service.WatchRequest(scene=id, from_revision=1 << 40)],
            own="OUT_OF_RANGE",
        )
    ],
    "Stream": [Row("scene", lambda me, id: [service.StreamRequest(settings=render(id))])],
    "RenderBatch": [
        Row("scene", lambda me, id: [service.RenderBatchRequest(job=render(id))]),
        Row("blob", lambda me, id: [service.RenderBatchRequest(job=overlay(me, blob=id))]),
    ],
}
