"""Means of an operator: health, --probe, metrics, reflection, the group."""

import contextlib
import grp
import json
import os
import re
import signal
import socket
import stat
import subprocess
import time
import urllib.error
import urllib.request

import grpc
import pytest
from conftest import DAEMON, ROOT, STUBS, Client, Replies, detail, eventually
from contracts import Contract
from google.protobuf import descriptor_pb2
from heliograph.v1 import scene_pb2, service_pb2
from test_edits import entity
from test_render import request

RENDERER = "heliograph.v1.Renderer"
SERVING, NOT_SERVING = 1, 2


def health(channel: grpc.Channel, name: str) -> int:
    """grpc.health.v1.Health/Check by hand: its request and reply have one field each."""
    check = channel.unary_unary("/grpc.health.v1.Health/Check")
    request = b"\x0a" + bytes([len(name)]) + name.encode() if name else b""
    reply = check(request, timeout=5, wait_for_ready=True)
    return reply[1] if reply else 0


def probe(daemon, what: str) -> int:
    return subprocess.run(
        [DAEMON, "--probe", what, "--socket", daemon.socket], timeout=20, capture_output=True
    ).returncode


def camera_scene(client) -> int:
    scene = client.create()
    lens = scene_pb2.Camera(width=64, height=64, fx=64, fy=64, cx=31.5, cy=31.5)
    client.apply(scene, entity("cam", camera=lens))
    return scene


def test_probe_tells_live_and_ready(start):
    daemon = start()
    eventually(lambda: probe(daemon, "ready") == 0)
    assert probe(daemon, "live") == 0
    daemon.stop()
    assert probe(daemon, "live") == 1


# ---------------------------------------------------------------- metrics


def scrape(daemon, path: str = "/metrics") -> dict[str, float]:
    """Name with labels -> value."""
    with urllib.request.urlopen(f"http://{daemon.ready['metrics']}{path}", timeout=5) as page:
        assert page.headers["Content-Type"].startswith("text/plain; version=0.0.4")
        text = page.read().decode()
    values = {}
    for line in text.splitlines():
        if line.startswith("#"):
            assert line.split()[1] in ("HELP", "TYPE")
            continue
        name, value = line.rsplit(" ", 1)
        values[name] = float(value)
    return values


def test_scenes_that_take_turns_and_have_no_room_are_told_of_once(start):
    daemon = start("--metrics", "127.0.0.1:0", "--limit", "derived_bytes=1")
    client = Client(daemon)
    scenes = [camera_scene(client) for _ in range(2)]
    for scene in 8 * scenes:
        assert list(client.call("Render", request(scene, "BEAUTY", spp=1)))
    assert scrape(daemon)["heliograph_scenes_made_again_total"] > 0
    time.sleep(1)  # the health is looked at four times a second
    for scene in 8 * scenes:
        assert list(client.call("Render", request(scene, "BEAUTY", spp=1)))
    time.sleep(1)
    client.close()
    daemon.stop()
    assert daemon.process.stderr.read().count("take turns in the memory of derived data") == 1


def test_metrics_count_what_happens(start):
    daemon = start("--metrics", "127.0.0.1:0")
    client = Client(daemon)
    eventually(lambda: scrape(daemon)["heliograph_ready"] == 1)
    before = scrape(daemon)
    scene = camera_scene(client)
    assert list(client.call("Render", request(scene, "BEAUTY", spp=4)))
    for _ in range(3):
        with pytest.raises(grpc.RpcError):
            client.call("DescribeScene", scene=999)
    not_found = 'heliograph_calls_total{code="NOT_FOUND",method="DescribeScene"}'
    eventually(lambda: scrape(daemon).get(not_found) == 3)  # counted when gRPC has let go of them
    after = eventually(
        lambda: (
            lambda page: (
                page if page.get('heliograph_calls_total{code="OK",method="Render"}') else None
            )
        )(scrape(daemon))
    )
    assert after["heliograph_sessions"] == 1
    assert after["heliograph_scenes"] == before["heliograph_scenes"] + 1
    assert after['heliograph_samples_total{tenant="local"}'] == 64 * 64 * 4
    assert after['heliograph_rays_total{tenant="local"}'] > 0
    assert after['heliograph_job_queue_seconds_count{tenant="local"}'] == 1
    assert after['heliograph_job_device_seconds_sum{tenant="local"}'] > 0
    assert after['heliograph_jobs_total{code="OK",tenant="local"}'] == 1
    assert after['heliograph_sent_bytes_total{method="Render"}'] > 64 * 64 * 12
    assert after['heliograph_tenant_used{limit="tenant_entities",tenant="local"}'] == 1
    assert after["heliograph_uploaded_bytes_total"] == 0  # of a CPU
    assert after["heliograph_device_memory_bytes"] == 0
    assert client.call("GetServerInfo").uploaded_bytes == 0
    assert after["heliograph_connections"] >= 1
    assert 1e7 < after["process_resident_memory_bytes"] < 1e10
    client.close()


