"""Cameras with a ray for each pixel: beside the lens whose rays they are, against arithmetic, each
pixel at its own time, and what they refuse."""

from __future__ import annotations

import heliograph as hg
import heliograph.datasets as hd
import numpy as np
import pytest
from lenses import LENSES, direction_at
from oracle import pose

SIZE = (48, 36)
LENS = hg.Camera.from_fov(70, *SIZE, degrees=True)
PLANES = ["instance", "depth", "distance", "position", "position_camera", "normal", "primitive"]


def rays_of(lens: hg.Camera) -> np.ndarray:
    """(H, W, 6): those of a lens, from its eye."""
    y, x = np.mgrid[: lens.height, : lens.width]
    directions = direction_at(lens, np.stack([x, y], -1).reshape(-1, 2).astype(float))
    rays = np.zeros((lens.height, lens.width, 6), np.float32)
    rays[..., 3:] = np.nan_to_num(directions).reshape(lens.height, lens.width, 3)
    return rays


def straight_down(size: tuple[int, int] = SIZE, step: float = 0.05) -> np.ndarray:
    """(H, W, 6): parallel rays along the optical axis, `step` metres apart."""
    width, height = size
    rays = np.zeros((height, width, 6), np.float32)
    rays[..., 0] = (np.arange(width) - 0.5 * width + 0.5) * step
    rays[..., 1] = ((np.arange(height) - 0.5 * height + 0.5) * step)[:, None]
    rays[..., 5] = 1
    return rays


@pytest.fixture
def scene(client):
    """Balls and a box before a camera at the origin's side."""
    with client.create_scene() as made:
        with made.edit() as edit:
            edit.mesh("ball", **hg.shapes.sphere(0.4))
            edit.mesh("cube", **hg.shapes.cube(0.6))
            for i, place in enumerate([(-0.8, 0, 0.2), (0.1, 0.6, 0), (0.9, -0.4, 0.3)]):
                edit.entity(f"ball {i}", mesh="ball", transform=pose(place), label=1 + i)
            edit.entity("box", mesh="cube", transform=pose((0.2, -0.3, -0.7)), label=9)
            edit.dome(color=(1, 0.9, 0.8))
        yield made


def look(scene: hg.Scene, name: str, camera: hg.Camera) -> None:
    with scene.edit() as edit:
        place = hg.look_at((0.2, -3, 0.6), (0, 0, 0))
        edit.entity(name, camera=camera, transform=place)


@pytest.mark.parametrize("name", LENSES)
def test_a_table_of_a_lens_is_that_lens(scene, name):
    lens = LENSES[name]
    if name == "orthographic":
        pytest.skip("its rays are parallel: below")
    look(scene, "lens", lens)
    look(scene, "table", hg.Camera.from_rays(rays_of(lens)))
    labels = {"boxes": True, "amodal": True, "amodal_masks": True}
    want = scene.render("lens", planes=PLANES, labels=labels)
    got = scene.render("table", planes=PLANES, labels=labels)
    same = got["instance"] == want["instance"]
    assert same.mean() > 0.999
    hit = same & (got["instance"] > 0) & (got["primitive"] == want["primitive"])
    assert hit.sum() > 100
    for plane in ("depth", "distance", "position", "position_camera"):
        np.testing.assert_allclose(got[plane][hit], want[plane][hit], atol=1e-3, err_msg=plane)
    for column in ("visible", "inside"):
        off = np.abs(got.labels[column].astype(int) - want.labels[column].astype(int))
        assert off.max() <= 3, column
    assert (got.labels["canvas"] == got.labels["inside"]).all()
    assert np.isnan(got.labels["corners_image"]).all()
    np.testing.assert_allclose(got.labels["corners_camera"], want.labels["corners_camera"])
    assert got.K[0, 0] == 0 and got.K[1, 1] == 0


def test_pictures_between_rays_are_those_of_the_lens(scene):
    """With the same random numbers samples go the same ways, but for rounding."""
    look(scene, "lens", LENS)
    look(scene, "table", hg.Camera.from_rays(rays_of(LENS), interpolated=True))
    want = scene.render("lens", spp=16)["beauty"]
    got = scene.render("table", spp=16)["beauty"]
    off = np.abs(got - want)[..., :3].max(-1)
    assert np.median(off) < 1e-3
    assert np.abs(got.mean((0, 1)) - want.mean((0, 1))).max() < 2e-3


def test_a_beam_has_no_footprint(scene):
    """Without interpolation all samples of a pixel see the same point: coverage is 0 or 1."""
    look(scene, "table", hg.Camera.from_rays(rays_of(LENS)))
    frame = scene.render("table", planes=["coverage", "instance"], spp=16)
    np.testing.assert_array_equal(frame["coverage"] == 1, frame["instance"] > 0)
    assert set(np.unique(frame["coverage"])) == {0, 1}


