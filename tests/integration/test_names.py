"""Names are unique per kind, as in other tools: a mesh, a material and an entity may share one."""

import heliograph as hg
import numpy as np
import pytest


@pytest.fixture
def balls(scene):
    """An entity, its mesh and its material, all named "ball", and a camera."""
    with scene.edit() as edit:
        edit.mesh("ball", **hg.shapes.sphere(0.5))
        edit.material("ball", base_color=(1, 0, 0), unlit=True)
        edit.entity("ball", mesh="ball", material="ball")
        lens = hg.Camera.from_fov(40, 16, 16, degrees=True)
        edit.entity("cam", camera=lens, transform=hg.Pose((0, 0, 3)))
    return scene


def test_a_field_takes_the_object_of_its_kind(balls):
    assert balls["ball"].mesh.id == balls.resolve("ball", "mesh")
    frame = balls.render("cam", planes=["beauty", "instance"])
    assert frame["instance"][8, 8] and np.allclose(frame["beauty"][8, 8, :3], (1, 0, 0))


def test_where_any_kind_will_do_the_entity_goes_first(balls):
    assert isinstance(balls["ball"], hg.Entity)
    kinds = [type(each).__name__ for each in balls.find("ball")]
    assert sorted(kinds) == ["Entity", "Material", "Mesh"]


def test_a_handle_means_its_own(balls):
    mesh = balls["ball"].mesh
    assert mesh != balls["ball"]
    with balls.edit() as edit:
        edit.remove("ball")
    with balls.edit() as edit:
        edit.remove(mesh)
    assert [type(each).__name__ for each in balls.find("ball")] == ["Material"]


def test_a_name_of_another_kind_says_so(balls):
    with balls.edit() as edit:
        edit.mesh("rock", **hg.shapes.cube(1))
    with (
        pytest.raises(hg.InvalidArgument, match="mesh 'rock' is not of the kind entity"),
        balls.edit() as edit,
    ):
        edit.entity("stone", parent="rock")
    with pytest.raises(hg.InvalidArgument, match="mesh 'rock' is not of the kind entity"):
        balls.render("rock", planes=["depth"])
