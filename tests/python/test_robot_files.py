"""The files that URDF files refer to, as people publish them, and what xacro left in these."""

import shlex

import heliograph as hg
import numpy as np
import pytest
from heliograph.robots import urdf
from urdf_text import BOX, joint, link, mesh, stl, strictly_refused, written

# ---------------------------------------------------------------- files


def test_what_is_missing_is_left_out_and_told(tmp_path):
    odd = ["no.stl", "/no/such/place/no.stl", "package://nowhere/no.stl", "http://host/no.stl", ""]
    for reference in odd:
        path = written(tmp_path / "r.urdf", link(mesh(reference), BOX))
        found = urdf.read(path, {})
        assert [visual.shape for visual in found.visuals["a"]] == ["box"]
        (warning,) = found.warnings
        assert warning.startswith("link 'a': ") and warning.endswith("; it is left out")
        strictly_refused(path, "link 'a'", (hg.InvalidArgument, hg.NotFound))


def test_a_robot_of_which_nothing_is_found_is_refused(tmp_path):
    path = written(tmp_path / "r.urdf", link(mesh("package://nowhere/a.stl"), mesh("b.stl")))
    with pytest.raises(hg.NotFound, match=r"packages=\{\"nowhere\""):
        urdf.read(path, {})


@pytest.mark.parametrize(
    ("model", "file", "reference"),
    [
        ("robot/urdf/r.urdf", "robot/meshes/a.stl", "../meshes/a.stl"),
        ("robot/urdf/arm/r.urdf", "robot/meshes/a.stl", "../../meshes/a.stl"),
        ("robot/robots/r.urdf", "robot/meshes/a.stl", "package://robot/meshes/a.stl"),
        ("robot-main/urdf/r.urdf", "robot-main/meshes/a.stl", "package://robot/meshes/a.stl"),
        ("robot/urdf/r.urdf", "robot/meshes/a.stl", "package:///robot/meshes/a.stl"),
        ("robot/urdf/r.urdf", "robot/meshes/a.stl", "meshes/a.stl"),
        ("robot/r.urdf", "robot/meshes/a.stl", "meshes\\a.stl"),
        ("robot/r.urdf", "robot/Meshes/A.STL", "meshes/a.stl"),
        ("robot/r.urdf", "robot/my meshes/a b.stl", "my%20meshes/a%20b.stl"),
        ("robot/r.urdf", "robot/my meshes/a b.stl", "my meshes/a b.stl"),
        ("robot/r.urdf", "robot/a%20b.stl", "a%20b.stl"),
        ("robot/urdf/r.urdf", "robot/meshes/a.stl", "package://robot//meshes/a.stl"),
    ],
)
def test_files_of_the_package_are_found(tmp_path, model, file, reference):
    file = stl(tmp_path / file)
    found = urdf.read(written(tmp_path / model, link(mesh(reference))), {}, strict=True)
    assert found.visuals["a"][0].file == file


def test_urls_of_files(tmp_path):
    file = stl(tmp_path / "my meshes/a.stl")
    place = str(file).replace(" ", "%20")
    for url in (f"file:{place}", f"file://{place}", f"file://localhost{place}"):
        found = urdf.read(written(tmp_path / "r.urdf", link(mesh(url))), {}, strict=True)
        assert found.visuals["a"][0].file == file


@pytest.mark.parametrize(
    ("scale", "size"), [("2 0 1", (2, 2e-4, 1)), ("0 1 3", (3e-4, 1, 3)), ("", (1, 1, 1))]
)
def test_a_scale_of_0_is_flat_and_an_empty_one_none(tmp_path, scale, size):
    stl(tmp_path / "a.stl")
    path = written(tmp_path / "r.urdf", link(mesh("a.stl", f' scale="{scale}"')))
    np.testing.assert_allclose(urdf.read(path, {}, strict=True).visuals["a"][0].size, size)


def test_a_python_package_is_one(tmp_path):
    file = stl(tmp_path / "robots/hand/parts/a.stl")
    path = written(tmp_path / "robots/arm/r.urdf", link(mesh("../hand/parts/a.stl")))
    with pytest.raises(hg.InvalidArgument, match="outside the file's own folder"):
        urdf.read(path, {})
    (tmp_path / "robots/__init__.py").touch()
    assert urdf.read(path, {}).visuals["a"][0].file == file


@pytest.mark.parametrize("mark", ["package.xml", "__init__.py", "urdf"])
def test_packages_beside_the_own_one_are_found_by_their_names(tmp_path, mark):
    file = stl(tmp_path / "src/hand/meshes/a.stl")
    path = written(tmp_path / "src/arm/urdf/r.urdf", link(mesh("package://hand/meshes/a.stl")))
    with pytest.raises(hg.NotFound, match=r"packages=\{\"hand\""):
        urdf.read(path, {})
    made = tmp_path / "src/hand" / mark
    made.touch() if made.suffix else made.mkdir()
    assert urdf.read(path, {}, strict=True).visuals["a"][0].file == file