def test_rays_start_where_the_table_says(scene):
    """A grid of parallel beams, some of them blind and of any length, down on a ball."""
    rays = straight_down()
    rays[::2, :, 3:] *= 37.5
    rays[5, 7, 3:] = 0
    with scene.edit() as edit:
        edit.entity("above", camera=hg.Camera.from_rays(rays), transform=pose((0.1, 0.6, 3)))
    frame = scene.render("above", planes=["depth", "instance", "beauty", "normal"], spp=1)
    x, y = rays[..., 0], rays[..., 1]
    r2 = x.astype(float) ** 2 + y.astype(float) ** 2
    inner = r2 < 0.3**2
    inner[5, 7] = False
    assert (frame["instance"][inner] == 2).all()
    expected = 3 - np.sqrt(0.4**2 - r2[inner])
    np.testing.assert_allclose(frame["depth"][inner], expected, atol=4e-3)  # facets of the ball
    assert frame["instance"][5, 7] == 0 and np.isinf(frame["depth"][5, 7])
    assert (frame["beauty"][5, 7, :3] == 0).all()
    hit = scene.pick("above", [(24, 18), (7, 5)])
    assert hit["instance"].tolist() == [2, 0]


def test_each_pixel_has_its_time(client):
    """A wall that comes nearer, and a ball that crosses the beams: labels at each pixel's time."""
    rays, (width, height) = straight_down(), SIZE
    times = np.random.default_rng(1).uniform(0, 0.5, (height, width)).astype(np.float32)
    speed, first = 2.0, 6.0
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.mesh("wall", **hg.shapes.cube(1.0))
            wall = {t: pose((0, 0, first - speed * t + 0.5)) for t in (0.0, 1.0)}
            for matrix in wall.values():
                matrix[:3, :3] = np.diag((50, 50, 1))
            edit.entity("wall", mesh="wall", keys=wall, label=1)
            edit.mesh("ball", **hg.shapes.sphere(0.5))
            ball = {t: pose((-1 + 4 * t, 0, 2)) for t in (0.0, 1.0)}
            edit.entity("ball", mesh="ball", keys=ball, label=2)
            down = np.diag((1.0, -1.0, -1.0, 1.0))  # looks along the world's +z
            camera = hg.Camera.from_rays(rays, times=times)
            edit.entity("scanner", camera=camera, transform=down)
        options = {"time": 0, "frame_interval": 0.1, "hold": True}
        labels = {"boxes": True, "amodal": True, "amodal_masks": True}
        planes = ["depth", "instance", "scene_flow"]
        frame = scene.render("scanner", planes=planes, labels=labels, **options)
        assert frame.rolling == pytest.approx(times.max())
        x, y = rays[..., 0].astype(float), rays[..., 1].astype(float)
        ball_x = -1 + 4 * times.astype(float)
        r2 = (x - ball_x) ** 2 + y**2
        on_ball, off_ball = r2 < 0.45**2, r2 > 0.51**2
        assert on_ball.sum() > 50
        assert (frame["instance"][on_ball] == 2).all()
        assert (frame["instance"][off_ball] == 1).all()
        wall_depth = first - speed * times.astype(float)
        np.testing.assert_allclose(frame["depth"][off_ball], wall_depth[off_ball], atol=2e-5)
        flow = frame["scene_flow"]
        assert np.abs(flow[off_ball] - [0, 0, -0.1 * speed]).max() < 1e-5
        np.testing.assert_array_equal(frame.amodal_mask(2), frame["instance"] == 2)
        assert frame.amodal_mask(1).all()
        # A picture sees each pixel at its time, too.
        sharp = scene.render("scanner", planes=["coverage", "beauty"], spp=4, time=0)
        assert (sharp["coverage"] == 1).all()


def test_it_is_read_back_and_saved_whole(client, scene, tmp_path):
    rays = straight_down((160, 120))  # more than comes within an object
    times = np.linspace(0, 1, 160 * 120, dtype=np.float32).reshape(120, 160)
    camera = hg.Camera.from_rays(rays, times=times, interpolated=True, shutter=(0, 0.25), near=0.1)
    look(scene, "table", camera)
    assert scene["table"].camera == camera
    assert scene["table"].camera != hg.Camera.from_rays(rays[::-1], times=times)
    before = scene.render("table", planes=["depth", "instance"])
    scene.save(tmp_path / "scene.hg")
    with client.load_scene(tmp_path / "scene.hg") as again:
        assert again["table"].camera == camera
        after = again.render("table", planes=["depth", "instance"])
    for plane in ("depth", "instance"):
        np.testing.assert_array_equal(before[plane], after[plane])


