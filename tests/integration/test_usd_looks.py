"""Cameras, lights and materials of USD files, and what is wrong or left out, against arithmetic."""

import math
import subprocess
import sys

import heliograph as hg
import lit_stages
import moving_stages
import numpy as np
import pytest
import stages
from PIL import Image

pytest.importorskip("pxr", reason="the extra `usd` is not installed")


# ---------------------------------------------------------------- cameras and lights


def test_a_camera_sees_what_its_apertures_say(scene, tmp_path):
    """A square of side 2 at a distance of 4, focal length and apertures 20: half of the width."""
    path = stages.written(tmp_path, lit_stages.CAMERA, "metersPerUnit = 0.01", 'upAxis = "Y"')
    asset = stages.put(scene, path, camera_width=80)
    camera = asset.cameras["/Cam"]
    assert (camera.camera.width, camera.camera.height) == (80, 40)
    assert camera.camera.near == pytest.approx(0.01)
    frame = scene.render(camera, spp=1, planes=["depth", "instance"])
    seen = frame["instance"] > 0
    assert seen.any(axis=0).sum() == 40 and seen.any(axis=1).sum() == 40
    np.testing.assert_allclose(frame["depth"][20, 40], 0.04, rtol=1e-5)
    shifted = scene.render(asset.cameras["/Shifted"], spp=1, planes=["instance"])["instance"] > 0
    assert np.flatnonzero(shifted.any(axis=0))[0] == 20 - 8  # the offset is a tenth of the width


@pytest.mark.parametrize("kind", list(lit_stages.LIGHTS))
def test_lights_give_the_irradiance_of_their_formulae(scene, tmp_path, kind):
    """On a white matt floor: radiance = irradiance / pi."""
    path = stages.written(tmp_path, lit_stages.lit(kind))
    asset = stages.put(scene, path, nit=1.0)
    frame = scene.render("above", spp=256, planes=["beauty"], seed=1)
    found = frame["beauty"][28:36, 28:36, :3].mean(axis=(0, 1))
    expected = np.divide(lit_stages.LIGHTS[kind][1], math.pi)
    np.testing.assert_allclose(found, np.broadcast_to(expected, 3), rtol=0.03)
    assert asset.warnings == []


def test_lights_of_a_stage_in_centimetres_are_as_bright(scene, tmp_path):
    path = stages.written(
        tmp_path, lit_stages.IN_CENTIMETRES, "metersPerUnit = 0.01", 'upAxis = "Z"'
    )
    stages.put(scene, path, nit=1.0)
    frame = scene.render("above", spp=256, planes=["beauty"], seed=1)
    found = frame["beauty"][28:36, 28:36, :3].mean(axis=(0, 1))
    np.testing.assert_allclose(found, lit_stages.LIGHTS["sphere"][1] / math.pi, rtol=0.03)


def test_a_dome_s_picture_is_turned_as_openexr_has_it(scene, tmp_path):
    """+Z of a stage with +Y up is the picture's middle, +X is a quarter to the left."""
    texels = np.zeros((8, 16, 3), np.uint8)
    texels[:, 7:9], texels[:, 3:5] = (255, 0, 0), (0, 255, 0)
    Image.fromarray(texels).save(tmp_path / "sky.png")
    path = stages.written(tmp_path, lit_stages.DOME, 'upAxis = "Y"', "metersPerUnit = 1")
    stages.put(scene, path, nit=1.0)
    with scene.edit() as edit:
        for name, at in {"z": (0, -1, 0), "x": (1, 0, 0)}.items():  # of the stage, in our world
            lens = hg.Camera.from_fov(10, 8, 8, degrees=True)
            edit.entity(name, camera=lens, transform=hg.look_at((0, 0, 0), at))
    seen = {n: scene.render(n, spp=4, planes=["beauty"])["beauty"][4, 4, :3] for n in "zx"}
    np.testing.assert_allclose(seen["z"], (2, 0, 0), atol=0.02)
    np.testing.assert_allclose(seen["x"], (0, 2, 0), atol=0.02)


# ---------------------------------------------------------------- materials, faults


