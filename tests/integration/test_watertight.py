"""No ray slips through a closed room, and an object that nothing hides is seen whole."""

import heliograph as hg
import numpy as np
import pytest
from oracle import pose


def crumpled_box(n, rng):
    """A closed box of n x n squares a side, 2 m wide, whose vertices lie up to 15 % off."""
    grid = np.stack(np.meshgrid(*[np.arange(n + 1)] * 2, indexing="ij"), -1).reshape(-1, 2)
    corners, squares = [], []
    for axis in range(3):
        for side in (0, n):
            first = len(corners)
            corners += np.insert(grid, axis, side, 1).tolist()
            for i, j in np.ndindex(n, n):
                a = first + i * (n + 1) + j
                squares.append([a, a + 1, a + n + 2, a + n + 1])
    places, numbers = np.unique(corners, axis=0, return_inverse=True)
    positions = (2 * places / n - 1) * (1 + 0.3 * (rng.random((len(places), 1)) - 0.5))
    faces = numbers.reshape(-1)[[[q[0], q[i], q[i + 1]] for q in squares for i in (1, 2)]]
    return {"positions": positions.astype("f4"), "indices": faces.astype("u4")}


def test_no_light_comes_into_a_closed_room(client):
    """Some million rays of pictures and labels, of which a leaky test loses one of a million; those
    at the edges that lie across the pixels' centres are the most likely ones."""
    with client.create_scene() as scene:
        for n in (1, 12):
            with scene.edit() as edit:
                box = edit.mesh("box", **crumpled_box(n, np.random.default_rng(3)))
                black = edit.material("black", base_color=0, specular=0)
                edit.entity("box", mesh=box, material=black)
                edit.dome(color=1e4)
                lens = hg.Camera.from_fov(100, 256, 256, degrees=True)
                eye = hg.look_at((0.013, 0.021, 0.017), (1, 0.3, 0.2))
                edit.entity("cam", camera=lens, transform=eye)
            frame = scene.render("cam", spp=64, planes=["beauty", "coverage"])
            assert (frame["beauty"][..., :3] == 0).all()
            assert (frame["coverage"] == 1).all()
            frame = scene.render("cam", planes=["depth", "instance"], size=(1536, 1536))
            assert np.isfinite(frame["depth"]).all()
            assert (frame["instance"] == 1).all()


def test_what_nothing_hides_is_seen_whole(client):
    rng = np.random.default_rng(5)
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("ball", **hg.shapes.sphere(0.3))
            edit.mesh("plane", **hg.shapes.plane(20))
            for i in range(30):
                turn = np.linalg.qr(rng.normal(size=(3, 3)))[0] @ np.diag(rng.uniform(0.5, 1, 3))
                place = np.eye(4)
                place[:3, :3], place[:3, 3] = turn, (i % 6 - 2.5, i // 6 - 2, 0)
                edit.entity(f"ball {i}", mesh="ball", transform=place)
            edit.entity("wall", mesh="plane", transform=pose((0, 0, -3)))
            lens = hg.Camera.from_fov(45, 2048, 2048, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((0.1, -0.2, 9), (0, 0, 0)))
        labels = scene.render("cam", planes=["instance"], labels=["amodal", "amodal_masks"]).labels
    balls = [name.startswith("ball") for name in labels["name"]]
    assert sum(balls) == 30
    assert (labels["visibility"][balls] == 1).all()
    assert labels["visibility"][~np.array(balls)] < 1


@pytest.mark.parametrize("order", [("wall", "decal"), ("decal", "wall")])
def test_of_a_decal_and_its_wall_the_smaller_label_is_seen(client, order):
    """Each has every pixel or none, though rounding has now one and now the other in front."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("decal", **hg.shapes.plane(1))
            edit.mesh("wall", **hg.shapes.plane(3))
            on = hg.look_at((0.3, 0.1, 0.2), (1.7, 0.9, -0.4))
            for name in order:
                edit.entity(name, mesh=name, transform=on)
            lens = hg.Camera.from_fov(50, 320, 240, degrees=True)
            edit.entity("cam", camera=lens, transform=on @ hg.look_at((1.1, -0.7, 2.3), (0, 0, 0)))
        frame = scene.render("cam", planes=["instance"], labels=["amodal", "amodal_masks"])
    assert frame.labels["name"] == list(order)
    first = frame.amodal_mask(1)
    assert first.sum() > 5000
    assert (frame["instance"][first] == 1).all()
    assert (frame["instance"][~first] != 1).all()
