"""Rendering over the wire: own writes, overlays, stop rules, cancel, deadline, drain."""

import signal
import threading
import time

import grpc
import numpy as np
import pytest
from conftest import Client, detail
from heliograph.v1 import render_pb2, scene_pb2, types_pb2
from heliograph.v1 import service_pb2 as service
from test_edits import entity, named, pose, refused, triangle

SLACK = 0.25  # seconds: two busy cores, one Python process


def setup(client: Client, **scene_fields) -> int:
    """A scene with one large triangle at distance 2 from a 32x24 camera."""
    scene = client.create(**scene_fields)
    camera = scene_pb2.Camera(width=32, height=24, fx=20, fy=20, cx=15.5, cy=11.5)
    emission = scene_pb2.Material(
        emission=scene_pb2.ColorParameter(value=types_pb2.Vec3(x=1, y=2, z=3))
    )
    client.apply(
        scene,
        scene_pb2.Edit(target=named("glow"), material=emission),
        triangle("mesh", positions=(-9, -9, 0, 9, -9, 0, 0, 9, 0)),
        entity(
            "thing",
            mesh=named("mesh"),
            pose=pose(0, 0, -2),
            materials=scene_pb2.Materials(parts=[named("glow")]),
        ),
        entity("cam", camera=camera),
    )
    return scene


def request(scene: int, *planes: str, **fields) -> render_pb2.RenderRequest:
    wanted = [render_pb2.PlaneRequest(plane=render_pb2.Plane.Value("PLANE_" + p)) for p in planes]
    return render_pb2.RenderRequest(scene=scene, cameras=[named("cam")], planes=wanted, **fields)


DTYPES = {
    types_pb2.D_TYPE_F32: np.float32,
    types_pb2.D_TYPE_U32: np.uint32,
    types_pb2.D_TYPE_U8: np.uint8,
}


def collect(stream) -> list[tuple[render_pb2.FrameHeader, dict[str, np.ndarray]]]:
    frames, header, buffers = [], None, []
    for part in stream:
        if part.HasField("header"):
            header = part.header
            buffers = [bytearray() for _ in header.planes]
            frames.append((header, {}))
        elif part.HasField("chunk"):
            buffer, info = buffers[part.chunk.plane], header.planes[part.chunk.plane]
            assert part.chunk.offset == len(buffer)
            assert len(part.chunk.chunk) <= 1 << 20
            buffer += part.chunk.chunk
            if len(buffer) == info.size:
                shape = (header.height, header.width, info.channels)
                frames[-1][1][info.name] = np.frombuffer(buffer, DTYPES[info.dtype]).reshape(shape)
    for header, planes in frames:
        assert len(planes) == len(header.planes)
    return frames


def render(client: Client, message: render_pb2.RenderRequest, timeout: float = 30):
    return collect(client.stub.Render(message, metadata=client.metadata, timeout=timeout))


@pytest.fixture
def scene(client) -> int:
    return setup(client)


def test_text_columns_have_rows_and_neither_shape_nor_dtype(client, scene):
    wanted = request(scene, "INSTANCE")
    wanted.labels.boxes = True
    ((header, _),) = render(client, wanted)
    columns = {column.name: column for column in header.labels}
    assert columns["name"].strings == ["thing"]
    assert columns["attributes"].strings == ["{}"]
    assert columns["visible"].dtype == types_pb2.D_TYPE_U32
    for column in header.labels:
        is_text = column.name in ("name", "attributes")
        assert is_text == (not column.shape) == (column.dtype == types_pb2.D_TYPE_UNSPECIFIED)
        assert not (column.data if is_text else column.strings)


def test_a_frame_has_its_planes_and_says_what_it_shows(client, scene):
    ((header, planes),) = render(
        client, request(scene, "BEAUTY", "DEPTH", "INSTANCE", spp=4, seed=7)
    )
    assert (header.width, header.height, header.revision) == (32, 24, 1)
    assert header.final and header.seed == 7 and header.samples == 4 and header.camera == "cam"
    assert planes["depth"].shape == (24, 32, 1)
    assert planes["depth"][12, 16, 0] == pytest.approx(2, abs=1e-5)
    assert np.allclose(planes["beauty"][12, 16], (1, 2, 3, 1), atol=1e-4)
    assert planes["instance"][12, 16, 0] > 0


