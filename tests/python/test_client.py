"""Sessions, forks, pickles, reads, queries, files, the command line."""

import multiprocessing
import os
import pickle
import socket
import subprocess
import sys
import time

import heliograph as hg
import numpy as np
import pytest
from heliograph import cli, framing
from heliograph._wire import launch
from heliograph._wire._proto import service_pb2
from heliograph._wire.shared import share_frames


def test_a_session_lives_on_the_second_socket(daemon):
    client = hg.connect(daemon.address)
    assert daemon.local_channels() == 1 and "heliograph 0.1" in daemon.sessions[0]
    client.close()
    assert daemon.local_channels() == 0
    with pytest.raises(hg.Unavailable, match="closed"):
        client.create_scene()


@pytest.mark.parametrize("address", ["unix:relative", "nowhere", "host:port", ""])
def test_bad_addresses(address):
    with pytest.raises(hg.InvalidArgument, match="address"):
        hg.connect(address)


def test_flags_of_a_private_daemon_are_no_text():
    with pytest.raises(hg.InvalidArgument, match="a sequence") as error:
        hg.connect(arguments="--threads 4")
    assert error.value.field == "arguments"


def test_nobody_listens(tmp_path):
    with pytest.raises(hg.Unavailable, match="no daemon listens"):
        hg.connect(f"unix://{tmp_path}/none.sock")


@pytest.mark.parametrize("address", [None, "unix:///run/heliograph.sock"])
def test_tls_is_for_tcp(address):
    with pytest.raises(hg.InvalidArgument, match="host:port") as error:
        hg.connect(address, tls=hg.TLS())
    assert error.value.field == "tls"


def test_a_certificate_needs_its_key():
    with pytest.raises(hg.InvalidArgument, match="go together"):
        hg.TLS(cert="client.pem")


def test_typed_errors(client):
    with pytest.raises(hg.NotFound, match="no scene 'x'"):
        client.open_scene("x")


def test_scenes_made_here_are_deleted_at_the_end(daemon, client):
    with client.create_scene("a"):
        pass
    assert isinstance(daemon.requests[-1], service_pb2.DeleteSceneRequest)
    count = len(daemon.requests)
    with client.create_scene("b", lifetime="daemon"):
        pass
    assert len(daemon.requests) == count + 1


def test_a_failing_deletion_does_not_hide_the_error(client, monkeypatch):
    def refuse(*_):
        raise hg.Unavailable("gone")

    with pytest.raises(RuntimeError, match="mine"), client.create_scene("a"):
        monkeypatch.setattr(client.connection, "call", refuse)
        raise RuntimeError("mine")


def test_lookup_by_name(daemon, scene):
    with scene.edit() as edit:
        edit.entity("bolt/1")
        edit.material("steel")
    assert isinstance(scene["steel"], hg.Material) and scene["bolt/1"].name == "bolt/1"
    assert "steel" in scene and "stel" not in scene
    with pytest.raises(hg.NotFound, match="nearest are steel"):
        scene["stel"]
    assert "entity bolt/1" in scene.tree()


def test_reading_arrays_in_parts(scene):
    read = scene.transforms(["a", "b"])
    assert read.shape == (2, 4, 4) and read[1, 3, 3] == 16
    with scene.edit() as edit:
        a = edit.entity("a")
    assert not a.transform.flags.writeable


def test_rays_go_in_pieces_of_one_revision(daemon, scene):
    origins = np.random.default_rng(0).random((200_000, 3))
    hits = scene.cast_rays(origins, (0, 0, 1))
    assert np.array_equal(hits.t, origins[:, 2].astype("f4"))
    asked = [r for r in daemon.requests if isinstance(r, service_pb2.QueryRequest)]
    assert len(asked) == 4 and not asked[0].HasField("revision")
    assert {r.revision for r in asked[1:]} == {5}


