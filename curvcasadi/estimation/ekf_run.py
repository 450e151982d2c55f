"""A shape filter over time-stamped samples, in Python."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.estimation.ekf import Estimate, ShapeEkf
from curvcasadi.estimation.process import offsets
from curvcasadi.estimation.samples import is_rotation, sample_values
from curvcasadi.expressions import Array, expression, rotation_matrix
from curvcasadi.sensors import Channels


def run_ekf(
    ekf: ShapeEkf, start: Estimate, samples: Iterable[tuple[Any, ...]]
) -> Iterator[Estimate]:
    """Estimates at the times of `samples`, each after its update.

    Parameters
    ----------
    samples : (time, measured) or (time, measured, inputs): s; (m,) as in `ekf.channels`, NaN for
        what there is no sample of, and an attitude that is no rotation to 1e-2 is none either;
        and "rate" and the `root_inputs` by name. Times may repeat.

    Raises
    ------
    ValueError
        If a time is before the one that precedes it, or inputs or sizes are wrong.
    """
    at = start
    _check_start(ekf, start)
    for k, sample in enumerate(samples):
        where = f"samples[{k}]"
        if not isinstance(sample, (tuple, list)) or len(sample) not in (2, 3):
            raise ValueError(
                f"{where}: expected (time, measured) or (time, measured, inputs), found {sample!r}"
            )
        time, measured, *rest = sample
        if rest and not isinstance(rest[0], Mapping):
            raise ValueError(f"{where}.inputs: expected values by name, found {rest[0]!r}")
        inputs: dict[str, Any] = {**rest[0]} if rest else {}
        yield (at := _step(ekf, at, where, _time(where, time), measured, inputs))


def _time(where: str, value: Any) -> float:
    return float(expression(f"{where}.time", value, (1, 1)))


def _check_start(ekf: ShapeEkf, start: Estimate) -> None:
    sizes = (ekf.layout.size,), (ekf.error_layout.size,) * 2
    found = np.shape(start.state), np.shape(start.factor)
    if found != sizes:
        raise ValueError(
            f"start: expected an estimate of this filter, state {sizes[0]} and factor {sizes[1]}; "
            f"found {found[0]} and {found[1]}"
        )


def _step(
    ekf: ShapeEkf, at: Estimate, where: str, time: float, measured: Any, inputs: dict[str, Any]
) -> Estimate:
    if not time >= at.time:
        raise ValueError(
            f"{where}.time: expected at least {at.time:g} s, the time before; found {time:g} s"
        )
    values = sample_values(f"{where}.measured", measured)
    size = ekf.channels.layout.size
    if values.size != size:
        raise ValueError(f"{where}.measured: expected {size} values, found {values.size}")
    needed = {*ekf.predict.name_in()[3:], *ekf.update.name_in()[3:]}
    if set(inputs) != needed:
        raise ValueError(f"{where}.inputs: expected {sorted(needed)}, found {sorted(inputs)}")
    if "attitude" in inputs:
        rotation_matrix(f"{where}.inputs['attitude']", inputs["attitude"])
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
        given = values[where[part.name]]
        if part.size == residual.size:
            found.append(np.isnan(given))
        else:
            found.append(np.full(residual.size, not float(is_rotation(ca.DM(given)))))
    return np.concatenate(found)
