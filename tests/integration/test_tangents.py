"""Tangents of meshes that deform: they turn with the surface."""

import heliograph as hg
import numpy as np

PLANE = hg.shapes.plane(2.0)
ALONG_X = np.tile(np.array([1, 0, 0, 1], "f4"), (len(PLANE["positions"]), 1))


def tangent(scene):
    frame = scene.render("camera", size=(8, 8), planes=["tangent"], labels=False)
    return np.asarray(frame["tangent"])[4, 4]


def test_tangents_turn_with_a_joint(scene):
    count = len(PLANE["positions"])
    joints = {"joints": np.zeros((count, 4), "u2"), "weights": np.tile(np.eye(4)[:1], (count, 1))}
    with scene.edit() as edit:
        mesh = edit.mesh("flag", **PLANE, tangents=ALONG_X, **joints)
        edit.material("brushed", anisotropic=0.5)
        edit.entity("joint")
        edit.entity("flag", mesh=mesh, material="brushed", skin=(["joint"], np.eye(4)[None]))
        camera = hg.Camera.from_fov(40, 8, 8, degrees=True)
        edit.entity("camera", camera=camera, transform=hg.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0)))
    np.testing.assert_allclose(tangent(scene), (1, 0, 0), atol=1e-3)
    with scene.edit() as edit:
        edit.entity("joint", transform=hg.Pose(euler=(0, 0, np.pi / 2)))
    np.testing.assert_allclose(tangent(scene), (0, 1, 0), atol=1e-3)


def test_tangents_of_a_mesh_at_rest_are_those_given(scene):
    turned = ALONG_X * 0 + np.array([0, 1, 0, -1], "f4")
    with scene.edit() as edit:
        mesh = edit.mesh("flag", **PLANE, tangents=turned)
        edit.entity("flag", mesh=mesh, material=edit.material("brushed", anisotropic=0.5))
        camera = hg.Camera.from_fov(40, 8, 8, degrees=True)
        edit.entity("camera", camera=camera, transform=hg.look_at((0, 0, 4), (0, 0, 0), (0, 1, 0)))
    np.testing.assert_allclose(tangent(scene), (0, 1, 0), atol=1e-3)
