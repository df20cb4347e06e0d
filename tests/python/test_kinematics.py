"""URDF files and kinematics without a daemon: closed forms, PyBullet, and what is refused."""

from pathlib import Path

import heliograph as hg
import numpy as np
import pytest
from heliograph.robots import urdf
from heliograph.robots.description import Joint, Look, RobotModel
from heliograph.robots.kinematics import Kinematics
from heliograph.robots.robot import listed

ARM = Path(__file__).resolve().parents[2] / "examples/assets/arm/arm.urdf"
LIMIT = '<limit lower="-1" upper="2" effort="1" velocity="1"/>'


def joint(name, kind, ends, inner=""):
    parent, child = ends
    tree = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{tree}{inner}</joint>'


def written(folder, body, links="abcd", head="<robot name='r'>"):
    path = folder / "robot.urdf"
    names = "".join(f'<link name="{link}"/>' for link in links)
    path.write_text(f"{head}{names}{body}</robot>")
    return path


def kinematics_of(folder, body, links="abcd"):
    return Kinematics(urdf.read(written(folder, body, links), {}))


def pose(xyz=(0, 0, 0), rotation=None):
    out = np.eye(4)
    out[:3, 3] = xyz
    if rotation is not None:
        out[:3, :3] = rotation
    return out


def about_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


# ---------------------------------------------------------------- closed forms


def test_two_links_in_a_plane(tmp_path):
    axis = '<axis xyz="0 0 2"/>'
    k = kinematics_of(
        tmp_path,
        joint("q1", "continuous", "ab", axis)
        + joint("q2", "continuous", "bc", axis + '<origin xyz="0.7 0 0"/>')
        + joint("tip", "fixed", "cd", '<origin xyz="0.4 0 0"/>'),
    )
    assert k.joint_names == ["q1", "q2"] and k.link_names == list("abcd")
    q = np.random.default_rng(1).uniform(-3, 3, (50, 2))
    got = k.forward(k.values(q))
    assert got.shape == (50, 4, 4, 4)
    first, both = q[:, 0], q.sum(1)
    x = 0.7 * np.cos(first) + 0.4 * np.cos(both)
    y = 0.7 * np.sin(first) + 0.4 * np.sin(both)
    np.testing.assert_allclose(got[:, 3, :3, 3], np.stack([x, y, 0 * x], 1), atol=1e-14)
    np.testing.assert_allclose(got[7, 3, :3, :3], about_z(both[7]), atol=1e-14)
    for row, poses in zip(q, got, strict=True):
        np.testing.assert_array_equal(k.forward(k.values(row)), poses)


def test_mimics_follow_their_joint_through_others(tmp_path):
    k = kinematics_of(
        tmp_path,
        joint("q", "revolute", "ab", '<axis xyz="0 0 1"/>' + LIMIT)
        + joint("m", "prismatic", "ac", LIMIT + '<mimic joint="n" multiplier="-2" offset="0.1"/>')
        + joint("n", "revolute", "ad", LIMIT + '<mimic joint="q" multiplier="0.5" offset="0.3"/>'),
    )
    assert k.joint_names == ["q"]
    got = k.forward(k.values([0.8]))
    np.testing.assert_allclose(got[k.link_names.index("c")], pose((-2 * 0.7 + 0.1, 0, 0)))
    assert k.moved_by(["q"]) == [0, 1, 2]
    with pytest.raises(hg.InvalidArgument, match="mimics 'q', which moves it"):
        k.values({"n": 0.1})


def test_planar_joints_move_across_their_axis(tmp_path):
    axis = np.array([0.6, 0, 0.8])
    k = kinematics_of(tmp_path, joint("p", "planar", "ab", '<axis xyz="0.6 0 0.8"/>'), "ab")
    assert k.joint_names == ["p/x", "p/y", "p/angle"]
    rng = np.random.default_rng(2)
    got = k.local(k.values({"p": rng.uniform(-1, 1, (20, 3))}))[:, 0]
    np.testing.assert_allclose(got[:, :3, 3] @ axis, 0, atol=1e-15)
    np.testing.assert_allclose(got[:, :3, :3] @ axis, np.tile(axis, (20, 1)), atol=1e-15)
    one = k.local(k.values([0.3, -0.4, 0]))[0]
    np.testing.assert_allclose(np.linalg.norm(one[:3, 3]), 0.5)
    np.testing.assert_allclose(one[:3, 3], (0.24, -0.4, -0.18), atol=1e-15)
    upright = kinematics_of(tmp_path, joint("p", "planar", "ab", '<axis xyz="0 0 1"/>'), "ab")
    np.testing.assert_allclose(
        upright.local(upright.values([1, 2, 0.5]))[0], pose((1, 2, 0), about_z(0.5)), atol=1e-15
    )
    with pytest.raises(hg.InvalidArgument, match="all columns of 'p'"):
        k.moved_by(["p/x"])


