"""A session is recorded, and played again: every call is answered the same, to the byte."""

import os
import re
import stat
import subprocess
import time

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire._proto import service_pb2 as service
from heliograph_replay.reader import Recording
from heliograph_replay.replay import DIFFERS, NOT_PLAYED, SAME
from recordings import (
    PLANES,
    furnish,
    items_of,
    methods,
    place,
    played,
    replay_command,
    shared_room,
    write_items,
)
from served import DAEMON


def grid(size):
    """(size^2, 3) vertices and their triangles: over 1 MiB where size is 300."""
    y, x = np.mgrid[0:size, 0:size].astype(np.float32) / size
    corner = (np.arange(size - 1)[:, None] * size + np.arange(size - 1)).ravel()
    faces = np.concatenate(
        [corner + np.array([[a], [b], [c]]) for a, b, c in ((0, 1, size), (1, size + 1, size))],
        axis=1,
    ).T
    return np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3), faces.astype(np.uint32)


def upload(scene):
    """Arrays over 1 MiB: by hash, and in shared memory or as an anonymous upload."""
    vertices, faces = grid(320)
    with scene.edit() as edit:
        mesh = edit.mesh("cloth", positions=vertices, indices=faces)
        edit.entity("sheet", mesh=mesh, label="auto")
    with scene.edit() as edit:
        edit.mesh("cloth", positions=vertices + np.float32(0.1))


def import_model(client, scene, folder):
    model = folder / "model.obj"
    model.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\n")
    with scene.edit() as edit:
        edit.import_file(model)


def show(scene):
    """Frames by every call that has them."""
    scene.render("cam", planes=PLANES, spp=4)
    scene.render("cam", planes=PLANES, spp=8, on_pass=lambda _: None)
    scene.render("cam", planes=PLANES, seconds=0.02)
    jobs = [hg.Job("cam", planes=PLANES, spp=2, seed=seed) for seed in (1, 2)]
    jobs.append(hg.Job("no camera", planes=PLANES, spp=2))
    results = list(scene.render_batch(jobs))
    assert sorted(result.error is None for result in results) == [False, True, True]
    with scene.stream("cam", planes=PLANES, spp=2) as stream:
        for x in (0.2, 0.4):
            next(iter(stream))
            place(scene, x)
        next(iter(stream))


def ask(scene):
    """Every question, and a refusal of each."""
    ball = scene["ball"]
    scene.read(["ball", "sheet"], ["pose", "aabb", "mesh.positions", "mesh.indices", "entity"])
    scene.cast_rays(np.tile([0, -3, 0.5], (500, 1)), np.tile([0, 1, 0], (500, 1)))
    scene.pick("cam", [(24, 24)])
    scene.visible("cam", ["ball"])
    scene.overlaps(["ball"], ["ball"])
    points = scene.sample_surface(["ball"], 20, seed=3)
    scene.tracks("cam", points, [0.0, 0.5])
    assert ball in scene.find("b*")
    assert scene.describe(tree=True, memory=True).memory.arrays > 0
    with pytest.raises(hg.NotFound):
        scene.read(["nobody"], ["pose"])
    with pytest.raises(hg.NotFound):
        scene.pick("nobody", [(1, 1)])


def work(client, folder):
    """A bit of everything."""
    with client.create_scene("room") as scene:
        furnish(scene)
        upload(scene)
        import_model(client, scene, folder)
        show(scene)
        with scene.watch() as watch:
            place(scene, 0.6)
            next(iter(watch))
            upload(scene)
            ask(scene)
            next(iter(watch))
        with pytest.raises(hg.NotFound):
            scene.render("nobody", planes=["depth"])
        with pytest.raises(hg.InvalidArgument), scene.edit() as edit:
            edit.set_transforms(["ball"], np.full((1, 4, 4), np.nan, np.float32))
        branch = scene.branch("other")
        place(branch, 1)
        branch.render("cam", planes=PLANES, spp=2)
        scene.save(folder / "scene.hgs")
        with client.load_scene(folder / "scene.hgs", name="again") as again:
            again.render("cam", planes=PLANES, spp=2)
        branch.delete()


EVERY_METHOD = {
    *("CreateScene", "BranchScene", "DeleteScene", "ImportScene", "Apply", "UploadBlob"),
    *("DecodeAsset", "Render", "RenderBatch", "Stream"),
    *("Read", "Query", "Tracks", "DescribeScene", "ExportScene", "Watch"),
}


