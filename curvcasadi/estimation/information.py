"""Information that sensors give about the weights, and what a covariance means for the shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import unpack_pose
from curvcasadi.estimation.sensor_model import SensorModel, sensor_model
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.jacobian import body_jacobian_of, jacobian_states
from curvcasadi.kinematics.weights import checked_weights
from curvcasadi.sensors import RootMotion, Sensor
from curvcasadi.sensors.measurement import check_in_view
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    instance,
    numbers,
    numeric,
    station,
)

#: What may be unknown.
UNKNOWNS = ("q", "q_dot")
CURVE_STATIONS = np.linspace(0.0, 1.0, 61)


@dataclass(frozen=True, eq=False, kw_only=True)
class ShapeDeviations:
    """Standard deviations of the shape along the span.

    Attributes
    ----------
    stations : array, shape (N,)
        Stations s/L.
    position : array, shape (3, N)
        Standard deviations of the position, m, parent axes.
    attitude : array, shape (3, N)
        Standard deviations of the attitude, rad, local axes.
    """

    stations: Array
    position: Array
    attitude: Array

    @property
    def distance(self) -> Array:
        """Root mean square (N,) of the distance from the true position, m."""
        return np.asarray(np.sqrt(np.sum(self.position**2, axis=0)))


def information_matrix(
    beam: Beam,
    sensors: Sequence[Sensor],
    shapes: Number,
    rates: Number | None = None,
    *,
    unknowns: Sequence[str] = ("q",),
    root: RootMotion | None = None,
) -> Array:
    """Fisher information of one sample of `sensors`, mean over shapes and motions.

        H = 1/S Σ_s J(q_s, q_dot_s)ᵀ diag(noise)⁻² J(q_s, q_dot_s)

    with J the structured derivative of the readings; that of an attitude stands on the right.

    Parameters
    ----------
    beam : Beam
        Wing with numeric fields.
    sensors : sequence of Sensor
        Sensors on the wing.
    shapes : array, shape (S, n) or (n,)
        Curvature weights, rad/m, within the bounds.
    rates : array, shape (S, n) or (n,), optional
        Rates of the weights, rad/(m s), one for each shape; at rest where None.
    unknowns : sequence of str
        ("q",), with q_dot known, or ("q", "q_dot").
    root : RootMotion, optional
        Motion of the root, gravity and magnetic field, as for `measure`.

    Returns
    -------
    ndarray, shape (n, n) or (2n, 2n)
        Information, (rad/m)⁻² of the weights, (rad/(m s))⁻² of their rates.
    """
    model, states = information_problem(beam, sensors, shapes, rates, unknowns, root)
    slopes = [model.slope(state) for state in states]
    return np.asarray(sum(slope.T @ slope for slope in slopes) / len(slopes))


def information_problem(
    beam: Beam,
    sensors: Sequence[Sensor],
    shapes: Number,
    rates: Number | None,
    unknowns: Sequence[str],
    root: RootMotion | None,
) -> tuple[SensorModel, list[dict[str, Array]]]:
    """The sensors, and the states at which their derivatives are wanted."""
    instance("beam", beam, Beam)
    single = isinstance(unknowns, str) or not np.iterable(unknowns)
    names = (unknowns,) if single else tuple(unknowns)
    if names not in (("q",), UNKNOWNS):
        raise ValueError(f"unknowns: expected ('q',) or ('q', 'q_dot'), found {unknowns!r}")
    n = beam.basis.n
    found = {"q": _samples("shapes", shapes, n)}
    for i, q in enumerate(found["q"]):
        checked_weights(beam, ca.DM(q), f"shapes[{i}]")
    if rates is not None or "q_dot" in names:
        found["q_dot"] = np.zeros_like(found["q"]) if rates is None else _samples("rates", rates, n)
        if found["q_dot"].shape != found["q"].shape:
            raise ValueError(
                f"rates: expected one row for each of the {len(found['q'])} shapes, "
                f"found {len(found['q_dot'])}"
            )
    model = sensor_model(beam, sensors, tuple(found), names, root)
    for i, q in enumerate(found["q"]):
        check_in_view(model.sensors, beam, q, f" with shapes[{i}]")
    rows = zip(*found.values(), strict=True)
    return model, [dict(zip(found, row, strict=True)) for row in rows]


def _samples(name: str, value: Number, n: int) -> Array:
    """`value` as rows (S, n)."""
    array = numbers(name, value)
    if array.shape in ((n,), (n, 1)):
        array = array.reshape(1, n)
    if array.ndim != 2 or array.shape[1] != n or not len(array):
        raise ValueError(f"{name}: expected shape (S, {n}) or ({n},), found {array.shape}")
    return array


def shape_deviations(
    beam: Beam, q: AnyExpr, covariance: Number, stations: Sequence[float] | None = None
) -> ShapeDeviations:
    """Standard deviations of positions and attitudes: the diagonal of J P Jᵀ.

    Parameters
    ----------
    beam : Beam
        Wing with numeric fields.
    q : array, shape (n, 1)
        Curvature weights, rad/m.
    covariance : array, shape (n, n)
        Covariance P, (rad/m)²; weights of infinite variance make what they move infinite.
    stations : sequence of float, optional
        Stations s/L; 61 from the root to the tip where None.

    Returns
    -------
    ShapeDeviations
        Along the span.
    """
    q = numeric("q", checked_weights(beam, q))
    covariance = _matrix("covariance", covariance, beam.basis.n)
    where = CURVE_STATIONS if stations is None else numbers("stations", stations).ravel()
    xi = np.array([station("stations", x) for x in where])
    unknown = ~np.isfinite(np.diag(covariance))
    known = np.where(unknown[:, None] | unknown, 0.0, covariance)

    root = beam.root.rotation.full()
    squares = []
    for state in jacobian_states(chain.build(beam, xi.tolist()), q):
        rotation, _ = unpack_pose(state)
        jacobian = body_jacobian_of(state).full()
        rows = np.vstack([jacobian[:3], root @ rotation.full() @ jacobian[3:]])
        variances = np.einsum("ij,jk,ik->i", rows, known, rows)
        moved = np.any(np.abs(rows[:, unknown]) > 1e-12, axis=1)
        squares.append(np.where(moved, np.inf, np.maximum(variances, 0.0)))
    deviations = np.sqrt(np.array(squares).T)
    return ShapeDeviations(stations=xi, position=deviations[3:], attitude=deviations[:3])


def _matrix(name: str, value: Number, n: int) -> Array:
    """`value` as a new array (n, n) of numbers, which need not be finite."""
    try:
        found = np.array(value.full() if isinstance(value, ca.DM) else value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected numbers, found {value!r}") from None
    if found.shape != (n, n):
        raise ValueError(f"{name}: expected shape {(n, n)}, found {found.shape}")
    return found
