"""render_data() of nvisii: what each option means, against formulas and the daemon's planes."""

import math

import numpy as np
import nvisii
import pytest
from nvisii_world import ball, rows

W, H = 32, 24
FARTHEST = np.finfo(np.float32).max


def data(option, bounce=0, samples=1):
    return rows(nvisii.render_data(W, H, 0, samples, bounce, option), W, H)


def rays():
    """Directions of the fixture's camera through the pixels' centres: 45 degrees high."""
    x, y = np.meshgrid(np.arange(W) + 0.5, np.arange(H) + 0.5)
    t = math.tan(0.785398 / 2)
    out = np.stack([(2 * x / W - 1) * t, np.ones_like(x), (1 - 2 * y / H) * t], axis=-1)
    return out / np.linalg.norm(out, axis=-1, keepdims=True)


def sphere_distances(radius=1.0):
    """From (0, -4, 0) to a ball about the origin; inf beside it."""
    d = rays()
    b = -4 * d[..., 1]
    square = b * b - (16 - radius * radius)
    with np.errstate(invalid="ignore"):
        return np.where(square > 0, -b - np.sqrt(square), np.inf)


def test_geometry_is_that_of_the_pixels_centres(camera):
    thing = ball()
    nvisii.mesh.remove("ball")
    thing.set_mesh(nvisii.mesh.create_sphere("fine", 1, 512, 256))
    distance = sphere_distances()
    hit = np.isfinite(distance)
    depth = data("depth")
    assert np.abs(depth[hit][:, 0] - distance[hit]).max() < 1e-3
    assert (depth[~hit][:, :3] == -FARTHEST).all() and (depth[..., 3] == 1).all()
    position, normal = data("position"), data("normal")
    point = [0, -4, 0] + rays()[hit] * distance[hit][:, None]
    assert np.abs(position[hit][:, :3] - point).max() < 1e-3
    assert (position[~hit][:, :3] == -FARTHEST).all()
    assert np.abs(normal[hit][:, :3] - point).max() < 0.02 and not normal[~hit][:, :3].any()
    seen = data("screen_space_normal")[hit]
    assert np.allclose(seen[:, 0], normal[hit][:, 0], atol=1e-5)
    assert np.allclose(seen[:, 1], normal[hit][:, 2], atol=1e-5)
    assert np.allclose(seen[:, 2], -normal[hit][:, 1], atol=1e-5)
    assert np.abs(data("ray_direction")[..., :3] - rays()).max() < 1e-6
    tangent = data("tangent")[hit][:, :3]
    assert np.abs((tangent * normal[hit][:, :3]).sum(axis=1)).max() < 0.02
    u = data("texture_coordinates")[hit][:, 0]
    around = np.arctan2(point[:, 1], point[:, 0]) / (2 * math.pi) % 1
    assert np.abs(u - around).max() < 0.01


def test_entity_ids_are_get_id(camera):
    a, b = ball("a", (-0.6, 0, 0), 0.5), ball("b", (0.6, 0, 0), 0.5)
    ids = data("entity_id")[..., 0]
    assert set(np.unique(ids)) == {a.get_id(), b.get_id(), FARTHEST}
    assert (ids[12, :16] != b.get_id()).all() and (ids[12, 16:] != a.get_id()).all()
    again = rows(nvisii.render_data(W, H, 0, 8, 0, "entity_id"), W, H)[..., 0]
    assert np.array_equal(ids, again)  # never averaged


