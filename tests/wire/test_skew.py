"""Clients of the version before, of this one and of the next one, against this daemon."""

import contracts
import grpc
import numpy as np
import pytest
import skewed
from conftest import detail, detail_of

N = contracts.today()
CONTRACTS = {
    "N-1": contracts.Contract(contracts.golden("v1_latest")),
    "N": contracts.Contract(N),
    "N+1": contracts.Contract(contracts.next_version(N)),
}
UNIMPLEMENTED = grpc.StatusCode.UNIMPLEMENTED
# They need or end no session.
OWN = {"OpenSession", "CloseSession", "KeepSession", "GetServerInfo", "ListSessions"}


@pytest.fixture(scope="module")
def tours(daemon):
    """Findings of a client of each version."""
    found = {}
    for name, contract in CONTRACTS.items():
        client = skewed.Client(contract, daemon)
        found[name] = skewed.tour(client)
        client.close()
    return found


@pytest.mark.parametrize("version", CONTRACTS)
def test_every_call_does_what_it_did(tours, version):
    found = tours[version]
    assert found["revision"] == 1 and found["header"].final and found["header"].samples == 4
    first, middle = found["first"], (12, 16)
    assert first["depth"][middle] == pytest.approx(2, abs=1e-5)
    assert first["instance"][middle] == 7
    assert np.allclose(first["normal"][middle], (0, 0, 1))
    # the lower triangle glows and is black; the upper one: default base color 0.8 times 0.5
    assert np.allclose(first["beauty"][20, 16][:3], (1, 2, 3), atol=0.1)
    assert np.allclose(first["base_color"][2, 16], 0.4, atol=1e-3)
    assert found["moved"]["depth"][middle] == pytest.approx(3, abs=1e-5)
    assert np.isfinite(found["moved"]["flow_backward"]).all()
    assert found["pose"][2, 3] == -3 and found["label"] == 7
    assert found["ray"]["t"][0] == pytest.approx(3)
    assert found["streamed"] == [3] and found["branch"]["depth"][middle] == pytest.approx(5)
    assert found["materials"] and len(np.unique(found["model"]["instance"])) > 1
    assert found["scenes"] == ["", "loaded", "tour"] and found["opened"]
    assert {"behind/1", "cam", "quad", "wall"} <= set(found["objects"])


def test_all_versions_get_the_same_bytes(tours):
    for frame in ("first", "again", "moved", "branch", "loaded", "model"):
        for version in ("N-1", "N+1"):
            for plane, pixels in tours["N"][frame].items():
                assert np.array_equal(pixels, tours[version][frame][plane]), (version, frame, plane)
    for plane, pixels in tours["N"]["first"].items():  # its manifest means the same to all
        assert np.array_equal(pixels, tours["N"]["again"][plane]), plane
    for plane, pixels in tours["N"]["branch"].items():
        if plane != "flow_backward":
            assert np.array_equal(pixels, tours["N"]["loaded"][plane]), plane


def test_the_handshake_names_version_and_api(tours):
    for found in tours.values():
        info = found["info"]
        assert info.max_api == 1 and info.version and info.instance and info.limits
    for version in ("N", "N+1"):
        assert tours[version]["info"].min_api == tours[version]["info"].max_api == 1


# ---------------------------------------------------------------- requests of the next version


@pytest.fixture(scope="module")
def newer(daemon):
    client = skewed.Client(CONTRACTS["N+1"], daemon)
    client.scene = client.call("CreateScene", request_id="newer").scene
    client.apply(client.scene, skewed.edits())
    yield client
    client.close()


def refusal(call):
    """(code, path, message)"""
    with pytest.raises(grpc.RpcError) as error:
        call()
    return error.value.code(), detail(error.value).field, error.value.details()


def assert_unknown(client, method, request, path, number):
    code, where, text = refusal(lambda: client.send(method, request))
    assert code == UNIMPLEMENTED, (code, text)
    assert where == path, (where, text)
    assert str(number) in text and "update the daemon" in text, text


def number_of(client, fields):
    client.last[client.scene] = fields["number"] = client.last[client.scene] + 1


