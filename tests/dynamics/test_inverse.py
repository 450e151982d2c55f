"""Equations of motion against Lagrange's equations by AD, in every kind of expression."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from tests.support.lagrangian import lagrange_function
from tests.support.moving_wing import GRAVITY, STATES, N, close, evaluated, motion, wing

KINDS = pytest.mark.parametrize("kind", ["SX", "MX", "DM"])
WEIGHT = [cc.Gravity(GRAVITY)]


@pytest.fixture(scope="module")
def lagrange():
    return lagrange_function(wing(), GRAVITY)


@KINDS
def test_residual_mass_and_energy_are_those_of_lagrange(lagrange, kind):
    beam, values = wing(), motion()

    def found(q, q_dot, q_ddot):
        residual = cc.inverse_dynamics(beam, q, q_dot, q_ddot, WEIGHT)
        energies = [cc.kinetic_energy(beam, q, q_dot), cc.potential_energy(beam, q, WEIGHT)]
        return [residual, cc.mass_matrix(beam, q), *energies]

    residual, matrix, energy, potential = evaluated(kind, values, found)
    expected = lagrange(*values)
    close(potential, expected[3])
    close(residual, expected[0])
    close(matrix, expected[1])
    close(energy, expected[2])
    np.testing.assert_array_equal(matrix.full(), matrix.full().T)
    assert np.linalg.eigvalsh(matrix.full())[0] > 0


@KINDS
def test_forward_dynamics_invert_inverse_dynamics(kind):
    beam, (q, q_dot, _) = wing(), motion(seed=2)
    loads = [*WEIGHT, cc.PointForce(1.0, [0, 3.0, -20.0], "follower")]
    (q_ddot,) = evaluated(kind, [q, q_dot], lambda q, v: [cc.forward_dynamics(beam, q, v, loads)])
    left = cc.inverse_dynamics(beam, q, q_dot, q_ddot, loads)
    inertial = cc.mass_matrix(beam, q) @ q_ddot
    # The residual of a solve in double precision, beside the forces that it balances.
    np.testing.assert_allclose(left.full(), 0, atol=1e-11 * float(ca.norm_inf(inertial)))


@pytest.mark.parametrize("rule", ["trapezoid", "midpoint", "magnus6"])
def test_every_rule_gives_the_lagrangian_of_its_own_poses(rule):
    beam, values = wing(rule), motion(seed=3)
    found = cc.inverse_dynamics(beam, *values, WEIGHT)
    close(found, lagrange_function(beam, GRAVITY)(*values)[0])


def test_closed_exponential_and_series_agree():
    values = motion(seed=4)
    closed = wing(grid=cc.Grid.lobatto(6, exponential="rodrigues"))
    close(cc.inverse_dynamics(closed, *values), cc.inverse_dynamics(wing(), *values))


def test_the_straight_wing_is_right_with_its_second_derivatives(lagrange):
    beam, zero = wing(), np.zeros(N)
    symbols = [ca.SX.sym(name, N) for name in STATES]
    residual = cc.inverse_dynamics(beam, *symbols, WEIGHT)
    total = ca.dot(residual, residual)
    hessian = ca.Function("H", symbols, [ca.hessian(total, ca.vertcat(*symbols[:2]))[0]])
    assert np.all(np.isfinite(hessian(zero, zero, zero).full()))
    values = [zero, *motion(seed=5)[1:]]
    close(cc.inverse_dynamics(beam, *values, WEIGHT), lagrange(*values)[0])


def test_a_moving_root_enters_as_lagrange_has_it():
    rng = np.random.default_rng(6)
    root = cc.RootMotion(
        pose=cc.Pose(rotation=cc.lie.so3.exp(ca.DM([0.4, 0.2, -0.3])), position=[3.0, 1.0, 2.0]),
        twist=rng.normal(size=6),
        twist_rate=rng.normal(size=6),
        gravity=GRAVITY,
    )
    beam, values = wing(), motion(seed=6)
    expected, _, kinetic, _ = lagrange_function(beam, GRAVITY, root)(*values)
    close(cc.inverse_dynamics(beam, *values, root=root), expected)
    close(cc.kinetic_energy(beam, *values[:2], root=root), kinetic)
    # The same with the twist as a symbol.
    twist = ca.MX.sym("twist", 6)
    weights = [ca.MX(ca.DM(x)) for x in values]
    found = cc.inverse_dynamics(beam, *weights, root=replace(root, twist=twist))
    close(ca.Function("r", [twist], [found])(root.twist), expected)


LOADS = [
    cc.PointForce(1.0, [1.0, 5.0, -20.0], "dead", offset=[0, 0.2, 0.1]),
    cc.PointMoment(1.0, [3.0, 1.0, 2.0], "follower"),
    cc.DistributedForce([0.3, 1.0, -4.0], "body", offset=[0, 0.1, 0]),
    cc.DistributedMoment([0.3, 0.2, 0.1], "dead"),
    cc.Gravity(GRAVITY),
]


@pytest.mark.parametrize("load", LOADS, ids=lambda load: type(load).__name__)
def test_at_rest_the_residual_is_that_of_equilibrium(load):
    attitude = cc.lie.so3.exp(ca.DM([0.4, 0.2, -0.3]))
    beam, (q, _, _), zero = wing(), motion(seed=7), np.zeros(N)
    # Weightless gravity gives statics the same stations where the load alone needs fewer.
    loads = [load] if isinstance(load, cc.Gravity) else [load, cc.Gravity([0, 0, 0])]
    root = cc.RootMotion(pose=cc.Pose(rotation=attitude, position=[0, 0, 0]))
    found = cc.inverse_dynamics(beam, q, zero, zero, loads, root)
    close(found, cc.equilibrium_residual(beam, q, loads, attitude), 1e-11)


def test_design_symbols_reach_mass_length_and_root():
    def build(mass, length, incidence, offset):
        section = cc.Section(
            GJ=1e4,
            EI_y=2e4,
            EI_z=4e6,
            mass_per_length=mass,
            inertia=np.diag([0.1, 0.01, 0.09]),
            center_of_mass=ca.vertcat(0, offset, 0),
        )
        rotation = cc.lie.so3.exp(ca.vertcat(0, incidence, 0))
        root = cc.Pose(rotation=rotation, position=[0, 0, 0])
        return wing(section=section, length=length, root=root, bodies=())

    symbols = [ca.MX.sym(name) for name in ("mass", "length", "incidence", "offset")]
    point, values = (0.9, 14.0, 0.2, -0.3), motion(seed=8)
    weights = [ca.MX(ca.DM(x)) for x in values]
    found = ca.Function("r", symbols, [cc.inverse_dynamics(build(*symbols), *weights, WEIGHT)])
    close(found(*point), cc.inverse_dynamics(build(*point), *values, WEIGHT))


def test_mirrored_wings_move_alike():
    root = cc.Pose(rotation=[[0, 1, 0], [1, 0, 0], [0, 0, -1]], position=[0, 0.4, 0])
    right, values = wing(root=root), motion(seed=9)
    left, loads = cc.mirror(right), [cc.Gravity([2.0, 0.0, 9.81])]  # in the plane of symmetry
    close(cc.inverse_dynamics(left, *values, loads), cc.inverse_dynamics(right, *values, loads))
    close(cc.mass_matrix(left, values[0]), cc.mass_matrix(right, values[0]))


def test_the_compact_residual_is_a_chain_of_calls_without_derivatives():
    symbols = [ca.MX.sym(name, N) for name in STATES]
    residual = cc.inverse_dynamics(wing(), *symbols, WEIGHT)
    names = {g.name() for g in ca.Function("r", symbols, [residual]).find_functions()}
    assert {"element_outward", "element_inward"} <= names
    assert not any(name.startswith(("fwd", "adj", "jac")) for name in names)


def section(**fields):
    return cc.Section(**{"GJ": 1e4, "EI_y": 2e4, "EI_z": 4e6, "mass_per_length": 0.75, **fields})


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"section": section(), "bodies": ()}, r"Section\.inertia.*rotary inertia.*torsion"),
        ({"section": section(mass_per_length=None), "bodies": ()}, "need mass"),
        ({"section": None}, "need mass"),
    ],
    ids=["torsion", "no mass", "no section"],
)
def test_inertia_that_makes_no_sense_is_refused_by_name(fields, message):
    with pytest.raises(ValueError, match=message):
        cc.inverse_dynamics(wing(**fields), *motion())


def test_negative_inertia_is_refused_by_name():
    negative = np.diag([1.0, 1.0, -0.5])
    with pytest.raises(ValueError, match=r"Section\.inertia: .*negative"):
        section(inertia=negative)
    with pytest.raises(ValueError, match=r"Body\.inertia: .*negative"):
        cc.Body(xi=0.5, mass=1.0, inertia=negative)
    varying = section(inertia=lambda xi: np.diag([0.1, 0.1, 0.1 - xi]))
    with pytest.raises(ValueError, match=r"Section\.inertia at xi = .*negative"):
        cc.mass_matrix(wing(section=varying), np.zeros(N))


def test_gravity_given_twice_is_refused():
    root = cc.RootMotion(gravity=[0, 0, 9.81])
    with pytest.raises(ValueError, match="twice"):
        cc.inverse_dynamics(wing(), *motion(), WEIGHT, root)


def test_the_potential_of_other_loads_is_refused():
    with pytest.raises(ValueError, match="Gravity alone"):
        cc.potential_energy(wing(), np.zeros(N), [cc.PointForce(1.0, [0, 0, 1.0])])


def test_wrong_shapes_and_kinds_are_named():
    q, v, a = motion()
    with pytest.raises(ValueError, match="q_ddot: expected shape"):
        cc.inverse_dynamics(wing(), q, v, a[:3])
    with pytest.raises(ValueError, match="one kind"):
        cc.inverse_dynamics(wing(), ca.SX.sym("q", N), ca.MX.sym("v", N), a)
    with pytest.raises(ValueError, match="RootMotion"):
        cc.forward_dynamics(wing(), q, v, root="clamped")


@pytest.mark.parametrize(
    "of",
    [
        cc.mass_matrix,
        cc.natural_frequencies,
        lambda beam, q: cc.inverse_dynamics(beam, q, q, q),
        lambda beam, q: cc.forward_dynamics(beam, q, q),
        lambda beam, q: cc.kinetic_energy(beam, q, q),
    ],
)
def test_weights_that_turn_an_element_too_far_are_refused(of):
    with pytest.raises(ValueError, match=r"q: expected every element to turn at most Grid\.max_an"):
        of(wing(), np.full(N, 9.0))
