"""Planforms against plane geometry."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc


def half_wing(length=8.0, **geometry):
    shape = cc.WingGeometry(length=length, **geometry)
    return cc.Beam(
        length=length,
        basis=cc.ChannelBasis(out_of_plane=cc.Legendre(2)),
        grid=cc.Grid.uniform(8),
        root=shape.root,
        initial_curvature=shape.initial_curvature,
    )


def strips(chord, center=0.0):
    return cc.StripAerodynamics(chord=chord, aerodynamic_center=center, lift_slope=2 * np.pi)


def test_a_trapezoid():
    taper = cc.Piecewise([0, 1], [1.5, 0.5])
    plan = cc.planform(half_wing(), strips(taper, 0.1))
    assert_allclose(plan.area, 8.0, rtol=1e-14)
    assert_allclose(plan.span, 8.0, rtol=1e-14)
    assert_allclose(plan.aspect_ratio, 16**2 / 16, rtol=1e-14)
    # ∫c² over ∫c of a linear chord: (a² + a b + b²)/3 over (a + b)/2.
    assert_allclose(plan.mean_aerodynamic_chord, (2.25 + 0.75 + 0.25) / 3, rtol=1e-14)
    assert_allclose(plan.leading[:, 0], [0.1 + 1.5 / 4, 0, 0], atol=1e-14)
    assert_allclose(plan.trailing[:, -1], [0.1 - 3 * 0.5 / 4, 8, 0], atol=1e-13)
    assert_allclose(plan.quarter_chord[0], 0.1, atol=1e-14)


def test_a_swept_and_raised_wing_is_shorter_in_span():
    plan = cc.planform(half_wing(sweep=0.4, dihedral=0.2), strips(1.0))
    assert_allclose(plan.span, 8 * np.cos(0.4) * np.cos(0.2), rtol=1e-12)
    assert_allclose(plan.area, 8.0, rtol=1e-14)


def test_a_chord_that_jumps_shows_both_sides():
    plan = cc.planform(half_wing(), strips(cc.Steps([0, 0.5, 1], [2.0, 1.0])))
    assert_allclose(plan.area, 8 * 1.5, rtol=1e-14)
    chords = np.linalg.norm(plan.leading - plan.trailing, axis=0)
    assert_allclose(chords[plan.xi < 0.5], 2.0, rtol=1e-12)
    assert_allclose(chords[plan.xi > 0.5], 1.0, rtol=1e-12)
    assert "aspect ratio" in str(plan)


def test_symbols_are_refused_by_name():
    with pytest.raises(ValueError, match=r"StripAerodynamics.chord: planform needs numbers"):
        cc.planform(half_wing(), strips(ca.SX.sym("c")))
