"""nvisii's cameras, motion blur, visibility and what else changes what is seen."""

import math

import numpy as np
import nvisii
import pytest
from nvisii_world import ball, rows


def ids(width, height):
    image = rows(nvisii.render_data(width, height, 0, 1, 0, "entity_id"), width, height)
    return image[..., 0]


def gray(width, height, samples=16):
    return rows(nvisii.render(width, height, samples), width, height)[..., 1]


def centroid(mask):
    return [float(axis.mean()) for axis in np.nonzero(mask)[::-1]]


@pytest.mark.parametrize("size", [(64, 48), (96, 96)])
def test_intrinsics_project_points_to_their_pixels(camera, size):
    """At the calibrated size, and at another."""
    lens = camera.get_camera()
    lens.set_intrinsics(80, 70, 20.5, 30.25, 64, 48)
    k = lens.get_intrinsic_matrix(64, 48)
    assert np.allclose(np.array(k).T, [[80, 0, 20.5], [0, 70, 30.25], [0, 0, 1]])
    dot = ball("dot", (-0.3, 0, 0.2), 0.06)
    k = np.array(lens.get_intrinsic_matrix(*size)).T
    x, y, w = k @ [-0.3, -0.2, 4]  # OpenCV's axes: right, down, ahead
    found = centroid(ids(*size) == dot.get_id())
    assert found == pytest.approx([x / w, y / w], abs=0.35)


def test_projections_are_those_of_opengl(camera):
    lens = nvisii.camera.create_from_fov("f", math.pi / 2, 2.0)
    assert np.allclose(np.array(lens.get_projection()).T[:2, :2], [[0.5, 0], [0, 1]])
    assert np.array(lens.get_intrinsic_matrix(200, 100)).T.tolist() == [
        pytest.approx([50, 0, 99.5]), [0, pytest.approx(50), 49.5], [0, 0, 1]
    ]  # fmt: skip
    film = nvisii.camera.create_from_focal_length("l", 50, 36, 24)
    assert film.get_intrinsic_matrix(360, 240)[0][0] == pytest.approx(500)
    old = nvisii.camera.create_perspective_from_focal_length("o", 50, 36, 24)
    assert old.get_projection() == film.get_projection()
    assert nvisii.camera.create_perspective_from_fov("p", 1, 1).get_projection()[3][2] < 0
    film.set_focal_length(100, 36, 24)
    assert film.get_intrinsic_matrix(360, 240)[0][0] == pytest.approx(1000)
    other = nvisii.camera.create_from_intrinsics("i", 80, 70, 20.5, 30.25, 64, 48)
    film.set_projection(other.get_projection())
    assert film.get_intrinsic_matrix(64, 48) == other.get_intrinsic_matrix(64, 48)
    with pytest.raises(RuntimeError, match="perspective"):
        film.set_projection(nvisii.mat4(1))
    with pytest.raises(RuntimeError, match="field_of_view"):
        film.set_fov(4, 1)


def test_the_camera_entity_is_followed(camera):
    """NViSII saw the copy that set_camera_entity() had taken."""
    thing = ball()
    assert ids(9, 9)[4, 4] == thing.get_id()
    camera.get_transform().look_at(at=(0, -9, 0), up=(0, 0, 1))
    assert ids(9, 9)[4, 4] != thing.get_id()
    nvisii.set_camera_entity(None)
    with pytest.raises(RuntimeError, match="no camera"):
        nvisii.render(8, 8, 1)
    nvisii.set_camera_entity(camera)
    nvisii.camera.remove("eye")
    with pytest.raises(RuntimeError, match="needs a transform and a camera"):
        nvisii.render(8, 8, 1)


def test_a_lens_blurs_what_is_out_of_focus(camera):
    """The circle of a point at z: f a |1 / z - 1 / z0| pixels."""
    ball("dot", (0, 4, 0), 0.02, base_color=(0, 0, 0), specular=0)
    size = 65
    lens = camera.get_camera()
    lens.set_focal_distance(4)
    lens.set_aperture_diameter(1000)
    dark = 1 - gray(size, size, 256)
    f = lens.get_intrinsic_matrix(size, size)[0][0]
    assert (dark > 0.001).any(axis=0).sum() == pytest.approx(f * abs(1 / 8 - 1 / 4), abs=2.5)
    lens.set_aperture_diameter(0)
    assert ((1 - gray(size, size, 64)) > 0.001).any(axis=0).sum() <= 3


