"""A beam with inertia as a control model: its motion, modes, damping and refusals."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.dynamics.inertia import inertial_mesh, station_inertias
from curvcasadi.reference_wings import hale_wing
from curvcasadi.statics.balance import root_wrench

GRAVITY = cc.Gravity([0, 0, 9.80665])


@pytest.fixture(scope="module")
def wing():
    published = hale_wing(torsion=2, out_of_plane=3, in_plane=1)
    section = replace(published.section, inertia=np.diag([0.1, 5e-4, 0.0995]))
    return replace(published, section=section, grid=cc.Grid.lobatto(6))


@pytest.fixture(scope="module")
def model(wing):
    force, stiffness = ca.MX.sym("force", 3), ca.MX.sym("EI_y")
    soft = replace(wing, section=replace(wing.section, EI_y=stiffness))
    loads = [GRAVITY, cc.PointForce(1.0, force)]
    return cc.beam_model(
        soft, loads, inputs={"force": force}, parameters={"EI_y": stiffness}, damping=2e-3
    )


X = np.random.default_rng(1).uniform(-0.03, 0.03, 12)
FORCE = [1.0, -2.0, 5.0]


def test_it_moves_as_the_equations_of_motion_say(wing, model):
    xdot = model.xdot(X, FORCE, 2e4).full().ravel()
    q, q_dot = X[:6], X[6:]
    assert_allclose(xdot[:6], q_dot, rtol=0)
    loads = [GRAVITY, cc.PointForce(1.0, FORCE)]
    left = cc.inverse_dynamics(wing, q, q_dot, xdot[6:], loads).full().ravel()
    stiffness = ca.Function("S", [], [model.second_order.matrices(X, 2e4)[2]]).call([])[0].full()
    # Rounding of elastic forces of EI_z.
    assert_allclose(left, -2e-3 * stiffness @ q_dot, atol=1e-12 * np.abs(stiffness).max())
    forward = cc.forward_dynamics(wing, q, q_dot, loads) + ca.solve(
        cc.mass_matrix(wing, q), ca.DM(-2e-3 * stiffness @ q_dot)
    )
    assert_allclose(xdot[6:], forward.full().ravel(), rtol=1e-9)


def test_its_balance_carries_the_structured_derivatives(model):
    f = model.second_order.balance
    symbols = [ca.MX.sym(name, size) for name, size in zip("xaup", (12, 6, 3, 1), strict=True)]
    slope = ca.jacobian(f(*symbols)[0], symbols[0])
    names = {g.name() for g in ca.Function("J", symbols, [slope]).find_functions()}
    assert "jac_beam_residual" in names
    assert not any(name.startswith(("fwd", "adj")) and "element" in name for name in names)


def test_its_layouts_name_what_the_user_named(wing, model):
    assert [part.name for part in model.x.parts] == ["q", "q_dot"]
    assert model.u.labels == ("force[0], SI", "force[1], SI", "force[2], SI")
    assert [part.name for part in model.p.parts] == ["EI_y"]
    assert_allclose(model.x.bounds[0][:6], wing.bounds[0])
    y = model.y.split(model.output(X, FORCE, 2e4))
    assert_allclose(y["position"], cc.pose_at(wing, X[:6], 1.0).position, atol=1e-13)


@pytest.mark.parametrize("entries, by", [(12, 0), (3, 1), (1, 2)], ids=["x", "u", "p"])
def test_derivatives_are_those_of_the_motion(model, entries, by):
    symbols = [ca.MX.sym("x", 12), ca.MX.sym("u", 3), ca.MX.sym("p")]
    slope = ca.Function("J", symbols, [ca.jacobian(model.xdot(*symbols), symbols[by])])
    at = [X, np.array(FORCE), np.array([2e4])]
    found = slope(*at).full()
    for k in range(entries):
        h = 1e-6 * max(1.0, np.abs(at[by]).max())
        ends = []
        for sign in (1, -1):
            moved = [value.copy() for value in at]
            moved[by][k] += sign * h
            ends.append(model.xdot(*moved).full())
        expected = (ends[0] - ends[1]) / (2 * h)
        # Rounding of accelerations, some 1e4 rad/(m s²) of EI_z, over h.
        assert_allclose(found[:, [k]], expected, atol=1e-6 * np.abs(found).max() + 1e-7)


def test_the_mass_matrix_is_not_differentiated(model):
    names = {f.name() for f in model.xdot.jacobian().find_functions()}
    assert not [name for name in names if "masses" in name and name.startswith(("fwd", "adj"))]


def test_damping_ratios_are_those_of_kelvin_and_voigt(wing):
    """C = β S damps a mode of frequency ω by β ω/2, whatever the mode: about the straight wing."""
    beta = 1e-3
    free = cc.linearize(cc.beam_model(wing), np.zeros(12)).eigenvalues
    damped = cc.linearize(cc.beam_model(wing, damping=beta), np.zeros(12)).eigenvalues
    frequencies = np.sort(np.abs(free.imag))[::2]
    oscillating = damped[damped.imag > 0]
    below = frequencies[beta * frequencies / 2 < 1][: len(oscillating)]
    ratios = -oscillating.real / np.abs(oscillating)
    assert len(below) >= 4
    assert_allclose(np.sort(ratios)[: len(below)], beta * below / 2, rtol=1e-9)


def test_modes_have_the_damping_ratios_that_were_asked_for(wing):
    """About a bent equilibrium, where loads add stiffness of their own."""
    loads, ratios = [GRAVITY, cc.PointForce(1.0, [0, 0, -80.0])], [0.02, 0.005]
    q = cc.solve_equilibrium(wing, loads).q.full().ravel()
    damping = cc.modal_damping(wing, ratios, q, loads)
    model = cc.beam_model(wing, loads, damping=damping, outputs=["position"])
    found = cc.linearize(model, {"q": q}).eigenvalues
    upper = found[found.imag > 0]
    upper = upper[np.argsort(np.abs(upper))]
    assert_allclose(-upper.real / np.abs(upper), [0.02, *[0.005] * 5], rtol=1e-7)
    assert_allclose(np.abs(upper), cc.natural_frequencies(wing, q, loads), rtol=1e-9)


@pytest.mark.parametrize(
    "ratios, options, message",
    [
        (-0.1, {}, r"ratios: expected numbers of at least zero, found -0.1"),
        ([0.1] * 7, {}, r"ratios: expected 1 to 6 numbers, found shape \(7,\)"),
        ([], {}, r"ratios: expected 1 to 6 numbers"),
        ("much", {}, r"ratios: expected numbers"),
        (0.1, {"root": cc.RootMotion(twist=[0, 0, 9, 0, 0, 0])}, r"loads, root: expected modes w"),
    ],
)
def test_wrong_damping_ratios_are_refused(wing, ratios, options, message):
    with pytest.raises(ValueError, match=message):
        cc.modal_damping(wing, ratios, **options)


def test_the_root_carries_what_newton_says(wing, model):
    """Force = loads − d²/dt² Σ m p, the mass moment by the potential in each direction."""
    q = ca.MX.sym("q", 6)
    moments = [cc.potential_energy(wing, q, [cc.Gravity(-axis)]) for axis in np.eye(3)]
    moment = ca.vertcat(*moments) - cc.strain_energy(wing, q)
    slope = ca.jacobian(moment, q)
    rate, acceleration = ca.MX.sym("rate", 6), ca.MX.sym("acceleration", 6)
    second = slope @ acceleration + ca.jtimes(slope @ rate, q, rate)
    f = ca.Function("second", [q, rate, acceleration], [second])
    xdot = model.xdot(X, FORCE, 2e4)
    mass = 16 * 0.75
    expected = np.array([0, 0, mass * 9.80665]) + FORCE - f(X[:6], X[6:], xdot[6:]).full().ravel()
    y = model.y.split(model.output(X, FORCE, 2e4))
    assert_allclose(wing.root.rotation @ y["root_force"], expected[:, None], rtol=1e-9)


def test_at_rest_the_root_carries_the_loads(wing, model):
    loads = [GRAVITY, cc.PointForce(1.0, FORCE)]
    q = cc.solve_equilibrium(wing, loads).q
    y = model.y.split(model.output(ca.vertcat(q, ca.DM.zeros(6)), FORCE, 2e4))
    total = ca.vertcat(y["root_moment"], y["root_force"])
    expected = root_wrench(wing, q, loads)  # about the parent origin, where the root is
    turned = ca.diagcat(wing.root.rotation, wing.root.rotation) @ total
    assert_allclose(turned, expected, atol=1e-9 * float(ca.norm_inf(expected)))


def test_only_outputs_that_are_wanted_are_there(wing):
    few = cc.beam_model(wing, outputs=["root_force", "position"])
    assert [part.name for part in few.y.parts] == ["position", "root_force"]
    assert cc.beam_model(wing, outputs=[]).output(np.zeros(12), [], []).shape == (0, 1)
    with pytest.raises(ValueError, match=r"outputs: expected one of 'position'.*found 'tip'"):
        cc.beam_model(wing, outputs=["tip"])


def test_outputs_of_a_wing_whose_length_is_a_parameter(wing):
    length = ca.MX.sym("length")
    model = cc.beam_model(replace(wing, length=length), [GRAVITY], parameters={"length": length})
    fixed = cc.beam_model(wing, [GRAVITY])
    found, expected = model.output(X, [], 16.0), fixed.output(X, [], [])
    assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def potential(wing, q):
    """Strain energy and −Σ m g·p at the stations of the inertia, J."""
    mesh = inertial_mesh(wing, [])
    masses = [float(ca.DM(data)[0]) for data in station_inertias(wing, mesh).data]
    heights = [float(cc.pose_at(wing, q, xi).position[2]) for xi in mesh.stations]
    return float(cc.strain_energy(wing, q)) - 9.80665 * float(np.dot(masses, heights))


def test_energy_is_kept_by_the_implicit_midpoint_rule(wing):
    """Released straight under gravity: T + U − Σ m g·p stays what it was, zero."""
    model = cc.beam_model(wing, [GRAVITY])
    result = cc.simulate(
        model, np.zeros(12), np.linspace(0, 0.5, 6), method="implicit_midpoint", dt=0.005
    )
    assert result.success and result.iterations < 5
    motions = list(zip(result.part("q").T, result.part("q_dot").T, strict=True))
    kinetic = np.array([float(cc.kinetic_energy(wing, q, q_dot)) for q, q_dot in motions])
    total = kinetic + [potential(wing, q) for q, _ in motions]
    assert kinetic.max() > 10  # J, so it moved
    # The rule keeps quadratic energies; the rest is (ω h)² of the nonlinear part.
    assert_allclose(total, total[0], atol=1e-6 * kinetic.max())


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"loads": [cc.PointForce(1.0, ca.MX.sym("F", 3))]}, r"F.*: expected an input or a param"),
        ({"inputs": {"f": ca.SX.sym("f")}}, r"inputs\['f'\]: expected an MX symbol"),
        ({"inputs": {"f": 3.0}}, r"inputs\['f'\]: expected an MX symbol"),
        (
            {"inputs": {"f": ca.MX.sym("f")}, "parameters": {"f": ca.MX.sym("f")}},
            r"parameters: expected names other than inputs', found 'f'",
        ),
        (
            {"inputs": {"f": ca.MX.sym("f")}},
            r"inputs: expected symbols .* 'f', which acts",
        ),
        ({"parameters": {"m": ca.MX.sym("m")}}, r"parameters: expected symbols .* 'm', which acts"),
        ({"damping": -1.0}, r"damping: expected a time of at least zero"),
        ({"damping": np.eye(3)}, r"damping: expected a number or a matrix \(6, 6\)"),
        ({"damping": -np.eye(6)}, r"damping: expected a matrix that takes energy out"),
        ({"inputs": {"f g": ca.MX.sym("f")}}, r"name in inputs: expected letters"),
        ({"inputs": dict.fromkeys("fg", ca.MX.sym("f"))}, r"of its own .* 'f' and 'g'"),
        ({"curvature_stations": 0.5}, r"curvature_stations: expected a sequence, found 0.5"),
        ({"curvature_stations": [1.5]}, r"curvature_stations: expected a number in"),
    ],
)
def test_wrong_arguments_are_refused_by_name(wing, arguments, message):
    with pytest.raises(ValueError, match=message):
        cc.beam_model(wing, **arguments)


def test_symbols_act_wherever_they_stand(wing):
    f, g, h = (ca.MX.sym(name, 3) for name in "fgh")
    beta, length, mass = (ca.MX.sym(name) for name in ("beta", "length", "mass"))
    beam = replace(wing, length=length, section=replace(wing.section, mass_per_length=mass))
    loads = [
        cc.PointForce(0.0, f),  # at the root: the reactions alone
        cc.Gravity(g),
        cc.DistributedForce(h),
    ]
    parameters = {"beta": beta, "length": length, "mass": mass, "g": g, "h": h}
    model = cc.beam_model(beam, loads, {"f": f}, parameters, beta, outputs=["position"])
    assert [part.name for part in (*model.u.parts, *model.p.parts)] == ["f", *parameters]


def test_an_input_in_the_section_is_refused(wing):
    stiffness = ca.MX.sym("EI_y")
    soft = replace(wing, section=replace(wing.section, EI_y=stiffness))
    with pytest.raises(ValueError, match=r"EI_y: expected a parameter"):
        cc.beam_model(soft, inputs={"EI_y": stiffness})
