"""Uploads and assets: chunks, hashes, limits, decoding, paths of the daemon's own machine."""

import hashlib
import json
import os
import struct

import grpc
import pytest
from conftest import Client, detail
from heliograph.v1 import scene_pb2, types_pb2
from heliograph.v1 import service_pb2 as service
from test_edits import named, refused

MIB = 1 << 20


def messages(data: bytes, chunk: int = MIB, **first):
    first.setdefault("size", len(data))
    for offset in range(0, max(len(data), 1), chunk):
        yield service.UploadBlobRequest(chunk=data[offset : offset + chunk], **first)
        first = {}


def upload(client: Client, data: bytes, **options) -> service.UploadBlobReply:
    return client.stub.UploadBlob(messages(data, **options), metadata=client.metadata, timeout=20)


def digest(data: bytes) -> bytes:
    return hashlib.sha256(data).digest()


def texture(source: types_pb2.Array) -> scene_pb2.Edit:
    return scene_pb2.Edit(target=named("t"), texture=scene_pb2.Texture(texels=source))


def texels(side: int, **source) -> types_pb2.Array:
    return types_pb2.Array(dtype=types_pb2.D_TYPE_U8, shape=(side, side, 4), **source)


def test_a_blob_is_uploaded_in_chunks_once_and_used(client):
    data = os.urandom(3 * MIB + 1024 * 1024)
    assert not upload(client, data, sha256=digest(data)).existed
    reply = upload(client, data, sha256=digest(data))
    assert reply.existed and reply.size == len(data)
    scene = client.create()
    client.apply(scene, texture(texels(1024, blob=digest(data))))
    assert client.call("DescribeScene", scene=scene, memory=True).memory.arrays >= len(data)


def test_an_anonymous_upload_is_consumed_by_its_use(client):
    data = os.urandom(16 * 16 * 4)
    upload(client, data, request_id="u1")
    scene = client.create()
    client.apply(scene, texture(texels(16, upload="u1")))
    error = refused(lambda: client.apply(scene, texture(texels(16, upload="u1"))))
    assert error.code() == grpc.StatusCode.NOT_FOUND
    assert detail(error).field.startswith("edits[0].texture.texels")


