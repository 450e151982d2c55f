"""Typed calls of exported functions, from C programs written by hand."""

from __future__ import annotations

import re
import subprocess
from contextlib import nullcontext
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.expressions import BOUND_SLACK

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror")
WING = replace(
    hale_wing(2, 2, 1, grid=cc.Grid.uniform(8, rule="midpoint", max_angle=0.3)), weight_bounds=0.05
)
FREE = replace(WING, weight_bounds=None)
N = WING.basis.n
STATUSES = {"OK": 0, "INFEASIBLE": 1, "NOT_CONVERGED": 2, "BAD_INPUT": 3}

PROGRAM = """\
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "curv.h"
static int untouched(const void *block, size_t size) {
  size_t i;
  for (i = 0; i < size; ++i) if (((const unsigned char *)block)[i] != 0x5A) return 0;
  return 1;
}
int main(void) {
%s
  return 0;
}
"""


def compiled(folder, functions, body, *, flags=(), **options):
    """What a program with `body` prints, numbers, after an export of `functions`."""
    cc.export_c(functions, folder, **options)
    (folder / "program.c").write_text(PROGRAM % body)
    sources = ("program.c", "curv.c", "curv_functions.c")
    command = ["gcc", *STRICT, "-Wno-unused-function", *flags, *sources, "-o", "program", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    done = subprocess.run(["./program"], cwd=folder, capture_output=True, text=True, check=True)
    return np.array([float(word) for word in done.stdout.split()])


def ended(folder, functions, name, calls, **options):
    """The status of each of `calls`, lists of arguments in C; outputs of none but OK are written"""
    lines = [f"  static curv_{name}_out out;"]
    for arguments in calls:
        lines += [
            "  memset(&out, 0x5A, sizeof out);",
            f'  printf("%d ", (int)curv_{name}({", ".join([*arguments, "&out"])}));',
            '  printf("%d\\n", untouched(&out, sizeof out));',
        ]
    found = compiled(folder, functions, "\n".join(lines), **options).astype(int)
    statuses, untouched = found[::2], found[1::2]
    np.testing.assert_array_equal(untouched, statuses != 0)
    return [list(STATUSES)[k] for k in statuses]


def array(values):
    """A compound literal."""
    values = values.full() if isinstance(values, ca.DM) else values
    words = [w if isinstance(w, str) else repr(float(w)) for w in np.ravel(values, "F").tolist()]
    return f"(const curv_real[]){{{', '.join(words)}}}"


def changed(values, index, word):
    values = [repr(float(x)) for x in np.ravel(values)]
    values[index] = word
    return f"(const curv_real[]){{{', '.join(values)}}}"


def test_arguments_stand_in_order_with_matrices_by_columns_and_scalars_by_value(tmp_path):
    a, s = ca.MX.sym("a", 2, 3), ca.MX.sym("s")
    none, low = ca.MX.sym("none", 0, 2), ca.MX.sym("low", ca.Sparsity.lower(2))
    outputs = [s * a, a[0, 2], ca.MX(0, 1), 2 * low]
    f = ca.Function(
        "mixed", [a, s, none, low], outputs, ["a", "s", "none", "low"], ["m", "t", "e", "l"]
    )
    body = """\
  static curv_mixed_out out;
  const curv_real a[CURV_MIXED_N_A] = {1, 2, 3, 4, 5, 6}, low[CURV_MIXED_N_LOW] = {7, 8, 9};
  typedef const curv_real *array;
  curv_status (*typed)(array, curv_real, array, curv_mixed_out *) = curv_mixed;
  int i;
  if (typed(a, 10, low, &out) != CURV_OK) return 1;
  for (i = 0; i < 6; ++i) printf("%g ", out.m[i]);
  printf("%g ", out.t);
  for (i = 0; i < 3; ++i) printf("%g ", out.l[i]);
  printf("%d", (int)(sizeof out / sizeof(curv_real)));"""
    found = compiled(tmp_path, f, body)
    np.testing.assert_array_equal(found, [10, 20, 30, 40, 50, 60, 5, 14, 16, 18, 10])
    header = (tmp_path / "curv.h").read_text()
    arguments = "const curv_real a[6], curv_real s, const curv_real low[3], curv_mixed_out *out"
    assert f"curv_mixed({arguments});" in header
    assert "in   low (2, 2), its 3 nonzeros" in header


def test_names_that_c_has_taken_get_an_underscore(tmp_path):
    x = [ca.MX.sym(name) for name in ("out", "work", "double", "index")]
    names = [symbol.name() for symbol in x]
    f = ca.Function("taken", x, [x[0] - x[1], x[2] * x[3]], names, ["for", "int"])
    body = """\
  static curv_taken_out out;
  if (curv_taken(5, 2, 3, 4, &out)) return 1;
  printf("%g %g", out.for_, out.int_);"""
    np.testing.assert_array_equal(compiled(tmp_path, f, body), [3, 12])


def test_both_forms_agree_whatever_the_buffers_held(tmp_path):
    q = np.linspace(-0.02, 0.02, N)
    body = f"""\
  static curv_tip_out plain, with;
  static curv_tip_work work;
  memset(&work, 0xFF, sizeof work);
  if (curv_tip({array(q)}, &plain) || curv_tip_with(&work, {array(q)}, &with)) return 1;
  printf("%d %.17g", memcmp(&plain, &with, sizeof with), with.position[2]);"""
    same, height = compiled(tmp_path, cc.tip_function(WING), body, beam=WING)
    assert same == 0
    # Rounding of 16 m.
    assert abs(height - float(cc.tip_function(WING)(q)[0][2])) <= 1e-13


@pytest.mark.parametrize("real", ["double", "float"])
def test_weights_that_a_solver_may_return_are_accepted_and_others_refused(tmp_path, real):
    beam = replace(WING, grid=replace(WING.grid, real=real))
    f = "f" if real == "float" else ""
    slack = BOUND_SLACK[real]
    kept, beyond = 0.05 + 0.99 * slack, 0.05 + 1.01 * slack
    values = (0.05, -0.05, kept, -kept, beyond, -beyond)
    calls = [[changed(np.zeros(N), 2, f"{value!r}{f}")] for value in values]
    statuses = ended(tmp_path, cc.tip_function(beam), "tip", calls, beam=beam, real=real)
    assert statuses == ["OK"] * 4 + ["BAD_INPUT"] * 2
    # As in Python.
    for value, status in zip(values, statuses, strict=True):
        q = np.zeros(N)
        q[2] = value
        with nullcontext() if status == "OK" else pytest.raises(ValueError, match="weight_bounds"):
            cc.shape_map(beam, q)


@pytest.mark.parametrize("beam", [WING, FREE], ids=["bounds", "element angles"])
def test_weights_that_are_not_finite_are_refused_in_every_entry(tmp_path, beam):
    calls = [
        [changed(np.zeros(N), k, word)]
        for k in range(N)
        for word in ("NAN", "INFINITY", "-INFINITY", "DBL_MAX", "-DBL_MAX")
    ]
    statuses = ended(tmp_path, cc.tip_function(beam), "tip", calls, beam=beam)
    assert set(statuses) == {"BAD_INPUT"}


def test_an_element_that_turns_further_than_the_grid_allows_is_refused(tmp_path):
    direction = np.linspace(1, 0.5, N)
    small = 1e-3  # of a bend within the limit
    squared = float(ca.mmax(cc.squared_element_angles(FREE, ca.DM(small * direction)))) / small**2
    limit = FREE.grid.max_angle / np.sqrt(squared)
    # By the midpoint rule the angle is linear in the weights; it rounds to 1e-15.
    slack = BOUND_SLACK["double"]
    parts = (0.5, 1, 1 + 0.99 * slack, 1 + 1.01 * slack, 2, 1e150)
    calls = [[array(part * limit * direction)] for part in parts]
    statuses = ended(tmp_path, cc.tip_function(FREE), "tip", calls, beam=FREE)
    assert statuses == ["OK"] * 3 + ["BAD_INPUT"] * 3


def test_denormals_and_negative_zeros_are_weights_like_others(tmp_path):
    calls = [[changed(np.zeros(N), 0, word)] for word in ("-0.0", "5e-324", "-DBL_MIN / 3")]
    assert ended(tmp_path, cc.tip_function(WING), "tip", calls, beam=WING) == ["OK"] * 3


@pytest.mark.parametrize("beam", [WING, FREE], ids=["bounds", "element angles"])
def test_every_column_of_weights_is_checked(tmp_path, beam):
    q = ca.MX.sym("samples", N, 2)
    tips = [cc.tip_function(beam)(column)[0] for column in ca.horzsplit(q)]
    f = cc.CFunction(
        function=ca.Function("two", [q], [ca.horzcat(*tips)], ["samples"], ["positions"]),
        weights={"samples": beam},
    )
    samples = {"two": [[np.zeros((N, 2))]]}
    calls = [[changed(np.zeros(2 * N), k, word)] for k in (0, N) for word in ("0.01", "5.0", "NAN")]
    statuses = ended(tmp_path, f, "two", calls, reference_inputs=samples)
    assert statuses == ["OK", "BAD_INPUT", "BAD_INPUT"] * 2


def test_missing_samples_may_be_nan_but_not_infinite(tmp_path):
    x, y = ca.MX.sym("x", 2), ca.MX.sym("y", 2)
    known = ca.fmax(x, -10)  # of NaN and a number, the number
    f = cc.CFunction(
        function=ca.Function("filter", [x, y], [known + y], ["x", "y"], ["z"]), missing=("x",)
    )
    two = array([1, 2])
    calls = [
        [two, two],
        [changed([1, 2], 1, "NAN"), two],
        [changed([1, 2], 1, "INFINITY"), two],
        [changed([1, 2], 0, "-INFINITY"), two],
        [two, changed([1, 2], 1, "NAN")],
    ]
    statuses = ended(tmp_path, f, "filter", calls)
    assert statuses == ["OK", "OK", "BAD_INPUT", "BAD_INPUT", "BAD_INPUT"]


def test_a_map_without_a_finite_value_was_given_bad_input(tmp_path):
    x = ca.MX.sym("x")
    f = ca.Function("root", [x], [ca.sqrt(x), 1 / x], ["x"], ["r", "inverse"])
    samples = {"root": [[4.0]]}
    calls = [["4"], ["-1"], ["0"], ["NAN"]]
    statuses = ended(tmp_path, f, "root", calls, reference_inputs=samples)
    assert statuses == ["OK", "BAD_INPUT", "BAD_INPUT", "BAD_INPUT"]


def test_a_solver_is_believed_where_both_outputs_are_at_most_one(tmp_path):
    v, s = ca.MX.sym("v"), ca.MX.sym("s")
    outputs = {"x": ca.sqrt(v + 2), "violation": v, "stationarity": s}
    f = ca.Function("solver", [v, s], [*outputs.values()], ["v", "s"], [*outputs])
    expected = {
        ("0", "0"): "OK",
        ("1", "1"): "OK",
        ("1 + DBL_EPSILON", "0"): "INFEASIBLE",
        ("2", "2"): "INFEASIBLE",
        ("0", "1 + DBL_EPSILON"): "NOT_CONVERGED",
        ("DBL_MAX", "0"): "INFEASIBLE",
        ("-3", "0"): "NOT_CONVERGED",  # x is no number
    }
    calls = [list(arguments) for arguments in expected]
    statuses = ended(tmp_path, f, "solver", calls, reference_inputs={"solver": [[0.0, 0.0]]})
    assert statuses == [*expected.values()]


def test_a_shape_target_ends_with_every_status_on_purpose(tmp_path):
    kind = cc.Target(xi=1.0, position=[0, 16, 0])
    shape = np.linspace(0.01, 0.02, N)
    goal = cc.pose_at(WING, shape, 1.0).position.full()
    guess = np.full(N, 0.005)
    nearby, soft = [replace(kind, weight=1.0)], {"regularization": 1e-4}
    hasty = cc.shape_target_function(WING, nearby, max_iter=1, name="hasty", **soft)
    met = cc.shape_target_function(WING, [kind], name="met")
    near = cc.shape_target_function(WING, nearby, name="near", **soft)
    solution = near(guess, goal)[0]
    samples = {
        "hasty": [(solution, goal), (guess, goal)],
        "met": [(guess, goal)],
        "near": [(guess, goal)],
    }
    functions = [hasty, met, near]
    calls = {
        "met": {
            "OK": [array(guess), array(goal)],
            "INFEASIBLE": [array(guess), array(3 * goal)],  # beyond the length of the wing
            "BAD_INPUT": [changed(guess, 0, "0.06"), array(goal)],
        },
        "near": {
            "OK": [array(guess), array(goal)],
            "BAD_INPUT": [array(guess), changed(goal, 1, "INFINITY")],
        },
        "hasty": {
            "OK": [array(solution), array(goal)],
            "NOT_CONVERGED": [array(guess), array(goal)],
            "BAD_INPUT": [changed(guess, N - 1, "NAN"), array(goal)],
        },
    }
    for name, expected in calls.items():
        options = {"beam": WING, "reference_inputs": samples}
        found = ended(tmp_path, functions, name, [*expected.values()], **options)
        assert found == [*expected], name


def test_an_equilibrium_ends_with_every_status_on_purpose(tmp_path):
    force = ca.MX.sym("force", 3)
    load = cc.PointForce(xi=1.0, force=force, frame="dead")
    of = {
        name: cc.equilibrium_function(
            WING, [load], {"force": force}, checked=True, max_iter=max_iter, name=name
        )
        for name, max_iter in (("hasty", 1), ("patient", 30))
    }
    light, zero = [0.0, 0.0, 1.0], np.zeros(N)
    samples = {"hasty": [(zero, zero[:3])], "patient": [(zero, light)]}
    # Bent beyond the bounds of the weights: an equilibrium, but not one of this wing.
    heavy = next(
        [0.0, 0.0, f] for f in 2.0 ** np.arange(20) if float(of["patient"](zero, [0, 0, f])[1]) > 1
    )
    calls = {
        "patient": {
            "OK": [array(zero), array(light)],
            "INFEASIBLE": [array(zero), array(heavy)],
            "BAD_INPUT": [array(zero), changed(light, 2, "NAN")],
        },
        "hasty": {"NOT_CONVERGED": [array(zero), array(light)]},
    }
    for name, expected in calls.items():
        options = {"beam": WING, "reference_inputs": samples}
        found = ended(tmp_path, [*of.values()], name, [*expected.values()], **options)
        assert found == [*expected], name


def test_fast_math_is_refused_by_the_header(tmp_path):
    cc.export_c(cc.tip_function(WING), tmp_path, beam=WING)
    done = subprocess.run(
        ["gcc", "-std=c99", "-ffast-math", "-fsyntax-only", "curv.c"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "compile without -ffast-math" in done.stderr


class _Twice(ca.Callback):
    def __init__(self):
        ca.Callback.__init__(self)
        self.construct("twice")

    def eval(self, arg):
        return [2 * arg[0]]


def _unsupported(part):
    x, p = ca.MX.sym("x"), ca.MX.sym("p")
    nlp = {"x": x, "p": p, "f": (x - p) ** 2}
    if part == "ipopt":
        return ca.nlpsol("s", "ipopt", nlp, {"print_time": False})(p=p)["x"]
    if part == "qpoases":
        return ca.qpsol("s", "qpoases", nlp)(p=p)["x"]
    if part in ("newton", "kinsol"):
        return ca.rootfinder("s", part, {"x": x, "p": p, "g": x**3 - p})(0, p)
    if part == "cvodes":
        return ca.integrator("s", "cvodes", {"x": x, "p": p, "ode": p - x}, 0, 1)(x0=0, p=p)["xf"]
    if part == "rk":
        return ca.integrator("s", "rk", {"x": x, "p": p, "ode": p - x}, 0, 1)(x0=0, p=p)["xf"]
    if part == "erfinv":
        return ca.erfinv(p)
    if part in ("thread", "openmp"):
        square = ca.Function("square", [x], [x**2], {"never_inline": True})
        return ca.sum2(square.map(3, part)(ca.horzcat(p, p, p)))
    if part == "printme":
        return p.printme(1)
    if part == "monitor":
        return p.monitor("p")
    return ca.MX(_KEPT(p))


_KEPT = _Twice()


@pytest.mark.parametrize(
    ("part", "instead"),
    [
        ("ipopt", r"sqpmethod.*shape_target_function"),
        ("qpoases", "'qrqp'"),
        ("newton", "fast_newton"),
        ("rk", "'simplify': True"),
        ("erfinv", "an approximation of your own"),
        ("openmp", r"map\(n, 'serial'\)"),
        ("kinsol", "fast_newton"),
        ("cvodes", r"integrator\(…, 'rk'"),
        ("thread", "'serial'"),
        ("printme", "without monitors"),
        ("monitor", "without monitors"),
        ("callback", "Python does not become C"),
    ],
)
def test_parts_without_c_are_refused_with_what_to_use_instead(tmp_path, part, instead):
    p = ca.MX.sym("p")
    made = _unsupported(part)
    f = ca.Function("guilty", [ca.symvar(made)[0]], [made])
    innocent = ca.Function("innocent", [p], [p**2])
    with pytest.raises(ValueError, match=rf"functions: 'guilty' holds a part .*{instead}"):
        cc.export_c([innocent, f], tmp_path)
    assert not [*tmp_path.iterdir()]


def test_functions_of_other_libraries_are_refused(tmp_path):
    x = ca.MX.sym("x")
    source = ca.CodeGenerator("lib.c", {"with_header": False})
    source.add(ca.Function("lib", [x], [ca.sin(x)]))
    source.generate(f"{tmp_path}/")
    subprocess.run(["gcc", "-shared", "-fPIC", "lib.c", "-o", "lib.so"], cwd=tmp_path, check=True)
    external = ca.external("lib", str(tmp_path / "lib.so"))
    f = ca.Function("guilty", [x], [2 * external(x)])
    with pytest.raises(
        ValueError, match=r"'guilty' holds a part .*External.*expressions themselves"
    ):
        cc.export_c(f, tmp_path / "c")


A = ca.MX.sym("A", 2)


def _f(*names, name="f", outputs=("y",)):
    x = [ca.MX.sym(n) for n in names]
    return ca.Function(name, x, [sum(x)] * len(outputs), list(names), list(outputs))


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: cc.CFunction(function=np.sin), "one or more casadi.Function or CFunction"),
        (lambda: cc.CFunction(function=_f("x"), weights={"z": WING}), "among x, found 'z'"),
        (lambda: cc.CFunction(function=_f("x"), weights={"x": WING}), "a beam of 1 weights"),
        (lambda: cc.CFunction(function=_f("x"), weights={"x": 3}), r"CFunction.weights\['x'\]"),
        (lambda: cc.CFunction(function=_f("x"), weights=[WING]), "CFunction.weights"),
        (lambda: cc.CFunction(function=_f("x"), missing=("y",)), "CFunction.missing.*among x"),
        (lambda: cc.CFunction(function=_f("x"), descriptions={"z": "m"}), "among x, y, found 'z'"),
        (lambda: cc.CFunction(function=_f("x"), tolerance=0.0), "CFunction.tolerance"),
    ],
)
def test_wrong_fields_of_a_c_function_are_refused(made, message):
    with pytest.raises(ValueError, match=message):
        made()


