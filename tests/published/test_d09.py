"""Published case D09: flutter and divergence of the straight HALE wing.

M. J. Patil, D. H. Hodges, C. E. S. Cesnik, J. Aircraft 38(1), 2001; the exact rows by the transfer
matrix of the bending-torsion equations with Theodorsen's function.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support.strip_wings import hale

#: Largest relative error of flutter speed and frequency.
LIMITS = {2: (0.006, 0.015), 3: (0.005, 0.005), 4: (0.0015, 0.0015)}
SPEEDS = (10, 20, 30, 35, 38.5)


def sweep(poles, modes=3, speeds=SPEEDS[2:4]):
    model = cc.wing_model(
        hale(),
        density=0.0889,
        gravity=0.0,
        lag=cc.IndicialLag(poles=poles, modes=modes),
        outputs=(),
    )
    return cc.flutter(model, speeds, p={"pitch": 0.0})


@pytest.fixture(scope="module")
def three_poles():
    return sweep(3, speeds=SPEEDS)


@pytest.fixture
def exact(published):
    return published("D09")["reference"]["exact_Theodorsen_strip"]["rho 0.0889"]


@pytest.mark.parametrize("poles", LIMITS)
def test_flutter_of_the_straight_wing(poles, three_poles, exact):
    found = three_poles if poles == 3 else sweep(poles)
    assert_allclose(found.speed, exact["flutter_speed"], rtol=LIMITS[poles][0])
    assert_allclose(found.frequency, exact["flutter_rad_s"], rtol=LIMITS[poles][1])


def test_divergence_of_the_straight_wing(three_poles, exact):
    assert_allclose(three_poles.divergence_speed, exact["divergence_speed"], rtol=5e-4)


@pytest.mark.parametrize(("modes", "limit"), [(3, 5e-4), (2, 3.5e-3)])
def test_few_lag_functions_do_what_a_set_per_strip_does(modes, limit, three_poles):
    few = three_poles if modes == 3 else sweep(3, modes)
    each = sweep(3, None)
    assert_allclose([few.speed, few.frequency], [each.speed, each.frequency], rtol=limit)


@pytest.mark.parametrize("mode", ["flap2", "torsion1"])
@pytest.mark.parametrize("speed", [10, 20, 30, 35])
def test_damped_modes_have_the_exact_eigenvalues(mode, speed, three_poles, published):
    rows = published("D09")["reference"]["exact_eigenvalues_rho0.0889_[real 1/s, imag rad/s]"]
    exact = complex(*rows[mode][f"U={speed}"])
    values = three_poles.roots[SPEEDS.index(speed)]
    nearest = values[np.argmin(np.abs(values - exact))]
    # The file's 2 % are of the root itself, mostly its frequency.
    assert abs(nearest / exact - 1) < 0.02
