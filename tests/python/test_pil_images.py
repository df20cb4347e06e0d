"""PIL images of all modes as textures: converted, or refused by name."""

import heliograph as hg
import numpy as np
import pytest
from heliograph._wire.arrays import from_message
from PIL import Image

RED = Image.new("RGB", (5, 4), (200, 30, 30))
CONVERTED = {"1": 1, "L": 1, "LA": 2, "P": 3, "PA": 4, "RGB": 3, "RGBX": 3, "RGBA": 4, "RGBa": 4}
CONVERTED |= {"CMYK": 3, "YCbCr": 3, "HSV": 3}


def of_mode(mode):
    if mode in ("P", "PA"):
        return RED.quantize(4).convert(mode)
    return RED.convert("RGBA").convert(mode) if mode == "RGBa" else RED.convert(mode)


def texels(daemon, scene, image):
    with scene.edit() as edit:
        edit.texture("t", image)
    return from_message(daemon.transactions[-1].edits[0].texture.texels)


@pytest.mark.parametrize("mode", CONVERTED)
def test_an_image_has_the_colours_that_it_shows(daemon, scene, mode):
    made = texels(daemon, scene, of_mode(mode))
    channels = CONVERTED[mode]
    assert made.dtype == np.uint8
    assert made.shape == ((4, 5) if channels == 1 else (4, 5, channels))
    shown = np.asarray(of_mode(mode).convert("RGBA" if channels % 2 == 0 else "RGB"))
    if channels > 2:
        assert np.abs(made.astype(int) - shown).max() == 0
        assert np.abs(made[0, 0, :3].astype(int) - (200, 30, 30)).max() <= 3
    else:
        assert (made.reshape(4, 5, channels)[..., 0] == shown[..., 0]).all()


def test_a_transparent_colour_becomes_alpha(daemon, scene):
    image = RED.quantize(4)
    image.info["transparency"] = image.getpixel((0, 0))
    assert texels(daemon, scene, image)[0, 0, 3] == 0
    grey = Image.new("L", (5, 4), 7)
    grey.info["transparency"] = 7
    assert (texels(daemon, scene, grey)[..., 1] == 0).all()


def test_sixteen_bits_stay(daemon, scene):
    numbers = np.arange(20, dtype="<u2").reshape(4, 5) * 3000
    made = texels(daemon, scene, Image.fromarray(numbers))
    assert made.dtype == np.uint16 and (made == numbers).all()


@pytest.mark.parametrize("mode", ["F", "I", "LAB"])
def test_numbers_that_are_no_colours_are_refused(scene, mode):
    image = Image.new(mode, (5, 4))
    with scene.edit() as edit, pytest.raises(hg.InvalidArgument, match=f"mode '{mode}'"):
        edit.texture("t", image)