def test_scene_files(daemon, client, scene, tmp_path):
    header = service_pb2.SceneChunk.Header(format="heliograph.v1", sizes=[3])
    blob = service_pb2.SceneChunk(chunk=b"abc")
    data = header.SerializeToString()
    pieces = [service_pb2.SceneChunk(header_chunk=data[:5])]
    pieces += [service_pb2.SceneChunk(header_chunk=data[5:])]
    for parts in ([service_pb2.SceneChunk(header=header)], pieces):
        daemon.exported = [*parts, blob]
        scene.save(tmp_path / "x.helio")
        assert client.load_scene(tmp_path / "x.helio", name="loaded").name == "loaded"
        assert daemon.imported[0].header.name == "loaded" and daemon.imported[0].header.request_id
        assert daemon.imported[0].header.format == "heliograph.v1"
        assert daemon.imported[1:] == [blob]
    whole = (tmp_path / "x.helio").read_bytes()
    (tmp_path / "x.helio").write_bytes(whole[:-1])
    with pytest.raises(hg.InvalidArgument, match="cut off"):
        client.load_scene(tmp_path / "x.helio")
    (tmp_path / "x.helio").write_bytes(b"not a scene")
    with pytest.raises(hg.InvalidArgument, match="not a scene file"):
        client.load_scene(tmp_path / "x.helio")
    with pytest.raises(hg.NotFound, match=r"no file .*y\.helio"):
        client.load_scene(tmp_path / "y.helio")


def _edit_in_child(scene, name):
    with scene.edit() as edit:
        handle = edit.entity(name)
    return os.getpid(), handle.id


def test_a_forked_child_opens_its_own_session(daemon, scene):
    with scene.edit() as edit:
        edit.entity("before")
    context = multiprocessing.get_context("fork")
    for k in range(3):
        with context.Pool(2) as pool:
            done = pool.starmap(_edit_in_child, [(scene, f"{k}/{i}") for i in range(4)])
        assert os.getpid() not in {pid for pid, _ in done}
    with scene.edit() as edit:
        edit.entity("after")
    assert daemon.last[1] == 2 and len(daemon.sessions) >= 4
    assert len(daemon.transactions) == 14
    assert daemon.local_channels() == 1


def test_fork_inherits_clients_and_exits_normally(daemon, scene):
    pid = os.fork()
    if pid == 0:
        status = 1
        try:
            with scene.edit() as edit:
                edit.entity("child")
            status = 0
        finally:
            os._exit(status)
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            break
        time.sleep(0.01)
    else:
        os.kill(pid, 9)
        pytest.fail("the child hung")
    assert status == 0 and "child" in daemon.objects


def test_pickles_reconnect(daemon, scene):
    data = pickle.dumps(scene)
    code = (
        "import pickle, sys\n"
        "scene = pickle.loads(bytes.fromhex(sys.argv[1]))\n"
        "with scene.edit() as edit: edit.entity('elsewhere')\n"
    )
    subprocess.run([sys.executable, "-c", code, data.hex()], check=True, timeout=30)
    assert "elsewhere" in daemon.objects


