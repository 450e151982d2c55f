"""Free flight in air: the airloads of moving strips, gusts, derivatives, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.aero import section
from curvcasadi.aero.air_states import state_parts
from curvcasadi.aero.stations import air_stations, section_data
from curvcasadi.control.aircraft_model import _gusts, flight_state
from curvcasadi.lie import se3
from tests.support.flying_aircraft import DENSITY, aircraft, anywhere

LAG = cc.IndicialLag(poles=2, modes=2)
ENTRY = cc.GustEntry(modes=2)


def field(position, time):
    """A gust that differs from place to place, along all axes."""
    wave = ca.sin(0.2 * position[0] + 0.3 * position[1] - 0.1 * position[2] + time)
    return ca.vertcat(wave, 0.5 * wave**2, -2 * wave)


def made(density):
    return cc.aircraft_model(
        aircraft(), density=density, gravity=0, lag=LAG, gust=cc.GustField(field), entry=ENTRY
    )


@pytest.fixture(scope="module")
def model():
    return made(DENSITY)


@pytest.fixture(scope="module")
def dense():
    """The same in air twice as dense: what the air does is the difference between the two."""
    return made(2 * DENSITY)


def adjoint(pose):
    """Takes a twist in the axes of the parent to the axes at `pose`."""
    inward = pose.inverse()
    return se3.adjoint(se3.matrix(inward.rotation, inward.position))


def test_parts_stand_in_their_order(model):
    sizes = {part.name: part.size for part in model.x.parts}
    assert sizes == {
        "quaternion_wxyz": 4, "position": 3, "q_right": 4, "q_left": 4,
        "twist": 6, "q_dot_right": 4, "q_dot_left": 4,
        "lag_right": 8, "lag_left": 8, "lag_tail": 4,
    }  # fmt: skip
    assert [part.name for part in model.u.parts] == ["aileron", "elevator", "thrust"]
    assert [part.name for part in model.p.parts] == ["time"]


def strip_loads(pose, jacobian, twist, t, strip, values, gust):
    """Generalized forces of a strip and rates of its states; `twist` is its own as it moves in t.

    Body Jacobian by all velocities, `section` data, states, and the gust in body axes.
    """
    found = ca.Function("at", [t], [twist, ca.jacobian(twist, t)])(0)
    (omega, velocity), rate = ca.vertsplit(found[0], 3), found[1]
    u = section.circulation(velocity, omega, strip)
    u_e = u.velocity / 2 + ca.dot(ca.DM(LAG.amplitudes), values[:2])
    u_e += ca.dot(ca.DM(ENTRY.poles.amplitudes), values[2:])
    wrench = section.circulatory_wrench(velocity, omega, strip, u.velocity, u_e)
    wrench += section.apparent_wrench(velocity, omega, rate[3:], rate[:3], strip)
    local = pose.rotation.T @ gust
    entered = section.circulation(velocity - local, omega, strip).velocity - u.velocity
    targets = ca.vertcat(u.velocity, u.velocity, entered, entered)
    pace = ca.DM(np.r_[LAG.rates, ENTRY.poles.rates]) * 2 * u.speed / strip.chord
    return (jacobian.T @ wrench).full().ravel(), (pace * (targets - values)).full().ravel()


def airloads(model, x, acceleration, u, p):
    """Generalized forces (6 + n,) of the air and rates of its states, strip by strip.

    Each strip has its own body Jacobian, and the rates of its twist by AD along the motion.
    """
    plane, inputs = aircraft(), model.u.split(ca.DM(u))
    state = flight_state(plane, model.x.split(ca.DM(x)))
    t, total, first = ca.MX.sym("t"), np.zeros(acceleration.size), 6
    twist, rates = state.twist + t * acceleration[:6], []

    def added(strips, xi, measure, pose, jacobian, moving, values, rows):
        strip = section_data(strips, xi, inputs, density=DENSITY, measure=measure, apparent=1)
        place = state.position + state.attitude @ pose.position
        gust = state.attitude.T @ field(place, p[0])
        force, changes = strip_loads(pose, jacobian, moving, t, strip, values, gust)
        total[rows] += force
        return changes

    for wing in plane.beams:
        beam, q, q_dot = wing.beam, state.q[wing.name], state.q_dot[wing.name]
        rows = np.r_[0:6, first : first + beam.basis.n]
        a, first = ca.DM(acceleration[rows[6:]]), rows[-1] + 1
        parts = state_parts(wing.strips, LAG, ENTRY)
        values, changes = parts.values(state.lag[wing.name]), []
        for k, (xi, weight) in enumerate(air_stations(wing.strips)):
            pose, root_twist = cc.pose_at(beam, q, xi), adjoint(beam.root) @ twist
            along = (q + t * q_dot + t**2 / 2 * a, q_dot + t * a)
            moving = cc.body_twist(beam, *along, xi, root_twist)
            jacobian = ca.horzcat(adjoint(pose), cc.body_jacobian(beam, q, xi))
            at = (pose, jacobian, moving, values[:, k], rows)
            changes.append(added(wing.strips, xi, weight * beam.length, *at))
        rates.append(parts.projection @ np.concatenate(changes))
    for tail in plane.surfaces:
        own = adjoint(tail.pose)
        at = (tail.pose, own, own @ twist, state.lag[tail.name], np.r_[0:6])
        rates.append(added(tail.strips, 0.5, tail.area / 0.5, *at))
    return total, np.concatenate(rates)


def test_airloads_are_those_of_strips_in_virtual_work(model, dense):
    x, u, p = anywhere(model)
    nv = model.second_order.velocities
    acceleration = np.random.default_rng(1).normal(size=nv)
    found, rates = model.second_order.balance(x, acceleration, u, p)
    twice, _ = dense.second_order.balance(x, acceleration, u, p)
    expected = airloads(model, x, acceleration, u, p)
    loads = (found - twice).full().ravel()  # proportional to the density
    # The chain of a body Jacobian has other elements than that of the model, magnus4 both.
    assert_allclose(loads, expected[0], atol=1e-5 * np.abs(expected[0]).max())
    assert_allclose(rates.full().ravel(), expected[1], atol=1e-5 * np.abs(expected[1]).max())


def energy_and_power(model, dense):
    """(x, u, p) -> energy of aircraft and wings, J; power of the air, W."""
    x, u, p = (ca.MX.sym(k, getattr(model, k).size) for k in "xup")
    nv = model.second_order.velocities
    start = model.x.slices["twist"].start
    v, a = x[start : start + nv], model.xdot(x, u, p)[start : start + nv]
    matrices = [m.second_order.matrices(x, p) for m in (model, dense)]
    mass = 2 * matrices[0][0] - matrices[1][0]
    q = ca.vertcat(ca.MX(6, 1), *(x[model.x.slices[f"q_{wing.name}"]] for wing in aircraft().beams))
    energy = ca.bilin(mass, v, v) / 2 + ca.bilin(matrices[0][2], q, q) / 2
    forces = [m.second_order.balance(x, a, u, p)[0] for m in (model, dense)]
    return ca.Function("energy", [x, u, p], [energy, ca.dot(v, forces[0] - forces[1])])


def test_the_air_takes_what_the_aircraft_loses(model, dense):
    x, u, p = anywhere(model)
    u[model.u.slices["thrust"]] = 0
    of = energy_and_power(model, dense)
    rate, step = model.xdot(x, u, p).full().ravel(), 1e-5
    ahead, behind = (float(of(x + sign * step * rate, u, p)[0]) for sign in (1, -1))
    power = float(of(x, u, p)[1])
    # Central differences: rounding of 10 kJ over a step of 10 µs.
    assert_allclose((ahead - behind) / (2 * step), power, rtol=1e-6)


def test_work_of_the_air_is_loss_of_energy_to_the_order_of_the_method(model, dense):
    x, u, p = anywhere(model)
    u[:] = 0
    of = energy_and_power(model, dense)
    left = []
    for steps in (40, 80):
        times = np.linspace(0, 0.05, steps + 1)
        found = cc.simulate(model, x, times, u=u, p={"time": 0.0})
        values = np.array([[float(y) for y in of(column, u, p * 0)] for column in found.x.T])
        simpson = np.ones(steps + 1)
        simpson[1:-1:2], simpson[2:-1:2] = 4, 2
        work = simpson @ values[:, 1] * (times[1] - times[0]) / 3
        left.append(abs(values[-1, 0] - values[0, 0] - work))
        size = abs(work)
    assert left[1] < 1e-6 * size
    assert 12 < left[0] / left[1] < 20  # Runge and Kutta, Simpson: order 4


def test_derivatives_are_those_of_differences(model):
    x, u, p = anywhere(model)
    symbols = [ca.MX.sym(k, getattr(model, k).size) for k in "xup"]
    stacked = ca.vertcat(*symbols)
    slope = ca.Function("slope", symbols, [ca.jacobian(model.xdot(*symbols), stacked)])
    used = {f.name() for f in slope.find_functions()}
    assert {"jac_aircraft_right", "jac_aircraft_left"} <= used
    assert not any(name.startswith("fwd") and "element" in name for name in used)
    matrix, rng = slope(x, u, p).full(), np.random.default_rng(3)
    for _ in range(3):
        ends = [rng.normal(size=value.size) for value in (x, u, p)]
        h = 1e-5
        pairs = [*zip((x, u, p), ends, strict=True)]
        ahead, behind = (model.xdot(*(v + s * h * d for v, d in pairs)) for s in (1, -1))
        expected = matrix @ np.concatenate(ends)
        # Errors of h² and of rounding over h.
        found = ((ahead - behind) / (2 * h)).full().ravel()
        assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_mass_matrix_is_the_derivative_of_the_balance(model):
    x, u, p = anywhere(model)
    motion = model.second_order
    unit = np.eye(motion.velocities)
    at_rest = motion.balance(x, np.zeros(motion.velocities), u, p)[0]
    columns = [(motion.balance(x, column, u, p)[0] - at_rest).full().ravel() for column in unit]
    mass = motion.matrices(x, p)[0].full()
    assert_allclose(np.column_stack(columns), mass, atol=1e-11 * np.abs(mass).max())


def test_derivatives_of_outputs_are_those_of_differences(model):
    x, u, p = anywhere(model)
    symbols = [ca.MX.sym(k, getattr(model, k).size) for k in "xup"]
    slope = ca.Function(
        "slope", symbols, [ca.jacobian(model.output(*symbols), ca.vertcat(*symbols))]
    )
    rng, h = np.random.default_rng(4), 1e-5
    ends = [rng.normal(size=value.size) for value in (x, u, p)]
    pairs = [*zip((x, u, p), ends, strict=True)]
    ahead, behind = (model.output(*(v + s * h * d for v, d in pairs)) for s in (1, -1))
    found = model.y.split((ahead - behind) / (2 * h))
    expected = model.y.split(slope(x, u, p) @ ca.DM(np.concatenate(ends)))
    assert len(found) == 6 + 2 * 11
    for name, value in found.items():
        assert float(ca.norm_inf(expected[name])) > 0, name
        assert_allclose(value, expected[name], atol=1e-6 * float(ca.norm_inf(value)), err_msg=name)


def test_stations_show_what_sensors_there_read(model):
    x, u, p = anywhere(model)
    found = model.y.split(model.output(x, u, p))
    rates = model.x.split(model.xdot(x, u, p))
    state = flight_state(aircraft(), model.x.split(ca.DM(x)))
    for wing in aircraft().beams:
        inward = adjoint(wing.beam.root)
        root = cc.RootMotion(
            pose=cc.Pose(rotation=state.attitude, position=state.position),
            twist=inward @ state.twist,
            twist_rate=inward @ rates["twist"],
            gravity=[0, 0, 0],
        )
        sensors = [
            kind(xi=xi, noise_density=1.0, rate=1.0)
            for xi in (0.0, 0.5, 1.0)
            for kind in (cc.Accelerometer, cc.RateGyro)
        ]
        motion = (state.q[wing.name], state.q_dot[wing.name], rates[f"q_dot_{wing.name}"])
        read = cc.measure(sensors, wing.beam, *motion, root=root).values
        readings = read.full().reshape(3, 2, 3)
        for name, expected in (("acceleration", readings[:, 0]), ("angular_rate", readings[:, 1])):
            value = found[f"{name}_{wing.name}"].full().reshape(3, 3)
            assert_allclose(value, expected, atol=1e-10 * np.abs(expected).max())


def test_a_gust_is_a_parameter_or_a_field():
    position, time = np.array([1.0, 2.0, 3.0]), ca.DM(0.4)
    wave = cc.OneMinusCosine(amplitude=2.0, duration=1.0)
    cases = ((ENTRY, time, [0, 0, -0.4]), (cc.GustField(field), time, field(position, 0.4)))
    for gust, value, expected in (*cases, (wave, time, [0, 0, -wave(0.4)])):
        found = _gusts(gust, cc.GustEntry()).wind(value)(position)
        assert_allclose(ca.DM(found), ca.DM(expected), atol=1e-15)


def test_time_is_the_time_of_a_simulation(model):
    x, u, _ = anywhere(model)
    times = np.linspace(0, 0.02, 3)
    found, same, still = (
        cc.simulate(model, x, times, u=u, p=p) for p in (None, {"time": lambda t: t}, {"time": 0})
    )
    assert_allclose(found.part("time")[0], times, atol=1e-15)
    assert_allclose(found.x, same.x, rtol=1e-15)
    lag = model.x.slices["lag_tail"]
    assert np.abs(found.x[lag, -1] - still.x[lag, -1]).max() > 1e-4


def test_what_cannot_fly_is_named(model):
    plane = aircraft()
    with pytest.raises(ValueError, match="density: expected a number above zero with a gust"):
        cc.aircraft_model(plane, density=0, gust=ENTRY)
    with pytest.raises(ValueError, match=r"density: expected a number above zero with .* lag"):
        cc.aircraft_model(plane, density=0, lag=LAG)
    with pytest.raises(ValueError, match="density"):
        cc.aircraft_model(plane, density=-1.0)
    with pytest.raises(ValueError, match="gust: expected a GustEntry, a GustField or a function"):
        cc.aircraft_model(plane, density=1.0, gust=3.0)
    with pytest.raises(ValueError, match=r"RigidBody\.inertia: expected \(3, 3\) for free flight"):
        cc.aircraft_model(replace(plane, body=replace(plane.body, inertia=None)), density=1.0)
    with pytest.raises(ValueError, match=r"IndicialLag\.modes: expected at most 3, .* found 7"):
        cc.aircraft_model(plane, density=1.0, lag=cc.IndicialLag(modes=7))
