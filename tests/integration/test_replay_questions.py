"""Questions of clients about a scene are recorded, and answered the same when played again."""

import contextlib
import pathlib
import threading

import heliograph as hg
import numpy as np
import pytest
from google.protobuf.message import DecodeError, Message
from heliograph._wire._proto import recording_pb2 as pb
from heliograph._wire._proto import service_pb2 as service
from heliograph_replay.reader import Recording
from heliograph_replay.replay import DIFFERS, NOT_PLAYED, SAME, replay
from recordings import (
    furnish,
    items_of,
    methods,
    place,
    played,
    replay_command,
    shared_room,
    write_items,
)
from served import Served

REPLIES = {
    "Read": service.ReadReply,
    "Query": service.QueryReply,
    "Tracks": service.TracksReply,
    "DescribeScene": service.DescribeSceneReply,
    "ExportScene": service.SceneChunk,
    "Watch": service.WatchReply,
}


@pytest.fixture
def asked(recorded, tmp_path):
    """The recording of each question once, small and large answers."""
    daemon = recorded()
    with hg.connect(daemon.socket) as client, client.create_scene("room") as scene:
        furnish(scene)
        with scene.watch() as watch:
            place(scene, 0.25)
            next(iter(watch))
        scene.read(["ball"], ["world_pose", "mesh.positions"])
        scene.cast_rays(np.tile([0.25, -3, 0.5], (900, 1)), [0, 1, 0])
        scene.tracks("cam", scene.pick("cam", [(24, 24)]), [0.0])
        scene.describe(tree=True)
        scene.save(tmp_path / "scene.hgs")
        place(scene, 0.5)
    daemon.stop()
    return daemon.recording


def call_of(items, method):
    """The number of the last call of a method."""
    return [i.call.call for i in items if i.HasField("call") and i.call.method == method][-1]


def longest(message, path=""):
    """(message, name of the field) of its longest field of bytes, and its path."""
    found = (0, None, "", "")
    for field, value in message.ListFields():
        if isinstance(value, bytes):
            found = max(
                found, (len(value), message, field.name, path + field.name), key=lambda f: f[0]
            )
        elif field.message_type and field.message_type.GetOptions().map_entry:
            continue
        elif field.message_type:
            for inner in [value] if isinstance(value, Message) else value:
                found = max(found, longest(inner, f"{path}{field.name}."), key=lambda f: f[0])
    return found


def stored_reply(items, item, kind):
    """A reply, which stands in its item or before it."""
    data = item.message
    for other in items:
        if item.sha256 and other.HasField("bytes") and other.bytes.sha256 == item.sha256:
            data = other.bytes.data
    return kind.FromString(data)


def flip(items, method):
    """Changes one byte of the longest field of the method's replies; how the field is called."""
    call, kind = call_of(items, method), REPLIES[method]
    replies = [i.reply for i in items if i.HasField("reply") and i.reply.call == call]
    messages = [stored_reply(items, reply, kind) for reply in replies]
    _, reply, message = max(
        zip([longest(m)[0] for m in messages], replies, messages, strict=True), key=lambda f: f[0]
    )
    _, holder, name, path = longest(message)
    data = bytearray(getattr(holder, name))
    data[-1] ^= 1
    setattr(holder, name, bytes(data))
    reply.message, reply.sha256 = message.SerializeToString(), b""
    return path.split(".")[-1]


def test_answers_are_short_in_the_recording_and_come_again(asked):
    found = played(asked)
    assert not found[DIFFERS] and not found[NOT_PLAYED]
    assert set(REPLIES) <= methods(found[SAME])
    recording = Recording(asked)
    for call in recording.calls.values():
        for part in call.replies if call.method in REPLIES else ():
            assert longest(recording.reply(call, part))[0] <= 4096
        if call.method in REPLIES and call.method != "Watch":
            assert call.status.item.HasField("revision")


