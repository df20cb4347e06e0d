"""Spatial queries against closed forms: rays, picks, overlaps, visibility and surface samples, on a
plane, a sphere, and instances that are scaled, turned and mirrored."""

import heliograph as hg
import numpy as np
import pytest

RADIUS, SIZE = 0.5, 8.0
# How far the triangles of the sphere lie inside it: a chord of 1/256 turn, around and along.
SAG = 2 * RADIUS * (1 - np.cos(np.pi / 256))
NONE = 0xFFFFFFFF
# A square of side 1 seen from +Z: scaled, turned about Z, and mirrored in x.
POSES = {
    "scaled": hg.Pose((3, 0, 1), scale=(2, 0.5, 1)).matrix,
    "turned": hg.Pose((0, 3, 1), euler=(0, 0, 0.7)).matrix,
    "mirrored": hg.Pose((-3, 0, 1), scale=(-1, 1, 1)).matrix,
}


@pytest.fixture(scope="module")
def world(client):
    """A floor at z = 0, a ball on it, squares at z = 1, and a camera above that looks down."""
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("square", **hg.shapes.plane(1.0))
            edit.mesh("sphere", **hg.shapes.sphere(RADIUS, segments=256))
            edit.entity("floor", mesh="square", transform=hg.Pose(scale=SIZE), label=1)
            edit.entity("ball", mesh="sphere", transform=hg.Pose((0, 0, RADIUS)), label=2)
            for label, (name, pose) in enumerate(POSES.items(), 3):
                edit.entity(name, mesh="square", transform=pose, label=label)
            lens = hg.Camera(64, 64, 64, 64, 31.5, 31.5)
            edit.entity("cam", camera=lens, transform=hg.Pose((0, 0, 8)))
        yield scene


def sphere_hits(origins, directions):
    """(t, position, normal) of rays against the ball; t is inf where they miss."""
    centre = np.array([0, 0, RADIUS])
    d = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    m = origins - centre
    b = (m * d).sum(1)
    root = b * b - (m * m).sum(1) + RADIUS**2
    t = np.where(root >= 0, -b - np.sqrt(np.maximum(root, 0)), np.inf)
    t[t < 0] = np.inf
    with np.errstate(invalid="ignore"):
        position = origins + t[:, None] * d
    return t, position, (position - centre) / RADIUS


def rays_at_the_ball(count):
    rng = np.random.default_rng(1)
    origins = rng.normal(size=(count, 3))
    origins = 1.9 * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    origins[:, 2] = np.abs(origins[:, 2]) + RADIUS
    targets = np.array([0, 0, RADIUS]) + rng.uniform(-0.7, 0.7, (count, 3))
    return origins, 3 * (targets - origins)  # directions of any length


def test_rays_meet_the_sphere_where_it_is(world):
    origins, directions = rays_at_the_ball(4000)
    hits = world.cast_rays(origins, directions)
    t, position, normal = sphere_hits(origins, directions)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    grazing = np.abs((normal * unit).sum(1)) < 0.1
    sure = np.isfinite(t) & ~grazing
    assert sure.sum() > 1500
    assert (hits.entity[sure] == world["ball"].id).all() and (hits.instance[sure] == 2).all()
    assert np.abs(hits.t[sure] - t[sure]).max() < SAG / 0.1 + 1e-5
    assert np.abs(hits.position[sure] - position[sure]).max() < SAG / 0.1 + 1e-5
    assert (hits.normal[sure] * normal[sure]).sum(1).min() > np.cos(np.pi / 100)
    along = origins + hits.t[:, None] * unit
    met = np.isfinite(hits.t)
    assert np.abs(along[met] - hits.position[met]).max() < 1e-5
    triangles = len(world["sphere"].indices)
    assert hits.primitive[sure].max() < triangles and len(np.unique(hits.primitive[sure])) > 500


def test_rays_that_miss_say_so_in_every_column(world):
    hits = world.cast_rays([[0, 0, 3], [9, 9, 3], [0, 0, -1]], [[0, 0, 1], [0, 0, -1], [0, 0, -1]])
    assert np.isposinf(hits.t).all() and (hits.entity == 0).all() and (hits.instance == 0).all()
    assert (hits.primitive == NONE).all() and np.isnan(hits.position).all()
    assert (hits.normal == 0).all() and (hits.uv == 0).all()


