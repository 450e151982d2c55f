"""A moving-horizon estimator, its step and what it starts from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.beam.beam import Beam
from curvcasadi.estimation.belief import initial_belief
from curvcasadi.estimation.mhe.estimate import WindowEstimate
from curvcasadi.estimation.model_process import Dynamics
from curvcasadi.estimation.samples import numeric_array
from curvcasadi.estimation.words import mhe_words
from curvcasadi.sensors import Channels
from curvcasadi.symbolic.expressions import Number
from curvcasadi.symbolic.layout import Layout


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapeMhe:
    """A moving-horizon estimator whose step is one Function, for Python and for C.

    Attributes
    ----------
    step : casadi.Function
        One step, as `shape_mhe` describes it.
    layout : Layout
        Parts of the state.
    error_layout : Layout
        Parts of the error state, of which there is a covariance: an attitude is a rotation vector.
    node : Layout
        Parts of a column of the guess: the state, and what else is unknown at a sample; with a
        control model what drives it, in standard deviations.
    channels : Channels
        Rows of the measurements.
    beam : Beam or Aircraft
        Wing whose shape is estimated, or aircraft.
    dt : float
        Time between samples, s.
    window : int
        Number N of steps; a window holds N + 1 samples.
    inputs : mapping of str to Layout
        Of a control model: parts of the inputs "u" and of the known parameters "p".
    dynamics : Dynamics or None
        The model as a process, where there is one.
    """

    step: ca.Function
    layout: Layout
    error_layout: Layout
    node: Layout
    channels: Channels
    beam: Beam | Aircraft
    dt: float
    window: int
    inputs: Mapping[str, Layout] = field(default_factory=dict)
    dynamics: Dynamics | None = None

    @property
    def descriptions(self) -> Mapping[str, str]:
        """Words for inputs and outputs of the step, as `CFunction` takes them."""
        names = [*self.step.name_in(), *self.step.name_out()]
        return mhe_words(
            self.layout, self.error_layout, self.node, self.channels, names, self.inputs
        )

    def initial(
        self,
        deviation: Mapping[str, Number],
        mean: Mapping[str, Number] | None = None,
        *,
        time: float = 0.0,
    ) -> WindowEstimate:
        """What is known of the state at the first sample, before it.

        Parameters
        ----------
        deviation : mapping of str to float or array
            Standard deviation of every part of the error state, one number or one per entry; or a
            symmetric, positive definite covariance matrix of the part.
        mean : mapping of str to float or array, optional
            Parts of the state, weights within `Beam.weight_bounds`; zero, and the identity
            attitude, where not given. Parameters of a model that are estimated have their nominal
            values, and have to be given where it has none.
        time : float
            Time of the first sample, s.

        Returns
        -------
        WindowEstimate
            What `run_mhe` starts from.
        """
        state, factor = initial_belief(
            self.beam,
            self.layout,
            self.error_layout,
            deviation,
            mean,
            self.dynamics.parameters if self.dynamics else None,
        )
        column = np.zeros(self.node.size)
        if self.dynamics is None:
            column[: state.size] = state
        return WindowEstimate(
            time=numeric_array("time", time, (1, 1)).item(),
            state=state,
            states=state[:, None],
            arrival_mean=state,
            arrival_factor=factor,
            guess=np.tile(column[:, None], self.window + 1),
        )
