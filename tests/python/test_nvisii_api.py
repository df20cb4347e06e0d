"""The public names of nvisii and their arguments are those of the table nvisii_api.txt."""

import ast
import importlib
import inspect
import math
import pathlib

import nvisii
import pytest

TABLE = pathlib.Path(__file__).parent / "nvisii_api.txt"
LINES = [line for line in TABLE.read_text().splitlines() if not line.startswith("#")]
CALLS = [line for line in LINES if "(" in line]
GLM = " ".join(line for line in LINES if "(" not in line).split()


def default(node):
    """A literal; nan by name."""
    if isinstance(node, ast.Tuple):
        return tuple(default(item) for item in node.elts)
    return math.nan if isinstance(node, ast.Name) else ast.literal_eval(node)


def same(a, b):
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return all(same(x, y) for x, y in zip(a, b, strict=True))
    return a == b or (a != a and b != b)


@pytest.mark.parametrize("line", CALLS)
def test_signature(line):
    call = ast.parse(line, mode="eval").body
    names = ast.unparse(call.func).split(".")
    found = nvisii
    for name in names:
        found = getattr(found, name)
    parameters = list(inspect.signature(found).parameters.values())
    if parameters and parameters[0].name == "self":
        del parameters[0]
    wanted = [(arg.id, inspect.Parameter.empty) for arg in call.args]
    wanted += [(keyword.arg, default(keyword.value)) for keyword in call.keywords]
    assert [p.name for p in parameters] == [name for name, _ in wanted]
    for parameter, (name, value) in zip(parameters, wanted, strict=True):
        assert same(parameter.default, value), name


def test_every_public_name_is_in_the_table():
    """What is there and not in the table is no part of the interface: it begins with "_"."""
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
