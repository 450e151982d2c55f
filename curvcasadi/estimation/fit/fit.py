"""The weights that explain one sample of sensors best, and how well they are known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.errors import ConvergenceError
from curvcasadi.estimation.fit.gauss_newton import Minimum, minimize
from curvcasadi.estimation.fit.losses import SCALES, Loss, LossName
from curvcasadi.estimation.fit.problem import FitProblem
from curvcasadi.estimation.fit.result import ShapeFit, fit_message
from curvcasadi.estimation.samples import numeric_array
from curvcasadi.estimation.sensor_model import (
    covariance_matrix,
    measured_values,
    sensor_model,
)
from curvcasadi.kinematics.weights import exceeded_limit
from curvcasadi.sensors import RootMotion, Sensor
from curvcasadi.solvers.active import active_bounds
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    choice,
    instance,
    numeric,
    positive,
)

#: Probability of the residual below which other starts are tried.
_SUSPECT = 1e-6


_FURTHER_STARTS = 8


_ALIKE = 3


def fit_shape(
    beam: Beam,
    sensors: Sequence[Sensor],
    measurements: Any,
    *,
    q_dot: AnyExpr | None = None,
    q_ddot: AnyExpr | None = None,
    root: RootMotion | None = None,
    prior: tuple[Number, Number] | None = None,
    loss: LossName = "squared",
    loss_scale: float | None = None,
    q_guess: AnyExpr | None = None,
    throw: bool = True,
) -> ShapeFit:
    """Weights of maximum likelihood from one sample of `sensors`.

        min_q  ½ Σ_i m_i ρ(u_i²) + ½ (q − μ)ᵀ P⁻¹ (q − μ),     u_i² = 1/m_i Σ (residual/noise)²

    over the sensors i with m_i readings each, within `Beam.weight_bounds`; the residual of an
    attitude is log(R_measuredᵀ R). Gauss–Newton with the structured derivatives, damped where a
    step disappoints; what the sensors do not see stays where it started. If χ² or the descent is
    suspect, up to eight further starts are tried, and the best fit is returned.

    Parameters
    ----------
    beam : Beam
        Wing with numeric fields.
    sensors : sequence of Sensor
        Sensors on the wing.
    measurements : array, shape (m,), or mapping of str to array
        Readings as `measure` stacks them, or values by name of the sensor. NaN, and names that are
        left out, are missing samples.
    q_dot : array, shape (n, 1), optional
        Known rates of the weights, rad/(m s); gyros and accelerometers need them.
    q_ddot : array, shape (n, 1), optional
        Known accelerations of the weights, rad/(m s²).
    root : RootMotion, optional
        Motion of the root, gravity and magnetic field, as for `measure`.
    prior : tuple, optional
        Mean μ (n,), rad/m, and P: one standard deviation, n of them, or a covariance (n, n).
    loss : {"squared", "huber", "cauchy"}
        "squared", ρ = u²; "huber", linear beyond `loss_scale`; "cauchy", logarithmic. A sensor then
        counts as in least squares reweighted by ρ'(u²) ≤ 1. The covariance takes these weights for
        given, so that it is approximate; `chi_squared` is not reweighted.
    loss_scale : float, optional
        Scale of the loss in standard deviations; 1.345 (huber) and 2.385 (cauchy) where None, which
        cost 5 % of the efficiency on Gaussian noise of one reading.
    q_guess : array, shape (n, 1), optional
        Weights to start from, rad/m, brought within the bounds; straight unless given.
    throw : bool
        Whether a fit that does not converge raises; otherwise the result says so.

    Returns
    -------
    ShapeFit
        Weights with their covariance, and what is not seen.

    Raises
    ------
    ConvergenceError
        If no start converges, or the best fit bends an element beyond `Grid.max_angle`; its
        `result` is the best fit.
    ValueError
        For arguments of the wrong shape, kind or range, if all samples are missing, and if a camera
        does not see its point where the fit starts.
    """
    choice("loss", loss, get_args(LossName))
    if loss == "squared" and loss_scale is not None:
        raise ValueError(
            f"loss_scale: expected None with loss 'squared', which has no scale; found {loss_scale}"
        )
    scale = SCALES[loss]
    if loss_scale is not None:
        scale = float(numeric("loss_scale", positive("loss_scale", loss_scale)))
    n = instance("beam", beam, Beam).basis.n
    rates = {"q_dot": q_dot, "q_ddot": q_ddot}
    given = {
        name: numeric_array(name, value, (n, 1)).ravel()
        for name, value in rates.items()
        if value is not None
    }
    model = sensor_model(beam, sensors, ("q", *given), ("q",), root)
    if q_dot is None and max(sensor.order for sensor in model.sensors):
        raise ValueError(
            f"q_dot: expected shape {(n, 1)} for gyros and accelerometers, found None; "
            "zeros are a wing at rest"
        )
    measured = measured_values(model, measurements)
    problem = FitProblem(beam, model, given, measured, _prior(prior, n), Loss(loss, scale))
    start = np.zeros(n) if problem.prior is None else problem.prior[0]
    if q_guess is not None:
        start = numeric_array("q_guess", q_guess, (n, 1)).ravel()
    problem.check_start(np.clip(start, *beam.bounds))
    best, iterations = _best(problem, start)
    result = _result(problem, best, iterations)
    if throw and not result.converged:
        raise ConvergenceError(result.message, result)
    return result


def _prior(prior: tuple[Number, Number] | None, n: int) -> tuple[Array, Array] | None:
    """Mean (n,) and the inverse (n, n) of the Cholesky factor of the covariance."""
    if prior is None:
        return None
    if not isinstance(prior, tuple) or len(prior) != 2:
        raise ValueError(f"prior: expected a pair (mean, covariance), found {prior!r}")
    from scipy.linalg import solve_triangular

    mean = numeric_array("prior mean", prior[0], (n, 1)).ravel()
    factor = np.linalg.cholesky(covariance_matrix("prior covariance", prior[1], n))
    return mean, np.asarray(solve_triangular(factor, np.eye(n), lower=True))


def _chance(squares: float, freedom: int) -> float:
    """Chance that a sum of `freedom` squares of standard normal numbers is at least `squares`."""
    from scipy.special import chdtrc

    return float(chdtrc(freedom, squares))


def _best(problem: FitProblem, start: Array) -> tuple[Minimum, int]:
    """The best of the fits from `start` and, where it is suspect, from random shapes.

    A suspect minimum that three starts have led to is taken for the best.
    """
    bounds, length = problem.beam.bounds, problem.length
    lower, upper = (np.clip(side, -1 / length, 1 / length) for side in bounds)
    random = np.random.default_rng(0)
    readings = problem.groups.size
    found = [minimize(problem.linearize, start, bounds, length)]
    while len(found) <= _FURTHER_STARTS:
        best = min(found, key=lambda m: (not m.converged, m.cost))
        alike = [m for m in found if m.converged and m.cost <= best.cost * (1 + 1e-6)]
        trusted = _chance(2 * best.cost, readings) > _SUSPECT
        if best.converged and (trusted or len(alike) >= _ALIKE):
            break
        found.append(minimize(problem.linearize, random.uniform(lower, upper), bounds, length))
    best = min(found, key=lambda m: (not m.converged, m.cost))
    return best, sum(m.iterations for m in found)


def _result(problem: FitProblem, best: Minimum, iterations: int) -> ShapeFit:
    beam, model, q = problem.beam, problem.model, best.q
    residual, slope = problem.residual(q)
    prior_residual, prior_slope = problem.prior_rows(q)
    _, sizes = problem.sizes(residual)
    weights = problem.loss.weight(sizes)
    weighted = np.sqrt(weights)[problem.groups][:, None] * slope
    information = weighted.T @ weighted
    seen = problem.observability(slope)
    known = problem.observability(np.vstack([slope, prior_slope]))

    labels = beam.basis.labels
    active = active_bounds(labels, q, beam.bounds, tolerance=1e-9, units=["rad/m"] * q.size)
    moved = np.linalg.matrix_rank(known.seen[[i not in active for i in range(q.size)]])
    squares = float(residual @ residual + prior_residual @ prior_residual)
    freedom = residual.size + prior_residual.size - int(moved)
    normalized = np.full(problem.present.size, np.nan)
    normalized[problem.present] = residual
    there = np.isin(np.arange(len(weights)), problem.groups)
    names = [part.name for part in model.channels.layout.parts]

    too_bent = exceeded_limit(beam, q)
    p_value = _chance(squares, freedom) if freedom else float("nan")
    loss_weights = dict(zip(names, np.where(there, weights, np.nan).tolist(), strict=True))
    message = fit_message(
        converged=best.converged,
        too_bent=too_bent,
        chi_test=(squares, freedom, p_value),
        loss=problem.loss.name,
        loss_weights=loss_weights,
        active_bounds=active.values(),
        seen=seen,
        prior=problem.prior is not None,
    )
    return ShapeFit(
        q=ca.DM(q),
        beam=beam,
        covariance=known.covariance(information + prior_slope.T @ prior_slope),
        information=information,
        rank=seen.rank,
        unseen=seen.words,
        channels=model.channels,
        residuals=normalized * model.channels.noise,
        normalized_residuals=normalized,
        chi_squared=squares,
        degrees_of_freedom=freedom,
        p_value=p_value,
        loss_weights=loss_weights,
        active_bounds=tuple(active.values()),
        converged=best.converged and not too_bent,
        iterations=iterations,
        message=message,
    )
