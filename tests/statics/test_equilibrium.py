"""Equilibrium: the branch, its derivatives, inside an NLP, as C, and where it ends."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipk

import curvcasadi as cc
from curvcasadi.export import CFunction, export_c, run_check
from curvcasadi.reference_wings import hale_wing
from curvcasadi.statics.equilibrium_function import residual_function
from tests.support.oracle import rotation

DOWN = [cc.Gravity([0, 0, 9.81])]  # body axes, z down
UNIT = cc.Section(GJ=1, EI_y=1, EI_z=1)
UP = np.array([0.0, 0.0, 1.0])


def rod(weights=8, section=UNIT, elements=24, **fields):
    """A unit rod that bends out of plane."""
    basis = cc.ChannelBasis(out_of_plane=cc.Legendre(weights))
    grid = fields.pop("grid", cc.Grid.lobatto(elements))
    return cc.Beam(length=1.0, basis=basis, grid=grid, section=section, **fields)


# The branch that grows from the unloaded shape.


def test_the_hale_wing_takes_its_own_weight_in_one_load_step():
    found = cc.solve_equilibrium(hale_wing(), DOWN)
    assert found.load_steps == 1
    assert found.iterations <= 6
    assert found.load_factor == 1.0
    residual = cc.equilibrium_residual(hale_wing(), found.q, DOWN).full()
    assert_allclose(found.residual_norm, np.abs(residual).max(), rtol=1e-6, atol=1e-9)
    assert found.residual_norm <= 1e-8  # of moments times length of 2e4 N m²
    sag = float(found.shape.tip.position[2])
    linear = 0.75 * 9.81 * 16.0**4 / (8 * 2e4)
    assert 0.9 * linear < sag < linear  # a bent beam is shorter than a straight one


def test_a_strong_dead_force_stays_on_the_branch_of_the_unloaded_shape():
    found = cc.solve_equilibrium(rod(), [cc.PointForce(1.0, 16 * UP)])
    assert found.load_steps > 1
    # Case 02: the tip of the elastica at P L²/EI = 16; other branches are 0.7 L away.
    assert_allclose(
        found.shape.tip.position.full().ravel(), [1 - 0.6467725851, 0, 0.8527469783], atol=5e-6
    )


@pytest.mark.parametrize(
    "weights, force", [(3, 16), (3, 25), (4, 12), (4, 20), (4, 25), (5, 40), (6, 60), (8, 40)]
)
def test_where_full_newton_steps_leave_the_branch_or_fail_it_is_followed(weights, force):
    """On the branch of the unloaded shape a dead force turns the tip up to its own direction."""
    beam = rod(weights, grid=cc.Grid.lobatto(24, max_angle=1.5))
    loads = [cc.PointForce(1.0, force * UP)]
    found = cc.solve_equilibrium(beam, loads)
    assert 1.3 < -float(found.q[0]) < np.pi / 2 + 0.02  # few weights overshoot a little
    f = ca.Function("f", [q := ca.MX.sym("q", weights)], [*cc.equilibrium_tangent(beam, q, loads)])
    q = np.zeros(weights)
    for _ in range(40):
        residual, tangent = (m.full() for m in f(q))
        q = q - np.linalg.solve(tangent, residual).ravel()
    assert not np.abs(q - found.q.full().ravel()).max() <= 1  # NaN where Newton diverges


@pytest.mark.parametrize("weights, force", [(3, 25), (4, 12), (4, 20)])
def test_bounded_steps_from_a_straight_guess_stay_on_the_branch(weights, force):
    beam = rod(weights, grid=cc.Grid.lobatto(24, max_angle=1.5))
    loads = [cc.PointForce(1.0, force * UP)]
    guessed = cc.solve_equilibrium(beam, loads, np.zeros(weights))
    assert guessed.load_steps == 1
    expected = cc.solve_equilibrium(beam, loads).q.full()
    assert_allclose(guessed.q.full(), expected, atol=1e-8)  # full steps land 4 rad away


def test_the_load_may_be_reached_from_any_part_of_it():
    """The same equilibrium from straight, and stepped by hand with the shape before as a guess."""
    beam, q = rod(), None
    for part in np.linspace(0.1, 1, 10):
        found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, 16 * part * UP)], q)
        assert found.load_steps == 1
        q = found.q
    expected = cc.solve_equilibrium(beam, [cc.PointForce(1.0, 16 * UP)]).q
    assert_allclose(q.full(), expected.full(), atol=1e-8)


def test_a_follower_force_turns_the_tip_by_half_a_turn_and_back():
    """From the tip the rod is a pendulum let go at a right angle: half its period is 2 K(½)."""
    beam = rod(12, grid=cc.Grid.lobatto(24, rule="magnus6"))
    half_turn = (2 * ellipk(0.5)) ** 2  # F L²/EI, 13.75
    turned = []
    for force in (5, half_turn, 20, 30):
        load = cc.PointForce(1.0, force * UP, frame="follower")
        turned.append(-float(cc.solve_equilibrium(beam, [load]).q[0]))  # P_0: mean curvature
    assert_allclose(turned[1], np.pi, atol=1e-5)
    assert turned[0] < turned[1] > turned[2] > turned[3]


def test_a_follower_force_and_moment_turn_the_tip_by_more_than_half_a_turn():
    """The same pendulum, pushed: θ'' = −F cos θ from the tip, where θ = 0 and θ' = −M."""
    beam = rod(12, grid=cc.Grid.lobatto(24, rule="magnus6"))
    force, moment = 10.0, 2.0
    solution = solve_ivp(
        lambda s, y: [y[1], -force * np.cos(y[0])], (0, 1), [0, -moment], rtol=1e-11, atol=1e-12
    )
    loads = [
        cc.PointForce(1.0, force * UP, frame="follower"),
        cc.PointMoment(1.0, [0, -moment, 0], frame="follower"),
    ]
    turned = -float(cc.solve_equilibrium(beam, loads).q[0])
    assert_allclose(turned, -solution.y[0, -1], rtol=1e-5)
    assert turned > np.pi


