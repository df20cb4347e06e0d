"""Files that nvisii reads: models as scenes and as meshes, pictures, volumes."""

import math
import pathlib

import numpy as np
import nvisii
import pytest
from nvisii_world import rows
from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parents[2]
HELMET = str(ROOT / "examples/assets/FlightHelmet/FlightHelmet.gltf")
QUAD = """v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl red
f 1/1 2/2 3/3
usemtl green
f 1/1 3/3 4/4
"""
COLORS = "newmtl red\nKd 1 0 0\nnewmtl green\nKd 0 1 0\n"


@pytest.fixture
def quad(tmp_path):
    (tmp_path / "quad.mtl").write_text(COLORS)
    (tmp_path / "quad.obj").write_text("mtllib quad.mtl\n" + QUAD)
    return str(tmp_path / "quad.obj")


def test_a_scene_has_all_that_its_file_has(camera):
    turn = nvisii.angleAxis(math.pi / 2, (1, 0, 0))
    made = nvisii.import_scene(HELMET, position=(0, 1, 0), scale=(2, 2, 2), rotation=turn)
    counts = {name: len(found) for name, found in vars(made).items()}
    assert counts == {
        **{"entities": 6, "transforms": 7, "textures": 15, "materials": 6, "meshes": 6},
        **{"lights": 0, "cameras": 0},
    }
    assert nvisii.entity.get("Hose_low") is made.entities[0]
    assert made.entities[0].get_transform().get_parent() is made.transforms[0]
    low, high = nvisii.get_scene_min_aabb_corner(), nvisii.get_scene_max_aabb_corner()
    assert high.z - low.z == pytest.approx(1.43, abs=0.02)  # the file's y, twice, upright
    assert abs(nvisii.get_scene_aabb_center().y - 1) < 0.1
    camera.get_transform().look_at(eye=(0, -1.5, 0.8), at=(0, 1, 0.7), up=(0, 0, 1))
    image = rows(nvisii.render(48, 48, 16), 48, 48)[..., :3]
    assert image[24, 24].max() < 0.6 and image[2, 2].min() > 0.9 and image.std() > 0.2
    again = nvisii.import_scene(HELMET)
    assert again.entities[0].get_name() == "Hose_low_2"


def test_coordinates_and_materials_are_those_of_the_file(camera, quad):
    made = nvisii.import_scene(quad)
    assert len(made.entities) == 2
    colors = [tuple(e.get_material().get_base_color()) for e in made.entities]
    assert colors == [(1, 0, 0), (0, 1, 0)]
    mesh = nvisii.mesh.create_from_file("joined", quad)
    assert mesh.get_min_aabb_corner() == [-1, 0, -1] and mesh.get_max_aabb_corner() == [1, 0, 1]
    assert len(mesh.get_triangle_indices()) == 6
    assert nvisii.mesh.create_from_obj("old", quad).get_vertices() == mesh.get_vertices()
    image = rows(nvisii.render(32, 32, 8), 32, 32)
    red, green = image[20, 19], image[11, 12]
    assert red[0] > 2 * red[1] and green[1] > 2 * green[0]


def test_textures_stand_upright(camera, quad, tmp_path):
    picture = np.zeros((2, 2, 3), np.uint8)
    picture[0, 0], picture[1, 1] = (255, 0, 0), (0, 255, 0)  # red upper left, green lower right
    Image.fromarray(picture).save(tmp_path / "picture.png")
    texture = nvisii.texture.create_from_file("picture", str(tmp_path / "picture.png"))
    assert (texture.get_width(), texture.get_height(), texture.is_hdr()) == (2, 2, False)
    assert texture.sample_byte_texels((0.25, 0.75)) == [255, 0, 0, 255]
    assert texture.get_byte_texels()[:8].tolist() == [0, 0, 0, 255, 0, 255, 0, 255]
    wall = nvisii.entity.create(
        "wall",
        transform=nvisii.transform.create("wall"),
        mesh=nvisii.mesh.create_from_file("wall", quad),
        material=nvisii.material.create("wall", specular=0, roughness=1),
    )
    wall.get_material().set_base_color_texture(texture)
    base = rows(nvisii.render_data(32, 32, 0, 1, 0, "base_color"), 32, 32)
    assert base[11, 11, 0] > 0.9 and base[20, 20, 1] > 0.9 and base[11, 20, :3].max() < 0.1
    texture.set_scale((2, 2))  # twice as large: the lower left quarter fills the wall
    base = rows(nvisii.render_data(32, 32, 0, 1, 0, "base_color"), 32, 32)
    assert base[..., :2].max() < 0.95 and base[11, 11, 0] < base[9, 9, 0] + 0.5
    wall.get_material().clear_base_color_texture()
    base = rows(nvisii.render_data(32, 32, 0, 1, 0, "base_color"), 32, 32)
    assert np.allclose(base[16, 16, :3], 0.8)


def test_files_that_are_not_there_or_nothing(camera, tmp_path):
    (tmp_path / "bad.glb").write_bytes(b"glTF nonsense")
    (tmp_path / "bad.png").write_bytes(b"nonsense")
    for call in (
        lambda: nvisii.import_scene(str(tmp_path / "no.obj")),
        lambda: nvisii.mesh.create_from_file("m", str(tmp_path / "bad.glb")),
        lambda: nvisii.texture.create_from_file("t", str(tmp_path / "bad.png")),
        lambda: nvisii.texture.create_from_file("t", str(tmp_path / "no.png")),
        lambda: nvisii.volume.create_from_file("v", HELMET),
    ):
        with pytest.raises(RuntimeError, match=r"no\.|bad\.|holds no volume"):
            call()
    assert nvisii.mesh.get("m") is nvisii.texture.get("t") is None


def test_a_part_without_a_material_has_the_default_one(camera):
    made = nvisii.import_scene(str(ROOT / "tests/assets/dae/bracket.dae"))
    looks = {e.get_name(): e.get_material().get_name() for e in made.entities}
    assert looks == {"main": "Painted", "main_2": "default", "left": "Glass", "left_2": "Painted"}
    low, high = nvisii.get_scene_min_aabb_corner(), nvisii.get_scene_max_aabb_corner()
    assert tuple(high - low) == pytest.approx((0.34, 0.03, 0.2), abs=1e-6)  # metres, +Z up
