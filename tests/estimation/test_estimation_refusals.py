"""Symbols, and what is no sequence of names, in arguments of estimators are named."""

from __future__ import annotations

import numpy as np
import pytest

import curvcasadi as cc

BEAM = cc.Beam(
    length=4.0, basis=cc.ChannelBasis(out_of_plane=cc.Legendre(3)), grid=cc.Grid.uniform(4)
)
GYRO = cc.RateGyro(xi=0.5, noise_density=1e-3, rate=100.0)
MARKER = cc.Marker(xi=1.0, noise=0.01)
TIP, ZERO = [4.0, 0.0, 0.0], np.zeros(3)
WHITE = {"process": "white_acceleration", "density": 0.1}
PRIOR = {"shapes": ZERO, "prior": 0.1}

#: Calls with an argument of a size that a symbol may have, by the argument and what it is of.
VECTORS = {
    "q_dot of a fit": lambda x: cc.fit_shape(BEAM, [GYRO], ZERO, q_dot=x),
    "q_ddot of a fit": lambda x: cc.fit_shape(BEAM, [GYRO], ZERO, q_dot=ZERO, q_ddot=x),
    "q_guess of a fit": lambda x: cc.fit_shape(BEAM, [MARKER], TIP, q_guess=x),
    "prior mean of a fit": lambda x: cc.fit_shape(BEAM, [MARKER], TIP, prior=(x, 0.1)),
    "prior covariance of a fit": lambda x: cc.fit_shape(BEAM, [MARKER], TIP, prior=(ZERO, x)),
    "measurements of a fit": lambda x: cc.fit_shape(BEAM, [MARKER], x),
    "shapes of an information": lambda x: cc.information_matrix(BEAM, [MARKER], x),
    "rates of an information": lambda x: cc.information_matrix(BEAM, [GYRO], ZERO, x),
    "q of deviations": lambda x: cc.shape_deviations(BEAM, x, np.eye(3)),
    "covariance of deviations": lambda x: cc.shape_deviations(BEAM, ZERO, x),
    "stations of deviations": lambda x: cc.shape_deviations(BEAM, ZERO, np.eye(3), x),
    "costs of a placement": lambda x: cc.place_sensors(BEAM, [MARKER], 1, costs=x, **PRIOR),
}
NUMBERS = {
    "gate of a filter": lambda x: cc.shape_ekf(BEAM, [MARKER], gate=x, **WHITE),
    "loss_scale of a fit": lambda x: cc.fit_shape(BEAM, [MARKER], TIP, loss="huber", loss_scale=x),
    "budget of a placement": lambda x: cc.place_sensors(
        BEAM, [MARKER], costs=1.0, budget=x, **PRIOR
    ),
}
NAMES = {
    "root_inputs of a filter": lambda x: cc.shape_ekf(BEAM, [MARKER], root_inputs=x, **WHITE),
    "root_inputs of an estimator": lambda x: cc.shape_mhe(
        BEAM, [MARKER], dt=0.1, window=1, root_inputs=x, **WHITE
    ),
    "unknowns of an information": lambda x: cc.information_matrix(BEAM, [MARKER], ZERO, unknowns=x),
    "inputs of a function": lambda x: cc.measurement_function("m", [MARKER], BEAM, x),
}


def argument(case):
    return case.partition(" of ")[0]


@pytest.mark.parametrize("case", VECTORS)
def test_symbols_for_vectors_are_named(symbolic, case):
    with pytest.raises(ValueError, match=rf"^{argument(case)}: expected numbers, found"):
        VECTORS[case](symbolic.sym("x", 3))


@pytest.mark.parametrize("case", NUMBERS)
def test_symbols_for_numbers_are_named(symbolic, case):
    with pytest.raises(ValueError, match=rf"^{argument(case)}: expected numbers, found"):
        NUMBERS[case](symbolic.sym("x"))


@pytest.mark.parametrize("case", NAMES)
def test_what_is_no_sequence_of_names_is_named(symbolic, case):
    for wrong in (symbolic.sym("x", 2), 3.0, "twists", ["q", "q", "speed"]):
        with pytest.raises(ValueError, match=rf"^{argument(case)}: expected"):
            NAMES[case](wrong)


def test_a_gate_may_be_open():
    assert cc.shape_ekf(BEAM, [MARKER], gate=np.inf, **WHITE).update.name() == "ekf_update"
