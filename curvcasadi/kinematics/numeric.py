"""Numeric shapes: one CasADi Function of a beam and its stations, made once and kept with the beam.

With numbers as weights the chain of a beam would otherwise be thousands of calls from Python.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple, overload

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, remembered
from curvcasadi.beam.pose import Pose, pose_of
from curvcasadi.kinematics import chain
from curvcasadi.symbolic.expressions import AnyExpr, is_numeric


def evaluated(
    beam: Beam, name: str, formula: Callable[..., AnyExpr], **arguments: AnyExpr
) -> AnyExpr:
    """`formula(**arguments)`, for numbers by a Function of the compact form that the beam keeps.

    Parameters
    ----------
    beam : Beam
        Beam that `formula` describes.
    name : str
        What tells `formula` from others of the beam with the same arguments.
    formula : callable
        Expression of the arguments and nothing else but the beam.
    **arguments : SX, MX or DM
        Arguments, checked already.
    """
    if beam.design_symbols or not all(map(is_numeric, arguments.values())):
        return formula(**arguments)

    def made() -> ca.Function:
        symbols = {key: ca.MX.sym(key, *value.shape) for key, value in arguments.items()}
        return ca.Function("numeric", [*symbols.values()], [formula(**symbols)])

    function = remembered(beam, ("numeric", name, *arguments), made)
    return function.call([*arguments.values()])[0]


class NumericPoses(Sequence[Pose]):
    """Poses of M stations as matrices; each becomes a `Pose` when it is asked for."""

    def __init__(self, rotations: ca.DM, positions: ca.DM) -> None:
        self.rotations = rotations  #: (3, 3 M), local to parent
        self.positions = positions  #: (3, M), m, parent axes
        self._indices = range(positions.shape[1])

    def __len__(self) -> int:
        return len(self._indices)

    @overload
    def __getitem__(self, index: int) -> Pose: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Pose, ...]: ...
    def __getitem__(self, index: int | slice) -> Pose | tuple[Pose, ...]:
        at = self._indices[index]
        if isinstance(at, range):
            return tuple(self[k] for k in at)
        return pose_of(self.rotations[:, 3 * at : 3 * at + 3], self.positions[:, at])


class NumericShape(NamedTuple):
    """M stations of a beam without design symbols, in matrices that nobody else holds."""

    rotations: ca.DM  #: (3, 3 M), local to parent
    positions: ca.DM  #: (3, M), m, parent axes
    curvatures: ca.DM  #: (3, M), rad/m
    squared_angle: float  #: the largest θ² of an element of the beam, rad²


def numeric_shape(beam: Beam, q: ca.DM, stations: Sequence[float]) -> NumericShape:
    """Shape at `stations` for numeric weights (n, 1)."""
    at = tuple(stations)
    function = remembered(beam, ("numeric shape", at), lambda: _shape_function(beam, at))
    rotations, positions, curvatures, squared_angle = function.call([q])
    return NumericShape(rotations, positions, curvatures, float(squared_angle))


def _shape_function(beam: Beam, stations: tuple[float, ...]) -> ca.Function:
    """q -> rotations (3, 3 M), positions and curvatures (3, M), largest θ².

    The elements are one accumulated call.
    """
    beam_chain = chain.build(beam, stations)
    q, elements = ca.MX.sym("q", beam.basis.n), beam_chain.elements
    step = _accumulating_step(beam_chain.pattern)
    states = ca.MX(beam.root.packed)
    if elements:
        data = ca.horzcat(*beam_chain.data[:elements])
        along = step.mapaccum(elements)(states, ca.repmat(q, 1, elements), data)
        states = ca.horzcat(states, along)
    ends = [
        states[:, k] if partial is None else step(states[:, k], q, beam_chain.data[partial])
        for k, partial in beam_chain.exits
    ]
    whole = [k for k, partial in beam_chain.exits if partial is None]
    if whole == list(range(elements + 1)) and len(ends) == len(whole):
        found = states
    else:
        found = ca.horzcat(*ends)
    rotations = ca.reshape(found[:9, :], 3, 3 * len(stations))
    initial = ca.vertcat(*(beam.initial_curvature_at(xi) for xi in stations))
    phi = ca.sparsify(ca.DM(np.vstack([beam.basis(xi) for xi in stations])))
    curvatures = ca.reshape(ca.densify(initial + phi @ q), 3, len(stations))
    largest = ca.mmax(chain.squared_angles(beam, q))
    outputs = [rotations, found[9:, :], curvatures, largest]
    return ca.Function("numeric_shape", [q], outputs)


@lru_cache(maxsize=256)
def _accumulating_step(pattern: chain.Pattern) -> ca.Function:
    """`chain.pose_step` with the state first: (state, q, data) -> state."""
    state, q = ca.SX.sym("state", 12), ca.SX.sym("q", pattern.n)
    data = ca.SX.sym("data", sum(pattern.sizes))
    end = chain.pose_step(pattern)(q, state, data)
    return ca.Function("accumulating_step", [state, q, data], [end], {"cse": True})