def test_a_session_played_again_is_answered_the_same(recorded, tmp_path):
    daemon = recorded()
    with hg.connect(daemon.socket) as client:
        session = client.connection.link.session
        work(client, tmp_path)
    assert daemon.stop() == 0
    found = played(daemon.recording)
    assert not found[DIFFERS] and not found[NOT_PLAYED]
    assert methods(found[SAME]) == EVERY_METHOD
    assert stat.S_IMODE(os.stat(daemon.recording).st_mode) == 0o600
    recording = Recording(daemon.recording)
    assert recording.reason == "the daemon ended" and recording.buffers
    assert str(session).encode() not in daemon.recording.read_bytes()


def test_over_tcp_no_token_is_recorded(recorded, tmp_path):
    daemon = recorded("--listen", "127.0.0.1:0")
    token = (tmp_path / "run/token").read_text().strip()
    with hg.connect(daemon.tcp, token=token) as client:
        work(client, tmp_path)
    daemon.stop()
    assert token.encode() not in daemon.recording.read_bytes()
    found = played(daemon.recording)
    assert not found[DIFFERS] and not found[NOT_PLAYED]
    assert not Recording(daemon.recording).buffers


def test_the_command_tells_of_each_call(short):
    run = replay_command(short, "--each")
    assert run.returncode == 0, run.stderr + run.stdout
    for line in (r"call 1 CreateScene: same", r"Apply +3 +0 +0", r"Render +2 +0 +0"):
        assert re.search(line, run.stdout), run.stdout


def test_a_changed_byte_is_found_and_its_call_named(short):
    items = items_of(short)
    edits = [i for i in items if i.HasField("request") and b"ball" in i.request.message]
    request = service.ApplyRequest.FromString(edits[-1].request.message)
    matrices = request.transaction.edits[0].entity.pose.matrices
    moved = np.frombuffer(matrices.inline, dtype="<f8" if len(matrices.inline) == 128 else "<f4")
    moved = moved.copy()
    moved[3] = 0.25  # x of a (4, 4) matrix
    matrices.inline = moved.tobytes()
    edits[-1].request.message = request.SerializeToString()
    write_items(short, items)
    run = replay_command(short)
    assert run.returncode == 1
    assert re.findall(r"(call \d+ \w+): differs", run.stdout) == ["call 7 Render"]
    assert "frame 0 of revision 3 has other pixels or labels" in run.stdout


def test_a_changed_answer_is_found_and_its_call_named(short):
    items = items_of(short)
    reply = [i.reply for i in items if i.HasField("reply") and i.reply.call == 4][0]
    answer = service.ApplyReply.FromString(reply.message)
    answer.revision += 7
    reply.message = answer.SerializeToString()
    write_items(short, items)
    run = replay_command(short)
    assert run.returncode == 1
    assert "call 4 Apply: differs: revision is 2; it was 9" in run.stdout


def test_damaged_bytes_are_named(short):
    data = bytearray(short.read_bytes())
    first = next(i for i in items_of(short) if i.HasField("status"))
    at = bytes(data).index(first.SerializeToString())
    data[at] = 0x07  # no such wire type
    short.write_bytes(data)
    run = replay_command(short)
    assert run.returncode == 2
    assert re.search(r"damaged at byte \d+, after call 1 CreateScene", run.stderr), run.stderr


@pytest.mark.parametrize(
    ("name", "message"), [("text", "text is no recording"), ("none", "none: No such file")]
)
def test_wrong_input_exits_with_2(tmp_path, name, message):
    (tmp_path / "text").write_text("{} hello")
    run = replay_command(tmp_path / name)
    assert run.returncode == 2
    assert message in run.stderr


