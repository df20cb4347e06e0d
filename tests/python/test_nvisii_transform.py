"""nvisii.transform: poses, parents, motion; it needs no daemon."""

import math

import numpy as np
import nvisii
import pytest
from nvisii import placement

HALF = math.sqrt(0.5)


@pytest.fixture(autouse=True)
def empty():
    yield
    nvisii.clear_all()


def rows(matrix):
    return np.array([[matrix[c][r] for c in range(4)] for r in range(4)])


def test_scale_then_rotation_then_translation():
    made = nvisii.transform.create(
        "t", scale=(2, 3, 4), rotation=nvisii.quat(HALF, 0, 0, HALF), position=[1, 2, 3]
    )
    assert made.transform_point((1, 0, 0)) == pytest.approx([1, 4, 3])
    assert made.transform_vector((0, 1, 0)) == pytest.approx([-3, 0, 0])
    assert made.transform_direction((0, 1, 0)) == pytest.approx([-1, 0, 0])
    assert made.inverse_transform_point((1, 4, 3)) == pytest.approx([1, 0, 0])
    assert made.inverse_transform_vector((-3, 0, 0)) == pytest.approx([0, 1, 0])
    product = (
        made.get_local_to_parent_translation_matrix()
        * made.get_local_to_parent_rotation_matrix()
        * made.get_local_to_parent_scale_matrix()
    )
    assert np.allclose(rows(product), rows(made.get_local_to_parent_matrix()))
    assert made.get_local_to_world_matrix()[3] == pytest.approx([1, 2, 3, 1])


@pytest.mark.parametrize("kind", [tuple, list, np.array, lambda v: nvisii.vec3(*v)])
def test_any_sequence_is_a_vector(kind):
    made = nvisii.transform.create("t", position=kind([1, 2, 3]))
    made.set_scale(kind([2, 2, 2]))
    made.add_position(kind([1, 1, 1]))
    assert made.get_position() == [2, 3, 4] and made.get_scale() == [2, 2, 2]
    with pytest.raises(RuntimeError, match="position: needs 3 numbers"):
        made.set_position(kind([1, 2, 3])[:2])
    with pytest.raises(RuntimeError, match="position: needs 3 numbers"):
        made.set_position("123")


def test_look_at_turns_minus_z_to_the_target_and_keeps_up():
    made = nvisii.transform.create("t")
    made.look_at(eye=[1, 2, 3], at=(4, 2, 3), up=[0, 0, 1])
    assert made.get_position() == [1, 2, 3]
    assert made.transform_direction((0, 0, -1)) == pytest.approx([1, 0, 0])
    assert made.get_up() == pytest.approx([0, 0, 1])
    made.look_at(at=(1, 2, 9), up=(0, 0, 1))  # along up: any roll will do
    assert made.get_position() == [1, 2, 3]
    assert made.get_forward() == pytest.approx([0, 0, -1])
    with pytest.raises(RuntimeError, match="same point"):
        made.look_at(at=(1, 2, 3), up=(0, 0, 1))


def test_a_matrix_is_decomposed_or_kept():
    turned = nvisii.transform.create("a", (1, 2, 3), nvisii.angleAxis(0.7, (1, 1, 0)), (4, 5, 6))
    matrix = turned.get_local_to_world_matrix()
    other = nvisii.transform.create_from_matrix("b", matrix)
    assert other.get_scale() == pytest.approx([1, 2, 3])
    assert other.get_position() == pytest.approx([4, 5, 6])
    assert np.allclose(rows(other.get_local_to_world_matrix()), rows(matrix))
    mirrored = nvisii.mat4(1)
    mirrored[0][0] = -1.0
    other.set_transform(mirrored)
    assert np.allclose(rows(other.get_local_to_parent_matrix()), np.diag([-1, 1, 1, 1]))
    skewed = nvisii.mat4(1)
    skewed[1][0] = 1.0
    with pytest.raises(RuntimeError, match="skews"):
        other.set_transform(skewed)
    other.set_transform(nvisii.mat4(1))
    other.set_transform(skewed, decompose=False)
    assert other.transform_point((0, 1, 0)) == pytest.approx([1, 1, 0])


