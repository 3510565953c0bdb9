"""Imports point one way: nouns <- verbs <- report, plot <- cli."""

import ast
import graphlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "hystjax"
MODULES = sorted(PACKAGE.rglob("*.py"))

# Folders are nouns and private files are verbs, but for these.
LAYERS = {"nouns": 0, "verbs": 1, "reports": 2, "cli": 3}
NOUN_FILES = {"_checks", "_errors", "_files", "_progress", "_recording", "_regressors"}
NOUN_FILES |= {"_factor_long", "_jit", "_long_recording", "_solution", "metrics"}
REPORTS = {"export", "plot", "report", "reproduce"}


def layer(unit):
    """The layer of a file or folder at the top of the package."""
    if unit == "cli":
        return LAYERS["cli"]
    if unit in REPORTS:
        return LAYERS["reports"]
    is_noun = unit in NOUN_FILES or (PACKAGE / unit).is_dir()
    return LAYERS["nouns" if is_noun else "verbs"]


def parts(path):
    return path.relative_to(PACKAGE.parent).with_suffix("").parts


def imported(path):
    """Absolute names of everything a module imports, inside its functions too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = parts(path)[: -node.level] if node.level else ()
            base = [*start, *([node.module] if node.module else [])]
            yield from (".".join([*base, alias.name]) for alias in node.names)


def units_imported(path):
    """Files and folders at the top of the package that a module imports."""
    for name in imported(path):
        package, *rest = name.split(".")
        if package == "hystjax" and rest and rest[0] != "__version__":
            yield rest[0]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: ".".join(parts(path)))
def test_imports_point_one_way(path):
    unit = parts(path)[1]
    if unit == "__init__":
        return
    assert "hystjax" not in imported(path), "import the modules, not the whole package"
    above = [name for name in units_imported(path) if layer(name) > layer(unit)]
    assert not above, f"{unit} imports {above}, which are built on top of it"


def test_imports_have_no_cycles():
    graph = {}
    for path in MODULES:
        unit = parts(path)[1]
        if unit != "__init__":
            graph.setdefault(unit, set()).update(set(units_imported(path)) - {unit})
    order = list(graphlib.TopologicalSorter(graph).static_order())
    assert order.index("_errors") < order.index("_recording") < order.index("cli")


def calls(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [ast.unparse(n.func) for n in ast.walk(tree) if isinstance(n, ast.Call)]


def test_only_the_command_line_configures_jax():
    callers = {parts(p)[1] for p in MODULES if "jax.config.update" in calls(p)}
    callers |= {parts(p)[1] for p in MODULES if "config.update" in calls(p)}
    assert callers <= {"cli"}


def test_importing_hystjax_imports_neither_matplotlib_nor_sympy():
    slow = {"matplotlib", "sympy", "pandas", "sklearn", "xarray"}
    code = f"import sys, hystjax; print(*sorted({slow} & set(sys.modules)))"
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE.parent)}
    run = subprocess.run(
        [sys.executable, "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.split() == []
