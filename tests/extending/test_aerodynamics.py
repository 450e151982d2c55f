"""An aerodynamic model of the user's, defined in this file alone: strips that stall."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

import curvcasadi as cc
from curvcasadi.loads import sites


class Curve:
    """A cubic spline through a table, as an expression: a cubic and a term for each knot.

    f(x) = Σ p_i (x − x_0)^i + Σ j_k max(x − x_k, 0)³, with j_k the jump of the third derivative
    over 6. Below and above the table it goes on with the outermost cubics.
    """

    def __init__(self, x, y):
        spline = CubicSpline(x, y)
        self.start, self.inner = spline.x[0], spline.x[1:-1]
        self.cubic = spline.c[::-1, 0]
        self.jumps = np.diff(spline.c[0])

    def __call__(self, x):
        powers = ca.vertcat(*((x - self.start) ** i for i in range(4)))
        beyond = ca.vertcat(*(ca.fmax(x - knot, 0) ** 3 for knot in self.inner))
        return ca.dot(self.cubic, powers) + ca.dot(self.jumps, beyond)


DEGREES = np.array([-30.0, -16, -12, -8, -4, 0, 4, 8, 12, 16, 30])
LIFT = [-0.8, -0.95, -1.15, -0.84, -0.42, 0.0, 0.42, 0.84, 1.15, 0.95, 0.8]
DRAG = [0.6, 0.15, 0.03, 0.015, 0.011, 0.01, 0.011, 0.015, 0.03, 0.15, 0.6]


@dataclass(frozen=True, eq=False, kw_only=True)
class StallingStrips(cc.Load):
    """Lift and drag of strips from tables over the angle of attack; right wings."""

    airspeed: Any  #: m/s
    pitch: Any  #: angle of the parent's x axis above the flow, rad
    density: float  #: kg/m³
    chord: float  #: m

    order = 1
    lift = Curve(np.radians(DEGREES), LIFT)
    drag = Curve(np.radians(DEGREES), DRAG)

    def is_distributed(self, beam):
        return True

    def contributions(self, beam, mesh, to_parent):
        stream = ca.vertcat(ca.cos(self.pitch), 0, ca.sin(self.pitch)) * self.airspeed
        for site in sites(beam, mesh):
            yield site.node, ca.vertcat(stream, self.density * self.chord / 2 * site.measure)

    @classmethod
    def wrench(cls, rotation, position, data, twist):
        velocity = twist[3:] + rotation.T @ data[:3]  # of the section through the air, local axes
        ahead, up = velocity[1], velocity[2]
        alpha, speed = ca.atan2(-up, ahead), ca.sqrt(ahead**2 + up**2)
        across, along = ca.vertcat(0, -up, ahead), ca.vertcat(0, ahead, up)
        local = data[3] * speed * (cls.lift(alpha) * across - cls.drag(alpha) * along)
        force = rotation @ local
        return ca.vertcat(ca.cross(position, force), force)


PITCH = np.radians(2)
WING = cc.Beam(
    length=16.0,
    basis=cc.ChannelBasis(torsion=cc.Legendre(1), out_of_plane=cc.Legendre(3)),
    grid=cc.Grid.lobatto(8),
    section=cc.Section(
        GJ=1e5, EI_y=2e5, EI_z=4e6, mass_per_length=0.75, inertia=np.diag([0.1, 0.05, 0.05])
    ),
    root=cc.Pose(rotation=[[0, 1, 0], [1, 0, 0], [0, 0, -1]], position=[0, 0, 0]),
)


def strips(degrees, airspeed=25.0):
    return StallingStrips(airspeed=airspeed, pitch=np.radians(degrees), density=1.2, chord=1.0)


def lift_of(load):
    return -float(cc.root_wrench(WING, np.zeros(4), [load])[5])


def test_the_curve_is_the_spline_of_the_table():
    x = np.radians(np.linspace(-29, 29, 50))
    expected = CubicSpline(np.radians(DEGREES), LIFT)(x)
    assert_allclose([float(StallingStrips.lift(v)) for v in x], expected, atol=1e-11)


@pytest.mark.parametrize("degrees", [-8, 4, 12, 16])
def test_its_force_is_that_of_the_table(degrees):
    k = list(DEGREES).index(degrees)
    alpha = np.radians(degrees)
    coefficient = LIFT[k] * np.cos(alpha) + DRAG[k] * np.sin(alpha)
    assert_allclose(lift_of(strips(degrees)), 0.5 * 1.2 * 25**2 * 16 * coefficient, rtol=1e-11)


def test_below_stall_the_wing_rests_as_with_strips_of_the_same_slope():
    """At 2° the spline of the table lies 0.08 % above a line through its inner points."""
    slope = 0.42 / np.radians(4)
    airfoil = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.0, lift_slope=slope, profile_drag=0.0103
    )
    flow = cc.Flow(density=1.2, velocity=25 * np.array([np.cos(PITCH), 0, np.sin(PITCH)]))
    own = cc.solve_equilibrium(WING, [strips(2)])
    linear = cc.solve_equilibrium(WING, [cc.AerodynamicLoad(strips=airfoil, flow=flow)])
    assert_allclose(own.shape.tip.position, linear.shape.tip.position, rtol=0, atol=3e-3)


def test_it_deflects_the_wing_less_beyond_stall():
    tips = [
        float(cc.solve_equilibrium(WING, [strips(angle, 8.0)]).shape.tip.position[2])
        for angle in (8, 12, 16)
    ]
    assert tips[1] < tips[0] < 0  # z is down
    assert tips[1] < tips[2]


def test_it_flies_in_a_model_with_the_airspeed_as_a_parameter():
    airspeed = ca.MX.sym("airspeed")
    load = replace(strips(2), airspeed=airspeed)
    model = cc.beam_model(WING, [load], parameters={"airspeed": airspeed})
    rest = cc.solve_equilibrium(WING, [strips(2)])
    x = ca.vertcat(rest.q, ca.DM.zeros(4))
    assert float(ca.norm_inf(model.xdot(x, [], 25.0))) < 1e-6
    eigenvalues = cc.linearize(model, x, [], 25.0).eigenvalues
    assert np.all(eigenvalues.real < 0)  # the flow damps bending below stall
