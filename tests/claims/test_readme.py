"""The README keeps its word: its code runs, its tables are the package's, its files exist."""

import re
import tomllib
from pathlib import Path

import pytest

import curvcasadi

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


def table(text, header):
    start = text.index(header)
    return text[start:].split("\n\n")[0]


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.splitlines()[-1][:30])
def test_code_blocks_run(block, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "README.md", "exec"), {})


def test_the_first_block_has_at_most_twelve_lines_of_code():
    assert len([line for line in BLOCKS[0].splitlines() if line]) <= 12


def test_the_conventions_table_is_that_of_the_package():
    header = "| what | convention |"
    assert table(TEXT, header) == table(curvcasadi.__doc__, header)


def test_named_files_exist():
    named = re.findall(r"`((?:ocp_examples|tests|codegen)/[\w./]+)`|\]\((docs/[\w.]+)\)", TEXT)
    assert named
    for path in (first or second for first, second in named):
        assert (ROOT / path).exists(), path


def test_named_tests_exist():
    row = None
    for line in table(TEXT, "| case | reference |").splitlines()[2:]:
        named = re.findall(r"`(\w+/test_\w+\.py)?(?:::)?(test_\w+)?`", line.split("|")[-2])
        for file, name in named:
            row = file or row
            source = (ROOT / "tests" / row).read_text()
            assert not name or f"def {name}(" in source, (row, name)


def test_named_functions_are_public():
    for name in re.findall(r"`(?:cc\.)?(\w+)\(", table(TEXT, "| what | equation |")):
        if name not in ("tip", "Grid", "uniform"):
            assert hasattr(curvcasadi, name), name


BUDGETED = (
    "midpoint_32.tip.cortex-m7",
    "midpoint_32.tip_jacobian.cortex-m7",
    "midpoint_64.tip_jacobian.cortex-m7",
    "bent_midpoint.tip.cortex-m7",
    "bent_magnus4.tip.cortex-m7",
    "target.shape_target.cortex-m4",
    "target.shape_target_step.cortex-m4",
    "target_met.shape_target_met.cortex-m4",
    "mpc.tip_path_step.cortex-m4",
    "mpc.tip_path.cortex-m4",
    "statics.equilibrium.cortex-m4",
    "ekf.ekf_step.cortex-m4",
)


def test_sizes_and_instructions_are_those_of_the_budgets():
    budgets = tomllib.loads((ROOT / "codegen" / "budgets.toml").read_text())["functions"]
    rows = table(TEXT, "| 32 midpoint elements,").splitlines()[2:]
    for row, name in zip(rows, BUDGETED, strict=True):
        budget = budgets[name]["budget"]
        cells = [cell.strip().replace(" ", "") for cell in row.split("|")[2:-1]]
        assert cells == [
            "M7" if name.endswith("m7") else "M4F",
            f"{budget['text'] / 1024:.1f}",
            *(str(budget[key]) for key in ("ram", "stack", "instructions")),
        ], name
