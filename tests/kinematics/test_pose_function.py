"""Poses as Functions: that the structured Jacobian is attached, used and right."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.lie import so3
from tests.support import oracle
from tests.support.oracle import CURLED_WEIGHTS

FORMS = {"compact": ca.MX, "unrolled": ca.SX}
OTHER = {"compact": ca.SX, "unrolled": ca.MX}
forms = pytest.mark.parametrize("form", FORMS)
BASIS = cc.ChannelBasis(
    torsion=cc.Legendre(2), out_of_plane=cc.Legendre(3), in_plane=cc.Legendre(2)
)
WEIGHTS = np.array([0.08, 0.05, -0.1, 0.07, 0.04, 0.06, -0.05])
STATIONS = (0.2, 0.55, 1.0)
#: Values of the design parameters, by name.
DESIGN = {
    "length": 5.0,
    "root_vector": np.array([0.3, -0.5, 0.7]),
    "root_position": np.array([1.0, -2.0, 0.5]),
    "k0": np.array([0.02, -0.05, 0.03]),
}
DESIGNS = [(), *((name,) for name in DESIGN), ("length", "k0"), tuple(DESIGN)]
designs = pytest.mark.parametrize("names", DESIGNS, ids=lambda names: "+".join(names) or "none")


def design_beam(kind, names, **grid):
    """A beam with symbols of `kind` for the design parameters `names`, and the symbols."""
    symbols = {name: kind.sym(name, np.size(DESIGN[name])) for name in names}
    value = {**DESIGN, **symbols}
    vector = value["root_vector"]
    rotation = so3.exp(vector) if "root_vector" in symbols else oracle.rotation(vector)
    k0 = value["k0"]
    beam = cc.Beam(
        length=value["length"],
        basis=BASIS,
        grid=cc.Grid.uniform(4, **grid),
        root=cc.Pose(rotation=rotation, position=value["root_position"]),
        initial_curvature=(lambda xi: (1 + xi) * k0) if "k0" in symbols else None,
    )
    return beam, symbols


def plain_chain(names, stations=STATIONS, **grid):
    """(q, design …) -> all derivatives up to the second of the unrolled chain, by AD."""
    beam, symbols = design_beam(ca.SX, names, **grid)
    q = ca.SX.sym("q", BASIS.n)
    frames = [cc.pose_at(beam, q, xi) for xi in stations]
    position = ca.horzcat(*(frame.position for frame in frames))
    rotation = ca.horzcat(*(frame.rotation for frame in frames))
    return derivatives("plain", [q, *symbols.values()], position, rotation)


def derivatives(name, inputs, position, rotation):
    z = ca.veccat(*inputs)
    if isinstance(z, ca.MX):
        # One symbol for all inputs: AD needs a symbol, not a concatenation.
        whole = ca.MX.sym("z", z.numel())
        sizes = np.cumsum([0, *(symbol.numel() for symbol in inputs)]).tolist()
        parts = [
            ca.reshape(part, *symbol.shape)
            for part, symbol in zip(ca.vertsplit(whole, sizes), inputs, strict=True)
        ]
        position, rotation = ca.Function("pose", inputs, [position, rotation])(*parts)
        z = whole
    pose = ca.veccat(position, rotation)
    cost = ca.sumsqr(position - 1) + ca.sumsqr(ca.sin(rotation[0, :])) * position[0, -1]
    hessian, gradient = ca.hessian(cost, z)
    return ca.Function(name, [z], [pose, ca.jacobian(pose, z), gradient, hessian])


def point(names):
    return np.concatenate([WEIGHTS, *(np.ravel(DESIGN[name]) for name in names)])


def called_with_mx(f, shapes):
    """Derivatives of `f` as an MX caller sees them."""
    inputs = [ca.MX.sym(name, *shape) for name, shape in shapes.items()]
    position, rotation = f(*inputs)[:2]
    return derivatives("called", inputs, position, rotation)


def input_shapes(f):
    return {name: f.size_in(name) for name in f.name_in()}


def function_names(f):
    """Names of all Functions that `f` calls, at any depth."""
    names = set()
    for inner in f.find_functions():
        names.add(inner.name())
    return names


def assert_structured(f, name):
    """`f` calls the attached Jacobian, and no derivative of the chain."""
    names = function_names(f)
    assert f"jac_{name}" in names
    # Second derivatives sweep through the attached Jacobian, never through the chain.
    chain = re.compile(rf"(fwd|adj)\d+_({name}|element_pose)$")
    assert not [inner for inner in names if chain.match(inner)]


# Values ----------------------------------------------------------------------------------------


@forms
def test_tip_function_is_the_tip_of_the_shape(wing, form):
    beam = wing(5, root=cc.Pose(rotation=oracle.rotation([1, 2, 3]), position=[1, 2, 3]))
    f = cc.tip_function(beam, form)
    assert f.name() == "tip"
    assert f.name_in() == ["q"]
    assert f.name_out() == ["position", "rotation"]
    assert (f.size_in("q"), f.size_out("position"), f.size_out("rotation")) == (
        (12, 1),
        (3, 1),
        (3, 3),
    )
    tip = cc.shape_map(beam, CURLED_WEIGHTS).tip
    got = f(q=CURLED_WEIGHTS)
    assert_allclose(got["position"], tip.position, atol=2e-14)  # the same operations
    assert_allclose(got["rotation"], tip.rotation, atol=2e-15)


@forms
def test_pose_function_stacks_stations_in_their_order(form):
    beam, _ = design_beam(ca.SX, ())
    stations = (1.0, 0.2, 0.2, 0.55, 0.0)
    f = cc.pose_function("poses", beam, stations, form)
    position, rotation = f(WEIGHTS)
    assert (position.shape, rotation.shape) == ((3, 5), (3, 15))
    for k, xi in enumerate(stations):
        pose = beam.root if xi == 0 else cc.pose_at(beam, WEIGHTS, xi)
        assert_allclose(position[:, k], pose.position, atol=1e-15)
        assert_allclose(rotation[:, 3 * k : 3 * k + 3], pose.rotation, atol=1e-15)


@forms
def test_pose_function_of_the_root_alone_is_constant(form):
    beam, _ = design_beam(ca.SX, ())
    f = cc.pose_function("root", beam, (0.0,), form)
    assert_allclose(f(WEIGHTS)[0], beam.root.position, rtol=0)
    q = ca.MX.sym("q", BASIS.n)
    J = ca.Function("J", [q], [ca.jacobian(f(q)[0], q)])(WEIGHTS)
    assert_allclose(J, 0, atol=0)


@forms
def test_unrolled_form_is_sx_and_compact_form_a_chain_of_calls(wing, form):
    f = cc.tip_function(wing(16), form)
    assert f.is_a("SXFunction") == (form == "unrolled")
    assert ("element_pose" in function_names(f)) == (form == "compact")


# Derivatives -----------------------------------------------------------------------------------


@designs
@forms
def test_derivatives_equal_ad_of_the_chain(form, names):
    beam, symbols = design_beam(FORMS[form], names)
    f = cc.pose_function("poses", beam, STATIONS, form, parameters=symbols)
    called = called_with_mx(f, input_shapes(f))
    assert_structured(called, "poses")
    got, expected = called(point(names)), plain_chain(names)(point(names))
    for value, exact in zip(got, expected, strict=True):
        # Both are exact: rounding, beside the largest entry of some 100.
        scale = np.abs(np.array(exact)).max()
        assert_allclose(value, exact, rtol=0, atol=1e-13 * scale)


@forms
@pytest.mark.parametrize("rule", ["trapezoid", "midpoint", "magnus6"])
def test_derivatives_equal_ad_with_every_rule(form, rule):
    names = tuple(DESIGN)
    beam, symbols = design_beam(FORMS[form], names, rule=rule)
    f = cc.pose_function("poses", beam, STATIONS, form, parameters=symbols)
    got = called_with_mx(f, input_shapes(f))(point(names))
    expected = plain_chain(names, rule=rule)(point(names))
    for value, exact in zip(got, expected, strict=True):
        scale = np.abs(np.array(exact)).max()
        assert_allclose(value, exact, rtol=0, atol=1e-13 * scale)  # as above


@forms
@pytest.mark.parametrize("exponential", ["series", "rodrigues"])
def test_derivatives_at_the_straight_wing_equal_ad(form, exponential):
    beam, _ = design_beam(FORMS[form], (), exponential=exponential)
    f = cc.pose_function("poses", beam, STATIONS, form)
    got = called_with_mx(f, input_shapes(f))(np.zeros(7))
    for value, exact in zip(got, plain_chain(())(np.zeros(7)), strict=True):
        scale = np.abs(np.array(exact)).max()
        assert_allclose(value, exact, rtol=0, atol=1e-13 * scale)  # as above


@forms
def test_gradients_and_sweeps_use_the_structured_jacobian(wing, form):
    f = cc.tip_function(wing(8), form)
    q, seed = ca.MX.sym("q", 12), ca.MX.sym("seed", 12)
    cost = ca.sumsqr(f(q)[0]) + ca.sumsqr(f(q)[1][:, 0])
    for expression in (
        ca.gradient(cost, q),
        ca.jtimes(f(q)[0], q, seed),
        ca.jtimes(f(q)[0], q, ca.MX.sym("adjoint", 3), True),
    ):
        g = ca.Function("g", ca.symvar(expression), [expression])
        assert_structured(g, "tip")


@forms
def test_jacobian_is_used_when_called_with_the_defining_symbol(form):
    """Called with the very symbol of a field, the Function stays a call."""
    length = FORMS[form].sym("length")
    beam = cc.Beam(length=length, basis=BASIS, grid=cc.Grid.uniform(4))
    f = cc.tip_function(beam, form, parameters={"length": length})
    q, L = ca.MX.sym("q", 7), length if form == "compact" else ca.MX.sym("L")
    J = ca.Function("J", [q, L], [ca.jacobian(f(q, L)[0], L)])
    assert_structured(J, "tip")
    plain = [
        cc.shape_map(cc.Beam(length=x, basis=BASIS, grid=cc.Grid.uniform(4)), WEIGHTS).tip.position
        for x in (5.0 - 1e-4, 5.0 + 1e-4)
    ]
    # Central differences of 1e-4.
    assert_allclose(J(WEIGHTS, 5.0), (plain[1] - plain[0]) / 2e-4, atol=1e-8)


@forms
def test_jacobian_is_used_when_called_with_the_symbols_of_the_function_itself(wing, form):
    f = cc.tip_function(wing(4), form)
    (q,) = f.mx_in()
    assert_structured(ca.Function("J", [q], [ca.jacobian(f(q)[0], q)]), "tip")


@forms
def test_approximate_exponentials_are_differentiated_by_casadi(wing, form):
    f = cc.tip_function(wing(4, exponential="small_angle_sine"), form)
    q = ca.MX.sym("q", 12)
    J = ca.Function("J", [q], [ca.jacobian(f(q)[0], q)])
    d = 1e-6
    for i in (0, 5, 11):
        step = d * np.eye(12)[i]
        difference = (f(CURLED_WEIGHTS + step)[0] - f(CURLED_WEIGHTS - step)[0]) / (2 * d)
        # Central differences of 1e-6 on derivatives of some 100 m².
        assert_allclose(J(CURLED_WEIGHTS)[:, i], difference, atol=1e-6)


@forms
def test_serialization_keeps_the_jacobian(wing, tmp_path, form):
    f = cc.tip_function(wing(4), form)
    path = str(tmp_path / "tip.casadi")
    f.save(path)
    for again in (ca.Function.deserialize(f.serialize()), ca.Function.load(path)):
        q = ca.MX.sym("q", 12)
        position, rotation = again(q)
        pose = ca.veccat(position, rotation)
        J = ca.Function("J", [q], [ca.jacobian(pose, q)])
        assert_structured(J, "tip")
        original = ca.veccat(*f(q))
        expected = ca.Function("J", [q], [ca.jacobian(original, q)])(CURLED_WEIGHTS)
        assert_allclose(J(CURLED_WEIGHTS), expected, rtol=0, atol=0)


@forms
def test_structured_derivatives_are_smaller_than_ad(wing, form):
    q = ca.SX.sym("q", 12)
    tip = cc.shape_map(wing(16), q).tip
    pose = ca.veccat(tip.position, tip.rotation)
    by_ad = ca.Function("ad", [q], [ca.jacobian(pose, q)], {"cse": True})
    f = cc.tip_function(wing(16), form)
    x = ca.MX.sym("q", 12)
    called = ca.Function("J", [x], [ca.jacobian(f(x)[0], x)])
    (jac,) = [g for g in called.find_functions() if g.name() == "jac_tip"]
    limit = 0.35 * by_ad.n_instructions() if form == "unrolled" else 200
    assert jac.n_instructions() < limit


# The body Jacobian as an output ----------------------------------------------------------------


@forms
def test_third_output_is_the_body_jacobian(form):
    names = tuple(DESIGN)
    beam, symbols = design_beam(FORMS[form], names)
    f = cc.pose_function("poses", beam, STATIONS, form, parameters=symbols, jacobian=True)
    assert f.name_out() == ["position", "rotation", "jacobian"]
    assert f.size_out("jacobian") == (18, 7)
    values = [DESIGN[name] for name in names]
    plain = cc.Beam(
        length=5.0,
        basis=BASIS,
        grid=cc.Grid.uniform(4),
        initial_curvature=lambda xi: (1 + xi) * DESIGN["k0"],
    )
    position, rotation, jacobian = f(WEIGHTS, *values)
    reference = cc.pose_function("poses", beam, STATIONS, form, parameters=symbols)
    expected = reference(WEIGHTS, *values)
    assert_allclose(position, expected[0], atol=1e-14)  # rounding
    assert_allclose(rotation, expected[1], atol=1e-14)
    for k, xi in enumerate(STATIONS):
        block = jacobian[6 * k : 6 * k + 6, :]
        assert_allclose(block, cc.body_jacobian(plain, WEIGHTS, xi), atol=1e-13)  # rounding


@forms
def test_derivative_of_the_third_output_is_nan_not_zero(wing, form):
    f = cc.tip_function(wing(3), form, jacobian=True)
    q = ca.MX.sym("q", 12)
    J = f(q)[2]
    rates = [
        ca.jacobian(ca.vec(J), q),
        ca.jtimes(J[5, 3], q, ca.DM.ones(12)),
        ca.gradient(ca.sumsqr(J), q),
    ]
    for rate in rates:
        value = ca.Function("rate", [q], [rate])(CURLED_WEIGHTS).full()
        assert np.all(np.isnan(value))


@forms
def test_third_output_does_not_contaminate_the_other_derivatives(form):
    names = ("length", "k0")
    beam, symbols = design_beam(FORMS[form], names)
    with_jacobian = cc.pose_function(
        "poses", beam, STATIONS, form, parameters=symbols, jacobian=True
    )
    got = called_with_mx(with_jacobian, input_shapes(with_jacobian))(point(names))
    expected = plain_chain(names)(point(names))
    for value, exact in zip(got, expected, strict=True):
        scale = np.abs(np.array(exact)).max()
        assert_allclose(value, exact, rtol=0, atol=1e-13 * scale)  # rounding, no NaN


@forms
def test_values_of_all_outputs_and_gradients_of_one_in_one_expression(wing, form):
    f = cc.tip_function(wing(3), form, jacobian=True)
    q = ca.MX.sym("q", 12)
    position, _, J = f(q)
    g = ca.Function("g", [q], [ca.gradient(ca.sumsqr(position), q), J])
    gradient, jacobian = g(CURLED_WEIGHTS)
    tip = cc.shape_map(wing(3), CURLED_WEIGHTS).tip
    expected = 2 * (tip.rotation @ jacobian[3:, :]).T @ tip.position
    # Rounding beside 2 × 16 m × 128 m².
    assert_allclose(gradient, expected, atol=1e-10)


# In an NLP -------------------------------------------------------------------------------------


@forms
def test_an_nlp_on_the_tip_function_converges(wing, form):
    f = cc.tip_function(wing(8), form)
    goal = cc.shape_map(wing(8), CURLED_WEIGHTS).tip
    opti = ca.Opti()
    q = opti.variable(12)
    position, rotation = f(q)
    opti.minimize(ca.sumsqr(q))
    opti.subject_to(position == goal.position)
    opti.subject_to(so3.attitude_error(rotation, goal.rotation) == 0)
    opti.set_initial(q, 0.5 * CURLED_WEIGHTS)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    solution = opti.solve()
    tip = cc.shape_map(wing(8), solution.value(q)).tip
    # The tolerance of the solver, 1e-8.
    assert_allclose(tip.position, goal.position, atol=1e-6)
    assert_allclose(tip.rotation, goal.rotation, atol=1e-6)


# Bad input -------------------------------------------------------------------------------------


@forms
@pytest.mark.parametrize("names", [(name,) for name in DESIGN], ids=lambda names: names[0])
def test_design_symbols_of_the_other_kind_are_refused_by_field(form, names):
    field = {
        "length": r"Beam\.length",
        "root_vector": r"Beam\.root\.rotation",
        "root_position": r"Beam\.root\.position",
        "k0": r"Beam\.initial_curvature",
    }[names[0]]
    beam, symbols = design_beam(OTHER[form], names)
    right, wrong = FORMS[form].__name__, OTHER[form].__name__
    with pytest.raises(ValueError, match=rf"parameters\['{names[0]}'\].*{right}.*{wrong}"):
        cc.tip_function(beam, form, parameters=symbols)
    with pytest.raises(ValueError, match=rf"{field}: .*{right}.*{wrong}"):
        cc.tip_function(beam, form)


@forms
@pytest.mark.parametrize("names", [(name,) for name in DESIGN], ids=lambda names: names[0])
def test_undeclared_design_symbols_are_refused_by_field(form, names):
    beam, _ = design_beam(FORMS[form], names)
    with pytest.raises(ValueError, match=rf"Beam\..*among parameters, found {names[0]}"):
        cc.tip_function(beam, form)
    with pytest.raises(ValueError, match=rf"Beam\..*among parameters, found {names[0]}"):
        cc.tip_function(beam, form, parameters={names[0]: FORMS[form].sym(names[0])})


@forms
def test_undeclared_symbols_that_vanish_at_mid_span_are_refused_by_field(form):
    k = FORMS[form].sym("k", 3)
    for initial in (lambda xi: k * (xi - 0.5), lambda xi: k if xi > 0.5 else ca.DM.zeros(3)):
        beam = cc.Beam(length=5.0, basis=BASIS, grid=cc.Grid.uniform(4), initial_curvature=initial)
        with pytest.raises(ValueError, match=r"Beam\.initial_curvature: .*found k"):
            cc.tip_function(beam, form)


@forms
@pytest.mark.parametrize("value", [1.0, ca.DM(1), "expression"], ids=str)
def test_parameters_must_be_symbols(form, value):
    if value == "expression":
        value = 2 * FORMS[form].sym("L")
    beam, _ = design_beam(FORMS[form], ())
    with pytest.raises(ValueError, match=r"parameters\['L'\]: form .* symbols, found"):
        cc.tip_function(beam, form, parameters={"L": value})


@forms
def test_a_parameter_cannot_take_the_name_of_the_weights(form):
    beam, symbols = design_beam(FORMS[form], ("length",))
    with pytest.raises(ValueError, match=r"parameters"):
        cc.tip_function(beam, form, parameters={"q": symbols["length"]})


@pytest.mark.parametrize("form", ["fast", None, ca.MX])
def test_unknown_forms_are_refused(wing, form):
    with pytest.raises(ValueError, match=r"form: expected one of 'compact', 'unrolled'; found"):
        cc.tip_function(wing(2), form)


@pytest.mark.parametrize("stations", [(1.2,), (-0.1, 1.0), (), (ca.SX.sym("xi"),), (np.nan,), 1.0])
def test_stations_off_the_beam_are_refused(wing, stations):
    with pytest.raises(ValueError, match=r"stations: expected"):
        cc.pose_function("poses", wing(2), stations)


def test_unused_parameters_have_zero_derivatives():
    beam, _ = design_beam(ca.MX, ())
    f = cc.tip_function(beam, parameters={"payload": ca.MX.sym("payload", 2)})
    q, payload = ca.MX.sym("q", 7), ca.MX.sym("payload", 2)
    J = ca.Function("J", [q, payload], [ca.jacobian(f(q, payload)[0], payload)])
    assert_allclose(J(WEIGHTS, [1, 2]), np.zeros((3, 2)), atol=0)
