"""The dependency rule of the Python client: which folder may import which, and no import circles.

usage: python_layers.py ROOT; prints file:line of each breach. Run by ctest.

Imports under `if TYPE_CHECKING` are free: they are never executed. Those in functions are not.
"""

import ast
import itertools
import pathlib
import sys

PACKAGE = "heliograph"
# Each may import itself and those before it.
LAYERS = (
    ("_version", "errors"),
    ("_optional",),
    ("_wire",),
    ("values",),
    ("scene",),
    ("image",),
    ("robots",),
    ("usd",),
    ("export",),
    ("render",),
    ("client",),
    ("__init__",),  # gives the names of all folders, those of later ones on demand only
    ("recording",),
    ("datasets",),
    ("torch",),
    ("cluster",),
    ("viewer",),
    ("cli",),
    ("aio",),
    ("__main__",),
)
RANK = {name: rank for rank, names in enumerate(LAYERS) for name in names}
Import = tuple[int, str]


def layer(module: str) -> str:
    """heliograph.scene.handles: scene."""
    return module.split(".")[1] if "." in module else "__init__"


def executed(node: ast.AST) -> list[ast.Import | ast.ImportFrom]:
    """Imports that run, at once or in a call."""
    found = []
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (ast.Import, ast.ImportFrom)):
            found.append(child)
        elif isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            found += [i for branch in child.orelse for i in executed(ast.Module([branch], []))]
        else:
            found += executed(child)
    return found


def imports(file: pathlib.Path, module: str, modules: dict[str, pathlib.Path]) -> list[Import]:
    """(line, module of the package) for each import that runs."""
    package = module if file.name == "__init__.py" else module.rpartition(".")[0]
    found = []
    for node in executed(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
            continue
        base = node.module or ""
        if node.level:
            parts = package.split(".")
            above = parts[: len(parts) - node.level + 1]
            base = ".".join([*above, *([base] if base else [])])
        for alias in node.names:
            full = f"{base}.{alias.name}"
            found.append((node.lineno, full if full in modules else base))
    return [(line, name) for line, name in found if name.split(".")[0] == PACKAGE]


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Strongly connected modules (Tarjan 1972), more than one each."""
    order: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []
    numbers = itertools.count()

    def visit(module: str) -> None:
        order[module] = low[module] = next(numbers)
        stack.append(module)
        for other in sorted(graph[module]):
            if other not in order:
                visit(other)
                low[module] = min(low[module], low[other])
            elif other in stack:
                low[module] = min(low[module], order[other])
        if low[module] == order[module]:
            start = stack.index(module)
            if len(stack) - start > 1:
                found.append(sorted(stack[start:]))
            del stack[start:]

    for module in graph:
        if module not in order:
            visit(module)
    return found


def main(root: pathlib.Path) -> int:
    base = root / "clients/python"
    modules = {}
    for file in sorted((base / PACKAGE).rglob("*.py")):
        name = ".".join(file.relative_to(base).with_suffix("").parts)
        modules[name.removesuffix(".__init__")] = file
    breaches = []
    graph: dict[str, set[str]] = {}
    for module, file in modules.items():
        graph[module] = set()
        mine, where = layer(module), file.relative_to(root).as_posix()
        if mine not in RANK:
            breaches.append(f"{where}:1: no layer of python_layers.py: {mine}")
            continue
        for line, other in imports(file, module, modules):
            theirs = layer(other)
            if theirs != mine and RANK.get(theirs, len(RANK)) >= RANK[mine]:
                breaches.append(f"{where}:{line}: {mine} may not import {other}")
            elif other in modules and other != module:
                graph[module].add(other)
    for circle in circles(graph):
        where = modules[circle[0]].relative_to(root).as_posix()
        breaches.append(f"{where}:1: a circle of imports: {', '.join(circle)}")
    print("".join(f"{breach}\n" for breach in breaches), end="")
    return 1 if breaches else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