def test_a_good_guess_is_an_equilibrium_at_once():
    found = cc.solve_equilibrium(hale_wing(), DOWN)
    again = cc.solve_equilibrium(hale_wing(), DOWN, found.q)
    assert again.iterations == 0
    assert_allclose(again.q.full(), found.q.full(), atol=0)


def test_without_loads_nothing_moves():
    found = cc.solve_equilibrium(hale_wing(), [])
    assert found.iterations == 0
    assert_allclose(found.q.full(), np.zeros((9, 1)), atol=0)


def test_attitude_turns_gravity():
    """A wing at a bank of 90 degrees bends in its plane: 200 times as stiff."""
    bank = rotation([np.pi / 2, 0, 0])  # body to inertial
    banked = cc.solve_equilibrium(hale_wing(), DOWN, attitude=ca.DM(bank))
    turned = cc.solve_equilibrium(hale_wing(), [cc.Gravity(bank.T @ [0, 0, 9.81])])
    assert_allclose(banked.q.full(), turned.q.full(), atol=1e-12)


# Where the branch ends.


def arm(moment, weight):
    """A unit torsion bar that lifts a weight on an arm: θ = λ (M − W sin θ), GJ = 1."""
    beam = cc.Beam(
        length=1.0,
        basis=cc.ChannelBasis(torsion=cc.Legendre(1)),
        grid=cc.Grid.lobatto(8),
        section=UNIT,
    )
    loads = [
        cc.PointMoment(1.0, [moment, 0, 0]),
        cc.PointForce(1.0, [0, 0, -weight], offset=[0, 0, -1]),
    ]
    return beam, loads


def limit(moment, weight):
    """The load factor λ = θ/(M − W sin θ) and the twist at its first maximum."""
    theta = brentq(lambda x: moment - weight * np.sin(x) + weight * x * np.cos(x), np.pi / 2, np.pi)
    return theta / (moment - weight * np.sin(theta)), theta


def test_a_load_beyond_its_limit_says_how_far_it_got():
    factor, twist = limit(12.0, 10.0)
    beam, loads = arm(12.0, 10.0)
    with pytest.raises(cc.ConvergenceError, match=r"equilibrium is lost beyond 0\.\d+") as error:
        cc.solve_equilibrium(beam, loads)
    result = error.value.result
    # The last step is not shorter than 1e-4, and no equilibrium is beyond the limit.
    assert factor - 4e-4 <= result.load_factor <= factor
    # At a limit the shape moves with the root of the distance to it.
    assert_allclose(float(result.q), twist, atol=0.1)
    # It is an equilibrium, of that part of the loads.
    got = float(result.q)
    balance = got - result.load_factor * (12.0 - 10.0 * np.sin(got))
    assert_allclose(balance, 0, atol=1e-9)
    assert result.residual_norm <= 1e-9
    assert_allclose(result.shape.tip.rotation.full(), rotation([got, 0, 0]), atol=1e-12)