def test_a_frame_shows_the_edit_just_made(client, scene):
    for distance in (3, 4, 5):
        revision = client.apply(scene, entity("thing", pose=pose(0, 0, -distance))).revision
        ((header, planes),) = render(client, request(scene, "DEPTH", min_revision=revision))
        assert header.revision >= revision
        assert planes["depth"][12, 16, 0] == pytest.approx(distance, abs=1e-5)


def test_an_older_revision_renders_as_it_was(client, scene):
    client.apply(scene, entity("thing", pose=pose(0, 0, -5)))
    ((header, planes),) = render(client, request(scene, "DEPTH", revision=1))
    assert header.revision == 1
    assert planes["depth"][12, 16, 0] == pytest.approx(2, abs=1e-5)
    error = refused(lambda: render(client, request(scene, "DEPTH", revision=99)))
    assert error.code() == grpc.StatusCode.OUT_OF_RANGE
    error = refused(lambda: render(client, request(scene, "DEPTH", min_revision=99)))
    assert error.code() == grpc.StatusCode.OUT_OF_RANGE


def test_an_overlay_changes_the_frame_and_not_the_scene(client, scene):
    overlay = scene_pb2.Transaction(edits=[entity("thing", pose=pose(0, 0, -7))])
    ((header, planes),) = render(client, request(scene, "DEPTH", overlay=overlay))
    assert header.revision == 1 and header.overlay != 0
    assert planes["depth"][12, 16, 0] == pytest.approx(7, abs=1e-5)
    ((header, planes),) = render(client, request(scene, "DEPTH"))
    assert header.overlay == 0 and planes["depth"][12, 16, 0] == pytest.approx(2, abs=1e-5)
    assert client.revision(scene) == 1
    bad = scene_pb2.Transaction(edits=[entity("thing", mesh=named("nothing"))])
    error = refused(lambda: render(client, request(scene, "DEPTH", overlay=bad)))
    assert detail(error).field.startswith("overlay.edits[0]")


def test_two_cameras_give_two_frames(client, scene):
    message = request(scene, "DEPTH")
    message.cameras.append(named("cam"))
    frames = render(client, message)
    assert [header.frame for header, _ in frames] == [0, 1]
    assert np.array_equal(frames[0][1]["depth"], frames[1][1]["depth"])


def test_progressive_frames_double_their_samples_and_end_with_the_final_one(client, scene):
    frames = render(client, request(scene, "BEAUTY", spp=64, progressive=True))
    samples = [header.samples for header, _ in frames]
    assert samples == sorted(samples) and samples[-1] == 64
    assert [header.final for header, _ in frames] == [False] * (len(frames) - 1) + [True]


def test_a_large_frame_comes_in_chunks(client, scene):
    ((_, planes),) = render(client, request(scene, "POSITION", width=640, height=480))
    assert planes["position"].shape == (480, 640, 3)


def test_unknown_planes_are_unimplemented(client, scene):
    for plane in (999, 1000):
        message = request(scene)
        message.planes.add(plane=plane)
        error = refused(lambda m=message: render(client, m))
        assert error.code() == grpc.StatusCode.UNIMPLEMENTED, error.details()
        assert "planes[0]" in detail(error).field + error.details()


def test_frames_over_the_byte_limit_are_refused(start):
    client = Client(start(limits={"frame_bytes": 100_000}))
    scene = setup(client)
    error = refused(lambda: render(client, request(scene, "POSITION", width=640, height=480)))
    assert error.code() == grpc.StatusCode.RESOURCE_EXHAUSTED
    assert detail(error).needed == 640 * 480 * 12 and detail(error).allowed == 100_000
    client.close()


def long_render(client: Client, scene: int, **options):
    return client.stub.Render(
        request(scene, "BEAUTY", spp=1 << 20, width=640, height=480),
        metadata=client.metadata,
        **options,
    )


def test_cancel_frees_the_device_at_once(client, scene):
    render(client, request(scene, "DEPTH"))  # warm
    for _ in range(3):
        stream = long_render(client, scene)
        time.sleep(0.1)
        begin = time.monotonic()
        stream.cancel()
        render(client, request(scene, "DEPTH"))
        assert time.monotonic() - begin < 0.05 + SLACK


