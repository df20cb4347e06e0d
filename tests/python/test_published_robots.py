"""URDF files as people publish them: what is meant is read, what is odd is told, and no more is
read than what belongs to a robot."""

import shlex

import heliograph as hg
import numpy as np
import pytest
from heliograph.robots import urdf
from heliograph.robots.kinematics import Kinematics

LIMIT = '<limit lower="-1" upper="2" effort="1" velocity="1"/>'
BOX = '<visual><geometry><box size="1 2 3"/></geometry></visual>'


def written(path, body, head="<robot name='r'>"):
    path.parent.mkdir(parents=True, exist_ok=True)
    text = f"{head}{body}</robot>"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def mesh(reference, scale=""):
    return f'<visual><geometry><mesh filename="{reference}"{scale}/></geometry></visual>'


def link(*visuals, name="a"):
    return f'<link name="{name}">{"".join(visuals)}</link>'


def joint(kind, inner="", name="j", ends="ab"):
    tree = f'<parent link="{ends[0]}"/><child link="{ends[1]}"/>'
    return f'<joint name="{name}" type="{kind}">{tree}{inner}</joint>'


def strictly_refused(path, message, error=hg.InvalidArgument):
    with pytest.raises(error, match=message):
        urdf.read(path, {}, strict=True)


def stl(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("solid\nendsolid\n")
    return path


# ---------------------------------------------------------------- text


@pytest.mark.parametrize(
    "text",
    [
        '\n\n \n<?xml version="1.0"?>\n<robot name="r"><link name="a"/></robot>',
        '\ufeff<?xml version="1.0"?><robot name="r"><link name="a"/></robot>',
        '\ufeff\n<robot name="r"><link name="a"/></robot>\n\0\0',
        '<robot name="r"><link name="a"/></robot>\r\n\0',
    ],
)
def test_blanks_marks_and_zeros_around_a_document_are_passed_over(tmp_path, text):
    (tmp_path / "r.urdf").write_bytes(text.encode())
    assert urdf.read(tmp_path / "r.urdf", {}, strict=True).links == ["a"]


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1", "utf-8"])
def test_letters_are_read_in_the_encoding_that_they_are_in(tmp_path, encoding):
    text = '<robot name="r"><!-- Käfer --><link name="Käfer"/></robot>'
    (tmp_path / "r.urdf").write_bytes(text.encode(encoding))
    assert urdf.read(tmp_path / "r.urdf", {}).links == ["Käfer"]


# ---------------------------------------------------------------- numbers


@pytest.mark.parametrize(
    ("xyz", "expected"),
    [
        ("0.5, -1, 2", (0.5, -1, 2)),
        ("0.5,-1,2", (0.5, -1, 2)),
        ("0.5 -1 2 7", (0.5, -1, 2)),
        ("0.5. -1 2", (0.5, -1, 2)),
        (" 5e-1\n-1.\t+2 ", (0.5, -1, 2)),
    ],
)
def test_numbers_are_read_as_they_are_meant(tmp_path, xyz, expected):
    body = link() + link(name="b") + joint("fixed", f'<origin xyz="{xyz}"/>')
    path = written(tmp_path / "r.urdf", body)
    found = urdf.read(path, {})
    np.testing.assert_array_equal(found.joints[0].origin[:3, 3], expected)
    if "7" in xyz or "." in xyz.split()[0][3:]:
        assert "joint 'j'" in found.warnings[0] and "0.5 -1 2" in found.warnings[0]
        strictly_refused(path, "is taken to be 0.5 -1 2")
    else:
        assert not found.warnings


@pytest.mark.parametrize(
    ("xyz", "message"),
    [
        ("0,5 1 2", "decimals with a point"),
        ("0 1", "needs 3 finite numbers"),
        ("0 1 inf", "needs 3 finite numbers"),
        ("0 1 nan", "holds no numbers"),
        ("a b c", "holds no numbers"),
    ],
)
def test_numbers_that_may_mean_anything_are_refused(tmp_path, xyz, message):
    body = link() + link(name="b") + joint("fixed", f'<origin xyz="{xyz}"/>')
    with pytest.raises(hg.InvalidArgument, match=message):
        urdf.read(written(tmp_path / "r.urdf", body), {})


def test_limits_may_be_infinite(tmp_path):
    limit = '<limit lower="-inf" upper="Infinity" effort="1" velocity="1"/>'
    body = link() + link(name="b") + joint("revolute", limit)
    assert Kinematics(urdf.read(written(tmp_path / "r.urdf", body), {})).limits.tolist() == [
        [-np.inf, np.inf]
    ]


def test_one_scale_is_that_of_all_axes(tmp_path):
    stl(tmp_path / "a.stl")
    path = written(tmp_path / "r.urdf", link(mesh("a.stl", ' scale="0.001"')))
    found = urdf.read(path, {})
    assert found.visuals["a"][0].size == (0.001,) * 3 and "all three axes" in found.warnings[0]
    strictly_refused(path, "all three axes")


# ---------------------------------------------------------------- materials


@pytest.mark.parametrize(
    ("rgba", "expected", "told"),
    [
        ("255 51 0 1", (1, 0.2, 0, 1), "up to 255"),
        ("255 51 0 255", (1, 0.2, 0, 1), "up to 255"),
        ("1.2 0.2 -0.1 1", (1, 0.2, 0, 1), "clamped"),
        ("1 0.2 0", (1, 0.2, 0, 1), None),
        ("1 0.2 0 0.5", (1, 0.2, 0, 0.5), None),
        ("red", None, "holds no numbers"),
    ],
)
def test_colors_are_read_as_they_are_meant(tmp_path, rgba, expected, told):
    paint = f'<material name="m"><color rgba="{rgba}"/></material>'
    path = written(tmp_path / "r.urdf", link(BOX.replace("</visual>", paint + "</visual>")))
    found = urdf.read(path, {})
    look = found.visuals["a"][0].look
    assert (look and look.color) == (expected and pytest.approx(expected))
    if told is None:
        assert not found.warnings
    else:
        assert told in found.warnings[0] and "'m'" in found.warnings[0]
        strictly_refused(path, told)


def test_a_texture_that_is_not_there_leaves_the_color(tmp_path):
    paint = '<material name="m"><texture {}/><color rgba="1 0 0 1"/></material>'
    for texture, told in (("", ()), ('filename="no.png"', ("no file",))):
        body = link(BOX.replace("</visual>", paint.format(texture) + "</visual>"))
        path = written(tmp_path / "r.urdf", body)
        found = urdf.read(path, {})
        assert found.visuals["a"][0].look == urdf.Look("m", (1, 0, 0, 1))
        assert len(found.warnings) == len(told) and all(t in found.warnings[0] for t in told)
    strictly_refused(path, "no file", hg.NotFound)


# ---------------------------------------------------------------- files


def test_what_is_missing_is_left_out_and_told(tmp_path):
    odd = ["no.stl", "/no/such/place/no.stl", "package://nowhere/no.stl", "http://host/no.stl", ""]
    for reference in odd:
        path = written(tmp_path / "r.urdf", link(mesh(reference), BOX))
        found = urdf.read(path, {})
        assert [visual.shape for visual in found.visuals["a"]] == ["box"]
        (told,) = found.warnings
        assert told.startswith("link 'a': ") and told.endswith("; it is left out")
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
    ],
)
def test_files_of_the_package_are_found(tmp_path, model, file, reference):
    file = stl(tmp_path / file)
    found = urdf.read(written(tmp_path / model, link(mesh(reference))), {}, strict=True)
    assert found.visuals["a"][0].file == file


