"""scene.render_batch: items are independent, tagged, and publish nothing."""

import asyncio

import heliograph as hg
import numpy as np
import pytest

PLANES = ["beauty", "depth", "instance"]


@pytest.fixture(scope="module")
def stage(client):
    """A ball under the studio, a camera "cam" and a second one "side"."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            mesh = edit.mesh("mesh", **hg.shapes.sphere(0.5))
            edit.entity("ball", mesh=mesh, transform=hg.Pose((0, 0, 0.5)), label="auto")
            lens = hg.Camera.from_fov(50, 48, 32, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0.5)))
            edit.entity("side", camera=lens, transform=hg.look_at((3, 0, 1), (0, 0, 0.5)))
        yield scene


def moved(scene, x):
    with scene.overlay() as overlay:
        overlay.entity("ball", transform=hg.Pose((x, 0, 0.5)))
    return overlay


def same(a, b):
    return all(a[plane].tobytes() == b[plane].tobytes() for plane in PLANES)


def test_each_item_is_the_frame_that_render_gives(stage):
    revision = stage.revision
    xs = np.linspace(-1, 1, 9)
    jobs = [
        hg.Job("cam", overlay=moved(stage, x), planes=PLANES, spp=4, seed=i, tag=("ball", i))
        for i, x in enumerate(xs)
    ]
    found = {result.tag: result for result in stage.render_batch(jobs, credits=3)}
    assert set(found) == {("ball", i) for i in range(len(xs))}
    for i, x in enumerate(xs):
        single = stage.render("cam", overlay=moved(stage, x), planes=PLANES, spp=4, seed=i)
        assert same(found[("ball", i)].frame, single)
        assert found[("ball", i)].frame.revision == revision
    assert stage.revision == revision


def test_the_frames_of_an_item_are_in_the_order_of_its_cameras(stage):
    job = hg.Job(["side", "cam"], planes=["depth"], tag="pair")
    (result,) = stage.render_batch([job])
    assert [frame.camera for frame in result.frames] == ["side", "cam"]


def test_one_error_does_not_end_the_others(stage):
    jobs = [
        hg.Job("cam", planes=["depth"], tag=0),
        hg.Job("nobody", planes=["depth"], tag=1),
        hg.Job("cam", planes=["depth"], spp=-1, tag=2),  # refused by the client
        hg.Job("cam", planes=["depth"], revision=999, tag=3),
        hg.Job("cam", planes=["depth"], tag=4),
    ]
    found = {result.tag: result for result in stage.render_batch(jobs)}
    assert sorted(found) == [0, 1, 2, 3, 4]
    assert found[0].error is None and found[4].error is None
    assert isinstance(found[1].error, hg.NotFound)
    assert found[1].error.field == "job.cameras[0]"
    assert isinstance(found[2].error, hg.InvalidArgument)
    assert isinstance(found[3].error, hg.OutOfRange)
    with pytest.raises(hg.NotFound):
        found[1].frame.image()


def test_items_come_back_as_they_are_done(stage):
    jobs = [
        hg.Job("cam", spp=1000, tag="long"),
        *(hg.Job("cam", planes=["depth"], tag=i) for i in range(5)),
    ]
    tags = [result.tag for result in stage.render_batch(jobs, credits=2)]
    assert tags == [0, 1, 2, 3, 4, "long"]


def test_jobs_are_taken_as_results_are(stage):
    taken = []

    def jobs():
        for i in range(100):
            taken.append(i)
            yield hg.Job("cam", planes=["depth"], tag=i)

    results = stage.render_batch(jobs(), credits=4)
    for _ in range(10):
        next(results)
    assert len(taken) <= 10 + 4
    results.close()
    with pytest.raises(hg.Cancelled):
        list(results)
    stage.render("cam", planes=["depth"])


def test_what_is_not_for_a_batch_is_refused(stage):
    with pytest.raises(hg.InvalidArgument, match="whole batch"):
        hg.Job("cam", timeout=3)
    with pytest.raises(hg.InvalidArgument, match="credits"):
        list(stage.render_batch([hg.Job("cam", spp=1)], credits=1000))
    with pytest.raises(hg.DeadlineExceeded):
        list(stage.render_batch([hg.Job("cam", spp=1 << 20)], timeout=0.2))
    assert list(stage.render_batch([])) == []


def test_async(stage):
    async def main():
        async with await hg.aio.connect(stage.client.address) as client:
            (scene,) = [s for s in await client.scenes() if s.id == stage.id]
            jobs = [hg.Job("cam", planes=["depth"], tag=i) for i in range(4)]
            return [result.tag async for result in scene.render_batch(jobs)]

    assert sorted(asyncio.run(main())) == [0, 1, 2, 3]
