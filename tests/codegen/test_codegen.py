"""What applies the export to targets, as far as it goes without their compiler."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import curvcasadi as cc
from codegen import benchmark_functions as functions, budgets, map_file, toolchain
from codegen.loop import run as loop

ROOT = Path(__file__).parents[2]

MAP = """\
Discarded input sections

 .text.curv_stations
                0x00000000       0x40 out/curv.o

Memory Configuration

Linker script and memory map

 .text          0x00000040        0x8 out/startup.o
 .text.curv_tip
                0x00000048       0x54 out/curv.o
 .text.casadi_f1
                0x0000009c      0x100 out/curv_functions.o
 *fill*         0x0000019c        0x4
 .rodata.casadi_s0
                0x000001a0       0x18 out/curv_functions.o
 .text.__kernel_sinf
                0x000001b8       0x58 /usr/lib/arm/libm.a(libm_a-kf_sin.o)
 .bss.buffers.0
                0x20000000      0x120 out/curv.o
 .data.none     0x20000120        0x0 out/curv.o
 .comment       0x00000000       0x33 out/curv.o
"""


def test_the_map_file_says_what_the_linker_kept_of_an_object():
    sizes = map_file.sizes(MAP, ["curv.o", "curv_functions.o"])
    assert (sizes["code"], sizes["tables"], sizes["ram"]) == (0x154, 0x18, 0x120)
    assert map_file.sizes(MAP, ["libm.a"])["code"] == 0x58


def test_text_without_a_memory_map_is_refused():
    with pytest.raises(ValueError, match="expected a map file of GNU ld"):
        map_file.sizes("Discarded input sections", ["curv.o"])


BUDGETS = budgets.Budgets(
    compiler="arm gcc 12",
    budget={"a.tip.cortex-m7": {"text": 1000, "instructions": 500}},
    required={"a.tip.cortex-m7": {"instructions": 510}},
)


@pytest.mark.parametrize(
    ("numbers", "failing"),
    [
        ({"text": 1030, "instructions": 510}, []),
        ({"text": 1031, "instructions": 500}, ["1031 text, budget 1000"]),
        ({"text": 1000, "instructions": 511}, ["511 instructions, required at most 510"]),
    ],
)
def test_three_percent_above_a_budget_fails_and_a_requirement_has_no_margin(numbers, failing):
    found = budgets.failures({"a.tip.cortex-m7": numbers}, BUDGETS)
    assert found == [f"a.tip.cortex-m7: {line}" for line in failing]


def test_a_function_without_a_budget_fails():
    assert "no budget" in budgets.failures({"a.new.cortex-m7": {"text": 1}}, BUDGETS)[0]


def test_a_number_ten_percent_below_its_budget_is_mentioned():
    key = "a.tip.cortex-m7"
    assert budgets.savings({key: {"text": 900}}, BUDGETS) == []
    assert budgets.savings({key: {"text": 899}}, BUDGETS) == [f"{key}: 899 text, budget 1000"]


def test_the_budget_file_is_read_as_it_was_written(tmp_path):
    file = tmp_path / "budgets.toml"
    more = budgets.updated(BUDGETS, {"a.tip.cortex-m4": {"text": 7}}, 'gcc "13"')
    file.write_text(budgets.text(more))
    assert budgets.load(file) == more
    assert more.budget["a.tip.cortex-m7"] == BUDGETS.budget["a.tip.cortex-m7"]


def test_relations_hold_on_every_cpu_by_itself():
    relation = budgets.Relation(quantity="text", of="a.x", to="a.y", factor=2.0, more=1)
    measured = {
        "a.x.cortex-m4": {"text": 21},
        "a.y.cortex-m4": {"text": 10},
        "a.x.cortex-m7": {"text": 22},
        "a.y.cortex-m7": {"text": 10},
    }
    assert [holds for _, holds in relation.lines(measured)] == [True, False]


def test_every_budget_is_that_of_a_library_and_a_cpu():
    loaded = budgets.load()
    known = {(library.name, cpu) for library in functions.LIBRARIES for cpu in library.cpus}
    known |= {("gust_loop", cpu) for cpu, _ in loop.TARGETS}
    assert {(k.split(".")[0], k.split(".")[2]) for k in loaded.budget} == known
    assert set(loaded.required) <= set(loaded.budget)


@pytest.mark.parametrize(
    "name", ["__aeabi_dadd", "__aeabi_f2d", "__aeabi_cdcmple", "sqrt", "atan2"]
)
def test_functions_of_double_are_known_by_name(name):
    assert toolchain.DOUBLE.fullmatch(name)


@pytest.mark.parametrize("name", ["__aeabi_idiv", "sqrtf", "atan2f", "memcpy", "curv_functions_f1"])
def test_other_functions_are_not_taken_for_those_of_double(name):
    assert not toolchain.DOUBLE.fullmatch(name)


@pytest.mark.parametrize("module", ["codegen.target", "codegen.firmware.run"])
def test_a_missing_tool_is_named_with_its_package(module, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "argv", [module])
    with pytest.raises(SystemExit) as end:
        runpy.run_module(module, run_name="__main__")
    said = capsys.readouterr().err
    assert end.value.code == 2
    assert "arm-none-eabi-gcc is missing (Debian: apt-get install" in said
    assert "qemu-system-arm" in said


def test_all_functions_of_64_elements_are_short_enough_for_gcc(tmp_path):
    """Counts in place of time: gcc's time and memory grow with the lines of its functions, of long
    ones faster than linearly. With these `gcc -O2` takes about 10 s and a fifth of a GiB."""
    beam = functions.wing(64)
    names = ("midpoint_32", "target", "target_met", "mpc", "statics", "ekf")
    libraries = [x for x in functions.LIBRARIES if x.name in names]
    samples = {}
    for library in libraries:
        samples |= library.reference_inputs(beam)
    exported = [f for library in libraries for f in library.functions(beam)]
    cc.export_c(exported, tmp_path, real="float", beam=beam, reference_inputs=samples)
    source = (tmp_path / "curv_functions.c").read_text()
    functions_of_c = re.findall(r"^\w[^\n;]*\) \{\n(.*?)^\}", source, re.M | re.S)
    assert source.count("\n") < 45_000  # 37 000 of 16 elements: a call each, no unrolled chain
    assert 100 < len(functions_of_c)
    assert max(body.count("\n") for body in functions_of_c) < 2_500
    # By a process of its own: what starts one hands its own memory on to the figure of it.
    measure = (
        "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True);"
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    command = ["gcc", "-std=c99", "-O0", "-c", "curv.c", "curv_functions.c"]
    done = subprocess.run(
        [sys.executable, "-c", measure, *command],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert int(done.stdout) * 1024 < 2**29  # half of the GiB that a small machine has to spare