def test_uvs_and_normals_of_the_plane(world):
    points = np.random.default_rng(2).uniform(-3.9, 3.9, (500, 2))
    points = points[np.linalg.norm(points, axis=1) > 0.6]
    for side in (1, -1):  # from above past the squares, and from below
        origins = np.column_stack([points, np.full(len(points), 0.5 * side)])
        hits = world.cast_rays(origins, (0, 0, -2 * side))
        assert np.allclose(hits.t, 0.5, atol=1e-6)
        assert np.allclose(hits.normal, (0, 0, side))
        assert np.allclose(hits.uv, points / SIZE + 0.5, atol=1e-5)
        assert (hits.entity == world["floor"].id).all()


def test_any_hit_and_t_max(world):
    origins, directions = rays_at_the_ball(3000)
    closest = world.cast_rays(origins, directions)
    any_hit = world.cast_rays(origins, directions, any_hit=True)
    assert list(any_hit) == ["t"]
    assert np.array_equal(np.isfinite(closest.t), any_hit.t == 0)
    assert np.isposinf(any_hit.t[any_hit.t != 0]).all()
    far = float(np.median(closest.t[np.isfinite(closest.t)]))
    near = world.cast_rays(origins, directions, t_max=far)
    assert np.array_equal(np.isfinite(near.t), closest.t <= far)
    blocked = world.cast_rays(origins, directions, t_max=far, any_hit=True)
    assert np.array_equal(blocked.t == 0, closest.t <= far)


@pytest.mark.parametrize("name", POSES)
def test_transformed_instances(world, name):
    local = np.random.default_rng(3).uniform(-0.49, 0.49, (200, 2))
    corners = np.column_stack([local, np.zeros(200), np.ones(200)])
    points = (corners @ POSES[name].T)[:, :3]
    for side in (1, -1):
        hits = world.cast_rays(points + (0, 0, side), (0, 0, -side), t_max=1.5)
        assert (hits.entity == world[name].id).all()
        assert np.allclose(hits.t, 1, atol=1e-6) and np.allclose(hits.normal, (0, 0, side))
        assert np.allclose(hits.uv, local + 0.5, atol=1e-5)


def test_a_pick_is_the_ray_of_its_pixel(world):
    pixels = np.random.default_rng(4).uniform(0, 63, (1000, 2))
    picked = world.pick("cam", pixels)
    directions = np.column_stack([(pixels - 31.5) / 64 * (1, -1), -np.ones(1000)])
    cast = world.cast_rays((0, 0, 8), directions)
    same = picked.entity == cast.entity
    assert same.mean() > 0.995  # a ray along an edge may round to either side
    for name in ("t", "position", "normal", "uv"):
        assert np.allclose(picked[name][same], cast[name][same], atol=1e-4, equal_nan=True), name
    on_floor = picked.entity == world["floor"].id
    assert on_floor.sum() > 100
    z = -directions[on_floor][:, :2] * 8 / directions[on_floor][:, 2:]
    assert np.allclose(picked.position[on_floor][:, :2], z, atol=1e-4)


def test_a_pick_agrees_with_the_planes(world):
    frame = world.render("cam", planes=["instance", "distance"])
    v, u = np.mgrid[0:64, 0:64]
    picked = world.pick("cam", np.column_stack([u.ravel(), v.ravel()]))
    assert np.array_equal(picked.instance, frame["instance"].ravel())
    assert np.allclose(picked.t, frame["distance"].ravel(), rtol=1e-5)


