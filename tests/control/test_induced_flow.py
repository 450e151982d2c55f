"""Induced flow of a wing in motion: its steady limit, its derivatives, frozen lines, still air."""

from __future__ import annotations

import pickle
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.statics.balance import root_wrench
from tests.support.strip_wings import hale

FLAPS = (
    cc.ControlSurface(name="inner", lift=3.5, moment=-0.6, start=0.2, end=0.6),
    cc.ControlSurface(name="outer", lift=3.5, moment=-0.6, start=0.6, end=0.95),
)
DENSITY, SPEED, PITCH = 0.0889, 25.0, 0.05
ANGLES = {"inner": 0.04, "outer": -0.03}
VELOCITY = [SPEED * np.cos(PITCH), 0, SPEED * np.sin(PITCH)]
ATTITUDE = [[np.cos(PITCH), 0, np.sin(PITCH)], [0, 1, 0], [-np.sin(PITCH), 0, np.cos(PITCH)]]
P = [SPEED, PITCH]
EACH = cc.IndicialLag(poles=2, modes=None)
MOVING, STRAIGHT = cc.LiftingLine(panels=4), cc.LiftingLine(panels=4, frozen=True)
N = 5


def flapped():
    wing = hale((2, 2, 1), 3)
    strips = replace(wing.strips, controls=FLAPS, profile_drag=0.01, zero_lift_angle=-0.02)
    return replace(wing, strips=strips)


def make(line, wing=None, **changes):
    fields = {"density": DENSITY, "lag": EACH, "outputs": ()}
    return cc.wing_model(wing or flapped(), induced_flow=line, **{**fields, **changes})


def statics(line, wing=None):
    """Loads of statics of the same wing in the same flight."""
    wing = wing or flapped()
    air = cc.AerodynamicLoad(
        strips=wing.strips,
        flow=cc.Flow(density=DENSITY, velocity=VELOCITY),
        deflections=ANGLES,
        induced_flow=line,
    )
    return wing.beam, [air, cc.Gravity([0, 0, 9.80665])]


def bent(seed=3):
    return 0.02 * np.random.default_rng(seed).standard_normal(N)


def settled(model, q, p=P):
    """State with weights q at rest, and the lag states, in which rates are linear, that last."""
    motion, u = model.second_order.balance, [*ANGLES.values()]
    symbol = ca.MX.sym("x", model.x.size)
    rates = motion(symbol, np.zeros(N), u, p)[1]
    f = ca.Function("f", [symbol], [rates, ca.jacobian(rates, symbol)])
    x = np.zeros(model.x.size)
    x[:N] = q
    if model.x.size > 2 * N:
        rate, slope = (m.full() for m in f(x))
        x[2 * N :] = -np.linalg.solve(slope[:, 2 * N :], rate).ravel()
    return x


def balance(model, x, p=P):
    return model.second_order.balance(x, np.zeros(N), [*ANGLES.values()], p)[0].full().ravel()


FROZEN_BENT = replace(STRAIGHT, shape=bent(5), velocity=VELOCITY)


@pytest.mark.parametrize("lag", [EACH, None], ids=["lag", "none"])
@pytest.mark.parametrize(
    "line", [MOVING, STRAIGHT, FROZEN_BENT], ids=["moving", "straight", "bent"]
)
def test_at_rest_in_steady_flow_the_balance_is_that_of_statics(line, lag):
    # The same horseshoes: only the order of sums is another.
    model, q = make(line, lag=lag), bent()
    beam, loads = statics(line)
    expected = cc.equilibrium_residual(beam, q, loads, ATTITUDE).full().ravel()
    assert_allclose(
        balance(model, settled(model, q)), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
    )


def test_equilibrium_of_statics_is_a_steady_state():
    beam, loads = statics(MOVING)
    q = cc.solve_equilibrium(beam, loads, attitude=ATTITUDE).q
    model = make(MOVING)
    x = settled(model, q.full().ravel())
    rates = model.xdot(x, [*ANGLES.values()], P).full().ravel()
    # Newton's method of the statics ends at corrections of 1e-10.
    assert np.abs(rates).max() < 1e-6


@pytest.mark.parametrize("lag", [EACH, None], ids=["lag", "none"])
def test_frozen_at_its_own_shape_and_stream_a_line_is_the_moving_one(lag):
    q = bent()
    moving = make(MOVING, lag=lag)
    x = settled(moving, q)
    x[N : 2 * N] = 0.1 * np.random.default_rng(1).standard_normal(N)
    frozen = make(replace(STRAIGHT, shape=q, velocity=VELOCITY), lag=lag)
    expected = balance(moving, x)
    # Elements of the model end at its stations, too, which those of the shape do not.
    assert_allclose(balance(frozen, x), expected, rtol=0, atol=1e-5 * np.abs(expected).max())


def test_unbent_in_level_flow_the_line_frozen_unless_told_otherwise_is_the_moving_one():
    models = [make(line) for line in (MOVING, STRAIGHT)]
    p = [SPEED, 0.0]
    balances = [balance(model, settled(model, np.zeros(N), p), p) for model in models]
    assert_allclose(*balances, rtol=0, atol=1e-12 * np.abs(balances[0]).max())


