"""Free flight against Lagrange's equations of the whole aircraft by AD."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.dynamics.inertia import inertial_mesh
from curvcasadi.lie import so3
from curvcasadi.statics.energy import strain_energy
from tests.support.lagrangian import lumps, relative_poses
from tests.support.moving_wing import close, evaluated

GRAVITY = 9.7
ATTITUDE = so3.exp(ca.DM([0.2, -0.3, 0.9]))
THRUST = {"engine": 35.0}
N = 8


@cache
def aircraft():
    """Two half wings without strips, one with a load of its own, a body and an inclined engine."""
    basis = cc.ChannelBasis(
        torsion=cc.Legendre(1), out_of_plane=cc.Legendre(2), in_plane=cc.Legendre(1)
    )
    section = cc.Section(
        GJ=1e4,
        EI_y=2e4,
        EI_z=4e6,
        mass_per_length=0.75,
        inertia=np.diag([0.1, 0.02, 0.09]) + 0.005,
        center_of_mass=(0, -0.1, 0.05),
    )
    root = cc.Pose(
        rotation=ca.DM([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) @ so3.exp(ca.DM([0.05, 0.1, -0.2])),
        position=[0.3, 0.4, -0.2],
    )
    beam = cc.Beam(
        length=16.0,
        basis=basis,
        grid=cc.Grid.lobatto(3),
        section=section,
        root=root,
        bodies=(cc.Body(xi=0.0, mass=1.5, offset=(0, 0.1, 0)), cc.Body(xi=1.0, mass=0.7)),
    )
    right = cc.Wing(name="right", beam=beam)
    body = cc.RigidBody(
        mass=50.0, center_of_mass=[0.1, 0, 0.2], inertia=np.diag([40.0, 30, 50]) + 2
    )
    engine = cc.Thrust(name="engine", position=[0.5, 0.1, -0.3], direction=[0.8, 0.0, -0.6])
    return cc.Aircraft(body=body, beams=(right, cc.mirror_wing(right, "left")), thrusts=(engine,))


def motion(seed=0):
    """q, velocity, acceleration."""
    rng = np.random.default_rng(seed)
    return [
        0.05 * rng.normal(size=N),
        np.r_[rng.normal(size=6), 0.1 * rng.normal(size=N)],
        np.r_[rng.normal(size=6), 0.3 * rng.normal(size=N)],
    ]


@cache
def lagrange():
    """(q, velocity, acceleration, dR) -> residual, kinetic energy, momenta, ∂T/∂q.

    Coordinates are φ and ψ of R = R_0 exp(φ), p = ψ, and q; at φ = 0 the body twist is
    (dφ/dt, R_0ᵀ dψ/dt), and its rates are d²φ/dt² and R_0ᵀ d²ψ/dt² − ω × v.
    """
    plane = aircraft()
    x, rate, rate2 = (ca.MX.sym(name, 6 + N) for name in ("x", "x_dot", "x_ddot"))
    rotation, position = ATTITUDE @ so3.exp(x[:3]), x[3:6]
    masses = [(position, rotation, plane.body.mass, plane.body.center_of_mass, plane.body.inertia)]
    potential = 0
    for wing, q in zip(plane.beams, ca.vertsplit(x[6:], N // 2), strict=True):
        mesh = inertial_mesh(wing.beam, ())
        potential += strain_energy(wing.beam, q)
        frames = [
            (wing.beam.root.position + wing.beam.root.rotation @ p, wing.beam.root.rotation @ R)
            for R, p in relative_poses(wing.beam, q, mesh)
        ]
        for node, *lump in lumps(wing.beam, mesh):
            p, R = frames[node]
            masses.append((position + rotation @ p, rotation @ R, *lump))
    kinetic = 0
    for origin, frame, mass, center, inertia in masses:
        at = origin + frame @ ca.DM(center)
        velocity = ca.jtimes(at, x, rate)
        omega = so3.vee(frame.T @ ca.reshape(ca.jtimes(ca.vec(frame), x, rate), 3, 3))
        kinetic += mass * ca.sumsqr(velocity) / 2 + omega.T @ ca.DM(inertia) @ omega / 2
        potential -= mass * GRAVITY * at[2]
    momentum = ca.gradient(kinetic, rate)
    force = ca.jtimes(momentum, ca.vertcat(x, rate), ca.vertcat(rate, rate2))
    force += ca.gradient(potential - kinetic, x)

    q, velocity, acceleration = (ca.MX.sym("q", N), ca.MX.sym("V", 6 + N), ca.MX.sym("A", 6 + N))
    omega, v = velocity[:3], velocity[3:6]
    linear = ATTITUDE @ (acceleration[3:6] + ca.cross(omega, v))
    values = [
        ca.vertcat(ca.DM.zeros(6), q),
        ca.vertcat(omega, ATTITUDE @ v, velocity[6:]),
        ca.vertcat(acceleration[:3], linear, acceleration[6:]),
    ]
    in_body = [ca.vertcat(y[:3], ATTITUDE.T @ y[3:6], y[6:]) for y in (force, momentum)]
    outputs = [*in_body, kinetic, ca.gradient(kinetic, x)[6:]]
    plain = ca.Function("lagrange", [x, rate, rate2], outputs)
    return ca.Function("lagrange", [q, velocity, acceleration], plain.call(values))


def thrust_wrench():
    engine = aircraft().thrusts[0]
    force = THRUST["engine"] * engine.direction
    return ca.vertcat(ca.cross(engine.position, force), force, ca.DM.zeros(N))


OPTIONS = {"inputs": THRUST, "gravity": GRAVITY, "attitude": ATTITUDE}


@pytest.mark.parametrize("kind", ["SX", "MX", "DM"])
def test_free_flight_is_that_of_lagrange(kind):
    values = motion()

    def found(q, velocity, acceleration):
        momenta = cc.free_momenta(aircraft(), q, velocity)
        return [
            cc.free_inverse_dynamics(aircraft(), q, velocity, acceleration, **OPTIONS),
            momenta.velocities,
            cc.free_kinetic_energy(aircraft(), q, velocity),
            momenta.by_shape,
            cc.free_mass_matrix(aircraft(), q),
        ]

    residual, momenta, energy, by_shape, matrix = evaluated(kind, values, found)
    expected = lagrange()(*values)
    close(residual, expected[0] - thrust_wrench(), 1e-12)
    close(momenta, expected[1])
    close(energy, expected[2])
    close(by_shape, expected[3])
    close(matrix @ values[1], expected[1])
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-12 * float(ca.norm_inf(matrix)))
    assert np.linalg.eigvalsh(matrix.full())[0] > 0


@pytest.mark.parametrize("kind", ["SX", "MX", "DM"])
def test_forward_dynamics_of_free_flight_invert_its_inverse_dynamics(kind):
    q, velocity, _ = motion(1)
    (acceleration,) = evaluated(
        kind,
        [q, velocity],
        lambda q, v: [cc.free_forward_dynamics(aircraft(), q, v, **OPTIONS)],
    )
    left = cc.free_inverse_dynamics(aircraft(), q, velocity, acceleration, **OPTIONS)
    size = float(ca.norm_inf(cc.free_mass_matrix(aircraft(), q) @ acceleration))
    np.testing.assert_allclose(left.full(), 0, atol=1e-10 * size)


def test_an_aircraft_without_loads_falls_with_gravity():
    rest = np.zeros(6 + N)
    acceleration = cc.free_forward_dynamics(aircraft(), np.zeros(N), rest, attitude=ATTITUDE)
    expected = ca.vertcat(0, 0, 0, ATTITUDE.T @ ca.DM([0, 0, 9.80665]), ca.DM.zeros(N))
    np.testing.assert_allclose(acceleration.full(), expected.full(), atol=1e-11)


def jacobians(f, values):
    symbols = [ca.MX.sym(f"x{i}", *f.size_in(i)) for i in range(f.n_in())]
    residual = f.call(symbols)[0]
    blocks = [ca.jacobian(residual, x) for x in symbols]
    return ca.Function("J", symbols, blocks).call([ca.DM(x) for x in values])


@pytest.mark.parametrize("form", ["compact", "unrolled"])
def test_structured_derivatives_of_free_flight_are_those_of_the_residual(form):
    kind = ca.MX if form == "compact" else ca.SX
    force, fall = kind.sym("force", 3), kind.sym("fall")
    parameters = {"force": force, "engine": kind.sym("engine"), "fall": fall}
    pushed = cc.PointForce(1.0, force, "dead", offset=[0, 0.1, 0])
    options = {
        "inputs": {"engine": parameters["engine"]},
        "gravity": fall,
        "loads": {"left": [pushed]},
    }
    f = cc.free_inverse_dynamics_function(aircraft(), parameters, form=form, **options)
    states = [kind.sym("attitude", 3, 3), kind.sym("q", N)]
    states += [kind.sym("velocity", 6 + N), kind.sym("acceleration", 6 + N)]
    residual = cc.free_inverse_dynamics(aircraft(), *states[1:], attitude=states[0], **options)
    plain = ca.Function("plain", [*states, *parameters.values()], [residual])
    values = [ATTITUDE, *motion(2), [3.0, -4.0, 12.0], 35.0, 9.7]
    close(f(*values), plain(*values))
    names = f.name_in()
    for name, block, by_ad in zip(
        names, jacobians(f, values), jacobians(plain, values), strict=True
    ):
        assert float(ca.norm_inf(by_ad)) > 0, name
        close(block, by_ad, 1e-11)


def test_one_beam_without_a_body_flies_alone():
    alone = cc.Aircraft(body=cc.NoBody(), beams=aircraft().beams[:1])
    q, velocity, _ = motion(3)
    q, velocity = q[: N // 2], velocity[: 6 + N // 2]
    acceleration = cc.free_forward_dynamics(alone, q, velocity, gravity=0.0)
    needed = cc.free_inverse_dynamics(alone, q, velocity, acceleration, gravity=0.0)
    # No wrench acts on the free root, beside the inertial forces.
    size = float(ca.norm_inf(cc.free_mass_matrix(alone, q) @ acceleration))
    np.testing.assert_allclose(needed[:6].full(), 0, atol=1e-10 * size)


def test_what_free_flight_lacks_is_named():
    plane = aircraft()
    bare = replace(plane, body=cc.RigidBody(mass=50.0, center_of_mass=[0, 0, 0]))
    with pytest.raises(ValueError, match=r"RigidBody\.inertia"):
        cc.free_mass_matrix(bare, np.zeros(N))
    with pytest.raises(ValueError, match="velocity: expected shape"):
        cc.free_momenta(plane, np.zeros(N), np.zeros(N))
    with pytest.raises(ValueError, match="inputs"):
        cc.free_inverse_dynamics(plane, *motion(), inputs={"motor": 1.0})
    with pytest.raises(ValueError, match="names of wings"):
        cc.free_inverse_dynamics(plane, *motion(), loads={"middle": []})
