"""Structured derivatives against AD of Lagrange's equations, and how CasADi uses them."""

from dataclasses import dataclass, replace
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.loads.stations import Load
from tests.support.lagrangian import lagrange_function
from tests.support.moving_wing import GRAVITY, STATES, N, close, motion, wing

WEIGHT = [cc.Gravity(GRAVITY)]


def blocks(f, *values):
    """Derivatives of the first output of `f` by each input."""
    symbols = [ca.MX.sym(f"x{i}", f.sparsity_in(i)) for i in range(f.n_in())]
    value = f.call(symbols)[0]
    jacobians = [ca.jacobian(value, x) for x in symbols]
    return ca.Function("blocks", symbols, jacobians).call([ca.DM(x) for x in values])


@pytest.fixture(scope="module")
def of_lagrange():
    return blocks(lagrange_function(few_elements(), GRAVITY), *motion())


def few_elements():
    """The wing without breaks: AD of Lagrange's equations takes seconds."""
    section = replace(wing().section, mass_per_length=0.75)
    return wing(section=section, bodies=wing().bodies[:1], grid=cc.Grid.lobatto(3))


@pytest.mark.parametrize("form", ["compact", "unrolled"])
def test_derivatives_are_those_of_lagrange(of_lagrange, form):
    values = motion()
    found = blocks(cc.inverse_dynamics_function(few_elements(), WEIGHT, form=form), *values)
    for block, expected in zip(found, of_lagrange, strict=True):
        close(block, expected, 1e-13)
    close(found[2], cc.mass_matrix(few_elements(), values[0]), 1e-14)


@pytest.mark.parametrize("rule", ["midpoint", "magnus6"])
def test_derivatives_of_other_rules_are_those_of_their_residual(rule):
    values = motion(seed=1)
    symbols = [ca.SX.sym(name, N) for name in STATES]
    residual = cc.inverse_dynamics(wing(rule), *symbols, WEIGHT)
    expected = blocks(ca.Function("r", symbols, [residual]), *values)
    found = blocks(cc.inverse_dynamics_function(wing(rule), WEIGHT), *values)
    for block, by_ad in zip(found, expected, strict=True):
        close(block, by_ad)


@dataclass(frozen=True, eq=False)
class Drag(Load):
    """A load that depends on all that a formula may take; no physics."""

    order: ClassVar[int] = 2
    factor: object

    def contributions(self, beam, mesh, to_parent):
        for node in range(len(mesh.stations)):
            yield node, ca.vertcat(self.factor, 0.1 * (1 + node))

    @staticmethod
    def wrench(rotation, position, data, twist, acceleration):
        speed = twist[3:] + ca.vertcat(0.3, -1.0, 0.5)
        force = -data[0] * ca.sumsqr(speed) * speed - data[1] * acceleration[3:]
        moment = -data[1] * (acceleration[:3] + twist[:3]) + data[0] * position
        force, moment = rotation @ force, rotation @ moment
        return ca.vertcat(moment + ca.cross(position, force), force)


def test_derivatives_by_states_and_parameters_of_every_kind_are_those_of_the_residual():
    symbols = {
        "force": ca.SX.sym("force", 3),
        "mass": ca.SX.sym("mass"),
        "EI_y": ca.SX.sym("EI_y"),
        "twist": ca.SX.sym("twist", 6),
        "twist_rate": ca.SX.sym("twist_rate", 6),
        "fall": ca.SX.sym("fall"),
        "pitch": ca.SX.sym("pitch"),
        "drag": ca.SX.sym("drag"),
    }
    point = [[1.0, 4.0, -20.0], 0.9, 1.5e4, [0.2, -0.3, 0.1, 4.0, 1.0, -2.0]]
    point += [[0.5, 0.1, -0.7, 1.0, 2.0, -1.0], 9.7, 0.3, 0.05]
    section = replace(wing().section, mass_per_length=symbols["mass"], EI_y=symbols["EI_y"])
    beam = wing(section=section)
    loads = [
        cc.PointForce(1.0, symbols["force"], "follower", offset=[0, 0.2, 0.1]),
        cc.PointForce(0.3, symbols["force"], "dead"),
        Drag(symbols["drag"]),
    ]
    root = cc.RootMotion(
        pose=cc.Pose(
            rotation=cc.lie.so3.exp(ca.vertcat(0.1, symbols["pitch"], -0.2)), position=[0, 0, 0]
        ),
        twist=symbols["twist"],
        twist_rate=symbols["twist_rate"],
        gravity=ca.vertcat(0.3, 0, symbols["fall"]),
    )
    f = cc.inverse_dynamics_function(beam, loads, symbols, root=root, form="unrolled")
    states = [ca.SX.sym(name, N) for name in STATES]
    residual = cc.inverse_dynamics(beam, *states, loads, root)
    plain = ca.Function("plain", [*states, *symbols.values()], [residual])
    values = [*motion(seed=3), *point]
    close(f(*values), plain(*values))
    for name, block, by_ad in zip(
        f.name_in(), blocks(f, *values), blocks(plain, *values), strict=True
    ):
        assert float(ca.norm_inf(by_ad)) > 0, name
        close(block, by_ad, 1e-11)


