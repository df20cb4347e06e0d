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
# Names of arguments: functions of numbers that have them.
NAMES = {
    "x": "abs acos acosh asin asinh atanh ceil floor fract isinf isnan round roundEven sign trunc",
    "angle": "cos cosh sin sinh tan tanh",
    "v": "exp exp2 inversesqrt log log2 sqrt",
    "Texcoord": "mirrorRepeat repeat",
    "degrees": "radians",
    "radians": "degrees",
    "y_over_x": "atan",
    "y x": "atan",
    "x y": "max min mod",
    "base exponent": "pow",
    "edge x": "step",
    "a b c": "fma",
    "x y a": "mix",
    "x minVal maxVal": "clamp",
    "edge0 edge1 x": "smoothstep",
}
BY_NAME = [(name, names.split()) for names, them in NAMES.items() for name in them.split()]
Z, QUARTER = (0, 0, 1), nvisii.angleAxis(math.pi / 2, (0, 0, 1))


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


def test_every_function_of_numbers_is_named():
    assert {name for name, _ in BY_NAME} == {*nvisii.glm.elementwise.ELEMENTWISE, "mix"}


@pytest.mark.parametrize(("name", "names"), BY_NAME)
def test_numbers_by_name(name, names):
    function, values = getattr(nvisii, name), [0.25, 0.5, 0.75][: len(names)]
    named = dict(reversed(list(zip(names, values, strict=True))))
    np.testing.assert_equal(function(**named), function(*values))


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("translate", {"v": (1, 2, 3)}),
        ("translate", {"m": nvisii.mat4(2), "v": (1, 2, 3)}),
        ("scale", {"v": (1, 2, 3)}),
        ("scale", {"m": nvisii.mat4(2), "v": (1, 2, 3)}),
        ("rotate", {"angle": 1, "axis": Z}),
        ("rotate", {"m": nvisii.mat4(2), "angle": 1, "axis": Z}),
        ("rotate", {"q": QUARTER, "angle": 1, "axis": Z}),
        ("rotate", {"q": QUARTER, "v": nvisii.vec3(1, 2, 3)}),
        ("rotate", {"v": (1, 2), "angle": 1}),
        ("rotate", {"v": (1, 2, 3), "angle": 1, "normal": Z}),
    ],
)
def test_overloads_by_name(name, named):
    function, values = getattr(nvisii, name), list(named.values())
    assert function(**dict(reversed(named.items()))) == function(*values)
    rest = dict(list(named.items())[1:])
    assert function(values[0], **rest) == function(*values)


@pytest.mark.parametrize(
    "call",
    [
        lambda: nvisii.radians(angle=1),
        lambda: nvisii.radians(1, degrees=1),
        lambda: nvisii.clamp(x=1, minVal=0),
        lambda: nvisii.translate(m=nvisii.mat4()),
    ],
)
def test_names_that_do_not_fit(call):
    with pytest.raises(TypeError, match=r"takes \("):
        call()


@pytest.mark.parametrize(
    "call",
    [
        lambda: nvisii.inverse(nvisii.mat3(0)),
        lambda: nvisii.inverse(nvisii.quat(0, 0, 0, 0)),
        lambda: nvisii.affineInverse(nvisii.mat4(0)),
        lambda: nvisii.inverseTranspose(nvisii.mat4(0)),
        lambda: nvisii.unProject((0, 0, 0), nvisii.mat4(0), nvisii.mat4(), (0, 0, 1, 1)),
        lambda: nvisii.unProject((0, 0, 0), nvisii.mat4(), nvisii.mat4(), (0, 0, 0, 0)),
        lambda: nvisii.ortho(0, 0, 0, 1),
        lambda: nvisii.perspective(1, 0, 1, 2),
        lambda: nvisii.proj((1, 0), (0, 0)),
        lambda: nvisii.dot((1, 0), (1, 0, 0)),
        lambda: nvisii.row(nvisii.mat4(), 4),
        lambda: nvisii.determinant(1.0),
        lambda: nvisii.rotate((1, 0), math.inf),
        lambda: nvisii.angleAxis(math.inf, Z),
        lambda: nvisii.ivec2(math.nan, 1),
        lambda: nvisii.ivec2(math.inf, 1),
    ],
)
def test_what_has_no_result_is_a_runtime_error(call):
    with pytest.raises(RuntimeError):
        call()