def test_balls_and_joints_that_rest_elsewhere():
    z, x = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])
    turn = Joint("turn", "revolute", "a", "b", pose((1, 0, 0)), z, 0.5, 2.0, rest=(0.25,))
    ball = Joint("ball", "spherical", "b", "c", pose((0, 1, 0)), x)
    for soft in (False, True):
        k = Kinematics(RobotModel("r", list("abc"), {}, [turn, ball], soft_limits=soft))
        assert k.joint_names == ["turn", "ball/qw", "ball/qx", "ball/qy", "ball/qz"]
        np.testing.assert_array_equal(k.rest, [0.25 if soft else 0.5, 1, 0, 0, 0])
        half = [np.cos(0.35), 0, 0, np.sin(0.35)]
        found = k.forward(k.values({"turn": 0.75, "ball": half}))
        expected = pose((1, 0, 0), about_z(0.5)) @ pose((0, 1, 0), about_z(0.7))
        np.testing.assert_allclose(found[2], expected, atol=1e-12)
        if soft:
            assert k.values({"turn": 9})[0] == 9 and k.values({"turn": 9}, clamp=True)[0] == 2
        else:
            with pytest.raises(hg.InvalidArgument, match="outside its limits"):
                k.values({"turn": 9})


def test_quaternions_are_taken_by_name(tmp_path):
    k = kinematics_of(tmp_path, joint("f", "floating", "ab") + joint("s", "spherical", "bc"), "abc")
    q = np.random.default_rng(5).normal(size=(4, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    expected = [hg.Pose((1, 2, 3), wxyz=each).matrix for each in q]
    rows = k.values({"f": np.column_stack([np.tile((1, 2, 3), (4, 1)), q]), "s": q})
    np.testing.assert_allclose(k.local(rows)[:, 0], expected, atol=1e-14)
    np.testing.assert_allclose(k.local(rows)[:, 1, :3, :3], np.array(expected)[:, :3, :3])
    np.testing.assert_allclose(k.values({"f": (1, 2, 3, *q[2]), "s": q[2]}), rows[2])
    for name, wrong in {"f": ["a"] * 7, "s": [1, 0, 0, np.nan]}.items():
        with pytest.raises(hg.InvalidArgument, match=rf"values\['{name}'\]"):
            k.values({name: wrong})


def test_floating_joints_take_poses(tmp_path):
    k = kinematics_of(tmp_path, joint("f", "floating", "ab", '<origin xyz="0 0 5"/>'), "ab")
    rng = np.random.default_rng(3)
    poses = [hg.Pose(rng.uniform(-1, 1, 3), wxyz=rng.normal(size=4)).matrix for _ in range(40)]
    poses += [hg.Pose((1, 2, 3), wxyz=q).matrix for q in np.eye(4)]  # half turns too
    expected = np.array([pose((0, 0, 5)) @ p for p in poses])
    np.testing.assert_allclose(
        k.forward(k.values({"f": np.array(poses)}))[:, 1], expected, atol=1e-14
    )
    np.testing.assert_allclose(k.forward(k.values({}))[1], pose((0, 0, 5)))
    turned = k.forward(k.values([0, 0, 0, 2, 0, 0, 2]))[1]
    np.testing.assert_allclose(turned, pose((0, 0, 5), about_z(np.pi / 2)), atol=1e-15)
    for wrong in (np.diag([2.0, 2, 2, 1]), np.diag([-1.0, 1, 1, 1]), np.zeros(3)):
        with pytest.raises(hg.InvalidArgument, match="'f'"):
            k.values({"f": wrong})


# ---------------------------------------------------------------- an oracle


@pytest.mark.parametrize(
    "name",
    [
        *("kuka_iiwa/model", "r2d2", "franka_panda/panda", "quadruped/minitaur", "a1/a1", "own"),
        *("bicycle/bike", "biped/biped2d_pybullet", "quadruped/microtaur/microtaur"),
        *("differential/diff_ring", "racecar/racecar_differential"),
    ],
)
def test_links_are_where_pybullet_has_them(name):
    bullet = pytest.importorskip("pybullet", reason="the extra `physics` is not installed")
    data = pytest.importorskip("pybullet_data")
    path = ARM if name == "own" else Path(data.getDataPath()) / f"{name}.urdf"
    k = Kinematics(urdf.read(path, {}))
    world = bullet.connect(bullet.DIRECT)
    try:
        body = bullet.loadURDF(str(path), useFixedBase=True, physicsClientId=world)
        joints = {}
        links = {}
        for i in range(bullet.getNumJoints(body, physicsClientId=world)):
            info = bullet.getJointInfo(body, i, physicsClientId=world)
            joints[info[1].decode()], links[info[12].decode()] = i, i
        low, high = np.clip(k.limits, -3, 3).T
        for values in np.random.default_rng(4).uniform(low, high, (8, len(low))):
            angles = k._motion.amounts(values)
            for one, angle in zip(k.moving, angles, strict=True):
                bullet.resetJointState(body, joints[one.name], angle, physicsClientId=world)
            ours = k.forward(k.values(values))
            states = bullet.getLinkStates(
                body, list(links.values()), computeForwardKinematics=True, physicsClientId=world
            )
            for link, state in zip(links, states, strict=True):
                matrix = np.reshape(bullet.getMatrixFromQuaternion(state[5]), (3, 3))
                theirs = pose(state[4], matrix)
                np.testing.assert_allclose(ours[k.link_names.index(link)], theirs, atol=1e-6)
    finally:
        bullet.disconnect(world)


# ---------------------------------------------------------------- values


def test_values_are_checked_against_the_limits():
    k = Kinematics(urdf.read(ARM, {}))
    assert k.joint_names == ["yaw", "shoulder", "elbow", "wrist", "grip"]
    with pytest.raises(
        hg.InvalidArgument, match=r"joint 'elbow' is at 2\.7.*\[-0\.2, 2\.6\].*clamp"
    ) as error:
        k.values({"elbow": 2.7})
    assert error.value.field == "values['elbow']"
    rows = np.zeros((3, 5))
    rows[2, 4] = -0.01
    with pytest.raises(hg.InvalidArgument, match=r"values\[2\]: joint 'grip' is at -0\.01"):
        k.values(rows)
    assert k.values(rows, clamp=True)[2, 4] == 0
    assert k.values({"yaw": 9.0})[0] == 9.0
    k.values(np.float32([0, 1.8, 2.6, 2, 0.05]))  # above the limits by their rounding
    np.testing.assert_array_equal(k.values({"grip": [0, 0.02]})[:, 4], [0, 0.02])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"elbo": 1}, "no such joint; joints are elbow"),
        ({"tool_joint": 1}, "it is fixed"),
        ({"elbow": float("nan")}, "finite"),
        ({"elbow": [0, 1], "yaw": [0, 1, 2]}, "do not go together"),
        ([0, 0, 0], r"needs shape \(5\)"),
        (np.zeros((2, 4)), r"needs shape \(N, 5\)"),
    ],
)
def test_wrong_values_are_refused_by_name(given, message):
    with pytest.raises(hg.InvalidArgument, match=message):
        Kinematics(urdf.read(ARM, {})).values(given)


