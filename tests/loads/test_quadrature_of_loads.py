"""Loads and masses along the span on any grid, of any kind and coarseness."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc

LENGTH = 4.0
Q = [0.2, -0.1, 0.15, -0.2, 0.25, 0.1, -0.15, 0.1, 0.05]  # turns the tip by a radian, about

GRIDS = {
    **{f"uniform {n}": cc.Grid.uniform(n, max_angle=3) for n in (1, 2, 3, 4, 5)},
    **{f"lobatto {n}": cc.Grid.lobatto(n, max_angle=3) for n in (1, 2, 3, 5)},
    "one": cc.Grid(boundaries=[0, 1], max_angle=3),
    "two": cc.Grid(boundaries=[0, 0.4, 1], max_angle=3),
    "three": cc.Grid(boundaries=[0, 0.2, 0.6, 1], max_angle=3),
    "clustered": cc.Grid(boundaries=[0, 0.5, 0.501, 0.502, 0.503, 1], max_angle=3),
}
FINE = cc.Grid.lobatto(40, rule="magnus6", max_angle=3)

MASSES = {
    "constant": 1.5,
    "linear": lambda xi: 2 - 1.5 * xi,
    "jumps": cc.Steps([0, 0.3, 0.35, 1], [2.0, 8.0, 0.5]),
}
LOADS = {
    "dead": cc.DistributedForce([0, 1, 3]),
    "jumps": cc.DistributedForce(
        cc.Steps([0, 0.3, 0.7, 1], [[0, 1, 0], [0, 5, 0.5], [0, -2, 3]]), frame="follower"
    ),
    "linear": cc.DistributedForce(lambda xi: [0, 1 - xi, xi], frame="follower"),
    "moment": cc.DistributedMoment(lambda xi: [xi, 1, xi**2], frame="follower"),
}


def wing(grid, mass=1.5):
    basis = cc.ChannelBasis(
        torsion=cc.Legendre(3), out_of_plane=cc.Legendre(4), in_plane=cc.Legendre(2)
    )
    section = cc.Section(
        GJ=1e4,
        EI_y=2e4,
        EI_z=1e5,
        mass_per_length=mass,
        center_of_mass=[0, 0.05, 0.02],
        inertia=np.diag([0.01, 0.005, 0.005]),
    )
    return cc.Beam(length=LENGTH, basis=basis, grid=grid, section=section)


def force(grid, name):
    return cc.generalized_force(wing(grid), ca.DM(Q), [LOADS[name]]).full()


def weight(grid, mass):
    beam = wing(grid, MASSES[mass])
    return cc.generalized_force(beam, ca.DM(Q), [cc.Gravity([0, 0, 9.81])]).full()


def mass_matrix(grid, mass):
    return cc.mass_matrix(wing(grid, MASSES[mass]), ca.DM(Q)).full()


@lru_cache
def exact(quantity, name):
    return quantity(FINE, name)


#: Three Lobatto elements along the whole wing leave 1.3 % (four times the error of their tip pose,
#: which is the least that a grid so coarse can do); one and two elements left from 3 to 200 %.
LEFT = 0.015


@pytest.mark.parametrize(
    ("quantity", "name"),
    [
        *((force, name) for name in LOADS),
        *((weight, name) for name in MASSES),
        *((mass_matrix, name) for name in MASSES),
    ],
    ids=lambda value: value if isinstance(value, str) else value.__name__,
)
def test_any_grid_integrates_loads_and_masses(quantity, name):
    wanted = exact(quantity, name)
    left = {
        key: np.max(np.abs(quantity(grid, name) - wanted)) / np.max(np.abs(wanted))
        for key, grid in GRIDS.items()
    }
    assert max(left.values()) < LEFT, left


@pytest.mark.parametrize("breaks", [(), (0.3, 0.35), (0.5005,)], ids=str)
@pytest.mark.parametrize("grid", GRIDS.values(), ids=GRIDS)
def test_quadrature_of_every_grid(grid, breaks):
    stations, panels = grid.quadrature(breaks)
    assert np.all(np.diff(stations) > 0)
    boundaries = grid.stations(breaks)
    if grid.kind != "lobatto":  # elements are divided, not moved
        assert np.max([np.min(np.abs(stations - x)) for x in boundaries]) < 1e-15
    edges = [0, *breaks, 1]
    for panel, left, right in zip(panels, edges[:-1], edges[1:], strict=True):
        assert np.all(panel.weights > 0)
        np.testing.assert_allclose(stations[list(panel.nodes)], panel.xi, atol=1e-15)
        for degree in range(4):
            exact_integral = (right ** (degree + 1) - left ** (degree + 1)) / (degree + 1)
            got = panel.weights @ panel.xi**degree
            np.testing.assert_allclose(got, exact_integral, rtol=1e-12)  # rounding


def test_many_even_elements_are_not_divided():
    for grid in (cc.Grid.uniform(4), cc.Grid.lobatto(3), cc.Grid(boundaries=np.linspace(0, 1, 9))):
        np.testing.assert_array_equal(grid.quadrature()[0], grid.stations())