def test_a_deadline_ends_the_job_in_time(client, scene):
    render(client, request(scene, "DEPTH"))
    for seconds in (0.05, 0.2):
        begin = time.monotonic()
        error = refused(lambda s=seconds: list(long_render(client, scene, timeout=s)))
        assert error.code() == grpc.StatusCode.DEADLINE_EXCEEDED
        render(client, request(scene, "DEPTH"))
        assert time.monotonic() - begin < seconds + 0.05 + SLACK


def test_a_killed_session_frees_the_device(daemon, client, scene):
    other = Client(daemon)
    stream = long_render(other, setup(other))
    time.sleep(0.1)
    other.call("CloseSession")
    begin = time.monotonic()
    render(client, request(scene, "DEPTH"))
    assert time.monotonic() - begin < 0.05 + SLACK
    assert refused(lambda: list(stream)).code() == grpc.StatusCode.CANCELLED
    other.close()


def test_two_clients_render_their_own_scenes(daemon):
    clients = [Client(daemon) for _ in range(2)]
    failures = []

    def work(client: Client, distance: float):
        try:
            scene = setup(client)
            client.apply(scene, entity("thing", pose=pose(0, 0, -distance)))
            for _ in range(20):
                ((_, planes),) = render(client, request(scene, "DEPTH"))
                assert planes["depth"][12, 16, 0] == pytest.approx(distance, abs=1e-5)
        except Exception as error:  # shown by the main thread
            failures.append(error)

    threads = [
        threading.Thread(target=work, args=pair) for pair in zip(clients, (3.0, 6.0), strict=True)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failures
    for client in clients:
        client.close()


def test_a_slow_reader_stalls_nobody(daemon, client, scene):
    slow = Client(daemon)
    message = request(setup(slow), "POSITION", width=2000, height=1000)
    stream = slow.stub.Render(message, metadata=slow.metadata)
    next(stream)  # and nothing more is read
    begin = time.monotonic()
    for _ in range(5):
        render(client, request(scene, "DEPTH"))
    assert time.monotonic() - begin < 2
    stream.cancel()
    slow.close()


def test_a_drain_finishes_the_frame_in_flight_and_refuses_new_work(start):
    daemon = start("--drain", "20")
    client = Client(daemon)
    scene = setup(client)
    render(client, request(scene, "DEPTH"))
    frames = []
    stream = client.stub.Render(
        request(scene, "BEAUTY", seconds=1.0, width=64, height=64), metadata=client.metadata
    )
    reader = threading.Thread(target=lambda: frames.extend(collect(stream)))
    reader.start()
    time.sleep(0.3)
    daemon.process.send_signal(signal.SIGTERM)
    time.sleep(0.1)
    error = refused(lambda: client.call("ListScenes", service.ListScenesRequest()))
    assert error.code() == grpc.StatusCode.UNAVAILABLE
    reader.join(10)
    assert len(frames) == 1 and frames[0][0].final
    assert daemon.process.wait(5) == 0
    client.close()


def test_a_second_signal_ends_at_once(start):
    daemon = start("--drain", "60")
    client = Client(daemon)
    stream = long_render(client, setup(client))
    time.sleep(0.3)
    daemon.process.send_signal(signal.SIGTERM)
    time.sleep(0.2)
    assert daemon.process.poll() is None
    begin = time.monotonic()
    assert daemon.stop() == 0
    assert time.monotonic() - begin < 2
    assert refused(lambda: list(stream)).code() in (
        grpc.StatusCode.CANCELLED,
        grpc.StatusCode.UNAVAILABLE,
    )
    client.close()


def test_memory_stays_flat_over_cycles(start):
    daemon = start()
    client = Client(daemon)

    def cycle(count: int) -> int:
        for _ in range(count):
            scene = setup(client)
            render(client, request(scene, "BEAUTY", "DEPTH", spp=1))
            client.call("DeleteScene", scene=scene)
        status = open(f"/proc/{daemon.process.pid}/status").read()
        return int(
            next(line for line in status.splitlines() if line.startswith("VmRSS")).split()[1]
        )

    first = cycle(150)
    assert cycle(150) - first < 3000  # KiB
    client.close()
