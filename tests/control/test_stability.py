"""Longest stable steps against the spectral radius of the steps themselves."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.control.stability import stable_step, unstable_step
from curvcasadi.reference_wings import hale_wing
from tests.support.strip_wings import hale


def beam(damping):
    wing = replace(
        hale_wing(grid=cc.Grid.lobatto(4)), basis=cc.ChannelBasis(torsion=cc.Legendre(3))
    )
    return cc.beam_model(wing, damping=damping)


def in_air(density):
    return cc.wing_model(hale((1, 2, 0), 3), density=density, lag=cc.IndicialLag(poles=2, modes=1))


MODELS = {
    "undamped": lambda: (beam(0.0), []),
    "lightly damped": lambda: (beam(0.003), []),
    "real modes": lambda: (beam(0.5), []),
    "in air, slow": lambda: (in_air(0.0889), [5.0, 0.0]),
    "lag of the air": lambda: (in_air(1e-12), [1e5, 0.0]),
    "first order": lambda: (cc.kinematic_model(hale_wing(1, 1, 1), time_constant=0.1), []),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_step_up_to_the_limit_is_stable_and_no_longer_one(name):
    model, p = MODELS[name]()
    x, u, p = np.zeros(model.x.size), np.zeros(model.u.size), np.array(p)
    limit, frequency = stable_step(model, x, u, p)
    assert 2.6 < limit * frequency < 3.0
    h, state = ca.MX.sym("h"), ca.MX.sym("x", model.x.size)
    step = cc.control.step.rk4(model, h, state, ca.MX(u), ca.MX(p))
    slope = ca.Function("slope", [state, h], [ca.jacobian(step, state)])
    room = 0.02 if name == "in air, slow" else 1e-3  # which damps a little

    def growth(h):
        return abs(np.linalg.eigvals(slope(x, h).full())).max()

    assert growth((1 - room) * limit) < 1 + 1e-9
    assert growth((1 + room) * limit) > 1 + room / 10
    assert unstable_step(model, (1 - room) * limit, x, u, p) is None
    words = unstable_step(model, (1 + room) * limit, x, u, p)
    assert ("'implicit_midpoint'" in words) == (model.second_order is not None)


def test_where_there_are_no_modes_no_step_is_refused():
    model = beam(0.0)
    lost = np.full(model.x.size, np.nan)
    assert stable_step(model, lost, np.zeros(0), np.zeros(0)) == (np.inf, 0.0)
    integrator = cc.ControlModel(
        name="integrator",
        x=cc.Layout((cc.Part("x", 1, "m"),)),
        u=cc.Layout((cc.Part("u", 1, "m/s"),)),
        p=cc.Layout(()),
        y=cc.Layout(()),
        xdot=ca.Function("f", [x := ca.MX.sym("x"), u := ca.MX.sym("u"), ca.MX.sym("p", 0)], [u]),
        output=ca.Function("h", [x, u, ca.MX.sym("p", 0)], [ca.MX(0, 1)]),
    )
    assert stable_step(integrator, np.zeros(1), np.zeros(1), np.zeros(0)) == (np.inf, 0.0)
