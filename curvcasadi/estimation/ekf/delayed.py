"""A filter on a control model whose samples arrive late: what it knows of the present."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from curvcasadi.control.signals import stacked, with_nominal
from curvcasadi.estimation.ekf.filter import Estimate, ShapeEkf
from curvcasadi.estimation.samples import numbers_or_nan
from curvcasadi.symbolic.compiled import compile_function
from curvcasadi.symbolic.expressions import Array, Number, count, instance, numbers, positive
from curvcasadi.symbolic.layout import Layout


class DelayedFilter:
    """An extended Kalman filter for each lane, of samples that are late by whole intervals.

    A sample that arrives is that of `delay` intervals ago. The filter stands at its time: it
    predicts and updates there, with the inputs that were applied then. `present` predicts from
    there to now with the inputs since.

    Parameters
    ----------
    ekf : ShapeEkf
        A filter on a control model, of `shape_ekf`.
    start : Estimate
        What every lane starts from, an interval before the first sample: the result of
        `ShapeEkf.initial`.
    dt : float
        Interval of the samples, s.
    delay : int
        Age of the samples that arrive, in intervals.
    lanes : int
        How many wings there are.
    p : array, shape (np,) or (lanes, np), or mapping of str to number, optional
        Parameters of the model that are known, such as airspeed and pitch, in their order or by
        name. Those that the model has a nominal value of may be left out by name.
    compiled : bool
        Whether the filter becomes native code, which takes a while and pays off in long runs.

    Raises
    ------
    ValueError
        If an argument is not of that kind, or `dt` is beyond the stability of the filter's steps.
    """

    def __init__(
        self,
        ekf: ShapeEkf,
        start: Estimate,
        *,
        dt: float,
        delay: int = 0,
        lanes: int = 1,
        p: ArrayLike | Mapping[str, Number] | None = None,
        compiled: bool = True,
    ) -> None:
        instance("ekf", ekf, ShapeEkf)
        instance("start", start, Estimate)
        if ekf.dynamics is None:
            raise ValueError(
                "ekf: expected a filter on a control model, shape_ekf(..., process=model)"
            )
        self._dt, lanes = float(positive("dt", dt)), count("lanes", lanes)
        if wrong := ekf.dynamics.unstable_at_rest(self._dt):
            raise ValueError(f"dt: {wrong}")
        self._nu = ekf.inputs["u"].size if "u" in ekf.inputs else 0
        self._p = _known(ekf.inputs.get("p", Layout(())), p, lanes).T
        self._predict, self._update = (
            (compile_function(f, derivatives=0) if compiled else f).map(lanes)
            for f in (ekf.predict, ekf.update)
        )
        self._state = ca.repmat(start.state, 1, lanes)
        self._factor = ca.repmat(start.factor, 1, lanes)
        self._has_begun = False
        self._applied: deque[Array] = deque(maxlen=count("delay", delay, 0) + 1)

    def take(self, samples: ArrayLike | None, u: ArrayLike) -> None:
        """Go on by an interval, with the samples that arrive.

        Parameters
        ----------
        samples : array, shape (lanes, m), or None
            Readings of `delay` intervals ago, NaN where there is none. None before the first, for
            which time does not go on; later it means that all are lost.
        u : array, shape (lanes, nu)
            Inputs that are applied at present, and since the interval before.

        Raises
        ------
        ValueError
            If an argument has another shape, or is infinite, or an input NaN. Nothing has changed
            then.
        """
        lanes, rows = self._state.shape[1], self._update.size1_in("measured")
        applied = _shaped("u", numbers("u", u), (lanes, self._nu))
        if samples is None:
            measured = np.full((lanes, rows), np.nan)
        else:
            measured = _shaped("samples", numbers_or_nan("samples", samples), (lanes, rows))
        self._applied.append(applied)
        if samples is None and not self._has_begun:
            return
        self._has_begun = True
        inputs = self._inputs(self._applied[0])
        belief = self._predict(self._state, self._factor, self._dt, *inputs)
        self._state, self._factor, *_ = self._update(*belief, measured.T, *inputs)

    def present(self) -> Array:
        """State of the filter at present.

        Returns
        -------
        array, shape (lanes, nz)
            Parts as in `ShapeEkf.layout`.
        """
        state, factor = self._state, self._factor
        for u in list(self._applied)[1:]:
            state, factor = self._predict(state, factor, self._dt, *self._inputs(u))
        return np.array(state).T

    def _inputs(self, u: Array) -> list[Array]:
        return [values for values in (u.T, self._p) if values.size]


def _shaped(name: str, values: Array, shape: tuple[int, int]) -> Array:
    if values.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, found {values.shape}")
    return values


def _known(layout: Layout, p: ArrayLike | Mapping[str, Number] | None, lanes: int) -> Array:
    """Known parameters (lanes, np) of every lane."""
    given = with_nominal("p", layout, p)
    by_name = isinstance(given, Mapping)
    values = stacked("p", layout, given) if by_name else np.atleast_1d(numbers("p", given))
    if values.shape not in ((layout.size,), (lanes, layout.size)):
        raise ValueError(
            f"p: expected shape ({layout.size},) or ({lanes}, {layout.size}), found {values.shape}"
        )
    return np.broadcast_to(values, (lanes, layout.size))