def test_methods_that_are_not_known_are_one_series(start):
    daemon = start("--metrics", "127.0.0.1:0")
    client = Client(daemon)
    for i in range(20):
        with pytest.raises(grpc.RpcError) as error:
            client.channel.unary_unary(f"/heliograph.v1.Renderer/Future{i}")(b"", timeout=10)
        assert error.value.code() == grpc.StatusCode.UNIMPLEMENTED
    unknown = 'heliograph_calls_total{code="UNIMPLEMENTED",method="unknown"}'
    eventually(lambda: scrape(daemon).get(unknown) == 20)
    assert not [name for name in scrape(daemon) if "Future" in name]
    client.close()


def test_every_metric_is_in_the_manual(start):
    daemon = start("--metrics", "127.0.0.1:0")
    client = Client(daemon)
    eventually(lambda: scrape(daemon)["heliograph_ready"] == 1)
    with open(ROOT / "docs/operations.md") as file:
        manual = file.read()
    for name in scrape(daemon):
        bare = re.sub(r"(_bucket|_sum|_count)?(\{.*)?$", "", name)
        assert f"`{bare}`" in manual, bare
    client.close()


def raw(daemon, data: bytes) -> bytes:
    host, port = daemon.ready["metrics"].rsplit(":", 1)
    with socket.create_connection((host, int(port)), timeout=8) as connection:
        connection.sendall(data)
        reply = b""
        with contextlib.suppress(ConnectionError):
            while part := connection.recv(4096):
                reply += part
        return reply


def test_the_metrics_port_answers_get_metrics_only(start):
    daemon = start("--metrics", "127.0.0.1:0")
    with pytest.raises(urllib.error.HTTPError) as error:
        scrape(daemon, "/")
    assert error.value.code == 404
    assert raw(daemon, b"POST /metrics HTTP/1.1\r\n\r\n").startswith(b"HTTP/1.1 405")
    assert raw(daemon, b"\x00" * 9000) == b""
    assert raw(daemon, b"GET /metrics HTTP/1.1\r\nHost: x\r\n") == b""  # never ended: closed
    assert scrape(daemon)["heliograph_sessions"] == 0


def test_idle_connections_do_not_block_a_scrape(start):
    daemon = start("--metrics", "127.0.0.1:0")
    host, port = daemon.ready["metrics"].rsplit(":", 1)
    with contextlib.ExitStack() as stack:
        for _ in range(100):
            stack.enter_context(socket.create_connection((host, int(port)), timeout=5))
        began = time.monotonic()
        for _ in range(10):
            assert scrape(daemon)["heliograph_ready"] in (0, 1)
        assert time.monotonic() - began < 3


def test_metrics_are_off_by_default_and_want_an_address(start):
    assert start().ready["metrics"] == ""
    for address in ("nonsense", "localhost:1", ":9464"):
        result = subprocess.run(
            [DAEMON, "--metrics", address, "--socket", "/tmp/hg-none/s"],
            capture_output=True,
            text=True,
            timeout=20,
        )
        assert result.returncode == 64 and "--metrics" in result.stderr


# ---------------------------------------------------------------- reflection


def reflection_call(channel, *requests, metadata=()):
    subprocess.check_call(
        ["protoc", f"-I{ROOT}", f"--python_out={STUBS}", "server/app/reflection.proto"], cwd=ROOT
    )
    from server.app import reflection_pb2

    method = channel.stream_stream(
        "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo",
        request_serializer=reflection_pb2.ServerReflectionRequest.SerializeToString,
        response_deserializer=reflection_pb2.ServerReflectionResponse.FromString,
    )
    messages = [reflection_pb2.ServerReflectionRequest(**request) for request in requests]
    return list(method(iter(messages), timeout=10, metadata=metadata))


def test_reflection_is_off_by_default(start):
    with grpc.insecure_channel(start().target) as channel, pytest.raises(grpc.RpcError) as error:
        reflection_call(channel, {"list_services": ""})
    assert error.value.code() == grpc.StatusCode.UNIMPLEMENTED


def test_reflection_gives_the_contract(start):
    daemon = start("--reflection")
    with grpc.insecure_channel(daemon.target) as channel:
        services, files, by_name, none = reflection_call(
            channel,
            {"list_services": ""},
            {"file_containing_symbol": RENDERER},
            {"file_by_filename": "heliograph/v1/types.proto"},
            {"file_containing_symbol": "heliograph.decode.Hello"},
        )
    assert [s.name for s in services.list_services_response.service] == [RENDERER]
    descriptors = [
        descriptor_pb2.FileDescriptorProto.FromString(data)
        for data in files.file_descriptor_response.file_descriptor_proto
    ]
    known = service_pb2.DESCRIPTOR.services_by_name["Renderer"].methods_by_name
    contract = Contract(descriptor_pb2.FileDescriptorSet(file=descriptors))
    assert set(contract.methods) == set(known)
    assert len(by_name.file_descriptor_response.file_descriptor_proto) == 1
    assert none.error_response.error_code == grpc.StatusCode.NOT_FOUND.value[0]


