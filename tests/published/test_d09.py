"""Published case D09: flutter and divergence of the straight HALE wing.

M. J. Patil, D. H. Hodges, C. E. S. Cesnik, J. Aircraft 38(1), 2001; the exact rows by the transfer
matrix of the bending-torsion equations with Theodorsen's function.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support.strip_wings import divergence, eigenvalues, flutter, hale

#: Largest relative error of flutter speed and frequency.
LIMITS = {2: (0.006, 0.015), 3: (0.005, 0.005), 4: (0.0015, 0.0015)}


def model(poles, modes=3):
    return cc.wing_model(
        hale(), density=0.0889, gravity=0.0, lag=cc.IndicialLag(poles=poles, modes=modes)
    )


@pytest.fixture(scope="module")
def three_poles():
    return model(3)


@pytest.fixture(scope="module")
def found(three_poles):
    return flutter(three_poles, 31.5, 33.5)


@pytest.fixture
def exact(published):
    return published("D09")["reference"]["exact_Theodorsen_strip"]["rho 0.0889"]


@pytest.mark.parametrize("poles", LIMITS)
def test_flutter_of_the_straight_wing(poles, found, exact):
    speed, frequency = found if poles == 3 else flutter(model(poles), 31.5, 33.5)
    assert_allclose(speed, exact["flutter_speed"], rtol=LIMITS[poles][0])
    assert_allclose(frequency, exact["flutter_rad_s"], rtol=LIMITS[poles][1])


def test_divergence_of_the_straight_wing(three_poles, exact):
    assert_allclose(divergence(three_poles, 36, 38.5), exact["divergence_speed"], rtol=5e-4)


@pytest.mark.parametrize(("modes", "limit"), [(3, 5e-4), (2, 3.5e-3)])
def test_few_lag_functions_do_what_a_set_per_strip_does(modes, limit, found):
    few = found if modes == 3 else flutter(model(3, modes), 31.5, 33.5)
    assert_allclose(few, flutter(model(3, None), 31.5, 33.5), rtol=limit)


@pytest.mark.parametrize("mode", ["flap2", "torsion1"])
@pytest.mark.parametrize("speed", [10, 20, 30, 35])
def test_damped_modes_have_the_exact_eigenvalues(mode, speed, three_poles, published):
    rows = published("D09")["reference"]["exact_eigenvalues_rho0.0889_[real 1/s, imag rad/s]"]
    exact = complex(*rows[mode][f"U={speed}"])
    values = eigenvalues(three_poles, speed)
    nearest = values[np.argmin(np.abs(values - exact))]
    # The file's 2 % are of the root itself, mostly its frequency.
    assert abs(nearest / exact - 1) < 0.02