def test_import_is_light():
    code = (
        "import sys, heliograph; "
        "print([m for m in ('numpy', 'grpc', 'google.protobuf') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_framing_sees_the_whole_box():
    bounds = [[-1, -2, 0], [1, 2, 3]]
    for size in ((640, 360), (300, 500)):
        lens = hg.Camera.from_fov(40, *size, degrees=True)
        pose = framing.frame_box(bounds, lens, azimuth=50, elevation=25)
        corners = np.c_[framing.corners_of(bounds), np.ones(8)]
        local = corners @ np.linalg.inv(pose).T
        assert (local[:, 2] < 0).all()
        u = lens.fx * local[:, 0] / -local[:, 2] + lens.cx + 0.5
        v = lens.fy * -local[:, 1] / -local[:, 2] + lens.cy + 0.5
        assert u.min() > 0 and u.max() < size[0] and v.min() > 0 and v.max() < size[1]
        assert max(np.ptp(u) / size[0], np.ptp(v) / size[1]) > 0.7


def test_cameras():
    k = np.array([[500, 0, 300.5], [0, 510, 250.25], [0, 0, 1]])
    assert np.array_equal(hg.Camera.from_intrinsics(k, 640, 480).K, k)
    assert hg.Camera.from_fov(90, 640, 480, degrees=True).fx == pytest.approx(320)
    assert hg.Camera.from_fov(90, 640, 480, axis="y", degrees=True).fy == pytest.approx(240)
    assert hg.Camera.from_focal_length(36, 640, 480).fx == pytest.approx(640)
    lens = hg.Camera.from_focal_length(50, 640, 480, f_number=2, focus_distance=3)
    assert lens.aperture == pytest.approx(0.025) and lens.focus_distance == 3
    assert hg.Camera.fisheye(180, 314, 200, degrees=True).fx == pytest.approx(314 / np.pi)
    panorama = hg.Camera.equirectangular(400, 200)
    assert panorama.fx == panorama.fy == pytest.approx(200 / np.pi)
    assert (panorama.cx, panorama.cy) == (199.5, 99.5)
    full = hg.Camera.from_intrinsics(
        *(k, 640, 480),
        **{"distortion": (0.1, 0.2, 0.3, 0.4, 0.5), "aperture": 0.02, "focus_distance": 2.0},
        **{"blades": 6, "blade_rotation": 0.3, "near": 0.1, "far": 9.0},
    )
    assert hg.Camera.from_message(full.to_message()) == full
    plain = hg.Camera.from_intrinsics(k, 640, 480)
    assert hg.Camera.from_message(plain.to_message()) == plain


def test_shapes_face_outside_and_are_closed():
    for shape, volume in (
        (hg.shapes.cube(2), 8),
        (hg.shapes.sphere(1, 128), 4 / 3 * np.pi),
        (hg.shapes.cylinder(1, 2, 256), 2 * np.pi),
        (hg.shapes.torus(2, 0.5, 256), 2 * np.pi**2 * 2 * 0.25),
    ):
        corners = np.asarray(shape["positions"], "f8")[shape["indices"]]
        signed = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
        assert signed.sum() / 6 == pytest.approx(volume, rel=4e-3)
        flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals = np.asarray(shape["normals"])[shape["indices"][:, 0]]
        assert (np.einsum("ij,ij->i", flat, normals) > 0).all()


def test_log_levels():
    assert launch.level_of("2026-01-02 10:00:00.123 warning x error") == 30
    assert launch.level_of("plain text") == 20


@pytest.mark.parametrize("arguments", [[], ["render"], ["paint"], ["render", "a", "--size", "9"]])
def test_wrong_usage_exits_with_2(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert ended.value.code == 2


def test_command_line_refusals(tmp_path, capsys):
    assert cli.main(["render", "a.glb", "-o", str(tmp_path / "a.bmp")]) == 2
    assert cli.main(["render", "a.glb", "-o", str(tmp_path / "no" / "a.png")]) == 2
    assert cli.main(["info", "--address", f"unix://{tmp_path}/none"]) == 1
    assert "no daemon listens" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("dataset dome --config none", "none: No such file"),
        ("rerender manifest.json none -o x.png", "no file none"),
        ("rerender none.exr none -o x.png", "no file none.exr"),
        ("rerender text.exr none -o x.png", "text.exr is no EXR file"),
        ("rerender picture.png none -o x.png", "picture.png is no manifest"),
        ("rerender text.exr -o x.png", "give the scene file (scene.save) too"),
        ("rerender picture.png -o x.png", "is no image of a data set"),
        ("info --threads 2", "--threads: is for a private daemon"),
    ],
)
def test_wrong_input_exits_with_2(daemon, scene, tmp_path, monkeypatch, capsys, arguments, message):
    if ".exr none" in arguments:
        pytest.importorskip("OpenEXR")
    monkeypatch.chdir(tmp_path)
    for name in ("text", "text.exr", "manifest.json"):
        (tmp_path / name).write_text("{} hello")
    (tmp_path / "picture.png").write_bytes(b"\x89PNG")
    words = arguments.split()
    if words[0] != "dataset":
        words += ["--address", daemon.address]
    assert cli.main(words) == 2
    assert message in capsys.readouterr().err


def test_a_viewer_needs_a_port_that_there_is(scene):
    with pytest.raises(hg.InvalidArgument, match=r"port: 80000 is outside \[0, 65535\]"):
        hg.Viewer(scene, port=80000)


def test_command_line_against_a_daemon(daemon, capsys):
    assert cli.main(["info", "--address", daemon.address]) == 0
    assert "fake" in capsys.readouterr().out


@pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="there is no local channel")
def test_a_daemon_that_ends_while_a_session_is_opened_is_unavailable():
    near, far = socket.socketpair()
    far.close()
    with near, pytest.raises(hg.Unavailable, match="ended"):
        share_frames(near, ["shared_memory"])
    near, far = socket.socketpair()
    far.send(b"no such word")
    with near, far, pytest.raises(hg.Internal):
        share_frames(near, ["shared_memory"])
