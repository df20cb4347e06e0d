"""scene.stream: a live picture that follows the scene and its settings."""

import asyncio
import time

import heliograph as hg
import pytest
from heliograph._wire import access

SPP = 64


@pytest.fixture
def stage(scene):
    """A ball under the studio, a camera "cam"."""
    with scene.edit() as edit:
        edit.sample_studio()
        mesh = edit.mesh("mesh", **hg.shapes.sphere(0.5))
        edit.entity("ball", mesh=mesh, transform=hg.Pose((0, 0, 0.5)), label="auto")
        lens = hg.Camera.from_fov(50, 48, 32, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 1), (0, 0, 0.5)))
    return scene


def move(scene, x):
    with scene.edit() as edit:
        edit.entity("ball", transform=hg.Pose((x, 0, 0.5)))
    return edit.revision


def overlay(scene, x):
    with scene.overlay() as o:
        o.entity("ball", transform=hg.Pose((x, 0, 0.5)))
    return o


def until_final(live, revision):
    """The frames up to the last one of a revision."""
    frames = []
    for frame in live:
        frames.append(frame)
        if frame.is_final and frame.revision >= revision:
            return frames
    raise AssertionError("the stream ended")


def test_frames_are_refined_and_end_as_render_would(stage):
    with stage.stream("cam", spp=SPP, seed=3) as live:
        frames = until_final(live, 1)
    samples = [frame.samples for frame in frames]
    assert samples == sorted(set(samples)) and samples[-1] == SPP
    single = stage.render("cam", spp=SPP, seed=3)
    assert frames[-1]["beauty"].tobytes() == single["beauty"].tobytes()


def test_it_follows_the_scene(stage):
    with stage.stream("cam", spp=SPP) as live:
        until_final(live, stage.revision)
        for x in (0.2, 0.4, 0.6):
            revision = move(stage, x)
            frames = until_final(live, revision)
            revisions = [frame.revision for frame in frames]
            assert revisions == sorted(revisions) and revisions[-1] == revision
            single = stage.render("cam", spp=SPP)
            assert frames[-1]["beauty"].tobytes() == single["beauty"].tobytes()


def test_refinement_starts_again_at_a_new_revision(stage):
    """Every edit interrupts an endless job's work, and the newest one is shown."""
    with stage.stream("cam", spp=1 << 20) as live:
        assert next(live).revision == stage.revision
        revisions = [move(stage, 0.1 * i) for i in range(5)]
        for frame in live:
            assert not frame.is_final
            if frame.revision == revisions[-1]:
                break


def test_a_fixed_revision_stays(stage):
    with stage.stream("cam", spp=4, revision=stage.revision) as live:
        first = until_final(live, 1)[-1].revision
        move(stage, 1)
        live.update(seed=5)
        assert until_final(live, 1)[-1].revision == first


def test_settings_change_while_it_runs(stage):
    with stage.stream("cam", spp=1 << 20, planes=["beauty"]) as live:
        next(live)
        live.update(overlay=overlay(stage, 0.7), planes=["depth"], spp=1)
        for frame in live:
            if "depth" in frame:
                break
    single = stage.render("cam", overlay=overlay(stage, 0.7), planes=["depth"])
    assert frame["depth"].tobytes() == single["depth"].tobytes()
    assert stage.revision == frame.revision


def test_lossless_answers_each_update_in_order(stage):
    xs = [0.1 * i for i in range(12)]
    with stage.stream(
        "cam", policy="lossless", planes=["depth"], overlay=overlay(stage, xs[0])
    ) as live:
        for x in xs[1:]:
            live.update(overlay=overlay(stage, x))
        live.finish()
        frames = list(live)
    assert len(frames) == len(xs)
    for x, frame in zip(xs, frames, strict=True):
        single = stage.render("cam", overlay=overlay(stage, x), planes=["depth"])
        assert frame["depth"].tobytes() == single["depth"].tobytes()


def test_latest_drops_what_nobody_waited_for(stage):
    with stage.stream("cam", spp=1, credits=1) as live:
        next(live)
        for i in range(200):
            live.update(seed=i)
        live.finish()
        seeds = [frame.seed for frame in live]
    assert seeds[-1] == 199 and len(seeds) < 200 and seeds == sorted(seeds)


def test_endless_streams_leave_room_for_each_other_and_for_renders(stage):
    with stage.stream("cam", spp=1 << 20) as a, stage.stream("cam", spp=1 << 20) as b:
        assert next(a).samples == next(b).samples == 1
        stage.render("cam", spp=1)
        assert not next(a).is_final and not next(b).is_final


def test_each_camera_is_shown(stage):
    with stage.edit() as edit:
        lens = hg.Camera.from_fov(50, 16, 16, degrees=True)
        edit.entity("side", camera=lens, transform=hg.look_at((3, 0, 1), (0, 0, 0.5)))
    with stage.stream(["cam", "side"], spp=4) as live:
        live.finish()
        cameras = {frame.camera for frame in live if frame.is_final}
    assert cameras == {"cam", "side"}


def test_errors_end_it(stage):
    with stage.stream("nobody", spp=1) as live, pytest.raises(hg.NotFound) as error:
        next(live)
    assert error.value.field == "settings.cameras[0]"
    with pytest.raises(hg.InvalidArgument, match="policy"):
        stage.stream("cam", policy="all")
    with stage.stream("cam", spp=1) as live:
        until_final(live, 1)
        with stage.edit() as edit:
            edit.remove("cam")
        with pytest.raises(hg.NotFound):
            next(live)


def test_it_ends_with_its_scene(stage):
    with stage.branch() as branch, branch.stream("cam", spp=1) as live:
        until_final(live, 1)
        branch.delete()
        with pytest.raises(hg.NotFound):
            next(live)


def test_a_reader_that_takes_nothing_is_closed(monkeypatch):
    # Else a connection may take more and more, on a busy machine all of a frame.
    monkeypatch.setattr(access, "_OPTIONS", (*access._OPTIONS, ("grpc.http2.bdp_probe", 0)))
    limits = ["--limit", "stall_seconds=1", "--limit", "shared_bytes=1"]
    with hg.connect(arguments=limits) as client, client.create_scene() as s:
        with s.edit() as edit:
            edit.dome(color=(1, 1, 1))
            edit.entity("cam", camera=hg.Camera.from_fov(50, 64, 48, degrees=True))
        with s.stream("cam", spp=1 << 14, credits=1) as live:
            assert not next(live).is_final  # the next one waits for its credit
            time.sleep(3)
            with pytest.raises(hg.ResourceExhausted, match="stall_seconds"):
                list(live)
        with s.stream("cam", spp=1, size=(512, 512)) as live:
            next(live)
            live.update(seed=1)  # more than fits into the connection, and nobody reads
            time.sleep(3)
            live.finish()
            with pytest.raises(hg.Unavailable, match="not read"):
                list(live)
        with s.stream("cam", spp=1) as idle:  # nothing waits for it: it may stay
            until_final(idle, 1)
            time.sleep(3)
            with s.edit() as edit:
                edit.dome(color=(1, 0, 0))
            until_final(idle, edit.revision)


def test_async(stage):
    async def main():
        async with await hg.aio.connect(stage.client.address) as client:
            (scene,) = [s for s in await client.scenes() if s.id == stage.id]
            async with scene.stream("cam", spp=4) as live:
                live.finish()
                return [frame.samples async for frame in live]

    assert asyncio.run(main())[-1] == 4