def test_a_load_below_its_limit_is_reached():
    factor, _ = limit(12.0, 10.0)
    beam, loads = arm(0.98 * factor * 12.0, 0.98 * factor * 10.0)
    found = cc.solve_equilibrium(beam, loads)
    assert found.load_factor == 1.0
    assert float(found.q) < limit(12.0, 10.0)[1]


# Derivatives of the equilibrium.


def parametrized():
    """The HALE wing under gravity and forces, with design symbols and loads as parameters."""
    EI_y, GJ, mass, tip_mass = (ca.MX.sym(n) for n in ("EI_y", "GJ", "mass", "tip_mass"))
    force, pitch = ca.MX.sym("force", 3), ca.MX.sym("pitch")
    wing = hale_wing()
    section = replace(
        wing.section,
        EI_y=EI_y,
        GJ=GJ,
        mass_per_length=mass,
        center_of_mass=[0, -0.1, 0],
    )
    wing = replace(
        wing, section=section, bodies=(cc.Body(xi=0.6, mass=tip_mass, offset=[0, 0.3, 0]),)
    )
    attitude = ca.vertcat(
        ca.horzcat(ca.cos(pitch), 0, ca.sin(pitch)),
        ca.horzcat(0, 1, 0),
        ca.horzcat(-ca.sin(pitch), 0, ca.cos(pitch)),
    )
    loads = [
        *DOWN,
        cc.PointForce(0.8, force, frame="follower", offset=[0, 0.2, 0]),
        cc.PointMoment(1.0, 0.1 * force),
    ]
    symbols = {
        "EI_y": EI_y,
        "GJ": GJ,
        "mass": mass,
        "tip_mass": tip_mass,
        "force": force,
        "pitch": pitch,
    }
    return wing, loads, symbols, attitude


NOMINAL = {
    "EI_y": 2e4,
    "GJ": 1e4,
    "mass": 0.75,
    "tip_mass": 2.0,
    "force": [10.0, -5.0, 60.0],
    "pitch": 0.2,
}


@pytest.fixture(scope="module")
def equilibrium():
    wing, loads, symbols, attitude = parametrized()
    return cc.equilibrium_function(wing, loads, symbols, attitude=attitude)


def numeric(values):
    """The same wing and loads without symbols, solved."""
    wing, loads, symbols, attitude = parametrized()
    inputs = [*symbols.values()]
    numbers = [ca.DM(values[name]) for name in symbols]
    section, (body,) = wing.section, wing.bodies
    plain = replace(
        wing,
        section=replace(
            section, EI_y=values["EI_y"], GJ=values["GJ"], mass_per_length=values["mass"]
        ),
        bodies=(replace(body, mass=values["tip_mass"]),),
    )
    turned = ca.Function("R", inputs, [attitude])(*numbers)
    force = ca.DM(values["force"])
    plain_loads = [*DOWN, replace(loads[1], force=force), replace(loads[2], moment=0.1 * force)]
    return cc.solve_equilibrium(plain, plain_loads, attitude=turned).q.full()


def test_the_function_gives_the_equilibrium(equilibrium):
    assert equilibrium.name_in() == ["q_guess", *NOMINAL]
    assert equilibrium.name_out() == ["q"]
    got = equilibrium(np.zeros(9), *NOMINAL.values()).full()
    assert_allclose(got, numeric(NOMINAL), atol=1e-10)


