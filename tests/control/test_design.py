"""Design derivatives about moving equilibria against Richardson differences of whole analyses."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.support.strip_wings import ROOT

NOMINAL = {
    "EI": 2e4,
    "GJ": 1e4,
    "mass": 0.75,  #: per length
    "aft": 0.02,  #: of the centre of mass behind the reference curve
    "chord": 1.0,
    "sweep": 0.05,
    "ahead": 0.25,  #: of the aerodynamic centre before the reference curve
    "pitch": 0.03,
}
NAMES = list(NOMINAL)
DESIGN = NAMES[:-1]
#: Steps of differences.
STEPS = {"EI": 40.0, "GJ": 20.0, "mass": 2e-3, "aft": 2e-3, "chord": 2e-3, "sweep": 2e-3}
STEPS |= {"ahead": 1e-3, "pitch": 1e-4}
SPEED = 20.0
NUMBERS = {name: NOMINAL[name] for name in DESIGN}


def swept(angle):
    c, s = ca.cos(angle), ca.sin(angle)
    turned = ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))
    return cc.Pose(rotation=ROOT.rotation @ turned, position=[0, 0, 0])


def wing(EI, GJ, mass, aft, chord, sweep, ahead):
    section = cc.Section(
        GJ=GJ,
        EI_y=EI,
        EI_z=4e6,
        mass_per_length=mass,
        inertia=np.diag([0.1, 5e-4, 0.0995]),
        center_of_mass=ca.vertcat(0, -aft, 0),
    )
    families = {"torsion": 2, "out_of_plane": 2, "in_plane": 1}
    beam = cc.Beam(
        length=16.0,
        basis=cc.ChannelBasis(**{name: cc.Legendre(n) for name, n in families.items()}),
        grid=cc.Grid.lobatto(3),
        section=section,
        root=swept(sweep),
    )
    strips = cc.StripAerodynamics(
        chord=chord, aerodynamic_center=ahead, lift_slope=2 * np.pi, upper_side=1
    )
    return cc.Wing(name="wing", beam=beam, strips=strips)


@pytest.fixture(scope="module")
def model():
    symbols = {name: ca.MX.sym(name) for name in DESIGN}
    return cc.wing_model(
        wing(**symbols),
        parameters=symbols,
        density=0.0889,
        lag=cc.IndicialLag(poles=2, modes=2),
        gust=cc.GustEntry(kind="kussner", modes=1),
        outputs=("tip_position", "root_moment"),
    )


def richardson(function, name):
    """Of the fourth order in the step."""

    def central(step):
        ends = [function({**NOMINAL, name: NOMINAL[name] + s}) for s in (step, -step)]
        return (ends[0] - ends[1]) / (2 * step)

    step = STEPS[name]
    return (4 * central(step / 2) - central(step)) / 3


def test_parameters_enter_as_numbers_would(model):
    plain = cc.wing_model(
        wing(**NUMBERS),
        density=0.0889,
        lag=cc.IndicialLag(poles=2, modes=2),
        gust=cc.GustEntry(kind="kussner", modes=1),
        outputs=("tip_position", "root_moment"),
    )
    x = 0.02 * np.random.default_rng(1).standard_normal(model.x.size)
    flight = [SPEED, 0.03, 0.4]
    design = [*NUMBERS.values()]
    for name in ("xdot", "output"):
        expected = getattr(plain, name)(x, [], flight).full()
        got = getattr(model, name)(x, [], [*flight, *design]).full()
        assert_allclose(got, expected, atol=1e-12 * np.abs(expected).max())


@pytest.fixture(scope="module")
def found(model):
    return cc.flutter(model, np.arange(18, 32, 2.0), p=NOMINAL)


@pytest.mark.parametrize("name", NAMES)
def test_flutter_speed(name, model, found):
    around = [found.speed - 1, found.speed + 1]
    expected = richardson(lambda p: cc.flutter(model, around, p=p).speed, name)
    got = cc.flutter_derivatives(found, NAMES)[name].item()
    # Speeds are found to 1e-9: over the steps that is 1e-6 of the largest derivatives.
    assert_allclose(got, expected, rtol=1e-6)


def about(model, p, names=("pitch",)):
    rest = cc.flutter(model, [18.0, SPEED], p=p).equilibria[-1]
    return cc.design_derivatives(cc.linearize(model, rest, p={"airspeed": SPEED, **p}), names)


@pytest.fixture(scope="module")
def derived(model):
    return about(model, NOMINAL, NAMES)


GUST = cc.OneMinusCosine(amplitude=1.0, duration=0.8)


def summary(derived, near):
    """What is differentiated: two roots, their damping, the peaks of the root bending moment."""
    roots, ratios = derived.roots[0], derived.damping_ratios[0]
    rows = [np.argmin(np.abs(roots - root)) for root in near]
    peaks = [
        cc.response_peak(derived, (0.5, 60.0), "root_moment", 1).value,
        cc.gust_peak(derived, GUST, 3.0, "root_moment", 1).value,
    ]
    return np.concatenate([roots[rows].real, roots[rows].imag, ratios[rows], peaks])


@pytest.mark.parametrize("name", NAMES)
def test_roots_damping_and_peaks(name, model, derived):
    roots = derived.roots[0]
    near = roots[roots.imag > 1][:2]
    rows = [int(np.flatnonzero(roots == root)[0]) for root in near]
    k = NAMES.index(name)
    slopes, damping = derived.roots[1][rows, k], derived.damping_ratios[1][rows, k]
    peaks = [
        cc.response_peak(derived, (0.5, 60.0), "root_moment", 1).derivatives[k],
        cc.gust_peak(derived, GUST, 3.0, "root_moment", 1).derivatives[k],
    ]
    got = np.concatenate([slopes.real, slopes.imag, damping, peaks])
    expected = richardson(lambda p: summary(about(model, p), near), name)
    # Beside what is differenced, whose rounding the steps divide.
    scale = np.abs(summary(derived, near)) / max(abs(NOMINAL[name]), 0.03)
    assert_allclose(got, expected, rtol=1e-6, atol=1e-8 * scale.max())


def test_the_equilibrium_moves_as_its_derivatives_say(model, derived):
    for k, name in enumerate(NAMES):
        expected = richardson(lambda p: cc.flutter(model, [18.0, SPEED], p=p).equilibria[-1], name)
        assert_allclose(derived.x[:, k], expected, atol=1e-7 * np.abs(expected).max())


def test_design_derivatives_go_through_no_chain(model):
    motion = model.second_order.balance
    p, rest = ca.MX.sym("p", model.p.size), [np.zeros(motion.numel_in(i)) for i in range(3)]
    slope = ca.Function("slope", [p], [ca.jacobian(ca.vertcat(*motion(*rest, p)), p)])
    names = {f.name() for f in slope.find_functions()}
    assert "jac_wing_forces" in names
    assert not any(name.startswith(("fwd", "adj")) and "element" in name for name in names)


def test_flutter_and_divergence_by_sweep():
    sweep = ca.MX.sym("sweep")
    model = cc.wing_model(
        wing(**{**NUMBERS, "aft": 0.0, "sweep": sweep}),
        parameters={"sweep": sweep},
        density=0.0889,
        gravity=0.0,
        lag=cc.IndicialLag(poles=2, modes=2),
        outputs=("tip_position",),
    )
    # Forward sweep diverges first, aft sweep flutters alone.
    for angle, derivatives, key in (
        (-0.1, cc.flutter_derivatives, "speed"),
        (0.05, cc.divergence_derivatives, "divergence_speed"),
    ):
        found = cc.flutter(model, np.arange(20, 42, 4.0), p={"sweep": angle, "pitch": 0.0})
        at = getattr(found, key)

        def speed(step, angle=angle, key=key, at=at):
            return getattr(
                cc.flutter(model, [at - 2, at + 2], p={"sweep": angle + step, "pitch": 0.0}), key
            )

        central = [(speed(s) - speed(-s)) / (2 * s) for s in (2e-3, 1e-3)]
        expected = (4 * central[1] - central[0]) / 3
        assert_allclose(derivatives(found, ["sweep"])["sweep"].item(), expected, rtol=1e-6)


BENT = {"EI": 2e4, "GJ": 1e4, "chord": 1.0, "sweep": 0.05, "ahead": 0.25, "drag": 0.3, "EI_z": 2e4}
LEVEL = {"pitch": 0.0}


@pytest.fixture(scope="module")
def dragged():
    """A wing of a symmetric airfoil that its drag bends, in its plane, by half a radian."""
    symbols = {name: ca.MX.sym(name) for name in BENT}
    known = {key: value for key, value in symbols.items() if key in DESIGN}
    plain = wing(**{**NUMBERS, "aft": 0.0, **known})
    beam = replace(plain.beam, section=replace(plain.beam.section, EI_z=symbols["EI_z"]))
    strips = replace(plain.strips, profile_drag=symbols["drag"])
    return cc.wing_model(
        replace(plain, beam=beam, strips=strips),
        parameters=symbols,
        density=0.0889,
        gravity=0.0,
        lag=cc.IndicialLag(poles=2, modes=2),
        outputs=(),
    )


@pytest.fixture(scope="module")
def diverged(dragged):
    return cc.flutter(dragged, [24.0, 28.0, 32.0, 36.0], p=BENT | LEVEL)


@pytest.mark.parametrize("name", BENT)
def test_divergence_of_a_wing_that_is_bent_in_its_plane(name, dragged, diverged):
    at, step = diverged.divergence_speed, 4e-3 * BENT[name] if name != "sweep" else 2e-3
    assert abs(diverged.divergence_equilibrium[4]) * 16 > 0.4

    def central(step):
        around = [at - 2, at - 0.5, at + 1]
        ends = [
            cc.flutter(dragged, around, p=BENT | LEVEL | {name: BENT[name] + s}).divergence_speed
            for s in (step, -step)
        ]
        return (ends[0] - ends[1]) / (2 * step)

    got = cc.divergence_derivatives(diverged, [*BENT])[name].item()
    assert_allclose(got, (4 * central(step / 2) - central(step)) / 3, rtol=1e-6)


def test_what_bends_a_wing_as_it_diverges_has_no_divergence_speed(diverged):
    with pytest.raises(ValueError, match=r"found pitch\[0\]"):
        cc.divergence_derivatives(diverged, ["EI", "pitch"])


def test_a_nonlinear_program_takes_the_flutter_speed(model):
    others = {name: NOMINAL[name] for name in NAMES[2:]}
    function = cc.flutter_speed_function(model, ["EI", "GJ"], [18.0, 24.0, 27.0], p=others)
    design = ca.MX.sym("design", 2)
    slope = ca.Function("slope", [design], [ca.jacobian(function(design), design)])
    at = [NOMINAL["EI"], NOMINAL["GJ"]]
    found = cc.flutter(model, [18.0, 24.0, 27.0], p=NOMINAL)
    assert_allclose(float(function(at)), found.speed, rtol=1e-12)
    expected = cc.flutter_derivatives(found, ["EI", "GJ"])
    assert_allclose(slope(at).full().ravel(), np.concatenate([*expected.values()]), rtol=1e-12)
    assert np.isnan(float(function([1e-3, 1e-3])))  # a wing that is unstable at the first speed


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda f, d: cc.flutter_derivatives(f, ["airspeed"]), "names: expected parameters other"),
        (lambda f, d: cc.flutter_derivatives(f, ["span"]), "names: expected one of"),
        (lambda f, d: cc.divergence_derivatives(f, ["EI"]), "divergence speed, found none"),
        (lambda f, d: cc.response_peak(d, (5.0, 1.0), "root_moment"), "omega: expected two"),
        (lambda f, d: cc.response_peak(d, (0.0, 1.0), "root_moment", 3), "entry: expected one"),
        (lambda f, d: cc.gust_peak(d, GUST, -1.0, "root_moment"), "duration: expected"),
        (lambda f, d: cc.gust_peak(d, 3.0, 1.0, "root_moment"), "gust: expected a function"),
        (
            lambda f, d: cc.gust_peak(d, lambda t: np.nan, 1.0, "root_moment"),
            r"gust\(0\): expected finite",
        ),
        (lambda f, d: cc.gust_peak(d, GUST, 1.0, "root_moment", 0.5), "entry: expected a whole"),
        (lambda f, d: cc.flutter_derivatives(f, "EI"), "names: expected a sequence, found 'EI'"),
        (
            lambda f, d: cc.design_derivatives(
                cc.linearize(f.model, {"q": [0.1] * 5}, p={"airspeed": SPEED, **NOMINAL}), ["EI"]
            ),
            "about a steady state",
        ),
        (
            lambda f, d: cc.wing_model(
                wing(**{**NUMBERS, "EI": ca.MX.sym("EI")}), density=1.0, outputs=()
            ),
            "expected",
        ),
    ],
)
def test_bad_input_is_named(call, message, found, derived):
    with pytest.raises(ValueError, match=message):
        call(found, derived)