def test_overlaps(world):
    with world.branch() as branch:
        with branch.edit() as edit:
            for name, x in (("apart", 1.01), ("touching", 0.98), ("inside", 0.2)):
                scale = 0.2 if name == "inside" else 1.0
                pose = hg.Pose((x, 0, RADIUS), scale=scale)
                edit.entity(name, mesh="sphere", transform=pose)
            edit.entity("above", mesh="square", transform=hg.Pose((0, 0, 1.001)))
            edit.entity("through", mesh="square", transform=hg.Pose((0, 0, 0.6), euler=(0.5, 0, 0)))
        names = ["apart", "touching", "inside", "above", "through", "floor", "ball"]
        found = branch.overlaps(["ball", "apart"], names)
        want = [
            [False, True, True, False, True, True, True],  # the ball stands on the floor
            [True, True, False, False, False, True, False],
        ]
        assert found.tolist() == want, dict(zip(names, found.T.tolist(), strict=True))


def test_visible_shares(world):
    with world.branch() as branch:
        with branch.edit() as edit:
            edit.entity("behind", mesh="square", transform=hg.Pose((0, 0, -1)))
            edit.entity("partly", mesh="square", transform=hg.Pose((2, 2, 2)))
            edit.entity("cover", mesh="square", transform=hg.Pose((2.375, 2.125, 3)))
            edit.entity("outside", mesh="square", transform=hg.Pose((50, 0, 0)))
        seen = branch.visible("cam", ["ball", "behind", "partly", "outside"])
    assert seen.visible.tolist() == [True, False, True, False]
    # "partly" covers the pixels 48..58 x 5..15, of which "cover" hides 56..58 x 5..10.
    assert np.allclose(seen.share, [1, 0, (121 - 18) / 121, 0], atol=1e-6)


def test_surface_samples_are_uniform_over_the_world_area(world):
    names = ["ball", "scaled", "mirrored"]
    count = 60_000
    points = world.sample_surface(names, count, seed=5)
    areas = np.array([4 * np.pi * RADIUS**2, 1.0, 1.0])
    ids = [world[name].id for name in names]
    got = np.array([(points.entity == i).sum() for i in ids])
    want = count * areas / areas.sum()
    assert got.sum() == count
    # chi^2 of 3 classes; 13.8 is its 0.1 % quantile at 2 degrees of freedom.
    assert ((got - want) ** 2 / want).sum() < 13.8
    ball = points.entity == ids[0]
    out = points.position[ball] - (0, 0, RADIUS)
    assert np.abs(np.linalg.norm(out, axis=1) - RADIUS).max() < SAG + 1e-6
    assert (points.normal[ball] * out / RADIUS).sum(1).min() > np.cos(np.pi / 100)
    # Archimedes: the height of a uniform point on a sphere is uniform. 20 bins; chi^2 at 19 degrees
    # of freedom stays below 43.8 but for 0.1 %.
    bins = np.histogram(out[:, 2], bins=20, range=(-RADIUS, RADIUS))[0]
    even = len(out) / 20
    assert ((bins - even) ** 2 / even).sum() < 43.8
    for name, index in (("scaled", 1), ("mirrored", 2)):
        mine = points.entity == ids[index]
        local = points.position[mine] @ np.linalg.inv(POSES[name])[:3, :3].T
        local += np.linalg.inv(POSES[name])[:3, 3]
        assert np.abs(local[:, :2]).max() <= 0.5 + 1e-6 and np.abs(local[:, 2]).max() < 1e-6
        assert np.allclose(points.uv[mine], local[:, :2] + 0.5, atol=1e-5)
        assert np.allclose(points.normal[mine], (0, 0, 1))
        cells = np.histogram2d(local[:, 0], local[:, 1], bins=5, range=[[-0.5, 0.5]] * 2)[0]
        # 25 cells: 24 degrees of freedom, 0.1 % quantile.
        assert ((cells - mine.sum() / 25) ** 2 / (mine.sum() / 25)).sum() < 51.2
    again = world.sample_surface(names, count, seed=5)
    assert all(np.array_equal(points[c], again[c]) for c in points)
    assert not np.array_equal(points.position, world.sample_surface(names, count).position)


def test_many_rays_come_back_in_order(world):
    count = 150_000  # several messages
    x = np.linspace(-3.9, 3.9, count)
    hits = world.cast_rays(np.column_stack([x, np.full(count, -3.5), np.ones(count)]), (0, 0, -1))
    assert len(hits.t) == count and np.allclose(hits.position[:, 0], x, atol=1e-5)