def test_parameters_of_preview_surface_omnipbr_and_omniglass(scene, tmp_path):
    asset = stages.put(scene, stages.written(tmp_path, lit_stages.MATERIALS))
    preview = asset.materials["/Preview"].parameters
    assert preview["metallic"] == 1 and preview["roughness"] == pytest.approx(0.25)
    assert preview["clearcoat"] == pytest.approx(0.5)
    assert preview["emission_strength"] == pytest.approx(1 / 683, rel=1e-5)
    omni = asset.materials["/Omni"].parameters
    np.testing.assert_allclose(omni["base_color"], np.multiply((0.5, 0.4, 0.2), 0.5), rtol=1e-5)
    assert omni["roughness"] == pytest.approx(0.3) and omni["metallic"] == pytest.approx(0.9)
    assert omni["emission_strength"] == pytest.approx(683 / 683, rel=1e-5)
    assert asset.materials["/Glass"].parameters["ior"] == pytest.approx(1.3)
    assert any("MyOwn is left out: grey taken" in warning for warning in asset.warnings)


def test_textures_of_omnipbr(scene, tmp_path):
    Image.new("RGB", (4, 4), (255, 128, 64)).save(tmp_path / "orm.png")
    Image.new("RGB", (4, 4), (255, 255, 0)).save(tmp_path / "color.png")
    asset = stages.put(scene, stages.written(tmp_path, lit_stages.OMNI_TEXTURES))
    frame = scene.render("above", spp=1, planes=["base_color", "roughness", "metallic"])
    np.testing.assert_allclose(frame["base_color"][32, 32], (1, 0.5, 0), atol=1e-3)
    assert frame["roughness"][32, 32] == pytest.approx(128 / 255, abs=1e-3)
    assert frame["metallic"][32, 32] == pytest.approx(64 / 255, abs=1e-3)
    assert asset.warnings == []


def test_what_is_left_out_is_named(scene, tmp_path):
    asset = stages.put(scene, stages.written(tmp_path, lit_stages.LEFT_OUT))
    text = "\n".join(asset.warnings)
    for what in (
        "/Curves: NurbsCurves is left out",
        "/Ball: catmullClark is not subdivided (give subdivision=)",
        "/Broken: a mesh without faces",
        "/Lamp: shaping:ies is left out",
        "/Gone: it is not composed whole: Could not open asset @",
        "/Hinge: a joint that connects no two bodies is left out",
        "a texture is left out: the file 'none.png' is not there",
    ):
        assert what in text, text


def test_a_broken_stage_is_read_as_far_as_it_goes(scene, tmp_path):
    asset = stages.put(scene, stages.written(tmp_path, lit_stages.BROKEN))
    text = "\n".join(asset.warnings)
    for what in (
        "/Zero: an axis of its transform has no length",
        "/Nan: its transform is not finite",
        "/Inf: size is not finite; 2 taken",
        "/NanPoints and 2 more: a mesh without faces",
        "/Flat: the primvar normals has too few vertex values",
        "/Cam: a camera without an aperture",
        "/I: its instances and their prototypes do not fit",
        "/Self: a prototype within itself is left out",
    ):
        assert what in text, text
    assert np.ptp(asset.entities["/Zero/C"].aabb, axis=0).max() < 1e-4
    scene.render("above", spp=1)


def test_faults_are_named(scene, tmp_path):
    bad = tmp_path / "bad.usda"
    bad.write_text("#usda 1.0\ndef {\n")
    for path, error in ((bad, hg.InvalidArgument), (tmp_path / "none.usd", hg.NotFound)):
        with pytest.raises(error, match=path.name), scene.edit() as edit:
            edit.import_usd(path)
    with pytest.raises(hg.InvalidArgument, match="import_usd"), scene.edit() as edit:
        edit.import_file(bad)
    good = stages.written(tmp_path, stages.TILES)
    for wrong in ({"purposes": ["all"]}, {"times": "some"}, {"colour": 1}):
        with pytest.raises(hg.InvalidArgument), scene.edit() as edit:
            edit.import_usd(stages.written(tmp_path, moving_stages.TURNING), name="no", **wrong)
    assert good.exists()


def test_without_the_package_it_says_how_to_install_it(tmp_path):
    program = """
import sys
sys.modules["pxr"] = None
import heliograph as hg
from heliograph.usd.edits import UsdEdits
try:
    UsdEdits().import_usd("x.usd")
except hg.Unimplemented as error:
    print(error)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert "pip install 'heliograph[usd]'" in done.stdout