def test_joints_without_usable_limits_move_freely_and_say_so(tmp_path):
    backwards = '<limit lower="2" upper="1"/>'
    body = joint("j", "revolute", "ab", backwards) + joint("k", "prismatic", "bc")
    body += joint("l", "revolute", "cd", '<limit effort="1" velocity="1"/>')
    found = urdf.read(written(tmp_path, body, "abcd"), {})
    assert not np.isfinite(Kinematics(found).limits).any()
    warned = [w.split(" has ")[0] for w in found.warnings]
    assert warned == ["joint 'j'", "joint 'k'", "joint 'l'"]


def test_rest_is_within_the_limits(tmp_path):
    limit = '<limit lower="0.5" upper="2" effort="1" velocity="1"/>'
    k = kinematics_of(tmp_path, joint("q", "revolute", "ab", limit), "ab")
    assert k.rest.tolist() == [0.5] and k.values({}).tolist() == [0.5]


# ---------------------------------------------------------------- files


def test_what_is_seen_is_read(tmp_path):
    package = tmp_path / "ros/arm_description"
    (package / "meshes").mkdir(parents=True)
    (package / "meshes/a.stl").write_text("solid a\nendsolid\n")
    visual = """<link name="a"><visual><origin xyz="1 2 3" rpy="0 0 1"/><geometry>
        <mesh filename="package://arm_description/meshes/a.stl" scale="1 2 3"/></geometry>
        <material name="red"/></visual><collision><geometry><capsule/></geometry></collision></link>
        <material name="red"><color rgba="1 0 0 0.5"/></material><gazebo/>"""
    path = written(tmp_path, visual, links="")
    with pytest.raises(hg.NotFound, match=r"packages=\{\"arm_description\"") as error:
        urdf.read(path, {})
    assert error.value.field == "packages"
    (seen,) = urdf.read(path, {"arm_description": package}).visuals["a"]
    assert (seen.shape, seen.size, seen.file) == ("mesh", (1, 2, 3), package / "meshes/a.stl")
    assert seen.look == Look("red", (1, 0, 0, 0.5))
    np.testing.assert_allclose(seen.origin, pose((1, 2, 3), about_z(1)))
    (package / "urdf").mkdir()
    inside = package / "urdf/r.urdf"  # its own package by the name of a folder above it
    inside.write_text(path.read_text())
    assert urdf.read(inside, {}).visuals["a"][0].file == seen.file


