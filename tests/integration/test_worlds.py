"""scene.render_worlds: each world is the picture that a render of its own gives."""

import asyncio
import json
import threading

import heliograph as hg
import heliograph.aio as aio
import numpy as np
import pytest
from heliograph._wire import shared as _shared
from heliograph._wire._proto import service_pb2 as service
from heliograph.render import call
from recordings import DIFFERS, NOT_PLAYED, SAME, played
from replicas import (
    BALLS,
    CAMERAS,
    COUNT,
    MATRICES,
    PLANES,
    SEED,
    SPP,
    TEXTS,
    alone,
    rows,
    seed_of,
    the_worlds,
)


def check_same(batch, i, camera, single, planes=PLANES):
    """A picture of a WorldFrame is a Frame, bit for bit."""
    picture = batch.frame(i, camera)
    for plane in planes:
        assert picture[plane].tobytes() == single[plane].tobytes(), (i, camera, plane)
        assert picture[plane].shape == single[plane].shape
    assert picture.seed == single.seed and picture.camera == single.camera
    assert np.array_equal(picture.K, single.K)
    assert np.array_equal(picture.camera_from_world_cv, single.camera_from_world_cv)
    assert set(picture.labels) == set(single.labels)
    for name in single.labels:
        assert np.array_equal(
            picture.labels[name], single.labels[name], equal_nan=name not in TEXTS
        )
    assert picture.sha256 == single.sha256


def test_each_world_is_the_picture_of_a_request_of_its_own(room):
    revision = room.revision
    options = {"planes": PLANES, "spp": SPP, "labels": True}
    batch = room.render_worlds(CAMERAS, the_worlds(room), seed=SEED, **options)
    assert batch["beauty"].shape == (COUNT, 2, 24, 40, 4)
    assert batch["depth"].shape == (COUNT, 2, 24, 40)
    assert batch["instance"].dtype == np.uint32
    assert batch.K.shape == (COUNT, 2, 3, 3)
    assert batch.worlds.tolist() == list(range(COUNT)) and batch.cameras == CAMERAS
    assert batch.seeds.tolist() == [seed_of(SEED, i) for i in range(COUNT)]
    for i in range(COUNT):
        for camera, single in enumerate(alone(room, i, **options)):
            check_same(batch, i, camera, single)
    assert len({batch["beauty"][i].tobytes() for i in range(COUNT)}) == COUNT
    assert batch.revision == room.revision == revision and batch.samples == SPP


def test_label_columns_are_those_of_all_pictures(room):
    batch = room.render_worlds(CAMERAS, the_worlds(room), planes=["depth"], labels=True)
    labels = batch.labels
    worlds = labels["world"].reshape(-1)
    assert (np.diff(worlds) >= 0).all() and set(labels["camera"]) == {0, 1}
    for i in range(COUNT):
        mine = (worlds == i) & (labels["camera"] == 1)
        assert len(set(labels["label"][mine])) == mine.sum()
        names = [name for name, is_in in zip(labels["name"], mine, strict=True) if is_in]
        assert ("more" in names) == (i == 5) and ("ball/1" in names) == (i != 5)
    tops = labels["keypoint_world"]
    assert [int((tops == i).sum()) for i in range(COUNT)] == [6] * COUNT  # world 5: "more" instead
    where = labels["world_from_object"][(worlds == 6) & (labels["camera"] == 0)]
    assert np.isclose(where[:, 0, 3], 0.3 - 0.7).any()


def test_a_mask_renders_some(room):
    mask = np.zeros(COUNT, bool)
    mask[[1, 4, 6]] = True
    worlds = the_worlds(room)
    full = room.render_worlds("cam", worlds, planes=PLANES, spp=SPP, seed=SEED)
    some = room.render_worlds("cam", worlds, mask=mask, planes=PLANES, spp=SPP, seed=SEED)
    assert some.worlds.tolist() == [1, 4, 6] and some["beauty"].shape == (3, 1, 24, 40, 4)
    for plane in PLANES:
        assert np.array_equal(some[plane], full[plane][mask], equal_nan=True)
    assert some.seeds.tolist() == full.seeds[mask].tolist()


