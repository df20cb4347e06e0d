"""glTF files that leave a choice: variants of materials, and textures as KTX 2."""

import base64
import json
import pathlib

import heliograph as hg
import numpy as np
import pytest

PICTURES = pathlib.Path(__file__).parents[1] / "assets/picture"
CORNERS = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, -1, 0], [1, 1, 0], [-1, 1, 0]], "<f4")
UVS = np.array([[0, 1], [1, 1], [1, 0], [0, 1], [1, 0], [0, 0]], "<f4")
GREEN, RED = (0, 1, 0), (1, 0, 0)


def gltf(primitive, **members):
    """A square in the plane of the camera."""
    data = CORNERS.tobytes() + UVS.tobytes()
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0, **primitive}
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "buffers": [
                {
                    "byteLength": len(data),
                    "uri": "data:;base64," + base64.b64encode(data).decode(),
                }
            ],
            "bufferViews": [
                {"buffer": 0, "byteLength": CORNERS.nbytes},
                {"buffer": 0, "byteOffset": CORNERS.nbytes, "byteLength": UVS.nbytes},
            ],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5126, "count": 6, "type": "VEC2"},
            ],
            "meshes": [{"primitives": [primitive]}],
            "nodes": [{"mesh": 0, "rotation": [0.7071068, 0, 0, -0.7071068]}],  # facing +Z here
            **members,
        }
    )


def linear(encoded):
    """IEC 61966-2-1."""
    encoded = np.maximum(encoded, 0)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def color(scene, path, side=16, **options):
    with scene.edit() as edit:
        asset = edit.import_file(path, **options)
        lens = hg.Camera.from_fov(53.13, side, side, degrees=True)  # sees the square and no more
        edit.entity("cam", camera=lens, transform=hg.look_at((0, 0, 2), (0, 0, 0), (0, 1, 0)))
    return scene.render("cam", planes=["base_color"])["base_color"][..., :3], asset.warnings


@pytest.fixture
def shoe(tmp_path):
    plain = [{"pbrMetallicRoughness": {"baseColorFactor": [*rgb, 1]}} for rgb in (GREEN, RED)]
    variants = {"variants": [{"name": "green"}, {"name": "red"}]}
    mappings = {"mappings": [{"material": 1, "variants": [1]}]}
    path = tmp_path / "shoe.gltf"
    path.write_text(
        gltf(
            {"extensions": {"KHR_materials_variants": mappings}},
            materials=plain,
            extensionsUsed=["KHR_materials_variants"],
            extensions={"KHR_materials_variants": variants},
        )
    )
    return path


@pytest.mark.parametrize(("variant", "seen"), [("", GREEN), ("green", GREEN), ("red", RED)])
def test_the_variant_that_was_asked_for_is_shown(scene, shoe, variant, seen):
    pixels, warnings = color(scene, shoe, variant=variant)
    assert pixels[8, 8] == pytest.approx(seen, abs=1e-6)
    assert ("green, red" in " ".join(warnings)) == (not variant)


def test_a_variant_that_is_not_there_is_refused_with_those_that_are(scene, shoe, tmp_path):
    with pytest.raises(hg.NotFound, match="green, red") as refused:
        color(scene, shoe, variant="blue")
    assert refused.value.field == "variant"
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(hg.InvalidArgument, match="variant"):
        color(scene, tmp_path / "a.obj", variant="red")


@pytest.mark.parametrize(("name", "close"), [("ramp_etc1s.ktx2", 0.15), ("ramp_uastc.ktx2", 0.06)])
def test_a_texture_as_ktx2_is_that_of_its_picture(scene, tmp_path, name, close):
    """Both hold 32 by 24 texels of (8 x, 10 y, 128), which glTF takes as sRGB."""
    path = tmp_path / "square.gltf"
    path.write_text(
        gltf(
            {},
            materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
            textures=[{"extensions": {"KHR_texture_basisu": {"source": 0}}}],
            images=[{"uri": name, "mimeType": "image/ktx2"}],
            extensionsRequired=["KHR_texture_basisu"],
            extensionsUsed=["KHR_texture_basisu"],
        )
    )
    (tmp_path / name).write_bytes((PICTURES / name).read_bytes())
    pixels, warnings = color(scene, path, side=32)
    assert not warnings
    red = linear(8 * np.arange(32) / 255)
    green = linear(10 * (np.arange(32) + 0.5) * 24 / 32 / 255 - 5 / 255)
    assert np.abs(pixels[16, 1:31, 0] - red[1:31]).max() < close
    assert np.abs(pixels[1:31, 16, 1] - green[1:31]).max() < close
    assert np.abs(pixels[1:31, 1:31, 2] - linear(128 / 255)).max() < close
