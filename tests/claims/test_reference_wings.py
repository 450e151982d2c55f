"""The published wings have the published numbers."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.reference_wings import RIGHT_WING_ROOT, hale_wing


def test_right_wing_axes_are_a_rotation_with_x_outboard_y_forward_z_up():
    R = RIGHT_WING_ROOT.rotation.full()
    forward, right, down = np.eye(3)
    # Whole numbers.
    assert_allclose(R.T @ R, np.eye(3), rtol=0)
    assert_allclose(np.linalg.det(R), 1, rtol=1e-15)
    assert_allclose(R, np.column_stack([right, forward, -down]), rtol=0)


def test_the_straight_hale_wing_ends_16_m_to_the_right():
    tip = cc.shape_map(hale_wing(), np.zeros(9)).tip
    assert_allclose(tip.position, [[0], [16], [0]], atol=1e-14)  # sums of element lengths
    assert_allclose(tip.rotation, RIGHT_WING_ROOT.rotation, rtol=0)


def test_negative_out_of_plane_curvature_lifts_the_tip_of_the_hale_wing():
    q = np.zeros(9)
    q[3] = -0.05
    x, y, z = cc.shape_map(hale_wing(), q).tip.position.full().ravel()
    # An arc of radius 20 m, exactly represented: rounding.
    assert_allclose([x, y, z], [0, 20 * np.sin(0.8), -20 * (1 - np.cos(0.8))], atol=1e-13)


@pytest.mark.parametrize("channel, rigidity", [(0, 1e4), (3, 2e4), (7, 4e6)])
def test_strain_energy_of_the_hale_wing_follows_from_its_published_rigidities(channel, rigidity):
    q = np.zeros(9)
    q[channel] = 0.01
    # ½ EI κ² L: a polynomial, integrated exactly.
    assert_allclose(cc.strain_energy(hale_wing(), q), 0.5 * rigidity * 0.01**2 * 16, rtol=1e-13)


def test_first_bending_frequencies_of_the_hale_wing_are_those_that_patil_published():
    wing = hale_wing()
    section = wing.section
    first = 1.8751040687119611**2 / wing.length**2
    # Patil, Hodges, Cesnik 2001: 2.243 and 31.719 rad/s, four and five digits; from the two
    # rigidities and the mass of a uniform cantilever.
    assert_allclose(first * np.sqrt(section.EI_y / section.mass_per_length), 2.243, rtol=3e-4)
    assert_allclose(first * np.sqrt(section.EI_z / section.mass_per_length), 31.719, rtol=3e-4)


def test_numbers_of_weights_and_grid_of_the_hale_wing_can_be_chosen():
    grid = cc.Grid.uniform(5)
    wing = hale_wing(1, 2, 3, grid=grid)
    assert wing.basis.n == 6
    assert wing.grid is grid
    lower, upper = wing.bounds
    assert_allclose([lower, upper], [[-0.15] * 6, [0.15] * 6], rtol=0)
    assert isinstance(cc.shape_map(wing, ca.SX.sym("q", 6)).tip.position, ca.SX)
