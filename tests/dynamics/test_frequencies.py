"""Frequencies and modes: what their definitions promise, and what has none."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support.moving_wing import N, wing


def rod(out_of_plane=0, in_plane=0, torsion=0, **fields):
    counts = {"torsion": torsion, "out_of_plane": out_of_plane, "in_plane": in_plane}
    basis = cc.ChannelBasis(**{name: cc.Legendre(n) for name, n in counts.items() if n})
    section = cc.Section(GJ=1, EI_y=1, EI_z=2, mass_per_length=1, **fields)
    return cc.Beam(length=1.0, basis=basis, grid=cc.Grid.lobatto(16), section=section)


def test_modes_diagonalize_mass_and_stiffness():
    beam = wing()
    modes = cc.vibration_modes(beam)
    mass = cc.mass_matrix(beam, np.zeros(N)).full()
    assert_allclose(modes.shapes.T @ mass @ modes.shapes, np.eye(N), atol=1e-10)
    q = np.zeros(N)
    stiffness = cc.equilibrium_tangent(beam, q, [])[1].full()
    squares = np.diag(modes.frequencies**2)
    # The largest squared frequency is some 1e6 times the smallest.
    assert_allclose(modes.shapes.T @ stiffness @ modes.shapes, squares, atol=1e-9 * squares.max())


def test_displacements_of_modes_are_derivatives_of_the_shape():
    beam, step = rod(out_of_plane=4, in_plane=3), 1e-5
    q = 0.3 * np.cos(np.arange(7))
    modes = cc.vibration_modes(beam, q)
    ends = [cc.shape_map(beam, q + s * step * modes.shapes[:, 0]).tip.position for s in (1, -1)]
    slope = (ends[0] - ends[1]).full().ravel() / (2 * step)
    assert_allclose(modes.displacements[0, :, -1], slope, rtol=1e-7, atol=1e-9)
    assert modes.displacements.shape == (7, 3, len(modes.stations))
    twist = cc.body_jacobian(beam, q).full() @ modes.shapes
    assert_allclose(modes.motions[:, :, -1].T, twist, rtol=1e-10, atol=1e-12)


def test_compression_lowers_the_frequency_to_zero_where_the_rod_buckles():
    beam = rod(out_of_plane=6)
    buckling = np.pi**2 / 4
    free = cc.natural_frequencies(beam)[0]
    # Rayleigh's quotient with a fixed shape is linear in the load, and the lowest of it is concave.
    for part in (0.5, 0.99):
        loads = [cc.PointForce(1.0, [-part * buckling, 0, 0])]
        found = cc.natural_frequencies(beam, loads=loads)[0]
        assert 1 - part <= (found / free) ** 2 <= 1.1 * (1 - part)
    with pytest.raises(ValueError, match="stable equilibrium"):
        loads = [cc.PointForce(1.0, [-1.01 * buckling, 0, 0])]
        cc.natural_frequencies(beam, loads=loads)


def test_a_follower_force_is_stable_until_becks_flutter_load():
    beam = rod(out_of_plane=6)

    def pushed(force):
        return [cc.PointForce(1.0, [-force, 0, 0], "follower")]

    # M. Beck, 1952: P L²/EI = 20.05, where the first two frequencies meet.
    below = cc.natural_frequencies(beam, loads=pushed(20.0))
    assert below[1] / below[0] < 1.2
    with pytest.raises(ValueError, match="stable equilibrium"):
        cc.natural_frequencies(beam, loads=pushed(20.1))


def test_a_rotor_that_gyrates_has_complex_modes_of_one_modal_mass():
    beam = rod(out_of_plane=3, in_plane=3)
    tip = cc.Body(xi=1.0, mass=1.0, offset=(0.3, 0, 0))
    bent = 0.4 * np.r_[-1.0, 0.3, 0.0, 0.5, 0.0, 0.0]
    root = cc.RootMotion(twist=[0, 0, 2.0, 0, 0, 0])
    modes = cc.vibration_modes(replace(beam, bodies=(tip,)), bent, root=root)
    assert np.iscomplexobj(modes.shapes)
    assert np.all(np.diff(modes.frequencies) > 0)


def test_what_has_no_frequencies_is_refused_by_name():
    with pytest.raises(ValueError, match=r"Section\.inertia.*torsion"):
        cc.natural_frequencies(rod(torsion=2))
    few = replace(
        rod(out_of_plane=8),
        section=cc.Section(GJ=1, EI_y=1, EI_z=1),
        bodies=(cc.Body(xi=1.0, mass=1.0),),
    )
    with pytest.raises(ValueError, match=r"masses that resist 3 motions.*mass_per_length"):
        cc.natural_frequencies(few)
    with pytest.raises(ValueError, match="mass_per_length"):
        cc.forward_dynamics(few, np.zeros(8), np.zeros(8))
