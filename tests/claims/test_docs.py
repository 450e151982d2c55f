"""README and pages keep their word: code runs, tables agree with the package, files exist."""

import ast
import importlib
import re
import tomllib
from pathlib import Path

import pytest

import curvcasadi
from docs import api, formats, pages

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = {path.stem: path for path in (ROOT / "README.md", *sorted(DOCS.glob("*.md")))}
TEXTS = {name: path.read_text(encoding="utf-8") for name, path in PAGES.items()}
README = TEXTS["README"]


def table(text, header):
    return text[text.index(header) :].split("\n\n")[0].rstrip("\n")


@pytest.mark.parametrize("name", [name for name in PAGES if pages.blocks(TEXTS[name])])
def test_code_blocks_run(name, tmp_path):
    for result in pages.run(TEXTS[name], str(PAGES[name]), tmp_path):
        assert "Traceback" not in result.output


def test_blocks_that_fail_are_noticed(tmp_path):
    wrong = {
        "python": "assert False",
        "shell": "curvcasadi shape missing.toml",
        "toml": "length = ",
        "c": "int f(void) { return undeclared; }",
    }
    for language, code in wrong.items():
        with pytest.raises((AssertionError, RuntimeError, tomllib.TOMLDecodeError)):
            list(pages.run(f"```{language}\n{code}\n```\n", "page", tmp_path))


def test_the_readme_is_short():
    lines = README.splitlines()
    assert len(lines) <= 120
    assert max(map(len, lines)) <= 100


def test_the_first_block_has_at_most_twelve_lines_of_code():
    assert len([line for line in pages.blocks(README)[0].text.splitlines() if line]) <= 12


def test_the_readme_names_every_example():
    for path in (ROOT / "ocp_examples").glob("*.py"):
        assert f"`{path.name}`" in README


def test_every_page_is_in_the_table_of_contents_and_in_the_readme():
    contents = re.findall(r"^\w+$", TEXTS["index"], re.MULTILINE)
    for name in PAGES.keys() - {"README", "index"}:
        assert name in contents, name
        assert f"(docs/{name}.md)" in README, name


def test_the_conventions_table_is_that_of_the_package():
    header = "| what | convention |"
    assert table(TEXTS["conventions"], header) == table(curvcasadi.__doc__, header)


@pytest.mark.parametrize("name", PAGES)
def test_named_files_exist(name):
    text = TEXTS[name]
    for path in re.findall(r"`((?:ocp_examples|tests|codegen|docs)/[\w./]+)`", text):
        assert (ROOT / path).exists(), path
    for path in re.findall(r"\]\(([\w./]+\.(?:md|svg|png))\)", text):
        assert (PAGES[name].parent / path).exists(), path


def test_named_tests_exist():
    file, seen = "", 0
    for named, test in re.findall(
        r"`(\w+/test_\w+\.py)?(?:::)?(test_\w+)?`", TEXTS["verification"]
    ):
        file, seen = named or file, seen + bool(named or test)
        source = (ROOT / "tests" / file).read_text()
        assert not test or f"def {test}(" in source, (file, test)
    assert seen > 30


def keys_read():
    """(module, name of the description) of every `table.read(…)` of the modules that read files."""
    for path in (ROOT / "curvcasadi" / "files").glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if (
                isinstance(node, ast.Call)
                and getattr(node.func, "attr", "") == "read"
                and node.args
            ):
                names = [n.id for n in ast.walk(node.args[0]) if isinstance(n, ast.Name)]
                yield path.stem, [name for name in names if name.isupper()], ast.unparse(node)


def test_every_key_that_is_read_is_documented():
    page, documented = formats.page(), set()
    for name in (name for names in formats.MODULES.values() for name in names):
        module = importlib.import_module(f"curvcasadi.files.{name}")
        for keys in formats.tables_of(module):
            documented.add(id(keys))
            assert formats.table(keys) in page
            for name_of_key, key in keys.all.items():
                assert f"| `{name_of_key}` |" in formats.table(keys), (keys.place, name_of_key)
                assert key.meaning, (keys.place, name_of_key)
    read = list(keys_read())
    assert len(read) > 20
    for name, constants, call in read:
        if call in ("table.read(keys)", "table.read(keys.with_kinds(kinds))"):
            continue  # of LOADS, SECTION and SECTION_BY_MATRIX, which the module documents
        assert constants, call  # no key is read that is not in a description
        module = importlib.import_module(f"curvcasadi.files.{name}")
        for constant in constants:
            value = getattr(module, constant)
            for keys in value.values() if isinstance(value, dict) else [value]:
                assert id(keys) in documented, (name, constant)


def test_every_public_name_is_in_the_reference():
    named = [name for names in api.subjects(curvcasadi).values() for name in names]
    assert sorted(named) == sorted(curvcasadi.__all__)


def test_named_functions_are_public():
    for name in re.findall(r"`(?:cc\.)?(\w+)\(", table(TEXTS["theory"], "| what | equation |")):
        assert hasattr(curvcasadi, name), name


def test_the_version_is_in_the_changelog():
    assert f"## {curvcasadi.__version__}" in TEXTS["changelog"]


#: Rows of the table of sizes, by their names in codegen/budgets.toml.
BUDGETED = (
    "midpoint_32.tip.cortex-m7",
    "midpoint_32.tip_jacobian.cortex-m7",
    "midpoint_64.tip_jacobian.cortex-m7",
    "bent_midpoint.tip.cortex-m7",
    "bent_magnus4.tip.cortex-m7",
    "bent_jacobian.tip_jacobian.cortex-m4",
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
    rows = table(TEXTS["c"], "| 32 midpoint elements,").splitlines()[2:]
    for row, name in zip(rows, BUDGETED, strict=True):
        budget = budgets[name]["budget"]
        cells = [cell.strip().replace(" ", "") for cell in row.split("|")[2:-1]]
        assert cells == [
            "M7" if name.endswith("m7") else "M4F",
            f"{budget['text'] / 1024:.1f}",
            *(str(budget[key]) for key in ("ram", "stack", "instructions")),
        ], name
