"""Randomizers that place things and cameras: nothing intersects, everything rests on its surface,
what is looked at is in view, and the same numbers give the same edits."""

import shutil
from pathlib import Path

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from drawing import drawn, meeting, same, seen, vertices
from heliograph import cli

BOLT = Path(__file__).parents[2] / "examples/assets/bolt/bolt.glb"
COUNT = 8
README = """
with hg.connect() as client, client.create_scene("demo") as scene:
    with scene.edit() as edit:
        edit.sample_studio()
        cam  = edit.entity("cam", camera=hg.Camera.from_fov(60, 64, 48, degrees=True))
        bolt = edit.import_file("bolt.glb", category="bolt", count=12)
    rand = hd.Compose(
        hd.scatter(bolt, on="floor"), hd.orbit(cam, bolt, distance=(.4, 1)), hd.random_dome())
    hd.generate(scene, cam, rand, count=4, spp=1, seed=0, writer=hd.Coco("out"))
assert hd.validate("out").ok
"""


@pytest.fixture(scope="module")
def stage(client):
    """A floor, bolts on a table, a wall, tori, and a camera."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            edit.mesh("cube", **hg.shapes.cube())
            edit.mesh("square", **hg.shapes.plane(1.0))
            table = hg.Pose((3, 0, 0.4), euler=(0.1, 0, 0.5), scale=(0.6, 0.4, 0.02))
            edit.entity("table", mesh="cube", transform=table, label=0)
            wall = hg.Pose((0.1, 0, 0.1), scale=(0.05, 2, 0.2))
            edit.entity("wall", mesh="cube", transform=wall, label=0)
            edit.mesh("torus", **hg.shapes.torus(0.05, 0.02, segments=24))
            eye = np.tile(np.eye(4), (COUNT, 1, 1))
            edit.instances("ring", mesh="torus", transforms=eye, category="ring")
            edit.bolts = edit.import_file(BOLT, category="bolt", count=COUNT)
            lens = hg.Camera.from_fov(60, 64, 48, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((1, 1, 1), (0, 0, 0)))
        yield scene, edit.bolts.roots, [scene[f"ring/{i}"] for i in range(COUNT)]


def test_the_first_ten_lines_of_the_guide(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(BOLT, "bolt.glb")
    exec(README, {"hg": hg, "hd": hd})
    assert len(list(tmp_path.glob("out/images/*.png"))) == 4
    assert cli.main(["rerender", "out/000003"]) == 0  # the dome's texels are kept with it


@pytest.mark.parametrize("upright", [True, False])
def test_scattered_things_rest_on_the_floor_and_never_meet(stage, upright):
    scene, _, rings = stage
    randomizer = hd.scatter(rings, on="floor", upright=upright, radius=0.3)
    for index in range(3):
        draw = drawn(scene, "cam", randomizer, index)
        with seen(scene, draw) as branch:
            assert meeting(branch, rings, ["floor"]) == 0
        for ring in rings:
            points, pose = vertices(draw, ring), draw.pose(ring)
            assert 0 < points[:, 2].min() < 1e-4
            middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
            assert np.linalg.norm(middle[:2]) <= 0.3
            assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-6)
            assert np.isclose(pose[2, 2], 1) == upright


def test_a_table_that_leans_carries_things_whole_and_clear_of_the_rest(stage):
    scene, bolts, _ = stage
    randomizer = hd.scatter(bolts, on="table", radius=np.inf, spacing=0.02)
    draw = drawn(scene, "cam", randomizer)
    table = scene["table"].world_transform.astype("f8")
    normal = table[:3, 2] / np.linalg.norm(table[:3, 2])
    top = (table @ (0, 0, 0.5, 1))[:3]
    boxes = []
    for bolt in bolts:
        points = vertices(draw, bolt)
        heights = (points - top) @ normal
        assert 0 < heights.min() < 1e-4
        local = (np.linalg.inv(table) @ np.column_stack([points, np.ones(len(points))]).T)[:2]
        assert np.abs(local).max() < 0.5  # nothing hangs over the edge
        assert np.isclose(draw.pose(bolt)[:3, 2] @ normal, 1, atol=1e-6)
        boxes.append((points.min(axis=0), points.max(axis=0)))
    for i, (low, high) in enumerate(boxes):
        for other_low, other_high in boxes[:i]:
            gap = np.maximum(0, np.maximum(low - other_high, other_low - high))
            assert np.linalg.norm(gap) >= 0.02


def test_things_keep_clear_of_what_they_are_to_avoid(stage):
    scene, _, rings = stage
    options = {"around": (0.1, 0, 0), "radius": 0.3}
    with seen(scene, drawn(scene, "cam", hd.scatter(rings, on="floor", **options))) as branch:
        assert branch.overlaps(rings, ["wall"]).any()
    randomizer = hd.scatter(rings, on="floor", avoid="wall", **options)
    with seen(scene, drawn(scene, "cam", randomizer)) as branch:
        assert meeting(branch, rings, ["floor", "wall"]) == 0


def test_scatter_sees_what_was_moved_before_it(stage):
    """The floor is lifted, the wall taken away, in the same draw."""
    scene, _, rings = stage

    def rearrange(draw):
        draw.place(["floor", "wall"], [hg.Pose((0, 0, 1)), hg.Pose((9, 9, 9))])

    scatter = hd.scatter(rings, on="floor", avoid="wall", radius=0.25)
    draw = drawn(scene, "cam", hd.Compose(rearrange, scatter))
    assert all(1 < vertices(draw, ring)[:, 2].min() < 1 + 1e-4 for ring in rings)
    assert any(np.abs(draw.pose(ring)[0, 3] - 0.1) < 0.025 for ring in rings)  # where the wall was


def test_no_room_is_an_error_that_says_so(stage):
    scene, _, rings = stage
    with pytest.raises(hg.ResourceExhausted, match="found no free place in 5 tries"):
        drawn(scene, "cam", hd.scatter(rings, on="floor", radius=0.01, tries=5))
    with pytest.raises(hg.ResourceExhausted, match="never stood whole"):
        drawn(scene, "cam", hd.scatter("wall", on="table", tries=5))
    drawn(scene, "cam", hd.scatter("wall", on="table", overhang=True))
    with pytest.raises(hg.InvalidArgument, match="things: .* has no mesh"):
        drawn(scene, "cam", hd.scatter("cam", on="floor"))
    with pytest.raises(hg.NotFound, match="flor"):
        drawn(scene, "cam", hd.scatter(rings, on="flor"))


def test_things_fill_a_volume_without_meeting(stage):
    scene, _, rings = stage
    low, high = np.array([0, 0, 1.0]), np.array([0.25, 0.25, 1.2])
    draw = drawn(scene, "cam", hd.in_volume(rings, (low, high)))
    with seen(scene, draw) as branch:
        assert meeting(branch, rings) == 0
    for ring in rings:
        points = vertices(draw, ring)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        assert (middle > low - 1e-6).all() and (middle < high + 1e-6).all()
    together = drawn(scene, "cam", hd.in_volume(rings, (low, low), apart=False, rotate=False))
    assert np.allclose([together.pose(ring)[:3, 3] for ring in rings], low)


def test_a_shell_holds_what_is_put_into_it(stage):
    scene, _, rings = stage
    randomizer = hd.shell(rings, "table", radius=(1, 2), elevation=(0.5, 1.0))
    draw = drawn(scene, "cam", randomizer)
    middle = scene["table"].aabb.mean(axis=0)
    away = np.array([draw.pose(ring)[:3, 3] for ring in rings]) - middle
    distance = np.linalg.norm(away, axis=1)
    assert (distance > 1 - 1e-6).all() and (distance < 2 + 1e-6).all()
    assert (np.arcsin(away[:, 2] / distance) > 0.5 - 1e-6).all()


def test_an_orbit_looks_at_the_middle_of_its_target(stage):
    scene, _, rings = stage
    ring = rings[0]
    place = hd.scatter(ring, on="table", radius=0.1)
    for index in range(5):
        orbit = hd.orbit("cam", ring, distance=(0.4, 0.6), elevation=(0.3, 1.2), roll=(-1, 1))
        draw = drawn(scene, "cam", hd.Compose(place, orbit), index)
        points = vertices(draw, ring)
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        camera = draw.pose("cam")
        away = camera[:3, 3] - middle
        assert 0.4 <= np.linalg.norm(away) <= 0.6
        assert np.allclose(camera[:3, 2], away / np.linalg.norm(away), atol=1e-6)
        assert 0.3 <= np.arcsin(camera[2, 2]) <= 1.2
        with seen(scene, draw) as branch:
            assert branch.visible("cam", [ring])["share"][0] > 0.9


def test_a_jittered_look_stays_where_it_is_and_near_its_target(stage):
    scene, _, _ = stage
    for index in range(5):
        draw = drawn(scene, "cam", hd.look_at_jitter("cam", (0, 0, 0), offset=0.2), index)
        camera = draw.pose("cam")
        assert np.allclose(camera[:3, 3], (1, 1, 1))
        miss = np.linalg.norm(np.cross(camera[:3, 2], camera[:3, 3]))
        assert 0 < miss <= 0.2


def test_lights_are_behind_the_camera(stage):
    scene, _, _ = stage
    numbers = set()
    for index in range(12):
        draw = drawn(scene, "cam", hd.random_lights((2, 4), distance=(1, 2), angle=1.2), index)
        with seen(scene, draw) as branch:
            lights = branch.find("random/light/*")
            numbers.add(len(lights))
            camera = branch["cam"].world_transform
            for light in lights:
                away = light.world_transform[:3, 3] - camera[:3, 3]
                distance, made = np.linalg.norm(away), light.light
                assert 1 <= distance - made.radius <= 2
                assert np.arccos(away @ camera[:3, 2] / distance) <= 1.2 + 1e-6
                assert 30 <= made.power <= 300 and 2500 <= made.temperature <= 9000
    assert numbers == {2, 3, 4}


def test_domes_come_from_the_package_a_folder_or_a_list(stage, tmp_path):
    scene, _, _ = stage
    assert {path.stem for path in hd.bundled_domes()} >= {"forest", "interior", "studio"}
    names = set()
    for index in range(8):
        draw = drawn(scene, "cam", hd.random_dome(), index)
        with seen(scene, draw) as branch:
            names.update(texture.name for texture in branch.find("dome/*"))
    assert len(names) > 3
    for images in (tmp_path, []):
        with pytest.raises(hg.InvalidArgument, match="at least one"):
            hd.random_dome(images)
    with pytest.raises(hg.NotFound, match="no file"):
        hd.random_dome(["nowhere.hdr"])
    mine = np.ones((4, 8, 3), "f4")
    assert same(
        drawn(scene, "cam", hd.random_dome([mine])), drawn(scene, "cam", hd.random_dome([mine]))
    )


@pytest.mark.parametrize(
    "make",
    [
        lambda rings: hd.scatter(rings, on="floor", upright=False),
        lambda rings: hd.in_volume(rings, ((0, 0, 1), (1, 1, 2))),
        lambda rings: hd.shell(rings, (0, 0, 1), radius=1),
        lambda rings: hd.orbit("cam", rings, distance=(1, 2)),
        lambda rings: hd.look_at_jitter("cam", rings, offset=0.1),
        lambda rings: hd.random_dome(),
        lambda rings: hd.random_lights(),
    ],
)
def test_a_draw_is_pure_in_its_seed_and_index(stage, make):
    scene, _, rings = stage
    once, again = (drawn(scene, "cam", make(rings), 3) for _ in range(2))
    assert once.edit.transaction.edits and same(once, again)
    assert not same(once, drawn(scene, "cam", make(rings), 4))
    assert not same(once, drawn(scene, "cam", make(rings), 3, seed=6))
