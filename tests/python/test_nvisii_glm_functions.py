"""GLM's constants and functions in nvisii, name by name; they need no daemon."""

import math

import numpy as np
import nvisii
import pytest

CONSTANTS = {
    "e": math.e,
    "epsilon": 2**-23,
    "euler": 0.5772156649,
    "four_over_pi": 4 / math.pi,
    "golden_ratio": 1.6180339887,
    "half_pi": math.pi / 2,
    "ln_ln_two": -0.3665129206,
    "ln_ten": 2.3025850930,
    "ln_two": 0.6931471806,
    "one": 1,
    "one_over_pi": 1 / math.pi,
    "one_over_root_two": 0.7071067812,
    "one_over_two_pi": 0.5 / math.pi,
    "quarter_pi": math.pi / 4,
    "root_five": 2.2360679775,
    "root_half_pi": 1.2533141373,
    "root_ln_four": 1.1774100226,
    "root_pi": 1.7724538509,
    "root_three": 1.7320508076,
    "root_two": 1.4142135624,
    "root_two_pi": 2.5066282746,
    "third": 1 / 3,
    "three_over_two_pi": 1.5 * math.pi,
    "two_over_pi": 2 / math.pi,
    "two_over_root_pi": 1.1283791671,
    "two_pi": 2 * math.pi,
    "two_thirds": 2 / 3,
    "zero": 0,
}
FUNCTIONS = {
    "abs": (-2, 2),
    "acos": (0.5, math.pi / 3),
    "acosh": (2, math.acosh(2)),
    "asin": (0.5, math.pi / 6),
    "asinh": (2, math.asinh(2)),
    "atanh": (0.5, math.atanh(0.5)),
    "ceil": (1.2, 2),
    "cos": (math.pi, -1),
    "cosh": (1, math.cosh(1)),
    "exp": (1, math.e),
    "exp2": (3, 8),
    "floor": (-1.2, -2),
    "inversesqrt": (4, 0.5),
    "isinf": (math.inf, True),
    "log": (math.e, 1),
    "log2": (8, 3),
    "mirrorRepeat": (1.25, 0.75),
    "radians": (180, math.pi),
    "repeat": (1.25, 0.25),
    "roundEven": (2.5, 2),
    "sign": (-3, -1),
    "sinh": (1, math.sinh(1)),
    "sqrt": (9, 3),
    "tan": (math.pi / 4, 1),
    "tanh": (1, math.tanh(1)),
    "trunc": (-1.7, -1),
}


@pytest.mark.parametrize("name", CONSTANTS)
def test_constants(name):
    assert getattr(nvisii, name)() == pytest.approx(CONSTANTS[name], rel=1e-9)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_of_a_number_and_of_each_component(name):
    given, expected = FUNCTIONS[name]
    function = getattr(nvisii, name)
    assert function(given) == pytest.approx(expected)
    assert list(function(nvisii.vec2(given, given))) == pytest.approx([expected] * 2)


def test_functions_of_two_and_three():
    assert nvisii.min(2, 1) == 1 and nvisii.fma(2, 3, 4) == 10
    assert nvisii.ivec3(1, 2, 3) + 1 == [2, 3, 4] and nvisii.ivec4(1).w == 1
    assert nvisii.u16vec3(-1, 0, 1)[0] == 65535 and nvisii.u16vec4() == [0, 0, 0, 0]


def test_lengths_and_projections():
    v = (3, -4)
    assert nvisii.length2(v) == 25 and nvisii.distance2((1, 1), (4, 5)) == 25
    assert (nvisii.l1Norm(v), nvisii.l2Norm(v), nvisii.lMaxNorm(v)) == (7, 5, 4)
    assert nvisii.proj((2, 3), (5, 0)) == [2, 0] and nvisii.perp((2, 3), (5, 0)) == [0, 3]
    assert nvisii.faceforward((0, 1, 0), (0, 1, 0), (0, 1, 0)) == [0, -1, 0]
    assert nvisii.triangleNormal((0, 0, 0), (1, 0, 0), (0, 1, 0)) == [0, 0, 1]
    angles = nvisii.polar((0, 0, 2))
    assert nvisii.euclidean(angles) == pytest.approx([0, 0, 1])


def test_quaternions():
    q = nvisii.quat(nvisii.vec3(0.1, -0.2, 0.3))
    assert [nvisii.pitch(q), nvisii.yaw(q), nvisii.roll(q)] == pytest.approx([0.1, -0.2, 0.3])
    assert list(nvisii.conjugate(q) * q) == pytest.approx([0, 0, 0, 1])
    assert nvisii.mat3_cast(q) * nvisii.vec3(1, 2, 3) == pytest.approx(q * nvisii.vec3(1, 2, 3))
    half = nvisii.lerp(nvisii.quat(), q, 0.5)
    assert list(half) == pytest.approx([v / 2 for v in list(q)[:3]] + [(1 + q.w) / 2])
    v = nvisii.vec3(0, 1, 0)
    assert nvisii.rotateX(v, math.pi / 2) == pytest.approx([0, 0, 1])
    assert nvisii.rotateY(nvisii.vec3(0, 0, 1), math.pi / 2) == pytest.approx([1, 0, 0])
    assert nvisii.rotateZ(v, math.pi / 2) == pytest.approx([-1, 0, 0])
    assert nvisii.rotate((1, 0), math.pi / 2) == pytest.approx([0, 1])
    with pytest.raises(RuntimeError, match="axis"):
        nvisii.angleAxis(1, (0, 0, 0))


def test_matrices():
    m = nvisii.rotate(nvisii.translate((1, 2, 3)), 0.7, (1, 1, 0))
    assert np.allclose(np.array(nvisii.affineInverse(m) * m), np.eye(4))
    expected = nvisii.transpose(nvisii.inverse(m))
    assert np.allclose(np.array(nvisii.inverseTranspose(m)), np.array(expected))
    assert nvisii.matrixCompMult(nvisii.mat2(2), nvisii.mat2(3)) == nvisii.mat2(6)
    square = nvisii.orthonormalize(nvisii.mat3(2, 0, 0, 1, 3, 0, 0, 0, -1))
    assert np.allclose(np.array(square) @ np.array(square).T, np.eye(3))
    wide = nvisii.frustum(-1, 1, -1, 1, 1, 10)
    assert np.allclose(np.array(wide), np.array(nvisii.perspective(math.pi / 2, 1, 1, 10)))
    same = nvisii.perspectiveFov(1, 200, 100, 1, 10)
    assert np.allclose(np.array(same), np.array(nvisii.perspective(1, 2, 1, 10)))
    endless = nvisii.infinitePerspective(1, 2, 0.5) * nvisii.vec4(0, 0, -1e9, 1)
    assert endless.z / endless.w == pytest.approx(1)


def test_random_numbers_have_their_means():
    np.random.seed(1)
    normal = [nvisii.gaussRand(5.0, 2.0) for _ in range(2000)]
    assert abs(np.mean(normal) - 5) < 0.2 and abs(np.std(normal) - 2) < 0.15
    assert nvisii.length(nvisii.circularRand(2.0)) == pytest.approx(2)
    inside = [nvisii.length(nvisii.diskRand(3.0)) for _ in range(500)]
    assert max(inside) <= 3 and abs(np.mean(inside) - 2) < 0.15  # 2/3 of the radius
