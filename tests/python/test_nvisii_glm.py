"""GLM's types and functions in nvisii: its conventions, against numpy; it needs no daemon."""

import math

import numpy as np
import nvisii
import pytest


def rows(matrix):
    return np.array(matrix).T


def test_vectors_have_names_indices_and_arithmetic():
    v = nvisii.vec3(1, 2, 3)
    assert (v.x, v.y, v.z, v.r, v[2], len(v)) == (1, 2, 3, 1, 3, 3)
    v.y, v[2] = 5, 6
    assert v == [1, 5, 6] and list(v) == [1, 5, 6]
    assert v + 1 == [2, 6, 7] and 1 - v == [0, -4, -5] and v * [2, 1, 0] == [2, 5, 0]
    assert -v / 2 == [-0.5, -2.5, -3] and 6 / nvisii.vec2(2, 3) == [3, 2]
    assert np.array([1, 1, 1]) + v == [2, 6, 7]
    assert nvisii.vec3(2) == [2, 2, 2] and nvisii.vec4(v, 1) == [1, 5, 6, 1]
    assert nvisii.vec2(v) == [1, 5] and nvisii.vec3() == [0, 0, 0]
    assert nvisii.ivec2(1.9, 2) == [1, 2] and nvisii.u16vec2(65537, 2) == [1, 2]
    assert np.asarray(v).tolist() == [1, 5, 6]
    assert repr(nvisii.vec2(1, 2)) == "vec2(1.000000, 2.000000)"
    with pytest.raises(RuntimeError, match="vec3 has 3 numbers"):
        nvisii.vec3(1, 2)
    with pytest.raises(TypeError):
        v + [1, 2]


def test_a_quaternion_is_made_of_wxyz_and_indexed_as_xyzw():
    q = nvisii.quat(1, 2, 3, 4)
    assert (q.w, q.x, q.y, q.z) == (1, 2, 3, 4) and list(q) == [2, 3, 4, 1] and q[3] == 1
    turn = nvisii.angleAxis(math.pi / 2, (0, 0, 2))
    assert turn * nvisii.vec3(1, 0, 0) == pytest.approx([0, 1, 0])
    assert nvisii.vec3(0, 1, 0) * turn == pytest.approx([1, 0, 0])
    both = nvisii.angleAxis(0.3, (1, 0, 0)) * turn
    assert list(nvisii.quat_cast(nvisii.mat4_cast(both))) == pytest.approx(list(both))
    assert list(nvisii.inverse(both) * both) == pytest.approx([0, 0, 0, 1])
    assert nvisii.angle(turn) == pytest.approx(math.pi / 2) and nvisii.axis(turn) == [0, 0, 1]
    euler = nvisii.quat(nvisii.vec3(0.1, 0.2, 0.3))
    assert nvisii.eulerAngles(euler) == pytest.approx([0.1, 0.2, 0.3])
    assert nvisii.quatLookAt((0, 1, 0), (0, 0, 1)) * nvisii.vec3(0, 0, -1) == pytest.approx(
        [0, 1, 0]
    )
    half = nvisii.slerp(nvisii.quat(), turn, 0.5)
    assert nvisii.angle(half) == pytest.approx(math.pi / 4)
    assert list(nvisii.mix(nvisii.quat(), turn, 0.5)) == pytest.approx(list(half))
    to = nvisii.rotation((1, 0, 0), (-1, 0, 0))
    assert to * nvisii.vec3(1, 0, 0) == pytest.approx([-1, 0, 0])


def test_matrices_are_indexed_by_column():
    m = nvisii.translate(nvisii.mat4(1), (1, 2, 3))
    assert m[3] == [1, 2, 3, 1] and m[3][1] == 2
    m[3][1] = 9
    assert (m * nvisii.vec4(0, 0, 0, 1)).y == 9
    numbers = nvisii.mat3(1, 2, 3, 4, 5, 6, 7, 8, 9)
    assert numbers[0] == [1, 2, 3] and nvisii.row(numbers, 0) == [1, 4, 7]
    assert nvisii.column(numbers, 1) == [4, 5, 6]
    assert nvisii.transpose(numbers)[0] == [1, 4, 7]
    assert numbers * nvisii.mat3(2) == numbers * 2 == numbers + numbers
    assert nvisii.mat4(numbers)[3] == [0, 0, 0, 1] and nvisii.mat3(m)[0] == [1, 0, 0]
    assert nvisii.determinant(nvisii.scale((2, 3, 4))) == pytest.approx(24)
    assert np.allclose(rows(nvisii.inverse(m) * m), np.eye(4))
    turned = nvisii.rotate(nvisii.mat4(1), 0.5, (0, 0, 1))
    assert np.allclose(rows(turned)[:2, :2], [[math.cos(0.5), -math.sin(0.5)],
                                              [math.sin(0.5), math.cos(0.5)]])  # fmt: skip
    assert nvisii.outerProduct((1, 2), (3, 4)) == nvisii.mat2((3, 6), (4, 8))


