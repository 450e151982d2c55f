"""Published case D15: flutter of the Pazy wing, straight and about its bent shapes.

C. Riso and C. E. S. Cesnik, J. Aircraft 2023, with UM/NAST: a hump mode, whose onset moves down as
the root angle bends the wing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.published import test_published_vibrations as vibrations
from tests.support.strip_wings import ROOT, pazy

SPEEDS = np.arange(30, 78, 4.0)  # wider than some humps


@pytest.fixture(scope="module")
def beam():
    return replace(vibrations.pazy(3, 4, 2), root=ROOT)


@pytest.fixture(scope="module")
def case(published):
    return published("D15")


def model(case, beam, **fields):
    return cc.wing_model(pazy(case, beam, **fields), density=1.225, gravity=0.0, outputs=())


@pytest.fixture(scope="module")
def bent(case, beam):
    return model(case, beam)


def onset(case, degrees):
    speeds, angles = np.transpose(case["reference"]["onset_vs_root_angle_varying_coeff_[U,deg]"])
    return speeds[angles == degrees].item()


@pytest.mark.parametrize("degrees", [1, 3, 5, 7])
def test_onset_of_the_hump_mode_with_suction(degrees, case, bent):
    found = cc.flutter(bent, SPEEDS, p={"pitch": np.radians(degrees)})
    # The source's lift stands on the chord: it has no suction.
    assert_allclose(found.speed, onset(case, degrees), rtol=0.04)
    assert found.linearizations <= 3 * len(SPEEDS)


def test_onset_of_the_hump_mode_without_suction(case, beam):
    plain = model(case, beam, suction=0.0)
    for degrees in (1, 3, 5, 7):
        found = cc.flutter(plain, SPEEDS, p={"pitch": np.radians(degrees)})
        assert_allclose(found.speed, onset(case, degrees), rtol=0.015)


def test_flutter_of_the_straight_wing_in_two_dimensional_flow(case, beam):
    found = cc.flutter(model(case, beam, varying=False), [75.0, 80.0, 85.0])
    rows = case["reference"]["undeformed_without_tip_mass"]
    # The rows are of the finite element model and of the beam; the modes are those of the first.
    speed, hertz = rows["2D strip flutter"][0]
    assert_allclose(found.speed, speed, rtol=0.015)
    assert_allclose(found.frequency, 2 * np.pi * hertz, rtol=0.015)
    assert_allclose(found.divergence_speed, rows["2D divergence"][1], rtol=0.015)
