"""The public names of nvisii and their arguments are those of the table nvisii_api.txt."""

import ast
import importlib
import inspect
import math
import operator
import pathlib
import re

import nvisii
import pytest

TABLE = pathlib.Path(__file__).parent / "nvisii_api.txt"
LINES = [line for line in TABLE.read_text().splitlines() if not line.startswith("#")]
CALLS = [line for line in LINES if "(" in line]
GLM = " ".join(line for line in LINES if "(" not in line).split()

THREE, TURN = (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0)
# Of arguments without a default that take numbers, or that the calls with such need.
WITHOUT_DEFAULT = {
    2: "width height depth count samples_per_pixel frame_count",
    0: "level node_idx start_frame bounce",
    1.0: "absorption angle aspect background clamp cx cy diameter distance exposure falloff "
    "field_of_view focal_length fx fy gradient_factor hue intensity saturation scattering "
    "sensor_height sensor_width value",
    5000.0: "kelvin",
    (0.5, 0.5): "uv",
    THREE: "additional_position additional_scale at axis color direction point position scale "
    "start stop sun_position up vector velocity",
    TURN: "additional_rotation rotation",
    (0.5,) * 16: "data",
    (0.5,) * 9: "positions",
    ((0, 0), (1, 0), (1, 1)): "vertices",
    ((0, 0, 0), (1, 0, 0)): "path",
    ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)): "transform",
    ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, -3, -1), (0, 0, -4, 0)): "projection",
    "new": "name",
    "depth": "options",
    "new.png": "file_path image_path",
    None: "texture a b tex",  # one is made
}
VALUES = {name: value for value, names in WITHOUT_DEFAULT.items() for name in names.split()}
SPECIAL = {
    ("texture.set_scale", "scale"): (1.0, 1.0),
    ("volume.create_from_data", "data"): (0.5,) * 8,
    ("volume.set_scale", "scale"): 1.0,
    ("transform.look_at", "eye"): THREE,
    ("transform.set_angular_velocity", "velocity"): TURN,
    ("mesh.create_from_data", "indices"): (0, 1, 2),
    ("mesh.create_from_data", "normals"): (0.5,) * 9,
    ("transform.create_from_matrix", "transform"): VALUES["transform"],
}
# Those whose numbers limit nothing, those that read a file first, and those without numbers.
FREE = re.compile(r"initialize|import_scene|entity\.|\w+\.create_from_(file|image|obj)")


def default(node):
    """A literal; nan by name."""
    if isinstance(node, ast.Tuple):
        return tuple(default(item) for item in node.elts)
    return math.nan if isinstance(node, ast.Name) else ast.literal_eval(node)


def same(a, b):
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return all(same(x, y) for x, y in zip(a, b, strict=True))
    return a == b or (a != a and b != b)


def parsed(line):
    """The name of a call, and its arguments: (name, default)."""
    call = ast.parse(line, mode="eval").body
    arguments = [(arg.id, inspect.Parameter.empty) for arg in call.args]
    arguments += [(keyword.arg, default(keyword.value)) for keyword in call.keywords]
    return ast.unparse(call.func), arguments


@pytest.mark.parametrize("line", CALLS)
def test_signature(line):
    name, wanted = parsed(line)
    found = operator.attrgetter(name)(nvisii)
    parameters = list(inspect.signature(found).parameters.values())
    if parameters and parameters[0].name == "self":
        del parameters[0]
    assert [p.name for p in parameters] == [name for name, _ in wanted]
    for parameter, (name, value) in zip(parameters, wanted, strict=True):
        assert same(parameter.default, value), name


def test_every_public_name_is_in_the_table():
    """Names that are not in the table are no part of the interface: they begin with "_"."""
    table = {line.partition("(")[0] for line in CALLS}
    for kind in ("entity", "transform", "mesh", "material", "texture", "light", "camera", "volume"):
        public = {f"{kind}.{name}" for name in dir(getattr(nvisii, kind)) if name[0] != "_"}
        assert public == {name for name in table if name.startswith(f"{kind}.")}
    functions = {name for name in table if "." not in name}
    kinds = {name.partition(".")[0] for name in table if "." in name} | {"scene"}
    assert set(nvisii.__all__) - functions - kinds - set(GLM) <= set(nvisii.glm.__all__)


@pytest.mark.parametrize("name", GLM)
def test_glm_has(name):
    assert callable(getattr(nvisii, name))


def test_the_rest():
    assert isinstance(nvisii.__version__, str)
    importers = importlib.import_module("nvisii.importers")

    assert [name for name in dir(importers) if not name.startswith("_")] == []


def values_of(line):
    """The name of a call, and good values of its arguments."""
    call, arguments = parsed(line)
    material = dict(parsed(next(v for v in CALLS if v.startswith("material.create(")))[1])
    known = {**material, **VALUES}
    values = {
        name: known.get(name, value) if value is inspect.Parameter.empty else value
        for name, value in arguments
    }
    values.update({name: value for (of, name), value in SPECIAL.items() if of == call})
    return call, values


def spoiled(value, bad):
    """With `bad` in place of its first number; None: it has none."""
    if isinstance(value, tuple) and value:
        return (spoiled(value[0], bad), *value[1:])
    return bad if type(value) in (int, float) else None


NUMBERS = [
    (line, name)
    for line in CALLS
    if not FREE.match(line)
    for name, value in values_of(line)[1].items()
    if spoiled(value, 0) is not None
]


@pytest.fixture
def empty():
    yield
    nvisii.clear_all()


def receiver(name):
    """A module, a class, or a component for its methods."""
    if name in ("", "mesh"):
        return getattr(nvisii, name, nvisii)
    if name == "texture":
        return nvisii.texture.create_from_data("old", 1, 1, [0, 0, 0, 1])
    if name == "volume":
        return nvisii.volume.create_from_data("old", 1, 1, 1, [1], 0)
    return getattr(nvisii, name).create("old")


@pytest.mark.parametrize(("line", "argument"), NUMBERS)
def test_nan_and_infinities_are_refused_where_they_are_given(empty, line, argument):
    call, values = values_of(line)
    kind, _, method = call.rpartition(".")
    found = getattr(receiver(kind), method)
    if None in values.values():
        image = nvisii.texture.get("old") or receiver("texture")
        values = {name: image if value is None else value for name, value in values.items()}
    for bad in (math.nan, math.inf, -math.inf):
        if (method, argument) == ("look_at", "eye") and bad != bad:
            continue  # the position stays
        with pytest.raises(RuntimeError, match=argument):
            found(**{**values, argument: spoiled(values[argument], bad)})
        assert kind == "" or getattr(nvisii, kind).get("new") is None