@pytest.mark.parametrize("method", [name for name in REPLIES if name != "DescribeScene"])
def test_a_changed_value_is_found(asked, method):
    items = items_of(asked)
    name = flip(items, method)
    write_items(asked, items)
    run = replay_command(asked)
    assert run.returncode == 1, run.stdout
    (line,) = [line for line in run.stdout.splitlines() if "differs:" in line]
    assert line.startswith(f"call {call_of(items, method)} {method}"), line
    assert "differs: scene 'room', revision 2: " in line and f"{name} has other values" in line
    assert method != "Read" or "of 'ball': array.inline" in line
    assert method not in ("Query", "Tracks") or "columns[" in line


def test_a_changed_description_is_found(asked):
    items = items_of(asked)
    call = call_of(items, "DescribeScene")
    item = [i.reply for i in items if i.HasField("reply") and i.reply.call == call][0]
    reply = service.DescribeSceneReply.FromString(item.message)
    reply.counts.meshes += 1
    item.message = reply.SerializeToString()
    write_items(asked, items)
    (line,) = played(asked)[DIFFERS]
    assert line.startswith(f"call {call} DescribeScene") and "counts.meshes is 2; it was 3" in line


def test_questions_about_an_altered_scene_differ(asked):
    """The first of the edits that move the ball moves it elsewhere."""
    items = items_of(asked)
    edit = [i.request for i in items if i.HasField("request") and b"ball" in i.request.message][1]
    request = service.ApplyRequest.FromString(edit.message)
    matrices = request.transaction.edits[0].entity.pose.matrices
    moved = np.frombuffer(matrices.inline, dtype="<f8" if len(matrices.inline) == 128 else "<f4")
    moved = moved.copy()
    moved[3] += 0.125  # x of a (4, 4) matrix
    matrices.inline = moved.tobytes()
    edit.message = request.SerializeToString()
    write_items(asked, items)
    found = played(asked)
    assert methods(found[DIFFERS]) == {"Read", "Query", "Tracks", "ExportScene", "Watch"}
    assert any("world_pose of 'ball'" in line for line in found[DIFFERS])


def test_a_question_is_played_before_the_next_edit(recorded):
    """Two sessions: one moves the ball as fast as it can, the other asks where it is."""
    daemon = recorded()
    with shared_room(daemon) as (mine, yours):
        done = threading.Event()

        def move():
            for x in range(300):
                place(mine, x / 100)
            done.set()

        thread = threading.Thread(target=move)
        with yours.watch() as watch:
            thread.start()
            places = set()
            while not done.is_set():
                places.add(yours.read(["ball"], ["pose"])[0][0][0, 3])
                yours.cast_rays([0.5, -3, 0.5], [0, 1, 0])
            assert [next(iter(watch)).revision for _ in range(300)] == list(range(2, 302))
        thread.join()
    daemon.stop()
    assert len(places) > 10
    found = played(daemon.recording)
    assert not found[DIFFERS] and not found[NOT_PLAYED]
    assert any("Watch, revisions 2 to 301" in line for line in found[SAME])


def test_watches_of_a_private_scene_begin_where_they_did(recorded):
    daemon = recorded()
    with hg.connect(daemon.socket) as client, client.create_scene() as scene:
        furnish(scene)
        with pytest.raises(hg.OutOfRange):
            scene.watch(from_revision=1)
        with scene.watch() as first:
            for x in range(3):
                place(scene, x)
            assert next(iter(first)).revision == 2
        with scene.watch(from_revision=3) as second:
            assert [next(iter(second)).revision for _ in range(2)] == [3, 4]
    daemon.stop()
    found = played(daemon.recording)
    assert not found[DIFFERS] and not found[NOT_PLAYED]
    assert sum("Watch, revisions" in line for line in found[SAME]) == 2
    assert sum("Watch" in line for line in found[SAME]) == 5


def test_a_recording_without_questions_is_played(asked):
    """As daemons wrote them that did not know any."""
    items = items_of(asked)
    left_out = {i.call.call for i in items if i.HasField("call") and i.call.method in REPLIES}
    kinds = ("call", "request", "reply", "status")
    items = [
        i
        for i in items
        if all(not i.HasField(k) or getattr(i, k).call not in left_out for k in kinds)
    ]
    write_items(asked, items)
    found = played(asked)
    assert not found[DIFFERS] and not found[NOT_PLAYED]
    assert {"CreateScene", "Apply"} <= methods(found[SAME])
    assert not methods(found[SAME]) & set(REPLIES)


