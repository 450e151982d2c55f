"""The layers of the package, read from its imports, and rules that hold in all of it."""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import curvcasadi

PACKAGE = Path(curvcasadi.__file__).parent

#: A module imports from lower lines, or from the left on its own line. A package counts as one
#: module. Names for which there is no module yet are places kept for it.
LAYERS = """
    symbolic errors
    lie
    beam
    kinematics solvers
    loads
    aero statics dynamics
    sensors aircraft
    reference_wings
    control ocp
    estimation
    plotting files export
    cli
"""
ORDER = {
    name: (level, place)
    for level, line in enumerate(LAYERS.split("\n"))
    for place, name in enumerate(line.split())
}
#: The rim: nothing below imports it.
RIM = {"plotting", "files", "export", "cli"}
#: May import everything: the command line, and what makes the public names.
EXEMPT = {"__init__", "__main__"}

#: Where branches may stand. That of estimation takes zero for a missing sample, which is NaN; it
#: guards no singularity, and is never differentiated.
BRANCHED = {"lie/so3.py", "kinematics/element.py", "aero/section.py", "estimation/ud.py"}
BRANCHED |= {"aero/airload.py", "aero/line_functions.py"}  # no direction in still air
BRANCHED |= {"aero/gust.py"}  # gusts begin and end
BRANCHED |= {"sensors/station.py"}  # the same for the slopes of a missing attitude
BRANCHED |= {"control/iteration.py"}  # whether another iteration is needed
BRANCHED |= {"solvers/gauss_newton.py"}  # whether a step is accepted, and whether another is needed
BRANCHED |= {"estimation/samples.py"}  # the same for windows of samples

FILES = sorted(PACKAGE.rglob("*.py"))
TREES = {path: ast.parse(path.read_text()) for path in FILES}


def module_of(path):
    """The top-level module or package that a file belongs to."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports_of(tree):
    """Full names of all imported modules, with the names taken from them."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def own_imports(tree):
    """Top-level modules of the package that a file imports; "" for the package itself."""
    found = set()
    for name in imports_of(tree):
        first, *rest = name.split(".")
        if first == "curvcasadi":
            found.add(rest[0] if rest and rest[0] in MODULES else "")
    return found


MODULES = {module_of(path) for path in FILES} - {"__init__"}


def test_every_module_has_a_place_in_the_order():
    assert MODULES - EXEMPT <= set(ORDER)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_modules_import_from_lower_layers(path):
    module = module_of(path)
    if module in EXEMPT:
        return
    for imported in own_imports(TREES[path]) - {module}:
        assert imported, f"{module} imports the package itself, not a module of it"
        assert imported not in EXEMPT, f"{module} imports {imported}"
        assert imported not in RIM or module in RIM, f"{module} imports {imported}, of the rim"
        assert ORDER[imported] < ORDER[module], f"{module} imports {imported}"


@pytest.mark.parametrize(
    "folder", sorted({path.parent for path in FILES} - {PACKAGE}), ids=lambda path: path.name
)
def test_imports_inside_a_folder_form_no_circle(folder):
    names = {".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): path
             for path in FILES if folder in path.parents and path.stem != "__init__"}  # fmt: skip
    graph = {
        name: {n for found in imports_of(TREES[path]) for n in (found, found.rpartition(".")[0])}
        & set(names)
        for name, path in names.items()
    }
    list(TopologicalSorter(graph).static_order())  # raises CycleError, which names the circle


def test_layers_are_seen_by_the_reader_of_imports():
    assert {"kinematics", "beam", "symbolic", "lie"} <= own_imports(
        TREES[PACKAGE / "kinematics" / "jacobian.py"]
    )


def test_matplotlib_is_imported_where_plots_are_drawn():
    users = {
        module_of(path)
        for path, tree in TREES.items()
        if any(name.split(".")[0] == "matplotlib" for name in imports_of(tree))
    }
    assert users <= {"plotting"}


def test_importing_the_package_does_not_import_matplotlib():
    code = "import sys, curvcasadi; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_nothing_is_kept_from_zero_by_adding_a_small_number(path):
    for node in ast.walk(TREES[path]):
        if not (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub)):
            continue
        for side in (node.left, node.right):
            name = getattr(side, "id", getattr(side, "attr", ""))
            assert name.lower() not in ("eps", "epsilon", "tiny"), f"line {node.lineno}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_branches_stay_in_the_guarded_places(path):
    if path.relative_to(PACKAGE).as_posix() in BRANCHED:
        return
    for node in ast.walk(TREES[path]):
        name = getattr(node, "id", getattr(node, "attr", ""))
        assert name not in ("if_else", "conditional", "if_else_zero"), f"line {node.lineno}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_dataclasses_are_frozen(path):
    for node in ast.walk(TREES[path]):
        if not isinstance(node, ast.ClassDef):
            continue
        for decorator in node.decorator_list:
            called = isinstance(decorator, ast.Call)
            name = decorator.func if called else decorator
            if getattr(name, "id", getattr(name, "attr", "")) != "dataclass":
                continue
            options = (
                {k.arg: ast.literal_eval(k.value) for k in decorator.keywords} if called else {}
            )
            assert options.get("frozen") is True, f"class {node.name}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_user_errors_are_not_assertions(path):
    assert not [node.lineno for node in ast.walk(TREES[path]) if isinstance(node, ast.Assert)]


def test_public_names_exist_once():
    assert len(set(curvcasadi.__all__)) == len(curvcasadi.__all__)
    for name in curvcasadi.__all__:
        assert getattr(curvcasadi, name).__doc__
