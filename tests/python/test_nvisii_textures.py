"""nvisii.texture: arrays, mixes, samples; it needs no daemon."""

import numpy as np
import nvisii
import pytest
from PIL import Image


@pytest.fixture(autouse=True)
def empty():
    yield
    nvisii.clear_all()


def flat(name, rgba, size=2, **how):
    return nvisii.texture.create_from_data(name, size, size, np.tile(rgba, size * size), **how)


def first(texture):
    return [round(float(v), 3) for v in texture.get_float_texels()[:4]]


def test_row_0_is_the_bottom_and_bytes_are_rounded():
    values = np.arange(16, dtype="f4") / 16
    made = nvisii.texture.create_from_data("t", 2, 2, values, hdr=True)
    assert made.get_float_texels().tolist() == values.tolist() and made.is_hdr()
    assert made.sample_float_texels((0.25, 0.25)) == values[:4].tolist()
    assert made.sample_float_texels((0.25, 0.75)) == values[8:12].tolist()
    middle = made.sample_float_texels((0.5, 0.5))
    assert list(middle) == pytest.approx(values.reshape(4, 4).mean(axis=0).tolist())
    small = nvisii.texture.create_from_data("b", 1, 1, [0.5, -1, 2, 1])
    assert small.get_byte_texels().tolist() == [128, 0, 255, 255] and not small.is_hdr()
    assert small.is_linear()
    small.set_linear(False)
    assert not small.is_linear()
    with pytest.raises(RuntimeError, match="16 floats, not 15"):
        nvisii.texture.create_from_data("x", 2, 2, values[:15])
    with pytest.raises(RuntimeError, match="scale"):
        made.set_scale((0, 1))


def test_mixes_are_linear_and_of_the_larger_size():
    a, b = flat("a", [0.2, 0.4, 0.6, 1]), flat("b", [0.6, 0.4, 0.2, 1], size=4)
    mix = nvisii.texture.create_mix("m", a, b, 0.25)
    assert first(mix) == pytest.approx([0.3, 0.4, 0.5, 1], abs=0.005) and mix.get_width() == 4
    total = nvisii.texture.create_add("s", a, b, hdr=True)
    assert first(total) == pytest.approx([0.8, 0.8, 0.8, 2], abs=0.005)
    product = nvisii.texture.create_multiply("p", a, b, hdr=True)
    assert first(product) == pytest.approx([0.12, 0.16, 0.12, 1], abs=0.005)
    srgb = flat("c", [0.5, 0.5, 0.5, 1], linear=False)
    assert first(nvisii.texture.create_mix("l", srgb, srgb, 0, hdr=True))[0] == pytest.approx(
        0.216, abs=0.003
    )


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ((0.5, 1, 1), [0.8, 0.4, 0.2]),
        ((0.5, 0, 1), [0.8, 0.8, 0.8]),
        ((0.5, 1, 0.5), [0.4, 0.2, 0.1]),
        ((0.5 + 1 / 3, 1, 1), [0.2, 0.8, 0.4]),
        ((0.0, 1, 1), [0.2, 0.6, 0.8]),
    ],
)
def test_hue_saturation_and_value(change, expected):
    source = flat("t", [0.8, 0.4, 0.2, 1], hdr=True)
    made = nvisii.texture.create_hsv("h", source, *change, hdr=True)
    assert first(made)[:3] == pytest.approx(expected, abs=0.002)
    half = nvisii.texture.create_hsv("half", source, *change, mix=0.5, hdr=True)
    halfway = [(a + b) / 2 for a, b in zip(expected, (0.8, 0.4, 0.2), strict=True)]
    assert first(half)[:3] == pytest.approx(halfway, abs=0.002)


def test_what_is_removed_is_used_no_more():
    texture, look = flat("t", [1, 0, 0, 1]), nvisii.material.create("m")
    look.set_base_color_texture(texture)
    look.set_roughness_texture(texture, channel=1)
    light = nvisii.light.create("l")
    light.set_color_texture(texture)
    nvisii.texture.remove("t")
    assert look._used() == light._used() == []
    with pytest.raises(RuntimeError, match="was removed"):
        look.set_base_color_texture(texture)
    with pytest.raises(RuntimeError, match="channel"):
        look.set_roughness_texture(flat("u", [0, 0, 0, 1]), 4)
    with pytest.raises(RuntimeError, match="roughness: needs a number"):
        look.set_roughness("rough")


def test_material_arguments_are_what_get_gives():
    look = nvisii.material.create("m", base_color=[0.1, 0.2, 0.3], roughness=2, sheen_tint=0.25)
    assert look.get_base_color() == [0.1, 0.2, 0.3]
    assert look.get_roughness() == 2 and look.get_sheen_tint() == 0.25  # kept as given
    look.set_base_color(color=(1, 1, 0))
    look.set_metallic(metallic=0.5)
    assert look.get_base_color() == [1, 1, 0] and look.get_metallic() == 0.5
    with pytest.raises(TypeError):
        look.set_metallic(rough=1)


def test_grey_of_16_bits_and_of_floats_is_not_cut_off(tmp_path):
    ramp = np.array([[0, 1000, 32896, 65535]], np.uint16)
    Image.fromarray(ramp).save(tmp_path / "grey.png")
    made = nvisii.texture.create_from_file("grey", tmp_path / "grey.png", linear=True)
    assert made.get_byte_texels().reshape(4, 4)[:, 0].tolist() == [0, 4, 128, 255]
    Image.fromarray(ramp.astype("f4") / 100).save(tmp_path / "grey.tif")
    floats = nvisii.texture.create_from_file("floats", tmp_path / "grey.tif")
    assert floats.is_hdr() and floats.is_linear()
    assert floats.get_float_texels().reshape(4, 4)[1].tolist() == [10, 10, 10, 1]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_texels_of_files_and_of_sums_are_finite(tmp_path):
    path = tmp_path / "grey.tif"
    Image.fromarray(np.array([[0, np.inf]], "f4")).save(path)
    with pytest.raises(RuntimeError, match="grey.tif: every number must be finite"):
        nvisii.texture.create_from_file("file", path)
    half = flat("half", [2e38, 0, 0, 1], hdr=True)
    with pytest.raises(RuntimeError, match='"sum": every number must be finite'):
        nvisii.texture.create_add("sum", half, half, hdr=True)


def test_bytes_are_no_floats():
    with pytest.raises(RuntimeError, match="divide them by 255"):
        nvisii.texture.create_from_data("b", 1, 1, np.full(4, 200, np.uint8))


@pytest.mark.parametrize(("last", "message"), [(b"\x85\x07", "too long"), (b"\x83", "range")])
def test_run_lengths_that_do_not_fit_a_radiance_picture(tmp_path, last, message):
    rows = b"\x02\x02\x00\x08" + b"\x88\x80" * 3 + b"\x04\x81\x82\x81\x82"
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 8\n"
    path = tmp_path / "dome.hdr"
    path.write_bytes(head + rows + b"\x84\x81")
    made = nvisii.texture.create_from_file("whole", str(path))
    expected = [(128 + 0.5) * 2.0 ** (e - 136) for e in (0x81, 0x82, 0x81, 0x82, *[0x81] * 4)]
    assert made.get_float_texels().reshape(8, 4)[:, 0].tolist() == expected
    path.write_bytes(head + rows + last)
    with pytest.raises(RuntimeError, match=message):
        nvisii.texture.create_from_file("bad", str(path))
