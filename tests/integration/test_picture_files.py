"""Pictures of every format and kind of number, as PIL and OpenEXR write them."""

from __future__ import annotations

import io
import struct
import warnings

import heliograph as hg
import numpy as np
import OpenEXR
import pytest
from heliograph._wire._proto import scene_pb2 as pb
from heliograph._wire.arrays import from_message
from PIL import Image

SRGB, LINEAR = pb.Texture.ENCODING_SRGB, pb.Texture.ENCODING_LINEAR


@pytest.fixture(scope="module")
def scene(client):
    with client.create_scene() as made:
        yield made


@pytest.fixture
def read(scene, tmp_path):
    """Texels, encoding and warnings of a file with these bytes."""

    def read(name, data, **options):
        path = tmp_path / name
        path.write_bytes(data)
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            with scene.edit() as edit:
                texture = edit.texture("picture", path, **options)
        message = texture._read("texture")[0].texture
        texels = from_message(message.texels)
        return (
            texels.reshape(*texels.shape[:2], -1),
            message.encoding,
            [str(w.message) for w in warned],
        )

    return read


def drawn(mode="RGB"):
    """A picture without symmetry, of smooth colours and an edge."""
    y, x = np.mgrid[0:40, 0:60]
    picture = np.stack([4 * x, 6 * y, np.where(x > y, 200, 30), 90 + 2 * x + y], -1).astype("u1")
    return Image.fromarray(picture, "RGBA").convert(mode)


def saved(image, kind, **options):
    file = io.BytesIO()
    image.save(file, kind, **options)
    return file.getvalue()


def exr(channels, **header):
    file = io.BytesIO()
    made = OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, **header}, channels)
    made.write(file)
    return file.getvalue()


LOSSLESS = [
    ("bmp", "BMP", {}),
    ("tga", "TGA", {}),
    ("tga", "TGA", {"compression": "tga_rle"}),
    ("webp", "WEBP", {"lossless": True}),
    ("jp2", "JPEG2000", {}),
    ("dds", "DDS", {}),
    ("ppm", "PPM", {}),
    ("sgi", "SGI", {}),
    ("png", "PNG", {}),
    ("tif", "TIFF", {"compression": "tiff_lzw"}),
    ("ico", "ICO", {"sizes": [(60, 40), (16, 16)]}),
]


@pytest.mark.parametrize(("ending", "kind", "options"), LOSSLESS)
def test_a_lossless_format_gives_the_texels_that_were_saved(read, ending, kind, options):
    texels, encoding, warned = read(f"a.{ending}", saved(drawn(), kind, **options))
    np.testing.assert_array_equal(texels[..., :3], np.asarray(drawn()))
    assert encoding == SRGB and warned == []


@pytest.mark.parametrize("kind", ["TGA", "WEBP", "PNG", "TIFF", "DDS", "JPEG2000"])
def test_alpha_stays_straight(read, kind):
    options = {"lossless": True, "exact": True} if kind == "WEBP" else {}
    texels, _, _ = read(f"a.{kind.lower()}", saved(drawn("RGBA"), kind, **options))
    np.testing.assert_array_equal(texels, np.asarray(drawn("RGBA")))


@pytest.mark.parametrize(
    ("mode", "kind", "options"),
    [
        ("1", "PNG", {}),
        ("1", "TIFF", {"compression": "group4"}),
        ("L", "PNG", {}),
        ("LA", "PNG", {}),
        ("P", "PNG", {}),
        ("P", "GIF", {}),
        ("P", "TIFF", {}),
        ("L", "JPEG", {}),
        ("RGB", "JPEG", {"progressive": True}),
        ("CMYK", "JPEG", {}),
        ("CMYK", "TIFF", {}),
        ("I;16", "PNG", {}),
    ],
)
def test_modes_of_numbers_become_grey_or_colours(read, mode, kind, options):
    image = drawn("L" if mode == "I;16" else mode)
    if mode == "I;16":
        image = Image.fromarray(np.asarray(image).astype("u2") * 257)
    data = saved(image, kind, **options)
    texels, _, _ = read("a." + kind.lower(), data)
    again = Image.open(io.BytesIO(data))
    wanted = {"1": "L", "P": "RGB", "CMYK": "RGB"}.get(again.mode, again.mode)
    wanted = np.asarray(again if again.mode == wanted else again.convert(wanted))
    wanted = wanted.reshape(*wanted.shape[:2], -1)
    np.testing.assert_allclose(texels[..., : wanted.shape[2]], wanted, atol=1)
    assert texels.dtype == (np.uint16 if mode == "I;16" else np.uint8)