def test_files_elsewhere_are_refused(tmp_path):
    (tmp_path / "b.stl").write_text("solid\n")
    (tmp_path / "in").mkdir()
    for reference in ("../b.stl", f"file://{tmp_path}/b.stl"):
        mesh = f'<visual><geometry><mesh filename="{reference}"/></geometry></visual>'
        path = written(tmp_path / "in", f'<link name="a">{mesh}</link>', links="")
        with pytest.raises(hg.InvalidArgument, match="outside the file's own folder"):
            urdf.read(path, {})
        assert urdf.read(path, {"meshes": tmp_path}).visuals["a"][0].file == tmp_path / "b.stl"
    (tmp_path / "package.xml").write_text("<package/>")  # of ROS
    urdf.read(path, {})


def test_xacro_is_refused_with_the_remedy(tmp_path):
    for body in ('<xacro:macro name="m"/>', '<link name="${prefix}x"/>'):
        with pytest.raises(hg.InvalidArgument, match=r"is xacro.*`xacro robot\.urdf > "):
            urdf.read(written(tmp_path, body), {})


BOMB = '<!DOCTYPE r [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><robot name="&b;">'


@pytest.mark.parametrize(
    ("body", "head", "message"),
    [
        ("", BOMB, "document type"),
        ("<x>" * 100 + "</x>" * 100, None, "nested deeper"),
        ("<link", None, "is no XML"),
        ("", "<sdf>", "<sdf>"),
        (joint("j", "revolute", "ab"), None, r"one link without a parent, has \['a', 'c', 'd'\]"),
        (joint("j", "hinge", "ab"), None, "type 'hinge' is none of revolute"),
        (joint("j", "fixed", "ax"), None, "joint 'j': there is no link 'x'"),
        (joint("j", "fixed", "ab") + joint("k", "fixed", "cb"), None, "'b': has more than one"),
        ("".join(joint(e, "fixed", e) for e in ("ab", "cd", "dc")), None, "cycle"),
        (joint("j", "revolute", "ab", '<axis xyz="0 0 0"/>'), None, "axis has length 0"),
        (joint("j", "revolute", "ab", '<axis xyz="0 1"/>'), None, "needs 3 finite numbers"),
        (joint("j", "fixed", "ab") * 2, None, "'j' is empty or taken"),
        ('<link name="e"><visual/></link>', None, "link 'e': a <visual> has no geometry"),
    ],
)
def test_broken_files_are_refused(tmp_path, body, head, message):
    text = written(tmp_path, body, head=head or "<robot name='r'>").read_text()
    if head == "<sdf>":
        text = text.replace("</robot>", "</sdf>")
    (tmp_path / "robot.urdf").write_text(text)
    with pytest.raises(hg.InvalidArgument, match=message) as error:
        urdf.read(tmp_path / "robot.urdf", {})
    assert error.value.field == "path"


def test_mimics_in_a_circle_are_refused(tmp_path):
    body = "".join(
        joint(a, "revolute", ends, LIMIT + f'<mimic joint="{b}"/>')
        for a, b, ends in [("j", "k", "ab"), ("k", "j", "bc")]
    )
    with pytest.raises(hg.InvalidArgument, match="mimics itself"):
        urdf.read(written(tmp_path, body, links="abc"), {})


def test_shapes_without_size_are_left_out(tmp_path):
    ball = '<link name="a"><visual><geometry><sphere radius="0"/></geometry></visual></link>'
    found = urdf.read(written(tmp_path, ball, links=""), {})
    assert found.visuals["a"] == [] and "without size" in found.warnings[0]


def test_unknown_shapes_are_unimplemented(tmp_path):
    cone = '<link name="a"><visual><geometry><cone radius="1"/></geometry></visual></link>'
    with pytest.raises(hg.Unimplemented, match="<cone>"):
        urdf.read(written(tmp_path, cone, links=""), {})


def test_a_name_is_no_robot():
    with pytest.raises(hg.InvalidArgument, match=r"needs an hg\.Robot or a sequence"):
        listed(["arm"])
