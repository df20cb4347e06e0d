"""Refusals of render_worlds: the error names the world and the field, and nothing is published."""

import heliograph as hg
import numpy as np
import pytest
from replicas import BALLS, CAMERAS, COUNT, MATRICES


def refused(room, worlds, error, field, **options):
    revision = room.revision
    options = {"planes": ["depth"], **options}
    with pytest.raises(error) as raised:
        room.render_worlds(options.pop("cameras", "cam"), worlds, **options)
    assert raised.value.field == field
    assert room.revision == revision
    return str(raised.value)


def overlaid(room, world, change, count=COUNT):
    with room.overlay() as overlay:
        change(overlay)
    worlds = hg.Worlds(count)
    worlds[world] = overlay
    return worlds


@pytest.mark.parametrize(
    ("change", "error", "field"),
    [
        (lambda o: o.update("nobody", visible=True), hg.NotFound, "[3].edits[0].target"),
        (lambda o: o.material("paint", metallic=7), hg.InvalidArgument, None),
        (lambda o: o.entity("x", mesh="lamp"), hg.InvalidArgument, "[3].edits[0].entity.mesh"),
        (lambda o: o.advance(1), hg.InvalidArgument, "[3]"),
        (lambda o: o.time(3), hg.InvalidArgument, "[3]"),
        (lambda o: o.entity("x", mesh="mesh", category="new"), hg.InvalidArgument, "[3]"),
    ],
)
def test_what_is_wrong_with_one_world_names_it(room, change, error, field):
    worlds = overlaid(room, 3, change)
    where = "worlds.overlays" + (field or "[3].edits[0].material.metallic.value")
    refused(room, worlds, error, where)


def test_a_world_without_the_camera_is_named(room):
    text = refused(room, overlaid(room, 4, lambda o: o.remove("cam")), hg.NotFound, "cameras[0]")
    assert "in world 4" in text
    lens = hg.Camera.from_fov(50, 41, 24, degrees=True)
    worlds = overlaid(room, 2, lambda o: o.update("side", camera=lens))
    text = refused(room, worlds, hg.InvalidArgument, "cameras[1]", cameras=CAMERAS)
    assert "in world 2" in text and "41 x 24" in text
    assert room.render_worlds(CAMERAS, worlds, planes=["depth"], size=(8, 8)).worlds.size == COUNT


def test_poses_are_checked_by_world_and_entity(room):
    bad = MATRICES.copy()
    bad[5, 1, 0, 0] = 0
    worlds = hg.Worlds(COUNT).set_transforms(BALLS, bad)
    refused(room, worlds, hg.InvalidArgument, "worlds.poses.matrices[5][1]")
    worlds = hg.Worlds(COUNT).set_transforms(["ball/0", "nobody", "ball/2"], MATRICES)
    refused(room, worlds, hg.NotFound, "worlds.poses.entities[1]")
    with pytest.raises(hg.InvalidArgument, match="needs shape"):
        hg.Worlds(COUNT).set_transforms(BALLS, MATRICES[:, :2])
    with pytest.raises(hg.InvalidArgument, match="finite"):
        hg.Worlds(1).set_transforms("ball/0", np.full((1, 1, 4, 4), np.nan))


def test_what_does_not_go_with_worlds_is_refused(room):
    worlds = hg.Worlds(3)
    for field, options in {
        "seconds": {"seconds": 1.0},
        "noise": {"noise": 0.1},
        "adaptive": {"adaptive": True, "spp": 32},
        "progressive": {"on_pass": print, "spp": 4},
    }.items():
        refused(room, worlds, hg.InvalidArgument, field, **{**options, "planes": ["beauty"]})
    refused(room, worlds, hg.InvalidArgument, "worlds.mask", mask=[0, 0, 0])
    text = refused(
        room,
        worlds,
        hg.ResourceExhausted,
        "labels.max_rows",
        labels={"boxes": True, "max_rows": 5},
    )
    assert "rows" in text
    with pytest.raises(hg.InvalidArgument) as raised:
        room.render_worlds("cam", worlds, mask=[1, 0])
    assert raised.value.field == "mask"


def test_limits_are_refused():
    with hg.connect(arguments=["--limit", "worlds=4", "--limit", "frame_bytes=20000"]) as client:
        with client.create_scene() as scene:
            with scene.edit() as edit:
                edit.entity("cam", camera=hg.Camera.from_fov(1, 32, 32))
            with pytest.raises(hg.ResourceExhausted) as raised:
                scene.render_worlds("cam", hg.Worlds(5), planes=["depth"])
            assert raised.value.field == "worlds.count"
            assert (raised.value.needed, raised.value.available) == (5, 4)
            assert scene.render_worlds("cam", hg.Worlds(4), planes=["depth"])["depth"].size == 4096
            with pytest.raises(hg.ResourceExhausted, match="frame_bytes") as raised:
                scene.render_worlds("cam", hg.Worlds(4), planes=["depth", "distance"])
            assert raised.value.needed == 4 * 2 * 4096
            some = scene.render_worlds(
                "cam", hg.Worlds(4), planes=["depth", "distance"], mask=[1, 0, 0, 1]
            )
            assert some.worlds.tolist() == [0, 3]