@pytest.mark.parametrize(
    ("functions", "options", "message"),
    [
        ([_f("x")], {"real": "half"}, r"real: .*'half'"),
        ([_f("x")], {"name": "2wing"}, "name: "),
        ([_f("x")], {"name": "check"}, "name: "),
        ([_f("x", name="sin")], {}, "found 'sin'"),
        ([_f("x", name="check_me")], {}, "found 'check_me'"),
        ([_f("q")], {"beam": 3}, "beam: "),
        ([_f("x", outputs=("violation", "stationarity"))], {}, "expected inputs of the solver"),
        ([_f("out", "out_")], {}, "'out' and 'out_'"),
        ([_f("x", outputs=("for", "for_"))], {}, "'for' and 'for_'"),
        (
            [ca.Function("f", [A, ca.MX.sym("a")], [2 * A], ["A", "a"], ["y"])],
            {},
            "'f.A' and 'f.a'",
        ),
        ([_f("x", name="tip"), _f("x", name="tip_with")], {}, "'tip' and 'tip_with'"),
        ([_f("x", name="tip"), _f("x", name="tip_out")], {}, "'tip' and 'tip_out'"),
        ([_f("x", name="status")], {}, "found 'status'"),
        ([_f("x", name="tip"), _f("x", name="casadi_tip")], {}, "found 'casadi_tip'"),
        ([_f("x", name="f" * 61)], {}, "expected names of at most 60 characters"),
        ([_f("x")], {"name": "math"}, "name: expected another .*found 'math'"),
        ([_f("x")], {"name": "all"}, "name: expected another .*found 'all'"),
        ([_f("x")], {"real": "float", "reference_inputs": {"f": [[1e300]]}}, "f.*that float32 has"),
    ],
)
def test_wrong_arguments_of_export_c_are_refused_and_nothing_is_written(
    tmp_path, functions, options, message
):
    with pytest.raises(ValueError, match=message):
        cc.export_c(functions, tmp_path, **options)
    assert not [*tmp_path.iterdir()]


def test_a_solver_asks_for_reference_inputs_in_their_form(tmp_path):
    """What the message shows, filled in, is what export_c takes."""
    beam = cc.Beam(
        length=2.0, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(1)), grid=cc.Grid.uniform(4)
    )
    f = cc.tip_path_step_function(
        cc.kinematic_model(beam, time_constant=0.3), dt=0.1, horizon=1, attitude_weight=0.0
    )
    form = f"reference_inputs={{{f.name()!r}: [[{', '.join(f.name_in())}], ...]}}"
    with pytest.raises(ValueError, match=re.escape(form)) as failure:
        cc.export_c(f, tmp_path)
    for key in f.name_in():  # and their shapes
        assert f"{key} {f.size_in(key)}" in str(failure.value)
    sample = [np.zeros(f.size_in(key)) for key in f.name_in()]
    sample[f.index_in("positions")][0] = 2.0
    cc.export_c(f, tmp_path, reference_inputs={f.name(): [sample]})
