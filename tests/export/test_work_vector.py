"""Work vectors of generated C are as long as it needs, and no call reaches beyond."""

from __future__ import annotations

import subprocess

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.export import run_check
from curvcasadi.export.casadi_c import work_vector

WING = cc.Beam(
    length=2.0,
    basis=cc.ChannelBasis(out_of_plane=cc.Legendre(2)),
    grid=cc.Grid.uniform(4),
    section=cc.Section(GJ=10, EI_y=20, EI_z=4e3),
)


def _filter():
    sensors = [cc.RateGyro(xi=1.0, noise_density=1, rate=1), cc.AttitudeSensor(xi=0.6, noise=1)]
    ekf = cc.shape_ekf(WING, sensors, process="white_acceleration", density=0.3, iterations=2)
    return ekf.update, [np.zeros(4), np.eye(4), np.append(np.zeros(3), np.eye(3))]


def _solver():
    force = ca.MX.sym("force", 3)
    loads = [cc.PointForce(xi=1.0, force=force, frame="dead")]
    f = cc.equilibrium_function(WING, loads, {"force": force}, max_iter=15, checked=True)
    return f, [np.zeros(2), [0, 0, 1.0]]


FUNCTIONS = {
    "pose": lambda: (cc.tip_function(WING), [np.zeros(2)]),
    "jacobian": lambda: (cc.tip_function(WING, jacobian=True), [np.zeros(2)]),
    "solver": _solver,
    "filter": _filter,
}


def _program(f, inputs, length):
    """Source of a call of `f` with a work vector on the heap, of `length` doubles."""
    lines = ["#include <stdlib.h>", '#include "curv_functions.h"']
    for i, value in enumerate(inputs):
        numbers = ca.project(ca.DM(value), f.sparsity_in(i)).nonzeros()
        lines.append(f"static const double in{i}[] = {{{', '.join(map(repr, numbers))}}};")
    lines += [f"static double out{i}[{f.nnz_out(i)}];" for i in range(f.n_out())]
    lines += [
        f"static const double *arg[{f.sz_arg()}];",
        f"static double *res[{f.sz_res()}];",
        f"static int iw[{f.sz_iw() + 1}];",
        "int main(void) {",
        *(f"  arg[{i}] = in{i};" for i in range(f.n_in())),
        *(f"  res[{i}] = out{i};" for i in range(f.n_out())),
        f"  return curv_casadi_{f.name()}(arg, res, iw, calloc({length}, sizeof(double)), 0);",
        "}",
    ]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("which", FUNCTIONS)
def test_no_call_reaches_beyond_its_work_vector(tmp_path, which):
    f, inputs = FUNCTIONS[which]()
    samples = {f.name(): [inputs]}
    described = cc.export_c([f], tmp_path, reference_inputs=samples)["functions"][f.name()]
    assert (
        run_check(tmp_path, optimization="-O0")[f.name()] <= 1e-9
    )  # of a solver: to its tolerance
    length = described["buffers"]["w"]
    assert length < f.sz_w()
    (tmp_path / "main.c").write_text(_program(f, inputs, length))
    gcc = ["gcc", "-std=c99", "-fsanitize=address,undefined", "main.c", "curv_functions.c", "-lm"]
    subprocess.run([*gcc, "-o", "main"], cwd=tmp_path, check=True)
    subprocess.run(["./main"], cwd=tmp_path, check=True, env={"ASAN_OPTIONS": "detect_leaks=0"})


def test_results_between_calls_stay_apart(tmp_path):
    """What is kept over a call lies behind all that the call, and what it calls, writes."""
    x = ca.MX.sym("x", 5)
    twice = ca.Function("twice", [x], [2 * x + ca.sin(x)], {"never_inline": True})
    inner = ca.Function("inner", [x], [ca.cos(twice(x)) * twice(x + 1), x / 3])
    y, z = inner(x)
    outer = ca.Function("outer", [x], [inner(y)[0] * z + inner(z)[1], ca.mtimes(y, z.T)])
    samples = {"outer": [[np.linspace(-1, 1, 5)]]}
    described = cc.export_c([outer], tmp_path, reference_inputs=samples)["functions"]["outer"]
    assert run_check(tmp_path)["outer"] <= 1e-15  # the same operations
    assert described["buffers"]["w"] < outer.sz_w()


def test_inputs_that_are_handed_on_have_their_length(tmp_path):
    """One index may be that of a result and of an intermediate one."""
    x, y, z = ca.MX.sym("x"), ca.MX.sym("y", 2), ca.MX.sym("z", 3)
    inner = ca.Function("inner", [z], [ca.sin(z)], {"never_inline": True})
    f = ca.Function("f", [x, y, z], [x, z, y, ca.vertcat(x, y, inner(z))])
    samples = {"f": [[1.0, [2.0, 3.0], [4.0, 5.0, 6.0]]]}
    cc.export_c([f], tmp_path, reference_inputs=samples)
    assert run_check(tmp_path)["f"] == 0


@pytest.mark.parametrize("horizon", [1, 2])
def test_a_controller_of_one_state_and_one_input_becomes_c(tmp_path, horizon):
    x, u, p = (ca.MX.sym(key) for key in "xup")
    layouts = {key: cc.Layout((cc.Part(key, 1, "1"),)) for key in "xup"}
    model = cc.ControlModel(
        name="lag",
        **layouts,
        y=cc.Layout((cc.Part("y", 3, "1"),)),
        xdot=ca.Function("xdot", [x, u, p], [u - x + p]),
        output=ca.Function("output", [x, u, p], [ca.vertcat(x, 2 * x, x**2)]),
    )
    mpc = cc.Mpc(model, dt=0.1, horizon=horizon, outputs={"y": [1, 0, 0]})
    assert mpc.step([0.5], {"p": 0.1}).success
    cc.export_c([mpc], tmp_path)
    assert run_check(tmp_path)["mpc"] <= 1e-12


def test_qrqp_has_room_for_the_end_of_its_list_of_integers(tmp_path):
    x, p = ca.MX.sym("x", 2), ca.MX.sym("p", 2)
    quiet = {"print_iter": False, "print_header": False, "print_info": False}
    solver = ca.qpsol("s", "qrqp", {"x": x, "p": p, "f": ca.sumsqr(x - p)}, quiet)
    f = ca.Function("f", [p], [solver(p=p)["x"]])
    assert work_vector.integers(f) == f.sz_iw() + 1
    manifest = cc.export_c([cc.CFunction(function=f, unchecked=True)], tmp_path)
    assert manifest["functions"]["f"]["buffers"]["iw"] == f.sz_iw() + 1
    assert f"f_SZ_IW {f.sz_iw() + 1}" in (tmp_path / "curv_functions.h").read_text()
    g = ca.Function("g", [p], [ca.sin(p)])
    assert work_vector.integers(g) == g.sz_iw()
