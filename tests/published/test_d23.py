"""Published case D23: Theodorsen's and Wagner's functions against those of indicial poles.

C(k) = K_1(ik)/(K_0(ik) + K_1(ik)) of modified Bessel functions; the rows of
`reference/D23_theodorsen_wagner.json` were computed from it.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import kv

import curvcasadi as cc

#: Largest relative error of C(k) for k up to 2 that the issue of each set of poles admits.
LIMITS = {2: 0.025, 3: 0.01, 4: 0.003}


def theodorsen(k):
    k0, k1 = kv(0, 1j * k), kv(1, 1j * k)
    return k1 / (k0 + k1)


def test_published_rows_are_theodorsens_function(published):
    rows = published("D23")["reference"]
    exact = theodorsen(np.array(rows["k"]))
    # Eight decimals are published.
    assert_allclose(exact, np.array(rows["F"]) + 1j * np.array(rows["G"]), atol=1e-8)


@pytest.mark.parametrize("poles", LIMITS)
def test_theodorsens_function_up_to_two(poles, published):
    k = np.concatenate([np.geomspace(1e-4, 0.01, 20), np.linspace(0.01, 2, 400)])
    exact = theodorsen(k)
    error = np.abs(cc.IndicialLag(poles=poles).theodorsen(k) / exact - 1)
    assert error.max() <= LIMITS[poles]
    rows = published("D23")["reference"]
    listed = np.array(rows["k"]) <= 2
    table = (np.array(rows["F"]) + 1j * np.array(rows["G"]))[listed]
    found = cc.IndicialLag(poles=poles).theodorsen(np.array(rows["k"])[listed])
    assert np.max(np.abs(found / table - 1)) <= LIMITS[poles]


def test_two_poles_are_those_of_jones(published):
    rows = published("D23")["reference"]
    found = cc.IndicialLag(poles=2).wagner(rows["wagner_s"])
    assert_allclose(found, rows["jones_approximation"], atol=5e-6)  # five decimals


@pytest.mark.parametrize(("poles", "limit"), [(2, 0.007), (3, 0.002), (4, 0.001)])
def test_wagners_function(poles, limit, published):
    rows = published("D23")["reference"]
    # Jones' poles are 0.0065 off at s = 1; more poles follow the published function more closely.
    found = cc.IndicialLag(poles=poles).wagner(rows["wagner_s"])
    assert_allclose(found, rows["wagner_phi"], atol=limit)


def test_limits_of_both_functions():
    for poles in LIMITS:
        lag = cc.IndicialLag(poles=poles)
        assert_allclose(lag.wagner([0.0, 1e5]), [0.5, 1.0], rtol=1e-12)
        assert_allclose(lag.theodorsen([0.0, 1e9]), [1.0, 0.5], rtol=1e-8)
