"""Scenes in which few of the paths find the light, of stop_rule.py. SCENES: what builds each."""

import common
import heliograph as hg
import numpy as np

SIZE = common.size((96, 64), (48, 32))
GREY = {"base_color": 0.7, "specular": 0.0}
BLACK = {"base_color": 0.0, "specular": 0.0}
MIRROR = {"base_color": 0.95, "metallic": 1.0, "roughness": 0.02}
GLASS = {"base_color": 1.0, "transmission": 1.0, "roughness": 0.0, "ior": 1.5}


def put(edit, name, mesh, material, at=(0, 0, 0), scale=(1, 1, 1), turn=0.0):
    """An entity of a mesh of its own; `turn`: radians about +Z."""
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[:3, :3] = pose[:3, :3] * np.asarray(scale, "f8")
    pose[:3, 3] = at
    look = edit.material(name, **material)
    edit.entity(name, mesh=edit.mesh(name, **mesh), material=look, transform=pose)


def box(edit, name, low, high, material=GREY, turn=0.0):
    low, high = np.asarray(low, "f8"), np.asarray(high, "f8")
    put(edit, name, hg.shapes.cube(1.0), material, (low + high) / 2, high - low, turn)


def lamp(edit, at, power=100.0, radius=0.05):
    light = hg.Light(power=power, shape="sphere", radius=radius)
    edit.entity("lamp", light=light, transform=hg.Pose(at))


def camera(edit, eye, target, fov=60):
    lens = hg.Camera.from_fov(fov, *SIZE, degrees=True)
    edit.entity("cam", camera=lens, transform=hg.look_at(eye, target))


def floor(edit, size=12.0):
    put(edit, "floor", hg.shapes.plane(size), GREY)


def room(edit, gap):
    """Walls of 5 x 5 x 3 m. gap: y0, z0, y1, z1 of an opening in the wall at x = -2.5, or None."""
    wall, h = 0.1, 2.5
    box(edit, "below", (-h, -h, -wall), (h, h, 0))
    box(edit, "above", (-h, -h, 3), (h, h, 3 + wall))
    box(edit, "right", (h, -h, 0), (h + wall, h, 3))
    box(edit, "front", (-h, -h - wall, 0), (h, -h, 3))
    box(edit, "back", (-h, h, 0), (h, h + wall, 3))
    y0, z0, y1, z1 = gap or (0, 0, 0, 3)
    box(edit, "left 1", (-h - wall, -h, 0), (-h, y0, 3))
    box(edit, "left 2", (-h - wall, y1, 0), (-h, h, 3))
    if gap:
        box(edit, "left 3", (-h - wall, y0, 0), (-h, y1, z0))
        box(edit, "left 4", (-h - wall, y0, z1), (-h, y1, 3))


def small_hole(edit):
    """A room lit by the sky through a hole of 30 x 30 cm, with a table in it."""
    room(edit, (0.4, 1.5, 0.7, 1.8))
    box(edit, "table", (0, 0, 0.7), (1.2, 1, 0.75))
    edit.dome(color=(0.8, 0.9, 1.0), intensity=800.0)
    camera(edit, (1.8, -2.2, 1.6), (-0.5, 1, 0.9))


def glass_caustic(edit):
    """A caustic of a glass ball and a small lamp on a floor that another light shows faintly."""
    floor(edit)
    put(edit, "ball", hg.shapes.sphere(0.4, 96), GLASS, (0, 0, 0.6))
    lamp(edit, (-1, 0.5, 2.5), 60.0, 0.06)
    edit.dome(color=1.0, intensity=0.02)
    camera(edit, (0, -2.6, 1.8), (0.2, 0, 0.2))


def ring_caustic(edit):
    """A caustic of a small lamp from the inside of a mirror ring on the floor."""
    floor(edit)
    tube = hg.shapes.torus(0.6, 0.12, 128)
    put(edit, "ring", tube, MIRROR | {"roughness": 0.05}, (0, 0, 0.15), (1, 1, 2))
    lamp(edit, (-2, 0.8, 1.6), 60.0, 0.15)
    camera(edit, (0, -2.2, 1.8), (0, 0, 0))


def tube(radius, height, gap, segments=120):
    """The wall of a cylinder that has no part within `gap` radians of +X."""
    angle = np.linspace(gap / 2, 2 * np.pi - gap / 2, segments)
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], -1)
    low, high = (np.column_stack([ring, np.full(segments, z)]) for z in (-height / 2, height / 2))
    a = np.arange(segments - 1)
    faces = np.stack([a, a + 1, a + segments + 1, a, a + segments + 1, a + segments], -1)
    positions = np.concatenate([low, high]).astype("f4")
    return {"positions": positions, "indices": faces.reshape(-1, 3).astype("u4")}


def slit_shade(edit):
    """A room with a lamp in a closed shade that has a slit away from the camera."""
    room(edit, None)
    put(edit, "shade", tube(0.25, 0.5, 0.12), GREY, (0, 0.5, 1.5), turn=2.2)
    for name, z in (("lid", 1.75), ("base", 1.25)):
        box(edit, name, (-0.3, 0.2, z - 0.01), (0.3, 0.8, z + 0.01))
    lamp(edit, (0, 0.5, 1.5), 100.0, 0.05)
    camera(edit, (1.5, -2.3, 1.6), (-0.4, 0.8, 1.2), 70)


