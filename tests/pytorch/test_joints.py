"""Joint values that are tensors: poses as numpy works them out, where the tensor is.
tests/gpu/frames.py has tensors on a GPU."""

import pickle
from pathlib import Path

import heliograph as hg
import numpy as np
import pytest
import torch
from heliograph.robots import urdf
from heliograph.robots.description import Joint, RobotModel
from heliograph.robots.kinematics import Kinematics

ARM = Path(__file__).resolve().parents[2] / "examples/assets/arm/arm.urdf"
KINDS = ["revolute", "prismatic", "continuous", "planar", "floating", "fixed"]


@pytest.fixture
def every_kind(tmp_path):
    """A chain with a joint of each kind, and one that mimics the first."""
    inner = (
        '<axis xyz="0.6 0 0.8"/><origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>'
        '<limit lower="-1" upper="2" effort="1" velocity="1"/>'
    )
    mimic = '<mimic joint="j0" multiplier="-0.5" offset="0.1"/>'
    joints = [
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>{inner}'
        + ("" if i < len(KINDS) else mimic)
        + "</joint>"
        for i, kind in enumerate([*KINDS, "revolute"])
    ]
    links = "".join(f'<link name="l{i}"/>' for i in range(len(joints) + 1))
    path = tmp_path / "robot.urdf"
    path.write_text(f"<robot name='r'>{links}{''.join(joints)}</robot>")
    return Kinematics(urdf.read(path, {}))


def values_of(kinematics, count):
    rows = np.random.default_rng(3).uniform(-0.9, 0.9, (count, len(kinematics.joint_names)))
    rows[:, -4:] += 0.2  # the quaternion, of any length
    return rows


def test_spherical_joints_are_those_of_numpy():
    ball = Joint("ball", "spherical", "a", "b", np.eye(4), np.array([1.0, 0, 0]))
    k = Kinematics(RobotModel("r", ["a", "b"], {}, [ball], soft_limits=True))
    rows = np.random.default_rng(1).normal(size=(20, 4))
    theirs = k.local(k.values(torch.from_numpy(rows)))
    np.testing.assert_allclose(theirs.numpy(), k.local(k.values(rows)), atol=1e-14)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_poses_are_those_of_numpy(every_kind, dtype):
    k = every_kind
    given = torch.from_numpy(values_of(k, 50)).to(dtype).requires_grad_()
    kept = given.detach().clone()
    theirs, ours = k.values(given), k.values(given.detach().numpy())
    assert theirs.dtype == torch.float64 and not theirs.requires_grad
    for function in (k.local, k.forward):
        made = function(theirs)
        assert isinstance(made, torch.Tensor)
        np.testing.assert_allclose(made.numpy(), function(ours), atol=1e-14)
    np.testing.assert_allclose(k.local(theirs[4]).numpy(), k.local(ours[4]), atol=1e-14)
    assert torch.equal(given, kept)
    again = pickle.loads(pickle.dumps(k))
    assert torch.equal(again.local(again.values(given)), k.local(theirs))


def test_what_is_wrong_is_told_as_of_numpy(every_kind):
    k = every_kind
    good = values_of(k, 3)

    def refusals(clamp=False, **wrong):
        rows = wrong.pop("rows", good).copy()
        for column, value in wrong.items():
            rows[1, k.joint_names.index(column.replace("_", "/"))] = value
        for given in (rows, torch.from_numpy(rows)):
            with pytest.raises(hg.InvalidArgument) as error:
                k.values(given, clamp)
            yield str(error.value), error.value.field

    for case in (
        {"j0": 2.1},
        {"j1": -1.1},
        {"j2": np.nan},
        {"j2": np.inf},
        {"j0": np.nan, "clamp": True},
        {"j4_qw": 0, "j4_qx": 0, "j4_qy": 0, "j4_qz": 1e-10},
        {"rows": good[:, :-1]},
        {"rows": good[None]},
    ):
        theirs, ours = refusals(**case)
        assert theirs == ours
    high = good + 5
    clamped = k.values(torch.from_numpy(high), clamp=True).numpy()
    np.testing.assert_array_equal(clamped[:, :2], 2)
    np.testing.assert_allclose(clamped, k.values(high, clamp=True), atol=1e-14)


def test_robots_of_a_scene_and_of_worlds_move_by_tensors():
    with hg.connect() as client, client.create_scene() as scene:
        with scene.edit() as edit:
            arms = [edit.import_urdf(ARM, name=f"arm{i}", category="arm") for i in range(2)]
            edit.dome(color=1.0)
            lens = hg.Camera.from_fov(50, 48, 32, degrees=True)
            edit.entity("cam", camera=lens, transform=hg.look_at((2, -2, 1), (0, 0, 0.4)))
        low, high = np.clip(arms[0].limits, -1, 1).T
        rows = np.random.default_rng(1).uniform(low, high, (3, 2, len(low)))
        moving = [entity for arm in arms for entity in arm.moving]
        poses = []
        for values in (rows[0], torch.from_numpy(rows[0])):
            with scene.edit() as edit:
                edit.set_joints(arms, np.clip(np.zeros_like(rows[0]), low, high))
                edit.set_joints(arms, values)
                edit.set_joints(arms[0], {"grip": values[0, -1]})
            poses.append(scene.transforms(moving))
        np.testing.assert_array_equal(*poses)
        with scene.edit() as edit:
            edit.set_joints(arms[0], keys={0: torch.from_numpy(rows[0, 0]), 1: rows[1, 0]})
        pictures = []
        for values in (rows, torch.from_numpy(rows)):
            worlds = hg.Worlds(3).set_joints(arms, values)
            pictures.append(scene.render_worlds("cam", worlds, planes=["depth"])["depth"])
        np.testing.assert_array_equal(*pictures)
        with pytest.raises(hg.InvalidArgument, match=r"values: needs shape \(3, 2, 5\), has"):
            hg.Worlds(3).set_joints(arms, torch.from_numpy(rows[:2]))
