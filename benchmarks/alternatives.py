"""Side by side with what a user would pick instead, on the test wing at the same accuracy."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
from tqdm import tqdm

import curvcasadi as cc
from benchmarks import rods
from benchmarks.contender import BATCH, Contender, finite_at_zero, of_functions
from benchmarks.cost import ad_function, pose_jacobian
from benchmarks.generated_c import compiled
from benchmarks.table import HEADERS, Table, compared
from benchmarks.timing import seconds
from curvcasadi.beam.grid import RuleName
from curvcasadi.kinematics.pose_function import Form
from tests.support.wing import WEIGHTS, elements_for, position_error, wing

#: Tip error of every contender, in L.
TARGET = 1e-6
#: Seconds of a pose, of a pose and Jacobian, and per pose of a batch of each.
Times = tuple[float, float, float, float]
MISSING = "not installed: pip install curvcasadi[compare]"


def straight_wing() -> Table:
    """Whether derivatives exist at q = 0, where the wing is straight."""
    own = [
        (f"curvcasadi, {form}", _finite_of(_own_position(form), ca.MX))
        for form in ("compact", "unrolled")
    ]
    others = [
        ("Runge–Kutta 4 in SX", _finite_of(lambda q: rods.runge_kutta(q, 4)[0], ca.SX)),
        ("integrator (cvodes)", _finite_of(lambda q: rods.integrator(q, "cvodes", {})[0], ca.MX)),
        ("Eqs. 6 and 13 as printed", _finite_of(lambda q: rods.as_printed(q, 4)[0], ca.SX)),
    ]
    met = [all(finite) for _, finite in own]
    rows = [
        (name, _words(finite), "yes, yes", "ok" if all(finite) else "FAIL") for name, finite in own
    ] + [(name, _words(finite), "", "") for name, finite in others]
    return Table(
        title="Straight wing, q = 0: are Jacobian and Hessian of the tip position finite?",
        headers=HEADERS,
        rows=tuple(rows),
        failures=met.count(False),
        requirements=len(met),
    )


def _own_position(form: Form) -> Callable[[Any], Any]:
    tip = cc.tip_function(wing(4), form=form)
    return lambda q: tip(q)[0]


def _finite_of(position: Callable[[Any], Any], kind: Any) -> tuple[bool, bool]:
    q = kind.sym("q", WEIGHTS.size)
    return finite_at_zero(position(q), q)


def _words(flags: tuple[bool, bool]) -> str:
    return ", ".join("yes" if flag else "no" for flag in flags)


def side_by_side() -> Table:
    """Error, time per pose, time per pose and Jacobian, as ratios to this package's default."""
    contenders = _contenders()
    times = [_times(contender) for contender in tqdm(contenders, leave=False)]
    rows = [_row(c, t, times[0]) for c, t in zip(contenders, times, strict=True)]
    if shutil.which("gcc"):
        rows.insert(2, _generated_c_row(times[0]))
    if not any(c.name.startswith("soromox") for c in contenders):
        rows.append(("soromox on JAX", MISSING, *[""] * 6))
    headers = (
        "model",
        "size",
        "error / L",
        "pose, one call",
        "pose and J, one call",
        f"pose, batch of {BATCH}",
        f"pose and J, batch of {BATCH}",
        "J, H finite at q = 0",
    )
    notes = (
        "Times are ratios to the first row, of one run; each row takes the smallest size for an",
        f"error of {TARGET:g} L. One call: from Python, with its overhead. Batch: one call for",
        f"{BATCH} weight vectors, per pose: CasADi's serial `map`, or JAX's `vmap`, which may use",
        "every core. Generated C is timed in C. J: this package and soromox give the body Jacobian",
        "(6, 12) by their own methods, the others the derivative of position and rotation (12, 12)",
        "by AD or the integrator's sensitivities. soromox: one link, the same Legendre basis, the",
        "same Magnus rule in cells between Gauss points, whose unequal lengths cost it cells.",
    )
    return compared("Side by side: the test wing at one accuracy", headers, rows, notes)


def _contenders() -> list[Contender]:
    own = [_own("magnus4", "unrolled"), _own("magnus4", "compact"), _own("magnus6", "unrolled")]
    others = [_own_with_ad(), _runge_kutta(), _integrator_rk(), _integrator_cvodes(), _as_printed()]
    try:
        from benchmarks import soromox_rod
    except ImportError:
        return own + others
    return [*own, *others, soromox_rod.contender(TARGET)]


