"""What functions on a target may take: measured numbers against those of budgets.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

FILE = Path(__file__).parent / "budgets.toml"
#: Parts of a budget by which a number may exceed it, and below which it is worth a word.
EXCESS, SHORTFALL = 0.03, 0.10
#: Quantities, in the order of tables; bytes but for the last. The text of the library is its code
#: and constants, the tables; what it uses of libm is counted apart.
QUANTITIES = ("text", "tables", "libm", "ram", "stack", "instructions")

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
        budget={key: entry["budget"] for key, entry in entries.items() if "budget" in entry},
        required={key: entry["required"] for key, entry in entries.items() if "required" in entry},
    )


def updated(budgets: Budgets, measured: Mapping[str, Numbers], compiler: str) -> Budgets:
    """`budgets` with the numbers of `measured`; what was not measured keeps its own."""
    return Budgets(
        compiler=compiler,
        budget={**budgets.budget, **measured},
        required=budgets.required,
    )


def text(budgets: Budgets) -> str:
    """The budget file."""
    lines = [f"{_HEAD}compiler = {_quoted(budgets.compiler)}"]
    for key in sorted({*budgets.budget, *budgets.required}):
        lines += ["", f"[functions.{_quoted(key)}]"]
        fields = {"budget": budgets.budget, "required": budgets.required}
        lines += [f"{name} = {_inline(of[key])}" for name, of in fields.items() if of.get(key)]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, kw_only=True)
class Relation:
    """On every CPU, a quantity of one function is at most `factor` × that of another + `more`."""

    quantity: str
    of: str  #: "library.function"
    to: str
    factor: float = 1.0
    more: int = 0

    def lines(self, measured: Mapping[str, Numbers]) -> list[tuple[str, bool]]:
        """What was found, and whether the relation holds, for every CPU that has both."""
        found = []
        for key in measured:
            cpu = key.rpartition(".")[2]
            other = f"{self.to}.{cpu}"
            if key != f"{self.of}.{cpu}" or other not in measured:
                continue
            ours, theirs = measured[key][self.quantity], measured[other][self.quantity]
            line = f"{key}: {ours} {self.quantity}, {ours / theirs:.2f} times {self.to}'s {theirs}"
            limit = f"at most {self.factor:.2f} times" + (f" + {self.more}" if self.more else "")
            found.append((f"{line} ({limit})", ours <= self.factor * theirs + self.more))
        return found


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