@pytest.mark.parametrize("blocks", ["DXT1", "DXT3", "DXT5"])
def test_blocks_of_a_dds_are_what_pil_reads(read, blocks):
    data = saved(drawn("RGBA"), "DDS", pixel_format=blocks)
    texels, _, _ = read("a.dds", data)
    wanted = np.asarray(Image.open(io.BytesIO(data)).convert("RGBA"))
    np.testing.assert_allclose(texels, wanted, atol=2)


@pytest.mark.parametrize("orientation", range(1, 9))
def test_an_orientation_turns_the_picture_upright(read, orientation):
    exif = Image.Exif()
    exif[274] = orientation
    texels, _, _ = read("a.png", saved(drawn(), "PNG", exif=exif))
    turned = {
        1: lambda a: a,
        2: lambda a: a[:, ::-1],
        3: lambda a: a[::-1, ::-1],
        4: lambda a: a[::-1],
        5: lambda a: a.swapaxes(0, 1),
        6: lambda a: np.rot90(a, -1),
        7: lambda a: np.rot90(a.swapaxes(0, 1), 2),
        8: lambda a: np.rot90(a),
    }[orientation]
    np.testing.assert_array_equal(texels, turned(np.asarray(drawn())))


def test_the_content_says_the_format_and_a_wrong_ending_is_told(read):
    texels, _, warned = read("wood.png", saved(drawn(), "BMP"))
    np.testing.assert_array_equal(texels, np.asarray(drawn()))
    assert (
        len(warned) == 1 and "PNG" in warned[0] and "BMP" in warned[0] and "wood.png" in warned[0]
    )
    texels, _, warned = read("no_ending", saved(drawn(), "PNG"))
    np.testing.assert_array_equal(texels, np.asarray(drawn()))
    assert warned == []


