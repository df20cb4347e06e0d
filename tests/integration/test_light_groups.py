"""Light groups through the daemon: planes, scene files, and relighting."""

import heliograph as hg
import numpy as np
import pytest

SUN = hg.Light(irradiance=2, color=(1, 0.9, 0.7), sun_angle=0.05)
FACTORS = {"key": 2.0, "fill": (1, 0.5, 0.2), "sky": 0}


@pytest.fixture(scope="module")
def studio(client):
    with client.create_scene() as scene:
        with scene.edit() as edit:
            edit.sample_studio()
            edit.dome(None, color=(0.2, 0.3, 0.5), light_group="sky")
            quad = edit.mesh(
                positions=[[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]],
                indices=[[0, 2, 1], [0, 3, 2]],
            )
            glow = edit.material(emission=(1, 0.2, 0.1), emission_strength=3)
            lamp = hg.Light(radiance=4)
            edit.entity("lamp", mesh=quad, light=lamp, transform=hg.Pose((2, 0, 3)))
            edit.update("lamp", light_group="key")
            edit.entity("sun", light=SUN, transform=hg.look_at((3, 2, 4), (0, 0, 0)))
            edit.update("sun", light_group="key")
            edit.entity("bars", mesh=quad, material=glow, transform=hg.Pose((-2, 0, 2)))
            edit.update("bars", light_group="fill")
            edit.entity("rest", mesh=quad, light=lamp, transform=hg.Pose((0, 3, 4)))
            eye = hg.look_at((0, -6, 3), (0, 0, 0.5))
            edit.entity("cam", camera=hg.Camera.from_fov(60, 40, 30, degrees=True), transform=eye)
        yield scene


PLANES = ["beauty", "beauty:key", "beauty:fill", "beauty:sky", "beauty:"]


def test_the_groups_sum_to_the_beauty(studio):
    frame = studio.render("cam", planes=PLANES, spp=40)
    assert frame.planes == PLANES
    sums = sum(frame[name].astype("f8") for name in PLANES[1:])
    np.testing.assert_allclose(sums, frame["beauty"][..., :3], rtol=1e-5, atol=1e-7)
    for name in PLANES[1:]:
        assert frame[name].shape == (30, 40, 3) and frame[name].max() > 0.05, name
    np.testing.assert_array_equal(
        studio.render("cam", planes=["beauty"], spp=40)["beauty"], frame["beauty"]
    )


def test_relight_is_the_sum_of_scaled_groups(studio):
    frame = studio.render("cam", planes=PLANES, spp=40)
    relit = frame.relight(FACTORS)
    want = 2 * frame["beauty:key"] + (1, 0.5, 0.2) * frame["beauty:fill"] + frame["beauty:"]
    np.testing.assert_allclose(relit[..., :3], want, rtol=1e-4, atol=1e-6)
    np.testing.assert_array_equal(relit[..., 3], frame["beauty"][..., 3])
    np.testing.assert_allclose(frame.relight({}), frame["beauty"])


def test_relight_agrees_with_a_new_render_in_the_mean(studio):
    """Means over the image of 16 pairs of frames: |z| below 4.9 (1e-6) in each channel."""
    with studio.overlay() as changed:
        changed.update("lamp", light=hg.Light(radiance=8))
        changed.update("sun", light=hg.Light(irradiance=4, color=SUN.color, sun_angle=0.05))
        changed.update("bars", material=changed.material(emission=(3, 0.3, 0.06)))
        changed.dome(color=0)
    differences = []
    for seed in range(16):
        relit = studio.render("cam", planes=PLANES, spp=16, seed=seed).relight(FACTORS)
        again = studio.render("cam", spp=16, seed=100 + seed, overlay=changed)["beauty"]
        differences.append((relit - again)[..., :3].mean(axis=(0, 1)))
    z = np.mean(differences, axis=0) / (np.std(differences, axis=0, ddof=1) / 4)
    assert np.abs(z).max() < 4.9, z


def test_what_has_no_such_plane_or_factor_is_refused(studio):
    frame = studio.render("cam", planes=["beauty", "beauty:key"], spp=1)
    with pytest.raises(KeyError, match="beauty:fill"):
        frame.relight({"fill": 2})
    with pytest.raises(hg.InvalidArgument, match="below 0"):
        frame.relight({"key": (1, -1, 1)})
    with pytest.raises(KeyError, match="no plane 'beauty'"):
        studio.render("cam", planes=["beauty:key"], spp=1)["beauty"]


def test_groups_survive_scene_files_and_are_reset(studio, tmp_path):
    assert studio["lamp"].light_group == "key"
    studio.save(tmp_path / "studio.helio")
    with studio.client.load_scene(tmp_path / "studio.helio") as again:
        assert again["bars"].light_group == "fill"
        a, b = (s.render("cam", planes=PLANES, spp=2) for s in (studio, again))
        for name in PLANES:
            np.testing.assert_array_equal(a[name], b[name])
        with again.edit() as edit:
            edit.update("bars", light_group=None)
            edit.dome(light_group=None)
        frame = again.render("cam", planes=["beauty:key", "beauty:"], spp=2)
        want = a["beauty:fill"] + a["beauty:sky"] + a["beauty:"]
        np.testing.assert_allclose(frame["beauty:"], want, rtol=1e-5, atol=1e-7)
