"""Sensors read what the model of the wing does."""

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

BEAM = hale_wing(1, 2, 1, grid=cc.Grid.lobatto(3))
ROOT = cc.RootMotion(gravity=[0, 0, 9.80665])
SENSORS = (
    cc.Accelerometer(xi=1.0, noise_density=1e-3, rate=100.0),
    cc.StrainGauge(xi=0.1, offset=[0, 0.05], noise=1e-5),
)


def hanging():
    """The wing under its weight and a force at the tip, N."""
    force = ca.MX.sym("force")
    loads = [
        cc.Gravity([0, 0, 9.80665]),
        cc.PointForce(xi=1.0, force=ca.vertcat(0, 0, force), frame="dead"),
    ]
    return cc.beam_model(BEAM, loads, {"force": force})


def test_an_accelerometer_at_rest_reads_gravity_and_feels_a_force_at_once():
    model = hanging()
    q = cc.solve_equilibrium(BEAM, [cc.Gravity([0, 0, 9.80665])]).q
    read = cc.readings_function(model, BEAM, SENSORS, root=ROOT)
    x = np.r_[q.full().ravel(), np.zeros(4)]
    rest, pushed = (read(x, force, []).full().ravel() for force in (0.0, 5.0))
    # Gravity is held by the elastic forces: the tip does not accelerate.
    assert np.linalg.norm(rest[:3]) == pytest.approx(9.80665, rel=1e-6)
    # A strain gauge feels the force only when the wing has moved.
    assert np.linalg.norm(pushed[:3] - rest[:3]) > 1
    assert pushed[3] == rest[3]


def test_mistakes_are_named():
    model = hanging()
    with pytest.raises(ValueError, match="model: expected a state with parts q and q_dot of 9"):
        cc.readings_function(model, hale_wing(), SENSORS, root=ROOT)
    kinematic = cc.kinematic_model(BEAM, time_constant=1.0)
    with pytest.raises(ValueError, match="model: expected a state with parts q and q_dot of 4"):
        cc.readings_function(kinematic, BEAM, SENSORS, root=ROOT)
    with pytest.raises(ValueError, match="beam: expected a Beam"):
        cc.readings_function(model, None, SENSORS)
