"""Round curves against arithmetic: planes, labels, flow, questions, refusals."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest

SIZE = 96
FOCAL = 32.0  # pixels a metre
PLANES = (
    "depth normal geometric_normal tangent uv instance part primitive position barycentric nocs"
)


def camera(edit: hg.Edits, **given: object) -> None:
    """An orthographic camera 5 m above the plane z = 0, with +y up in its image."""
    middle = SIZE / 2 - 0.5
    lens = hg.Camera(SIZE, SIZE, FOCAL, FOCAL, middle, middle, "orthographic", **given)
    edit.entity("cam", camera=lens, transform=hg.Pose((0, 0, 5)))


def places() -> tuple[np.ndarray, np.ndarray]:
    """World x and y of pixel centres."""
    x = (np.arange(SIZE) - SIZE / 2 + 0.5) / FOCAL
    return np.meshgrid(x, -x)


def assert_near(found: np.ndarray, wanted: np.ndarray, steep: np.ndarray) -> None:
    """A pixel's place is known to a few 1e-7 m; what is steep there is known by as much less."""
    steep = steep.reshape(steep.shape + (1,) * (wanted.ndim - steep.ndim))
    assert np.abs((found - wanted) * steep).max() < 3e-6


def rod(edit: hg.Edits, name: str = "rod", **given: object) -> hg.Entity:
    """Two segments of radius 0.25 m from x = -1 to 1, the second one of part 1."""
    edit.mesh(
        f"{name}/mesh",
        positions=[(-1, 0, 0), (0, 0, 0), (1, 0, 0)],
        curves=[3],
        radii=[0.25, 0.25, 0.25],
        parts=[0, 1],
    )
    edit.material("white", base_color=0.8, specular=0)
    return edit.entity(name, mesh=f"{name}/mesh", material="white", label="auto", **given)