def test_sensors_see_along_its_rays(scene):
    sensor = {
        "rgb_sensor": hg.RgbSensor(vignetting=1),
        "depth_sensor": hg.DepthSensor(kind="time_of_flight"),
    }
    lens = hg.Camera.from_fov(70, *SIZE, degrees=True, **sensor)
    look(scene, "lens", lens)
    look(scene, "table", hg.Camera.from_rays(rays_of(lens), interpolated=True, **sensor))
    planes = ["sensor_rgb", "sensor_depth", "distance"]
    want = scene.render("lens", planes=planes, spp=4)
    got = scene.render("table", planes=planes, spp=4)
    assert np.median(np.abs(got["sensor_rgb"] - want["sensor_rgb"])) < 1e-3
    measured = (got["sensor_depth"] > 0) & (want["sensor_depth"] > 0)
    assert measured.sum() > 100
    np.testing.assert_allclose(got["sensor_depth"][measured], got["distance"][measured], rtol=1e-5)


def test_saved_frames_of_a_table_are_valid(scene, tmp_path):
    look(scene, "table", hg.Camera.from_rays(rays_of(LENS)))
    writer = hd.Exr(tmp_path / "set")
    hd.generate(scene, "table", lambda draw: None, count=1, spp=1, writer=writer)
    report = hd.validate(tmp_path / "set", "exr")
    assert report.ok, str(report)
    with pytest.raises(hg.HeliographError, match="ray table"):
        hd.generate(
            *(scene, "table", lambda draw: None),
            count=1,
            spp=1,
            writer=hd.Colmap(tmp_path / "colmap"),
        )


def changed(pixel: tuple[int, ...], value: float) -> np.ndarray:
    rays = straight_down()
    rays[pixel] = value
    return rays


REFUSED = {
    "shape": ("rays", lambda: hg.Camera.from_rays(np.zeros((4, 4, 5)))),
    "nan": (r"rays\[2\]\[3\]\[5\]", lambda: hg.Camera.from_rays(changed((2, 3, 5), np.nan))),
    "far origin": (r"rays\[2\]\[3\]", lambda: hg.Camera.from_rays(changed((2, 3, 0), 2e6))),
    "short": (r"rays\[2\]\[3\]", lambda: hg.Camera.from_rays(changed((2, 3, 5), 1e-9))),
    "long": (r"rays\[2\]\[3\]", lambda: hg.Camera.from_rays(changed((2, 3, 5), 1e30))),
    "blind": ("rays", lambda: hg.Camera.from_rays(0 * straight_down())),
    "times": ("times", lambda: hg.Camera.from_rays(straight_down(), times=np.zeros((3, 3)))),
    "past": (
        r"times\[0\]\[0\]",
        lambda: hg.Camera.from_rays(straight_down(), times=np.full(SIZE[::-1], -1.0)),
    ),
    "aperture": (
        "aperture",
        lambda: hg.Camera.from_rays(straight_down(), aperture=0.1, focus_distance=1),
    ),
    "rolling": ("rolling", lambda: hg.Camera.from_rays(straight_down(), rolling=0.1)),
    "distortion": (
        "distortion",
        lambda: hg.Camera.from_rays(straight_down(), distortion=(0.1, 0, 0, 0)),
    ),
    "stereo": (
        "depth_sensor",
        lambda: hg.Camera.from_rays(straight_down(), depth_sensor=hg.DepthSensor(baseline=0.1)),
    ),
    "no rays": ("rays", lambda: hg.Camera(*SIZE, 0, 0, 0, 0, "ray_table")),
}


@pytest.mark.parametrize("name", REFUSED)
def test_bad_tables_are_refused_by_name(scene, name):
    where, make = REFUSED[name]
    before = scene.revision
    with pytest.raises(hg.InvalidArgument, match=where):
        look(scene, "table", make())
    assert scene.revision == before


@pytest.mark.parametrize(
    "options",
    [
        {"planes": ["flow_forward"], "frame_interval": 0.1, "hold": True},
        {"planes": ["instance"], "labels": {"keypoints": True}},
    ],
)
def test_what_needs_a_place_in_the_image_is_not_there(scene, options):
    look(scene, "table", hg.Camera.from_rays(straight_down()))
    with scene.edit() as edit:
        edit.mesh("marked", **hg.shapes.cube(0.1), keypoints={"tip": (0, 0, 0.05)})
    with pytest.raises(hg.HeliographError, match="does not tell where it sees a point") as refused:
        scene.render("table", **options)
    assert refused.value.code == "UNIMPLEMENTED"


def test_another_size_is_refused(scene):
    look(scene, "table", hg.Camera.from_rays(straight_down()))
    with pytest.raises(hg.InvalidArgument, match="at that size"):
        scene.render("table", planes=["depth"], size=(96, 72))
    look(scene, "table 2", hg.Camera.from_rays(straight_down((1, 1))))
    frame = scene.render("table 2", planes=["depth", "beauty"], spp=1)
    assert frame["depth"].shape == (1, 1)


def test_tracks_are_not_there(scene):
    look(scene, "table", hg.Camera.from_rays(straight_down()))
    with pytest.raises(hg.HeliographError, match="does not tell where it sees a point"):
        scene.tracks("table", ("box", [0, 1]), [0.0])