def test_reflection_asks_for_the_token_too(start):
    daemon = start("--reflection", "--listen", "127.0.0.1:0")
    with grpc.insecure_channel(daemon.ready["listen"][0]) as channel:
        with pytest.raises(grpc.RpcError) as error:
            reflection_call(channel, {"list_services": ""})
        assert error.value.code() == grpc.StatusCode.UNAUTHENTICATED
        with open(os.path.join(os.path.dirname(daemon.socket), "token")) as file:
            bearer = [("authorization", "Bearer " + file.read())]
        assert reflection_call(channel, {"list_services": ""}, metadata=bearer)


# ---------------------------------------------------------------- the group


def as_user(uid: int, gid: int, groups: list[int], path: str) -> bool:
    """True if a process of that user gets a ticket on the local channel."""
    child = os.fork()
    if child == 0:
        status = 1
        with contextlib.suppress(OSError):
            os.setgroups(groups)
            os.setresgid(gid, gid, gid)
            os.setresuid(uid, uid, uid)
            with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as connection:
                connection.settimeout(5)
                connection.connect(path)
                status = 0 if len(connection.recv(64)) == 16 else 1
        os._exit(status)
    return os.waitpid(child, 0)[1] == 0


@pytest.mark.skipif(os.geteuid() != 0, reason="takes other users' identities")
def test_members_of_the_socket_group_may_connect(tmp_path):
    group = grp.getgrnam("games").gr_gid
    for parent in (tmp_path, *tmp_path.parents):
        if parent.owner() == "root" and str(parent).startswith("/tmp/"):
            os.chmod(parent, 0o711)
    folder = tmp_path / "shared"
    read, write = os.pipe()
    process = subprocess.Popen(
        [DAEMON, "--socket", folder / "s", "--socket-group", "games", "--ready-fd", str(write)],
        pass_fds=(write,),
    )
    os.close(write)
    with os.fdopen(read) as ready:
        json.loads(ready.readline())
    for path in (folder / "s", folder / "s.fd.sock"):
        info = os.stat(path)
        assert (stat.S_IMODE(info.st_mode), info.st_gid) == (0o660, group)
    assert stat.S_IMODE(os.stat(folder).st_mode) == 0o750
    line = str(folder / "s.fd.sock")
    assert as_user(0, 0, [], line)
    assert as_user(4242, group, [], line)
    assert as_user(4242, 4242, [7, group], line)
    assert not as_user(4242, 4242, [], line)
    os.chmod(folder, 0o755)
    os.chmod(line, 0o666)  # the mode is the first fence, the peer's groups the second
    assert not as_user(4242, 4242, [], line)
    process.terminate()
    assert process.wait(10) == 0


def test_an_unknown_group_is_refused(tmp_path):
    result = subprocess.run(
        [DAEMON, "--socket", tmp_path / "s", "--socket-group", "no-such"],
        capture_output=True,
        text=True,
        timeout=20,
    )
    assert result.returncode == 64 and "no-such" in result.stderr


# ---------------------------------------------------------------- drain


def endless(client):
    scene = camera_scene(client)
    job = request(scene, "BEAUTY", progressive=True, seconds=600)
    stream = client.call("Render", job, timeout=None)
    next(stream)
    eventually(lambda: health(client.channel, RENDERER) == SERVING)  # a drain is seen by its end
    return stream


def test_what_drain_cuts_off_is_unavailable_and_says_when_to_retry(start):
    daemon = start("--drain", "0.5", "--grace", "30")
    client = Client(daemon)
    read = Replies(endless(client))  # who reads late may find that the connection has gone
    begin = time.monotonic()
    daemon.process.send_signal(signal.SIGTERM)
    eventually(lambda: health(client.channel, RENDERER) == NOT_SERVING, 1)
    assert time.monotonic() - begin < 0.4
    assert health(client.channel, "") == SERVING
    with pytest.raises(grpc.RpcError) as error:
        client.create()
    assert error.value.code() == grpc.StatusCode.UNAVAILABLE
    assert detail(error.value).retry_seconds > 0
    eventually(lambda: read.is_over)
    assert read.error.code() == grpc.StatusCode.UNAVAILABLE
    assert detail(read.error).retry_seconds > 0
    assert daemon.process.wait(5) == 0
    client.close()


def test_a_second_signal_ends_at_once(start):
    daemon = start("--drain", "60")
    client = Client(daemon)
    stream = endless(client)
    daemon.process.send_signal(signal.SIGTERM)
    eventually(lambda: health(client.channel, RENDERER) == NOT_SERVING, 2)
    assert daemon.process.poll() is None
    begin = time.monotonic()
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.process.wait(5) == 0
    assert time.monotonic() - begin < 2
    with pytest.raises(grpc.RpcError):
        list(stream)
    client.close()