def test_small_derivatives_by_reverse_sweeps_are_the_same():
    force = ca.MX.sym("force", 3)
    loads, values = [*WEIGHT, cc.PointForce(1.0, force, "follower")], [*motion(), [1.0, 4.0, -20.0]]
    structured = cc.inverse_dynamics_function(wing(), loads, {"force": force})
    small = cc.inverse_dynamics_function(wing(), loads, {"force": force}, small=True)
    for block, expected in zip(blocks(small, *values), blocks(structured, *values), strict=True):
        close(block, expected, 1e-13)
    with pytest.raises(ValueError, match="form: expected 'compact'"):
        cc.inverse_dynamics_function(wing(), form="unrolled", small=True)


@pytest.mark.parametrize("form", ["compact", "unrolled"])
def test_derivatives_of_forward_dynamics_are_those_of_its_expression(form):
    kind = ca.MX if form == "compact" else ca.SX
    force, values = kind.sym("force", 3), [*motion()[:2], [1.0, 4.0, -20.0]]
    loads = [*WEIGHT, cc.PointForce(1.0, force, "follower")]
    f = cc.forward_dynamics_function(wing(), loads, {"force": force}, form=form)
    states = [kind.sym(name, N) for name in STATES[:2]]
    plain = ca.Function("plain", [*states, force], [cc.forward_dynamics(wing(), *states, loads)])
    close(f(*values), plain(*values))
    for block, by_ad in zip(blocks(f, *values), blocks(plain, *values), strict=True):
        close(block, by_ad, 1e-10)  # the condition of the mass matrix
    x = [ca.MX.sym(name, N) for name in STATES[:2]]
    jacobian = ca.Function("J", x, [ca.jacobian(f(*x, values[2]), x[0])])
    assert "jac_forward_dynamics" in {g.name() for g in jacobian.find_functions()}


def test_forward_dynamics_refuse_loads_that_have_mass():
    q, q_dot, _ = motion()
    with pytest.raises(ValueError, match="do not depend on accelerations"):
        cc.forward_dynamics(wing(), q, q_dot, [Drag(0.1)])


def test_casadi_uses_the_attached_derivative_and_second_derivatives_follow():
    f = cc.inverse_dynamics_function(wing(), WEIGHT)
    x = [ca.MX.sym(name, N) for name in STATES]
    jacobian = ca.Function("J", x, [ca.jacobian(f(*x), x[0])])
    names = {g.name() for g in jacobian.find_functions()}
    assert "jac_inverse_dynamics" in names
    assert not any(name.startswith("fwd") for name in names)
    straight = [np.zeros(N)] * 3
    hessian = ca.Function("H", x, [ca.jacobian(ca.jacobian(f(*x), x[1])[:, 0], x[1])])
    assert np.all(np.isfinite(hessian(*straight).full()))


def test_the_compact_derivative_has_no_derivatives_of_the_chain():
    f = cc.inverse_dynamics_function(wing(), WEIGHT).jacobian()
    names = {g.name() for g in f.find_functions()}
    assert {"element_tangents", "element_field", "station_inertia", "element_sums"} <= names
    assert not any(name.startswith(("fwd", "adj")) for name in names)


def test_symbols_that_are_not_parameters_are_named():
    force = ca.MX.sym("force", 3)
    with pytest.raises(ValueError, match="missing force"):
        cc.inverse_dynamics_function(wing(), [cc.PointForce(1.0, force)])
    with pytest.raises(ValueError, match=r"Beam\.length"):
        cc.inverse_dynamics_function(wing(length=ca.MX.sym("length")))
    with pytest.raises(ValueError, match="names of their own"):
        cc.inverse_dynamics_function(wing(), parameters={"q": force})