def test_a_daemon_that_was_killed_leaves_what_it_had(recorded):
    daemon = recorded()
    with hg.connect(daemon.socket) as client:
        scene = client.create_scene("room", lifetime="daemon")
        furnish(scene)
        for x in range(20):
            place(scene, x)
        scene.render("cam", planes=PLANES, spp=2)
        time.sleep(0.5)  # it writes twenty times a second
        daemon.process.kill()
        daemon.process.wait(30)
    found = played(daemon.recording)
    assert not found[DIFFERS] and len(found[SAME]) >= 23
    whole = daemon.recording.read_bytes()
    for cut in (1, 7, 300, len(whole) // 2):
        daemon.recording.write_bytes(whole[:-cut])
        assert Recording(daemon.recording).reason == ""
        assert not played(daemon.recording)[DIFFERS]


def test_it_keeps_up_after_much_came_at_once(recorded):
    daemon = recorded()
    with hg.connect(daemon.socket) as client:
        scene = client.create_scene("room", lifetime="daemon")
        with scene.edit() as edit:
            edit.mesh("cloth", positions=np.zeros((1_000_000, 3), "f4"), indices=[(0, 1, 2)])
        for x in range(1000):
            place(scene, x)
        time.sleep(0.5)
        daemon.process.kill()
        daemon.process.wait(30)
    calls = Recording(daemon.recording).calls.values()
    assert sum(call.status is not None for call in calls) > 1000


def test_its_size_is_limited(recorded):
    daemon = recorded("--limit", "record_bytes=50000")
    with hg.connect(daemon.socket) as client, client.create_scene("room") as scene:
        for x in range(400):
            place(scene, x)
        time.sleep(0.2)
        assert "record_bytes" in daemon.log()
        place(scene, 400)  # everything else goes on
        assert scene.revision == 401
    daemon.stop()
    assert daemon.recording.stat().st_size <= 50_000
    assert "record_bytes" in Recording(daemon.recording).reason
    found = played(daemon.recording)
    assert not found[DIFFERS] and len(found[SAME]) > 50


def test_two_sessions_that_share_a_scene(recorded):
    daemon = recorded()
    with shared_room(daemon) as (mine, yours):
        for x in range(10):
            place((mine, yours)[x % 2], x)
            (yours, mine)[x % 2].render("cam", planes=PLANES, spp=2)
    daemon.stop()
    found = played(daemon.recording)
    assert not found[DIFFERS]
    assert {"OpenScene", "Apply", "Render"} <= methods(found[SAME])


def test_edits_that_were_refused_for_now_are_left_out(recorded):
    daemon = recorded("--limit", "tenant_edits_per_second=10")
    with hg.connect(daemon.socket) as client, client.create_scene() as scene:
        for _ in range(2):
            first = scene._info().next_edit
            edits = [service.ApplyRequest(scene=scene.id, number=first + n) for n in range(200)]
            for each in edits:
                each.transaction.edits.add().advance.dt = 1
            replies = list(client.connection.stream("ApplyStream", iter(edits)))
            codes = [reply.status.code for reply in replies]
            assert 0 < codes.index(8) and codes[-1] in (8, 10)
            time.sleep(1)
    daemon.stop()
    found = played(daemon.recording)
    assert not found[DIFFERS]
    assert any("it depended on time: RESOURCE_EXHAUSTED" in line for line in found[NOT_PLAYED])


def test_where_it_may_not_be(tmp_path):
    there = tmp_path / "no/such/folder"
    run = subprocess.run(
        [DAEMON, "--socket", tmp_path / "run/s", "--record", there], capture_output=True, text=True
    )
    assert run.returncode == 64 and "--record" in run.stderr and "folder" in run.stderr


def test_a_file_that_is_there_is_kept(tmp_path):
    settings = tmp_path / "heliographd.toml"
    settings.write_text(f'record = "{tmp_path}/session.recording"\n[limits]\nrecord_bytes = 2000\n')
    other = tmp_path / "sessions.recording"  # of something else: it counts for no limit
    other.write_bytes(bytes(4000))
    for run in range(3):
        with hg.connect(arguments=("--config", str(settings))) as client:
            for _ in range(4):
                client.create_scene()
        found = sorted(tmp_path.glob("session[.-]*recording"), key=lambda path: path.stat().st_ino)
        assert len(found) == run + 1
        if run == 0:
            first = found[0].read_bytes()
    assert (tmp_path / "session.recording").read_bytes() == first
    assert sum(path.stat().st_size for path in found) <= 2000 + 512


def test_a_folder_gets_a_file_a_run(tmp_path):
    for run in range(2):
        with hg.connect(arguments=("--record", str(tmp_path))) as client:
            client.create_scene()
        assert len(list(tmp_path.glob("heliograph-*.recording"))) == run + 1
