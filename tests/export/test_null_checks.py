"""Questions leave generated C only where they have one answer."""

from __future__ import annotations

import re
import subprocess

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.export.casadi_c.generate import generate
from curvcasadi.export.casadi_c.null_checks import without_failure_checks, without_null_copies

QUESTION = re.compile(r"(?:arg|res)\[\d+\](?: *\?|!=0\))")


def _inner(name, **options):
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    options = {"never_inline": True, **options}
    return ca.Function(name, [x, y], [x * ca.cos(y), x + y], ["x", "y"], ["a", "b"], options)


def _calls(which):
    """Calls of an inner function: with both outputs, the first alone, or an input that is zero."""
    f, x, y = _inner("inner"), ca.MX.sym("x"), ca.MX.sym("y")
    a, b = f(x, y)
    outputs = {
        "all": [a + 2 * b],
        "one output": [a + 2 * b, f(y, x)[0]],
        "zero input": [a + 2 * b, ca.vertcat(*f(x, ca.MX(1, 1)))],
    }
    return ca.Function("outer", [x, y], outputs[which])


def _definition(source, words):
    """The generated function whose comment says `words`."""
    start = source.index(f"/* {words}")
    return source[start : source.index("\n}\n", start)]


@pytest.mark.parametrize("which", ["all", "one output", "zero input"])
def test_questions_stay_where_a_call_passes_null(which):
    source, *_ = generate([_calls(which)], "curv_functions", "double")
    asked = QUESTION.findall(_definition(source, "inner:("))
    assert bool(asked) == (which == "one output")  # CasADi passes a zero for a zero input


@pytest.mark.parametrize("which", ["all", "one output", "zero input"])
def test_results_stay_what_they_were(tmp_path, which):
    samples = {"outer": [[[0.3], [-1.2]], [[2.0], [0.0]]]}
    cc.export_c([_calls(which)], tmp_path, reference_inputs=samples)
    assert cc.export.run_check(tmp_path)["outer"] <= 1e-15  # the same operations


@pytest.mark.parametrize("size", [2, 30])
def test_zeros_for_inputs_that_are_left_out_stay_where_there_can_be_any(size):
    """CasADi points at them in place of a large input; inner functions have all of theirs."""
    y, z, x = ca.SX.sym("y", 30), ca.MX.sym("z", 30), ca.MX.sym("x", size)
    one = ca.Function("one", [y], [ca.sumsqr(y)], {"never_inline": True})
    inner = ca.Function("inner", [z], [one(z) + one(2 * z)])
    outer = ca.Function("outer", [x], [inner(ca.repmat(x, 30 // size))])
    source, *_ = generate([outer], "curv_functions", "double")
    table = re.search(r"^static const casadi_real casadi_zeros\[", source, re.M)
    assert bool(table) == (size == 30)


def test_functions_that_cannot_fail_are_not_asked_whether_they_did():
    """What calls one that can fail can fail, too."""
    bodies = {
        "casadi_f1": "if (arg[0]) return 1;\n  return 0;",
        "casadi_f2": "res[0][0]=1;\n  return 0;",
        "casadi_f3": "if (casadi_f1(arg, res)) return 1;\n  return 0;",
        "casadi_f4": "if (casadi_f2(arg, res)) return 1;\n  return 0;",
        "casadi_f5": "if (casadi_f3(arg, res)) return 1;\n  if (casadi_f4(arg, res)) return 1;\n"
        "  return 0;",
    }
    head = "static int {}(const casadi_real** arg, casadi_real** res) {{\n  {}\n}}\n\n"
    source = "".join(head.format(name, body) for name, body in bodies.items())
    asked = re.findall(r"if \((casadi_f\d+)\(", without_failure_checks(source))
    assert asked == ["casadi_f1", "casadi_f3"]
    assert re.findall(r"^  (casadi_f\d+)\(", without_failure_checks(source), re.M) == [
        "casadi_f2",
        "casadi_f4",
    ]


def test_copies_of_what_is_never_null_do_not_ask():
    """Not in gcc -O2 either, which warned of a part of the work vector beyond a null one."""
    definition = "void casadi_copy(const casadi_real* x, casadi_int n, casadi_real* y) {\n}\n"
    calls = [
        "casadi_copy(w00, 6, w03);",
        "casadi_copy(casadi_c2, 3, w05);",
        "casadi_copy(arg[0], 6, w02);",
        "casadi_copy(w03, 6, res[0]);",
    ]
    source = without_null_copies(definition + "\n".join(calls))
    assert re.findall(r"^casadi_(\w+)\(", source, re.M) == ["move", "move", "copy", "copy"]
    assert re.match("static void casadi_move", source)
    asked = definition + calls[-1]
    assert without_null_copies(asked) == asked


def test_exported_functions_still_take_null_as_casadi_says(tmp_path):
    """NULL for an input is zero, for an output that it is not wanted."""
    wing = cc.Beam(
        length=2.0, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(2)), grid=cc.Grid.uniform(4)
    )
    manifest = cc.export_c([cc.tip_function(wing), _inner("plain")], tmp_path)
    assert max(max(f["buffers"].values()) for f in manifest["functions"].values()) < 99
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "curv_functions.h"\n'
        "static const double *arg[99];\n"
        "static double *res[99], w[999], p[3], b;\n"
        "static int iw[99];\n"
        "int main(void) {\n  const double x = 3;\n  res[0] = p;\n"
        "  if (curv_casadi_tip(arg, res, iw, w, 0)) return 1;\n"
        "  arg[0] = &x; res[0] = 0; res[1] = &b;\n"
        "  if (curv_casadi_plain(arg, res, iw, w, 0)) return 1;\n"
        '  printf("%.17g %.17g %.17g %.17g\\n", p[0], p[1], p[2], b);\n  return 0;\n}\n'
    )
    gcc = ["gcc", "-std=c99", "-fsanitize=undefined", "main.c", "curv_functions.c", "-lm"]
    subprocess.run([*gcc, "-o", "main"], cwd=tmp_path, check=True)
    printed = subprocess.run(["./main"], cwd=tmp_path, check=True, capture_output=True, text=True)
    np.testing.assert_allclose(np.fromstring(printed.stdout, sep=" "), [2, 0, 0, 3], rtol=0)
