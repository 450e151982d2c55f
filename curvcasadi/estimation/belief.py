"""What an estimator starts from: mean and covariance, given part by part or as an estimate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.beam.beam import Beam
from curvcasadi.control.signals import with_nominal
from curvcasadi.estimation import ud
from curvcasadi.estimation.samples import numeric_array
from curvcasadi.estimation.sensor_model import covariance_matrix
from curvcasadi.kinematics.weights import checked_weights
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    choice,
    instance,
    numbers,
    rotation_matrix,
)
from curvcasadi.symbolic.layout import Layout, Part

#: Most that the length of a quaternion may differ from 1.
UNIT = 1e-6


def weights_of(wings: Beam | Aircraft) -> dict[str, Beam]:
    """The beam of each part of a state that holds weights, by name of the part."""
    if isinstance(wings, Beam):
        return {"q": wings}
    return {f"q_{wing.name}": wing.beam for wing in wings.beams}


def initial_belief(
    wings: Beam | Aircraft,
    state: Layout,
    error: Layout,
    deviation: Mapping[str, Number],
    mean: Mapping[str, Number] | None,
    parameters: Layout | None = None,
) -> tuple[Array, Array]:
    """Mean (x,) of the state and factor (N, N) of the covariance of its error.

    Parameters
    ----------
    deviation : by name of every part of `error`, what `covariance_matrix` takes
    mean : by name of parts of `state`; zero, and the identity attitude, where not given; of the
        weights within the bounds of the beam
    parameters : those of a model among `state`, which are nominal, not zero, where not given

    Raises
    ------
    ValueError
        If a part is unknown, has no deviation, is a parameter without a mean, has values of another
        shape, or weights are beyond what `shape_map` takes.
    """
    means = {} if mean is None else mean
    _check_names("mean", means, state)
    _check_names("deviation", deviation, error)
    for part in error.parts:
        if part.name not in deviation:
            raise ValueError(f"deviation: expected {part.name!r}, {part.unit}; not found")
    if parameters is not None:
        names = [part.name for part in parameters.parts]
        given = {name: means[name] for name in names if name in means}
        means = {**means, **with_nominal("mean", parameters, given)}
    covariance = np.zeros((error.size, error.size))
    for name, where in error.slices.items():
        size = where.stop - where.start
        covariance[where, where] = covariance_matrix(f"deviation[{name!r}]", deviation[name], size)
    found = np.concatenate([_mean(part, means) for part in state.parts])
    for name, beam in weights_of(wings).items():
        checked_weights(beam, ca.DM(found[state.slices[name]]), f"mean[{name!r}]")
    return found, ud.factor_of(covariance)


def _mean(part: Part, means: Mapping[str, Number]) -> Array:
    name, size = part.name, part.size
    where = f"mean[{name!r}]"
    if part.attitude:
        value = numeric_array(where, means.get(name, [1.0, 0, 0, 0]), (4, 1)).ravel()
        length = np.linalg.norm(value)
        if not abs(length - 1) <= UNIT:
            raise ValueError(f"{where}: expected a unit quaternion, found length {length:g}")
        return np.asarray(value / length)
    if name != "attitude":
        return numeric_array(where, means.get(name, np.zeros(size)), (size, 1)).ravel()
    rotation = rotation_matrix(where, means.get(name, ca.DM.eye(3)))
    return numeric_array(where, rotation, (3, 3)).ravel(order="F")


def _check_names(argument: str, given: Mapping[str, Number], layout: Layout) -> None:
    if not isinstance(given, Mapping):
        raise ValueError(f"{argument}: expected values by name of a part, found {given!r}")
    for name in given:
        choice(argument, name, [part.name for part in layout.parts])


def check_start(
    start: Any, kind: type, what: str, shapes: Mapping[str, tuple[int, ...]], factor: str
) -> None:
    """ValueError unless `start` is a `kind` whose fields have these shapes and finite numbers.

    Parameters
    ----------
    what : that it is an estimate of, in words
    factor : the field that holds a factor U D Uᵀ
    """
    instance("start", start, kind)
    for name, shape in shapes.items():
        found = np.shape(getattr(start, name))
        if found != shape:
            raise ValueError(
                f"start: expected an estimate of this {what}, {name} of shape {shape}; "
                f"found {found}"
            )
        numbers(f"start.{name}", getattr(start, name))
    values = np.asarray(getattr(start, factor))
    for i, j in np.argwhere(np.tril(values, -1)):
        raise ValueError(
            f"start.{factor}[{i}, {j}]: expected an upper triangular matrix, 0 below its diagonal, "
            f"found {values[i, j]:g}"
        )
    for i in np.flatnonzero(np.diag(values) <= 0):
        raise ValueError(
            f"start.{factor}[{i}, {i}]: expected a number above zero, as D of U D Uᵀ, found "
            f"{values[i, i]:g}"
        )