def test_motion_blur_spans_the_time_interval(camera):
    """A black square that moves by its own width: a trapezoid from the box of the shutter."""
    square = nvisii.entity.create(
        "square",
        transform=nvisii.transform.create("square", position=(0.5, 0, 0)),
        mesh=nvisii.mesh.create_box("square", size=(0.5, 0.01, 0.5)),
        material=nvisii.material.create("square", base_color=(0, 0, 0), specular=0),
    )
    square.get_transform().set_position((-0.5, 0, 0), previous=True)
    row = 1 - gray(64, 64, 256)[32]
    scale = 64 / (2 * 3.99 * math.tan(0.785398 / 2))  # pixels a unit, at the square's front
    x = (np.arange(64) - 31.5) / scale
    assert np.abs(row - np.clip(1 - np.abs(x), 0, 1)).max() < 0.1
    for time, place in ((0, -0.5), (0.5, 0), (1, 0.5)):
        nvisii.sample_time_interval((time, time))
        sharp = 1 - gray(64, 64, 16)[32]
        assert np.abs(sharp - (np.abs(x - place) < 0.5)).sum() < 2.5
        assert abs(centroid(ids(64, 64) == square.get_id())[0] - 31.5 - place * scale) < 0.6
    square.get_transform().clear_motion()
    nvisii.sample_time_interval((0, 1))
    assert np.abs(1 - gray(64, 64, 16)[32] - (np.abs(x - 0.5) < 0.5)).sum() < 2.5


def test_visibility_is_by_ray(camera):
    thing = ball(base_color=(0, 0, 0), specular=0)
    thing.set_visibility(camera=False)
    assert (gray(9, 9) == 1).all()
    thing.set_visibility()
    assert gray(9, 9)[4, 4] < 0.1
    floor = ball("floor", (0, 0, -11), 10, base_color=(1, 1, 1), specular=0)
    nvisii.set_max_bounce_depth(0, 0, 0, 0, 0)
    under = gray(33, 33, 64)[26, 16]
    thing.set_visibility(shadow=False, diffuse=False)
    assert gray(33, 33, 64)[26, 16] > under + 0.1
    assert floor.get_material() is nvisii.material.get("floor")


def test_boxes_of_entities(camera):
    thing = ball("ball", (1, 2, 3), 0.5)
    thing.get_transform().set_scale((1, 2, 4))
    assert thing.get_min_aabb_corner() == pytest.approx([0.5, 1, 1])
    assert thing.get_max_aabb_corner() == pytest.approx([1.5, 3, 5])
    assert thing.get_aabb_center() == thing.get_center() == pytest.approx([1, 2, 3])
    assert nvisii.get_scene_max_aabb_corner() == pytest.approx([1.5, 3, 5])
    nvisii.update_scene_aabb(thing)
    assert nvisii.entity.get_renderable_entities() == [thing]
    assert thing in nvisii.entity.get_dirty_entities() and nvisii.entity.are_any_dirty()
    nvisii.render(8, 8, 1)
    assert nvisii.entity.get_dirty_entities() == [] and thing.is_clean()
    thing.clear_transform()
    with pytest.raises(RuntimeError, match="needs a transform and a mesh"):
        thing.get_min_aabb_corner()
    with pytest.raises(RuntimeError, match="needs a nvisii.mesh"):
        thing.set_mesh(nvisii.material.get("ball"))


def test_children_follow_their_parents(camera):
    thing = ball(radius=0.3)
    parent = nvisii.transform.create("parent")
    thing.get_transform().set_parent(parent)
    assert ids(17, 17)[8, 8] == thing.get_id()
    parent.set_position((0, 0, 1))
    seen = ids(17, 17)
    assert seen[8, 8] != thing.get_id() and seen[3, 8] == thing.get_id()
    parent.set_linear_velocity((0, 0, 1))
    nvisii.sample_time_interval((0, 0))
    assert ids(17, 17)[8, 8] == thing.get_id()


