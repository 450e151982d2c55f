"""What inputs and outputs of estimators mean, in words for generated C."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from curvcasadi.sensors import Channels
from curvcasadi.symbolic.layout import Layout

_FACTOR = (
    "covariance U D U': U above a unit diagonal, D on it; nonzeros of the upper triangle by columns"
)
_ROOT = {
    "attitude": "parent to inertial axes, by columns",
    "position": "of the parent, m, inertial axes",
    "twist": "of the root, rad/s and m/s, root axes, the parent's motion included",
    "twist_rate": "time derivative of the components of twist, rad/s2 and m/s2, root axes",
}


def ekf_words(
    state: Layout,
    error: Layout,
    channels: Channels,
    names: Iterable[str],
    given: Mapping[str, Layout] | None = None,
) -> Mapping[str, str]:
    """Words for `names` of inputs and outputs of a filter's Functions.

    `given` are inputs and known parameters of its model, by name of the argument.
    """
    at = _parts(state)
    factor = f"{_FACTOR}; rows: {_parts(error)}"
    rows = ", ".join(channels.residual_labels)
    words = {
        "state": at,
        "state_after": at,
        "factor": factor,
        "factor_after": factor,
        "dt": "time since the state, s, not below zero",
        "rate": "reading of the gyro at the root, rad/s, root axes",
        "measured": _measured(channels),
        "innovation": f"over its standard deviation, 0 where missing or not in view; rows: {rows}",
        "used": f"1 for samples that were used, else 0; rows: {rows}",
        "nis": "normalized innovation squared of the used samples",
        "dof": "number of used samples",
        **_ROOT,
        **{key: _parts(layout) for key, layout in (given or {}).items()},
    }
    return {name: words[name] for name in names}


def mhe_words(
    state: Layout,
    error: Layout,
    node: Layout,
    channels: Channels,
    names: Iterable[str],
    given: Mapping[str, Layout],
) -> Mapping[str, str]:
    """Words for `names` of inputs and outputs of the step of a moving-horizon estimator.

    `given` are inputs and known parameters of its model, by name of the argument.
    """
    at, factor = _parts(state), f"of arrival_mean: {_FACTOR}; rows: {_parts(error)}"
    guess = f"one column a sample; rows: {_parts(node)}"
    words = {
        "arrival_mean": f"state at the first sample, from those before it: {at}",
        "arrival_factor": factor,
        "arrival_mean_after": "arrival_mean of the next window",
        "arrival_factor_after": "arrival_factor of the next window",
        "measured": f"one column a sample; rows: {_measured(channels)}",
        "guess": guess,
        "guess_after": "guess of the next window",
        "noise": "what drives the window, in standard deviations: guess of the same window",
        "state": f"at the newest sample: {at}",
        "states": f"one column a sample; rows: {at}",
        "violation": "largest excess over a bound, over its tolerance; kept where at most 1",
        "stationarity": "bound of the distance to the optimum over its tolerance; solved to 1",
        **{name: f"{text}; one sample beside the other" for name, text in _ROOT.items()},
        **{key: f"one column a sample; rows: {_parts(layout)}" for key, layout in given.items()},
    }
    return {name: words[name] for name in names}


def _parts(layout: Layout) -> str:
    return ", ".join(f"{part.name} ({part.size}) {part.unit}" for part in layout.parts)


def _measured(channels: Channels) -> str:
    return ", ".join(
        f"{label} {unit}" for label, unit in zip(channels.labels, channels.units, strict=True)
    )