@pytest.mark.parametrize("place", ["/home/x/ws/robot", "C:\\Users\\x\\robot", "file:///C:/robot"])
def test_files_of_another_machine_are_found_by_the_ends_of_their_paths(tmp_path, place):
    file = stl(tmp_path / "robot/meshes/fine/a.stl")
    stl(tmp_path / "robot/a.stl")
    reference = f"{place}\\meshes\\fine\\a.stl" if "\\" in place else f"{place}/meshes/fine/a.stl"
    path = written(tmp_path / "robot/r.urdf", link(mesh(reference)))
    found = urdf.read(path, {})
    assert found.visuals["a"][0].file == file and "is taken to be" in found.warnings[0]
    strictly_refused(path, "is taken to be")


def test_nothing_else_is_read(tmp_path):
    secret = stl(tmp_path / "secret/a.stl")
    own = tmp_path / "robot/urdf"
    own.mkdir(parents=True)
    (tmp_path / "robot/meshes").mkdir()
    (own / "link.stl").symlink_to(secret)
    (own / "folder").symlink_to(secret.parent)
    (own / "FOLDED").symlink_to(secret.parent)
    for reference in (
        *("../../secret/a.stl", "%2e%2e/%2e%2e/secret/a.stl", "..\\..\\secret\\a.stl"),
        *(str(secret), f"file://{secret}", str(secret).upper()),
        *("link.stl", "folder/a.stl", "folded/A.stl", "LINK.STL"),
        *("package://../secret/a.stl", "package://robot/../secret/a.stl", "package://./../a.stl"),
        *("package://urdf/folder/a.stl", "model://folder/a.stl"),
        *("package://secret/a.stl", f"package://{tmp_path.name}/secret/a.stl"),
    ):
        path = written(own / "r.urdf", link(mesh(reference), BOX))
        found = urdf.read(path, {})
        assert [visual.shape for visual in found.visuals["a"]] == ["box"], reference
    path = written(own / "r.urdf", link(mesh("../../secret/a.stl")))
    assert urdf.read(path, {"secret": secret.parent}).visuals["a"][0].file == secret


# ---------------------------------------------------------------- xacro


def test_leftovers_of_xacro_that_nothing_needs_are_passed_over(tmp_path):
    body = (
        '<xacro:property name="w" value="${1 + 2}"/><xacro:arg name="g" default="x"/>'
        + '<gazebo><plugin file="$(find p)/a.yaml"/><xacro:if value="1"/></gazebo>'
        + '<link name="a"><collision><geometry><box size="${w} 1 1"/></geometry></collision></link>'
        + link(BOX, name="b")
        + joint("fixed", '<origin xyz="$(optenv HELIO_X 0.19 0 0.149)" rpy="$(optenv R 0 0 0)"/>')
    )
    path = written(tmp_path / "r.urdf", body, head='<robot name="r" xmlns:xacro="http://x">')
    found = urdf.read(path, {})
    np.testing.assert_array_equal(found.joints[0].origin[:3, 3], (0.19, 0, 0.149))
    assert len(found.warnings) == 3 and any("HELIO_X" in text for text in found.warnings)
    strictly_refused(path, "optenv|xacro")


@pytest.mark.parametrize(
    "body",
    [
        '<xacro:arm parent="a"/>',
        '<xacro:include filename="b.xacro"/>',
        '<xacro:if value="1"><link name="b"/></xacro:if>',
        link('<visual><geometry><box size="${w} 1 1"/></geometry></visual>', name="b"),
        link("<visual><xacro:box_shape/></visual>", name="b"),
        link("<xacro:body/>", name="b"),
        link(mesh("$(find p)/a.stl"), name="b"),
        link(name="b") + joint("fixed", '<origin xyz="0 0 ${h}"/>'),
    ],
)
def test_a_template_is_refused_and_no_file_is_put_at_risk(tmp_path, body):
    names = ["my arm.urdf", "my arm_expanded.urdf", "my arm.urdf.xacro"]
    for name in names:
        path = written(tmp_path / name, link() + body)
    for name in names:
        with pytest.raises(hg.InvalidArgument, match="is xacro") as error:
            urdf.read(tmp_path / name, {})
        command = str(error.value).split("`")[1]
        program, source, arrow, made = shlex.split(command)
        assert (program, source, arrow) == ("xacro", name, ">")
        assert made.endswith(".urdf") and not (path.parent / made).exists()
