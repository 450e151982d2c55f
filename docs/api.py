"""The API reference: a page for each subject, that is, for each folder of the package."""

from __future__ import annotations

import importlib
import inspect
from types import ModuleType
from typing import Any

#: Titles of the subjects in the order of the reference; a folder that is not here comes last.
TITLES = {
    "beam": "Beams, bases and grids",
    "kinematics": "Shapes, poses and Jacobians",
    "loads": "Loads",
    "statics": "Stiffness and equilibrium",
    "aero": "Strip aerodynamics",
    "dynamics": "Equations of motion",
    "aircraft": "Aircraft and trim",
    "control": "Models for control",
    "ocp": "Shape targets and predictive control",
    "sensors": "Sensors",
    "estimation": "Shape estimation",
    "export": "C code",
    "files": "Files",
    "plotting": "Figures",
    "symbolic": "Named Functions and layouts",
    "errors": "Errors",
}
#: Modules whose names are public by their own path.
MODULES = {
    "curvcasadi.reference_wings": "Reference wings",
    "curvcasadi.lie.so3": "Rotations",
    "curvcasadi.lie.se3": "Poses and strains",
    "curvcasadi.lie.series": "Coefficient functions",
}


def pages(package: ModuleType) -> dict[str, str]:
    """Pages of the reference by their path; every name of `package.__all__` is on one of them."""
    made = {}
    for subject, names in subjects(package).items():
        title = TITLES.get(subject, subject.replace("_", " ").capitalize())
        made[f"api/{subject}.rst"] = _page(title, package.__name__, names)
    for module, title in MODULES.items():
        names = _public(importlib.import_module(module))
        made[f"api/{module}.rst"] = _page(title, module, names)
    entries = "\n".join(f"   {path.removeprefix('api/').removesuffix('.rst')}" for path in made)
    made["api/index.rst"] = INDEX.format(entries=entries)
    return made


def subjects(package: ModuleType) -> dict[str, list[str]]:
    """Public names by the folder in which they are defined."""
    grouped: dict[str, list[str]] = {subject: [] for subject in TITLES}
    for name in package.__all__:
        module = _home(getattr(package, name))
        grouped.setdefault(module.split(".")[1], []).append(name)
    return {subject: sorted(names, key=str.lower) for subject, names in grouped.items() if names}


def _home(entry: Any) -> str:
    return str(entry.__module__)


def _public(module: ModuleType) -> list[str]:
    if hasattr(module, "__all__"):
        return list(module.__all__)
    return [
        name
        for name, entry in vars(module).items()
        if inspect.isfunction(entry)
        and not name.startswith("_")
        and entry.__module__ == module.__name__
    ]


INDEX = """\
API reference
=============

Names are those of the package, ``import curvcasadi as cc``, unless the page says otherwise. A type
"SX, MX, DM or array" means that numbers give numbers and symbols give expressions of their kind.

.. toctree::
   :maxdepth: 1

{entries}
"""


def _page(title: str, module: str, names: list[str]) -> str:
    lines = [title, "=" * len(title), "", f".. currentmodule:: {module}", ""]
    lines += [".. autosummary::", "", *(f"   {name}" for name in names), ""]
    home = importlib.import_module(module)
    for name in names:
        entry = getattr(home, name)
        if inspect.isclass(entry):
            members = "" if issubclass(entry, Exception) else "   :members:"
            lines += [f".. autoclass:: {name}", *([members] if members else []), ""]
        else:
            lines += [f".. autofunction:: {name}", ""]
    return "\n".join(lines)
