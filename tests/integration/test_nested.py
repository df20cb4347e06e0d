"""Bodies that overlap, through the daemon: a full glass equals one whose faces were built apart."""

import heliograph as hg
import numpy as np
import pytest

SIZE, SEEDS, SPP = (12, 12), 48, 32
BOUND = 6.3  # of nine values of Student's t, at 47 degrees of freedom or more: level 1e-6
GLASS, WATER = 1.5, 1.33
OUTER, INNER, FLOOR, SURFACE, RIM = 1, 0.8, 0.25, 1.2, 2  # half widths and heights, metres


def box(half, low, high):
    """Corners of a box, by (x, y, z) bits, and its six faces: -x, +x, -y, +y, -z, +z."""
    corners = np.array(
        [
            [(2 * x - 1) * half, (2 * y - 1) * half, z]
            for z in (low, high)
            for y in (0, 1)
            for x in (0, 1)
        ]
    )
    faces = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    return [corners[list(face)] for face in faces]


def turned(faces):
    """Faces turned inside out."""
    return [face[::-1] for face in faces]


def rim():
    """Four sides of a square ring at the height of the rim, facing up."""
    turn = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    side = np.array(
        [[-OUTER, -OUTER, RIM], [OUTER, -OUTER, RIM], [INNER, -INNER, RIM], [-INNER, -INNER, RIM]]
    )
    return [side @ np.linalg.matrix_power(turn, k) for k in range(4)]


def mesh(faces):
    """Mesh of quadrilaterals."""
    indices = np.array(
        [(4 * i, 4 * i + a, 4 * i + a + 1) for i in range(len(faces)) for a in (1, 2)]
    )
    return {"positions": np.concatenate(faces).astype("f4"), "indices": indices.astype("u4")}


OUTSIDE = [face for i, face in enumerate(box(OUTER, 0, RIM)) if i != 5] + rim()
WET = [face for i, face in enumerate(turned(box(INNER, FLOOR, SURFACE))) if i != 5]
DRY = turned(box(INNER, SURFACE, RIM))[:4]
TOP = [box(INNER, FLOOR, SURFACE)[5]]


def clear(edit, name, faces, **material):
    edit.material(f"{name} matter", base_color=1, roughness=0, transmission=1, **material)
    made = edit.mesh(f"{name} mesh", **mesh(faces))
    edit.entity(name, mesh=made, material=f"{name} matter")


@pytest.fixture(scope="module")
def table(client):
    """A lit place with a ball where the glass will stand around it."""
    sky = np.full((8, 16, 3), 0.2, "f4")
    sky[2, 3:6], sky[3, 9:12] = (6, 5, 4), (3, 5, 8)
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.dome(sky)
            edit.material("wood", base_color=(0.6, 0.4, 0.2), roughness=1)
            edit.entity("board", mesh=edit.mesh(**hg.shapes.plane(8)), material="wood")
            edit.update("board", transform=hg.Pose((0, 0, -0.01)))
            ball = edit.mesh(**hg.shapes.sphere(0.3))
            edit.entity("ball", mesh=ball, material="wood", transform=hg.Pose((0.1, 0, 0.9)))
            camera = hg.Camera.from_fov(26, *SIZE, degrees=True)
            pose = hg.look_at((1, -5.5, 2.8), (0, 0, 1))
            edit.entity("camera", camera=camera, transform=pose)
        yield scene


def apart(edit):
    """Three surfaces, each with the ratio of the indices behind and before it."""
    clear(edit, "to air", [*OUTSIDE, *DRY], ior=GLASS)
    clear(edit, "to water", WET, ior=GLASS / WATER)
    clear(edit, "water", TOP, ior=WATER)


def overlapping(of_glass, of_water):
    def build(edit):
        clear(edit, "glass", [*OUTSIDE, *WET, *DRY], ior=GLASS, priority=of_glass)
        body = box(INNER + 0.1, FLOOR - 0.1, SURFACE)
        clear(edit, "water", body, ior=WATER, priority=of_water)

    return build


def blocks(scene, build, first=0):
    """(SEEDS, 9) green of the blocks of 4 x 4 pixels."""
    with scene.overlay() as lit:
        build(lit)
    out = []
    for seed in range(first, first + SEEDS):
        frame = scene.render("camera", spp=SPP, seed=seed, overlay=lit, max_depth=64)
        green = frame["beauty"][..., 1].astype("f8")
        out.append(green.reshape(3, 4, 3, 4).mean(axis=(1, 3)).ravel())
    return np.array(out)


def largest_t(one, other):
    """Largest of Welch's t over the blocks."""
    error = np.sqrt((one.var(axis=0, ddof=1) + other.var(axis=0, ddof=1)) / SEEDS)
    return (np.abs(one.mean(axis=0) - other.mean(axis=0)) / error).max()


@pytest.fixture(scope="module")
def want(table):
    return blocks(table, apart, first=SEEDS)


@pytest.mark.parametrize("priorities", [(1, 0), (7, -3)])
def test_glass_that_wins_over_the_water_in_it_is_a_full_glass(table, want, priorities):
    assert largest_t(blocks(table, overlapping(*priorities)), want) < BOUND


@pytest.mark.parametrize("priorities", [(0, 0), (0, 1)])
def test_without_it_the_picture_is_another(table, want, priorities):
    assert largest_t(blocks(table, overlapping(*priorities)), want) > 2 * BOUND
