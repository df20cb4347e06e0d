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


@pytest.mark.parametrize(
    "option",
    [{"groups": 1}, {"groups": (9,)}, {"groups": "a"}, {"size": 3}, {"size": (0, 3)}],
)
def test_of_mjcf_files(world, tmp_path, option):
    pytest.importorskip("mujoco", reason="the extra `mjcf` is not installed")
    path = tmp_path / "ball.xml"
    path.write_text('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
    [name] = option
    check(world, edited(lambda edit: edit.import_mjcf(path, **option)), (INVALID, name))


def test_a_pointer_of_git_lfs_is_said_to_be_one(world, tmp_path):
    for name in ("a.png", "a.stl"):
        path = tmp_path / name
        path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n")

        def call(edit, path=path):
            edit.texture("t", path) if path.suffix == ".png" else edit.import_file(path)

        check(world, edited(call), (INVALID, "path"), "git lfs pull")


AGAIN = {
    **{"variants": {"/A": {"look": "red"}}, "payloads": False, "purposes": ["proxy"], "time": 1.0},
    **{"times": "all", "units": 1.0, "semantics": None, "nit": 1.0, "lights": False},
    **{"camera_width": 64, "subdivision": 1},
}


@pytest.fixture
def cube(tmp_path):
    pytest.importorskip("pxr", reason="the extra `usd` is not installed")
    path = tmp_path / "cube.usda"
    path.write_text('#usda 1.0\n(\nmetersPerUnit = 1\n)\ndef Cube "A"\n{\n}\n')
    return path


@pytest.mark.parametrize(
    "option",
    [
        *({"times": times} for times in ("some", 3, [], [0, "a"])),
        *({"time": "x"}, {"units": -1}, {"nit": -1.0}, {"nit": 0}, {"semantics": 3}),
        *({"variants": {"/A": "red"}}, {"camera_width": 0}, {"subdivision": 9}),
    ],
)
def test_of_stages(world, cube, option):
    [name] = option
    check(world, edited(lambda edit: edit.import_usd(cube, **option)), (INVALID, name))


def test_units_beside_those_of_a_stage_are_told(scene, cube):
    with scene.edit() as edit:
        asset = edit.import_usd(cube, units=0.5)
    assert asset.warnings == ["/: it names its metersPerUnit, which comes before units="]


def test_of_a_stage_that_is_placed_again(scene, cube, tmp_path):
    with scene.edit() as edit:
        first = edit.import_usd(cube)
        edit.import_usd(first, name="again", purposes=["default", "render"])  # as by default
    for name, value in {**AGAIN, "folders": [tmp_path]}.items():
        with pytest.raises(INVALID, match=f"{name}: an asset is placed again as it was read"):
            with scene.edit() as edit:
                edit.import_usd(first, name="third", **{name: value})