def test_worlds_do_not_share_their_noise(room):
    batch = room.render_worlds("cam", hg.Worlds(5), planes=["beauty", "depth"], spp=1)
    assert len({picture.tobytes() for picture in batch["depth"]}) == 1
    noise = batch["beauty"][:, 0, ..., :3] - batch["beauty"][:, 0, ..., :3].mean(axis=0)
    between = np.corrcoef(noise.reshape(5, -1))
    assert np.abs(between[~np.eye(5, dtype=bool)] + 1 / 4).max() < 0.1  # about their own mean


def test_the_overlay_of_the_call_is_every_worlds(room):
    with room.overlay() as common:
        common.material("paint", base_color=(0, 0, 0.9))
        common.advance(0.1)
    worlds = hg.Worlds(2).set_transforms(BALLS, MATRICES[:2])
    options = {"planes": ["base_color", "flow_backward"], "overlay": common}
    batch = room.render_worlds("cam", worlds, **options)
    for i in range(2):
        with room.overlay() as overlay:
            overlay.material("paint", base_color=(0, 0, 0.9))
            overlay.advance(0.1)
            overlay.set_transforms(BALLS, MATRICES[i])
        single = room.render("cam", planes=options["planes"], overlay=overlay)
        assert batch["base_color"][i, 0].tobytes() == single["base_color"].tobytes()
        assert batch["flow_backward"][i, 0].tobytes() == single["flow_backward"].tobytes()
    assert np.abs(batch["flow_backward"][1]).max() > 0.5


def test_planes_travel_as_f16_too(room):
    worlds = the_worlds(room)
    options = {"planes": ["beauty", "depth"], "spp": SPP, "seed": SEED}
    full = room.render_worlds("cam", worlds, **options)
    half = room.render_worlds("cam", worlds, half=["beauty"], **options)
    assert half["beauty"].dtype == np.float16
    assert np.array_equal(half["beauty"], full["beauty"].astype(np.float16))
    assert np.array_equal(half["depth"], full["depth"])


# ---------------------------------------------------------------- the rest of the house


def test_a_manifest_renders_all_again(room):
    worlds = the_worlds(room)
    batch = room.render_worlds(CAMERAS, worlds, planes=PLANES, spp=SPP, seed=SEED)
    assert json.loads(batch.manifest)["worlds"] == str(COUNT)
    again = room.rerender(batch.manifest)
    assert again.sha256 == batch.sha256 and again.worlds.tolist() == batch.worlds.tolist()
    many = hg.Worlds(400).set_transforms(BALLS, np.tile(MATRICES[:1], (400, 1, 1, 1)))
    large = room.render_worlds("cam", many, planes=["depth"], size=(4, 4))
    with pytest.raises(hg.InvalidArgument, match="worlds were too large"):
        room.rerender(large.manifest)


def test_a_manifest_serves_a_scene_file(room, client, tmp_path):
    batch = room.render_worlds("cam", the_worlds(room), planes=["depth"], seed=SEED)
    room.save(tmp_path / "scene.helio")
    with client.load_scene(tmp_path / "scene.helio") as loaded:
        assert np.array_equal(loaded.rerender(batch.manifest)["depth"], batch["depth"])


def test_names_of_handles_groups_and_asyncio(room):
    async def twin():
        async with await aio.connect() as client:
            scene = await client.create_scene()
            async with scene.edit() as edit:
                mesh = edit.mesh("m", **hg.shapes.sphere(0.5))
                group = edit.instances("b", mesh=mesh, transforms=rows(), label="auto")
                lens = hg.Camera.from_fov(1, 16, 16)
                edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0)))
            worlds = hg.Worlds(4).set_transforms(group, MATRICES[:4])
            return await scene.render_worlds("cam", worlds, planes=["instance"])

    batch = asyncio.run(twin())
    assert batch["instance"].shape == (4, 1, 16, 16)
    assert len({picture.tobytes() for picture in batch["instance"]}) == 4


