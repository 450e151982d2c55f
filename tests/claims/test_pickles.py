"""Public objects pickle and deep-copy: for processes of a pool, caches and notebooks."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

WING = hale_wing()
WEIGHTS = np.linspace(-0.02, 0.02, 9)
SENSORS = [
    cc.AttitudeSensor(xi=1.0, noise=0.01),
    cc.StrainGauge(xi=0.3, offset=[0.0, 0.01], noise=1e-6),
    cc.Camera(xi=1.0, pose=cc.Pose.identity(), noise=1e-3),
]
STEPS = cc.Steps([0, 0.4, 1], [np.diag([1.0, 2, 3]), np.diag([2.0, 3, 4])])
OBJECTS = {
    "beam": lambda: WING,
    "mirrored beam": lambda: cc.mirror(WING),
    "section of steps": lambda: cc.Section.from_stiffness(STEPS, mass_per_length=1.0),
    "mirrored section of steps": lambda: cc.mirror(
        cc.Beam(
            length=1.0,
            basis=cc.ChannelBasis(out_of_plane=cc.Tabulated([0, 1], [[0], [1]])),
            grid=cc.Grid(boundaries=[0, 0.5, 1]),
            section=cc.Section.from_stiffness(STEPS),
        )
    ),
    "shape": lambda: cc.shape_map(WING, WEIGHTS),
    "equilibrium": lambda: cc.solve_equilibrium(WING, [cc.PointForce(1.0, [0, 0, -30.0])]),
    "loads": lambda: [cc.Gravity([0, 0, 9.81]), cc.PointMoment(1.0, [1, 0, 0])],
    "target": lambda: cc.Target(xi=1.0, position=[0, 1, 2]),
    "sensors": lambda: SENSORS,
    "measurement": lambda: cc.measure(SENSORS[:2], WING, WEIGHTS),
    "fit": lambda: cc.fit_shape(
        WING, SENSORS[:1], cc.measure(SENSORS[:1], WING, WEIGHTS).values, prior=(WEIGHTS, 0.1)
    ),
    "aircraft": lambda: cc.load_aircraft(
        Path(__file__).parents[2] / "ocp_examples" / "hale_aircraft.toml"
    ),
    "function": lambda: cc.tip_function(WING),
    "model": lambda: cc.kinematic_model(WING, time_constant=0.1),
    "filter": lambda: cc.shape_ekf(
        WING, SENSORS[:1], process="white_acceleration", density=0.1, acceleration=0.1
    ),
    "failure": lambda: cc.ConvergenceError("missed", 3),
}


def numbers_of(value):
    """What can be compared of an object: its text without addresses."""
    return [word for word in str(value).split() if "0x" not in word]


@pytest.mark.parametrize("name", OBJECTS)
def test_public_objects_pickle_and_copy(name):
    value = OBJECTS[name]()
    for again in (copy.deepcopy(value), pickle.loads(pickle.dumps(value))):
        assert type(again) is type(value)
        assert numbers_of(again) == numbers_of(value)


def test_a_copied_beam_has_the_same_shape_and_stiffness():
    again = pickle.loads(pickle.dumps(cc.mirror(WING)))
    plain = cc.mirror(WING)
    tips = [cc.shape_map(beam, WEIGHTS).tip.position for beam in (again, plain)]
    np.testing.assert_array_equal(*tips)
    energies = [float(cc.strain_energy(beam, WEIGHTS)) for beam in (again, plain)]
    assert energies[0] == energies[1]


def test_symbols_pickle_within_a_context_of_casadi():
    length = ca.SX.sym("length")
    beam = cc.Beam(
        length=length, basis=cc.ChannelBasis(torsion=cc.Legendre(1)), grid=cc.Grid.uniform(2)
    )
    with ca.global_pickle_context():
        text = pickle.dumps(beam)
    with ca.global_unpickle_context():
        again = pickle.loads(text)
    assert str(again.length) == "length"
    assert ca.is_equal(copy.deepcopy(beam).length, length)
