"""Published case D12: flutter and vacuum frequencies of the Goland wing.

M. Goland 1945; the exact rows by the transfer matrix of the bending-torsion equations with
Theodorsen's function, with the properties of SHARPy's template.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support.strip_wings import goland

#: Largest relative error of flutter speed and frequency.
LIMITS = {2: (0.004, 0.012), 3: (0.003, 0.003)}
SPEEDS = (40, 120, 140, 150, 155)


def sweep(poles, modes=3, speeds=SPEEDS[2:]):
    model = cc.wing_model(
        goland(),
        density=1.02,
        gravity=0.0,
        lag=cc.IndicialLag(poles=poles, modes=modes),
        outputs=(),
    )
    return cc.flutter(model, speeds, p={"pitch": 0.0})


@pytest.fixture(scope="module")
def three_poles():
    return sweep(3, speeds=SPEEDS)


@pytest.mark.parametrize("poles", LIMITS)
def test_flutter(poles, three_poles, published):
    exact = published("D12")["reference"]["exact_COMPUTED"]["SHARPy props, rho 1.02"]
    found = three_poles if poles == 3 else sweep(poles)
    assert_allclose(found.speed, exact["speed"], rtol=LIMITS[poles][0])
    assert_allclose(found.frequency, exact["rad_s"], rtol=LIMITS[poles][1])


def test_three_lag_functions_do_what_a_set_per_strip_does(three_poles):
    each = sweep(3, None)
    got, expected = ((found.speed, found.frequency) for found in (three_poles, each))
    assert_allclose(got, expected, rtol=5e-4)


def test_vacuum_frequencies(published):
    exact = published("D12")["reference"]["exact_COMPUTED"]["vacuum coupled rad_s (SHARPy props)"]
    frequencies = cc.natural_frequencies(goland().beam)[: len(exact)]
    assert_allclose(frequencies, exact, rtol=1e-3)


@pytest.mark.parametrize("speed", [40, 120, 150])
def test_torsion_has_the_exact_eigenvalues(speed, three_poles, published):
    rows = published("D12")["reference"]["exact_COMPUTED"]
    rows = rows["eigenvalues SHARPy props rho 1.02 [real 1/s, imag rad/s]"]
    exact = complex(*rows["torsion1"][f"U={speed}"])
    values = three_poles.roots[SPEEDS.index(speed)]
    assert np.min(np.abs(values / exact - 1)) < 5e-3