def test_items_of_a_batch_may_have_worlds(room):
    jobs = []
    for i in range(4):
        poses = np.tile(rows(0.1 * i), (COUNT, 1, 1, 1))
        moved = hg.Worlds(COUNT).set_transforms(BALLS, poses)
        jobs.append(hg.Job("cam", worlds=moved, planes=["depth"], tag=i))
    none = [0] * COUNT
    jobs.append(hg.Job("cam", worlds=hg.Worlds(COUNT), mask=none, planes=["depth"], tag="none"))
    found = {result.tag: result for result in room.render_batch(jobs)}
    assert found["none"].error.field == "job.worlds.mask"
    for i in range(4):
        single = room.render_worlds("cam", jobs[i].worlds, planes=["depth"])
        assert np.array_equal(found[i].frame["depth"], single["depth"])


def test_a_stream_has_no_worlds(room):
    settings = call.make_request(room, ["cam"], {"planes": ["depth"]})
    settings.worlds.count = 2
    requests = iter([service.StreamRequest(settings=settings)])
    with pytest.raises(hg.InvalidArgument) as raised:
        list(room.client.connection.stream("Stream", requests))
    assert raised.value.field == "settings.worlds"


def small(client):
    """A scene with three balls "b" before a camera "cam"; the balls."""
    scene = client.create_scene()
    with scene.edit() as edit:
        mesh = edit.mesh("m", **hg.shapes.sphere(0.5))
        balls = edit.instances("b", mesh=mesh, transforms=rows(), label="auto")
        lens = hg.Camera.from_fov(1, 64, 64)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0)))
    return scene, balls


def many_worlds(balls):
    """Poses of 80 KB: they go by shared memory."""
    poses = np.tile(MATRICES, (60, 1, 1, 1))
    return hg.Worlds(len(poses)).set_transforms(balls, poses)


def test_planes_lie_in_shared_memory_and_have_the_bytes_of_those_that_travel(monkeypatch):
    def look(client):
        scene, balls = small(client)
        return scene.render_worlds("cam", many_worlds(balls), planes=["depth", "instance"])

    with hg.connect() as client:
        shared = look(client)
        assert client.connection.link.shared._maps
    monkeypatch.setattr(_shared, "CAPABILITY", "none of these")
    with hg.connect() as other:
        assert look(other).sha256 == shared.sha256
    assert shared["depth"].shape == (60 * COUNT, 1, 64, 64)


def test_a_session_with_worlds_is_recorded_and_replayed(recorded):
    daemon = recorded()
    with hg.connect(daemon.socket) as client:
        scene, balls = small(client)
        few = hg.Worlds(COUNT).set_transforms(balls, MATRICES)
        scene.render_worlds("cam", few, planes=["beauty", "instance"], spp=2)
        scene.render_worlds("cam", many_worlds(balls), planes=["depth"])
        with pytest.raises(hg.InvalidArgument):
            scene.render_worlds("cam", few, planes=["beauty"], noise=0.5)
    daemon.stop()
    found = played(daemon.recording)
    assert found[DIFFERS] == found[NOT_PLAYED] == []
    assert sum("Render" in line for line in found[SAME]) == 3


def test_a_call_that_is_cancelled_ends_within_a_slice(room):
    cancels = []
    timer = threading.Timer(0.3, lambda: cancels[0]())
    timer.start()
    with pytest.raises(hg.Cancelled):
        room.render_worlds(
            "cam", hg.Worlds(4000), planes=["beauty"], spp=64, on_start=cancels.append
        )
    timer.join()
    assert room.render_worlds("cam", hg.Worlds(2), planes=["depth"]).worlds.size == 2


def test_progress_counts_all_pictures(room):
    reports = []
    room.render_worlds("cam", hg.Worlds(200), planes=["beauty"], spp=16, progress=reports.append)
    shares = [progress.done for progress in reports]
    assert shares == sorted(shares) and shares[-1] == 1 and len([s for s in shares if s < 0.9]) > 1