def test_clamps_and_depths(camera):
    nvisii.set_dome_light_color((0, 0, 0))
    ball(base_color=(0, 0, 0), specular=0).set_light(nvisii.light.create("l"))
    nvisii.light.get("l").use_surface_area(True)
    nvisii.light.get("l").set_intensity(50)
    assert gray(9, 9)[4, 4] == pytest.approx(50)
    nvisii.set_direct_lighting_clamp(5)
    nvisii.set_indirect_lighting_clamp(1)
    assert gray(9, 9)[4, 4] == pytest.approx(5)
    nvisii.set_direct_lighting_clamp(0)
    assert gray(9, 9)[4, 4] == pytest.approx(50)
    for call, message in (
        (lambda: nvisii.set_direct_lighting_clamp(-1), "clamp"),
        (lambda: nvisii.set_max_bounce_depth(-1), "diffuse_depth: -1"),
        (lambda: nvisii.set_light_sample_count(11), "between 1 and 10"),
        (lambda: nvisii.sample_pixel_area((0.5, 0.2)), "x_sample_interval"),
        (lambda: nvisii.configure_denoiser(use_albedo_guide=False), "albedo guide"),
    ):
        with pytest.raises(RuntimeError, match=message):
            call()
    nvisii.set_light_sample_count(4)
    nvisii.sample_pixel_area((0.5, 0.5), (0.5, 0.5))


def test_the_denoiser_makes_smooth(camera):
    pytest.importorskip("pyoidn")
    ball("floor", (0, 0, -11), 10)
    ball("shade", (0, 0, 0.5), 1.2)
    nvisii.configure_denoiser(use_albedo_guide=True, use_normal_guide=True)
    noisy = gray(48, 48, 1)
    nvisii.enable_denoiser()
    smooth = gray(48, 48, 1)
    nvisii.disable_denoiser()

    def roughness(image):
        return np.abs(np.diff(image[30:45], axis=1)).mean()

    assert roughness(smooth) < 0.5 * roughness(noisy)


def test_one_picture_is_one_callback_and_the_same_bytes(camera):
    ball()
    calls = []
    nvisii.register_callback(lambda: calls.append(len(calls)))
    first, second = nvisii.render(16, 16, 2, seed=7), nvisii.render(16, 16, 2, seed=7)
    assert calls == [0, 1] and np.array_equal(first, second)
    assert not np.array_equal(first, nvisii.render(16, 16, 2, seed=8))
    nvisii.register_pre_render_callback(None)
    nvisii.render(8, 8, 1)
    assert len(calls) == 3
    with pytest.raises(RuntimeError, match="no function"):
        nvisii.register_callback(5)


def test_there_is_no_window(camera):
    assert nvisii.should_window_close() and not nvisii.is_button_pressed("MOUSE_LEFT")
    assert not nvisii.is_button_held("W") and nvisii.get_cursor_pos() == [0, 0]
    nvisii.resize_window(320, 200)
    assert nvisii.get_window_size() == [320, 200]
    nvisii.set_cursor_mode("DISABLED")
    with pytest.raises(RuntimeError, match="mode"):
        nvisii.set_cursor_mode("GONE")
    nvisii.disable_updates()
    assert not nvisii.are_updates_enabled()
    nvisii.enable_updates()
    assert nvisii.are_updates_enabled()


def test_old_names_still_start_it():
    for start in (nvisii.initialize_headless, nvisii.initialize_interactive):
        with pytest.warns(DeprecationWarning, match="use nvisii.initialize"):
            start(verbose=True, max_entities=5)
        nvisii.transform.create("t")
        nvisii.clear_all()
        assert nvisii.transform.get_count() == 0
        nvisii.deinitialize()


def test_names_that_a_daemon_does_not_take_do_not_matter(camera):
    for name in ("", "x" * 300, "a/b*"):
        ball(name, radius=0.1)
    nvisii.render(8, 8, 1)
