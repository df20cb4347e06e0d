"""Durable scenes against a real daemon: what a client sees of a restart."""

import pathlib
import subprocess
import sys
import time

import grpc
import heliograph as hg
import numpy as np
import pytest
from heliograph._wire._proto import service_pb2 as service
from heliograph._wire.link import Link

sys.path.append(str(pathlib.Path(__file__).parents[1] / "fault"))
from served import DAEMON, Served  # noqa: E402


@pytest.fixture
def daemons(tmp_path):
    """Starts daemons on one state directory, one at a time."""
    running = []

    def start(kill=True, flags=()):
        if running:
            last = running.pop()
            last.process.kill() if kill else last.process.terminate()
            last.process.wait(30)
        running.append(Served(tmp_path, "--state-dir", tmp_path / "state", *flags))
        return running[0].socket

    yield start
    for daemon in running:
        daemon.stop()


def place(scene, name, x):
    with scene.edit() as edit:
        return edit.entity(name, transform=hg.Pose((x, 0, 0)))


@pytest.mark.parametrize("kill", [True, False], ids=["kill", "drain"])
@pytest.mark.parametrize("lifetime", ["disk", "disk_synced"])
def test_a_client_goes_on_after_a_restart(daemons, kill, lifetime):
    with hg.connect(daemons()) as client:
        scene = client.create_scene("room", lifetime=lifetime)
        assert scene.lifetime == lifetime
        thing = place(scene, "thing", 1)
        session = client.connection.link.session
        daemons(kill)
        assert place(scene, "thing", 2).id == thing.id
        assert client.connection.link.session == session
        assert scene.revision == 2
        assert scene.transforms([thing])[0, 0, 3] == 2


def test_a_retry_after_a_restart_is_answered_not_applied(daemons):
    with hg.connect(daemons()) as client:
        scene = client.create_scene("room", lifetime="disk")
        place(scene, "thing", 1)
        state = client.state_of(scene.id)
        state.next -= 1  # as if the reply had been lost
        daemons()
        thing = place(scene, "thing", 1)
        assert scene.revision == 1
        assert scene["thing"].id == thing.id


def test_a_repeated_creation_is_answered_with_the_scene_as_it_is(daemons):
    with hg.connect(daemons()) as client:
        request = service.CreateSceneRequest(
            name="room", lifetime="LIFETIME_DISK", request_id="once"
        )
        scene = client.open_scene(client.connection.call("CreateScene", request).name)
        place(scene, "thing", 1)
        for revision in (1, 2):
            again = client.connection.call("CreateScene", request)
            assert (again.scene, again.revision) == (scene.id, revision)
            assert again.next_edit == revision + 1
            daemons()
            client.connection.call("CreateScene", request)  # by which the session is resumed
            place(scene, "thing", 2)


@pytest.mark.parametrize("lifetime", ["daemon", "disk"])
def test_an_edit_refused_for_now_leaves_its_number_free(daemons, lifetime):
    rate = ("--limit", "tenant_edits_per_second=10")
    with hg.connect(daemons(flags=rate)) as client:
        scene = client.create_scene("room", lifetime=lifetime)
        for number in range(1, 1000):
            request = service.ApplyRequest(scene=scene.id, number=number)
            request.transaction.edits.add().advance.dt = 1
            try:
                client.connection.call("Apply", request)
            except hg.ResourceExhausted as error:
                refused = error
                break
        assert 0 < refused.retry_seconds < 60
        assert scene._info().next_edit == number
        time.sleep(refused.retry_seconds)
        assert client.connection.call("Apply", request).revision == number
        time.sleep(1)
        scene.apply(request.transaction)  # numbered by the client
        with pytest.raises(hg.ResourceExhausted):
            for _ in range(1000):
                scene.apply(request.transaction)
        applied = scene.revision
        time.sleep(1)
        assert scene.apply(request.transaction).revision == applied + 1


def test_what_was_not_durable_is_gone(daemons):
    with hg.connect(daemons()) as client:
        client.create_scene("kept", lifetime="disk")
        plain = client.create_scene("plain")
        daemons()
        with pytest.raises(hg.NotFound):
            place(plain, "thing", 1)
        assert [scene.name for scene in client.scenes()] == ["kept"]
        fresh = client.create_scene("plain")
        assert fresh.id not in (plain.id, client.open_scene("kept").id)


