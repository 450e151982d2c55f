"""C export, compiled and compared on the host."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.export import export_c, run_check
from curvcasadi.reference_wings import hale_wing

WING = hale_wing(2, 2, 1, grid=cc.Grid.lobatto(6))
Q = np.random.default_rng(0).uniform(-0.03, 0.03, (3, 5))


def _small(name="small"):
    x = ca.SX.sym("x", 2)
    return ca.Function(name, [x], [ca.sin(x[0]) * x[1], x**2], ["x"], ["a", "b"])


def test_the_tip_and_its_jacobian_agree_with_python_to_1e_13(tmp_path):
    functions = [
        cc.tip_function(hale_wing()),
        cc.pose_function("stations", WING, (0.3, 1.0), jacobian=True),
        cc.tip_function(WING).jacobian(),
    ]
    export_c(functions, tmp_path)
    errors = run_check(tmp_path)
    assert set(errors) == {"tip", "stations", "jac_tip"}
    # Over the largest entry of each output, 16 m of a position: rounding.
    assert max(errors.values()) <= 1e-13


def test_reference_inputs_are_those_that_are_compared(tmp_path):
    manifest = export_c([_small()], tmp_path, reference_inputs={"small": [[[0.25, 0.5]]]})
    source = (tmp_path / "check.c").read_text()
    assert "small_in0[][2] = {{0.25, 0.5}};" in source
    assert run_check(tmp_path)["small"] <= 1e-15
    assert manifest["functions"]["small"]["inputs"] == {"x": [2, 1]}


def test_unrolled_functions_and_single_elements_compile(tmp_path):
    stiff = replace(WING, grid=cc.Grid.uniform(1, max_angle=3.0))
    export_c([cc.tip_function(stiff, form="unrolled")], tmp_path)
    assert run_check(tmp_path)["tip"] <= 1e-13


def test_a_shape_target_solver_compiles_and_agrees(tmp_path):
    goals = [cc.pose_at(WING, q, 1.0) for q in Q]
    like = cc.Target(xi=1, position=[0, 16, 0], rotation=WING.root.rotation)
    f = cc.shape_target_function(WING, [like], regularizer="strain_energy")
    samples = [[np.full(5, 0.001), goal.position, goal.rotation] for goal in goals]
    export_c([f], tmp_path, reference_inputs={f.name(): samples})
    # The same operations in another program; compilers may fuse some, and a solver amplifies that
    # by its conditioning: the check's own limit.
    assert run_check(tmp_path, optimization="-O0")[f.name()] <= 1e-13


def test_a_tip_path_solver_compiles_and_agrees(tmp_path):
    model = cc.kinematic_model(WING, time_constant=0.5)
    stages, n = 3, WING.basis.n
    functions = [
        cc.tip_path_step_function(
            model,
            dt=0.1,
            horizon=stages,
            rate_bound=0.1,
            curvature_bound=0.1,
            iterations=iterations,
            name=name,
        )
        for iterations, name in ((None, "converged"), (1, "real_time"))
    ]
    samples = []
    for q in Q:
        tip = cc.pose_at(WING, q, 1.0)
        path = [ca.repmat(part, 1, stages) for part in (tip.position, tip.rotation)]
        samples.append([0.1 * q, 0 * q, 0.1 * q, *path, np.tile(np.tile(0.1 * q, 2), stages)])
    assert samples[0][-1].shape == (2 * n * stages,)
    export_c(functions, tmp_path, reference_inputs={f.name(): samples for f in functions})
    errors = run_check(tmp_path, optimization="-O0")
    # Python's DAQP takes another way to the same optimum, known to a distance of 1e-8.
    assert max(errors.values()) <= 1e-7


def test_a_float_solver_works_from_the_straight_wing(tmp_path):
    """Swept, with dihedral, splines and washout; where a solver divided by a denormal once."""
    rotation = cc.wing_root(side="right", sweep=np.deg2rad(15), dihedral=np.deg2rad(3)).rotation
    beam = cc.Beam(
        length=7.4,
        root=cc.Pose(rotation=rotation, position=[0, 0, 0]),
        basis=cc.ChannelBasis(torsion=cc.BSpline(5), out_of_plane=cc.BSpline(6)),
        grid=cc.Grid.uniform(20, real="float"),
        initial_curvature=[-0.007, 0, 0],
        weight_bounds=0.3,
    )
    target = cc.Target(xi=1.0, position=[0, 0, 0], weight=1.0)
    options = {"regularization": 1e-3, "name": "rti", "iterations": 1}
    f = cc.shape_target_function(beam, [target], **options)
    goal = cc.pose_at(beam, np.full(11, 0.02), 1.0).position
    samples = {"rti": [[np.zeros(11), goal]]}
    export_c([f], tmp_path, real="float", beam=beam, reference_inputs=samples)
    assert max(run_check(tmp_path).values()) <= 1e-3  # the check's own limit for solvers


def test_the_check_program_fails_on_a_wrong_reference(tmp_path):
    export_c([_small()], tmp_path, reference_inputs={"small": [[[0.25, 0.5]]]})
    program = tmp_path / "check.c"
    text = program.read_text()
    value = re.search(r"small_out0\[\]\[1\] = \{\{([^,}]+)\}", text).group(1)
    # Relative to 1, as no output is larger: ten times the limit.
    program.write_text(text.replace(f"= {{{{{value}}}", f"= {{{{{float(value) + 1e-12!r}}}"))
    with pytest.raises(RuntimeError, match=r"small 1\.0\d+e-12 FAILED"):
        run_check(tmp_path)


def test_the_check_program_fails_on_wrong_c(tmp_path):
    export_c([_small()], tmp_path)
    source = tmp_path / "curv_functions.c"
    assert "sin(" in source.read_text()
    source.write_text(source.read_text().replace("sin(", "cos("))
    with pytest.raises(RuntimeError, match=r"small .* FAILED"):
        run_check(tmp_path)


def test_the_check_program_fails_on_nan(tmp_path):
    export_c([_small()], tmp_path)
    source = tmp_path / "curv_functions.c"
    source.write_text(source.read_text().replace("sin(", "sqrt(-2+0*"))
    with pytest.raises(RuntimeError, match=r"small inf FAILED"):
        run_check(tmp_path)


def test_samples_that_are_missing_stand_in_the_self_test(tmp_path):
    y = ca.SX.sym("y", 2)
    f = ca.Function("sum", [y], [ca.sum1(ca.fmax(y, 0))], ["y"], ["total"])
    export = cc.CFunction(function=f, missing=("y",))
    for real in ("double", "float"):
        export_c([export], tmp_path, real=real, reference_inputs={"sum": [[[np.nan, 2.0]]]})
        assert "{{NAN, 2.0" in (tmp_path / "check.c").read_text()
        assert run_check(tmp_path)["sum"] == 0  # an exact number
    with pytest.raises(ValueError, match=r"reference_inputs\['sum'\], y: expected finite numbers"):
        export_c([f], tmp_path, reference_inputs={"sum": [[[np.nan, 2.0]]]})


def test_python_values_that_are_not_finite_are_refused_or_compile(tmp_path):
    x = ca.SX.sym("x")
    f = ca.Function("root", [x], [ca.sqrt(x)])
    try:
        export_c([f], tmp_path, reference_inputs={"root": [[-1.0]]})
    except ValueError as error:
        assert "root" in str(error)
        return
    with pytest.raises(RuntimeError, match=r"root .*FAILED"):
        run_check(tmp_path)


def test_two_runs_write_the_same_bytes(tmp_path):
    written = []
    for folder in ("a", "b"):
        f = cc.tip_function(WING)
        export_c([f, _small()], tmp_path / folder)
        written.append({p.name: p.read_bytes() for p in (tmp_path / folder).iterdir()})
    assert written[0] == written[1]
    names = {"curv.c", "curv.h", "curv_functions.c", "curv_functions.h", "check.c"}
    names |= {"CMakeLists.txt", "cortex-m.cmake", "manifest.json"}
    assert set(written[0]) == names


def test_the_manifest_tells_shapes_and_buffers(tmp_path):
    f = cc.tip_function(WING)
    manifest = export_c([f], tmp_path, name="wing")
    assert json.loads((tmp_path / "manifest.json").read_text()) == manifest
    written = {path.name for path in tmp_path.iterdir()}
    assert set(manifest["files"]) == written - {"manifest.json"}
    assert {"wing.c", "wing.h", "wing_functions.c", "wing_functions.h", "check.c"} < written
    assert manifest["casadi"] == ca.CasadiMeta.version()
    tip = manifest["functions"]["tip"]
    assert tip["outputs"] == {"position": [3, 1], "rotation": [3, 3]}
    header = (tmp_path / "wing_functions.h").read_text()
    for size in ("arg", "res", "iw", "w"):
        assert f"#define tip_SZ_{size.upper()} {tip['buffers'][size]}" in header


def test_functions_without_inputs_or_with_sparse_ones_are_exported(tmp_path):
    x = ca.SX.sym("x", ca.Sparsity.lower(3))
    functions = [
        ca.Function("constant", [], [ca.DM([1, 2])]),
        ca.Function("sparse", [x], [x @ ca.DM([1, 2, 3]), 2 * x]),
    ]
    export_c(functions, tmp_path)
    assert max(run_check(tmp_path).values()) <= 1e-15


@pytest.mark.parametrize("name", ["w", "main", "cases", "in", "small_in"])
def test_names_may_be_those_of_the_check_program(tmp_path, name):
    # Either works or is refused with the name; a check that does not compile helps nobody.
    try:
        export_c([_small(), _small(name)], tmp_path)
    except ValueError as error:
        assert name in str(error)
        return
    assert max(run_check(tmp_path).values()) <= 1e-15


def test_the_name_of_the_check_program_is_not_for_the_source(tmp_path):
    with pytest.raises(ValueError, match="name: "):
        export_c([_small()], tmp_path, name="check")


def _with_plugin(plugin):
    x, p = ca.MX.sym("x", 2), ca.MX.sym("p", 2)
    if plugin == "qrsqp":
        nlp = {"x": x, "p": p, "f": ca.sumsqr(x - p)}
        options = {"qpsol": "qrqp", "print_time": False, "print_header": False}
        return ca.Function("f", [p], [ca.nlpsol("s", plugin, nlp, options)(p=p)["x"]])
    if plugin == "newton":
        g = ca.Function("g", [x, p], [x - p])
        return ca.Function("f", [p], [ca.rootfinder("s", plugin, g)(0, p)])
    qp = ca.qpsol("s", plugin, {"x": x, "p": p, "f": ca.sumsqr(x - p)})
    return ca.Function("f", [p], [qp(p=p)["x"]])


@pytest.mark.parametrize("plugin", ["ipqp", "qrsqp", "newton"])
def test_parts_without_c_are_refused_and_no_broken_c_is_left(tmp_path, plugin):
    with pytest.raises(
        ValueError, match=r"functions: 'f' holds a part without .*; use .*(qrqp|fast_newton)"
    ):
        export_c([_with_plugin(plugin)], tmp_path)
    assert [path.name for path in tmp_path.iterdir() if path.suffix in (".c", ".h")] == []


def test_free_symbols_are_refused_by_name(tmp_path):
    x, load = ca.SX.sym("x"), ca.SX.sym("load")
    f = ca.Function("f", [x], [x * load], {"allow_free": True})
    with pytest.raises(ValueError, match=r"functions: 'f' has free symbols .*load"):
        export_c([f], tmp_path)


def test_functions_that_compute_nothing_are_refused(tmp_path):
    x = ca.MX.sym("x")
    with pytest.raises(ValueError, match=r"functions: expected outputs to compute, 'f' has none"):
        cc.export_c([ca.Function("f", [x], [])], tmp_path)


def test_numbers_beyond_single_precision_are_refused(tmp_path):
    x = ca.MX.sym("x")
    f = ca.Function("f", [x], [ca.fmin(x, 1e300)])
    with pytest.raises(ValueError, match=r"1.*e\+300, which real='float' does not have"):
        cc.export_c([f], tmp_path, real="float")
    cc.export_c([f], tmp_path, real="double")
    assert run_check(tmp_path)["f"] == 0


def test_numbers_below_single_precision_are_refused(tmp_path):
    x = ca.MX.sym("x")
    f = ca.Function("f", [x], [x / (x**2 + 1e-300)])
    with pytest.raises(ValueError, match=r"1.*e-300, which real='float' does not have"):
        cc.export_c([f], tmp_path, real="float")


def test_symbols_are_no_reference_inputs(tmp_path):
    x = ca.MX.sym("x", 2)
    f = ca.Function("f", [x], [2 * x], ["x"], ["y"])
    with pytest.raises(ValueError, match=r"\['f'\], x: expected numbers, found the symbol x"):
        cc.export_c([f], tmp_path, reference_inputs={"f": [(x,)]})


def test_inputs_at_which_python_fails_are_named(tmp_path):
    x = ca.SX.sym("x")
    options = {"qpsol": "qrqp", "print_time": False, "print_header": False}
    options |= {"print_iteration": False, "print_status": False}
    options["qpsol_options"] = {"print_iter": False, "print_header": False, "print_info": False}
    solver = ca.nlpsol("s", "sqpmethod", {"x": x, "f": x**2, "g": x**2 + 1}, options)
    y = ca.MX.sym("y")
    f = ca.Function("f", [y], [solver(x0=y, ubg=0)["x"]])
    with pytest.raises(ValueError, match=r"\['f'\]: expected inputs at which it can be evaluated"):
        cc.export_c([cc.CFunction(function=f, unchecked=True)], tmp_path)


def test_two_functions_of_one_name_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"functions: expected different names, found \['small', "):
        export_c([_small(), _small()], tmp_path)


@pytest.mark.parametrize("functions", [[], [1.0], [np.sin]], ids=str)
def test_what_is_no_function_is_refused(tmp_path, functions):
    with pytest.raises(
        ValueError, match=r"functions: expected one or more casadi\.Function or CFun"
    ):
        export_c(functions, tmp_path)


@pytest.mark.parametrize(
    "inputs",
    [
        {"other": [[[1.0, 2.0]]]},
        {"small": [[[1.0, 2.0, 3.0]]]},
        {"small": [[[1.0, 2.0], [3.0]]]},
        {"small": [[1.0]]},
    ],
    ids=["unknown function", "wrong shape", "too many", "broadcast"],
)
def test_wrong_reference_inputs_are_refused(tmp_path, inputs):
    with pytest.raises(ValueError, match=r"reference_inputs.*expected"):
        export_c([_small()], tmp_path, reference_inputs=inputs)


def test_a_missing_compiler_is_named(tmp_path):
    export_c([_small()], tmp_path)
    with pytest.raises(
        FileNotFoundError, match=r"compiler: expected 'no-such-cc' on the PATH, found"
    ):
        run_check(tmp_path, compiler="no-such-cc")


def test_a_folder_without_a_check_program_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"directory: expected what export_c writes, no"):
        run_check(tmp_path)


def test_c_that_does_not_compile_shows_the_compilers_words(tmp_path):
    export_c([_small()], tmp_path)
    source = tmp_path / "curv_functions.c"
    source.write_text(source.read_text() + "\nnonsense\n")
    with pytest.raises(RuntimeError, match=r"-std=c99 -pedantic .*failed:[\s\S]*nonsense"):
        run_check(tmp_path)
