"""A small swept wing with every kind of inertia, for tests of dynamics."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

import curvcasadi as cc

GRAVITY = [1.0, -2.0, -9.81]
STATES = ("q", "q_dot", "q_ddot")
N = 7


def wing(rule="magnus4", **fields):
    """Offsets and products of inertia, a jump of the mass, a body at the tip and one inside."""
    basis = cc.ChannelBasis(
        torsion=cc.Legendre(2), out_of_plane=cc.Legendre(3), in_plane=cc.Legendre(2)
    )
    section = cc.Section(
        GJ=1e4,
        EI_y=2e4,
        EI_z=4e6,
        mass_per_length=cc.Steps([0, 0.3, 1], [1.1, 0.75]),
        inertia=np.diag([0.1, 0.03, 0.09]) + 0.01,
        center_of_mass=(0.02, -0.1, 0.05),
    )
    inertia = np.diag([0.1, 0.2, 0.3])
    beam = cc.Beam(
        length=16.0,
        basis=basis,
        grid=cc.Grid.lobatto(6, rule=rule),
        section=section,
        root=cc.Pose(rotation=cc.lie.so3.exp(ca.DM([0.3, -0.5, 0.8])), position=[1.0, -2.0, 0.5]),
        bodies=(
            cc.Body(xi=1.0, mass=2.0, inertia=inertia, offset=(0.1, 0.2, -0.1)),
            cc.Body(xi=0.3, mass=1.0, offset=(0, 0.3, 0)),
        ),
    )
    return replace(beam, **fields)


def motion(seed=0, n=N):
    """q, q_dot, q_ddot, (n,) each, of a bent wing in motion."""
    rng = np.random.default_rng(seed)
    return [scale * rng.normal(size=n) for scale in (0.05, 0.1, 0.3)]


def close(found, expected, tolerance=1e-12):
    """Equal to a fraction of the largest entry; sums of some hundred terms lose three digits."""
    found, expected = (ca.DM(x).full() for x in (found, expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * np.abs(expected).max())


def evaluated(kind, values, expressions_of):
    """Numbers of `expressions_of(*symbols)`, with symbols of `kind` or with the numbers at once."""
    if kind == "DM":
        found = expressions_of(*values)
        assert all(isinstance(x, ca.DM) for x in found)
        return found
    symbols = [getattr(ca, kind).sym(f"x{i}", len(x)) for i, x in enumerate(values)]
    found = expressions_of(*symbols)
    assert all(isinstance(x, getattr(ca, kind)) for x in found)
    return ca.Function("f", symbols, found).call([ca.DM(x) for x in values])