@pytest.mark.parametrize("method", sorted(CONTRACTS["N"].methods))
def test_an_unknown_field_of_every_request_is_refused(newer, method):
    kind = CONTRACTS["N+1"].methods[method].input_type
    fields = {"future": 1}
    if "scene" in kind.fields_by_name:
        fields["scene"] = newer.scene
    if method.startswith("Apply"):
        number_of(newer, fields)
    request = newer.make(method, **fields)
    if method == "ApplyStream":  # a refusal of one transaction is a reply
        (reply,) = newer.send(method, request)
        assert reply.status.code == UNIMPLEMENTED.value[0]
        assert not detail_of(reply.status).field
        assert str(contracts.FUTURE_FIELD) in reply.status.message
    else:
        assert_unknown(newer, method, request, "", contracts.FUTURE_FIELD)


REQUESTS = {
    "Apply": [
        ({"transaction": {"edits": [{"future_case": {}}]}}, "edits[0]", 1998),
        ({"transaction": {"future": 1}}, "", 1999),
        (
            {"transaction": {"edits": [{"advance": {"dt": 1, "future": 1}}]}},
            "edits[0].advance",
            1999,
        ),
        (
            {"transaction": {"edits": [{"target": {"name": "x"}, "mode": 999, "entity": {}}]}},
            "edits[0].mode",
            999,
        ),
        (
            {"transaction": {"edits": [{"entity": {"light": {"shape": 999}}}]}},
            "edits[0].entity.light.shape",
            999,
        ),
        (
            {"transaction": {"edits": [{"entity": {"parent": {"future_case": {}}}}]}},
            "edits[0].entity.parent",
            1998,
        ),
    ],
    "Render": [
        ({"planes": [{"plane": "PLANE_DEPTH"}, {"plane": 999}]}, "planes[1].plane", 999),
        ({"planes": [{"plane": "PLANE_DEPTH", "future": 1}]}, "planes[0]", 1999),
        ({"filter": 999}, "filter", 999),
        ({"future_case": {}}, "", 1998),
        ({"overlay": {"edits": [{"future_case": {}}]}}, "overlay.edits[0]", 1998),
        ({"labels": {"future": 1}}, "labels", 1999),
    ],
    "Query": [
        ({"future_case": {}}, "", 1998),
        ({"pick": {"camera": {"name": "cam"}, "pixels": {"dtype": 999}}}, "pick.pixels.dtype", 999),
    ],
    "Read": [({"refs": [{"future_case": {}}], "fields": ["pose"]}, "refs[0]", 1998)],
    "Stream": [
        ({"settings": {"filter": 999}}, "settings.filter", 999),
        ({"settings": {}, "policy": 999}, "policy", 999),
    ],
    "BranchScene": [({"lifetime": 999}, "lifetime", 999)],
    "DecodeAsset": [({"files": [{"path": "a.glb", "future": 1}]}, "files[0]", 1999)],
}
ROWS = [(method, *row) for method, rows in REQUESTS.items() for row in rows]


@pytest.mark.parametrize(
    "method,fields,path,number", ROWS, ids=[f"{row[0]} {row[2]} {row[3]}" for row in ROWS]
)
def test_what_is_unknown_is_refused_by_its_path(newer, method, fields, path, number):
    fields = dict(fields)
    if method == "Apply":
        number_of(newer, fields)
    if method == "Stream":
        fields["settings"] = {**fields["settings"], "scene": newer.scene}
    elif method != "DecodeAsset":
        fields["scene"] = newer.scene
    assert_unknown(newer, method, newer.make(method, **fields), path, number)


def test_an_item_of_a_batch_answers_for_itself(newer):
    planes, cameras = [{"plane": "PLANE_DEPTH"}], [skewed.named("cam")]
    good = {"scene": newer.scene, "cameras": cameras, "planes": planes}
    jobs = [{"tag": 1, "credits": 2, "job": {**good, "filter": 999}}, {"tag": 2, "job": good}]
    replies = newer.send("RenderBatch", [newer.make("RenderBatch", **job) for job in jobs])
    bad, fine = (next(r for r in replies if r.done and r.tag == tag) for tag in (1, 2))
    assert bad.status.code == UNIMPLEMENTED.value[0] and detail_of(bad.status).field == "job.filter"
    assert fine.status.code == 0


def test_an_unknown_call_is_unimplemented(newer):
    with pytest.raises(grpc.RpcError) as error:
        newer.call("Future")
    assert error.value.code() == UNIMPLEMENTED


def test_the_scene_is_as_it_was_after_all_refusals(newer):
    assert newer.call("DescribeScene", scene=newer.scene).scene.revision == 1
    _, planes = newer.render(newer.scene)
    assert planes["depth"][12, 16] == pytest.approx(2, abs=1e-5)
