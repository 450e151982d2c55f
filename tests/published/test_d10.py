"""Published case D10, set C: flutter of the HALE wing about its shape under weight and lift.

M. J. Patil, D. H. Hodges, C. E. S. Cesnik, J. Aircraft 38(1), 2001, digitised in AeroBeams.jl: the
root angle bends the wing, and bending lowers its flutter speed.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import curvcasadi as cc
from tests.support.strip_wings import hale

WING = hale((4, 4, 3), 8)


class Flying:
    """The wing at a root angle, rad, about its equilibrium at each airspeed."""

    def __init__(self, angle):
        self.angle = angle
        model = cc.wing_model(WING, density=0.0889, gravity=9.8)
        n, size = model.second_order.velocities, model.x.size
        x, p, none = ca.MX.sym("x", size), ca.MX.sym("p", 2), ca.MX(0, 1)
        rest = ca.vertcat(*model.second_order.balance(x, ca.DM.zeros(n), none, p))
        slope = ca.jacobian(model.xdot(x, none, p), x)
        self._rest = ca.Function("rest", [x, p], [rest, ca.jacobian(rest, x)])
        self._slope = ca.Function("slope", [x, p], [ca.densify(slope)])
        self._free = np.r_[0:n, 2 * n : size]  # weights and lag states; velocities are zero
        self.n, self.x = n, np.zeros(size)

    def settle(self, speed):
        """Equilibrium by Newton's method from the one before."""
        for _ in range(40):
            left, slope = (m.full() for m in self._rest(self.x, [speed, self.angle]))
            step = -np.linalg.solve(slope[:, self._free], left).ravel()
            bend = 16 * np.abs(step[: self.n]).max()
            self.x[self._free] += step * min(1.0, 1.5 / max(bend, 1e-30))
            if bend < 1e-9:
                return
        raise AssertionError(f"no equilibrium at {speed} m/s")

    def least_damped(self, speed):
        self.settle(speed)
        values = np.linalg.eigvals(self._slope(self.x, [speed, self.angle]).full())
        # In-plane modes are undamped but for rounding: no flutter.
        values = values[(values.imag > 1) & (np.abs(values.real) > 1e-5 * np.abs(values))]
        return values[np.argmax(values.real)]


@pytest.fixture(scope="module")
def wing():
    return Flying(0.0)


@pytest.mark.parametrize("degrees", [0.8055, 1.5422, 2.9077, 4.2043])
def test_flutter_about_the_bent_wing(degrees, wing, published):
    rows = published("D10")["reference"]
    speeds, frequencies, tips = (
        rows[key]
        for key in (
            "C_flutter_speed_vs_root_angle",
            "C_flutter_freq_vs_root_angle",
            "C_tip_disp_at_flutter",
        )
    )
    expected = np.interp(degrees, speeds["deg"], speeds["speed"])
    wing.angle, wing.x[:] = np.radians(degrees), 0.0
    for speed in np.linspace(5, 0.95 * expected, 6):
        wing.settle(speed)
    found = brentq(lambda v: wing.least_damped(v).real, 0.95 * expected, 1.05 * expected, xtol=1e-2)
    assert_allclose(found, expected, rtol=0.02)
    frequency = np.interp(degrees, frequencies["deg"], frequencies["rad_s"])
    assert_allclose(wing.least_damped(found).imag, frequency, rtol=0.04)
    tip = cc.shape_map(WING.beam, wing.x[: wing.n]).tip.position
    # Digitised; the axis of his tip displacements is some 10 to 17 % short.
    assert_allclose(-float(tip[2]), np.interp(degrees, tips["deg"], tips["m"]), rtol=0.2)
