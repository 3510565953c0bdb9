"""Imports point one way: each folder builds on those before it, and on no other."""

import ast
import graphlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

import hystjax

PACKAGE = Path(__file__).parents[1] / "hystjax"
MODULES = sorted(PACKAGE.rglob("*.py"))

# Folders, and the files beside them, from what everything stands on to what nothing
# does.
ORDER = [
    "_core",
    "least_squares",
    "signals",
    "recording",
    "saving",
    "library",
    "models",
    "simulation",
    "loops",
    "regression",
    "refinement",
    "inversion",
    "compensation",
    "discovery",
    "comparison",
    "sweeping",
    "export",
    "plot",
    "report",
    "reproduce",
    "cli",
    "__main__",
]


def parts(path):
    """A module as the names of its folders and its own; a folder's face has none."""
    names = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return names[:-1] if names[-1] == "__init__" else names


NAMES = {".".join(parts(path)): path for path in MODULES}


def imported(path):
    """Absolute names of everything a module imports, inside its functions too."""
    here = path.relative_to(PACKAGE.parent).with_suffix("").parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = here[: -node.level] if node.level else ()
            base = [*start, *([node.module] if node.module else [])]
            yield from (".".join([*base, alias.name]) for alias in node.names)


def modules_imported(path):
    """Those of the package that a module imports, or imports something from."""
    for name in imported(path):
        module = name if name in NAMES else name.rpartition(".")[0]
        if module.startswith("hystjax."):
            yield module


def test_every_folder_has_its_place():
    assert {parts(path)[1] for path in MODULES if len(parts(path)) > 1} == set(ORDER)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: ".".join(parts(path)))
def test_imports_point_one_way(path):
    if path == PACKAGE / "__init__.py":
        return
    assert "hystjax" not in imported(path), "import the modules, not the whole package"
    place = ORDER.index(parts(path)[1])
    above = [m for m in modules_imported(path) if ORDER.index(m.split(".")[1]) > place]
    assert not above, f"{parts(path)[1]} imports {above}, which stand above it"


def test_no_file_imports_itself_by_way_of_others():
    graph = {name: set(modules_imported(path)) for name, path in NAMES.items()}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" <- ".join(error.args[1]), pytrace=False)


def calls(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [ast.unparse(n.func) for n in ast.walk(tree) if isinstance(n, ast.Call)]


def test_only_the_command_line_configures_jax():
    callers = {parts(p)[1] for p in MODULES if "jax.config.update" in calls(p)}
    callers |= {parts(p)[1] for p in MODULES if "config.update" in calls(p)}
    assert callers <= {"cli"}


def test_names_that_are_imported_later_are_those_that_tools_are_told_of():
    """Type checkers and the reference read imports that never run."""
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    (told,) = (n.body for n in tree.body if isinstance(n, ast.If))
    folders, *named = told
    assert {alias.name for alias in folders.names} == set(hystjax._LATER)
    names = {each.module: {alias.name for alias in each.names} for each in named}
    assert names == {k: set(v) for k, v in hystjax._LATER.items() if v}
    for name in {*hystjax._LATER, *hystjax._HOMES}:
        assert getattr(hystjax, name) is not None


def test_importing_hystjax_imports_neither_matplotlib_nor_sympy():
    slow = {"matplotlib", "sympy", "pandas", "sklearn", "xarray", "interpax", "tqdm"}
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