def test_moving_and_frozen_about_the_equilibrium_differ_by_the_geometry_alone():
    # A = −M⁻¹ ∂balance: of the derivatives of the balance only that by q is another, by what the
    # influence of the horseshoes changes while all else is held.
    q = bent()
    frozen = replace(STRAIGHT, shape=q, velocity=VELOCITY)
    models = {line: make(line) for line in (MOVING, frozen)}
    x, u = settled(models[MOVING], q), [*ANGLES.values()]
    linear = {line: cc.linearize(model, x, u, P) for line, model in models.items()}
    change = linear[MOVING].A - linear[frozen].A
    rows, columns = slice(N, 2 * N), slice(0, N)
    scale = np.abs(change[rows, columns]).max()
    assert scale > 1
    other = change.copy()
    other[rows, columns] = 0
    # Elements of the model end at its stations, too, which those of the shape do not.
    assert np.abs(other).max() < 1e-4 * scale
    mass = models[MOVING].second_order.matrices(x, P)[0].full()
    direction, step = np.random.default_rng(4).standard_normal(N), 1e-5
    up, down = (balance(make(replace(frozen, shape=q + d * direction)), x) for d in (step, -step))
    expected = -np.linalg.solve(mass, (up - down) / (2 * step))
    found = change[rows, columns] @ direction
    # The difference of the elements again, and of the derivative by differences.
    assert_allclose(found, expected, rtol=0, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize("lag", [cc.IndicialLag(poles=2, modes=2), None], ids=["lag", "none"])
@pytest.mark.parametrize("line", [MOVING, STRAIGHT], ids=["moving", "frozen"])
def test_structured_derivatives_are_those_of_the_equations(line, lag):
    # Central differences of the values: no derivative is shared.
    model = make(line, lag=lag, gust=cc.GustEntry(kind="lag", modes=1))
    motion, rng = model.second_order.balance, np.random.default_rng(2)
    scales = np.ones(model.x.size)
    scales[: 2 * N] = np.repeat([0.02, 0.05], N)
    at = scales * rng.standard_normal(model.x.size), 0.1 * rng.standard_normal(N)
    at += np.array([0.05, -0.1]), np.array([22.0, 0.06, 1.3])
    symbols = [ca.MX.sym(motion.name_in(i), *motion.size_in(i)) for i in range(4)]
    slope = ca.jacobian(ca.vertcat(*motion(*symbols)), ca.vertcat(*symbols))
    got, joined = ca.Function("s", symbols, [slope])(*at).full(), np.concatenate(at)
    ends = np.cumsum([len(part) for part in at])[:-1]

    def value(y):
        return np.concatenate([part.full().ravel() for part in motion(*np.split(y, ends))])

    scale = np.abs(value(joined)).max()
    for column in range(len(joined)):
        step = np.zeros(len(joined))
        step[column] = 1e-5 * max(1.0, abs(joined[column]))
        expected = (value(joined + step) - value(joined - step)) / (2 * step[column])
        # The square of the step, and rounding of the values over it.
        assert_allclose(got[:, column], expected, rtol=2e-6, atol=2e-7 * scale)


def test_derivatives_go_through_no_elimination():
    motion = make(MOVING).second_order.balance
    symbols = [ca.MX.sym(motion.name_in(i), *motion.size_in(i)) for i in range(4)]
    slope = ca.jacobian(motion(*symbols)[0], symbols[0])
    found = ca.Function("f", symbols, [slope]).find_functions()
    names = {f.name() for f in found}
    assert {"jac_wing_forces", "coupled_slopes"} <= names
    assert not any(name.startswith(("fwd", "adj")) and "induced" in name for name in names)


def test_derivative_of_the_forces_costs_eight_times_the_forces():
    wing, states, speed = hale((2, 2, 1), 3), ca.SX.sym("lag", 6), ca.SX.sym("airspeed")
    counts = {}
    for line in (None, cc.LiftingLine(panels=6)):
        load = cc.UnsteadyAirload(
            strips=wing.strips,
            flow=cc.Flow(density=DENSITY, velocity=ca.vertcat(speed, 0, 0)),
            lag=cc.IndicialLag(poles=2, modes=3),
            states=states,
            induced_flow=line,
        )
        forces = cc.inverse_dynamics_function(
            wing.beam, [load], {"lag": states, "airspeed": speed}, form="unrolled"
        )
        counts[line] = [f.n_instructions() for f in (forces, forces.jacobian())]
    (plain, _), (induced, slopes) = counts.values()
    assert induced < plain + 5000
    assert slopes < 8 * induced


@pytest.mark.parametrize("lag", [EACH, None], ids=["lag", "none"])
def test_mirrored_wing_has_the_same_equations(lag):
    wing = flapped()
    one, other = (make(MOVING, w, lag=lag) for w in (wing, cc.mirror_wing(wing, "left")))
    x = settled(one, bent())
    x[N : 2 * N] = 0.1
    expected = balance(one, x)
    assert_allclose(balance(other, x), expected, rtol=0, atol=1e-11 * np.abs(expected).max())
    eigenvalues = [cc.linearize(m, x, [*ANGLES.values()], P).eigenvalues for m in (one, other)]
    # Eigenvalues of a matrix that differs by rounding.
    assert_allclose(*eigenvalues, rtol=1e-9)


@pytest.mark.parametrize("lag", [EACH, None], ids=["lag", "none"])
def test_still_air_is_finite(lag):
    model = make(MOVING, lag=lag)
    motion, symbol = model.second_order.balance, ca.MX.sym("x", model.x.size)
    results = ca.vertcat(*motion(symbol, np.zeros(N), [0.1, 0.0], [0.0, 0.0]))
    f = ca.Function("f", [symbol], [results, ca.jacobian(results, symbol)])
    moving = np.zeros(model.x.size)
    moving[: 2 * N] = 0.05
    for x in (np.zeros(model.x.size), moving):
        assert all(np.all(np.isfinite(m.full())) for m in f(x))


def test_gusts_that_are_in_meet_the_same_line_however_they_entered():
    # Küssner's states beside the lag states, or one in front of them: the same steady circulation.
    found = []
    for kind in ("kussner", "lag"):
        model = make(MOVING, gust=cc.GustEntry(kind=kind, modes=None))
        found.append(balance(model, settled(model, bent(), [*P, 1.3]), [*P, 1.3]))
    assert_allclose(*found, rtol=0, atol=1e-12 * np.abs(found[0]).max())


def test_a_moving_line_on_a_moving_root_needs_the_velocity_of_its_parent():
    # The wake streams along it; of nothing moving it lies behind the chord.
    wing = hale((2, 2, 1), 3)
    loads = [
        cc.UnsteadyAirload(
            strips=wing.strips,
            flow=cc.Flow(density=DENSITY),
            lag=None,
            induced_flow=MOVING,
            through_air=through,
        )
        for through in (VELOCITY, None)
    ]
    inward = ca.diagcat(wing.beam.root.rotation.T, wing.beam.root.rotation.T)
    root = cc.RootMotion(twist=inward @ ca.vertcat(0, 0, 0, *VELOCITY))
    still = np.zeros(N)
    got, other = (
        cc.inverse_dynamics(wing.beam, still, still, still, [load], root).full() for load in loads
    )
    air = cc.AerodynamicLoad(
        strips=wing.strips,
        flow=cc.Flow(density=DENSITY, velocity=VELOCITY),
        induced_flow=MOVING,
    )
    expected = cc.equilibrium_residual(wing.beam, still, [air]).full()
    assert_allclose(got, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    assert np.abs(other - expected).max() > 1e-6 * np.abs(expected).max()
    assert root_wrench(wing.beam, still, [air]).shape == (6, 1)


def crossing(**root):
    wing = flapped()
    pose = cc.Pose(**{"rotation": wing.beam.root.rotation, "position": [0, 0, 0], **root})
    return replace(wing, beam=replace(wing.beam, root=pose))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda: make(
                MOVING, replace(w := flapped(), strips=replace(w.strips, controls=(), stations=2))
            ),
            r"StripAerodynamics.stations: expected at least 3 with induced flow, found 2",
        ),
        (
            lambda: make(MOVING, crossing(position=[0, -0.5, 0])),
            r"LiftingLine.image: expected a wing that leads away .* stands -0.5 m from it",
        ),
        (
            lambda: make(replace(MOVING, plane=[1, 0, 0])),
            r"LiftingLine.image: .* the span at 0 degrees",
        ),
        (
            lambda: make(MOVING, crossing(rotation=cc.wing_root(side="right", sweep=0.8).rotation)),
            r"Beam.root: expected an axis of the parent near the span of the root",
        ),
        (
            lambda: make(replace(STRAIGHT, shape=[0.1, 0.2])),
            r"LiftingLine.shape: expected shape \(5, 1\)",
        ),
        (
            lambda: make(replace(STRAIGHT, shape={"left": bent()})),
            r"LiftingLine.shape: expected weights of the wing 'wing', found those of \['left'\]",
        ),
        (lambda: replace(MOVING, shape=bent()), r"LiftingLine.shape: expected None of a line that"),
        (lambda: replace(STRAIGHT, velocity=[0, 0, 0]), r"LiftingLine.velocity: expected three"),
        (
            lambda: make(
                MOVING,
                replace(
                    w := hale((2, 2, 1), 3), strips=replace(w.strips, tip_loss=lambda xi: 1 - xi)
                ),
            ),
            "StripAerodynamics.tip_loss: expected None with induced flow",
        ),
    ],
)
def test_bad_input_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        change()


def test_a_line_frozen_at_the_shapes_of_an_aircraft_survives_pickling():
    line = replace(STRAIGHT, shape={"left": bent()}, velocity=VELOCITY)
    again = pickle.loads(pickle.dumps(line))
    assert_allclose(again.shape["left"], bent())
    assert_allclose(again.velocity, VELOCITY)
