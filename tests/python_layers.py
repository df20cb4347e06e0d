"""The dependency rules of the Python packages: which package and which folder may import which, and
no import circles between modules, in one folder or several.

usage: python_layers.py ROOT; prints file:line of each breach. Run by ctest.

Imports under `if TYPE_CHECKING` are free: they are never executed. Those in functions are not.
"""

import ast
import itertools
import pathlib
import sys

# Package: its folder, and which of the others it may import.
PACKAGES: dict[str, tuple[str, tuple[str, ...]]] = {
    "heliograph": ("clients/python", ()),
    "nvisii": ("clients/nvisii", ("heliograph",)),
    "heliograph_replay": ("scripts", ("heliograph",)),
}
# Folders of heliograph: each may import itself and those before it.
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
Modules = dict[str, pathlib.Path]


def layer(module: str) -> str:
    """heliograph.scene.handles: scene."""
    return module.split(".")[1] if "." in module else "__init__"


def is_type_checking(test: ast.expr) -> bool:
    return ast.unparse(test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")


def executed(node: ast.AST) -> list[ast.stmt | ast.Call]:
    """Imports that run, at once or in a call; calls of import_module too."""
    found: list[ast.stmt | ast.Call] = []
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and is_type_checking(child.test):
            found += [i for branch in child.orelse for i in executed(ast.Module([branch], []))]
            continue
        if isinstance(child, (ast.Import, ast.ImportFrom)) or imported_by_call(child):
            found.append(child)
        found += executed(child)
    return found


def imported_by_call(node: ast.AST) -> str:
    """ "a.b" of import_module("a.b") and __import__("a.b"); "" of all else."""
    if not isinstance(node, ast.Call) or not node.args:
        return ""
    function, first = ast.unparse(node.func).rpartition(".")[2], node.args[0]
    if function not in ("import_module", "__import__") or not isinstance(first, ast.Constant):
        return ""
    return str(first.value)


def absolute(name: str, level: int, package: str) -> str:
    """`name` after `level` dots, in a package."""
    if not level:
        return name
    parts = package.split(".")
    return ".".join([*parts[: len(parts) - level + 1], *([name] if name else [])])


def names_of(node: ast.stmt | ast.Call, package: str, modules: Modules) -> list[str]:
    """Modules that an import names."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        base = absolute(node.module or "", node.level, package)
        full = [f"{base}.{alias.name}" for alias in node.names]
        return [name if name in modules else base for name in full]
    name = imported_by_call(node)
    return [absolute(name.lstrip("."), len(name) - len(name.lstrip(".")), package)]


def imports(module: str, modules: Modules) -> list[Import]:
    """(line, module of PACKAGES) for each import that runs."""
    file = modules[module]
    package = module if file.name == "__init__.py" else module.rpartition(".")[0]
    return [
        (node.lineno, name)
        for node in executed(ast.parse(file.read_text()))
        for name in names_of(node, package, modules)
        if name.split(".")[0] in PACKAGES
    ]


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


def refusal(module: str, other: str) -> str:
    """Why a module may not import another; "": it may."""
    package, theirs = module.split(".")[0], other.split(".")[0]
    if theirs != package:
        return "" if theirs in PACKAGES[package][1] else f"{package} may not import {other}"
    if package != "heliograph" or layer(module) == layer(other):
        return ""
    allowed = RANK.get(layer(other), len(RANK)) < RANK[layer(module)]
    return "" if allowed else f"{layer(module)} may not import {other}"


def find_modules(root: pathlib.Path) -> Modules:
    modules = {}
    for package, (folder, _) in PACKAGES.items():
        for file in sorted((root / folder / package).rglob("*.py")):
            name = ".".join(file.relative_to(root / folder).with_suffix("").parts)
            modules[name.removesuffix(".__init__")] = file
    return modules


def find_breaches(modules: Modules) -> list[tuple[pathlib.Path, int, str]]:
    found = []
    graph: dict[str, set[str]] = {module: set() for module in modules}
    for module, file in modules.items():
        if module.split(".")[0] == "heliograph" and layer(module) not in RANK:
            found.append((file, 1, f"no layer of python_layers.py: {layer(module)}"))
            continue
        for line, other in imports(module, modules):
            if reason := refusal(module, other):
                found.append((file, line, reason))
            elif other in modules and other != module:
                graph[module].add(other)
    for circle in circles(graph):
        found.append((modules[circle[0]], 1, f"a circle of imports: {', '.join(circle)}"))
    return found


def main(root: pathlib.Path) -> int:
    breaches = find_breaches(find_modules(root))
    for file, line, reason in breaches:
        print(f"{file.relative_to(root).as_posix()}:{line}: {reason}")
    return 1 if breaches else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1])))
