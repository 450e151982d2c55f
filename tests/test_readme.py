"""The README keeps its word: its code runs, its tables are the package's, its files exist."""

import re
from pathlib import Path

import pytest

import curvcasadi

ROOT = Path(__file__).parents[1]
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
    named = re.findall(r"`((?:ocp_examples|tests)/[\w./]+)`|\]\((docs/[\w.]+)\)", TEXT)
    assert named
    for path in (first or second for first, second in named):
        assert (ROOT / path).exists(), path


def test_named_tests_exist():
    row = None
    for line in table(TEXT, "| case | reference |").splitlines()[2:]:
        for file, name in re.findall(r"`(test_\w+\.py)?(?:::)?(test_\w+)?`", line.split("|")[-2]):
            row = file or row
            source = (ROOT / "tests" / row).read_text()
            assert not name or f"def {name}(" in source, (row, name)


def test_named_functions_are_public():
    for name in re.findall(r"`(?:cc\.)?(\w+)\(", table(TEXT, "| what | equation |")):
        if name not in ("tip", "Grid", "uniform"):
            assert hasattr(curvcasadi, name), name
