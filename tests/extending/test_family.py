"""A family of basis functions of the user's, defined in this file alone: quarter waves."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.testing import assert_allclose

import curvcasadi as cc


class QuarterWaves:
    """cos((2 k + 1) π xi/2), k = 0 … n − 1: zero at the tip, as curvature of a free one is."""

    breaks = ()

    def __init__(self, n):
        self.n = n

    @property
    def labels(self):
        return tuple(f"quarter wave {k}" for k in range(self.n))

    def __call__(self, xi):
        return np.cos((2 * np.arange(self.n) + 1) * np.pi * xi / 2)


def beam(n=4, elements=32):
    return cc.Beam(
        length=2.0,
        basis=cc.ChannelBasis(out_of_plane=QuarterWaves(n), torsion=cc.Legendre(1)),
        grid=cc.Grid.lobatto(elements),
        section=cc.Section(GJ=3.0, EI_y=5.0, EI_z=50.0),
    )


def test_a_beam_bends_by_it():
    # K_y = a cos(π xi/2): the angle of the tip is ∫ K_y ds = a L 2/π about the y axis.
    tip = cc.shape_map(beam(), [0, 0.3, 0, 0, 0]).tip
    angle = 0.3 * 2.0 * 2 / np.pi
    expected = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    assert_allclose(tip.rotation, expected, atol=1e-9)  # magnus4 on 32 elements
    assert beam().basis.labels[1] == "out_of_plane: quarter wave 0"


def test_statics_use_it():
    # S_kl = L EI ∫ cos cos dxi = L EI/2 δ_kl.
    q = [0, 0.3, 0.1, 0, 0.2]
    energy = 0.5 * 2.0 * 5.0 / 2 * np.sum(np.square(q[1:]))
    assert_allclose(cc.strain_energy(beam(), q), energy, rtol=1e-12)
    # A small tip force: the exact cantilever, F L³/(3 EI), less the part of waves left out.
    force = 1e-3
    rest = cc.solve_equilibrium(beam(8), [cc.PointForce(1.0, [0, 0, -force])])
    assert_allclose(rest.shape.tip.position[2], -force * 8 / 15, rtol=2e-4)


def test_it_runs_as_c(tmp_path):
    cc.export_c([cc.tip_function(beam(elements=8))], tmp_path)
    assert cc.export.run_check(tmp_path)["tip"] <= 1e-13


def test_a_mirrored_beam_has_its_mirror_image():
    q = ca.DM([0.1, 0.3, 0.1, 0, 0.2])
    left, right = (cc.shape_map(b, q).tip.position for b in (cc.mirror(beam()), beam()))
    assert_allclose(left, ca.DM([1, -1, 1]) * right, atol=1e-14)