BAD = {
    "wrong hash": (dict(sha256=digest(b"other")), "INVALID_ARGUMENT"),
    "short hash": (dict(sha256=b"short"), "INVALID_ARGUMENT"),
    "too few bytes": (dict(request_id="b1", size=1000), "INVALID_ARGUMENT"),
    "too many bytes": (dict(request_id="b2", size=10), "INVALID_ARGUMENT"),
    "no name": (dict(), "INVALID_ARGUMENT"),
    "long name": (dict(request_id="x" * 257), "INVALID_ARGUMENT"),
    "over the limit": (dict(request_id="b3", size=1 << 50), "RESOURCE_EXHAUSTED"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_upload_is_refused_and_the_next_works(client, name):
    first, code = BAD[name]
    error = refused(lambda: upload(client, b"x" * 100, **first))
    assert error.code().name == code, error.details()
    upload(client, b"y" * 100, request_id="good-" + name)


def test_a_chunk_over_its_limit_is_refused(client):
    error = refused(lambda: upload(client, b"x" * (2 * MIB), chunk=2 * MIB, request_id="c"))
    assert detail(error).field == "chunk"


def test_an_empty_upload_stream_is_refused(client):
    error = refused(lambda: client.stub.UploadBlob(iter(()), metadata=client.metadata, timeout=5))
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT


def test_another_sessions_upload_is_not_found(daemon, client):
    other = Client(daemon)
    upload(other, b"z" * 1024, request_id="theirs")
    error = refused(lambda: client.apply(client.create(), texture(texels(16, upload="theirs"))))
    assert error.code() == grpc.StatusCode.NOT_FOUND
    other.close()


def gltf(image: str | None = None) -> tuple[bytes, bytes]:
    """A triangle as .gltf and its .bin; `image` names a picture that the material uses."""
    positions = struct.pack("<9f", -1, -1, 0, 1, -1, 0, 0, 1, 0)
    model = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        "nodes": [{"name": "tri", "mesh": 0}],
        "meshes": [{"name": "tri_mesh", "primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 3,
                "type": "VEC3",
                "min": [-1, -1, 0],
                "max": [1, 1, 0],
            }
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"uri": "tri.bin", "byteLength": 36}],
    }
    if image:
        model["images"] = [{"uri": image}]
        model["textures"] = [{"source": 0}]
        model["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        model["meshes"][0]["primitives"][0]["material"] = 0
    return json.dumps(model).encode(), positions


def decode(client: Client, **files: bytes) -> service.DecodeAssetReply:
    request = service.DecodeAssetRequest()
    for path, data in files.items():
        upload(client, data, sha256=digest(data))
        request.files.add(path=path.replace("__", "."), sha256=digest(data))
    return list(client.call("DecodeAsset", request, timeout=60))[-1]


def test_a_bundle_is_decoded_and_placed(client):
    model, binary = gltf()
    reply = decode(client, model__gltf=model, tri__bin=binary)
    assert reply.done == 1 and not reply.missing
    assert list(reply.asset.meshes) and list(reply.asset.entities)
    scene = client.create()
    place = scene_pb2.Instantiate(asset=reply.asset.sha256)
    client.apply(scene, scene_pb2.Edit(target=named("one"), instantiate=place))
    client.apply(scene, scene_pb2.Edit(target=named("two"), instantiate=place))
    counts = client.call("DescribeScene", scene=scene).counts
    assert counts.meshes == 1 and counts.entities >= 4


def test_a_bundle_that_lacks_a_file_names_it(client):
    model, _ = gltf()
    reply = decode(client, model__gltf=model)
    assert list(reply.missing) == ["tri.bin"] and not reply.HasField("asset")


def test_a_broken_file_is_refused_and_the_next_works(client):
    broken = b"glTF" + struct.pack("<II", 2, 112) + b"\xff" * 100
    error = refused(lambda: decode(client, bad__glb=broken))
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT, error.details()
    model, binary = gltf()
    assert decode(client, model__gltf=model, tri__bin=binary).HasField("asset")


def bundle(client: Client, *paths: str) -> service.DecodeAssetRequest:
    """One blob of 1 MiB under all of these."""
    data = b"ply\n" + bytes(MIB - 4)
    upload(client, data, sha256=digest(data))
    files = [service.BundleFile(path=path, sha256=digest(data)) for path in paths]
    return service.DecodeAssetRequest(files=files)


def test_a_path_is_in_a_bundle_once(client):
    request = bundle(client, "m.ply", "a", "a")
    error = refused(lambda: list(client.call("DecodeAsset", request)))
    assert error.code() == grpc.StatusCode.INVALID_ARGUMENT
    assert detail(error).field == "files[2].path" and "twice" in error.details()


@pytest.mark.parametrize("limit", ["decode_bytes", "tenant_bytes"])
def test_what_is_copied_for_the_decoder_is_limited_and_charged(start, limit):
    small, files = (900 * MIB, 901) if limit == "decode_bytes" else (8 * MIB, 8)
    client = Client(start(limits={limit: small}))
    request = bundle(client, "m.ply", *(f"f{i}" for i in range(files - 1)))
    used = client.call("GetServerInfo").used["tenant_bytes"]
    error = refused(lambda: list(client.call("DecodeAsset", request)))
    assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert detail(error).field == "files" and limit in error.details()
    assert detail(error).needed == files * MIB
    del request.files[1:]
    assert "PLY" in refused(lambda: list(client.call("DecodeAsset", request))).details().upper()
    assert client.call("GetServerInfo").used["tenant_bytes"] == used
    client.close()


def test_an_unknown_asset_is_not_found(client):
    place = scene_pb2.Instantiate(asset=b"\1" * 32)
    error = refused(lambda: client.apply(client.create(), scene_pb2.Edit(instantiate=place)))
    assert error.code() == grpc.StatusCode.NOT_FOUND
    missing = service.BundleFile(path="a.glb", sha256=b"\1" * 32)
    request = service.DecodeAssetRequest(files=[missing])
    error = refused(lambda: list(client.call("DecodeAsset", request)))
    assert error.code() == grpc.StatusCode.NOT_FOUND
    assert detail(error).field.startswith("files[0]")


def test_paths_of_the_daemon_are_off_by_default(client):
    error = refused(lambda: list(client.call("DecodeAsset", server_path="a.glb")))
    assert error.code() == grpc.StatusCode.PERMISSION_DENIED
    assert "--asset-root" in error.details()


def test_a_server_path_reads_beneath_the_asset_root_only(start, tmp_path):
    model, binary = gltf()
    (tmp_path / "root/models").mkdir(parents=True)
    (tmp_path / "root/models/m.gltf").write_bytes(model)
    (tmp_path / "root/models/tri.bin").write_bytes(binary)
    (tmp_path / "secret.glb").write_bytes(b"secret")
    client = Client(start("--asset-root", str(tmp_path / "root")))
    reply = list(client.call("DecodeAsset", server_path="models/m.gltf", timeout=60))[-1]
    assert reply.HasField("asset"), reply
    texts = set()
    for path in ("../secret.glb", "no.glb", str(tmp_path / "secret.glb"), "/proc/self/environ"):
        error = refused(lambda p=path: list(client.call("DecodeAsset", server_path=p)))
        assert error.code() == grpc.StatusCode.NOT_FOUND
        texts.add(error.details())
    assert len(texts) == 1
    client.close()