def test_pictures_are_the_same_after_a_restart(daemons):
    with hg.connect(daemons()) as client:
        scene = client.create_scene("room", lifetime="disk")
        with scene.edit() as edit:
            edit.sample_studio()
            mesh = edit.mesh("mesh", **hg.shapes.sphere(0.5))
            ball = edit.entity("ball", mesh=mesh, transform=hg.Pose((0, 0, 0.5)), label="auto")
            lens = hg.Camera.from_fov(50, 32, 32, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0.5)))
        with scene.edit() as edit:
            edit.advance(0.1)
            edit.entity("ball", transform=hg.Pose((0.1, 0, 0.5)))
        planes = ["beauty", "depth", "instance", "flow_backward"]
        before = scene.render("cam", planes=planes, spp=4)
        boxes = scene.read([ball], ["aabb"])[0][0]
        for kill in (True, False):
            daemons(kill)
            assert scene.revision == 2
            after = scene.render("cam", planes=planes, spp=4)
            for plane in planes:
                assert before[plane].tobytes() == after[plane].tobytes()
            assert scene.read([ball], ["aabb"])[0][0].tobytes() == boxes.tobytes()


@pytest.mark.parametrize("where", ["shared memory", "upload"])
def test_large_arrays_are_there_after_a_restart(daemons, where):
    vertices = np.random.default_rng(1).random((120_000, 3), dtype=np.float32)  # over 1 MiB
    with hg.connect(daemons()) as client:
        if where == "upload":
            client.connection.link.shared = None
        scene = client.create_scene("room", lifetime="disk")
        with scene.edit() as edit:
            faces = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
            mesh = edit.mesh("mesh", positions=vertices, indices=faces)
        with scene.edit() as edit:
            edit.mesh(mesh, positions=vertices + 1)
        for kill in (True, False):
            daemons(kill)
            assert scene.revision == 2
            assert (scene.read([mesh], ["mesh.positions"])[0][0] == vertices + 1).all()


def test_branches_are_durable_when_asked(daemons):
    with hg.connect(daemons()) as client:
        scene = client.create_scene("room", lifetime="disk")
        place(scene, "thing", 1)
        assert scene.branch("not", lifetime="daemon").lifetime == "daemon"
        branch = scene.branch("too", lifetime="disk_synced")
        place(branch, "thing", 2)
        scene.delete()
        daemons()
        assert [s.name for s in client.scenes()] == ["too"]
        assert branch.transforms(["thing"])[0, 0, 3] == 2


def test_a_session_is_not_resumed_for_ever(daemons):
    with hg.connect(daemons()) as client:
        scene = client.create_scene("room", lifetime="disk")
        place(scene, "thing", 1)
        daemons(flags=("--limit", "resume_seconds=1"))
        time.sleep(2)
        with pytest.raises(hg.Unauthenticated):
            place(scene, "thing", 2)
        place(scene, "thing", 3)  # in a new session
        assert scene.revision == 2


def test_scenes_on_disk_need_a_state_directory(client):
    with pytest.raises(hg.FailedPrecondition, match="--state-dir"):
        client.create_scene("room", lifetime="disk")
    with pytest.raises(hg.InvalidArgument, match="one of session, daemon, disk, disk_synced"):
        client.create_scene("room", lifetime="maybe")


def test_a_ticket_of_the_daemon_before_costs_nothing(daemons):
    with hg.connect(daemons()) as client:
        scene = client.create_scene("room", lifetime="disk")
        place(scene, "thing", 1)
        session = client.connection.link.session
        address = daemons()
        with hg.connect(address) as other:
            request = service.OpenSessionRequest(client="late", ticket=b"x" * 16, resume=session)
            with pytest.raises(grpc.RpcError, match="ticket"):
                other.connection.link.method("OpenSession")(request)
        place(scene, "thing", 2)
        assert client.connection.link.session == session
        assert scene.revision == 2


def test_a_session_is_resumed_again_when_the_reply_was_lost(daemons):
    with hg.connect(daemons()) as client:
        scene = client.create_scene("room", lifetime="disk")
        place(scene, "thing", 1)
        old = client.connection.link
        access = client.connection.access
        daemons()
        old_link = Link(access, old.session)
        with pytest.raises(grpc.RpcError, match="carries it"):
            Link(access, old.session)
        old_link.close()
        assert client.connection.resume(old, hg.Unauthenticated("the daemon restarted"))
        assert client.connection.link is not old
        assert client.connection.link.session == old.session
        place(scene, "thing", 2)
        assert scene.revision == 2


def test_two_daemons_do_not_share_a_state_directory(daemons, tmp_path):
    with hg.connect(daemons()):  # by now it has taken the directory
        flags = ["--socket", tmp_path / "other" / "s", "--state-dir", tmp_path / "state"]
        second = subprocess.run([DAEMON, *flags], capture_output=True, text=True, timeout=20)
    assert second.returncode == 69 and "another daemon's" in second.stderr


def test_a_state_directory_may_be_relative(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    daemon = Served(tmp_path, "--state-dir", "state")
    with hg.connect(daemon.socket) as client:
        client.create_scene("room", lifetime="disk")
    daemon.stop()
    assert (tmp_path / "state" / "journal.db").exists()