def test_a_rod_is_a_cylinder_with_round_ends(scene):
    with scene.edit() as edit:
        rod(edit)
        camera(edit)
    frame = scene.render("cam", planes=PLANES.split(), labels=["boxes", "amodal", "amodal_masks"])
    x, y = places()
    beyond = np.maximum(np.abs(x) - 1, 0)
    square = 0.25**2 - y**2 - beyond**2
    hit = square > 0
    np.testing.assert_array_equal(frame["instance"] == 1, hit)
    z = np.sqrt(np.maximum(square, 0))
    steep = 4 * z[hit]
    assert_near(frame["depth"][hit], 5 - z[hit], steep)
    normal = np.stack([np.sign(x) * beyond, y, z], -1) / 0.25
    assert_near(frame["normal"][hit], normal[hit], steep / 4)
    assert_near(frame["geometric_normal"][hit], normal[hit], steep / 4)
    assert_near(frame["position"][hit], np.stack([x, y, z], -1)[hit], steep)
    along = np.array([1, 0, 0]) - normal * normal[..., :1]
    shaft = hit & (beyond == 0)
    assert_near(frame["tangent"][shaft], along[shaft], steep[shaft[hit]] / 4)
    # Where both segments have the sphere between them, either may be seen.
    sure = shaft & (np.abs(x) > 0.02)
    np.testing.assert_array_equal(frame["primitive"][sure], (x > 0)[sure])
    np.testing.assert_array_equal(frame["part"][sure], 1 + (x > 0)[sure])
    np.testing.assert_allclose(frame["uv"][shaft][:, 0], (x[shaft] + 1) / 2, atol=1e-6)
    # v grows around the strand so that u and v are right-handed about the normal.
    turns = 2 * np.pi * frame["uv"][shaft][:, 1] + np.arctan2(z, y)[shaft]
    assert np.abs(np.exp(1j * turns).mean()) > 1 - 1e-5
    np.testing.assert_array_equal(frame.amodal_mask(1), hit)
    rows, columns = hit.any(1).nonzero()[0], hit.any(0).nonzero()[0]
    box = [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
    assert frame.labels["bbox_visible"][0].tolist() == box
    assert frame.labels["bbox_amodal"][0].tolist() == box
    np.testing.assert_allclose(frame.labels["box_half_extents"][0], (1.25, 0.25, 0.25), atol=1e-6)
    diagonal = 2 * np.linalg.norm([1.25, 0.25, 0.25])
    nocs = 0.5 + np.stack([x, y, z], -1) / diagonal
    assert_near(frame["nocs"][hit], nocs[hit], steep)


def test_a_strand_of_no_length_is_a_sphere_and_poses_stretch_it(scene):
    with scene.edit() as edit:
        edit.mesh("dot", positions=np.zeros((2, 3)), curves=[2], radii=[0.5, 0.2])
        edit.entity("dot", mesh="dot", transform=hg.Pose((0.1, 0.2, 0), scale=(2, 1, 0.5)))
        camera(edit)
    frame = scene.render("cam", planes=["depth", "normal", "instance"])
    x, y = places()
    a, b = (x - 0.1) / 1.0, (y - 0.2) / 0.5
    square = 1 - a**2 - b**2
    hit = square > 0
    np.testing.assert_array_equal(frame["instance"] != 0, hit)
    c = np.sqrt(np.maximum(square, 0))
    assert_near(frame["depth"][hit], 5 - 0.25 * c[hit], c[hit])
    normal = np.stack([a / 1.0, b / 0.5, c / 0.25], -1)[hit]
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    assert_near(frame["normal"][hit], normal, c[hit] / 8)


def test_a_cone_leans(scene):
    """A strand from radius 0.6 to 0.2 along x: the slope of the cone between its circles."""
    with scene.edit() as edit:
        edit.mesh("cone", positions=[(-1, 0, 0), (1, 0, 0)], curves=[2], radii=[0.6, 0.2])
        edit.entity("cone", mesh="cone")
        camera(edit)
    frame = scene.render("cam", planes=["depth", "normal", "barycentric"])
    x, y = places()
    sine = 0.4 / 2
    cosine = np.sqrt(1 - sine**2)
    width = (0.6 - sine * (x + 1)) / cosine  # of the cone at x
    along = ((x + 1) - width * sine / cosine) / 2  # of the sphere that touches there
    on_cone = (along > 0) & (along < 1) & (np.abs(y) < width - 1e-3)
    z = np.sqrt(np.where(on_cone, width**2 - y**2, 1))
    steep = (z / width)[on_cone]
    assert_near(frame["depth"][on_cone], 5 - z[on_cone], steep)
    out = np.stack([np.full_like(x, sine), cosine * y / width, cosine * z / width], -1)
    assert_near(frame["normal"][on_cone], out[on_cone], steep / 2)
    assert_near(frame["barycentric"][on_cone][:, 0], along[on_cone], steep)


def test_flow_of_what_moves(scene):
    with scene.edit() as edit:
        turn = hg.Pose((0.25, 0.5, 0), euler=(0, 0, 0.4))
        rod(edit, keys={0: hg.Pose(), 1: turn})
        edit.entity("cam", keys={0: hg.Pose((0, 0, 5)), 1: hg.Pose((0, 0, 5))})
        camera(edit)
    planes = ["flow_forward", "flow_forward_valid", "scene_flow", "position", "instance"]
    frame = scene.render("cam", planes=planes, time=0, frame_interval=1, hold=True)
    hit = frame["instance"] != 0
    p = frame["position"][hit]
    c, s = np.cos(0.4), np.sin(0.4)
    to = p @ np.array([(c, s, 0), (-s, c, 0), (0, 0, 1)]) + (0.25, 0.5, 0)
    np.testing.assert_allclose(frame["scene_flow"][hit], to - p, atol=5e-6)
    pixels = (to - p)[:, :2] * [FOCAL, -FOCAL]
    np.testing.assert_allclose(frame["flow_forward"][hit], pixels, atol=2e-4)
    assert frame["flow_forward_valid"][hit].all()


def test_flow_of_what_deforms(scene):
    """A straight strand along x turns about z by its points: places turn with it."""
    first = np.array([(-1, 0, 0), (0, 0, 0), (1, 0, 0)], "f8")
    c, s = np.cos(0.5), np.sin(0.5)
    turn = np.array([(c, -s, 0), (s, c, 0), (0, 0, 1)])
    with scene.edit() as edit:
        keys = np.stack([first, first @ turn.T])
        edit.mesh("hair", positions=keys, times=[0, 1], curves=[3], radii=[0.2, 0.25, 0.3])
        edit.entity("hair", mesh="hair")
        camera(edit)
    planes = ["flow_forward", "scene_flow", "position", "instance"]
    frame = scene.render("cam", planes=planes, time=0, frame_interval=1, hold=True)
    hit = frame["instance"] != 0
    p = frame["position"][hit]
    np.testing.assert_allclose(frame["scene_flow"][hit], p @ turn.T - p, atol=1e-5)


def test_blur_of_a_strand_that_deforms_is_the_mean_of_its_times(scene):
    def build(edit: hg.Edits) -> None:
        first = np.array([(-1, -0.5, 0), (1, -0.5, 0)], "f8")
        keys = np.stack([first, first + (0, 1, 0)])
        edit.mesh("bar", positions=keys, times=[0, 1], curves=[2], radii=[0.2, 0.2])
        edit.material("lit", base_color=1.0, unlit=True)
        edit.entity("bar", mesh="bar", material="lit")
        camera(edit, shutter=(0, 1))

    with scene.edit() as edit:
        build(edit)
    frame = scene.render("cam", planes=["beauty"], time=0, spp=1024, filter="box")
    # At x = 0 the bar covers y in [t - 0.7, t - 0.3]: the share of times at which it covers y.
    edges = -(np.arange(SIZE + 1) - SIZE / 2) / FOCAL
    t = np.arange(2000) / 2000
    low, high = t - 0.7, t - 0.3
    cover = np.minimum(high, edges[:-1, None]) - np.maximum(low, edges[1:, None])
    expected = (cover.clip(0) * FOCAL).mean(1)
    np.testing.assert_allclose(frame["beauty"][:, SIZE // 2, 0], expected, atol=0.03)


def test_questions(scene):
    with scene.edit() as edit:
        rod(edit)
        edit.mesh("ball/mesh", **hg.shapes.sphere(0.5))
        edit.entity("ball", mesh="ball/mesh", transform=hg.Pose((0, 1, 0)))
        camera(edit)
    met = scene.cast_rays([(0.5, 0.1, 5)], [(0, 0, -1)])
    z = np.sqrt(0.25**2 - 0.1**2)
    np.testing.assert_allclose(met.t, 5 - z, atol=1e-6)
    np.testing.assert_allclose(met.normal, [(0, 0.4, 4 * z)], atol=1e-6)
    assert met.entity[0] == scene["rod"].id and met.primitive[0] == 1
    middle = SIZE / 2 - 0.5
    pixel = (middle + 0.5 * FOCAL, middle - 0.1 * FOCAL)
    picked = scene.pick("cam", [pixel])
    np.testing.assert_allclose(picked.position, [(0.5, 0.1, z)], atol=3e-6)
    followed = scene.tracks("cam", picked, [0.0])
    np.testing.assert_allclose(followed.position[0, 0], (0.5, 0.1, z), atol=3e-6)
    assert followed.visible.all()
    assert scene.visible("cam", ["rod"]).share[0] == 1
    for ask in (
        lambda: scene.sample_surface(["rod"], 10),
        lambda: scene.overlaps(["rod"], ["ball"]),
        lambda: scene.tracks("cam", ("rod", [0]), [0.0]),
    ):
        with pytest.raises(hg.InvalidArgument, match="'rod'.* shows curves"):
            ask()


def test_arrays_come_back(scene):
    with scene.edit() as edit:
        mesh = rod(edit) and edit.mesh("more", positions=np.eye(3), curves=[3], radii=[1, 2, 3])
    curves, radii = scene.read([mesh], ["mesh.curves", "mesh.radii"])[0]
    assert curves.tolist() == [3] and radii.tolist() == [1, 2, 3]
    assert mesh.indices.shape == (0, 3) and mesh.uvs is None
    with scene.edit() as edit:
        edit.mesh("more", positions=2 * np.eye(3))
    assert scene.read([mesh], ["mesh.radii"])[0][0].tolist() == [1, 2, 3]
    assert mesh.positions[0, 0] == 2
    np.testing.assert_allclose(scene["rod"].aabb, [(-1.25, -0.25, -0.25), (1.25, 0.25, 0.25)])


POINTS = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0)], "f4")
REFUSED = {
    "no radii": ({"radii": None}, "radii", "is missing"),
    "a radius of 0": ({"radii": [1, 0, 1]}, r"radii\[1\]", "radii are from"),
    "a negative radius": ({"radii": [1, 1, -1]}, r"radii\[2\]", "radii are from"),
    "a large radius": ({"radii": [1e30, 1, 1]}, r"radii\[0\]", "radii are from"),
    "a radius that is no number": ({"radii": [1, np.nan, 1]}, "radii", "finite|nan"),
    "radii of others": ({"radii": [1, 1]}, "radii.shape", "V = 3"),
    "too few points": ({"curves": [4]}, "curves", "sums to 4 points; positions has 3"),
    "points of none": ({"curves": [2]}, "curves", "sums to 2 points; positions has 3"),
    "a strand of one point": ({"curves": [2, 1]}, r"curves\[1\]", "2 points or more"),
    "no strands": ({"curves": []}, "curves", "1 strand or more"),
    "triangles, too": ({"indices": [(0, 1, 2)]}, "indices", "leave it out"),
    "normals": ({"normals": POINTS}, "normals", "leave it out"),
    "tangents": ({"tangents": np.ones((3, 4))}, "tangents", "leave it out"),
    "radii without curves": ({"curves": None}, "curves", "is missing"),
    "parts of points": ({"parts": [0, 0, 0]}, "parts.shape", "F = 2"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(scene, case):
    given, field, text = REFUSED[case]
    with pytest.raises(hg.InvalidArgument, match=text) as raised, scene.edit() as edit:
        edit.mesh("hair", **{"positions": POINTS, "curves": [3], "radii": [1, 1, 1], **given})
    assert np.char.find(raised.value.field, field.replace("\\", "")) >= 0


def test_no_light_of_an_entity_leaves_from_curves(scene):
    with scene.edit() as edit:
        rod(edit)
    with pytest.raises(hg.InvalidArgument, match="give their material emission"):
        with scene.edit() as edit:
            edit.update("rod", light=hg.Light(radiance=1))
    with scene.edit() as edit:
        edit.mesh("lamp", **hg.shapes.cube(1))
        edit.entity("lamp", mesh="lamp", light=hg.Light(radiance=1))
    with pytest.raises(hg.InvalidArgument, match="'lamp'.* shows this mesh"):
        with scene.edit() as edit:
            edit.mesh("lamp", positions=POINTS, curves=[3], radii=[1, 1, 1])


def test_emission_is_found_by_rays_that_scatter(scene):
    """Irradiance below a long glowing cylinder of radius r at a distance h: pi L r / h."""
    with scene.edit() as edit:
        edit.mesh("tube", positions=[(-200, 0, 1), (200, 0, 1)], curves=[2], radii=[0.25, 0.25])
        edit.material("glow", base_color=0.0, specular=0, emission=1.0, emission_strength=3.0)
        edit.entity("tube", mesh="tube", material="glow")
        edit.mesh("floor", **hg.shapes.plane(1))
        edit.material("paper", base_color=0.5, specular=0)
        edit.entity("floor", mesh="floor", material="paper")
        lens = hg.Camera.from_fov(1, 8, 8, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, 0.6, 0.5), (0, 0, 0)))
    frame = scene.render("cam", planes=["beauty"], spp=4096, max_depth=2)
    found = float(np.mean(frame["beauty"][..., 0]))
    assert found == pytest.approx(0.5 * 3.0 * 0.25, rel=0.02)


