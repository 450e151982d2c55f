"""Extended Kalman filters of the shape of a wing, from sensors on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.beam.beam import Beam
from curvcasadi.estimation import ud
from curvcasadi.estimation.belief import initial_belief
from curvcasadi.estimation.model_process import Dynamics
from curvcasadi.estimation.samples import numeric_array
from curvcasadi.estimation.words import ekf_words
from curvcasadi.sensors import Channels
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    choice,
)
from curvcasadi.symbolic.layout import Layout
from curvcasadi.symbolic.text import described, shown


class Estimate(NamedTuple):
    """State of a filter at a time. What an update says of its samples is empty before the first.

    Attributes
    ----------
    time : float
        Time, s.
    state : array, shape (x,)
        State, parts as in `ShapeEkf.layout`.
    factor : array, shape (N, N)
        Covariance U D Uᵀ, upper triangular with D on the diagonal.
    innovation : array, shape (r,)
        Innovations over their standard deviations; NaN where there is no sample, or no prediction
        of it.
    used : array, shape (r,)
        1 for samples that were used, 0 for missing and gated ones.
    nis : float
        Normalized innovation squared of the used samples.
    dof : int
        Number of used samples, the expectation of `nis`.
    """

    time: float
    state: Array
    factor: Array
    innovation: Array = np.zeros(0)
    used: Array = np.zeros(0)
    nis: float = 0.0
    dof: int = 0

    def __repr__(self) -> str:
        return f"<Estimate at {self.time:g} s: {int(np.sum(self.used))} readings used>"

    def __str__(self) -> str:
        rows = {
            "state": shown(self.state),
            "deviations": f"{shown(np.sqrt(np.diag(self.covariance)))}, of the error state",
            "used": f"{int(np.sum(self.used))} of {self.used.size} readings",
            "NIS": f"{self.nis:.4g}, expected {self.dof}",
        }
        return described(f"Estimate at {self.time:g} s", rows)

    @property
    def covariance(self) -> Array:
        """Covariance of the error state, parts as in `ShapeEkf.error_layout`."""
        return ud.covariance_of(self.factor)


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapeEkf:
    """An extended Kalman filter as two Functions, for Python and for C.

    predict: (state, factor, dt and, with an attitude, rate) -> state_after, factor_after.

    update: (state, factor, measured and the inputs asked for) -> state_after, factor_after,
    innovation (r, 1), over its standard deviation, used (r, 1), nis, dof. A sample that is NaN is
    missing. So is an attitude whose columns c1, c2, c3 are no rotation to 1e-2, by the Euclidean
    norm of (c1·c1 − 1, c2·c2 − 1, c1·c2, c1 × c2 − c3); and the bearing of a point that is
    predicted out of the camera's view. Of these the output `innovation` is 0, and
    `Estimate.innovation` of `run_ekf` NaN; of a gated sample both are its innovation.

    After a negative dt the factor is NaN: in Python, and in C before its wrapper refuses it. The
    wrapper refuses infinite samples, too; any finite one is used, gated or missing.

    Attributes
    ----------
    predict : casadi.Function
        Prediction, called <name>_predict.
    update : casadi.Function
        Update, called <name>_update.
    layout : Layout
        Parts of the state.
    error_layout : Layout
        Parts of the error state: that of the attitude is a rotation vector, parent axes.
    channels : Channels
        Rows of the measurements, and of their residuals.
    beam : Beam or Aircraft
        Wing whose shape is estimated, or aircraft.
    inputs : mapping of str to Layout
        Of a control model: parts of the inputs "u" and of the known parameters "p", which both
        Functions take.
    dynamics : Dynamics or None
        The model as a process, where there is one.
    """

    predict: ca.Function
    update: ca.Function
    layout: Layout
    error_layout: Layout
    channels: Channels
    beam: Beam | Aircraft
    inputs: Mapping[str, Layout] = field(default_factory=dict)
    dynamics: Dynamics | None = None

    def initial(
        self,
        deviation: Mapping[str, Number],
        mean: Mapping[str, Number] | None = None,
        *,
        time: float = 0.0,
    ) -> Estimate:
        """An estimate to start from.

        Parameters
        ----------
        deviation : mapping of str to float or array
            Standard deviation of every part of the error state, one number or one per entry; or a
            symmetric, positive definite covariance matrix of the part.
        mean : mapping of str to float or array, optional
            Parts of the state; zero, and the identity attitude, where not given. The attitude is a
            rotation matrix (3, 3). Weights lie within `Beam.weight_bounds`. Parameters of a model
            that are estimated have their nominal values, and have to be given where it has none.
        time : float
            Time, s.

        Returns
        -------
        Estimate
            Mean and covariance at that time.
        """
        state, factor = initial_belief(
            self.beam,
            self.layout,
            self.error_layout,
            deviation,
            mean,
            self.dynamics.parameters if self.dynamics else None,
        )
        return Estimate(numeric_array("time", time, (1, 1)).item(), state, factor)

    @property
    def descriptions(self) -> Mapping[str, Mapping[str, str]]:
        """Of "predict" and of "update", words for inputs and outputs, as `CFunction` takes them."""
        return {
            key: ekf_words(
                self.layout,
                self.error_layout,
                self.channels,
                [*f.name_in(), *f.name_out()],
                self.inputs,
            )
            for key, f in (("predict", self.predict), ("update", self.update))
        }

    def part(self, estimate: Estimate, name: str) -> Array:
        """A part of the state of an estimate.

        Parameters
        ----------
        estimate : Estimate
            Estimate of this filter.
        name : str
            Name of a part of `layout`.

        Returns
        -------
        ndarray, shape (size,)
            The part.
        """
        where = self.layout.slices
        choice("name", name, list(where))
        return estimate.state[where[name]]

    def covariance(self, estimate: Estimate, name: str) -> Array:
        """Covariance of a part of the error state of an estimate.

        That of "q" makes standard deviations along the span by `shape_deviations`.

        Parameters
        ----------
        estimate : Estimate
            Estimate of this filter.
        name : str
            Name of a part of `error_layout`.

        Returns
        -------
        ndarray, shape (size, size)
            Covariance of the part.
        """
        where = self.error_layout.slices
        choice("name", name, list(where))
        return estimate.covariance[where[name], where[name]]