def test_a_python_package_is_one(tmp_path):
    file = stl(tmp_path / "robots/hand/parts/a.stl")
    path = written(tmp_path / "robots/arm/r.urdf", link(mesh("../hand/parts/a.stl")))
    with pytest.raises(hg.InvalidArgument, match="outside the file's own folder"):
        urdf.read(path, {})
    (tmp_path / "robots/__init__.py").touch()
    assert urdf.read(path, {}).visuals["a"][0].file == file


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
    assert len(found.warnings) == 3 and any("HELIO_X" in told for told in found.warnings)
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


# ---------------------------------------------------------------- joints


def test_mimics_of_what_never_moves_are_fixed(tmp_path):
    axis = '<axis xyz="0 0 1"/>' + LIMIT
    above = LIMIT.replace("-1", "0.5")
    body = "".join(link(name=name) for name in "abcdefg") + "".join(
        [
            joint("fixed", '<mimic joint="gone"/>', "f", "ab"),
            joint("revolute", axis + '<mimic joint="f" multiplier="3" offset="0.2"/>', "m", "ac"),
            joint("revolute", axis + '<mimic joint="m" multiplier="2" offset="1"/>', "n", "ad"),
            joint("prismatic", above + '<mimic joint="gone"/>', "o", "ae"),
            joint("prismatic", LIMIT + '<mimic joint="o" multiplier="2"/>', "p", "af"),
            joint("revolute", axis, "q", "ag"),
        ]
    )
    path = written(tmp_path / "r.urdf", body)
    found = urdf.read(path, {})
    k = Kinematics(found)
    assert k.joint_names == ["q"]
    poses = dict(zip(k.link_names, k.forward(k.values([0.7])), strict=True))
    np.testing.assert_array_equal(poses["b"], np.eye(4))
    for name, angle in (("c", 0.2), ("d", 2 * 0.2 + 1), ("g", 0.7)):
        c, s = np.cos(angle), np.sin(angle)
        np.testing.assert_allclose(poses[name][:2, :2], [[c, -s], [s, c]], atol=1e-15)
    assert poses["e"][0, 3] == 0.5 and poses["f"][0, 3] == 1.0  # o rests at its lower limit
    told = "\n".join(found.warnings)
    for one in ("'f' is fixed", "'m' mimics 'f', which is fixed", "'o' mimics 'gone', which is no"):
        assert one in told
    assert len(found.warnings) == 5
    with pytest.raises(hg.InvalidArgument, match="it is fixed"):
        k.values({"m": 0.1})
    strictly_refused(path, "mimic")