def test_colors_by_lobe(camera):
    ball("red", (-0.6, 0, 0), 0.5, base_color=(0.8, 0.2, 0.1))
    ball("metal", (0.6, 0, 0), 0.5, base_color=(0.9, 0.6, 0.3), metallic=1)
    lamp = ball("lamp", (0, 0, 0.8), 0.2)
    lamp.set_light(nvisii.light.create("lamp"))
    ids = data("entity_id")[..., 0]
    red, metal, light = (ids == nvisii.entity.get(n).get_id() for n in ("red", "metal", "lamp"))
    assert np.allclose(data("base_color")[red][:, :3], (0.8, 0.2, 0.1))
    diffuse, glossy = data("diffuse_color"), data("glossy_color")
    assert np.allclose(diffuse[red][:, :3], (0.8, 0.2, 0.1))
    assert not diffuse[metal][:, :3].any() and not diffuse[light][:, :3].any()
    assert glossy[red][:, 0].min() == pytest.approx(0.04, abs=0.01)
    assert np.allclose(glossy[metal][:, :3].min(axis=0), (0.9, 0.6, 0.3), atol=0.01)
    assert not data("transmission_color")[..., :3].any()


def test_the_parts_of_light_sum_to_the_picture(camera):
    ball("floor", (0, 0, -3), 2.5)
    ball("metal", (0, 0, 0), 0.5, metallic=1, roughness=0.2)
    kinds = ("diffuse", "glossy", "transmission")
    parts = [data(f"{k}_{p}_lighting", samples=4) for k in kinds for p in ("direct", "indirect")]
    hit = data("depth")[..., 0] > 0
    image = data("none", samples=4)
    summed = sum(part[..., :3] for part in parts)
    inside = hit & np.roll(hit, 1, 0) & np.roll(hit, -1, 0) & np.roll(hit, 1, 1)
    inside &= np.roll(hit, -1, 1)
    assert inside.sum() > 50
    assert np.allclose(summed[inside], image[inside][:, :3], rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("time", [0.0, 0.25, 1.0])
def test_motion_vectors_are_the_daemons_flow(camera, time):
    thing = ball()
    thing.get_transform().set_linear_velocity((0.3, 0.5, 0.1))
    thing.get_transform().set_angular_velocity(nvisii.angleAxis(0.3, (0, 1, 1)))
    camera.get_transform().set_linear_velocity((0.1, -0.2, 0.05))
    nvisii.sample_time_interval((time, time))
    vectors = data("diffuse_motion_vectors")[..., :3]
    shoot = nvisii.rendering.shoot
    flow = np.zeros((H, W, 2))
    for name, interval, sign in (("flow_forward", 1 - time, 1), ("flow_backward", time, -1)):
        if interval:
            frame = shoot((W, H), [name], (time, time), label_time=time, frame_interval=interval)
            flow += sign * frame[name]
    assert np.abs(flow).max() > 1
    assert np.abs(vectors[..., 0] * W - flow[..., 0]).max() < 0.01
    assert np.abs(-vectors[..., 1] * H - flow[..., 1]).max() < 0.01


def test_a_still_scene_has_no_motion(camera):
    ball()
    assert not data("diffuse_motion_vectors")[..., :3].any()


def test_the_other_options(camera):
    ball()
    assert not data("device_id")[..., :3].any()
    heat = data("heatmap")[..., 0]
    assert 0 < heat.min() and heat.max() <= 1
    assert np.isfinite(data("denoise_albedo")).all() and np.isfinite(data("denoise_normal")).all()
    for arguments, message in (
        ((0, "depht"), "there is no 'depht', but none, depth"),
        ((-1, "depth"), "bounce: -1: is below 0"),
    ):
        with pytest.raises(RuntimeError, match=message):
            data(arguments[1], bounce=arguments[0])
    assert len(nvisii.render_data(8, 8, 0, 0, 0, "entity_id")) == 256  # as its documentation says


def test_a_later_bounce_is_what_a_mirror_shows(camera):
    """A mirror at y = 0 before the camera at (0, -4, 0), and a ball of radius 2 behind that, at
    (0, -10, 0): its image is at (0, 10, 0)."""
    mirror = nvisii.entity.create(
        "mirror",
        mesh=nvisii.mesh.create_box("mirror", size=(8, 0.01, 8)),
        transform=nvisii.transform.create("mirror", position=(0, 0.01, 0)),
        material=nvisii.material.create("mirror", metallic=1, roughness=0),
    )
    real = nvisii.entity.create(
        "real",
        mesh=nvisii.mesh.create_sphere("real", radius=2, slices=400, segments=200),
        transform=nvisii.transform.create("real", position=(0, -10, 0)),
        material=nvisii.material.create("real", base_color=(0.5, 0.25, 0.125)),
    )
    d = rays()
    b = -14 * d[..., 1]
    square = b * b - (14 * 14 - 4)
    expected = -b - np.sqrt(np.maximum(square, 0)) - 4 / d[..., 1]
    sees = square > 1
    misses = square < -1
    assert sees.sum() > 20 and misses.sum() > 200
    depth, number, way = (data(name, bounce=1) for name in ("depth", "entity_id", "ray_direction"))
    assert np.allclose(depth[sees][:, 0], expected[sees], rtol=2e-3)
    assert (number[sees][:, 0] == real.get_id()).all() and (number[misses][:, 0] > 1e38).all()
    assert (depth[misses][:, 0] == -FARTHEST).all() and not way[misses][:, :3].any()
    assert np.allclose(way[sees][:, :3], d[sees] * (1, -1, 1), atol=1e-3)
    assert np.allclose(data("base_color", bounce=1)[sees][:, :3], (0.5, 0.25, 0.125), atol=1e-3)
    assert (data("entity_id")[sees][:, 0] == mirror.get_id()).all()
    # The ball scatters wherever: what is met then is averaged over paths, and drawn by the seed.
    one, many = data("position", bounce=2), data("position", bounce=2, samples=16)
    assert np.array_equal(one, data("position", bounce=2))
    met = [(abs(p[sees][:, :3]) < 1e3).all(axis=1) for p in (one, many)]
    assert met[1].sum() > met[0].sum() and (met[1] | ~met[0]).all()


def test_files_hold_the_same_numbers(camera, tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    ball()
    depth = data("depth")
    path = str(tmp_path / "depth.exr")
    nvisii.render_data_to_file(W, H, 0, 1, 0, "depth", path)
    with OpenEXR.File(path) as file:
        assert np.array_equal(file.channels()["RGBA"].pixels, depth)
    path = str(tmp_path / "image.hdr")
    nvisii.render_to_file(W, H, 4, path, seed=2)
    image = rows(nvisii.render(W, H, 4, seed=2), W, H)[..., :3]
    texture = nvisii.texture.create_from_file("back", path)
    back = np.array(texture.get_float_texels()).reshape(H, W, 4)[::-1, :, :3]
    assert texture.is_hdr() and np.abs(back - image).max() <= image.max() / 128
    with pytest.raises(RuntimeError, match="ending must be"):
        nvisii.render_to_file(W, H, 1, str(tmp_path / "image.jpeg2000"))


def test_each_of_many_things_has_its_own_motion(camera):
    steps = {"left": (0, 0, 0.2), "middle": (0, 0, 0), "right": (-0.1, 0, 0)}
    for i, (name, step) in enumerate(steps.items()):
        ball(name, (i - 1, 0, 0), radius=0.4).get_transform().set_linear_velocity(step)
    nvisii.sample_time_interval((1, 1))
    motion = rows(nvisii.render_data(61, 61, 0, 1, 0, "diffuse_motion_vectors"), 61, 61)
    half = math.tan(math.radians(45) / 2) * 3.6  # of the picture's height, at the balls' fronts
    pixel = 61 / (2 * math.tan(math.radians(45) / 2) * 3.6)
    for i, step in enumerate(steps.values()):
        seen = motion[30, round(30 + (i - 1) * pixel * 0.95)]
        expected = (step[0] / 2 / half, step[2] / 2 / half)
        assert seen[:2].tolist() == pytest.approx(expected, abs=1e-3)
