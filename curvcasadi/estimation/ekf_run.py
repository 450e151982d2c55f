"""A shape filter over time-stamped samples, in Python."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from curvcasadi.estimation.ekf import Estimate, ShapeEkf
from curvcasadi.estimation.process import offsets
from curvcasadi.expressions import Array, expression
from curvcasadi.sensors import Channels


def run_ekf(
    ekf: ShapeEkf, start: Estimate, samples: Iterable[tuple[Any, ...]]
) -> Iterator[Estimate]:
    """Estimates at the times of `samples`, each after its update.

    Parameters
    ----------
    samples : (time, measured) or (time, measured, inputs): s; (m,) as in `ekf.channels`, NaN for
        what there is no sample of; and "rate" and the `root_inputs` by name. Times may repeat.

    Raises
    ------
    ValueError
        If a time is before the one that precedes it, or inputs or sizes are wrong.
    """
    at = start
    for k, (time, measured, *rest) in enumerate(samples):
        inputs: dict[str, Any] = {**rest[0]} if rest else {}
        yield (at := _step(ekf, at, f"samples[{k}]", float(time), measured, inputs))


def _step(
    ekf: ShapeEkf, at: Estimate, where: str, time: float, measured: Any, inputs: dict[str, Any]
) -> Estimate:
    if not time >= at.time:
        raise ValueError(
            f"{where}.time: expected at least {at.time:g} s, the time before; found {time:g} s"
        )
    values = np.asarray(measured, dtype=float).ravel()
    size = ekf.channels.layout.size
    if values.size != size:
        raise ValueError(f"{where}.measured: expected {size} values, found {values.size}")
    if np.any(np.isinf(values)):
        raise ValueError(f"{where}.measured: expected finite values or NaN, found infinite ones")
    needed = {*ekf.predict.name_in()[3:], *ekf.update.name_in()[3:]}
    if set(inputs) != needed:
        raise ValueError(f"{where}.inputs: expected {sorted(needed)}, found {sorted(inputs)}")
    rates, motion = (
        {
            key: expression(f"{where}.inputs[{key!r}]", inputs[key], f.size_in(key))
            for key in f.name_in()[3:]
        }
        for f in (ekf.predict, ekf.update)
    )
    ahead = ekf.predict(state=at.state, factor=at.factor, dt=time - at.time, **rates)
    found = ekf.update(
        state=ahead["state_after"],
        factor=ahead["factor_after"],
        measured=values,
        **motion,
    )
    innovation = found["innovation"].full()[:, 0]
    innovation[_missing(ekf.channels, values)] = np.nan
    return Estimate(
        time,
        found["state_after"].full()[:, 0],
        found["factor_after"].full(),
        innovation,
        found["used"].full()[:, 0],
        float(found["nis"]),
        int(found["dof"]),
    )


def _missing(channels: Channels, values: Array) -> Array:
    """Which residuals (r,) there is no sample of: of an attitude all three or none."""
    parts = zip(channels.layout.parts, channels.residual_layout.parts, strict=True)
    where, found = offsets(channels.layout), []
    for part, residual in parts:
        lost = np.isnan(values[where[part.name]])
        found.append(lost if part.size == residual.size else np.full(residual.size, lost.any()))
    return np.concatenate(found)
