"""A moving-horizon estimator over samples, one every step, in Python."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.estimation.belief import check_start
from curvcasadi.estimation.mhe.estimate import WindowEstimate
from curvcasadi.estimation.mhe.estimator import ShapeMhe
from curvcasadi.estimation.samples import (
    input_values,
    missing_residuals,
    sample_values,
    sequence,
)
from curvcasadi.symbolic.expressions import Array, instance


def run_mhe(
    mhe: ShapeMhe, start: WindowEstimate, samples: Iterable[Any]
) -> Iterator[WindowEstimate]:
    """Estimates at the first sample and every `dt` after it, in constant memory.

    Parameters
    ----------
    mhe : ShapeMhe
        The estimator.
    start : WindowEstimate
        The result of `ShapeMhe.initial`, at the time of the first sample.
    samples : iterable
        Readings (m,), NaN where missing, or pairs of these and, by name, the root inputs and of a
        control model "u" and "p"; one every `dt`. An attitude that is no rotation is missing, as
        for `ShapeEkf`. Where samples lead to what cannot be computed the estimate stays as it was,
        not `solved`.

    Returns
    -------
    iterator of WindowEstimate
        One per sample.

    Raises
    ------
    ValueError
        If the start, samples or root inputs are not finite numbers of the sizes that the estimator
        has, the start's factor is not that of a covariance, or, with a control model, `dt` is
        beyond the stability of its steps at the start.
    """
    size, error = instance("mhe", mhe, ShapeMhe).layout.size, mhe.error_layout.size
    check_start(
        start,
        WindowEstimate,
        "estimator",
        {
            "time": (),
            "arrival_mean": (size,),
            "arrival_factor": (error, error),
            "guess": (mhe.node.size, mhe.window + 1),
        },
        "arrival_factor",
    )
    at = start
    nodes = mhe.window + 1
    columns: deque[Array] = deque(maxlen=nodes)
    motions: deque[dict[str, Array]] = deque(maxlen=nodes)
    shapes = {key: _at_a_sample(mhe, key) for key in mhe.step.name_in()[4:]}
    for k, sample in enumerate(sequence("samples", samples)):
        where = f"samples[{k}]"
        if isinstance(sample, tuple) and len(sample) != 2:
            raise ValueError(f"{where}: expected measured or (measured, inputs), found {sample!r}")
        measured, inputs = sample if isinstance(sample, tuple) else (sample, {})
        columns.append(sample_values(f"{where}.measured", measured, mhe.channels.layout.size))
        motions.append(input_values(f"{where}.inputs", inputs, shapes))
        if mhe.dynamics is not None and k == 0:
            own = {key: motions[0][key] for key in mhe.inputs}
            wrong = mhe.dynamics.unstable_step(mhe.dt, at.arrival_mean, own)
            if wrong:
                raise ValueError(f"{where}: {wrong}")
        at = _estimate(mhe, at, start.time + k * mhe.dt, columns, motions)
        yield at


def _at_a_sample(mhe: ShapeMhe, name: str) -> tuple[int, int]:
    """Shape of an input that comes with every sample."""
    rows, columns = mhe.step.size_in(name)
    return rows, columns // (mhe.window + 1)


def _estimate(
    mhe: ShapeMhe,
    at: WindowEstimate,
    time: float,
    columns: deque[Array],
    motions: deque[dict[str, Array]],
) -> WindowEstimate:
    newest, ahead = len(columns) - 1, mhe.window + 1 - len(columns)
    missing = [np.full_like(columns[0], np.nan)] * ahead
    used = (~missing_residuals(mhe.channels, columns[-1])).astype(float)
    found = _step(
        mhe,
        arrival_mean=at.arrival_mean,
        arrival_factor=at.arrival_factor,
        measured=np.column_stack([*columns, *missing]),
        guess=at.guess,
        **{
            key: np.hstack([motion[key] for motion in [*motions, *[motions[-1]] * ahead]])
            for key in motions[-1]
        },
    )
    if found is None:  # as in C, all stays as it is
        return at._replace(time=time, violation=np.inf, stationarity=np.inf, used=used)
    states = found["states"].full()[:, : newest + 1]
    estimate = WindowEstimate(
        time=time,
        state=states[:, -1],
        states=states,
        arrival_mean=found["arrival_mean_after"].full().ravel(),
        arrival_factor=found["arrival_factor_after"].full(),
        guess=found["guess_after"].full(),
        violation=float(found["violation"]),
        stationarity=float(found["stationarity"]),
        used=used,
    )
    if ahead == 0:
        return estimate
    if mhe.dynamics is None:
        first = np.concatenate([states[:, 0], at.guess[mhe.layout.size :, 0]])
        guess = np.column_stack([first, estimate.guess[:, :-1]])
    else:
        guess = found["noise"].full()
    return estimate._replace(
        arrival_mean=at.arrival_mean, arrival_factor=at.arrival_factor, guess=guess
    )


def _step(mhe: ShapeMhe, **inputs: Array) -> dict[str, ca.DM] | None:
    """Outputs of the step by name; None where it leads to what cannot be computed."""
    try:
        found: dict[str, ca.DM] = mhe.step(**inputs)
    except RuntimeError:
        return None
    return found if all(value.is_regular() for value in found.values()) else None