def test_spherical_joints_turn_as_pybullet_has_them(tmp_path):
    bullet = pytest.importorskip("pybullet", reason="the extra `physics` is not installed")
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
    arm = '<origin xyz="0.1 0.2 0.3" rpy="0.4 -0.5 0.6"/><axis xyz="0 0 0"/>'
    body = "".join(link(mass, name=name) for name in "abc")
    body += joint("spherical", arm, "s", "ab") + joint("spherical", arm, "t", "bc")
    path = written(tmp_path / "r.urdf", body)
    k = Kinematics(urdf.read(path, {}))
    assert k.joint_names == [f"{j}/{q}" for j in "st" for q in ("qw", "qx", "qy", "qz")]
    assert k.rest.tolist() == [1, 0, 0, 0] * 2
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(6, 2, 4))
    rows /= np.linalg.norm(rows, axis=-1, keepdims=True)
    turns = [[hg.Pose(wxyz=q) for q in row] for row in rows]
    world = bullet.connect(bullet.DIRECT)
    try:
        body = bullet.loadURDF(str(path), useFixedBase=True, physicsClientId=world)
        for row, (s, t) in zip(rows, turns, strict=True):
            for i, (w, *xyz) in enumerate(row):
                bullet.resetJointStateMultiDof(body, i, [*xyz, w], physicsClientId=world)
            states = bullet.getLinkStates(
                body, [0, 1], computeForwardKinematics=True, physicsClientId=world
            )
            ours = k.forward(k.values(2.5 * row.ravel()))[1:]  # of any length
            by_name = k.forward(k.values({"s": s, "t": t.matrix[:3, :3]}))[1:]
            np.testing.assert_allclose(by_name, ours, atol=1e-12)
            for state, matrix in zip(states, ours, strict=True):
                theirs = np.reshape(bullet.getMatrixFromQuaternion(state[5]), (3, 3))
                np.testing.assert_allclose(matrix[:3, :3], theirs, atol=1e-6)
                np.testing.assert_allclose(matrix[:3, 3], state[4], atol=1e-6)
    finally:
        bullet.disconnect(world)
    assert k.moved_by(["s"]) == [0]
    for wrong in (hg.Pose((0, 0, 1)), 2 * np.eye(3), np.eye(4), np.diag([1, 1, -1.0])):
        with pytest.raises(hg.InvalidArgument, match=r"values\['s'\]"):
            k.values({"s": wrong})