def test_scenes_from_before_are_said_not_to_be_played(recorded, tmp_path):
    state = ("--state-dir", tmp_path / "state")
    before = Served(tmp_path, *state)
    with hg.connect(before.socket) as client:
        furnish(client.create_scene("room", lifetime="disk"))
    assert before.stop() == 0
    daemon = recorded(*state)
    with hg.connect(daemon.socket) as client:
        scene = client.open_scene("room")
        place(scene, 1)
        scene.read(["ball"], ["pose"])
        with scene.watch(from_revision=1) as watch:
            next(iter(watch))
        with pytest.raises(hg.NotFound):
            scene.read(["nobody"], ["pose"])
    daemon.stop()
    found = played(daemon.recording)
    assert not found[DIFFERS]
    assert {"OpenScene", "Apply", "Read"} <= methods(found[NOT_PLAYED])
    assert all(
        "before the recording began" in line for line in found[NOT_PLAYED] if "Watch" not in line
    )


def spoil_reply(items, method):
    call = call_of(items, method)
    for item in items:
        if item.HasField("reply") and item.reply.call == call:
            item.reply.message, item.reply.sha256 = b"\x07", b""


def lose_bytes(items, method):
    call = call_of(items, method)
    [i.reply for i in items if i.HasField("reply") and i.reply.call == call][-1].sha256 = b"?" * 32


@pytest.mark.parametrize("method", sorted(REPLIES))
@pytest.mark.parametrize(
    "spoil, text",
    [(spoil_reply, "its message is damaged"), (lose_bytes, "its bytes are not in the recording")],
)
def test_damaged_answers_are_named(asked, method, spoil, text):
    items = items_of(asked)
    spoil(items, method)
    write_items(asked, items)
    lines = played(asked)[DIFFERS]
    assert lines and all(method in line and text in line for line in lines), lines


def test_calls_of_nobody_and_of_no_kind(asked):
    items = items_of(asked)
    of_no_kind = pb.RecordCall(call=900, session=1, method="Hypnotise")
    write_items(asked, [*items, pb.RecordItem(call=of_no_kind)])
    (line,) = played(asked)[NOT_PLAYED]
    assert line == "call 900 Hypnotise: this client does not know such calls"
    of_nobody = pb.RecordCall(call=901, session=77, method="Read")
    write_items(asked, [*items, pb.RecordItem(call=of_nobody)])
    run = replay_command(asked)
    assert run.returncode == 2 and "damaged at byte" in run.stderr, run.stderr


def spoil(items, seed):
    """Items lost, repeated, exchanged, and with a bit that is another."""
    random = np.random.default_rng(seed)
    for _ in range(random.integers(1, 6)):
        at, other = random.integers(1, len(items), 2)
        data = bytearray(items[at].SerializeToString())
        data[random.integers(len(data))] ^= 1 << random.integers(8)
        with contextlib.suppress(DecodeError):
            changes = ([], [items[at]] * 2, [items[other]], [pb.RecordItem.FromString(bytes(data))])
            items[at : at + 1] = changes[random.integers(4)]


def test_hostile_recordings_end_in_verdicts_or_in_a_word(asked):
    """Whatever is in the file, replay says what is wrong with it, and goes on where it can."""
    whole, ends = items_of(asked), set()
    with hg.connect() as client:
        for seed in range(25):
            items = list(whole)
            spoil(items, seed)
            write_items(asked, items)
            try:
                ends |= {outcome.verdict for outcome in replay(Recording(asked), client)}
            except hg.InvalidArgument as error:
                assert "damaged at byte" in str(error)
                ends.add("refused")
    assert ends == {SAME, DIFFERS, NOT_PLAYED, "refused"}


def test_a_recording_that_ends_in_a_watch(asked):
    """Cut off anywhere, it is played as far as it goes."""
    whole = pathlib.Path(asked).read_bytes()
    for part in (0.5, 0.7, 0.9):
        asked.write_bytes(whole[: int(len(whole) * part)])
        found = played(asked)
        assert not found[DIFFERS] and found[SAME]
