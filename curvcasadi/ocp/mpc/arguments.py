"""Arguments of a predictive controller, checked against the names of its model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

import numpy as np

from curvcasadi.control.model import ControlModel
from curvcasadi.control.signals import stacked, two_sides
from curvcasadi.control.step import Method
from curvcasadi.ocp.mpc.terms import (
    ANGLES,
    WIDE,
    Limit,
    Penalty,
    Source,
    angle_function,
    is_rotation,
    sizes,
)
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    choice,
    count,
    instance,
    numbers,
    positive,
)
from curvcasadi.symbolic.layout import Layout, Part

#: Half a range from which on it tells nothing of the size of an input.
_UNBOUNDED = 1e10


def all_penalties(
    model: ControlModel, outputs: Any, states: Any, inputs: Any
) -> tuple[Penalty, ...]:
    """Penalties of outputs, states and inputs by different names, not of inputs alone."""
    found = (
        *penalties("outputs", "y", model.y, outputs),
        *penalties("states", "x", model.x, states),
    )
    names = [penalty.part.name for penalty in found]
    if len(set(names)) < len(names):
        raise ValueError(f"states: expected other names than those of outputs, found {names}")
    if not found:
        raise ValueError(
            "outputs: expected a weight above zero of an output "
            f"({', '.join(part.name for part in model.y.parts)}), found none"
        )
    return (*found, *penalties("inputs", "u", model.u, inputs))


def penalties(name: str, source: Source, layout: Layout, given: Any) -> tuple[Penalty, ...]:
    """Penalties of weights by the names of parts of a layout."""
    found = []
    for key, value in _by_name(name, layout, given).items():
        part = _part(layout, key)
        size = 3 if part.attitude else part.size
        size = part.size // 3 if source == "y" and is_rotation(part) else size
        weights = numbers(f"{name}[{key!r}]", value).ravel()
        if weights.size not in (1, size):
            raise ValueError(
                f"{name}[{key!r}]: expected one weight or {size}, found {weights.size}"
            )
        if not np.all(weights >= 0):
            raise ValueError(
                f"{name}[{key!r}]: expected weights of at least zero, found {weights.tolist()}"
            )
        weights = np.full(size, weights[0]) if weights.size == 1 else weights
        if np.any(weights > 0):
            found.append(Penalty(part=part, source=source, weights=weights))
    return tuple(found)


def input_weights(name: str, layout: Layout, given: Any) -> Array:
    """Weights (nu,) of inputs by name; zero for those without."""
    found = np.zeros(layout.size)
    for penalty in penalties(name, "u", layout, given):
        found[layout.slices[penalty.part.name]] = penalty.weights
    return found


def limits(model: ControlModel, bounds: Any, rates: Any, soft: Any) -> tuple[Limit, ...]:
    """Limits of outputs, states and angles, those of the model's state among them; not of inputs.

    A bound of a part of the state replaces that of the model.
    """
    known: dict[str, tuple[Source, Layout]] = {
        **{part.name: ("x", model.x) for part in model.x.parts},
        **{part.name: ("y", model.y) for part in model.y.parts},
    }
    inputs = {part.name for part in model.u.parts}
    names = [*known, *sorted(inputs), *([ANGLES] if angle_function(model) else [])]
    given = {
        part.name: (part.lower, part.upper)
        for part in model.x.parts
        if np.any(np.isfinite(part.lower)) or np.any(np.isfinite(part.upper))
    }
    given |= {ANGLES: (-np.inf, 1.0)} if model.angles else {}
    for key in _mapping("bounds", bounds):
        _one_of("bounds", key, names)
        owners = [layout for layout in (model.x, model.y, model.u) if key in layout.slices]
        if len(owners) > 1:
            raise ValueError(
                f"bounds: expected a name of one part, found {key!r}, of which the model "
                f"{model.name!r} has {len(owners)}"
            )
    given |= {key: value for key, value in bounds.items() if key not in inputs}
    weights = _soft(soft, given, inputs, bounds)
    found = []
    for key, pair in given.items():
        source: Source = "angles"
        angles = angle_function(model)
        size, start = int(angles.nnz_out(0)) if angles else 0, 0
        if key in known:
            source, layout = known[key]
            size, start = _part(layout, key).size, layout.slices[key].start
            _refuse_attitude("bounds", key, _part(layout, key), source)
        lower, upper = two_sides(f"bounds[{key!r}]", pair, size)
        rows = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
        if not rows.size and key in weights:
            raise ValueError(f"soft: expected finite bounds of {key!r}, found {pair!r}")
        if rows.size:
            sides = {"lower": lower[rows], "upper": upper[rows]}
            found.append(
                Limit(name=key, source=source, rows=start + rows, weight=weights.get(key), **sides)
            )
    return (*found, *_state_rates(model, rates, inputs))


def input_bounds(model: ControlModel, bounds: Mapping[str, Any]) -> tuple[Array, Array]:
    """Bounds (nu,) of the inputs: the tighter of the model's own and the given ones."""
    lower, upper = (side.copy() for side in model.u.bounds)
    for part in model.u.parts:
        if part.name in bounds:
            rows = model.u.slices[part.name]
            low, high = two_sides(f"bounds[{part.name!r}]", bounds[part.name], part.size)
            if np.any(low > upper[rows]) or np.any(high < lower[rows]):
                raise ValueError(
                    f"bounds[{part.name!r}]: expected bounds that meet the model's own, "
                    f"{lower[rows].tolist()} to {upper[rows].tolist()}, found {low.tolist()} to "
                    f"{high.tolist()}"
                )
            lower[rows], upper[rows] = np.maximum(lower[rows], low), np.minimum(upper[rows], high)
    return lower, upper


