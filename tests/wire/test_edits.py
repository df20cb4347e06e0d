"""Edits: exactly once, in order, all or nothing, isolated between branches."""

import struct

import grpc
import pytest
from conftest import Client, detail, detail_of
from heliograph.v1 import render_pb2, scene_pb2, types_pb2
from heliograph.v1 import service_pb2 as service

ABORTED = grpc.StatusCode.ABORTED


def array(dtype: int, shape: tuple, fmt: str, *values) -> types_pb2.Array:
    return types_pb2.Array(
        dtype=dtype, shape=shape, inline=struct.pack(f"<{len(values)}{fmt}", *values)
    )


def f32(shape: tuple, *values) -> types_pb2.Array:
    return array(types_pb2.D_TYPE_F32, shape, "f", *values)


def named(name: str) -> types_pb2.Ref:
    return types_pb2.Ref(name=name)


def pose(*translation: float) -> types_pb2.Pose:
    x, y, z = translation
    return types_pb2.Pose(matrices=f32((4, 4), 1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z, 0, 0, 0, 1))


def entity(name: str, **fields) -> scene_pb2.Edit:
    mode = fields.pop("mode", scene_pb2.Edit.MODE_UPSERT)
    return scene_pb2.Edit(mode=mode, target=named(name), entity=scene_pb2.Entity(**fields))


