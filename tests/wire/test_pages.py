"""Lists come in pages, and answers that may be long in pieces: none outgrows a message."""

import grpc
import numpy as np
import pytest
from conftest import Client, detail
from heliograph.v1 import scene_pb2, types_pb2
from heliograph.v1 import service_pb2 as service

MESSAGE = 4 << 20  # bytes that gRPC's clients take by default
OBJECTS, SCENES = 100_000, 10_000


def pages(client, method, **fields):
    token = ""
    while True:
        reply = client.call(method, page_token=token, **fields)
        assert reply.ByteSize() < MESSAGE
        yield reply
        token = reply.next_page_token
        if not token:
            return


def instances(count, name="n"):
    matrices = np.tile(np.eye(4, dtype="<f4"), (count, 1, 1))
    array = types_pb2.Array(dtype=types_pb2.D_TYPE_F32, shape=matrices.shape)
    edit = scene_pb2.Edit(target={"name": name}, instances={"matrices": array})
    edit.instances.prototype.SetInParent()
    return edit, matrices.tobytes()


def fill(client, scene, count):
    """`count` entities and their parent."""
    edit, data = instances(count)
    chunks = [data[i : i + (1 << 20)] for i in range(0, len(data), 1 << 20)]
    first = service.UploadBlobRequest(request_id=f"m{scene}", size=len(data), chunk=chunks[0])
    rest = [service.UploadBlobRequest(chunk=chunk) for chunk in chunks[1:]]
    client.call("UploadBlob", iter([first, *rest]))
    edit.instances.matrices.upload = first.request_id
    client.apply(scene, edit)


@pytest.fixture(scope="module")
def large(daemon):
    client = Client(daemon)
    scene = client.create()
    fill(client, scene, OBJECTS)
    yield client, scene
    client.close()


def test_100_000_objects_are_described(large):
    client, scene = large
    found = list(pages(client, "DescribeScene", scene=scene, tree=True))
    ids = [o.id for reply in found for o in reply.objects]
    assert len(found) > 1 and len(set(ids)) == len(ids) == found[0].counts.entities
    assert len(ids) >= OBJECTS and ids == sorted(ids)
    assert {reply.scene.revision for reply in found} == {1}


def test_a_page_has_as_many_as_it_is_asked_for(large):
    client, scene = large
    first = client.call("DescribeScene", scene=scene, tree=True, page_size=3)
    second = client.call(
        "DescribeScene", scene=scene, tree=True, page_size=3, page_token=first.next_page_token
    )
    both = client.call("DescribeScene", scene=scene, tree=True, page_size=6)
    assert [*first.objects, *second.objects] == list(both.objects) and len(both.objects) == 6
    last = client.call("DescribeScene", scene=scene, tree=True, pattern="n/9", page_size=3)
    assert [o.name for o in last.objects] == ["n/9"] and not last.next_page_token


def test_what_is_removed_between_pages_leaves_the_rest(client):
    scene = client.create()
    fill(client, scene, 10)
    listed = pages(client, "DescribeScene", scene=scene, tree=True, page_size=4)
    names = [o.name for o in next(listed).objects]
    gone = scene_pb2.Edit(target={"name": names[0]}, remove={})
    next_one = scene_pb2.Edit(target={"name": "n/9"}, remove={})
    client.apply(scene, gone, next_one)
    names += [o.name for reply in listed for o in reply.objects]
    assert len(set(names)) == len(names) and {f"n/{i}" for i in range(9)} <= set(names)


def test_10_000_scenes_are_listed(start):
    client = Client(start(limits={"scenes": SCENES + 1}))
    made = [client.create(f"scene {i}" if i % 2 else "") for i in range(SCENES)]
    found = list(pages(client, "ListScenes", page_size=3000))
    assert [info.scene for reply in found for info in reply.scenes] == made
    assert len(found) == 4
    assert [i.scene for r in pages(client, "ListScenes") for i in r.scenes] == made
    client.close()


def test_sessions_are_listed_the_oldest_first(start):
    daemon = start()
    clients = [Client(daemon) for _ in range(5)]
    listed = pages(clients[0], "ListSessions", page_size=2)
    found = [use for reply in listed for use in reply.sessions]
    assert len(found) == 5
    ages = [use.open_seconds for use in found]
    assert ages[0] >= ages[-1] > 0
    for client in clients:
        client.close()


@pytest.mark.parametrize("method", ["ListScenes", "ListSessions", "DescribeScene"])
def test_another_token_is_refused(client, method):
    fields = {"scene": client.create()} if method == "DescribeScene" else {}
    with pytest.raises(grpc.RpcError) as error:
        client.call(method, page_token="1x", **fields)
    assert error.value.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert detail(error.value).field == "page_token"


def test_a_long_answer_comes_in_pieces(client):
    """65,536 rays: 56 bytes a row and more."""
    scene = client.create()
    count = 1 << 16
    request = service.QueryRequest(scene=scene)
    for name in ("origins", "directions"):
        array = types_pb2.Array(dtype=types_pb2.D_TYPE_F32, shape=[count, 3])
        array.inline = np.ones((count, 3), "<f4").tobytes()
        getattr(request.cast_rays, name).CopyFrom(array)
    pieces = list(client.stub.Query(request, metadata=client.metadata, timeout=30))
    assert len(pieces) > 1 and all(piece.ByteSize() < MESSAGE for piece in pieces)
    for piece in pieces:
        rows = {column.shape[0] for column in piece.columns}
        assert len(rows) == 1
    assert sum(piece.columns[0].shape[0] for piece in pieces) == count
