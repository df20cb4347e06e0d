"""The plane `denoised`: Open Image Denoise behind the daemon."""

import json
import re

import heliograph as hg
import numpy as np
import pytest


def furnish(scene):
    """A room of coloured balls under a small lamp."""
    with scene.edit() as edit:
        mesh = edit.mesh("ball", **hg.shapes.sphere(0.4))
        for i, color in enumerate([(0.8, 0.2, 0.1), (0.2, 0.7, 0.3), (0.2, 0.3, 0.8)]):
            material = edit.material(f"paint{i}", base_color=color, roughness=0.6)
            place = hg.Pose((i - 1.0, 0, 0.4))
            edit.entity(None, mesh=mesh, material=material, transform=place)
        edit.entity("floor", mesh=edit.mesh("plane", **hg.shapes.plane(8)))
        lamp = hg.Light(radiance=60)
        edit.entity(
            "lamp",
            mesh=edit.mesh("bulb", **hg.shapes.sphere(0.15)),
            light=lamp,
            transform=hg.Pose((1, -1, 2.5)),
        )
        edit.dome(color=(0.1, 0.12, 0.15))
        lens = hg.Camera.from_fov(50, 96, 64, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, -4, 2), (0, 0, 0.3)))


def rmse(picture, reference):
    """RMSE of radiance compressed as the eye does: x / (1 + x)."""
    a, b = (p[..., :3] / (1 + p[..., :3]) for p in (picture, reference))
    return float(np.sqrt(np.mean((a - b) ** 2)))


def test_denoised_is_nearer_the_truth_than_four_times_the_samples(scene):
    furnish(scene)
    truth = scene.render("cam", spp=1024, seed=99)["beauty"]
    few = scene.render("cam", spp=8, seed=1, planes=["beauty", "denoised"])
    many = scene.render("cam", spp=32, seed=1)["beauty"]
    assert rmse(few["denoised"], truth) < rmse(many, truth) < rmse(few["beauty"], truth)
    assert np.array_equal(few["denoised"][..., 3], few["beauty"][..., 3])


def test_denoised_alone_and_again_gives_the_same_bytes(scene):
    furnish(scene)
    first, second = (scene.render("cam", spp=8, planes=["denoised"]) for _ in range(2))
    assert first.planes == ["denoised"]
    assert first["denoised"].tobytes() == second["denoised"].tobytes()
    assert re.fullmatch(
        r"Open Image Denoise 2\.\d+\.\d+ on the CPU", json.loads(first.manifest)["denoiser"]
    )
    assert "denoiser" not in scene.render("cam", spp=1).manifest and first.warnings == []
    again = scene.rerender(first.manifest)
    assert first["denoised"].tobytes() == again["denoised"].tobytes()


@pytest.mark.parametrize("library", ["off", "/nowhere/libOpenImageDenoise.so.2", "libc.so.6"])
def test_without_the_library_it_says_what_to_do(library):
    with hg.connect(arguments=["--denoiser", library]) as client, client.create_scene() as scene:
        furnish(scene)
        with pytest.raises(hg.Unimplemented, match=r"DENOISED.*--denoiser") as caught:
            scene.render("cam", spp=1, planes=["denoised"])
        assert caught.value.field == "planes"
        assert scene.render("cam", spp=1)["beauty"].any()
