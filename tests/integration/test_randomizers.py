"""Randomizers of looks, distractors, motion, views and physics against a daemon."""

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from drawing import drawn, meeting, same, seen, vertices

COUNT = 6


@pytest.fixture(scope="module")
def stage(client):
    """A floor, boxes, a wall, distractors and a camera."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            edit.mesh("cube", **hg.shapes.cube(0.1))
            edit.material("paint", base_color=0.5)
            poses = [hg.Pose((0.2 * i - 0.5, 0, 0.05)) for i in range(COUNT)]
            boxes = edit.instances(
                "box", mesh="cube", material="paint", transforms=poses, category="box"
            )
            wall = hg.Pose((0, -0.5, 0.3), scale=(20, 0.1, 6))
            edit.entity("wall", mesh="cube", transform=wall, label=0)
            flying = hd.add_distractors(edit, 12)
            lens = hg.Camera.from_fov(60, 64, 48, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((1, 1, 1), (0, 0, 0)))
        yield scene, boxes, flying


def parameters(branch, name):
    return branch[name].materials[0].parameters


def test_things_get_materials_of_their_own(stage):
    scene, boxes, _ = stage
    draw = drawn(scene, "cam", hd.random_materials(boxes, roughness=(0.2, 0.3), ior=1.4))
    with seen(scene, draw) as branch:
        found = [parameters(branch, f"box/{i}") for i in range(COUNT)]
        assert branch["paint"].parameters["base_color"] == (0.5, 0.5, 0.5)
    assert len({row["base_color"] for row in found}) == COUNT
    assert all(0.2 <= row["roughness"] <= 0.3 and np.isclose(row["ior"], 1.4) for row in found)
    assert {row["metallic"] for row in found} <= {0.0, 1.0}


def test_a_shared_material_changes_for_all_and_keeps_what_is_none(stage):
    scene, _, _ = stage
    material = scene["paint"]
    draw = drawn(scene, "cam", hd.random_materials(material, base_color=None, roughness=0.25))
    with seen(scene, draw) as branch:
        found = parameters(branch, "box/0")
        assert found == parameters(branch, "box/1")
        assert found["base_color"] == (0.5, 0.5, 0.5) and found["roughness"] == 0.25


def test_textures_show_on_things(stage):
    scene, boxes, _ = stage
    red = np.full((8, 8, 3), (255, 0, 0), "u1")
    look = hd.orbit("cam", "box/0", distance=0.5)
    draw = drawn(scene, "cam", hd.Compose(hd.random_textures("box/0", [red]), look))
    options = {"overlay": draw.edit, "spp": 1, "planes": ["base_color", "instance"]}
    frame = scene.render("cam", **options)
    label = int(frame.labels["label"][list(frame.labels["name"]).index("box/0")])
    assert np.allclose(frame["base_color"][frame["instance"] == label], (1, 0, 0), atol=1e-3)
    with pytest.raises(hg.InvalidArgument, match="entities or materials"):
        drawn(scene, "cam", hd.random_textures(scene["cube"]))


def test_bundled_textures_are_seamless_and_always_the_same():
    pictures = hd.bundled_textures()
    assert len(pictures) == 27
    image = pictures[18]()
    assert (image == pictures[18]()).all() and image.dtype == np.uint8
    # Across its edges it changes no more than within.
    step = np.abs(np.diff(image.astype(int), axis=0)).mean()
    assert np.abs(image[0].astype(int) - image[-1]).mean() < 2 * step + 1


def test_distractors_keep_clear_of_what_they_are_told_to(stage):
    scene, boxes, flying = stage
    randomizer = hd.distractors(
        flying, "box/2", count=(3, 8), radius=(0.1, 0.8), size=(0.1, 0.2), clear_of=boxes
    )
    counts = set()
    for index in range(6):
        draw = drawn(scene, "cam", randomizer, index)
        with seen(scene, draw) as branch:
            shown = [thing for thing in flying if branch[thing.name].visible]
            assert meeting(branch, shown, boxes) == 0
            frame = branch.render("cam", planes=["instance"])
            assert not any("distractor" in name for name in frame.labels["name"])
        counts.add(len(shown))
        for thing in shown:
            away = np.linalg.norm(draw.pose(thing)[:3, 3] - (-0.1, 0, 0.05))
            assert 0.1 <= away <= 0.8
            assert 0.1 <= np.ptp(vertices(draw, thing), axis=0).max() <= 0.2 * np.sqrt(3)
    assert counts <= set(range(3, 9)) and len(counts) > 2
    with pytest.raises(hg.ResourceExhausted, match="no free place"):
        tight = hd.distractors(flying, (0, 0, 3), count=8, radius=(0, 0.2), size=0.3)
        drawn(scene, "cam", tight)


def test_what_is_asked_for_is_in_view(stage):
    scene, boxes, _ = stage
    inner = hd.orbit("cam", (0.0, -0.3, 0.3), distance=(0.8, 1.5), elevation=(0.0, 0.4))

    def visibilities(draw):
        frame = scene.render("cam", overlay=draw.edit, planes=[], labels=["amodal"])
        table = dict(zip(frame.labels["name"], frame.labels["visibility"], strict=True))
        return [table[f"box/{i}"] for i in range(COUNT)]

    plain = [visibilities(drawn(scene, "cam", inner, index)) for index in range(8)]
    assert sum(min(row) < 0.5 for row in plain) >= 2  # the wall is in the way
    all_ = hd.in_view(inner, boxes, min_visibility=0.5)
    some = hd.in_view(inner, boxes, min_visibility=0.9, least=2)
    for index in range(8):
        draw = drawn(scene, "cam", all_, index)
        assert min(visibilities(draw)) >= 0.5 and len(draw.edit.transaction.edits) == 1
        assert sorted(visibilities(drawn(scene, "cam", some, index)))[-2] >= 0.9
    away = hd.orbit("cam", (0, 9, 9), distance=1)
    with pytest.raises(hg.ResourceExhausted, match="never seen together in 3 tries"):
        drawn(scene, "cam", hd.in_view(away, boxes, tries=3))
    with pytest.raises(hg.InvalidArgument, match="no label"):
        drawn(scene, "cam", hd.in_view(inner, "wall"))


def test_each_try_of_a_composition_has_numbers_of_its_own(stage):
    scene, boxes, _ = stage
    tried, after = [], []

    def nothing(draw):
        tried.append(draw.rng.random())

    inner = hd.orbit("cam", (0.0, -0.3, 0.3), distance=(0.8, 1.5), elevation=(0.0, 0.4))
    look = hd.in_view(hd.Compose(nothing, hd.Compose(inner)), boxes, min_visibility=0.5)
    for first in (nothing, look):
        both = hd.Compose(first, lambda draw: after.append(draw.rng.random()))
        for index in range(8):
            drawn(scene, "cam", both, index)
    assert len(tried) == len(set(tried)) > 16 + 2  # some looks took several tries
    assert after[:8] == after[8:]
    away = hd.Compose(nothing, hd.orbit("cam", (0, 9, 9), distance=1))
    for _ in range(2):
        with pytest.raises(hg.ResourceExhausted, match="in 3 tries"):
            drawn(scene, "cam", hd.in_view(away, boxes, tries=3))
    assert tried[-6:-3] == tried[-3:] and len(set(tried[-3:])) == 3


def test_a_camera_runs_through_its_points_and_looks_at_its_target(stage):
    scene, _, _ = stage
    points = [(2, 0, 1), (0, 2, 1), (-2, 0, 1.5)]
    path = hd.camera_path("cam", points, frames=21, target=(0, 0, 0))
    poses = np.array([drawn(scene, "cam", path, i).pose("cam") for i in range(21)])
    assert np.allclose(poses[[0, -1], :3, 3], [points[0], points[-1]], atol=1e-6)
    assert np.linalg.norm(poses[:, :3, 3] - points[1], axis=1).min() < 0.15
    away = poses[:, :3, 3] / np.linalg.norm(poses[:, :3, 3], axis=1)[:, None]
    assert np.allclose(poses[:, :3, 2], away, atol=1e-6)
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps.max() < 1.05 * steps.min()
    assert np.allclose(drawn(scene, "cam", path, 21).pose("cam"), poses[0])
    closed = hd.camera_path("cam", points, frames=10, loop=True)
    assert np.allclose(closed._at(0), closed._at(1)) and np.allclose(closed._at(0), points[0])


def test_a_camera_path_has_flow_both_ways(stage):
    """A camera that moves sideways at 3 m/s, 2 m from the floor that it looks down at."""
    scene, _, _ = stage
    path = hd.camera_path("cam", [(5, 5, 2), (8, 5, 2)], frames=31, interval=1 / 30)
    path._pose = lambda draw, step: hg.Pose((5 + 0.1 * step, 5, 2)).matrix
    draw = drawn(scene, "cam", path, 10)
    planes = ["flow_forward", "flow_backward"]
    frame = scene.render("cam", overlay=draw.edit, planes=planes, frame_interval=1 / 30, hold=True)
    shift = 0.1 * frame.K[0, 0] / 2
    assert np.allclose(frame["flow_forward"], (-shift, 0), atol=0.02)
    assert np.allclose(frame["flow_backward"], (shift, 0), atol=0.02)


def test_a_hand_shakes_smoothly_as_much_as_it_is_told(stage):
    scene, _, _ = stage
    path = hd.camera_path("cam", [(2, 0, 1), (2.001, 0, 1)], frames=2, handheld=1.0)
    noise = np.array([path._noise(3, i / 30) for i in range(20_000)])
    assert np.abs(noise.mean(axis=0)).max() < 0.05
    assert np.allclose((noise**2).mean(axis=0), 1, atol=0.1)
    assert np.abs(np.diff(noise, axis=0)).max() < 0.6
    still = hd.camera_path("cam", [(2, 0, 1), (0, 2, 1)], frames=9, target=(0, 0, 0))
    shaken = hd.camera_path(
        "cam", [(2, 0, 1), (0, 2, 1)], frames=9, target=(0, 0, 0), handheld=0.01, sway=0.01
    )
    a, b = (drawn(scene, "cam", p, 4).pose("cam") for p in (still, shaken))
    assert 0 < np.linalg.norm(a[:3, 3] - b[:3, 3]) < 0.06
    assert 0 < np.arccos(a[:3, 2] @ b[:3, 2]) < 0.08


def test_motion_ends_at_the_poses_that_were_drawn(stage):
    scene, boxes, _ = stage
    place = hd.scatter(boxes, on="floor", around=(0, 0.5, 0))
    look = hd.orbit("cam", boxes, distance=1.2)
    move = hd.random_motion(boxes, speed=(0.5, 1.0), spin=2.0)
    still = drawn(scene, "cam", hd.Compose(place, look))
    draw = drawn(scene, "cam", hd.Compose(place, look, move))
    assert all(np.allclose(draw.pose(box), still.pose(box)) for box in boxes)
    planes = ["instance", "flow_backward", "flow_backward_valid"]
    frame = scene.render("cam", overlay=draw.edit, planes=planes)
    boxed = np.isin(frame["instance"], frame.labels["label"])
    assert (frame["flow_backward_valid"] == 1).all() and boxed.any()
    flow = np.linalg.norm(frame["flow_backward"], axis=2)
    # 0.5 to 1 m/s and 2 rad/s at 0.1 m, about 1.2 m away, some of it towards the camera.
    pixels = frame.K[0, 0] / 1.2 / 30
    assert 0.3 * pixels < flow[boxed].mean() and flow[boxed].max() < 1.5 * pixels
    assert flow[~boxed].max() < 1e-3


def test_things_fall_and_rest_on_the_floor_without_meeting(stage):
    scene, boxes, _ = stage
    drop = hd.in_volume(boxes, ((-0.15, 0.3, 0.2), (0.15, 0.6, 0.8)))
    settle = hd.settle(boxes, on=["floor", "wall"])
    for index in range(3):
        draw = drawn(scene, "cam", hd.Compose(drop, settle), index)
        heights = [vertices(draw, box)[:, 2].min() for box in boxes]
        assert min(heights) > -1e-4
        assert min(heights) < 1e-3  # one at least lies on the floor itself
        with seen(scene, draw) as branch:
            assert meeting(branch, boxes) == 0
        again = hd.settle(boxes, on=["floor", "wall"], seconds=0.2)
        later = drawn(scene, "cam", hd.Compose(drop, settle, again), index)
        moved = [np.abs(draw.pose(b)[:3, 3] - later.pose(b)[:3, 3]).max() for b in boxes]
        assert max(moved) < 2e-3  # they rest


def test_things_fall_as_fast_as_gravity_has_it(stage):
    scene, boxes, _ = stage
    high = hd.in_volume(boxes, ((-1, 1, 50), (1, 3, 52)))
    for seconds in (0.2, 0.6):
        start = drawn(scene, "cam", hd.Compose(high))
        draw = drawn(scene, "cam", hd.Compose(high, hd.settle(boxes, on="floor", seconds=seconds)))
        for box in boxes:
            fallen = start.pose(box)[2, 3] - draw.pose(box)[2, 3]
            assert np.isclose(fallen, 0.5 * 9.81 * seconds**2, rtol=0.03)


def test_contacts_have_the_friction_and_the_restitution_that_are_asked_for(client):
    """On a slope of 25 degrees, whose tangent is 0.466, and on the floor."""
    slope = hg.Pose((0, 0, 9), euler=(0, np.radians(25), 0)).matrix
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            edit.mesh("cube", **hg.shapes.cube(0.1))
            edit.mesh("square", **hg.shapes.plane(4.0))
            edit.entity("slope", mesh="square", transform=slope)
            on_it = slope @ hg.Pose((0, 0, 0.0501)).matrix
            edit.entity("brick", mesh="cube", transform=on_it)
            edit.entity("die", mesh="cube", transform=hg.Pose((0, 0, 1.05)))
            edit.entity("cam", camera=hg.Camera.from_fov(60, 64, 48, degrees=True))
        for friction, slid in ((0.6, 0.0), (0.35, 0.186)):  # 0.5 g (sin - friction cos) t^2
            settle = hd.settle("brick", on="slope", seconds=0.6, friction=friction)
            now = drawn(scene, "cam", settle).pose("brick")
            assert np.isclose((np.linalg.inv(slope) @ now)[0, 3], slid, atol=2e-3)
        up_again = 1.5 * np.sqrt(2 / 9.81)  # of what fell 1 m and left the floor half as fast
        settle = hd.settle("die", on="floor", seconds=up_again, restitution=0.5)
        bounced = drawn(scene, "cam", settle).pose("die")
        assert np.isclose(bounced[2, 3] - 0.05, 0.25, atol=0.01)


@pytest.mark.parametrize(
    "make",
    [
        lambda boxes, flying: hd.random_materials(boxes),
        lambda boxes, flying: hd.random_textures(boxes, [np.zeros((4, 4, 3), "u1")] * 9),
        lambda boxes, flying: hd.distractors(flying, boxes),
        lambda boxes, flying: hd.in_view(hd.orbit("cam", boxes, distance=1), boxes, least=1),
        lambda boxes, flying: hd.camera_path("cam", [(1, 0, 1), (0, 1, 1)], frames=9, sway=0.1),
        lambda boxes, flying: hd.random_motion(boxes, speed=(0, 1), spin=1),
        lambda boxes, flying: hd.settle(boxes, on="floor", velocity=1, seconds=0.1),
    ],
)
def test_a_draw_is_pure_in_its_seed_and_index(stage, make):
    scene, boxes, flying = stage
    once, again = (drawn(scene, "cam", make(boxes, flying), 3) for _ in range(2))
    assert once.edit.transaction.edits and same(once, again)
    assert not same(once, drawn(scene, "cam", make(boxes, flying), 4))