@pytest.mark.parametrize("name", NOMINAL)
def test_derivatives_of_the_equilibrium_are_those_of_finite_differences(equilibrium, name):
    symbols = [ca.MX.sym(n, *equilibrium.size_in(n)) for n in equilibrium.name_in()]
    index = equilibrium.index_in(name)
    slope = ca.jacobian(equilibrium(*symbols), symbols[index])
    f = ca.Function("slope", symbols, [slope])
    got = f(np.zeros(9), *NOMINAL.values()).full()
    base = np.ravel(NOMINAL[name]).astype(float)
    step = 1e-3 * np.abs(base).max()

    def shifted(k, by):
        return numeric({**NOMINAL, name: base + by * step * np.eye(base.size)[k]})

    for k in range(base.size):
        # Fourth-order differences of a solution to 1e-11.
        difference = 8 * (shifted(k, 1) - shifted(k, -1)) - (shifted(k, 2) - shifted(k, -2))
        expected = (difference / (12 * step)).ravel()
        assert_allclose(got[:, k], expected, atol=1e-6 * np.abs(expected).max())


def test_the_derivative_of_the_residual_is_the_structured_one():
    """Routed to the attached derivative, and not through the two passes."""
    wing, loads, symbols, attitude = parametrized()
    residual = residual_function(wing, loads, symbols, attitude=attitude)
    q = ca.MX.sym("q", 9)
    arguments = [q, *symbols.values()]
    for name, by in zip(("q", *symbols), arguments, strict=True):
        slope = ca.Function("slope", arguments, [ca.jacobian(residual(*arguments), by)])
        called = {f.name() for f in slope.find_functions(0)}
        # Its nominal output is the residual itself; AD would call derivatives of the element steps.
        assert called == {"jac_equilibrium_residual", "equilibrium_residual"}, name
        numbers = [0.01 * np.cos(np.arange(9)), *NOMINAL.values()]
        plain = cc.equilibrium_residual(wing, q, loads, attitude)
        by_ad = ca.Function("ad", arguments, [ca.jacobian(plain, by)])(*numbers).full()
        got = slope(*numbers).full()
        assert_allclose(got, by_ad, atol=1e-12 * np.abs(by_ad).max())


def test_the_solver_uses_the_structured_derivative(equilibrium):
    names = {f.name() for f in equilibrium.find_functions(-1)}
    assert {"equilibrium_residual", "jac_equilibrium_residual"} <= names


