"""Uploads of a client go when nothing refers to them; their hashes are then NOT_FOUND."""

import hashlib
import time

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire._proto import service_pb2 as service
from heliograph._wire._proto import types_pb2 as types

SIDE = 700


def texels(i):
    return np.random.default_rng(i).integers(0, 255, (SIDE, SIDE, 3)).astype("u1")


def daemon(**limits):
    flags = [flag for name, value in limits.items() for flag in ("--limit", f"{name}={value}")]
    return hg.connect(arguments=["--threads", "1", *flags])


def bytes_used(client):
    return client.info().used["tenant_bytes"]


def apply(client, scene, digest):
    """One edit that names a blob by its hash."""
    request = service.ApplyRequest(scene=scene.id, number=1)
    edit = request.transaction.edits.add()
    edit.target.name = "t"
    edit.texture.texels.CopyFrom(
        types.Array(dtype=types.D_TYPE_U8, shape=[SIDE, SIDE, 3], blob=digest)
    )
    return client.connection.call("Apply", request)


def test_a_texture_a_draw_takes_no_more_memory():
    with daemon(revisions=2, recent_bytes=8 << 20) as client, client.create_scene() as scene:
        used = []
        for i in range(60):
            with scene.edit() as edit:
                edit.texture("t", texels(i))
            used.append(bytes_used(client))
        assert max(used) < (8 << 20) + 8 * texels(0).nbytes


def test_what_nothing_names_goes_in_time_and_says_so():
    data = texels(0).tobytes()
    with daemon() as client:
        client.store.blob(data)
        assert bytes_used(client) >= len(data)
    with daemon(recent_seconds=1) as client, client.create_scene() as scene:
        digest = client.store.blob(data)
        end = time.monotonic() + 20
        while bytes_used(client) > 0:
            assert time.monotonic() < end
            time.sleep(0.1)
        with pytest.raises(hg.NotFound, match=f"sha256 {digest.hex()}.*upload it again") as refused:
            apply(client, scene, digest)
        assert refused.value.field == "edits[0].texture.texels.blob"


def test_what_a_scene_refers_to_stays():
    with daemon(recent_seconds=1, recent_bytes=1) as client, client.create_scene() as scene:
        with scene.edit() as edit:
            edit.texture("t", texels(0))
        time.sleep(3)
        digest = hashlib.sha256(texels(0).tobytes()).digest()
        with client.create_scene() as other:
            assert apply(client, other, digest).revision > 0


def test_bytes_of_an_asset_go_with_the_last_scene_that_has_it(tmp_path):
    vertices = np.random.default_rng(0).random((60000, 3))
    with open(tmp_path / "m.obj", "w") as file:
        for v in vertices:
            file.write(f"v {v[0]} {v[1]} {v[2]}\n")
        for i in range(1, 59998, 3):
            file.write(f"f {i} {i + 1} {i + 2}\n")
    with daemon(recent_seconds=1, recent_bytes=1) as client:
        with client.create_scene() as scene:
            with scene.edit() as edit:
                edit.import_file(tmp_path / "m.obj", name="m")
            time.sleep(4)
            assert bytes_used(client) > 500_000  # the session let go of it, the scene did not
        end = time.monotonic() + 20
        while bytes_used(client) > 0:
            assert time.monotonic() < end
            time.sleep(0.1)
