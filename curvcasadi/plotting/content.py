"""What a picture shows: half wings with their shapes over time, and what is fixed to the body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from curvcasadi.aero.outline import edges
from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.aircraft.parts import Aircraft, LiftingSurface, Wing
from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.beam.mirror import mirror
from curvcasadi.control.simulation import Simulation
from curvcasadi.kinematics.history import ShapeHistory, shape_history
from curvcasadi.plotting.figures import CURVE_STATIONS
from curvcasadi.symbolic.expressions import Array

#: What pictures are drawn of.
Flying: TypeAlias = Beam | Wing | Aircraft
#: Ribbon of wings whose chord is not known, as a fraction of the length.
RIBBON = 0.06


class HalfWing(NamedTuple):
    """A half wing with its shapes."""

    beam: Beam
    history: ShapeHistory
    undeformed: ShapeHistory
    edges: tuple[Array, Array]  #: m along local y at the stations, ahead of and behind the curve
    has_chord: bool

    def outline(self, shape: ShapeHistory, sample: int) -> tuple[Array, Array]:
        """Leading and trailing edge (3, M) of a sample, m, parent axes."""
        y = shape.deformation_maps[sample][:, 1].T
        ahead, behind = self.edges
        return shape.positions[sample] + y * ahead, shape.positions[sample] + y * behind


def simulated(wing: Flying, times: Array | None, weights: Any) -> tuple[Flying, Array | None, Any]:
    """Wing, times and weights (T, n), those of a `Simulation` by name of the wing of an aircraft.

    Bounds of weights do not hold in a simulation, so that its wing has none.
    """
    if not isinstance(weights, Simulation):
        return wing, times, weights
    if times is not None:
        raise ValueError("times: expected None with a Simulation, which has its own")
    if isinstance(wing, Aircraft):
        flown = {part.name: weights.part(f"q_{part.name}").T for part in wing.beams}
        beams = tuple(_unbounded(part) for part in wing.beams)
        return replace(wing, beams=beams), weights.t, flown
    return _unbounded(wing), weights.t, weights.part("q").T


def _unbounded(wing: Any) -> Any:
    """A beam or wing without bounds of its weights."""
    if isinstance(wing, Wing):
        return replace(wing, beam=replace(wing.beam, weight_bounds=None))
    return replace(wing, weight_bounds=None)


def half_wings(
    wing: Flying,
    weights: Any,
    times: Array | None,
    *,
    both: bool,
    strips: StripAerodynamics | None = None,
    names: Sequence[str] | None = None,
) -> list[HalfWing]:
    """Shapes of all half wings for `weights` (T, n), of an aircraft by name of the wing."""
    if isinstance(wing, Aircraft):
        expected = [part.name for part in wing.beams]
        if not isinstance(weights, Mapping) or set(weights) != set(expected):
            found = sorted(weights) if isinstance(weights, Mapping) else type(weights).__name__
            raise ValueError(f"weights: expected a mapping from {expected}, found {found}")
        return [
            _half_wing(part.beam, _rows(weights[part.name]), times, part.strips, names)
            for part in wing.beams
        ]
    if isinstance(wing, Wing):
        beam, strips = wing.beam, wing.strips if strips is None else strips
    elif isinstance(wing, Beam):
        beam = wing
    else:
        raise ValueError(f"wing: expected a Beam, Wing or Aircraft, found {type(wing).__name__}")
    right = _half_wing(beam, _rows(weights), times, strips, names)
    if not both:
        return [right]
    return [right, _half_wing(mirror(beam), _rows(weights), times, strips, names)]


def _rows(weights: Any) -> Array:
    values = np.asarray(weights, dtype=float)
    return values.reshape(1, -1) if values.ndim < 2 or values.shape[1] == 1 else values


def _half_wing(
    beam: Beam,
    weights: Array,
    times: Array | None,
    strips: StripAerodynamics | None,
    names: Sequence[str] | None,
) -> HalfWing:
    length = numeric_length(beam, "a figure")
    jumps = [] if strips is None else strips.breaks
    # Both sides of a break, where a chord may jump.
    sides = [np.nextafter(x, end) for x in jumps for end in (0.0, 1.0)]
    own = [body.xi for body in beam.bodies]
    stations = np.unique([*CURVE_STATIONS, *beam.stations, *own, *sides])
    history = shape_history(beam, weights, times, stations=stations.tolist(), names=names)
    # Zero weights need not be within the bounds.
    unbounded = replace(beam, weight_bounds=None)
    zero = np.zeros((1, beam.basis.n))
    undeformed = shape_history(unbounded, zero, stations=stations.tolist())
    if strips is None:
        half = np.full(len(stations), RIBBON * length / 2)
        return HalfWing(beam, history, undeformed, (half, -half), False)
    return HalfWing(beam, history, undeformed, edges(strips, stations), True)


def corners(surface: LiftingSurface) -> Array:
    """Corners (3, 4) of a rigid surface as a rectangle, m, body axes."""
    ahead, behind = (float(edge[0]) for edge in edges(surface.strips, [0.5]))
    half = float(surface.area) / (ahead - behind) / 2
    local = np.array(
        [[-half, half, half, -half], [ahead, ahead, behind, behind], [0.0, 0.0, 0.0, 0.0]]
    )
    pose = surface.pose
    return np.asarray(pose.position.full() + pose.rotation.full() @ local)


def points_of(wings: Sequence[HalfWing], aircraft: Aircraft | None, undeformed: bool) -> Array:
    """All points (k, 3) that must be in view, m."""
    points = []
    for wing in wings:
        shapes = [wing.history, wing.undeformed] if undeformed else [wing.history]
        for shape in shapes:
            points.append(shape.positions.transpose(0, 2, 1).reshape(-1, 3))
            if wing.has_chord:
                points += [
                    edge.T for k in range(len(shape.times)) for edge in wing.outline(shape, k)
                ]
    if aircraft is not None:
        points += [corners(surface).T for surface in aircraft.surfaces]
        points += [aircraft.body.center_of_mass.full().T] if float(aircraft.body.mass) else []
    return np.concatenate(points)
