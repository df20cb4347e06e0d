"""Scene.watch against a real daemon: what changes say, resuming, and the end."""

import asyncio
import pathlib
import sys
import threading
import time

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire.arrays import from_message

sys.path.append(str(pathlib.Path(__file__).parents[1] / "fault"))
from served import Served  # noqa: E402


@pytest.fixture
def shared(client):
    made = client.create_scene(lifetime="daemon")
    yield made
    made.delete()


def place(scene, x, name="thing"):
    with scene.edit() as edit:
        return edit.entity(name, transform=hg.Pose((x, 0, 0)))


def revisions(watch, count):
    return [next(watch).revision for _ in range(count)]


def test_a_change_says_what_was_done_to_what(shared):
    eyes = np.tile(np.eye(4), (3, 1, 1))
    with shared.edit() as edit:
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.5, 8))
        many = edit.instances("many", mesh=mesh, transforms=eyes)
    with shared.edit() as edit:
        edit.set_transforms(many, eyes)
        edit.remove("many/0")
        edit.advance(0.5)
    with shared.watch(1) as watch:
        made, moved = next(watch), next(watch)
    assert (made.revision, moved.revision, made.is_bookmark) == (1, 2, False)
    put, placed = made.edits
    assert (put.action, put.name, list(put.ids)) == ("mesh", "mesh", [mesh.id])
    assert {"positions", "indices"} <= set(put.fields)
    assert placed.action == "instances" and list(placed.ids) == [one.id for one in many]
    poses, removed, advanced = moved.edits
    assert (poses.action, list(poses.ids)) == ("poses", [one.id for one in many])
    assert (removed.action, removed.name) == ("remove", "many/0")
    assert (advanced.action, advanced.ids.size, advanced.fields) == ("advance", 0, ("dt",))
    assert moved.transaction.edits[2].advance.dt == 0.5
    assert shared.handle(int(put.ids[0])).positions.shape[1] == 3


def test_another_client_watches_from_where_it_read(client, shared):
    place(shared, 1)
    with hg.connect(client.address) as other:
        theirs = hg.Scene(other, shared.id)
        with theirs.watch(theirs.revision + 1) as watch:
            for x in range(5):
                place(shared, x)
            assert revisions(watch, 5) == [2, 3, 4, 5, 6]
            assert watch.revision == 6


def test_bookmarks_are_shown_when_asked_for(scene):
    with scene.watch(bookmark_seconds=0.5) as watch:
        bookmark = next(watch)
        assert bookmark.is_bookmark and bookmark.revision == 0 and bookmark.edits == []
        place(scene, 1)
        assert not next(watch).is_bookmark
        assert (next(watch).revision, watch.revision) == (1, 1)


def test_close_ends_the_iteration_from_another_thread(scene):
    with scene.watch() as watch:
        threading.Timer(0.1, watch.close).start()
        assert list(watch) == []


def test_what_cannot_be_had_is_refused(client, scene):
    place(scene, 1)
    with pytest.raises(hg.OutOfRange, match="compacted") as error:
        scene.watch(1)  # a private scene keeps changes since its first watch
    assert error.value.expected == 2
    with pytest.raises(hg.OutOfRange, match="not there yet") as error:
        scene.watch(3)
    assert error.value.expected == 2
    with pytest.raises(hg.InvalidArgument, match="from_revision"):
        scene.watch(0)
    with pytest.raises(hg.InvalidArgument, match="bookmark_seconds"):
        scene.watch(bookmark_seconds=0.1)
    gone = client.create_scene(lifetime="daemon")
    with gone.watch() as watch:
        gone.delete()
        with pytest.raises(hg.NotFound):
            next(watch)


def test_a_reader_that_falls_behind_is_told_the_oldest():
    with hg.connect(arguments=["--limit", "watch_events=4"]) as client:
        scene = client.create_scene(lifetime="daemon")
        mesh = hg.shapes.sphere(0.5, segments=64)
        with scene.watch(1) as watch:
            for _ in range(400):  # together far more than connections hold
                with scene.edit() as edit:
                    edit.mesh("mesh", **mesh)
            with pytest.raises(hg.OutOfRange) as error:
                revisions(watch, 400)
            assert watch.revision < error.value.expected <= 401
        with scene.watch(397) as watch:
            assert revisions(watch, 4) == [397, 398, 399, 400]


@pytest.mark.parametrize("kill", [True, False], ids=["kill", "drain"])
def test_it_goes_on_after_a_restart_and_begins_before_it(tmp_path, kill):
    state = ("--state-dir", tmp_path / "state", "--limit", "snapshot_edits=5")
    daemon = Served(tmp_path, *state)
    with hg.connect(daemon.socket) as client:
        scene = client.create_scene("room", lifetime="disk")
        with scene.watch() as watch:
            for x in range(13):
                place(scene, x)
            assert revisions(watch, 6) == [1, 2, 3, 4, 5, 6]
            daemon.process.kill() if kill else daemon.process.terminate()
            daemon.process.wait(30)
            daemon = Served(tmp_path, *state)
            place(scene, 13)
            assert revisions(watch, 8) == [7, 8, 9, 10, 11, 12, 13, 14]
        with scene.watch(1) as again:
            for x in range(14):
                edit = next(again).transaction.edits[0]
                matrix = from_message(edit.entity.pose.matrices)
                assert matrix[0, 3] == x
    daemon.stop()


def test_a_private_daemon_that_dies_ends_it():
    with hg.connect() as client:
        scene = client.create_scene()
        with scene.watch() as watch:
            client.connection.daemon._process.kill()
            start = time.monotonic()
            with pytest.raises(hg.Unavailable) as error:
                next(watch)
            assert error.value.exit_code == -9
            assert time.monotonic() - start < 5


def test_the_async_twin(client):
    async def follow():
        async with await hg.aio.connect(client.address) as mine:
            scene = await mine.create_scene()
            async with scene.watch() as watch:
                for x in range(3):
                    async with scene.edit() as edit:
                        edit.entity("thing", transform=hg.Pose((x, 0, 0)))
                found = []
                async for change in watch:
                    found.append(change.revision)
                    if len(found) == 3:
                        break
            return found, watch.revision

    assert asyncio.run(follow()) == ([1, 2, 3], 3)