def test_cut_outs(scene):
    """A picture along the strand whose second half is clear."""
    with scene.edit() as edit:
        rod(edit)
        alpha = np.zeros((1, 64, 4), "u1")
        alpha[0, :, :3] = 255
        alpha[0, :32, 3] = 255
        cut = edit.texture("cut", alpha, filter="nearest")
        edit.material("half", base_color=cut, alpha=hg.Tex(cut, channel=3), alpha_mode="mask")
        edit.entity("rod", material="half")
        camera(edit)
    frame = scene.render("cam", planes=["instance", "beauty"], spp=1)
    x, y = places()
    clear = (np.abs(x) > 0.02) & (np.abs(y) < 0.24) & (np.abs(x) < 0.9)
    np.testing.assert_array_equal((frame["instance"] != 0)[clear], (x < 0)[clear])


def hair(threads: int) -> hg.Frame:
    """A frame of a daemon of so many threads."""
    rng = np.random.default_rng(3)
    roots = rng.uniform(-1, 1, (400, 1, 3)) * (1, 1, 0.1)
    grown = roots + np.cumsum(rng.normal(0, 0.1, (400, 5, 3)), 1)
    with (
        hg.connect(arguments=["--threads", str(threads)]) as client,
        client.create_scene() as scene,
    ):
        with scene.edit() as edit:
            edit.mesh(
                "hair",
                positions=grown.reshape(-1, 3),
                curves=np.full(400, 5),
                radii=np.tile(np.linspace(0.02, 0.005, 5), 400),
            )
            edit.material("brown", base_color=(0.3, 0.2, 0.1), roughness=0.3, anisotropic=0.8)
            edit.entity("hair", mesh="hair", material="brown", label="auto")
            edit.dome(color=1.0)
            camera(edit)
        planes = ["beauty", "depth", "instance", "primitive", "normal", "uv"]
        return scene.render("cam", planes=planes, spp=8, labels=["boxes", "amodal"])


def test_bytes_do_not_depend_on_threads():
    one, two = hair(1), hair(2)
    assert all(one[plane].tobytes() == two[plane].tobytes() for plane in one.planes)
    assert all(np.array_equal(one.labels[name], two.labels[name]) for name in one.labels)
    assert (one["instance"] != 0).mean() > 0.1
