"""Options of imports that would change nothing, or make no sense: refused by name."""

from pathlib import Path

import heliograph as hg
import numpy as np
import pytest
from refusals import check, edited

ARM = Path(__file__).resolve().parents[2] / "examples/assets/arm/arm.urdf"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
INVALID, MISSING = hg.InvalidArgument, hg.NotFound
GREY = np.zeros((2, 2, 3), "u1")


@pytest.fixture
def model(tmp_path):
    path = tmp_path / "tile.obj"
    path.write_text(TRIANGLE)
    return path


@pytest.mark.parametrize(
    ("options", "want"),
    [
        ({"count": -1}, (INVALID, "count")),
        ({"count": 1.5}, (INVALID, "count")),
        ({"folders": "folder"}, (INVALID, "folders")),
        ({"folders": ["no such folder"]}, (MISSING, "folders")),
        ({"folders": [__file__]}, (MISSING, "folders")),
        ({"colour": 1}, (INVALID, "colour")),
    ],
)
def test_of_models(world, model, options, want):
    check(world, edited(lambda edit: edit.import_file(model, **options)), want)


def test_folders_of_this_machine_for_a_file_of_the_daemon_s(world, tmp_path):
    def call(edit):
        edit.import_file(server_path="a.obj", folders=[tmp_path])

    check(world, edited(call), (INVALID, "folders"))


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda edit: edit.dome(layer="diffuse"), "layer"),
        (lambda edit: edit.dome(None, layer="diffuse"), "layer"),
        (lambda edit: edit.dome(GREY, layer="diffuse"), "layer"),
        (lambda edit: edit.texture("dots", layer="diffuse"), "layer"),
        (lambda edit: edit.texture("dots", GREY, wrap=("clamp",)), "wrap"),
        (lambda edit: edit.texture("dots", GREY, wrap=("clamp", "clamp", "clamp")), "wrap"),
    ],
)
def test_of_pictures(world, call, field):
    check(world, edited(call), (INVALID, field))


def test_packages_that_are_no_folders(world):
    def call(edit):
        edit.import_urdf(ARM, packages={"arm": "no such folder"})

    check(world, edited(call), (MISSING, "packages"))


@pytest.mark.parametrize("option", [{"strict": True}, {"packages": {"arm": ARM.parent}}])
def test_of_a_robot_that_is_placed_again(scene, option):
    with scene.edit() as edit:
        arm = edit.import_urdf(ARM)
    [name] = option
    with pytest.raises(INVALID, match=f"{name}: a robot is placed again as it was read"):
        with scene.edit() as edit:
            edit.import_urdf(arm, name="again", **option)


AGAIN = {
    **{"variants": {"/A": {"look": "red"}}, "payloads": False, "purposes": ["proxy"], "time": 1.0},
    **{"times": "all", "units": 1.0, "semantics": None, "nit": 1.0, "lights": False},
    **{"camera_width": 64, "subdivision": 1},
}


def test_of_a_stage_that_is_placed_again(scene, tmp_path):
    pytest.importorskip("pxr", reason="the extra `usd` is not installed")
    path = tmp_path / "cube.usda"
    path.write_text('#usda 1.0\n(\nmetersPerUnit = 1\n)\ndef Cube "A"\n{\n}\n')
    with scene.edit() as edit:
        cube = edit.import_usd(path)
        edit.import_usd(cube, name="again", purposes=["default", "render"])  # as by default
    for name, value in {**AGAIN, "folders": [tmp_path]}.items():
        with pytest.raises(INVALID, match=f"{name}: an asset is placed again as it was read"):
            with scene.edit() as edit:
                edit.import_usd(cube, name="third", **{name: value})
