"""The line of each call in the log: whose it is, how it ended, its trace, and what took long."""

import json
import re

import grpc
import pytest
from conftest import Client
from heliograph.v1 import service_pb2
from test_edits import entity
from test_operation import camera_scene
from test_render import request


@pytest.fixture
def logged(start):
    daemon = start("--log-level", "debug", "--log-json")
    client = Client(daemon)

    def lines():
        client.close()
        daemon.stop()
        return [json.loads(line) for line in daemon.process.stderr.read().splitlines()]

    return client, lines


def trailing_id(call) -> str:
    return dict(call.trailing_metadata())["heliograph-request-id"]


def test_each_call_has_a_line_with_its_request_id(logged):
    client, lines = logged
    info = client.stub.GetServerInfo.with_call
    asked = service_pb2.GetServerInfoRequest()
    _, own = info(asked, metadata=[("heliograph-request-id", "epoch-3.17:a_b")])
    _, made = info(asked)
    _, bad = info(asked, metadata=[("heliograph-request-id", 'no "quotes"')])
    _, long = info(asked, metadata=[("heliograph-request-id", "x" * 65)])
    ids = [trailing_id(call) for call in (own, made, bad, long)]
    assert ids[0] == "epoch-3.17:a_b"
    assert len(set(ids)) == 4 and all(re.fullmatch(r"[0-9a-f]+-[0-9a-f]+", i) for i in ids[1:])
    with pytest.raises(grpc.RpcError) as error:
        client.call("DescribeScene", scene=12345)
    refused = trailing_id(error.value)
    by_id = {line["request"]: line for line in lines() if line["event"] == "call"}
    for number in ids:
        line = by_id[number]
        assert line["method"] == "/heliograph.v1.Renderer/GetServerInfo" and line["code"] == "OK"
        assert line["level"] == "debug" and float(line["ms"]) < 5000
        assert int(line["sent_bytes"]) > 0 and line["tenant"] == "local" and line["peer"] == "unix:"
    assert by_id[refused]["code"] == "NOT_FOUND" and by_id[refused]["level"] == "info"


TRACE, SPAN = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"
PARENT = f"00-{TRACE}-{SPAN}-01"


def traced(client, *headers):
    """The manifest of a picture that is asked for with more headers."""
    scene = camera_scene(client)
    metadata = [*client.metadata, *headers]
    parts = client.stub.Render(request(scene, "BEAUTY", spp=1), metadata=metadata, timeout=10)
    return json.loads(next(p.header.manifest for p in parts if p.HasField("header")))


def test_a_line_names_tenant_client_scene_and_reason(logged):
    client, lines = logged
    scene = client.create(name="room", lifetime="LIFETIME_DAEMON")
    with pytest.raises(grpc.RpcError):
        client.apply(scene, entity("a"), number=9)
    anonymous = camera_scene(client)
    list(client.call("Render", request(anonymous, "BEAUTY", spp=1)))
    calls = [line for line in lines() if line["event"] == "call"]
    of = {line["method"].rpartition("/")[2]: line for line in calls}
    assert of["OpenSession"]["tenant"] == "local" and "client" not in of["OpenSession"]
    assert {line["client"] for line in calls if "client" in line} == {"test"}
    refused = next(line for line in calls if line["code"] == "ABORTED")
    assert (refused["scene"], refused["scene_name"]) == (str(scene), "room")
    assert "number" in refused["reason"] and int(refused["received_bytes"]) > 10
    assert of["Render"]["scene"] == str(anonymous) and "scene_name" not in of["Render"]


def test_a_line_of_a_method_that_is_not_known_says_its_name(logged):
    client, lines = logged
    with pytest.raises(grpc.RpcError):
        client.channel.unary_unary("/heliograph.v1.Renderer/Future")(b"", timeout=10)
    line = next(line for line in lines() if line.get("code") == "UNIMPLEMENTED")
    assert line["method"] == "/unknown"
    assert line["reason"] == "there is no method /heliograph.v1.Renderer/Future"


def test_a_trace_is_in_the_line_and_in_the_manifest(logged):
    client, lines = logged
    states = ("tracestate", "a=1"), ("tracestate", "b=2")
    assert traced(client, ("traceparent", PARENT), *states)["trace"] == {
        "traceparent": PARENT,
        "tracestate": "a=1,b=2",
    }
    for wrong in (PARENT.upper(), PARENT[:-1], PARENT.replace(SPAN, 16 * "0"), "ff" + PARENT[2:]):
        assert "trace" not in traced(client, ("traceparent", wrong))
    assert "trace" not in traced(client)
    renders = [line for line in lines() if line.get("method", "").endswith("/Render")]
    traces = [(line.get("trace_id"), line.get("span_id")) for line in renders]
    assert sorted(traces, key=str) == [(TRACE, SPAN), *[(None, None)] * 5]


def test_a_slow_call_says_where_its_time_went(start):
    limits = {"slow_call_seconds": 1, "slow_render_seconds": 1}
    daemon = start("--log-json", limits=limits)
    client = Client(daemon)
    scene = camera_scene(client)
    list(client.call("Render", request(scene, "BEAUTY", spp=1)))
    list(client.call("Render", request(scene, "BEAUTY", seconds=1.3, spp=1 << 20)))
    item = service_pb2.RenderBatchRequest(
        tag=1, job=request(scene, "BEAUTY", seconds=1.3, spp=1 << 20)
    )
    list(client.stub.RenderBatch(iter([item]), metadata=client.metadata, timeout=30))
    client.close()
    daemon.stop()
    lines = [json.loads(line) for line in daemon.process.stderr.read().splitlines()]
    call, job = [line for line in lines if line["event"].startswith("slow")]
    assert (call["event"], call["level"]) == ("slow call", "warning")
    assert call["method"].endswith("/Render") and call["scene"] == str(scene)
    assert float(call["ms"]) > 1300 and float(call["device_ms"]) > 1000
    assert {"before_ms", "queued_ms", "derived_ms", "others_ms", "sending_ms"} <= set(call)
    assert (job["event"], job["client"]) == ("slow job", "test")
    assert job["method"].endswith("/RenderBatch") and float(job["device_ms"]) > 1000


def test_a_session_is_a_secret_of_the_log(logged):
    client, lines = logged
    session = str(client.opened.session)
    assert not any(session in json.dumps(line) for line in lines())