def test_a_truncated_file_is_refused_and_never_filled_with_grey(read):
    for kind in ("JPEG", "PNG", "BMP", "TIFF", "TGA", "WEBP", "JPEG2000"):
        data = saved(drawn(), kind)
        with pytest.raises(hg.InvalidArgument, match=r"a\."):
            read(f"a.{kind.lower()}", data[: len(data) // 2])


def test_infinite_texels_become_the_largest_finite_one_and_are_told(read):
    for dtype in ("f2", "f4"):
        rgb = np.full((4, 6, 3), 0.5, dtype)
        rgb[1, 2] = np.inf
        rgb[2, 3, 0] = np.nan
        rgb[3, 4, 1] = -np.inf
        texels, encoding, warned = read("sun.exr", exr({"RGB": rgb}))
        wanted = np.where(np.isposinf(rgb), 65504, np.where(np.isneginf(rgb), -65504, rgb))
        np.testing.assert_array_equal(texels, np.nan_to_num(wanted, nan=0))
        assert encoding == LINEAR
        assert any("4 infinite" in text for text in warned) and any(
            "NaN" in text for text in warned
        )


def test_a_dome_tells_of_infinite_texels_too(scene, tmp_path):
    rgb = np.full((4, 8, 3), 0.5, "f2")
    rgb[0, 0] = np.inf
    (tmp_path / "sky.exr").write_bytes(exr({"RGB": rgb}))
    with (
        pytest.warns(hg.FileWarning, match=r"sky\.exr: 3 infinite") as warned,
        scene.edit() as edit,
    ):
        edit.dome(tmp_path / "sky.exr")
    assert warned[0].filename == __file__


def test_layers_of_an_exr_are_chosen_by_name(read):
    def plane(value):
        return np.full((4, 6), value, "f4")

    data = exr(
        {
            "Z": plane(9),
            "diffuse.R": plane(1),
            "diffuse.G": plane(2),
            "diffuse.B": plane(3),
            "View Layer.gloss.Y": plane(4),
        }
    )
    texels, _, warned = read("a.exr", data)
    assert texels[0, 0].tolist() == [1, 2, 3]
    assert "'diffuse'" in warned[0] and "View Layer.gloss" in warned[0]
    assert read("a.exr", data, layer="diffuse")[2] == []
    assert read("a.exr", data, layer="View Layer.gloss")[0][0, 0].tolist() == [4]
    assert read("a.exr", data, layer="Z")[0][0, 0].tolist() == [9]
    assert read("a.exr", data, layer="diffuse.G")[0][0, 0].tolist() == [2]
    with pytest.raises(hg.InvalidArgument, match=r"no layer 'specular'.*diffuse\.R"):
        read("a.exr", data, layer="specular")


def test_colours_that_alpha_multiplied_are_divided(read):
    rgba = np.array([[[0.25, 0.5, 0.1, 0.5], [3, 2, 1, 1], [7, 6, 5, 0]]], "f4")
    texels, _, warned = read("a.exr", exr({"RGBA": rgba}))
    np.testing.assert_allclose(
        texels, [[[0.5, 1, 0.2, 0.5], [3, 2, 1, 1], [7, 6, 5, 0]]], rtol=1e-6
    )
    assert warned == []


def test_xyz_and_lonely_channels(read):
    plane = np.arange(6, dtype="f4").reshape(2, 3)
    texels, _, warned = read("a.exr", exr({"X": plane, "Y": plane + 1, "Z": plane + 2}))
    assert texels.shape == (2, 3, 3) and len(warned) == 1 and "X, Y, Z" in warned[0]
    assert read("a.exr", exr({"depth": plane}))[0].shape == (2, 3, 1)


def test_a_layer_of_a_model_or_an_array_is_refused(scene, tmp_path):
    with pytest.raises(hg.InvalidArgument, match="layer"), scene.edit() as edit:
        edit.texture("t", np.zeros((2, 2, 3), "u1"), layer="diffuse")


def test_kinds_that_are_no_texels_are_refused_by_name(read):
    with pytest.raises(hg.HeliographError, match="CIELAB"):
        read("a.tif", saved(drawn().convert("LAB"), "TIFF"))
    with pytest.raises(hg.Unimplemented, match=r"'xyz' is not one of .*gltf.*webp"):
        read("a.xyz", b"words")


@pytest.mark.parametrize("ends", [b"\0\0\0\1", b"\0\1"], ids=["line and picture", "picture"])
def test_a_run_length_bmp_may_end_its_last_line(read, ends):
    rows = [[3, 3, 3, 7, 8, 9, 7], [0, 1, 2, 3, 0, 0, 0]]  # upwards
    codes = b"\3\3\0\4\7\10\11\7\0\0" + b"\0\4\0\1\2\3\3\0" + ends
    palette = b"".join(bytes([i, 2 * i, 3 * i, 0]) for i in range(16))
    head = struct.pack("<IiiHHIIiiII", 40, 7, 2, 1, 8, 1, len(codes), 0, 0, 16, 0)
    start = 14 + len(head) + len(palette)
    file = struct.pack("<2sIHHI", b"BM", start + len(codes), 0, 0, start) + head + palette + codes
    texels, _, warned = read("a.bmp", file)
    grey = np.array(rows[::-1])[..., None]
    np.testing.assert_array_equal(texels[..., :3], np.concatenate([3 * grey, 2 * grey, grey], -1))
    assert warned == []


def test_a_radiance_picture_in_xyze_is_refused_by_name(read):
    file = b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n\x80\x80\x80\x81"
    with pytest.raises(hg.Unimplemented, match="XYZE"):
        read("a.hdr", file)
