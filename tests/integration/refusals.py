"""Helpers of the tables of bad input: a scene to refer to, calls, and the check of a refusal."""

import re

import heliograph as hg
import numpy as np
import pytest

NAN, INF = float("nan"), float("inf")
EYE = np.eye(4)
TRIANGLE = {"positions": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "indices": [[0, 1, 2]]}


CAMERA = hg.Camera.from_fov(50, 32, 24, degrees=True)


@pytest.fixture(scope="module")
def furnished(client):
    """One of everything that a row may refer to."""
    with client.create_scene() as made:
        with made.edit() as edit:
            edit.mesh("tri", **TRIANGLE)
            edit.mesh("morphed", **TRIANGLE, morph_positions=np.zeros((2, 3, 3)))
            joints, weights = np.zeros((3, 4), "u2"), np.tile([1.0, 0, 0, 0], (3, 1))
            edit.mesh("skinned", **TRIANGLE, joints=joints, weights=weights)
            edit.material("gold", roughness=0.3)
            edit.texture("dots", np.zeros((2, 2, 3), "u1"))
            edit.entity("ball", mesh="tri", material="gold", category="ball")
            edit.entity("bone")
            edit.entity("cam", camera=CAMERA, transform=hg.Pose((0, 0, 5)))
        yield made


@pytest.fixture
def world(furnished):
    """A branch for each row, so that no row can spoil another."""
    with furnished.branch() as made:
        yield made


def camera(**changed):
    given = {"width": 32, "height": 24, "fx": 40.0, "fy": 40.0, "cx": 15.5, "cy": 11.5}
    return hg.Camera(**{**given, **changed})


def put(array, value):
    """The array as float64, its last number replaced."""
    out = np.array(array, dtype="f8")
    out.reshape(-1)[-1] = value
    return out


def edited(call):
    """A row's call from a function of an edit: in a transaction behind a good edit."""

    def run(scene):
        with scene.edit() as edit:
            edit.entity("not kept")
            call(edit)

    return run


def entity(**given):
    return edited(lambda e: e.entity("thing", **given))


def mesh(**given):
    return edited(lambda e: e.mesh("thing", **{**TRIANGLE, **given}))


def material(**given):
    return edited(lambda e: e.material("thing", **given))


def dome(**given):
    return edited(lambda e: e.dome(**given))


def render(camera="cam", **options):
    return lambda scene: scene.render(camera, **{"spp": 1, **options})


def check(world, call, want, message=""):
    """`call` raises want[0] and names the field want[1]; the scene stays; the next one works."""
    kind, field = want
    before = world.revision
    with pytest.raises(kind) as raised:
        call(world)
    error = raised.value
    assert type(error) is kind, repr(error)
    assert field in f"{error.field} {error}", (error.field, str(error))
    assert re.search(message, str(error)), str(error)
    assert world.revision == before and "not kept" not in world
    assert world.render("cam", planes=["instance"])["instance"].max() > 0