def triangle(name: str, indices=(0, 1, 2), positions=(-1, -1, 0, 1, -1, 0, 0, 1, 0)):
    mesh = scene_pb2.Mesh(
        positions=f32((len(positions) // 3, 3), *positions),
        indices=array(types_pb2.D_TYPE_U32, (len(indices) // 3, 3), "I", *indices),
    )
    return scene_pb2.Edit(target=named(name), mesh=mesh)


def refused(call) -> grpc.RpcError:
    with pytest.raises(grpc.RpcError) as error:
        call()
    return error.value


@pytest.fixture
def scene(client) -> int:
    return client.create()


def test_a_transaction_gives_ids_and_a_revision(client, scene):
    reply = client.apply(scene, triangle("t"), entity("e", mesh=named("t")))
    assert (reply.number, reply.revision, len(reply.ids)) == (1, 1, 16)
    mesh, thing = struct.unpack("<2Q", reply.ids)
    assert mesh and thing and mesh != thing
    tree = client.call("DescribeScene", scene=scene, tree=True)
    assert {o.name: o.id for o in tree.objects} == {"t": mesh, "e": thing}
    assert tree.counts.entities == 1 and tree.counts.meshes == 1


def test_a_repeated_number_is_answered_not_done_again(client, scene):
    first = client.apply(scene, entity("a"))
    again = client.apply(scene, entity("b"), number=1)
    assert first == again
    assert client.revision(scene) == 1
    assert [o.name for o in client.call("DescribeScene", scene=scene, tree=True).objects] == ["a"]


def test_a_gap_names_the_number_expected(client, scene):
    client.apply(scene, entity("a"))
    error = refused(lambda: client.apply(scene, entity("b"), number=5))
    assert error.code() == ABORTED
    assert detail(error).expected == 2
    client.apply(scene, entity("b"), number=2)
    assert client.revision(scene) == 2


def test_there_is_no_edit_0(client, scene):
    for next_number in (1, 2):
        error = refused(lambda: client.apply(scene, entity("z"), number=0))
        assert error.code() == grpc.StatusCode.INVALID_ARGUMENT
        assert detail(error).field == "number"
        assert detail(error).expected == next_number
        assert f"numbered from 1: give {next_number}" in error.details()
        client.apply(scene, entity("a"), number=next_number)
    assert client.revision(scene) == 2


def test_a_refusal_uses_its_number_up_and_is_answered_again(client, scene):
    for _ in range(2):
        error = refused(
            lambda: client.apply(scene, entity("x", mode=scene_pb2.Edit.MODE_UPDATE), number=1)
        )
        assert error.code() == grpc.StatusCode.NOT_FOUND
    assert client.revision(scene) == 0
    client.apply(scene, entity("x"), number=2)
    assert client.revision(scene) == 1


def test_sessions_number_their_edits_of_a_shared_scene_apart(daemon, client):
    other = Client(daemon)
    scene = client.create("counted", lifetime="LIFETIME_DAEMON")
    client.apply(scene, entity("a"))
    assert other.call("OpenScene", name="counted").next_edit == 1
    other.apply(scene, entity("b"))
    assert client.call("OpenScene", name="counted").next_edit == 2
    assert client.revision(scene) == other.revision(scene) == 2
    client.call("DeleteScene", scene=scene)
    other.close()


def test_expected_revision(client, scene):
    client.apply(scene, entity("a"), expected_revision=0)
    error = refused(lambda: client.apply(scene, entity("b"), expected_revision=0))
    assert error.code() == ABORTED
    assert detail(error).expected == 1


def test_a_branch_is_isolated_both_ways(client, scene):
    client.apply(scene, entity("a"))
    branch = client.call("BranchScene", scene=scene).scene
    client.apply(branch, entity("b"))
    client.apply(scene, entity("c"))

    def names(of):
        return {o.name for o in client.call("DescribeScene", scene=of, tree=True).objects}

    assert names(branch) == {"a", "b"}
    assert names(scene) == {"a", "c"}
    client.call("DeleteScene", scene=scene)
    assert names(branch) == {"a", "b"}


def test_a_branch_may_start_at_an_older_revision(client, scene):
    client.apply(scene, entity("a"))
    client.apply(scene, entity("b"))
    branch = client.call("BranchScene", scene=scene, revision=1)
    assert branch.revision == 1
    tree = client.call("DescribeScene", scene=branch.scene, tree=True)
    assert [o.name for o in tree.objects] == ["a"]
    error = refused(lambda: client.call("BranchScene", scene=scene, revision=99))
    assert error.code() == grpc.StatusCode.OUT_OF_RANGE


def test_an_array_of_fewer_bytes_than_its_shape_is_refused(client, scene):
    short = types_pb2.Array(dtype=types_pb2.D_TYPE_F32, shape=[9, 3], inline=b"1234")
    edit = scene_pb2.Edit(target=named("m"), mesh=scene_pb2.Mesh(positions=short))
    error = refused(lambda: client.apply(scene, edit))
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert detail(error).field.startswith("edits[0].mesh.positions"), detail(error)
    assert client.revision(scene) == 0


def test_one_bad_edit_undoes_its_transaction(client, scene):
    error = refused(lambda: client.apply(scene, entity("good"), entity("bad", mesh=named("no"))))
    assert detail(error).field.startswith("edits[1]")
    assert not client.call("DescribeScene", scene=scene, tree=True).objects


def test_the_edits_of_a_transaction_are_limited(start):
    client = Client(start(limits={"edits": 2}))
    scene = client.create()
    three = [entity(name) for name in "abc"]
    error = refused(lambda: client.apply(scene, *three))
    assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED and "limit edits" in error.details()
    found = detail(error)
    assert (found.field, found.needed, found.allowed, found.limit) == ("edits", 3, 2, "edits")
    assert found.reason == "LIMIT_EXCEEDED"
    streamed = service.ApplyRequest(scene=scene, number=2)
    streamed.transaction.edits.extend(three)
    (reply,) = client.stub.ApplyStream(iter([streamed]), metadata=client.metadata, timeout=20)
    assert reply.status.code == 8 and detail_of(reply.status).field == "edits"
    camera = scene_pb2.Camera(width=2, height=2, fx=2, fy=2, cx=0.5, cy=0.5)
    client.numbers[scene] = 2
    client.apply(scene, entity("cam", camera=camera), entity("a"))
    overlay = scene_pb2.Transaction(edits=three)
    depth = render_pb2.PlaneRequest(plane=render_pb2.PLANE_DEPTH)
    fields = {"overlay": overlay}, {"worlds": render_pb2.Worlds(count=1, overlays=[overlay])}
    for each, where in zip(fields, ("overlay.edits", "worlds.overlays[0].edits"), strict=True):
        request = render_pb2.RenderRequest(
            scene=scene, cameras=[named("cam")], planes=[depth], **each
        )
        error = refused(lambda r=request: list(client.call("Render", r)))
        assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED, error.details()
        assert detail(error).field == where
    client.close()


def test_an_unknown_field_in_an_edit_uses_its_number_up(client, scene):
    request = service.ApplyRequest(scene=scene, number=1)
    request.transaction.edits.append(scene_pb2.Edit.FromString(b"\xf8\x07\x01"))
    error = refused(lambda: client.call("Apply", request))
    assert error.code() == grpc.StatusCode.UNIMPLEMENTED
    assert "edits[0]" in detail(error).field + error.details()
    client.apply(scene, entity("a"), number=2)


def test_a_message_over_the_limit_is_refused_and_the_next_works(client, scene):
    big = types_pb2.Array(dtype=types_pb2.D_TYPE_U8, shape=[17 << 20], inline=bytes(17 << 20))
    edit = scene_pb2.Edit(target=named("t"), texture=scene_pb2.Texture(texels=big))
    error = refused(lambda: client.apply(scene, edit, number=1))
    assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    client.apply(scene, entity("a"), number=1)


def test_a_stream_answers_in_order_and_goes_on_after_a_refusal(client, scene):
    def requests():
        for number in range(1, 101):
            request = service.ApplyRequest(scene=scene, number=number)
            mesh = named("missing") if number == 50 else None
            request.transaction.edits.append(entity(f"e{number}", mesh=mesh))
            yield request

    replies = list(client.stub.ApplyStream(requests(), metadata=client.metadata, timeout=20))
    assert [r.number for r in replies] == list(range(1, 101))
    assert [r.number for r in replies if r.HasField("status")] == [50]
    assert replies[49].status.code == 5
    assert detail_of(replies[49].status).field.startswith("edits[0]")
    assert replies[-1].revision == 99


def test_applying_to_a_deleted_scene_is_not_found(client, scene):
    client.call("DeleteScene", scene=scene)
    assert refused(lambda: client.apply(scene, entity("a"))).code() == grpc.StatusCode.NOT_FOUND
