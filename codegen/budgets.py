"""What functions on a target may take: measured numbers against those of budgets.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

FILE = Path(__file__).parent / "budgets.toml"
#: Parts of a budget by which a number may exceed it, and below which it is worth a word.
EXCESS, SHORTFALL = 0.03, 0.10
#: Quantities, in the order of tables; bytes but for the last.
QUANTITIES = ("code", "tables", "libm", "ram", "stack", "instructions")

Numbers = Mapping[str, int]

_HEAD = """\
# Sizes (bytes) and instructions that functions may take on a Cortex-M. A number more than 3 % above
# its budget fails `make target-test`; `required` is a limit set beforehand, and no margin is added.
# Written by `python -m codegen.target --update`; sizes depend on the compiler.
"""


@dataclass(frozen=True, kw_only=True)
class Budgets:
    """Budgets and requirements by function and CPU, such as "midpoint_32.tip.cortex-m7"."""

    compiler: str
    budget: Mapping[str, Numbers]
    required: Mapping[str, Numbers]


def load(path: Path = FILE) -> Budgets:
    tables = tomllib.loads(path.read_text()) if path.exists() else {}
    entries = tables.get("functions", {})
    return Budgets(
        compiler=tables.get("compiler", ""),
        budget={key: entry.get("budget", {}) for key, entry in entries.items()},
        required={key: entry.get("required", {}) for key, entry in entries.items()},
    )


def text(budgets: Budgets) -> str:
    """The budget file."""
    lines = [f"{_HEAD}compiler = {_quoted(budgets.compiler)}"]
    for key, numbers in budgets.budget.items():
        lines += ["", f"[functions.{_quoted(key)}]", f"budget = {_inline(numbers)}"]
        if budgets.required.get(key):
            lines.append(f"required = {_inline(budgets.required[key])}")
    return "\n".join(lines) + "\n"


def failures(measured: Mapping[str, Numbers], budgets: Budgets) -> list[str]:
    """A line for every number above its requirement, or too far above its budget."""
    found = []
    for key, numbers in measured.items():
        if key not in budgets.budget:
            found.append(f"{key}: no budget; --update writes one")
        for quantity, number in numbers.items():
            limit = budgets.budget.get(key, {}).get(quantity)
            if limit is not None and number > limit * (1 + EXCESS):
                found.append(f"{key}: {number} {quantity}, budget {limit}")
            limit = budgets.required.get(key, {}).get(quantity)
            if limit is not None and number > limit:
                found.append(f"{key}: {number} {quantity}, required at most {limit}")
    return found


def savings(measured: Mapping[str, Numbers], budgets: Budgets) -> list[str]:
    """A line for every number far below its budget: --update would keep what was gained."""
    return [
        f"{key}: {number} {quantity}, budget {budgets.budget[key][quantity]}"
        for key, numbers in measured.items()
        for quantity, number in numbers.items()
        if number < budgets.budget.get(key, {}).get(quantity, 0) * (1 - SHORTFALL)
    ]


def _inline(numbers: Numbers) -> str:
    return "{ " + ", ".join(f"{name} = {number}" for name, number in numbers.items()) + " }"


def _quoted(value: str) -> str:
    return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
