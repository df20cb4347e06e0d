"""Portals through the daemon: the same pictures in the mean, with less noise."""

import heliograph as hg
import numpy as np
import pytest

SIZE, SEEDS, SPP = (20, 15), 24, 16
WINDOW = hg.Pose((0.4, 2, 1.5), euler=(-np.pi / 2, 0, 0))  # its z axis points outdoors, to +y
PORTAL = hg.Portal(0.75, 1)  # a little larger than the hole


def sky():
    """(16, 32) lat-long: a bright patch before the window, and one elsewhere."""
    image = np.full((16, 32), 0.3, "f4")
    image[:8] = 1
    image[5, 6], image[4, 22] = 60, 60
    return image


def wall(edit, name, at, size):
    """A box of this size."""
    pose = hg.Pose(at).matrix @ np.diag([*size, 1])
    edit.entity(name, mesh="box", material="paint", transform=pose)


@pytest.fixture(scope="module")
def room(client):
    """A closed room with a window in its +y wall and, if shown, a hole in the roof."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("box", **hg.shapes.cube(1))
            edit.material("paint", base_color=0.6, roughness=0.7)
            edit.dome(sky(), rotation=0.3)
            wall(edit, "floor", (0, 0, -0.05), (4.2, 4.2, 0.1))
            wall(edit, "left", (-2.05, 0, 1.5), (0.1, 4.2, 3.2))
            wall(edit, "right", (2.05, 0, 1.5), (0.1, 4.2, 3.2))
            wall(edit, "back", (0, -2.05, 1.5), (4.2, 0.1, 3.2))
            wall(edit, "below", (0.4, 2.05, 0.5), (0.7, 0.1, 1.1))
            wall(edit, "above", (0.4, 2.05, 2.5), (0.7, 0.1, 1.1))
            wall(edit, "west", (-0.975, 2.05, 1.5), (2.05, 0.1, 3.2))
            wall(edit, "east", (1.375, 2.05, 1.5), (1.25, 0.1, 3.2))
            wall(edit, "roof", (0.3, 0, 3.05), (3.4, 4.2, 0.1))
            wall(edit, "lid", (-1.7, 0, 3.05), (0.6, 4.2, 0.1))
            camera = hg.Camera.from_fov(70, *SIZE, degrees=True)
            edit.entity(
                "inside", camera=camera, transform=hg.look_at((-1.5, -1.7, 1.6), (0.5, 1, 0.9))
            )
            edit.entity("outside", camera=camera, transform=hg.look_at((1, 7, 2), (0, 2, 1.5)))
        yield scene


def frames(scene, camera, overlay=None):
    """(SEEDS, pixels) luminance."""
    out = []
    for seed in range(SEEDS):
        frame = scene.render(camera, spp=SPP, seed=seed, overlay=overlay)
        out.append(frame["beauty"][..., 1].ravel().astype("f8"))
    return np.array(out)


def same_mean(one, other):
    """Means over the image, each frame a sample: |z| below 4.9 (1e-6)."""
    a, b = one.mean(axis=1), other.mean(axis=1)
    error = np.sqrt((a.var(ddof=1) + b.var(ddof=1)) / SEEDS)
    assert abs(a.mean() - b.mean()) < 4.9 * error, (a.mean(), b.mean(), error)


def window(scene, **more):
    with scene.overlay() as lit:
        lit.entity("window", portal=PORTAL, transform=WINDOW)
        for name, shown in more.items():
            lit.update(name, visible=shown)
    return lit


def test_a_room_keeps_its_mean_and_loses_its_noise(room):
    without = frames(room, "inside")
    with_portal = frames(room, "inside", window(room))
    same_mean(without, with_portal)
    ratio = without.var(axis=0).mean() / with_portal.var(axis=0).mean()
    assert ratio > 4, ratio


def test_light_through_other_openings_is_found(room):
    with room.overlay() as open_roof:
        open_roof.update("lid", visible=False)
    same_mean(frames(room, "inside", open_roof), frames(room, "inside", window(room, lid=False)))


def test_outdoors_nothing_changes(room):
    same_mean(frames(room, "outside"), frames(room, "outside", window(room)))


def test_a_portal_is_read_back_and_taken_away(room, client, tmp_path):
    with room.branch() as scene:
        before = scene.render("inside", spp=2)["beauty"]
        with scene.edit() as edit:
            edit.entity("window", portal=PORTAL, transform=WINDOW)
        assert scene["window"].portal == PORTAL
        lit = scene.render("inside", spp=2)["beauty"]
        assert (lit != before).any()
        scene.save(tmp_path / "room.helio")
        with client.load_scene(tmp_path / "room.helio") as again:
            np.testing.assert_array_equal(again.render("inside", spp=2)["beauty"], lit)
        with scene.edit() as edit:
            edit.update("window", portal=None)
        assert scene["window"].portal is None
        np.testing.assert_array_equal(scene.render("inside", spp=2)["beauty"], before)
