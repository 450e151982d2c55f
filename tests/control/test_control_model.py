"""Control models: state, input, parameter and output of a beam."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

Q = np.random.default_rng(1).uniform(-0.03, 0.03, 9)


@pytest.fixture(scope="module")
def beam():
    """The published wing with bounds that differ from weight to weight."""
    upper = np.linspace(0.1, 0.2, 9)
    return replace(hale_wing(), weight_bounds=(-upper / 2, upper))


@pytest.fixture(scope="module")
def model(beam):
    return cc.kinematic_model(beam, time_constant=0.5)


def test_weights_follow_command_and_disturbance_with_a_lag(beam):
    tau = np.linspace(0.1, 0.9, 9)
    model = cc.kinematic_model(beam, time_constant=tau)
    command, disturbance = Q[::-1], 0.1 * Q
    # Three operations an entry.
    assert_allclose(
        model.xdot(Q, command, disturbance).full().ravel(),
        (command + disturbance - Q) / tau,
        rtol=1e-13,
    )


def test_state_and_input_carry_the_weight_bounds(beam, model):
    for layout in (model.x, model.u):
        assert layout.size == beam.basis.n
        assert_allclose(layout.bounds, beam.bounds, rtol=0)
    assert not np.any(np.isfinite(model.p.bounds))
    assert_allclose(cc.kinematic_model(beam, time_constant=1).x.bounds, beam.bounds, rtol=0)


def test_outputs_are_the_pose_of_the_tip_and_the_curvatures(beam, model):
    y = model.y.split(model.output(Q, 0, 0))
    tip = cc.pose_at(beam, Q, 1.0)
    # The same formulas in another Function: rounding of 16 m.
    assert_allclose(y["position"], tip.position, atol=1e-13)
    assert_allclose(ca.reshape(y["rotation"], 3, 3), tip.rotation, atol=1e-14)
    expected = np.concatenate([beam.basis(xi) @ Q for xi in (0, 0.25, 0.5, 0.75, 1)])
    assert_allclose(y["curvature"].full().ravel(), expected, atol=1e-16)


def test_curvature_stations_can_be_chosen(beam):
    model = cc.kinematic_model(beam, time_constant=1, curvature_stations=[0.3])
    y = model.y.split(model.output(Q, 0, 0))
    assert_allclose(y["curvature"].full().ravel(), beam.basis(0.3) @ Q, atol=1e-16)  # rounding
    assert cc.kinematic_model(beam, time_constant=1, curvature_stations=[]).y.size == 12


def test_initial_curvature_is_in_the_output(beam):
    bent = replace(beam, initial_curvature=[0.01, -0.02, 0.03])
    model = cc.kinematic_model(bent, time_constant=1)
    y = model.y.split(model.output(np.zeros(9), 0, 0))
    assert_allclose(y["curvature"].full().ravel(), 5 * [0.01, -0.02, 0.03], rtol=1e-15)  # copies


def test_derivatives_of_the_output_use_the_structured_jacobian(model):
    x, u, p = (ca.MX.sym(name, 9) for name in "xup")
    jacobian = ca.Function("J", [x, u, p], [ca.jacobian(model.output(x, u, p), x)])
    names = {f.name() for f in jacobian.find_functions()}
    assert "jac_tip" in names
    assert not [n for n in names if n.startswith(("fwd", "adj")) and "element" in n]
    h = 1e-6
    differences = [
        (model.output(Q + h * e, 0, 0) - model.output(Q - h * e, 0, 0)).full() / (2 * h)
        for e in np.eye(9)
    ]
    # Central differences: h² times third derivatives of up to 16⁴ m, and rounding over h.
    assert_allclose(jacobian(Q, 0, 0).full(), np.hstack(differences), atol=2e-6)


def test_all_functions_share_their_signature(model):
    for f, output in ((model.xdot, "xdot"), (model.output, "y")):
        assert f.name_in() == ["x", "u", "p"]
        assert f.name_out() == [output]


@pytest.mark.parametrize(
    "tau", [0, -1, np.nan, np.inf, [1, 2], [[1.0]] * 8, [1] * 8 + [0], "slow", ca.SX.sym("tau")]
)
def test_wrong_time_constants_are_refused(beam, tau):
    with pytest.raises(ValueError, match=r"time_constant: expected .*, found"):
        cc.kinematic_model(beam, time_constant=tau)


@pytest.mark.parametrize("stations", [[1.1], [-0.1], [np.nan], [ca.MX.sym("xi")]])
def test_wrong_curvature_stations_are_refused(beam, stations):
    with pytest.raises(ValueError, match=r"curvature_stations: expected .*, found"):
        cc.kinematic_model(beam, time_constant=1, curvature_stations=stations)


@pytest.mark.parametrize(
    "field, value",
    [("length", ca.MX.sym("L")), ("initial_curvature", ca.MX.sym("K0", 3))],
    ids=["length", "initial_curvature"],
)
def test_design_symbols_are_refused_by_name(beam, field, value):
    with pytest.raises(ValueError, match=rf"Beam\.{field}: .*needs numbers, found a symbol"):
        cc.kinematic_model(replace(beam, **{field: value}), time_constant=1)


def test_a_model_prints_the_parts_of_its_vectors(beam):
    lines = str(cc.kinematic_model(beam, time_constant=0.2)).splitlines()
    assert "kinematic" in lines[0] and len(lines) < 20 and max(map(len, lines)) <= 100
    assert f"  x  q ({beam.basis.n}, rad/m)" in lines
