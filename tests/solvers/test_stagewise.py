"""Programs that keep their states say the same as the condensed ones."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

from curvcasadi.solvers.certificate import Bounds
from curvcasadi.solvers.gauss_newton import GaussNewton
from curvcasadi.solvers.stages import Stages
from curvcasadi.solvers.stagewise import Stagewise, node_linearization

NX, NU, COUNT = 4, 2, 5


def stages(hold, terminal, relative=True):
    """Nonlinear stages, whose last state is none that the next stage depends on."""
    rng = np.random.default_rng(3)
    A, B, C = (rng.normal(size=shape) / 2 for shape in ((NX, NX), (NX, NU), (3, NX)))
    A[:, 3] = 0
    x, u, p, goal = (ca.MX.sym(key, n) for key, n in zip("xupg", (NX, NU, 1, 3), strict=True))
    end = ca.DM(A) @ ca.sin(x) + ca.DM(B) @ u + 0.1 * p * ca.cos(u[0])
    after = ca.MX.sym("after", NX)
    error = ca.DM(C) @ after + 0.1 * ca.sumsqr(after) - goal
    limits = ca.vertcat(after[0] + u[1], x[1] * u[0] + after[2])
    last = ca.vertcat(after[:3] ** 2, after[1])

    def slopes(value, *by):
        return ca.horzcat(*(ca.jacobian(value, v) for v in by))

    return Stages(
        count=COUNT,
        error=ca.Function("error", [after, p, goal], [error, ca.densify(slopes(error, after))]),
        step=ca.Function("step", [x, u, p], [end, slopes(end, x).T, slopes(end, u).T]),
        limits=ca.Function("limits", [x, u, after, p], [limits, slopes(limits, x, u, after).T]),
        move_weight=0.0,
        damping=1e-3,
        relative=relative,
        hold=hold,
        varying=True,
        terminal=ca.Function("last", [after], [last, ca.densify(slopes(last, after))])
        if terminal
        else None,
    )


def point(made):
    """Unknowns and parameters, at random."""
    rng = np.random.default_rng(0)
    return rng.normal(size=made.inputs * NU) / 10, rng.normal(size=sum(made.parameter_sizes)) / 2


@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("hold", [(), (0, 0, 1, 2, 2), (0, 0, 0, 0, 0)], ids=str)
class TestOfTheSameStages:
    @pytest.fixture
    def solvers(self, hold, terminal):
        made = stages(hold, terminal)
        n, at = made.inputs * NU, made.evaluate("at")(*point(made))
        values = at[3].full().ravel()
        bounds = Bounds(np.full(n, -0.4), np.full(n, 0.4), values - 0.02, values + 0.1)
        fields = {
            "name": "same",
            "values": made.rollout("rolled"),
            "bounds": bounds,
            "real": "double",
            "stages": made,
            "relative": True,
        }
        condensed = GaussNewton(linearization=made.evaluate("condensed"), **fields)
        nodes = Stagewise(
            linearization=node_linearization(made, "nodes"), qp_solver="hpipm", **fields
        )
        return condensed, nodes

    def test_products_are_those_of_the_condensed_matrices(self, solvers):
        condensed, _ = solvers
        rng = np.random.default_rng(1)
        d, multipliers = ca.MX(rng.normal(size=condensed.n)), ca.MX(rng.normal(size=condensed.m))
        results = []
        for solver in solvers:
            f, g, H, c, At = solver.linearization(*map(ca.MX, point(solver.stages)))
            H = solver.damped(H, ca.MX(0.2))
            results.append(
                [
                    ca.evalf(value).full()
                    for value in (
                        *(f, g, c, solver.unit(H)),
                        *(solver.curved(H, At, d), solver.changed(H, At, d)),
                        solver.pulled(H, At, multipliers),
                    )
                ]
            )
        for expected, found in zip(*results, strict=True):
            assert_allclose(found, expected, rtol=1e-12, atol=1e-13)

    def test_steps_and_multipliers_are_those_of_the_condensed_program(self, solvers):
        results = []
        for solver in solvers:
            x, p = map(ca.MX, point(solver.stages))
            d, multipliers, distance = solver.step(x, list(solver.linearization(x, p)))
            assert float(ca.evalf(distance)) < 1
            results.append([ca.evalf(value).full() for value in (d, multipliers)])
        # Limits are reached; multipliers of two solvers agree to the interior point's tolerance.
        assert np.abs(results[0][1]).max() > 1e-2
        for expected, found in zip(*results, strict=True):
            assert_allclose(found, expected, atol=1e-7)