def corner_mirror(edit):
    """Two black corridors: the lamp of one shows in the other by a mirror at the bend alone."""
    for name, low, high in (
        ("outer", (-0.1, 3, 0), (4.1, 3.1, 2)),
        ("end", (0, -3.1, 0), (1, -3, 2)),
        ("west", (-0.1, -3, 0), (0, 3, 2)),
        ("east", (1, -3, 0), (1.1, 2, 2)),
        ("inner", (1.1, 1.9, 0), (4, 2, 2)),
        ("shut", (4, 2, 0), (4.1, 3, 2)),
        ("roof", (-0.1, -3.1, 2), (4.1, 3.1, 2.1)),
    ):
        box(edit, name, low, high, BLACK)
    box(edit, "floor", (0, -3, -0.1), (1, 1.9, 0))
    box(edit, "block", (0.3, 0.4, 0), (0.5, 0.6, 0.4))
    plate = hg.shapes.cube(1.0)
    put(edit, "mirror", plate, MIRROR, (0.45, 2.55, 0.9), (1.2, 0.02, 1.8), np.pi / 4)
    lamp(edit, (3.5, 2.5, 1.2), 80.0, 0.4)
    camera(edit, (0.5, -2.8, 1.4), (0.5, 1.0, 0.0))


def far_lamp(edit):
    """200 blocks below a lamp of 5 cm that is 300 m away, and as bright as it takes."""
    floor(edit, 30.0)
    rng = np.random.default_rng(3)
    for i in range(200):
        x, y = rng.uniform(-4, 4, 2)
        w, h = rng.uniform(0.05, 0.3), rng.uniform(0.1, 1.2)
        box(edit, f"block {i}", (x - w, y - w, 0), (x + w, y + w, h), turn=rng.uniform(0, 3))
    lamp(edit, (-200, 120, 190), 2e7, 0.05)
    camera(edit, (0, -6, 3), (0, 0, 0.3))


def bright_texel(edit):
    """Balls of glass and clay below a dim sky with one texel that is 200,000 times as bright."""
    floor(edit)
    for i in range(9):
        look = (GLASS, GREY, MIRROR)[i % 3]
        put(edit, f"ball {i}", hg.shapes.sphere(0.35), look, (i % 3 - 1, i // 3 - 1, 0.36))
    sky = np.full((32, 64, 3), 0.05, "f4")
    sky[7, 35] = 1e4
    edit.dome(sky)
    camera(edit, (0, -3.6, 2.2), (0, 0, 0.2))


def lamp_in_fog(edit):
    """A lamp behind a post in a box of fog."""
    floor(edit)
    fog = {"base_color": 1.0, "transmission": 1.0, "ior": 1.0, "roughness": 0.0}
    box(edit, "fog", (-3, -3, 0.01), (3, 3, 3), fog | {"medium_density": 0.5})
    box(edit, "post", (-0.25, -0.3, 0), (0.25, -0.1, 2.2))
    lamp(edit, (0, 0.2, 1.4), 60.0, 0.04)
    camera(edit, (0, -4.5, 1.5), (0, 0, 1.2))


def tiny_among_dim(edit):
    """One glowing triangle of 5 cm among 100 balls that glow faintly, most of them hidden."""
    room(edit, None)
    rng = np.random.default_rng(5)
    edit.material("dim", emission=0.02, base_color=0.4)
    ball = edit.mesh("ball", **hg.shapes.sphere(0.08, 16))
    for i in range(100):
        at = hg.Pose(rng.uniform((-2.3, -1, 0.1), (2.3, 2.3, 2.8)))
        edit.entity(f"ball {i}", mesh=ball, material="dim", transform=at)
    corners = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0]], "f4")
    spark = {"positions": corners, "indices": np.array([[0, 2, 1]], "u4")}
    put(edit, "spark", spark, {"emission": 1600, "two_sided_emission": True}, (0.5, 0.8, 1.2))
    camera(edit, (1.5, -2.3, 1.6), (-0.4, 0.8, 1.2), 70)


def rough_plates(edit):
    """A lamp in a black box that is shut by two plates of rough glass."""
    floor(edit)
    for name, low, high in (
        ("lid", (-0.5, -0.5, 2.6), (0.5, 0.5, 2.65)),
        ("west", (-0.55, -0.5, 1.5), (-0.5, 0.5, 2.6)),
        ("east", (0.5, -0.5, 1.5), (0.55, 0.5, 2.6)),
        ("south", (-0.55, -0.55, 1.5), (0.55, -0.5, 2.6)),
        ("north", (-0.55, 0.5, 1.5), (0.55, 0.55, 2.6)),
    ):
        box(edit, name, low, high, BLACK)
    rough = GLASS | {"roughness": 0.4}
    box(edit, "plate 1", (-0.5, -0.5, 1.55), (0.5, 0.5, 1.6), rough)
    box(edit, "plate 2", (-0.5, -0.5, 1.7), (0.5, 0.5, 1.75), rough)
    lamp(edit, (0.1, 0, 2.2), 100.0, 0.35)
    box(edit, "block", (0.3, 0.2, 0), (0.8, 0.7, 0.5))
    camera(edit, (0, -3.5, 1.6), (0, 0, 0.4))


def blinds(edit):
    """A room with a lamp outside, behind the slats of its window."""
    room(edit, (-0.8, 0.9, 0.8, 2.1))
    for i in range(14):
        z = 0.93 + 0.09 * i
        put(edit, f"slat {i}", hg.shapes.cube(1.0), GREY, (-2.55, 0, z), (0.085, 1.6, 0.012))
    box(edit, "shelf", (-0.8, 1.9, 0), (0.8, 2.4, 1.2))
    lamp(edit, (-4.5, 0.3, 2.9), 800.0, 0.08)
    camera(edit, (1.9, -2.2, 1.6), (-1, 0.8, 1.0), 65)


BUILDERS = (small_hole, glass_caustic, slit_shade, lamp_in_fog, blinds, ring_caustic)
BUILDERS += (corner_mirror, far_lamp, bright_texel, tiny_among_dim, rough_plates)
SCENES = {build.__name__: build for build in BUILDERS}
