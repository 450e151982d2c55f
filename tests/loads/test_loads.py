"""Generalized forces against potentials and virtual work, by AD of the poses alone."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial import legendre
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.loads.stations import loaded_mesh
from tests.support.oracle import CURLED_WEIGHTS, WING_LENGTH, curled_curvature, integrate, rotation

#: So soft that the tangent is the derivative of the loads alone.
SOFT = cc.Section(
    GJ=1e-18,
    EI_y=1e-18,
    EI_z=1e-18,
    mass_per_length=lambda xi: 0.75 * (2 - xi),
    center_of_mass=lambda xi: ca.DM([0.02, -0.1 * (1 + xi), 0.03]),
)
BODIES = (
    cc.Body(xi=0.5, mass=3.0, offset=[0.1, -0.4, 0.2]),
    cc.Body(xi=1.0, mass=1.0, offset=[-0.3, 0.2, 0.1]),
)
ROOT = cc.Pose(rotation=rotation([0.3, -0.5, 1.1]), position=[1.0, -2.0, 0.5])
ATTITUDE = ca.DM(rotation([-0.7, 0.4, 0.2]))
GRAVITY = [3.0, 1.0, -9.0]
#: Every station of the loads below is one of these.
BOUNDARIES = [0, 0.08, 0.2, 0.35, 0.5, 0.6, 0.7, 0.8, 0.9, 1]
RULES = ("trapezoid", "midpoint", "magnus4", "magnus6")


def custom(rule="magnus4"):
    return cc.Grid(boundaries=BOUNDARIES, rule=rule, max_angle=1.5)


@pytest.fixture
def beam(wing):
    """Maker of a curved, rooted, soft test wing."""

    def make(grid=None, **fields):
        standard = {"section": SOFT, "root": ROOT, "initial_curvature": [0.01, 0.02, -0.03]}
        return replace(wing(**{**standard, **fields}), grid=grid or custom())

    return make


class Applied(NamedTuple):
    """A force and a moment at a station, as the oracle takes them."""

    xi: float
    force: object = (0, 0, 0)
    moment: object = (0, 0, 0)
    frame: str = "dead"
    offset: object = (0, 0, 0)

    def axes(self, pose, attitude):
        """From the axes of the load to parent axes."""
        return {"dead": attitude.T, "body": ca.DM.eye(3), "follower": pose.rotation}[self.frame]


def lobatto_rule(n):
    """n + 1 Gauss–Lobatto points on [0, 1], and weights 1/(n (n + 1) P_n²)."""
    series = np.eye(n + 1)[n]
    points = np.array([-1, *np.sort(legendre.legroots(legendre.legder(series))), 1])
    return (1 + points) / 2, 1 / (n * (n + 1) * legendre.legval(points, series) ** 2)


def potential(beam, q, applied, attitude):
    """−Σ F·(p + R r)."""
    total = 0
    for load in applied:
        pose = cc.pose_at(beam, q, load.xi)
        point = pose.position + pose.rotation @ ca.DM(load.offset)
        total -= ca.dot(load.axes(pose, attitude) @ ca.DM(load.force), point)
    return total


def virtual_work(beam, applied, attitude=None):
    """Σ F·∂(p + R r)/∂q + M·∂φ/∂q at the curled weights, ∂φ from ∂R Rᵀ: AD of the poses."""
    attitude = ca.DM.eye(3) if attitude is None else attitude
    q = ca.SX.sym("q", beam.basis.n)
    total = ca.SX(beam.basis.n, 1)
    for load in applied:
        pose = cc.pose_at(beam, q, load.xi)
        axes = load.axes(pose, attitude)
        point = pose.position + pose.rotation @ ca.DM(load.offset)
        total += ca.jacobian(point, q).T @ (axes @ ca.DM(load.force))
        moment = axes @ ca.DM(load.moment)
        for k in range(beam.basis.n):
            spin = ca.reshape(ca.jacobian(ca.vec(pose.rotation), q[k]), 3, 3) @ pose.rotation.T
            total[k] += ca.dot(ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0]), moment)
    return ca.Function("work", [q], [total])(CURLED_WEIGHTS).full()


# Points: bodies, forces and moments at stations of the grid.

DEAD_FORCES = [
    cc.PointForce(0.7, [10.0, -20.0, 30.0], offset=[0.1, 0.5, -0.2]),
    cc.PointForce(0.2, [-15.0, 5.0, 8.0], frame="body", offset=[0.0, -0.3, 0.1]),
]
AS_APPLIED = [
    Applied(0.7, [10.0, -20.0, 30.0], offset=[0.1, 0.5, -0.2]),
    Applied(0.2, [-15.0, 5.0, 8.0], frame="body", offset=[0.0, -0.3, 0.1]),
]
HANGING = [Applied(b.xi, b.mass * ca.DM(GRAVITY), offset=b.offset) for b in BODIES]


@pytest.mark.parametrize("rule", RULES)
def test_dead_forces_and_bodies_do_the_work_of_their_potential(beam, evaluate, rule):
    section = replace(SOFT, mass_per_length=None)
    rod = beam(custom(rule), section=section, bodies=BODIES)
    loads = [*DEAD_FORCES, cc.Gravity(GRAVITY)]
    got = evaluate(lambda q: cc.generalized_force(rod, q, loads, ATTITUDE), CURLED_WEIGHTS)
    q = ca.SX.sym("q", 12)
    slope = -ca.gradient(potential(rod, q, [*AS_APPLIED, *HANGING], ATTITUDE), q)
    expected = ca.Function("f", [q], [slope])(CURLED_WEIGHTS).full()
    assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


LOADS = {
    "follower force": (
        cc.PointForce(0.8, [3.0, -4.0, 5.0], frame="follower", offset=[0.1, 0.2, -0.3]),
        Applied(0.8, [3.0, -4.0, 5.0], frame="follower", offset=[0.1, 0.2, -0.3]),
    ),
    "dead moment": (
        cc.PointMoment(0.9, [30.0, -40.0, 50.0]),
        Applied(0.9, moment=[30.0, -40.0, 50.0]),
    ),
    "follower moment": (
        cc.PointMoment(0.35, [30.0, -40.0, 50.0], frame="follower"),
        Applied(0.35, moment=[30.0, -40.0, 50.0], frame="follower"),
    ),
    "body moment": (
        cc.PointMoment(1.0, [30.0, -40.0, 50.0], frame="body"),
        Applied(1.0, moment=[30.0, -40.0, 50.0], frame="body"),
    ),
    "dead force": (DEAD_FORCES[0], AS_APPLIED[0]),
    "body force": (DEAD_FORCES[1], AS_APPLIED[1]),
}


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("name", LOADS)
def test_point_loads_do_the_virtual_work_of_their_station(beam, name, rule):
    load, applied = LOADS[name]
    rod = beam(custom(rule))
    expected = virtual_work(rod, [applied], ATTITUDE)
    got = cc.generalized_force(rod, CURLED_WEIGHTS, [load], ATTITUDE).full()
    assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", LOADS)
def test_point_loads_of_every_kind_of_expression(beam, evaluate, name):
    load, applied = LOADS[name]
    rod = beam()
    expected = virtual_work(rod, [applied])
    got = evaluate(lambda q: cc.generalized_force(rod, q, [load]), CURLED_WEIGHTS)
    assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", LOADS)
def test_attitude_turns_dead_loads_and_no_others(beam, name):
    load, _ = LOADS[name]
    level, turned = (
        cc.generalized_force(beam(), CURLED_WEIGHTS, [load], a).full() for a in (None, ATTITUDE)
    )
    assert np.allclose(level, turned) == (load.frame != "dead")


def test_loads_add_up(beam):
    rod = beam()
    loads = [load for load, _ in LOADS.values()]
    each = [cc.generalized_force(rod, CURLED_WEIGHTS, [load]).full() for load in loads]
    together = cc.generalized_force(rod, CURLED_WEIGHTS, loads).full()
    # One mesh each: the breaks are stations of this grid already.
    assert_allclose(together, sum(each), atol=1e-12 * np.abs(together).max())


def test_a_load_at_the_root_does_no_work(beam):
    rod = beam(bodies=(cc.Body(xi=0.0, mass=5.0, offset=[1.0, 2.0, 3.0]),))
    loads = [
        cc.PointForce(0.0, [1.0, 2.0, 3.0], offset=[1.0, 1.0, 1.0]),
        cc.PointMoment(0.0, [1.0, 2.0, 3.0]),
    ]
    assert_allclose(cc.generalized_force(rod, CURLED_WEIGHTS, loads), np.zeros((12, 1)), atol=0)


def test_a_point_load_off_the_grid_makes_a_station(beam):
    rod = beam(cc.Grid.uniform(8, max_angle=1.5))
    loads = [cc.PointForce(0.43, [1.0, 2.0, 3.0]), cc.PointMoment(0.77, [1.0, 0.0, 0.0])]
    mesh = loaded_mesh(rod, loads)
    assert {0.43, 0.77} <= set(mesh.stations.tolist())
    with_stations = replace(rod, grid=cc.Grid(boundaries=mesh.stations, max_angle=1.5))
    applied = [Applied(0.43, [1.0, 2.0, 3.0]), Applied(0.77, moment=[1.0, 0.0, 0.0])]
    expected = virtual_work(with_stations, applied)
    got = cc.generalized_force(rod, CURLED_WEIGHTS, loads).full()
    assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


# Distributed loads, by Gauss–Lobatto quadrature at the stations.


def spread(elements, density, offset, frame="dead", field="force"):
    """A density along the span as point loads at Gauss–Lobatto points."""
    points, weights = lobatto_rule(elements)
    return [
        Applied(
            xi,
            frame=frame,
            offset=offset(xi),
            **{field: WING_LENGTH * weight * np.ravel(density(xi))},
        )
        for xi, weight in zip(np.clip(points, 0, 1), weights, strict=True)
    ]


@pytest.mark.parametrize("rule", RULES)
def test_weight_of_the_sections_does_the_work_of_its_potential(beam, evaluate, rule):
    rod = beam(cc.Grid.lobatto(9, rule=rule, max_angle=1.5))
    mass, centre = SOFT.mass_per_length, lambda xi: SOFT.center_of_mass(xi).full().ravel()
    applied = spread(9, lambda xi: mass(xi) * np.array(GRAVITY), centre)
    got = evaluate(
        lambda q: cc.generalized_force(rod, q, [cc.Gravity(GRAVITY)], ATTITUDE), CURLED_WEIGHTS
    )
    q = ca.SX.sym("q", 12)
    slope = -ca.gradient(potential(rod, q, applied, ATTITUDE), q)
    expected = ca.Function("f", [q], [slope])(CURLED_WEIGHTS).full()
    assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


def density(xi):
    return np.array([1.0 + xi, -2.0 * xi, 3.0 - xi**2])


def offset(xi):
    return np.array([0.0, 0.3 - 0.1 * xi, 0.05])


@pytest.mark.parametrize("frame", ["dead", "follower", "body"])
@pytest.mark.parametrize("field", ["force", "moment"])
def test_distributed_loads_do_the_virtual_work_of_their_stations(beam, frame, field):
    rod = beam(cc.Grid.lobatto(9, max_angle=1.5))
    if field == "force":
        load = cc.DistributedForce(density, frame=frame, offset=offset)
    else:
        load = cc.DistributedMoment(density, frame=frame)
    expected = virtual_work(rod, spread(9, density, offset, frame, field), ATTITUDE)
    got = cc.generalized_force(rod, CURLED_WEIGHTS, [load], ATTITUDE).full()
    assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


def test_a_distributed_load_against_an_ode(wing):
    """Power of a dead load on the curled wing, by differences of its ODE solution."""
    grid = cc.Grid.lobatto(32, rule="magnus6", max_angle=1.5)
    rod = replace(wing(section=SOFT), grid=grid)
    load = np.array([0.0, 2.0, 3.0])
    nodes, weights = np.polynomial.legendre.leggauss(24)

    def energy(step):
        direction = 1e-3 * np.cos(np.arange(12))

        def curvature(xi):
            bend = (step * direction).reshape(3, 4) @ legendre.legval(2 * xi - 1, np.eye(4))
            return curled_curvature(xi) + bend

        poses = integrate(curvature, WING_LENGTH, (1 + nodes) / 2)
        return WING_LENGTH / 2 * sum(w * load @ p for w, (_, p) in zip(weights, poses, strict=True))

    # Fourth-order differences, steps of 1e-3 rad/m: 1e-9 of the power.
    power = (8 * (energy(1) - energy(-1)) - (energy(2) - energy(-2))) / 12
    force = cc.generalized_force(rod, CURLED_WEIGHTS, [cc.DistributedForce(load)]).full().ravel()
    assert_allclose(force @ (1e-3 * np.cos(np.arange(12))), power, rtol=1e-7)


def test_a_jump_of_a_load_is_integrated_on_both_sides(wing):
    """Work on the mean in-plane curvature of a straight wing: L² ∫ q(xi) xi²/2 dxi."""
    rod = replace(wing(section=SOFT), grid=cc.Grid.lobatto(8))
    steps = cc.Steps([0, 0.3, 0.7, 1], [[0, 1, 0], [0, 5, 0], [0, -2, 0]])
    got = cc.generalized_force(rod, np.zeros(12), [cc.DistributedForce(steps)]).full()[8, 0]
    edges = np.array([0, 0.3, 0.7, 1]) ** 3
    expected = WING_LENGTH**3 / 6 * np.diff(edges) @ [1, 5, -2]
    assert_allclose(got, expected, rtol=1e-13)


# Derivatives, symbols, cost.

EVERY = [load for load, _ in LOADS.values()] + [
    cc.Gravity(GRAVITY),
    cc.DistributedForce(density, frame="follower", offset=offset),
    cc.DistributedForce([1.0, 2.0, 3.0], offset=[0.1, 0.2, 0.3]),
    cc.DistributedMoment(density),
]
WITH_POTENTIAL = [*DEAD_FORCES, cc.Gravity(GRAVITY), cc.DistributedForce(density, offset=offset)]


def slope_of_loads(rod, q, loads):
    """dQ/dq by the two passes, without stiffness."""
    _, tangent = cc.equilibrium_tangent(rod, q, loads, ATTITUDE)
    return -tangent


@pytest.mark.parametrize("rule", RULES)
def test_the_derivative_of_the_loads_is_that_of_ad(beam, evaluate, rule):
    rod = beam(custom(rule), bodies=BODIES)
    q = ca.SX.sym("q", 12)
    by_ad = ca.jacobian(cc.generalized_force(rod, q, EVERY, ATTITUDE), q)
    expected = ca.Function("f", [q], [by_ad])(CURLED_WEIGHTS).full()
    got = evaluate(lambda q: slope_of_loads(rod, q, EVERY), CURLED_WEIGHTS)
    assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", LOADS)
def test_the_derivative_of_each_load_is_that_of_ad(beam, name):
    load, _ = LOADS[name]
    rod = beam()
    q = ca.SX.sym("q", 12)
    by_ad = ca.jacobian(cc.generalized_force(rod, q, [load], ATTITUDE), q)
    expected = ca.Function("f", [q], [by_ad])(CURLED_WEIGHTS).full()
    got = slope_of_loads(rod, CURLED_WEIGHTS, [load]).full()
    assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


def test_the_residual_of_the_tangent_is_the_residual(beam):
    rod = beam(section=cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6, mass_per_length=0.75), bodies=BODIES)
    residual, tangent = cc.equilibrium_tangent(rod, CURLED_WEIGHTS, EVERY, ATTITUDE)
    expected = cc.equilibrium_residual(rod, CURLED_WEIGHTS, EVERY, ATTITUDE).full()
    assert_allclose(residual.full(), expected, atol=1e-12 * np.abs(expected).max())
    q = ca.SX.sym("q", 12)
    by_ad = ca.jacobian(cc.equilibrium_residual(rod, q, EVERY, ATTITUDE), q)
    expected = ca.Function("f", [q], [by_ad])(CURLED_WEIGHTS).full()
    assert_allclose(tangent.full(), expected, atol=1e-12 * np.abs(expected).max())


def asymmetry(rod, loads):
    slope = slope_of_loads(rod, CURLED_WEIGHTS, loads).full()
    return np.abs(slope - slope.T).max() / np.abs(slope).max()


def test_the_derivative_is_symmetric_where_there_is_a_potential(beam):
    rod = beam(bodies=BODIES)
    for load in WITH_POTENTIAL:
        assert asymmetry(rod, [load]) <= 1e-13  # rounding
    q = ca.SX.sym("q", 12)
    curved = -ca.hessian(potential(rod, q, AS_APPLIED, ATTITUDE), q)[0]
    expected = ca.Function("f", [q], [curved])(CURLED_WEIGHTS).full()
    got = slope_of_loads(rod, CURLED_WEIGHTS, DEAD_FORCES).full()
    assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(
    "load",
    [
        LOADS["follower force"][0],
        LOADS["dead moment"][0],
        LOADS["body moment"][0],
        cc.DistributedForce(density, frame="follower"),
        cc.DistributedMoment(density),
    ],
    ids=["force", "dead moment", "body moment", "distributed force", "distributed moment"],
)
def test_the_derivative_is_unsymmetric_where_there_is_none(beam, load):
    assert asymmetry(beam(), [load]) > 1e-2


def test_magnitudes_offsets_and_attitude_may_be_symbols(beam, symbolic):
    force, lever, turn = (symbolic.sym(*s) for s in (("F", 3), ("r", 3), ("R", 3, 3)))
    moment, acceleration = symbolic.sym("M", 3), symbolic.sym("g", 3)
    rod = beam(bodies=BODIES)

    def loads(F, r, M, g):
        return [
            cc.PointForce(0.7, F, offset=r),
            cc.PointForce(0.8, F, frame="follower", offset=r),
            cc.PointMoment(1.0, M),
            cc.DistributedForce(lambda xi: xi * F),
            cc.DistributedMoment(M, frame="follower"),
            cc.Gravity(g),
        ]

    q = symbolic.sym("q", 12)
    residual, tangent = cc.equilibrium_tangent(
        rod, q, loads(force, lever, moment, acceleration), turn
    )
    f = ca.Function("f", [q, force, lever, moment, acceleration, turn], [residual, tangent])
    numbers = ([1.0, 2.0, 3.0], [0.1, 0.2, 0.3], [5.0, -4.0, 3.0], GRAVITY)
    got = f(CURLED_WEIGHTS, *numbers, ATTITUDE)
    as_dm = loads(*(ca.DM(x) for x in numbers))
    expected = cc.equilibrium_tangent(rod, CURLED_WEIGHTS, as_dm, ATTITUDE)
    for a, b in zip(got, expected, strict=True):
        assert_allclose(a.full(), b.full(), atol=1e-12 * np.abs(b.full()).max())


def follower_wing(elements):
    family = {"torsion": cc.Legendre(3), "out_of_plane": cc.Legendre(3), "in_plane": cc.Legendre(2)}
    return cc.Beam(
        length=1.0,
        basis=cc.ChannelBasis(**family),
        grid=cc.Grid.lobatto(elements),
        section=cc.Section(GJ=1, EI_y=1, EI_z=1),
    )


def node_counts(elements):
    """Nodes of the residual, and of residual and derivative, SX."""
    q, force = ca.SX.sym("q", 8), ca.SX.sym("F", 3)
    rod = follower_wing(elements)
    loads = [cc.PointForce(1.0, force, frame="follower")]
    residual = cc.equilibrium_residual(rod, q, loads)
    outputs = ([residual], cc.equilibrium_tangent(rod, q, loads))
    return [
        ca.Function("f", [q, force], [*output], {"cse": True}).n_instructions()
        for output in outputs
    ]


def test_nodes_per_element():
    residual, with_derivative = np.array(node_counts(16)) / 16
    assert residual <= 500
    assert with_derivative <= 4300


def test_cost_is_linear_in_the_number_of_elements():
    small, middle, large = (np.array(node_counts(n)) for n in (10, 20, 40))
    # Each doubling adds twice what the one before added; a quadratic cost would add four times.
    assert_allclose((large - middle) / (middle - small), [2, 2], rtol=0.02)


# Bad input.


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: cc.PointForce(1.2, [0, 0, 1]), r"PointForce\.xi: expected .*\[0, 1\], found 1\.2"),
        (lambda: cc.PointMoment(-0.1, [0, 0, 1]), r"PointMoment\.xi: expected .* found -0\.1"),
        (lambda: cc.PointForce(ca.SX.sym("xi"), [0, 0, 1]), r"PointForce\.xi: .* symbol xi"),
        (lambda: cc.PointForce(1, [0, 1]), r"PointForce\.force: expected shape \(3, 1\), found"),
        (lambda: cc.PointForce(1, [0, 0, np.nan]), r"PointForce\.force: expected finite"),
        (lambda: cc.PointForce(1, [0, 0, 1], offset=[1]), r"PointForce\.offset: .*\(3, 1\)"),
        (lambda: cc.PointForce(1, [0, 0, 1], "live"), r"PointForce\.frame: .*'dead'.*'live'"),
        (lambda: cc.PointMoment(1, [0, 0, 1], "live"), r"PointMoment\.frame: .*found 'live'"),
        (lambda: cc.PointMoment(1, 3.0), r"PointMoment\.moment: expected shape \(3, 1\)"),
        (lambda: cc.DistributedForce([1, 2]), r"DistributedForce\.force: expected shape"),
        (lambda: cc.DistributedForce([0, 0, 1], "live"), r"DistributedForce\.frame: .*'live'"),
        (lambda: cc.DistributedMoment([1, 2]), r"DistributedMoment\.moment: expected shape"),
        (lambda: cc.DistributedMoment([0, 0, 1], "x"), r"DistributedMoment\.frame: .*'x'"),
        (lambda: cc.Gravity(9.81), r"Gravity\.acceleration: expected shape \(3, 1\)"),
        (lambda: cc.Gravity([0, 0, "down"]), r"Gravity\.acceleration: expected numbers"),
    ],
)
def test_bad_loads_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_what_is_no_load_is_refused(beam):
    with pytest.raises(ValueError, match=r"loads: expected loads such as PointForce.*found 3"):
        cc.generalized_force(beam(), CURLED_WEIGHTS, [3])


def test_a_load_that_varies_to_a_wrong_shape_names_the_station(beam):
    load = cc.DistributedForce(lambda xi: [1.0, xi])
    with pytest.raises(ValueError, match=r"DistributedForce\.force at xi = .*shape \(3, 1\)"):
        cc.generalized_force(beam(), CURLED_WEIGHTS, [load])


@pytest.mark.parametrize("section", [None, cc.Section(GJ=1, EI_y=1, EI_z=1)], ids=["none", "light"])
def test_gravity_needs_a_mass(beam, section):
    rod = beam(section=section)
    with pytest.raises(ValueError, match=r"Gravity: expected a Section with mass_per_length"):
        cc.generalized_force(rod, CURLED_WEIGHTS, [cc.Gravity(GRAVITY)])


def test_a_negative_density_along_the_span_is_refused(beam):
    rod = beam(section=replace(SOFT, mass_per_length=lambda xi: 0.5 - xi))
    message = r"Section\.mass_per_length at xi = .*not below zero, found -"
    with pytest.raises(ValueError, match=message):
        cc.generalized_force(rod, CURLED_WEIGHTS, [cc.Gravity(GRAVITY)])


def test_symbols_of_another_kind_are_refused(beam):
    load = cc.PointForce(1.0, ca.MX.sym("F", 3))
    with pytest.raises(ValueError, match=r"q is SX, loads at xi = 1 is MX"):
        cc.generalized_force(beam(), ca.SX.sym("q", 12), [load])
