"""Static equilibrium as a `casadi.Function`: differentiable, and exportable as C."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.kinematics.shape import squared_element_angles
from curvcasadi.loads.stations import Load
from curvcasadi.statics.balance import (
    equilibrium_residual,
    equilibrium_tangent,
    parameter_slopes,
)
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import BOUND_SLACK, AnyExpr, function_name
from curvcasadi.symbolic.functions import free_symbols

#: Newton step, rad/m, at which the solver ends.
_STEP = {"double": 1e-12, "float": 1e-6}
#: Excess over a limit that counts as kept, and residual over the largest force that counts as zero.
_CERTIFIED = {"double": (BOUND_SLACK["double"], 1e-8), "float": (BOUND_SLACK["float"], 1e-4)}


def equilibrium_function(
    beam: Beam,
    loads: Sequence[Load],
    parameters: Mapping[str, AnyExpr] | None = None,
    *,
    attitude: AnyExpr | None = None,
    name: str = "equilibrium",
    max_iter: int = 50,
    checked: bool = False,
) -> ca.Function:
    """Equilibrium as a Function: q_guess, parameters … -> q (n, 1), rad/m.

    `fast_newton` on the residual with its structured derivative; derivatives of q with respect to
    the parameters follow from the implicit function theorem. It becomes self-contained C. Newton's
    steps are full and the loads are not stepped, and it never raises (NaN parameters give the guess
    back): guess near the equilibrium, and check `equilibrium_residual`.

    Parameters
    ----------
    beam : Beam
        With a section.
    loads : sequence of loads
        Such as `Gravity` and `PointForce`; they may hold parameters.
    parameters : mapping of str to MX, optional
        Symbols in loads, attitude and section, by the name of their input.
    attitude : MX or array, shape (3, 3), optional
        Rotation from parent to inertial axes; the identity unless given.
    name : str
        Name of the Function, also in generated C.
    max_iter : int
        Newton steps at most.
    checked : bool
        Whether to add two outputs that are at most 1 where q is an equilibrium: violation, the
        largest excess over weight bounds (rad/m) and squared element angles (rad²) over 1e-6 (of a
        beam with `Grid(real="float")`: 1e-5), and stationarity, the largest entry of the residual
        over 1e-8 (float: 1e-4) of the largest force, elastic, applied, or of a bend of 1e-3 rad.

    Returns
    -------
    casadi.Function
        Inputs q_guess (n, 1), rad/m, and the parameters; output q (n, 1), rad/m.
    """
    function_name("name", name)
    parameters = dict(parameters or {})
    if "q_guess" in parameters:
        raise ValueError("parameters: expected names other than 'q_guess', found 'q_guess'")
    n = beam.basis.n
    residual = residual_function(
        beam, loads, parameters, attitude=attitude, name=f"{name}_residual"
    )
    q, guess = ca.MX.sym("q", n), ca.MX.sym("q_guess", n)
    stacked = ca.veccat(*parameters.values()) if parameters else ca.MX.sym("none", 0)
    symbols = ca.MX.sym("p", stacked.numel())
    parts = _unstack(symbols, list(parameters.values()))
    root = ca.rootfinder(
        f"{name}_solver",
        "fast_newton",
        {"x": q, "p": symbols, "g": residual(q, *parts)},
        {"max_iter": max_iter, "error_on_fail": False, "abstolStep": _STEP[beam.grid.real]},
    )
    outputs = {"q": root(guess, stacked)}
    if checked:
        certificate = _certificate(
            f"{name}_certificate", beam, residual, parameters, symbols, parts
        )
        outputs["violation"], outputs["stationarity"] = certificate(outputs["q"], stacked)
    return ca.Function(
        name,
        [guess, *parameters.values()],
        [*outputs.values()],
        ["q_guess", *parameters],
        [*outputs],
    )


def _certificate(
    name: str,
    beam: Beam,
    residual: ca.Function,
    parameters: Mapping[str, AnyExpr],
    symbols: ca.MX,
    parts: list[ca.MX],
) -> ca.Function:
    """(q, parameters) -> violation, stationarity: the conditions that an equilibrium meets."""
    limit, balanced = _CERTIFIED[beam.grid.real]
    q = ca.MX.sym("q", beam.basis.n)
    lower, upper = beam.bounds
    angles = squared_element_angles(beam, q) - beam.grid.max_angle**2
    violation = ca.mmax(ca.vertcat(0, lower - q, q - upper, angles)) / limit
    of_parameters = ca.Function(
        "stiffness", [*parameters.values()], [ca.MX(stiffness_matrix(beam))]
    )
    (stiffness,) = of_parameters.call(parts)  # with no parameters, calling it returns a dict
    left = residual(q, *parts)
    elastic = stiffness @ q
    bend = ca.mmax(ca.fabs(ca.diag(stiffness))) * 1e-3 / numeric_length(beam, "checked")
    scale = ca.mmax(ca.fabs(ca.vertcat(elastic, elastic - left, bend)))
    # The Euclidean norm, as a maximum would overlook NaN.
    return ca.Function(name, [q, symbols], [violation, ca.norm_2(left) / (scale * balanced)])


def residual_function(
    beam: Beam,
    loads: Sequence[Load],
    parameters: Mapping[str, AnyExpr],
    *,
    attitude: AnyExpr | None = None,
    name: str = "equilibrium_residual",
) -> ca.Function:
    """Residual S q − Q as a Function: q, parameters … -> residual, structured derivative attached.

    The derivatives are those of `equilibrium_tangent` and, with respect to symbols in loads,
    attitude and stiffness, of `parameter_slopes`: none goes through the chain by AD.
    """
    q = ca.MX.sym("q", beam.basis.n)
    inputs = {"q": q, **parameters}
    for field, symbol in beam.design_symbols.items():
        raise ValueError(f"{field}: expected numbers, found the symbol {symbol}")
    residual = equilibrium_residual(beam, q, loads, attitude)
    missing = free_symbols(residual, inputs.values())
    if missing:
        raise ValueError(f"parameters: expected every symbol, missing {', '.join(missing)}")
    _, slopes = equilibrium_tangent(beam, q, loads, attitude)
    if parameters:
        stacked = ca.veccat(*parameters.values())
        slopes = ca.horzcat(slopes, parameter_slopes(beam, q, loads, stacked, attitude)[0])
    return with_jacobian(name, inputs, {"residual": residual}, {"residual": slopes})


def _unstack(stacked: ca.MX, like: list[AnyExpr]) -> list[ca.MX]:
    offsets = np.cumsum([0, *(symbol.numel() for symbol in like)]).tolist()
    pieces = ca.vertsplit(stacked, offsets) if like else []
    return [ca.reshape(piece, *s.shape) for piece, s in zip(pieces, like, strict=True)]