def test_an_nlp_chooses_the_stiffness_that_gives_a_sag():
    wing = hale_wing()
    EI = ca.MX.sym("EI")
    stiffness = 2e4 * EI
    symbolic = replace(wing, section=replace(wing.section, EI_y=stiffness))
    equilibrium = cc.equilibrium_function(symbolic, DOWN, {"EI": EI})
    opti = ca.Opti()
    x = opti.variable()
    q = equilibrium(np.zeros(9), x)
    tip = cc.tip_function(wing)(q)[0]
    opti.minimize(x)
    opti.subject_to(tip[2] <= 1.5)
    opti.subject_to(opti.bounded(0.5, x, 10))
    opti.set_initial(x, 1.0)
    opti.solver(
        "ipopt",
        {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"},
        {"hessian_approximation": "limited-memory", "tol": 1e-10},
    )
    chosen = opti.solve().value(x)
    stiff = replace(wing, section=replace(wing.section, EI_y=2e4 * chosen))
    sag = float(cc.solve_equilibrium(stiff, DOWN).shape.tip.position[2])
    assert_allclose(sag, 1.5, atol=1e-7)  # the tolerance of the solver, 1e-8 of a bound


def test_the_equilibrium_becomes_c(tmp_path, equilibrium):
    samples = [
        [np.zeros(9), *NOMINAL.values()],
        [np.full(9, 1e-3), 3e4, 2e4, 1.0, 0.5, [0.0, 5.0, -30.0], -0.4],
    ]
    # Without outputs that tell: refused, unless asked for.
    with pytest.raises(
        ValueError, match=r"'equilibrium' holds a solver \(FastNewton\).*checked=Tr"
    ):
        export_c([equilibrium], tmp_path, reference_inputs={"equilibrium": samples})
    export = CFunction(function=equilibrium, unchecked=True)
    export_c([export], tmp_path, reference_inputs={"equilibrium": samples})
    # Newton ends at rounding in either program: the check's own limit.
    assert run_check(tmp_path, optimization="-O0")["equilibrium"] <= 1e-13


# Bad input.


def test_symbols_are_refused_by_name():
    load = [cc.PointForce(1.0, ca.MX.sym("F", 3))]
    with pytest.raises(ValueError, match=r"loads: .*needs numbers, found the symbols F.*function"):
        cc.solve_equilibrium(rod(), load)
    soft = rod(section=replace(UNIT, EI_y=ca.MX.sym("EI")))
    with pytest.raises(ValueError, match=r"needs numbers, found the symbols EI"):
        cc.solve_equilibrium(soft, [])
    with pytest.raises(ValueError, match=r"Beam\.length: solve_equilibrium needs a number"):
        cc.solve_equilibrium(replace(rod(), length=ca.MX.sym("L")), [])


def test_sx_symbols_are_refused_by_name():
    with pytest.raises(ValueError, match=r"q is MX, loads at xi = 1 is SX"):
        cc.solve_equilibrium(rod(), [cc.PointForce(1.0, ca.SX.sym("F", 3))])


def test_a_guess_of_a_wrong_shape_is_refused():
    with pytest.raises(ValueError, match=r"q_guess: expected shape \(8, 1\), found \(3, 1\)"):
        cc.solve_equilibrium(rod(), [], [0, 0, 0])


def test_an_equilibrium_needs_a_section():
    with pytest.raises(ValueError, match=r"Beam\.section: expected a Section.* found None"):
        cc.solve_equilibrium(rod(section=None), [])


def test_a_parameter_that_is_not_listed_is_named():
    load = [cc.PointForce(1.0, ca.MX.sym("F", 3))]
    with pytest.raises(ValueError, match=r"parameters: expected every symbol, missing F"):
        cc.equilibrium_function(rod(), load)


@pytest.mark.parametrize("field", ["length", "initial_curvature"])
def test_symbols_that_shape_the_beam_are_refused(field):
    symbol = ca.MX.sym("x", *{"length": (1, 1), "initial_curvature": (3, 1)}[field])
    beam = replace(rod(), **{field: symbol})
    with pytest.raises(ValueError, match=rf"Beam\.{field}: expected numbers, found the symbol"):
        cc.equilibrium_function(beam, [cc.PointForce(1.0, UP)], {"x": symbol})


def test_a_load_beyond_the_weight_bounds_ends_with_the_last_shape_within():
    beam = replace(rod(), weight_bounds=0.5)
    with pytest.raises(cc.ConvergenceError, match=r"limit: q.*Beam\.weight_bounds") as raised:
        cc.solve_equilibrium(beam, [cc.PointForce(1.0, 4 * UP)])
    last = raised.value.result
    # The load steps are halved down to 1e-7, and a weight may exceed its bound by 1e-6 of it.
    assert_allclose(np.abs(last.q.full()).max(), 0.5, rtol=1e-5)
    part = cc.solve_equilibrium(beam, [cc.PointForce(1.0, 4 * last.load_factor * UP)])
    assert_allclose(last.q, part.q, atol=1e-9)  # Newton's tolerance


def test_elements_that_turn_too_far_are_refused():
    beam = rod(2, grid=cc.Grid.uniform(1))
    with pytest.raises(cc.ConvergenceError, match=r"Grid\.max_angle = 1 rad.*use more elements"):
        cc.solve_equilibrium(beam, [cc.PointMoment(1.0, [0, 1.3, 0])])


def test_a_column_buckles_with_the_branch_that_its_imperfection_chooses():
    # Twice the Euler load, and a force of 1/400 of it across: Newton's method from straight ends on
    # the unstable straight branch, at a tip 6 cm off. Following the load in 2000 steps of
    # `equilibrium_function` gives the tip below, to the centimetre.
    wing = replace(hale_wing(), weight_bounds=None)
    result = cc.solve_equilibrium(wing, [cc.PointForce(1.0, [0, -400, -1])])
    assert_allclose(result.shape.tip.position.full().ravel(), [0, 0.66, -12.67], atol=0.01)
    _, tangent = cc.equilibrium_tangent(wing, result.q, [cc.PointForce(1.0, [0, -400, -1])])
    assert np.all(np.linalg.eigvalsh(tangent.full()) > 0)


def test_a_checked_equilibrium_of_constant_loads_needs_no_parameters():
    wing = hale_wing()
    load = [cc.PointForce(1.0, [0, 0, -30.0])]
    found = cc.equilibrium_function(wing, load, checked=True)(q_guess=np.zeros(9))
    np.testing.assert_allclose(found["q"], cc.solve_equilibrium(wing, load).q, atol=1e-9)
    assert max(float(found["violation"]), float(found["stationarity"])) <= 1