@pytest.mark.parametrize(
    "call",
    [
        lambda made: made.inverse_transform_point((1, 2, 3)),
        lambda made: made.inverse_transform_vector((1, 2, 3)),
        lambda made: made.get_parent_to_local_matrix(),
        lambda made: made.get_world_to_local_matrix(),
    ],
)
def test_a_scale_of_0_has_no_inverse(call):
    made = nvisii.transform.create("t", scale=(0, 1, 1))
    with pytest.raises(RuntimeError, match="no inverse: a scale is 0"):
        call(made)


def test_rotate_around_carries_position_and_rotation_the_same_way():
    made = nvisii.transform.create("t", position=(2, 0, 0))
    made.rotate_around((1, 0, 0), nvisii.angleAxis(math.pi / 2, (0, 0, 1)))
    assert made.get_position() == pytest.approx([1, 1, 0])
    assert made.transform_direction((1, 0, 0)) == pytest.approx([0, 1, 0])


def test_parents_compose_and_refuse_cycles():
    a, b = nvisii.transform.create("a", position=(0, 0, 1)), nvisii.transform.create("b")
    b.set_parent(a)
    b.set_position((1, 0, 0))
    a.set_angle_axis(math.pi / 2, (0, 0, 1))
    assert b.get_world_position() == pytest.approx([0, 1, 1])
    assert a.get_children() == [b] and b.get_parent() is a
    with pytest.raises(RuntimeError, match="cycle"):
        a.set_parent(b)
    nvisii.transform.remove("a")
    assert b.get_parent() is None and b.get_world_position() == [1, 0, 0]


def test_velocities_move_the_previous_pose_back():
    made = nvisii.transform.create("t", position=(3, 0, 0))
    made.set_linear_velocity((24, 0, 0), frames_per_second=24)
    made.set_angular_velocity(nvisii.angleAxis(math.pi / 2, (0, 0, 1)), 2)
    made.set_scalar_velocity((1, 1, 1), 2)
    assert made.get_position(previous=True) == [2, 0, 0]
    assert made.get_scale(previous=True) == [0.5, 0.5, 0.5]
    turned = made.get_rotation(previous=True) * nvisii.vec3(1, 0, 0)
    assert turned == pytest.approx([HALF, -HALF, 0])
    made.set_position((5, 0, 0))
    assert made.get_position(previous=True) == [4, 0, 0]
    made.set_position((0, 0, 0), previous=True)
    made.set_position((6, 0, 0))
    assert made.get_position(previous=True) == [0, 0, 0]
    made.set_linear_velocity((1, 0, 0))
    made.set_linear_velocity((3, 0, 0), mix=0.5)
    assert made.get_position(previous=True) == [4, 0, 0]
    made.clear_motion()
    assert made.get_position(previous=True) == [6, 0, 0]


def test_names_are_unique_and_ids_are_the_lowest_free_ones():
    first, second = nvisii.transform.create("a"), nvisii.transform.create("b")
    with pytest.raises(RuntimeError, match="already exists"):
        nvisii.transform.create("a")
    assert (first.get_id(), second.get_id()) == (0, 1)
    nvisii.transform.remove("a")
    assert nvisii.transform.get("a") is None and not first.is_initialized()
    nvisii.transform.remove("a")  # silent, as for all but materials, lights and cameras
    with pytest.raises(RuntimeError, match="no material"):
        nvisii.material.remove("a")
    assert nvisii.transform.create("c").get_id() == 0
    assert nvisii.transform.get_name_to_id_map() == {"b": 1, "c": 0}
    assert nvisii.transform.get_count() == 2


def test_transforms_share_nothing_that_changes():
    a, b = nvisii.transform.create("a"), nvisii.transform.create("b")
    a.set_position((1, 0, 0), previous=True)
    a.set_linear_velocity((0, 0, 2))
    a.add_angle_axis(1, (0, 0, 1))
    assert a.get_position(previous=True) == [0, 0, -2] and placement.moves(a)
    assert b.get_position(previous=True) == [0, 0, 0] and b.get_rotation() == nvisii.quat()
    assert not placement.moves(b)
    b.set_parent(a)
    assert placement.moves(b)
    a.set_transform(np.eye(4) * 2 - np.diag([0, 0, 0, 1]), decompose=False, previous=True)
    a.set_linear_velocity((0, 0, 0))
    assert placement.moves(a)
    a.clear_motion()
    assert not placement.moves(b)