def input_rates(model: ControlModel, rates: Mapping[str, Any]) -> tuple[Array, Array]:
    """Bounds (nu,) of the rates of the inputs."""
    lower, upper = np.full(model.u.size, -np.inf), np.full(model.u.size, np.inf)
    for part in model.u.parts:
        if part.name in rates:
            rows = model.u.slices[part.name]
            lower[rows], upper[rows] = _rate("rate_bounds", part, rates[part.name])
    return lower, upper


def inputs_at_rest(model: ControlModel, value: Any, lower: Array, upper: Array) -> Array:
    """The trimmed input (nu,); zero within the bounds unless given."""
    if value is None:
        return np.clip(np.zeros(model.u.size), lower, upper)
    found = stacked("u_trim", model.u, value)
    outside = np.flatnonzero((found < lower) | (found > upper))
    if outside.size:
        i = int(outside[0])
        raise ValueError(
            f"u_trim: {model.u.labels[i]}: expected within {lower[i]:g} to {upper[i]:g}, "
            f"found {found[i]:g}"
        )
    return found


def method(model: ControlModel, given: Method | None) -> Method:
    """The integration method of the stages: implicit for models with inertia unless given."""
    if given is None:
        return "rk4" if model.second_order is None else "implicit_midpoint"
    choice("method", given, get_args(Method))
    if given != "rk4" and model.second_order is None:
        raise ValueError(
            f"method: expected 'rk4' for {model.name!r}, which has no inertia, found {given!r}"
        )
    return given


def hold(blocks: Sequence[int] | None, horizon: int) -> tuple[int, ...]:
    """Index of the unknown input of each stage."""
    if blocks is None:
        return tuple(range(horizon))
    lengths = [count("blocks", length) for length in instance("blocks", blocks, Iterable)]
    if sum(lengths) != horizon:
        raise ValueError(f"blocks: expected lengths of sum {horizon}, the horizon, found {blocks}")
    return tuple(i for i, length in enumerate(lengths) for _ in range(length))


def scales(layout: Layout, given: Mapping[str, float], lower: Array, upper: Array) -> Array:
    """Units (nu,) of the inputs among the unknowns: given, or half their range, or 1."""
    half = sizes(lower, upper)
    found = np.where((half > 0) & (half < _UNBOUNDED), half, 1.0)
    for key, value in _by_name("scales", layout, given).items():
        rows, scale = layout.slices[key], float(positive(f"scales[{key!r}]", value))
        least = np.min(half[rows], where=half[rows] > 0, initial=np.inf)
        if scale > WIDE * least:
            raise ValueError(
                f"scales[{key!r}]: expected the size of an input with half the range {least:g}, "
                f"found {scale:g}"
            )
        found[rows] = scale
    return found


def _soft(soft: Any, given: Mapping[str, Any], inputs: set[str], bounds: Any) -> dict[str, float]:
    """Weights of soft bounds by name."""
    found = {}
    for key, weight in _mapping("soft", soft).items():
        if key in inputs:
            raise ValueError(f"soft: expected outputs or states, found the input {key!r}")
        if key not in given:
            raise ValueError(f"soft: expected names with bounds, {sorted(given)}, found {key!r}")
        found[key] = float(positive(f"soft[{key!r}]", weight))
    return found


def _state_rates(model: ControlModel, rates: Any, inputs: set[str]) -> list[Limit]:
    states = [part.name for part in model.x.parts]
    found = []
    for key, value in _mapping("rate_bounds", rates).items():
        _one_of("rate_bounds", key, [*sorted(inputs), *states])
        if key not in inputs:
            part = _part(model.x, key)
            _refuse_attitude("rate_bounds", key, part, "x")
            lower, upper = _rate("rate_bounds", part, value)
            rows = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
            if rows.size:
                at = model.x.slices[key].start + rows
                found.append(
                    Limit(name=key, source="rate", rows=at, lower=lower[rows], upper=upper[rows])
                )
    return found


def _rate(name: str, part: Part, value: Any) -> tuple[Array, Array]:
    """Bounds of rates: a number or an array for both directions, or a pair."""
    if isinstance(value, tuple):
        lower, upper = two_sides(f"{name}[{part.name!r}]", value, part.size)
    else:
        try:
            upper = np.array(np.broadcast_to(np.asarray(value, dtype=float), (part.size,)))
        except (TypeError, ValueError):
            upper = np.full(part.size, np.nan)
        if not np.all(upper > 0):
            raise ValueError(
                f"{name}[{part.name!r}]: expected one or {part.size} numbers above zero, or a "
                f"pair, found {value!r}"
            )
        lower = -upper
    return lower, upper


def _refuse_attitude(name: str, key: str, part: Part, source: str) -> None:
    if part.attitude or (source == "y" and is_rotation(part)):
        raise ValueError(
            f"{name}: expected a part that is no attitude, found {key!r}; bound angular rates, "
            "a part of their own, instead"
        )


def _mapping(name: str, given: Any) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise ValueError(f"{name}: expected a mapping by name, found {given!r}")
    return given


def _by_name(name: str, layout: Layout, given: Any) -> Mapping[str, Number]:
    for key in _mapping(name, given):
        _one_of(name, key, [part.name for part in layout.parts])
    return dict(given)


def _one_of(name: str, key: str, known: list[str]) -> None:
    if key not in known:
        raise ValueError(f"{name}: expected names among {', '.join(known)}, found {key!r}")


def _part(layout: Layout, key: str) -> Part:
    return next(part for part in layout.parts if part.name == key)