def _own(rule: RuleName, form: Form) -> Contender:
    n = elements_for(TARGET, rule)
    beam = wing(n, rule)
    pose = cc.tip_function(beam, form=form)
    return of_functions(
        f"curvcasadi, {rule}, {form}",
        f"{n} elements",
        pose,
        cc.tip_function(beam, form=form, jacobian=True),
        lambda: _finite_of(lambda q: pose(q)[0], ca.MX),
    )


def _own_with_ad() -> Contender:
    n = elements_for(TARGET, "magnus4")
    beam = wing(n)
    return of_functions(
        "the same chain in SX, J by AD",
        f"{n} elements",
        cc.tip_function(beam, form="unrolled"),
        ad_function(beam),
        lambda: _finite_of(lambda q: cc.shape_map(wing(4), q).tip.position, ca.SX),
    )


def _runge_kutta() -> Contender:
    steps = 16
    while _error(partial(rods.runge_kutta, steps=steps)) > TARGET:
        steps += 1
    return _by_ad(
        "Runge–Kutta 4 on Eqs. 2 and 4, SX, AD",
        f"{steps} steps",
        partial(rods.runge_kutta, steps=steps),
        ca.SX,
    )


def _integrator_rk() -> Contender:
    def rod(q: ca.MX, steps: int) -> rods.Tip:
        return rods.integrator(q, "rk", {"number_of_finite_elements": steps})

    steps = 16
    while _error(partial(rod, steps=steps), ca.MX) > TARGET:
        steps += 1
    return _by_ad(
        "CasADi integrator (rk), Eqs. 2 and 4", f"{steps} steps", partial(rod, steps=steps), ca.MX
    )


def _integrator_cvodes() -> Contender:
    def rod(q: ca.MX, tolerance: float) -> rods.Tip:
        return rods.integrator(q, "cvodes", {"reltol": tolerance, "abstol": tolerance / 10})

    tolerance = 1e-5
    while _error(partial(rod, tolerance=tolerance), ca.MX) > TARGET:
        tolerance *= 0.8
    return _by_ad(
        "CasADi integrator (cvodes), Eqs. 2 and 4",
        f"reltol {tolerance:.0e}",
        partial(rod, tolerance=tolerance),
        ca.MX,
    )


def _as_printed() -> Contender:
    n = elements_for(TARGET, "trapezoid")
    return _by_ad(
        "trapezoid, Eqs. 6 and 13 as printed, SX, AD",
        f"{n} elements",
        partial(rods.as_printed, elements=n),
        ca.SX,
        finite=partial(rods.as_printed, elements=4),
    )


def _by_ad(
    name: str,
    size: str,
    rod: Callable[..., rods.Tip],
    kind: Any,
    finite: Callable[..., rods.Tip] | None = None,
) -> Contender:
    """A contender from an expression; `finite` is a cheaper one for its derivatives at q = 0."""
    q = kind.sym("q", WEIGHTS.size)
    position, rotation = rod(q)
    outputs = [position, rotation]
    return of_functions(
        name,
        size,
        ca.Function("pose", [q], outputs),
        ca.Function("pose_and_jacobian", [q], [*outputs, pose_jacobian(position, rotation, q)]),
        lambda: _finite_of(lambda x: (finite or rod)(x)[0], kind),
    )


def _error(rod: Callable[..., rods.Tip], kind: Any = ca.DM) -> float:
    if kind is ca.DM:
        return position_error(rod(ca.DM(WEIGHTS))[0])
    q = ca.MX.sym("q", WEIGHTS.size)
    return position_error(ca.Function("position", [q], [rod(q)[0]])(WEIGHTS))


def _times(contender: Contender) -> Times:
    return (
        seconds(contender.pose, contender.point),
        seconds(contender.pose_and_jacobian, contender.point),
        seconds(contender.pose_batch, contender.batch) / BATCH,
        seconds(contender.pose_and_jacobian_batch, contender.batch) / BATCH,
    )


def _row(contender: Contender, times: Times, own: Times) -> tuple[str, ...]:
    return (
        contender.name,
        contender.size,
        f"{position_error(contender.position(WEIGHTS)):.1e}",
        *(f"{t / reference:.2f}" for t, reference in zip(times, own, strict=True)),
        _words(contender.finite()),
    )


def _generated_c_row(own: Times) -> tuple[str, ...]:
    """The compact form as C, timed in C."""
    n = elements_for(TARGET, "magnus4")
    times = [
        compiled(cc.tip_function(wing(n), jacobian=jacobian), "-O2", WEIGHTS).nanoseconds * 1e-9
        for jacobian in (False, True)
    ]
    ratios = (f"{t / reference:.2f}" for t, reference in zip(times, own[2:], strict=True))
    return "curvcasadi, magnus4, C (gcc -O2)", f"{n} elements", "as above", "", "", *ratios, ""