def test_quaternions_turn_evenly_the_shorter_way(tmp_path):
    body = link() + link(name="b") + link(name="c")
    body += joint("spherical", "", "s", "ab") + joint("floating", "", "f", "bc")
    k = Kinematics(urdf.read(written(tmp_path / "r.urdf", body), {}))
    axis = np.array((0.6, 0, 0.8))

    def row(angle, sign=1):
        turn = sign * np.array((np.cos(angle / 2), *np.sin(angle / 2) * axis))
        return np.concatenate([turn, (angle, 0, 0), turn])

    for sign in (1, -1):
        begin, end = row(0.2), row(2.6, sign)
        assert k.turned(begin, end) == pytest.approx(2.4)
        for share in (0, 0.25, 1):
            expected = k.local(row(0.2 + share * 2.4))
            np.testing.assert_allclose(k.local(k.between(begin, end, share)), expected, atol=1e-12)
    np.testing.assert_allclose(k.between(begin, begin, 0.5), begin)


# ---------------------------------------------------------------- shapes


def test_capsules_are_read_and_unknown_shapes_left_out(tmp_path):
    shape = "<visual><geometry><{}/></geometry></visual>"
    visuals = [shape.format(s) for s in ('capsule radius="0.2" length="1"', 'cone radius="1"')]
    path = written(tmp_path / "r.urdf", link(*visuals))
    found = urdf.read(path, {})
    assert [(v.shape, v.size) for v in found.visuals["a"]] == [("capsule", (0.2, 1))]
    assert "<cone>" in found.warnings[0]
    strictly_refused(path, "<cone>", hg.Unimplemented)


def test_a_robot_without_visuals_is_seen_by_its_collision_shapes(tmp_path):
    solid = '<collision><origin xyz="0 0 1"/><geometry><{}/></geometry></collision>'
    ball = solid.format('sphere radius="2"')
    body = link(ball, solid.format('mesh filename="no.stl"')) + link(name="b") + joint("fixed")
    found = urdf.read(written(tmp_path / "r.urdf", body), {})
    (seen,) = found.visuals["a"]
    assert (seen.shape, seen.size, seen.origin[2, 3]) == ("sphere", (2,), 1)
    assert "no file" in found.warnings[0] and "collision shapes are shown" in found.warnings[1]
    body = link(ball) + link(BOX, name="b") + joint("fixed")
    found = urdf.read(written(tmp_path / "r.urdf", body), {}, strict=True)
    assert not found.visuals["a"] and [v.shape for v in found.visuals["b"]] == ["box"]
    lost = link(solid.format('mesh filename="no.stl"'))
    assert urdf.read(written(tmp_path / "r.urdf", lost), {}).visuals["a"] == []


def test_a_capsule_is_a_cylinder_between_two_halves_of_a_sphere():
    radius, length = 0.3, 1.1
    made = {k: np.asarray(v, float) for k, v in hg.shapes.capsule(radius, length).items()}
    points, faces = made["positions"], made["indices"].astype(int)
    middle = np.clip(points[:, 2], -length / 2, length / 2)
    from_axis = points - np.column_stack([0 * middle, 0 * middle, middle])
    np.testing.assert_allclose(np.linalg.norm(from_axis, axis=1), radius, atol=1e-6)
    np.testing.assert_allclose(made["normals"], from_axis / radius, atol=1e-5)
    a, b, c = (points[faces[:, i]] for i in range(3))
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    exact = np.pi * radius**2 * length + 4 / 3 * np.pi * radius**3
    assert 0.995 * exact < volume < exact
    assert made["uvs"].min() == 0 and made["uvs"].max() == 1
