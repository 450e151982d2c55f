"""A wing in a stream: its derivatives, its mirror image, gusts, still air, what it refuses."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.control.implicit_midpoint import Midpoint, midpoint_solver
from curvcasadi.dynamics import inverse, system
from curvcasadi.dynamics.functions import balance_function
from tests.support.strip_wings import hale

FLAPS = (
    cc.ControlSurface(name="inner", lift=3.5, moment=-0.6, start=0.2, end=0.6),
    cc.ControlSurface(name="outer", lift=3.5, moment=-0.6, start=0.6, end=0.95),
)
DENSITY = 0.0889


def flapped(weights=(2, 2, 1), elements=3):
    wing = hale(weights, elements)
    return replace(wing, strips=replace(wing.strips, controls=FLAPS, profile_drag=0.01))


def make(wing=None, **changes):
    fields = {"density": DENSITY, "lag": cc.IndicialLag(poles=2, modes=2)}
    return cc.wing_model(wing or flapped(), **{**fields, **changes})


@pytest.fixture(scope="module")
def model():
    return make(gust=cc.GustEntry(kind="kussner", modes=1))


def values(model, seed=1):
    rng = np.random.default_rng(seed)
    n = model.second_order.velocities
    scale = np.concatenate([np.full(n, 0.02), np.full(n, 0.05), np.ones(model.x.size - 2 * n)])
    x = scale * rng.standard_normal(model.x.size)
    return x, 0.1 * rng.standard_normal(n), np.array([0.05, -0.1]), np.array([22.0, 0.06, 1.3])


def test_structured_derivatives_are_those_of_the_equations(model):
    # Central differences of the values: no derivative is shared.
    motion, at = model.second_order.balance, values(model)
    symbols = [ca.MX.sym(motion.name_in(i), *motion.size_in(i)) for i in range(4)]
    stacked = ca.vertcat(*symbols)
    slopes = ca.Function(
        "slopes", symbols, [ca.jacobian(ca.vertcat(*motion(*symbols)), ca.vertcat(*symbols))]
    )
    got = slopes(*at).full()
    joined = np.concatenate(at)
    ends = np.cumsum([len(part) for part in at])[:-1]

    def value(y):
        return np.concatenate([part.full().ravel() for part in motion(*np.split(y, ends))])

    for column in range(stacked.numel()):
        step = np.zeros(len(joined))
        step[column] = 1e-5 * max(1.0, abs(joined[column]))
        expected = (value(joined + step) - value(joined - step)) / (2 * step[column])
        # The square of the step, and rounding of the values over it.
        assert_allclose(
            got[:, column], expected, rtol=2e-6, atol=2e-7 * np.abs(value(joined)).max()
        )


def unrolled(wing):
    """Load, parameters and root of a wing in a stream, in SX."""
    states, speed, pitch = ca.SX.sym("lag", 6), ca.SX.sym("airspeed"), ca.SX.sym("pitch")
    c, s = ca.cos(pitch), ca.sin(pitch)
    load = cc.UnsteadyAirload(
        strips=wing.strips,
        flow=cc.Flow(density=DENSITY, velocity=speed * ca.vertcat(c, 0, s)),
        lag=cc.IndicialLag(poles=2, modes=3),
        states=states,
    )
    attitude = ca.vertcat(ca.horzcat(c, 0, s), ca.horzcat(0, 1, 0), ca.horzcat(-s, 0, c))
    pose = cc.Pose(rotation=attitude, position=[0, 0, 0])
    root = cc.RootMotion(pose=pose, gravity=[0, 0, 9.80665])
    return load, {"lag": states, "airspeed": speed, "pitch": pitch}, root


def motion_of(wing):
    load, parameters, root = unrolled(wing)
    return balance_function(
        wing.beam, [load], load.parts.projection, parameters, root=root, form="unrolled"
    )


@pytest.mark.parametrize(("elements", "nodes"), [(4, 10_000), (6, 14_000)])
def test_nodes_of_the_equations_and_of_their_derivative(elements, nodes):
    # 9 weights, 6 lag states, six aerodynamic stations; measured 9 778 and 11 646.
    motion = motion_of(hale((3, 4, 2), elements))
    assert motion.n_instructions() <= nodes
    assert motion.jacobian().n_instructions() <= 12 * motion.n_instructions()  # 11.4, 11.3


def test_structured_derivatives_are_those_of_automatic_differentiation():
    wing = hale((3, 4, 2), 4)
    load, parameters, root = unrolled(wing)
    weights = {key: ca.SX.sym(key, 9) for key in ("q", "q_dot", "q_ddot")}
    found = inverse.balance(system.build(wing.beam, [load], root, weights), *weights.values())
    values = ca.vertcat(found.residual, ca.DM(load.parts.projection) @ found.rates)
    inputs = [*weights.values(), *parameters.values()]
    by_ad = ca.Function("ad", inputs, [ca.jacobian(values, ca.veccat(*inputs))])
    rng = np.random.default_rng(0)
    at = [s * rng.standard_normal(9) for s in (0.05, 0.2, 1.0)]
    at += [rng.standard_normal(6), 30.0, 0.06]
    blocks = motion_of(wing).jacobian()(*at, 0, 0)
    got = np.vstack([np.hstack([block.full() for block in blocks[k : k + 6]]) for k in (0, 6)])
    expected = by_ad(*at).full()
    scale = np.abs(expected).max(axis=1, keepdims=True)
    assert_allclose(got / scale, expected / scale, atol=1e-12)


def test_derivatives_go_through_no_chain(model):
    motion = model.second_order.balance
    symbols = [ca.MX.sym(motion.name_in(i), *motion.size_in(i)) for i in range(4)]
    slope = ca.jacobian(ca.vertcat(*motion(*symbols)), symbols[0])
    names = {f.name() for f in ca.Function("f", symbols, [slope]).find_functions()}
    assert "jac_wing_forces" in names
    # What is differentiated by CasADi is the Function around it.
    assert {name for name in names if name.startswith(("fwd", "adj"))} <= {"fwd16_wing_balance"}


def test_mass_is_the_derivative_by_the_accelerations(model):
    # The apparent mass of the air is in it; the equations are linear in the accelerations.
    x, a, u, p = values(model)
    motion = model.second_order
    mass = motion.matrices(x, p)[0].full()
    at = [motion.balance(x, a + d, u, p)[0].full().ravel() for d in [0 * a, *np.eye(len(a))]]
    assert_allclose(np.transpose(at[1:] - at[0]), mass, atol=1e-9 * np.abs(mass).max())
    wing = flapped()
    air = cc.AerodynamicLoad(strips=wing.strips, flow=cc.Flow(density=DENSITY))
    vacuum = cc.mass_matrix(wing.beam, x[: len(a)], [air]).full()  # on the same stations
    assert np.linalg.eigvalsh(mass - vacuum)[0] > -1e-9 * np.abs(mass).max()
    assert np.linalg.norm(mass - vacuum) > 0.01 * np.linalg.norm(vacuum)


def test_at_rest_in_steady_flow_the_balance_is_that_of_statics(model):
    # x_i = u is the steady state of the lag states: then the airloads are those of statics.
    q = 0.02 * np.random.default_rng(3).standard_normal(5)
    speed, pitch, angles = 25.0, 0.05, {"inner": 0.04, "outer": -0.03}
    wing = flapped()
    lag = make(wing, lag=cc.IndicialLag(poles=2, modes=None))
    n = 5
    x = np.zeros(lag.x.size)
    x[:n] = q
    u, p = [angles["inner"], angles["outer"]], [speed, pitch]
    # The rates are linear in the lag states: −b W/b each.
    motion = lag.second_order.balance
    symbol = ca.MX.sym("x", lag.x.size)
    rates = motion(symbol, np.zeros(n), u, p)[1]
    f = ca.Function("f", [symbol], [rates, ca.jacobian(rates, symbol)])
    rate, slope = (m.full() for m in f(x))
    x[2 * n :] = -np.linalg.solve(slope[:, 2 * n :], rate).ravel()
    balance, rate = motion(x, np.zeros(n), u, p)
    assert_allclose(rate.full(), 0, atol=1e-9)
    flow = cc.Flow(density=DENSITY, velocity=[speed * np.cos(pitch), 0, speed * np.sin(pitch)])
    air = cc.AerodynamicLoad(strips=wing.strips, flow=flow, deflections=angles)
    c, s = np.cos(pitch), np.sin(pitch)
    loads = [air, cc.Gravity([0, 0, 9.80665])]
    expected = cc.equilibrium_residual(wing.beam, q, loads, [[c, 0, s], [0, 1, 0], [-s, 0, c]])
    assert_allclose(balance, expected, atol=1e-9 * np.abs(expected.full()).max())


def test_mirrored_wing_has_the_same_equations():
    wing = flapped()
    one, other = make(wing), make(cc.mirror_wing(wing, "left"))
    x, a, u, p = values(one)
    for got, expected in zip(
        other.second_order.balance(x, a, u, p[:2]),
        one.second_order.balance(x, a, u, p[:2]),
        strict=True,
    ):
        assert_allclose(got, expected, atol=1e-11 * np.abs(expected.full()).max())
    eigenvalues = [cc.linearize(m, x, u, p[:2]).eigenvalues for m in (one, other)]
    # Eigenvalues of a matrix that differs by rounding.
    assert_allclose(*eigenvalues, rtol=1e-9)


def test_still_air_leaves_a_wing_with_apparent_mass(model):
    x, a, u, _ = values(model)
    x[10:] = 0
    motion = model.second_order.balance
    symbol = ca.MX.sym("x", model.x.size)
    results = motion(symbol, a, u, [0.0, 0.0, 0.0])
    f = ca.Function("f", [symbol], [ca.jacobian(ca.vertcat(*results), symbol)])
    for state in (np.zeros(model.x.size), x):
        assert np.all(np.isfinite(f(state).full()))


def test_an_upward_gust_bends_the_wing_up_and_ends_in_its_steady_shape(model):
    wing = flapped()
    gusty = make(wing, gravity=0.0, damping=0.05, gust=cc.GustEntry(kind="kussner", modes=2))
    settled = cc.simulate(
        gusty,
        np.zeros(gusty.x.size),
        np.linspace(0, 4, 5),
        p={"airspeed": 15.0, "pitch": 0.0, "gust": 0.3},
        method="implicit_midpoint",
        dt=0.02,
    )
    tip = gusty.output(settled.x[:, -1], np.zeros(2), [15.0, 0.0, 0.3])[:3]
    flow = cc.Flow(density=DENSITY, velocity=[15.0, 0, 0.3])
    air = cc.AerodynamicLoad(strips=wing.strips, flow=flow)
    expected = cc.solve_equilibrium(wing.beam, [air]).shape.tip.position
    assert float(tip[2]) < -0.01  # z is down
    # The slowest root, of lag and flap together, is −0.7 1/s: 6 % of the way are left.
    assert_allclose(float(tip[2]), float(expected[2]), rtol=0.1)


def test_frozen_induced_flow_lowers_the_lift():
    wing = hale((2, 2, 1), 3)
    plain = make(wing, lag=cc.IndicialLag(poles=2, modes=None))
    line = cc.LiftingLine(panels=4, frozen=True)
    induced = make(wing, lag=cc.IndicialLag(poles=2, modes=None), induced_flow=line)
    x = np.zeros(plain.x.size)
    x[10:] = np.tile(20 * 0.05 * np.ones(6), 2)  # u of all strips, followed by all poles
    p = [20.0, 0.05]
    lifts = [
        m.second_order.balance(x, np.zeros(5), [], p)[0].full().ravel() for m in (plain, induced)
    ]
    flow = cc.Flow(density=DENSITY, velocity=[20 * np.cos(0.05), 0, 20 * np.sin(0.05)])
    for residual, of in zip(lifts, (None, line), strict=True):
        air = cc.AerodynamicLoad(strips=wing.strips, flow=flow, induced_flow=of)
        c, s = np.cos(0.05), np.sin(0.05)
        attitude = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        loads = [air, cc.Gravity([0, 0, 9.80665])]
        expected = cc.equilibrium_residual(wing.beam, np.zeros(5), loads, attitude)
        assert_allclose(residual, expected.full().ravel(), atol=2e-3 * np.abs(lifts[0]).max())


def test_structured_derivatives_of_outputs_are_those_of_their_values(model):
    # Central differences of the values: no derivative is shared.
    x, _, u, p = values(model)
    linear = cc.linearize(model, x, u, p)
    joined = np.concatenate([x, u, p])
    ends = [len(x), len(x) + len(u)]

    def value(y):
        return model.output(*np.split(y, ends)).full().ravel()

    got = np.hstack([linear.C, linear.D, linear.D_p])
    for column in range(len(joined)):
        step = np.zeros(len(joined))
        step[column] = 1e-5 * max(1.0, abs(joined[column]))
        expected = (value(joined + step) - value(joined - step)) / (2 * step[column])
        for name, rows in model.y.slices.items():
            # The square of the step, and rounding of the values over it.
            scale = max(np.abs(expected[rows]).max(), np.abs(value(joined)[rows]).max())
            assert_allclose(got[rows, column], expected[rows], atol=1e-7 * scale, err_msg=name)


def test_motion_of_stations_is_what_sensors_there_read(model):
    x, _, u, p = values(model)
    n = model.second_order.velocities
    y = model.y.split(model.output(x, u, p))
    c, s = np.cos(p[1]), np.sin(p[1])
    attitude = cc.Pose(rotation=[[c, 0, s], [0, 1, 0], [-s, 0, c]], position=[0, 0, 0])
    root = cc.RootMotion(pose=attitude, gravity=[0, 0, 9.80665])
    for k, xi in enumerate([0.0, 0.25, 0.5, 0.75, 1.0]):
        sensors = [
            kind(xi=xi, noise_density=1.0, rate=1.0) for kind in (cc.RateGyro, cc.Accelerometer)
        ]
        q_ddot = model.xdot(x, u, p)[n : 2 * n]
        read = cc.measure(sensors, flapped().beam, x[:n], x[n : 2 * n], q_ddot, root).values.full()
        where = slice(3 * k, 3 * k + 3)
        assert_allclose(y["angular_rate"][where], read[:3], atol=1e-12)
        assert_allclose(y["acceleration"][where], read[3:], atol=1e-9 * np.abs(read).max())
    pose = cc.shape_map(flapped().beam, x[:n]).tip
    assert_allclose(y["tip_position"], pose.position, atol=1e-12)
    assert_allclose(y["station_position"][-3:], pose.position, atol=1e-12)
    assert_allclose(y["station_rotation"][-9:], ca.vec(pose.rotation), atol=1e-12)


def test_a_steady_wing_hands_its_loads_on_to_its_root():
    # At rest the wrench of statics, about the root and in its axes; level, a load factor of one.
    wing = flapped()
    model = make(wing, lag=None)
    x, pitch = np.concatenate([0.02 * np.arange(-2, 3), np.zeros(5)]), 0.05
    u, p = [0.04, -0.03], [25.0, pitch]
    flow = cc.Flow(density=DENSITY, velocity=[25 * np.cos(pitch), 0, 25 * np.sin(pitch)])
    air = cc.AerodynamicLoad(
        strips=wing.strips, flow=flow, deflections={"inner": 0.04, "outer": -0.03}
    )
    c, s = np.cos(pitch), np.sin(pitch)
    attitude = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    # Without accelerations, which the wing would have here.
    function = model.output.find_function("wing_outputs_root")
    wrench = function(x[:5], x[5:], np.zeros(5), *u, *p).full().ravel()
    weight = cc.Gravity([0, 0, 9.80665])
    expected = cc.root_wrench(wing.beam, x[:5], [air, weight], attitude).full().ravel()
    rotation = wing.beam.root.rotation.full()
    turned = np.concatenate([rotation.T @ expected[:3], rotation.T @ expected[3:]])
    assert_allclose(wrench, turned, atol=1e-9 * np.abs(turned).max())
    level = make(wing, lag=None, gravity=9.80665)
    y = level.y.split(level.output(np.zeros(10), [0, 0], [0.0, 0.0]))
    assert_allclose(float(y["load_factor"][0]), 1.0, rtol=1e-12)  # the root does not fall


def test_outputs_are_those_that_are_asked_for():
    model = make(outputs=("root_moment", "tip_position"), stations=(0.5,))
    assert [part.name for part in model.y.parts] == ["tip_position", "root_moment"]
    assert model.output(np.zeros(model.x.size), [0, 0], [20.0, 0.05]).shape == (6, 1)
    with pytest.raises(ValueError, match="outputs: expected one of"):
        make(outputs=("root_bending",))


GUST = cc.OneMinusCosine(amplitude=1.0, duration=1.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"density": 0.0}, "density"),
        ({"density": -1.0}, "density"),
        ({"density": 0.0, "lag": None, "induced_flow": cc.LiftingLine()}, "zero with induced_flow"),
        ({"density": 0.0, "lag": None, "gust": cc.GustEntry()}, "zero with gust"),
        ({"lag": cc.IndicialLag(poles=2, modes=9)}, "IndicialLag.modes"),
        ({"induced_flow": 4}, "induced_flow: expected a LiftingLine, found 4"),
        ({"damping": -1.0}, "damping"),
        ({"name": "2 wings"}, "name"),
        ({"lag": 3}, "lag: expected an IndicialLag, found 3"),
        ({"gust": GUST}, "gust: expected a GustEntry, found OneMinusCosine"),
        ({"gravity": np.nan}, "^gravity: expected finite"),
        ({"parameters": {"m": ca.MX.sym("m")}}, "parameters: expected symbols .* 'm', which acts"),
        ({"outputs": "root_moment"}, "outputs: expected a sequence, found 'root_moment'"),
    ],
)
def test_bad_input_is_named(changes, message):
    with pytest.raises(ValueError, match=message):
        make(**changes)


def test_a_stream_from_behind_and_a_pitch_in_degrees_are_named():
    model = make(outputs=())
    at = np.zeros(model.x.size)
    for p, message in (
        (
            {"airspeed": -1.0, "pitch": 0.0},
            r"p: airspeed\[0\], m/s: expected within 0 to inf, found -1",
        ),
        ({"airspeed": 9.0, "pitch": 3.0}, r"p: pitch\[0\], rad: .* 3 degrees are 0.05236 rad"),
    ):
        with pytest.raises(ValueError, match=message):
            cc.linearize(model, at, p=p)
        with pytest.raises(ValueError, match=message):
            cc.simulate(model, at, [0.0, 0.01], p=p)


def iterations(model, dt, steps=50):
    """Balances of the implicit midpoint rule in a step, on average, from rest in a gust."""
    solve = midpoint_solver(Midpoint(model=model, motion=model.second_order))
    x, counts, forces = np.zeros(model.x.size), [], [np.zeros(solve.numel_in(4))] * 2
    for k in range(steps):
        p = [25.0, 0.03, np.sin(3 * k * dt)][: model.p.size]
        x, _, force, count = solve(x, [], p, dt, 2 * forces[-1] - forces[-2])
        forces.append(force.full().ravel())
        counts.append(float(count))
    return np.mean(counts)


def test_lag_states_take_no_further_iterations_of_an_implicit_step():
    # 5.4 and 8.4 balances a step with lag states, 6.0 and 9.3 without any.
    wing = hale((3, 4, 2), 4)
    lagged = make(wing, lag=cc.IndicialLag(poles=3), gust=cc.GustEntry(), outputs=())
    at_once = make(wing, lag=None, outputs=())
    slow = replace(lagged, second_order=replace(lagged.second_order, decays=None))
    for dt in (0.005, 0.02):
        assert iterations(lagged, dt) <= iterations(at_once, dt)
        assert iterations(slow, dt) > 1.2 * iterations(lagged, dt)  # the rates are what helps


def test_states_decay_at_the_rates_of_the_mean_chord(model):
    x, _, _, p = values(model)
    poles = [*np.repeat(cc.IndicialLag(poles=2).rates, 2), 0.13, 1.0]
    assert_allclose(model.second_order.decays(x, p).full().ravel(), np.multiply(poles, 22.0 / 0.5))


def test_sx_symbols_and_symbolic_densities_are_named():
    symbol = ca.SX.sym("s")
    wing = hale()
    stiff = replace(wing.beam, section=replace(wing.beam.section, GJ=symbol))
    for changed, field in (
        (replace(wing, strips=replace(wing.strips, chord=symbol)), "StripAerodynamics.chord"),
        (replace(wing, beam=stiff), "Section.GJ"),
    ):
        with pytest.raises(ValueError, match=rf"{field}: expected numbers or MX symbols"):
            cc.wing_model(changed, density=0.0889)
    with pytest.raises(ValueError, match=r"Section.GJ: expected numbers or MX symbols"):
        cc.beam_model(stiff)
    with pytest.raises(ValueError, match="density: expected numbers, found the symbol"):
        cc.wing_model(wing, density=ca.MX.sym("rho"))
