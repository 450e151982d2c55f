"""A shape filter over time-stamped samples, in Python."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from curvcasadi.control.stability import SLACK
from curvcasadi.errors import ConvergenceError
from curvcasadi.estimation.belief import check_start
from curvcasadi.estimation.ekf.filter import Estimate, ShapeEkf
from curvcasadi.estimation.samples import (
    input_values,
    missing_residuals,
    numeric_array,
    sample_values,
    sequence,
)
from curvcasadi.symbolic.expressions import instance


def run_ekf(
    ekf: ShapeEkf, start: Estimate, samples: Iterable[tuple[Any, ...]]
) -> Iterator[Estimate]:
    """Estimates at the times of `samples`, each after its update.

    Parameters
    ----------
    ekf : ShapeEkf
        The filter.
    start : Estimate
        The result of `ShapeEkf.initial`, or an estimate to go on from.
    samples : iterable of tuple
        Tuples (time, measured) or (time, measured, inputs): the time, s; readings (m,) as in
        `ekf.channels`, NaN where there is no sample; and by name "rate", the `root_inputs`, and
        of a filter on a control model "u" and "p", arrays, where the model has them.
        Times may repeat.

    Returns
    -------
    iterator of Estimate
        One per sample.

    Raises
    ------
    ValueError
        If a time is before the one that precedes it, if the start, samples or inputs are not
        finite numbers of the sizes that the filter has, or the start's factor is not that of a
        covariance; with a control model, if steps between samples are so long that Runge–Kutta's
        method is unstable.
    ConvergenceError
        If a prediction is not finite, or its implicit steps do not converge; `.result` is the
        estimate before it.
    """
    instance("ekf", ekf, ShapeEkf)
    check_start(
        start,
        Estimate,
        "filter",
        {
            "time": (),
            "state": (ekf.layout.size,),
            "factor": (ekf.error_layout.size, ekf.error_layout.size),
        },
        "factor",
    )
    at, longest = start, 0.0
    for k, sample in enumerate(sequence("samples", samples)):
        where = f"samples[{k}]"
        if not isinstance(sample, (tuple, list)) or len(sample) not in (2, 3):
            raise ValueError(
                f"{where}: expected (time, measured) or (time, measured, inputs), found {sample!r}"
            )
        time, measured, *rest = sample
        inputs = rest[0] if rest else {}
        before = at.time
        at = _step(ekf, at, where, time, measured, inputs, longest)
        longest = max(longest, at.time - before)
        yield at


def _step(
    ekf: ShapeEkf,
    at: Estimate,
    where: str,
    stamp: Any,
    measured: Any,
    given: Any,
    longest: float,
) -> Estimate:
    """The estimate at a sample; `longest` is the longest time between samples before."""
    time = float(numeric_array(f"{where}.time", stamp, (1, 1)).item())
    if not time >= at.time:
        raise ValueError(
            f"{where}.time: expected at least {at.time:g} s, the time before; found {time:g} s"
        )
    values = sample_values(f"{where}.measured", measured, ekf.channels.layout.size)
    shapes = {key: f.size_in(key) for f in (ekf.predict, ekf.update) for key in f.name_in()[3:]}
    inputs = input_values(f"{where}.inputs", given, shapes)
    rates, motion = (
        {key: inputs[key] for key in f.name_in()[3:]} for f in (ekf.predict, ekf.update)
    )
    dt = time - at.time
    if ekf.dynamics is not None and dt > longest * (1 + SLACK):
        wrong = ekf.dynamics.unstable_step(dt, at.state, rates)
        if wrong:
            raise ValueError(f"{where}.time: {dt:g} s after the one before, {wrong}")
    ahead = ekf.predict(state=at.state, factor=at.factor, dt=dt, **rates)
    if not all(value.is_regular() for value in ahead.values()):
        raise ConvergenceError(
            f"{where}: the prediction over {dt:g} s is not finite or did not converge; take "
            "samples that are closer, or more substeps of the ModelProcess",
            at,
        )
    found = ekf.update(
        state=ahead["state_after"],
        factor=ahead["factor_after"],
        measured=values,
        **motion,
    )
    innovation, used = (found[key].full()[:, 0] for key in ("innovation", "used"))
    innovation[missing_residuals(ekf.channels, values)] = np.nan
    for rows in ekf.channels.residual_layout.slices.values():
        if not np.any(used[rows]) and not np.any(innovation[rows]):
            innovation[rows] = np.nan  # out of a camera's view: a gated one has an innovation
    return Estimate(
        time,
        found["state_after"].full()[:, 0],
        found["factor_after"].full(),
        innovation,
        used,
        float(found["nis"]),
        int(found["dof"]),
    )