def test_cameras():
    view = nvisii.lookAt((0, 0, 5), (0, 0, 0), (0, 1, 0))
    assert view * nvisii.vec4(0, 0, 0, 1) == pytest.approx([0, 0, -5, 1])
    lens = nvisii.perspective(math.pi / 2, 2.0, 1.0, 10.0)
    corner = lens * nvisii.vec4(2, 1, -1, 1)
    assert corner / corner.w == pytest.approx([1, 1, -1, 1])
    far = lens * nvisii.vec4(0, 0, -10, 1)
    assert far.z / far.w == pytest.approx(1)
    port = (0, 0, 200, 100)
    window = nvisii.project((1, 0.5, 0), view, lens, port)
    assert nvisii.unProject(window, view, lens, port) == pytest.approx([1, 0.5, 0])
    corner = nvisii.ortho(-2, 2, -1, 1, 0, 4) * nvisii.vec4(2, 1, -4, 1)
    assert corner == pytest.approx([1, 1, 1, 1])


def test_functions_take_numbers_vectors_and_sequences():
    assert nvisii.sin(math.pi / 2) == 1 and nvisii.degrees(nvisii.pi()) == 180
    assert nvisii.clamp(nvisii.vec3(-1, 0.5, 9), 0, 1) == [0, 0.5, 1]
    assert nvisii.mix((0, 0), (2, 4), 0.5) == [1, 2]
    assert nvisii.max([1, 5], 3) == [3, 5] and nvisii.pow(2, 3) == 8
    assert nvisii.fract(-0.25) == 0.75 and nvisii.mod(-1, 3) == 2 and nvisii.round(-2.5) == -3
    assert nvisii.smoothstep(0, 1, 0.5) == 0.5 and nvisii.step(1, 0.5) == 0
    assert nvisii.isnan(nvisii.vec2(math.nan, 1)) == [True, False]
    assert nvisii.atan(1, -1) == pytest.approx(math.atan2(1, -1))
    assert nvisii.length((3, 4)) == 5 and nvisii.distance([1, 1], [4, 5]) == 5
    assert nvisii.dot((1, 2, 3), (4, 5, 6)) == 32
    assert nvisii.cross((1, 0, 0), (0, 1, 0)) == [0, 0, 1]
    assert nvisii.normalize([3, 0, 4]) == pytest.approx([0.6, 0, 0.8])
    assert nvisii.reflect((1, -1, 0), (0, 1, 0)) == [1, 1, 0]
    assert nvisii.refract((0, -1, 0), (0, 1, 0), 0.66) == pytest.approx([0, -1, 0])
    assert nvisii.refract((1, 0, 0), (0, 1, 0), 1.5) == [0, 0, 0]
    assert nvisii.closestPointOnLine((2, 5), (0, 0), (4, 0)) == [2, 0]
    assert nvisii.orientedAngle((1, 0), (0, 1)) == pytest.approx(math.pi / 2)
    with pytest.raises(RuntimeError, match="clamp"):
        nvisii.clamp(1)


def test_random_numbers_repeat_by_seed_and_stay_in_their_sets():
    np.random.seed(5)
    first = [nvisii.ballRand(2.0) for _ in range(200)]
    np.random.seed(5)
    assert [nvisii.ballRand(2.0) for _ in range(200)] == first
    lengths = [nvisii.length(v) for v in first]
    assert max(lengths) <= 2 and 1.3 < np.mean(lengths) < 1.7  # 3/4 of the radius
    assert nvisii.length(nvisii.sphericalRand(3.0)) == pytest.approx(3)
    low, high = np.array([list(nvisii.linearRand((0, 5), (1, 6))) for _ in range(99)]).T
    assert 0 <= low.min() and low.max() <= 1 and 5 <= high.min() and high.max() <= 6


def test_numpys_functions_take_vectors_as_arrays():
    v, points = nvisii.vec3(1, -2, 3), np.ones((3, 3))
    assert np.abs(v).tolist() == [1, 2, 3] and np.max(v) == 3
    assert np.degrees(nvisii.eulerAngles(nvisii.angleAxis(0.5, (0, 0, 1))))[2] == pytest.approx(
        math.degrees(0.5)
    )
    assert (points + v).tolist() == (v + points).tolist() == [[2, -1, 4]] * 3
    total = np.zeros(3)
    total += v
    assert total.tolist() == [1, -2, 3]
    assert np.isfinite(nvisii.mat4()).all() and np.minimum(v, 0).tolist() == [0, -2, 0]
    assert np.float64(2) * v == [2, -4, 6] and isinstance(np.float64(2) * v, nvisii.vec3)


def test_a_row_vector_times_a_matrix():
    m = nvisii.translate(nvisii.mat4(1), (1, 2, 3))
    assert nvisii.vec4(1, 1, 1, 1) * m == [1, 1, 1, 7]
