"""Numbers that no ray can be computed with are refused, or meet nothing, and end no daemon."""

from __future__ import annotations

import heliograph as hg
import numpy as np
import pytest

LENS = hg.Camera.from_fov(50, 48, 32, degrees=True)
FAR = (1.1e8, 2e18, 1e25, 1e37)


def scaled(x=1.0, y=1.0, z=1.0):
    return np.diag([x, y, z, 1.0])


@pytest.fixture
def scene(scene):
    with scene.edit() as edit:
        edit.mesh("sphere", **hg.shapes.sphere(1))
        edit.entity("ball", mesh="sphere", material=edit.material("grey"), label=1)
        edit.entity(
            "other", mesh="sphere", material="grey", transform=hg.Pose((0, 2.5, 0)), label=2
        )
        edit.entity("cam", camera=LENS, transform=hg.look_at((6, 0, 0), (0, 1, 0)))
        edit.dome(color=(1, 1, 1))
    return scene


def picture(scene, **options):
    planes = ["beauty", "instance", "position"]
    return scene.render("cam", planes=planes, spp=2, labels=True, **options)


@pytest.mark.parametrize("far", FAR)
def test_a_camera_beyond_reach_is_refused(scene, far):
    for overlay_of in (
        lambda overlay: overlay.entity("cam", transform=hg.Pose((0, -far, 0))),
        lambda overlay: [
            overlay.entity("base", transform=hg.Pose((0, 0, far))),
            overlay.entity("cam", parent="base"),
        ],
    ):
        with scene.overlay() as overlay:
            overlay_of(overlay)
        with pytest.raises(hg.FailedPrecondition, match=r"within 1e\+08 m of") as error:
            picture(scene, overlay=overlay)
        assert error.value.field == "cameras[0]"
    assert set(np.unique(picture(scene)["instance"])) == {0, 1, 2}


def test_a_camera_within_reach_renders(scene):
    with scene.overlay() as overlay:
        overlay.entity("cam", transform=hg.Pose((9e7, 0, 0)))
        overlay.entity("ball", transform=hg.Pose((9e7, 0, -1e5), scale=3e4))
    assert (picture(scene, overlay=overlay)["instance"] == 1).any()


@pytest.mark.parametrize("far", FAR)
def test_a_ray_from_beyond_reach_is_refused(scene, far):
    for any_hit in (False, True):
        with pytest.raises(hg.InvalidArgument, match="farther than") as error:
            scene.cast_rays([(6, 0, 0), (0, far, 0)], [(-1, 0, 0)] * 2, any_hit=any_hit)
        assert error.value.field == "cast_rays.origins[1]"
    assert scene.cast_rays([(6, 0, 0)], [(-1, 0, 0)])["t"][0] == pytest.approx(5, abs=0.01)


@pytest.mark.parametrize(
    "axes", [(1e-19, 1e-5, 1e-5), (1e-29, 1, 1), (1, 1e-25, 1e-3), (1e-10, 1e-10, 1e-10)]
)
def test_an_entity_as_thin_as_nothing_is_not_seen(scene, axes):
    before = picture(scene)
    with scene.edit() as edit:
        edit.entity("ball", transform=scaled(*axes))
    frame = picture(scene)
    assert not (frame["instance"] == 1).any()
    other = before["instance"] == 2
    np.testing.assert_array_equal(frame["instance"][other], 2)
    np.testing.assert_array_equal(frame["position"][other], before["position"][other])
    scene.visible("cam", ["ball", "other"])
    scene.pick("cam", [(24, 16)])


def test_parents_that_make_it_so(scene):
    with scene.edit() as edit:
        edit.entity("small", transform=scaled(1e-10, 1e-10, 1e-10))
        edit.entity("smaller", parent="small", transform=scaled(1e-10, 1e-10, 1e-10))
        edit.entity("ball", parent="smaller")
    assert set(np.unique(picture(scene)["instance"])) == {0, 2}


def test_what_is_small_is_seen_from_near(scene):
    """The smallest that an edit may say."""
    with scene.edit() as edit:
        edit.entity("ball", transform=scaled(1.1e-10, 1.1e-10, 1.1e-10))
        edit.entity("cam", transform=hg.look_at((6e-10, 0, 0), (0, 0, 0)))
    frame = picture(scene)
    assert (frame["instance"] == 1).sum() > 50


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
def test_coordinates_that_no_float_holds_the_difference_of(scene, wrap):
    plane = hg.shapes.plane(4.0)
    huge = np.where(plane["uvs"] > 0.5, 3e38, -3e38).astype("f4")
    texels = np.full((64, 64, 3), 200, "u1")
    with scene.edit() as edit:
        texture = edit.texture("checks", texels, wrap=(wrap, wrap))
        edit.material("painted", base_color=texture)
        shifted = hg.Tex(texture, uv=((3e38, 3e38, 0), (0, 1, 0)))
        edit.material("shifted", base_color=shifted)
        edit.mesh("far", **{**plane, "uvs": huge})
        edit.mesh("plane", **plane)
        edit.entity("floor", mesh="far", material="painted", transform=hg.Pose((0, 0, -1)))
        edit.entity("ground", mesh="plane", material="shifted", transform=hg.Pose((0, 4, -1)))
    frame = scene.render("cam", spp=4, planes=["beauty", "base_color"])
    assert np.isfinite(frame["beauty"]).all() and np.isfinite(frame["base_color"]).all()
