"""Airfoil data of implausible size are taken, with a warning that names the unit."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc

DATA = {"chord": 1.0, "aerodynamic_center": 0.25}


@pytest.mark.parametrize("slope", [0.11, 30.0])
def test_a_lift_slope_per_degree_is_named(slope):
    with pytest.warns(UserWarning, match=rf"lift_slope: {slope:g} 1/rad .* 0.11 per degree"):
        cc.StripAerodynamics(**DATA, lift_slope=slope)


def test_an_angle_of_degrees_is_named_in_tables_too():
    table = cc.Piecewise((0, 0.5, 1), (-0.05, -3.0))
    for angle in (-3.0, table):
        with pytest.warns(UserWarning, match="zero_lift_angle: 3 rad is implausibly large"):
            cc.StripAerodynamics(**DATA, lift_slope=6.0, zero_lift_angle=angle)


def test_plausible_data_symbols_and_functions_pass_in_silence():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for slope in (0.0, 2 * np.pi, ca.SX.sym("a"), lambda xi: 6.0):
            cc.StripAerodynamics(**DATA, lift_slope=slope, zero_lift_angle=-0.05)
