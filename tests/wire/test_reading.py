"""Reading back: components, arrays, scene files, spatial queries."""

import struct

import grpc
import numpy as np
import pytest
from conftest import Client, detail
from heliograph.v1 import scene_pb2, types_pb2
from heliograph.v1 import service_pb2 as service
from test_edits import entity, f32, named, pose, refused
from test_refused_messages import dots, full_lights
from test_render import render, request, setup

NUMPY = {
    types_pb2.D_TYPE_F32: np.float32,
    types_pb2.D_TYPE_F64: np.float64,
    types_pb2.D_TYPE_U8: np.uint8,
    types_pb2.D_TYPE_U32: np.uint32,
    types_pb2.D_TYPE_U64: np.uint64,
}


@pytest.fixture
def scene(client) -> int:
    return setup(client)


def read(client: Client, scene: int, name: str, field: str) -> np.ndarray:
    message = service.ReadRequest(scene=scene, refs=[named(name)], fields=[field])
    replies = list(client.call("Read", message))
    data = b"".join(r.array.inline for r in replies)
    first = replies[0].array
    return np.frombuffer(data, NUMPY[first.dtype]).reshape(first.shape)


def query(client: Client, scene: int, **fields) -> dict[str, np.ndarray]:
    reply = client.call("Query", service.QueryRequest(scene=scene, **fields))
    return {c.name: np.frombuffer(c.data, NUMPY[c.dtype]).reshape(c.shape) for c in reply.columns}


def test_a_pose_and_an_array_are_read_back(client, scene):
    matrix = read(client, scene, "thing", "pose")
    assert matrix.shape[-2:] == (4, 4) and matrix.reshape(4, 4)[2, 3] == -2
    positions = read(client, scene, "mesh", "mesh.positions")
    assert positions.reshape(-1, 3)[2].tolist() == [0, 9, 0]


def test_lights_and_portals_are_read_back_whole(client, scene):
    lights = full_lights()
    client.apply(
        scene,
        dots(),
        *(scene_pb2.Edit(target=named(name), entity=made) for name, made in lights.items()),
    )
    tree = client.call("DescribeScene", scene=scene, tree=True)
    texture = next(o.id for o in tree.objects if o.name == "dots")
    message = service.ReadRequest(scene=scene, refs=[named(n) for n in lights], fields=["entity"])
    replies = list(client.call("Read", message))
    assert [r.ref for r in replies] == list(range(len(lights)))
    for reply, made in zip(replies, lights.values(), strict=True):
        for ref in (made.light.profile, made.light.texture.texture):
            if ref.name:
                ref.id = texture
        for part in ("light", "portal"):
            for field, value in getattr(made, part).ListFields():
                found = getattr(getattr(reply.object.entity, part), field.name)
                if field.name == "texture":
                    value.uv_set = 0
                assert found == value, (part, field.name)


def test_an_unknown_field_or_object_is_refused(client, scene):
    message = service.ReadRequest(scene=scene, refs=[named("thing")], fields=["colour"])
    error = refused(lambda: list(client.call("Read", message)))
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert detail(error).field == "fields[0]"
    message = service.ReadRequest(scene=scene, refs=[named("thong")], fields=["pose"])
    error = refused(lambda: list(client.call("Read", message)))
    assert error.code() == grpc.StatusCode.NOT_FOUND
    assert "thing" in detail(error).nearest


def test_a_scene_file_makes_the_same_scene_in_another_session(daemon, client, scene):
    chunks = list(client.call("ExportScene", scene=scene))
    assert chunks[0].header.format == "heliograph.v1"
    other = Client(daemon)
    chunks[0].header.name = "copy"
    chunks[0].header.request_id = "import-1"
    send = lambda: other.stub.ImportScene(  # noqa: E731
        iter(chunks), metadata=other.metadata, timeout=10
    )
    info = send()
    assert info.name == "copy" and send() == info
    ((_, mine),) = render(client, request(scene, "BEAUTY", "DEPTH", spp=4))
    ((_, theirs),) = render(other, request(info.scene, "BEAUTY", "DEPTH", spp=4))
    assert np.array_equal(mine["beauty"], theirs["beauty"])
    assert np.array_equal(mine["depth"], theirs["depth"])
    other.close()


def test_a_file_of_another_format_is_refused(client):
    header = service.SceneChunk.Header(format="other")
    chunks = iter([service.SceneChunk(header=header)])
    error = refused(lambda: client.stub.ImportScene(chunks, metadata=client.metadata, timeout=5))
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT


def test_rays_say_what_they_hit(client, scene):
    rays = service.CastRays(
        origins=f32((2, 3), 0, 0, 0, 0, 0, 0), directions=f32((2, 3), 0, 0, -1, 0, 0, 1)
    )
    columns = query(client, scene, cast_rays=rays)
    assert columns["t"][0] == pytest.approx(2) and np.isinf(columns["t"][1])
    assert columns["entity"][0] != 0


def test_a_pick_and_a_bad_query(client, scene):
    pick = service.Pick(camera=named("cam"), pixels=f32((1, 2), 15.5, 11.5))
    assert query(client, scene, pick=pick)["t"][0] == pytest.approx(2, abs=1e-4)
    bad = service.CastRays(origins=f32((1, 3), 0, 0, 0), directions=f32((1, 3), 0, 0, 0))
    error = refused(lambda: query(client, scene, cast_rays=bad))
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert detail(error).field.startswith("cast_rays.directions")


def test_a_query_reads_own_writes(client, scene):
    client.apply(scene, entity("thing", pose=pose(0, 0, -4)))
    rays = service.CastRays(origins=f32((1, 3), 0, 0, 0), directions=f32((1, 3), 0, 0, -1))
    assert query(client, scene, cast_rays=rays)["t"][0] == pytest.approx(4)


def test_ids_name_objects_in_replies(client, scene):
    tree = client.call("DescribeScene", scene=scene, tree=True, pattern="th*")
    assert [o.name for o in tree.objects] == ["thing"]
    columns = query(
        client,
        scene,
        cast_rays=service.CastRays(origins=f32((1, 3), 0, 0, 0), directions=f32((1, 3), 0, 0, -1)),
    )
    assert struct.unpack("<Q", columns["entity"].tobytes())[0] == tree.objects[0].id
