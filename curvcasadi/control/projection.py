"""The state of a model of a wing from that of a finer one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from curvcasadi.control.model import ControlModel
from curvcasadi.control.signals import stacked
from curvcasadi.control.spans import Span
from curvcasadi.symbolic.expressions import Array, Number, instance


def project_state(
    plant: ControlModel, x: Number | Mapping[str, Number], model: ControlModel
) -> Array:
    """The state of `model` that is nearest to the state `x` of `plant`.

    Weights are those of the curvature, its rate, and the states of the air along the span that
    differ least from the plant's in the mean square; what the model's functions can represent is
    kept exactly. A state of the air follows a pole: where the model has other poles, states are
    interpolated in the logarithm of their rates, and those of the nearest pole beyond the ends.
    Every other part is the plant's of the same name.

    Parameters
    ----------
    plant : ControlModel
        A model of the same wing or aircraft, such as one with more weights.
    x : array, shape (nx,), or mapping of str to array
        State of the plant.
    model : ControlModel
        The coarser model.

    Returns
    -------
    array, shape (nx of the model,)
        State of the model.

    Raises
    ------
    ValueError
        If the plant lacks a part of the model's state, or has one of another kind.
    """
    instance("plant", plant, ControlModel)
    instance("model", model, ControlModel)
    if x is None:
        raise ValueError(f"x: expected the state of {plant.name!r}, found None")
    state = stacked("x", plant.x, x)
    known = {part.name: state[plant.x.slices[part.name]] for part in plant.x.parts}
    pieces = []
    for part in model.x.parts:
        if part.name not in known:
            raise ValueError(
                f"model: expected parts of the plant's state, {', '.join(known)}, found "
                f"{part.name!r}"
            )
        coarse, fine = model.spans.get(part.name, ()), plant.spans.get(part.name, ())
        if coarse and fine:
            pieces += _projected(part.name, fine, known[part.name], coarse)
        elif len(known[part.name]) == part.size:
            pieces.append(known[part.name])
        else:
            raise ValueError(
                f"model: expected {len(known[part.name])} entries of {part.name!r}, as the plant "
                f"has, or functions along the span, found {part.size}"
            )
    return np.concatenate(pieces)


def _projected(
    name: str, fine: Sequence[Span], weights: Array, coarse: Sequence[Span]
) -> list[Array]:
    """Weights of each of the coarse functions."""
    ends = np.cumsum([0, *(span.size for span in fine)])
    pieces = {id(span): weights[a:b] for span, a, b in zip(fine, ends[:-1], ends[1:], strict=True)}
    found = []
    for span in coarse:
        alike = [other for other in fine if other.quantity == span.quantity]
        if not alike:
            raise ValueError(f"plant: expected the {span.quantity} in {name!r}, found none")
        by_pole = [_nearest(other, pieces[id(other)], span) for other in alike]
        if span.rate is None:
            found.append(by_pole[0])
        else:
            found.append(_between([other.rate or 0.0 for other in alike], by_pole, span.rate))
    return found


def _nearest(fine: Span, weights: Array, coarse: Span) -> Array:
    """Weights of the coarse functions by least squares."""
    xi, measures = coarse.points if coarse.is_pointwise else fine.points
    functions, values = coarse.at(xi), fine.at(xi) @ weights
    root = np.sqrt(np.repeat(measures, len(values) // len(xi)))
    return np.asarray(np.linalg.lstsq(root[:, None] * functions, root * values, rcond=None)[0])


def _between(rates: Sequence[float], weights: Sequence[Array], rate: float) -> Array:
    """Linear between poles in the logarithm of their rates."""
    order = np.argsort(rates)
    logarithms = np.log(np.asarray(rates)[order])
    columns = np.array(weights)[order].T
    return np.array([np.interp(np.log(rate), logarithms, column) for column in columns])
