"""Robots in a real daemon whose files are not all as they should be."""

from pathlib import Path

import heliograph as hg
import numpy as np
import pytest
from PIL import Image

ASSETS = Path(__file__).resolve().parents[2] / "examples/assets"
BOX = "<geometry><box size='1 1 1'/></geometry>"


def written(folder, *visuals, rest=""):
    body = "".join(f"<visual>{visual}</visual>" for visual in visuals)
    path = folder / "r.urdf"
    path.write_text(f'<robot name="r"><link name="a">{body}</link>{rest}</robot>')
    return path


def paint(name, rgba, texture=""):
    return f'<material name="{name}"><color rgba="{rgba}"/>{texture}</material>'


def mesh(file):
    return f'<geometry><mesh filename="{file}"/></geometry>'


@pytest.fixture
def cam(scene):
    with scene.edit() as edit:
        lens = hg.Camera.orthographic(32, 64, 64)
        return edit.entity("cam", camera=lens, transform=hg.look_at((0, -3, 0), (0, 0, 0)))


def test_what_cannot_be_decoded_is_left_out_and_told(scene, tmp_path):
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    (tmp_path / "broken.png").write_bytes(b"GIF89a")
    texture = '<texture filename="broken.png"/>'
    path = written(
        tmp_path,
        mesh("broken.stl"),
        mesh("broken.stl"),
        BOX + paint("m", "1 0 0 1", texture),
        BOX + paint("n", "0 1 0 1", texture),
    )
    with scene.edit() as edit:
        robot = edit.import_urdf(path)
        again = edit.import_urdf(robot, name="again")
    for one in (robot, again):
        assert [warning.split()[0] for warning in one.warnings] == ["broken.stl", "broken.png"]
    shown = {e.name for e in scene.find("r/a/*") if e.kind == "entity"}
    assert shown == {"r/a/2", "r/a/3"}
    assert scene["r/material/m"].parameters["base_color"] == pytest.approx((1, 0, 0))
    for visual, name in ((mesh("broken.stl"), "broken.stl"), (BOX + texture, "m")):
        path = written(tmp_path, visual, BOX + paint("m", "1 0 0 1", texture))
        with pytest.raises(hg.HeliographError), scene.edit() as edit:
            edit.import_urdf(path, name=name, strict=True)
        assert not list(scene.find(f"{name}*"))


def test_names_with_blanks_are_read(scene, tmp_path):
    (tmp_path / "my meshes").mkdir()
    text = (ASSETS / "arm/meshes/hand.obj").read_text()
    (tmp_path / "my meshes/a hand.obj").write_text(text)
    (tmp_path / "my meshes/hand.mtl").write_bytes((ASSETS / "arm/meshes/hand.mtl").read_bytes())
    with scene.edit() as edit:
        robot = edit.import_urdf(written(tmp_path, mesh("my meshes/a hand.obj")), strict=True)
    assert robot.warnings == [] and scene["r/a/0"].mesh is not None


def test_links_that_alpha_hides_from_labels_are_named(scene, cam, tmp_path):
    glass, tinted = paint("glass", "1 1 1 0.3"), paint("tinted", "1 1 1 0.6")
    rest = f"""<link name="b"><visual>{BOX}{tinted}</visual></link>
        <joint name="j" type="fixed"><parent link="a"/><child link="b"/>
        <origin xyz="0 5 0"/></joint>"""
    with scene.edit() as edit:
        robot = edit.import_urdf(written(tmp_path, BOX + glass, rest=rest), strict=True)
    assert robot.warnings == ["r/a: of alpha 0.3, labels show what is behind it"]
    part = scene.render(cam, planes=["part"])["part"]
    assert set(np.unique(part)) == {0, robot.parts["b"]}


def test_a_capsule_is_seen_where_it_is(scene, cam, tmp_path):
    shape = '<geometry><capsule radius="0.2" length="0.7"/></geometry>'
    with scene.edit() as edit:
        edit.import_urdf(written(tmp_path, '<origin xyz="0.1 0 0.05"/>' + shape))
    frame = scene.render(cam, planes=["depth", "part"])
    rows, columns = np.mgrid[:64, :64]
    x, z = (columns + 0.5) / 32 - 1 - 0.1, 1 - (rows + 0.5) / 32 - 0.05
    beyond = np.hypot(x, np.maximum(np.abs(z) - 0.35, 0))
    inside, outside = beyond < 0.198, beyond > 0.202
    assert inside.sum() > 300 and (frame["part"][inside] == 1).all()
    assert (frame["part"][outside] == 0).all()
    expected = 3 - np.sqrt(np.maximum(0.2**2 - beyond**2, 0))
    near = beyond < 0.15
    np.testing.assert_allclose(frame["depth"][near], expected[near], atol=2e-3)


def test_spherical_joints_are_set(scene, tmp_path):
    rest = """<link name="b"/><joint name="s" type="spherical"><parent link="a"/><child link="b"/>
        <origin xyz="0 0 1"/></joint>"""
    with scene.edit() as edit:
        robot = edit.import_urdf(written(tmp_path, BOX, rest=rest))
    turn = hg.Pose(euler=(0.3, -0.4, 0.5))
    with scene.edit() as edit:
        edit.set_joints(robot, {"s": turn})
    expected = turn.matrix + np.array([[0, 0, 0, 0]] * 2 + [[0, 0, 0, 1], [0, 0, 0, 0]])
    np.testing.assert_allclose(robot.links["b"].transform, expected, atol=1e-6)


def test_textures_of_meshes_are_read_from_the_package(scene, tmp_path):
    for folder in ("urdf", "meshes", "textures"):
        (tmp_path / folder).mkdir()
    (tmp_path / "meshes/a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl paint\nf 1/1 2/1 3/1\n"
    )
    (tmp_path / "meshes/a.mtl").write_text("newmtl paint\nmap_Kd ../textures/red.png\n")
    path = written(tmp_path / "urdf", mesh("package://robot/meshes/a.obj"))
    with pytest.raises(hg.NotFound, match="red.png"), scene.edit() as edit:
        edit.import_urdf(path, name="strict", strict=True)
    with scene.edit() as edit:
        robot = edit.import_urdf(path, name="without")
    assert any("red.png" in warning for warning in robot.warnings)
    Image.new("RGB", (2, 2), (255, 0, 0)).save(tmp_path / "textures/red.png")
    with scene.edit() as edit:
        robot = edit.import_urdf(path, name="with", strict=True)
    assert robot.warnings == [] and scene["with/a/0"].mesh is not None
