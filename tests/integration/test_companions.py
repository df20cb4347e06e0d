"""Textures and MTL files that a model names: found as other programs find them, only beneath
folders that may be read, and named by a warning where they are not there."""

import os

import heliograph as hg
import numpy as np
import pytest
from PIL import Image

QUAD = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
OBJ = f"mtllib m.mtl\n{QUAD}usemtl a\nf 1/1 2/2 3/3 4/4\n"
RED = (0.578, 0.013, 0.013)  # 200, 30, 30 of sRGB by IEC 61966-2-1
BLUE = (0, 0, 1)


def red_png(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (4, 4), (200, 30, 30)).save(path, "PNG")


def model(folder, texture):
    """A quad that is blue where its texture is not there; `texture` as it stands in the MTL."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "m.mtl").write_bytes(b"newmtl a\nKd 0 0 1\nmap_Kd " + texture + b"\n")
    (folder / "m.obj").write_text(OBJ)
    return folder / "m.obj"


def look(scene, path, **options):
    """The base colour of the model, and what its import warned of."""
    with scene.edit() as edit:
        asset = edit.import_file(path, **options)
        lens = hg.Camera.from_fov(40, 16, 16, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0)))
    color = scene.render("cam", planes=["base_color"])["base_color"][8, 8, :3]
    return color, " ".join(asset.warnings)


def white(path):
    """Kd becomes white, so that the texture is seen as it is."""
    mtl = path.parent / "m.mtl"
    mtl.write_bytes(mtl.read_bytes().replace(b"Kd 0 0 1", b"Kd 1 1 1", 1))
    return path


@pytest.mark.parametrize(
    ("written", "there"),
    [
        (b"C:\\Users\\me\\tex.png", "tex.png"),
        (b"/home/me/tex.png", "tex.png"),
        (b"TEX.PNG", "tex.png"),
        (b"Textures/tex.png", "textures/Tex.png"),
        (b"tex.png", "materials/textures/tex.png"),
        (b"../elsewhere/tex.png", "tex.png"),
        (b"bl\xe4u.png", "bl\xe4u.png"),
        (b"my%20tex.png", "my tex.png"),
    ],
)
def test_it_is_found_beneath_the_model_s_folder(scene, tmp_path, written, there):
    path = white(model(tmp_path, written))
    red_png(tmp_path / there)
    color, warnings = look(scene, path)
    np.testing.assert_allclose(color, RED, atol=2e-3)
    assert warnings == ""


def test_it_is_found_by_bytes_that_are_no_text(scene, tmp_path):
    path = white(model(tmp_path, b"bl\xe4u.png"))
    red_png(tmp_path / "x.png")
    raw = os.fsencode(tmp_path) + b"/bl\xe4u.png"
    os.rename(tmp_path / "x.png", raw)
    renamed = os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.obj")
    os.rename(path, renamed)
    np.testing.assert_allclose(look(scene, renamed)[0], RED, atol=2e-3)


@pytest.mark.parametrize("encoding", ["shift_jis", "gbk"])
def test_letters_of_two_bytes_of_which_one_is_a_backslash(scene, tmp_path, encoding):
    name = {"shift_jis": "表", "gbk": "俓"}[encoding].encode(encoding) + b".png"
    assert b"\\" in name
    path = white(model(tmp_path, name))
    red_png(tmp_path / "t.png")
    os.rename(tmp_path / "t.png", os.fsencode(tmp_path) + b"/" + name)
    color, warning = look(scene, path)
    np.testing.assert_allclose(color, RED, atol=2e-3)
    assert warning == ""


def test_without_it_the_model_loads_and_a_warning_names_it(scene, tmp_path):
    path = model(tmp_path, b"gone.png")
    color, warnings = look(scene, path)
    np.testing.assert_allclose(color, BLUE, atol=1e-3)
    assert "'gone.png'" in warnings
    with scene.edit() as edit, pytest.raises(hg.NotFound, match=r"'gone\.png'"):
        edit.import_file(path, strict=True)


def test_an_empty_name_is_none(scene, tmp_path):
    color, warnings = look(scene, model(tmp_path, b""), strict=True)
    np.testing.assert_allclose(color, BLUE, atol=1e-3)
    assert warnings == ""


@pytest.mark.parametrize("written", [b"texture.png", b"../materials/textures/texture.png"])
def test_folders_allow_what_is_not_beneath_the_model(scene, tmp_path, written):
    path = white(model(tmp_path / "mug/meshes", written))
    red_png(tmp_path / "mug/materials/textures/texture.png")
    color, warnings = look(scene, path, name="without")
    np.testing.assert_allclose(color, (1, 1, 1), atol=1e-3)
    assert "texture.png" in warnings and "folders=" in warnings
    with scene.edit() as edit:
        edit.remove(["without"], cascade=True)
    color, warnings = look(scene, path, name="with", folders=[tmp_path / "mug"])
    np.testing.assert_allclose(color, RED, atol=2e-3)
    assert warnings == ""


def test_a_link_out_of_the_folder_is_not_read(scene, tmp_path):
    path = white(model(tmp_path / "in", b"link.png"))
    red_png(tmp_path / "secret.png")
    (tmp_path / "in/link.png").symlink_to(tmp_path / "secret.png")
    color, warnings = look(scene, path)
    np.testing.assert_allclose(color, (1, 1, 1), atol=1e-3)
    assert "'link.png'" in warnings


def test_a_robot_s_meshes_read_from_its_package(scene, tmp_path):
    path = white(model(tmp_path / "bot/meshes", b"../textures/tex.png"))
    red_png(tmp_path / "bot/textures/tex.png")
    (tmp_path / "bot/package.xml").write_text("<package/>")
    (tmp_path / "bot/urdf").mkdir()
    urdf = tmp_path / "bot/urdf/bot.urdf"
    urdf.write_text(
        '<robot name="bot"><link name="base"><visual><geometry>'
        f'<mesh filename="package://bot/meshes/{path.name}"/>'
        "</geometry></visual></link></robot>"
    )
    with scene.edit() as edit:
        robot = edit.import_urdf(urdf, packages={"bot": tmp_path / "bot"})
    assert not robot.warnings
