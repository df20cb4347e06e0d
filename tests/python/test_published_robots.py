"""URDF files as people publish them: what is meant is read, what is odd is told, and no more is
read than what belongs to a robot."""

import heliograph as hg
import numpy as np
import pytest
from heliograph.robots import urdf
from heliograph.robots.description import Look
from heliograph.robots.kinematics import Kinematics
from urdf_text import BOX, LIMIT, joint, link, mesh, stl, strictly_refused, written

# ---------------------------------------------------------------- text


@pytest.mark.parametrize(
    "text",
    [
        '\n\n \n<?xml version="1.0"?>\n<robot name="r"><link name="a"/></robot>',
        '\ufeff<?xml version="1.0"?><robot name="r"><link name="a"/></robot>',
        '\ufeff\n<robot name="r"><link name="a"/></robot>\n\0\0',
        '<robot name="r"><link name="a"/></robot>\r\n\0',
        '<!-- mine --><?xml version="1.0"?>\n<robot name="r"><link name="a"/></robot>',
        '<robot name="r"><!-- a -- b --- --><link name="a"/></robot>',
        '<!DOCTYPE robot><robot name="r"><link name="a"/></robot>',
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


@pytest.mark.parametrize(
    ("named", "encoding"),
    [
        *((name, name) for name in ("shift_jis", "gb2312", "windows-1252", "utf-16", "utf-16-le")),
        ("utf-16", "utf-8"),  # as writers of texts in memory leave it
        ("us-ascii", "utf-8"),
        ("no such", "utf-8"),
        ("utf-8", "latin-1"),
    ],
)
def test_documents_that_say_their_encoding_are_read_whether_it_is_so_or_not(
    tmp_path, named, encoding
):
    name = "青" if encoding in ("shift_jis", "gb2312") else "Käfer"
    text = f'<?xml version="1.0" encoding="{named}"?><robot name="r"><link name="{name}"/></robot>'
    (tmp_path / "r.urdf").write_bytes(text.encode(encoding))
    assert urdf.read(tmp_path / "r.urdf", {}).links == [name]


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
    ("rgba", "expected", "warning"),
    [
        ("255 51 0 1", (1, 0.2, 0, 1), "up to 255"),
        ("255 51 0 255", (1, 0.2, 0, 1), "up to 255"),
        ("1.2 0.2 -0.1 1", (1, 0.2, 0, 1), "clamped"),
        ("1 0.2 0", (1, 0.2, 0, 1), None),
        ("1 0.2 0 0.5", (1, 0.2, 0, 0.5), None),
        ("red", None, "holds no numbers"),
    ],
)
def test_colors_are_read_as_they_are_meant(tmp_path, rgba, expected, warning):
    paint = f'<material name="m"><color rgba="{rgba}"/></material>'
    path = written(tmp_path / "r.urdf", link(BOX.replace("</visual>", paint + "</visual>")))
    found = urdf.read(path, {})
    look = found.visuals["a"][0].look
    assert (look and look.color) == (expected and pytest.approx(expected))
    if warning is None:
        assert not found.warnings
    else:
        assert warning in found.warnings[0] and "'m'" in found.warnings[0]
        strictly_refused(path, warning)


def test_a_texture_that_is_not_there_leaves_the_color(tmp_path):
    paint = '<material name="m"><texture {}/><color rgba="1 0 0 1"/></material>'
    for texture, warning in (("", ()), ('filename="no.png"', ("no file",))):
        body = link(BOX.replace("</visual>", paint.format(texture) + "</visual>"))
        path = written(tmp_path / "r.urdf", body)
        found = urdf.read(path, {})
        assert found.visuals["a"][0].look == Look("m", (1, 0, 0, 1))
        assert len(found.warnings) == len(warning) and all(t in found.warnings[0] for t in warning)
    strictly_refused(path, "no file", hg.NotFound)


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
    warnings = "\n".join(found.warnings)
    for one in ("'f' is fixed", "'m' mimics 'f', which is fixed", "'o' mimics 'gone', which is no"):
        assert one in warnings
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
    missing = link(solid.format('mesh filename="no.stl"'))
    assert urdf.read(written(tmp_path / "r.urdf", missing), {}).visuals["a"] == []


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
