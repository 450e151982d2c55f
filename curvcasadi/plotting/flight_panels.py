"""The surfaces of a flying aircraft over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.control.simulation import Simulation
from curvcasadi.lie import quaternion
from curvcasadi.plotting.content import corners, half_wings, simulated
from curvcasadi.symbolic.expressions import Array

#: Colours of wings, of rigid surfaces and of what joins them.
WING, TAIL, BODY = "#4c8fc7", "#8a8f99", "#404040"
#: Points along a wing.
_POINTS = 21


class Panel(NamedTuple):
    """A surface that moves: corners of its edges, inertial axes less the path flown."""

    name: str
    front: Array  #: (T, 3, M), m
    back: Array  #: (T, 3, M)
    rigid: bool


def flight_panels(aircraft: Aircraft, simulation: Simulation) -> list[Panel]:
    """Wings and rigid surfaces over time, inertial axes less the mean path along the ground."""
    flown, times, weights = simulated(aircraft, None, simulation)
    attitude = [quaternion.rotation(ca.DM(q)).full() for q in simulation.part("quaternion_wxyz").T]
    origin = simulation.part("position").T
    path = origin[0] + np.outer(simulation.t - simulation.t[0], _mean_velocity(simulation))
    shift = origin - path

    def moved(points: Array) -> Array:
        """Points (T, 3, M), body axes, as the view sees them: north, east, down."""
        turned = np.einsum("tij,tjm->tim", np.array(attitude), points)
        return np.asarray(turned + shift[:, :, None])

    panels = []
    wings = half_wings(flown, weights, times, both=False)
    for part, wing in zip(aircraft.beams, wings, strict=True):
        outlines = [wing.outline(wing.history, k) for k in range(len(simulation.t))]
        kept = np.linspace(0, outlines[0][0].shape[1] - 1, _POINTS).round().astype(int)
        front, back = (np.array(edge)[:, :, kept] for edge in zip(*outlines, strict=True))
        panels.append(Panel(part.name, moved(front), moved(back), False))
    for surface in aircraft.surfaces:
        held = np.broadcast_to(corners(surface), (len(simulation.t), 3, 4))
        panels.append(Panel(surface.name, moved(held[:, :, :2]), moved(held[:, :, [3, 2]]), True))
    joints = [wing.beam.root.position for wing in aircraft.beams]
    joints += [surface.pose.position for surface in aircraft.surfaces]
    center = aircraft.body.center_of_mass.full()
    for k, joint in enumerate(joints):
        bar = np.hstack([center, joint.full()])
        if np.ptp(bar, axis=1).max() > 0:
            held = np.broadcast_to(bar, (len(simulation.t), 3, 2))
            panels.append(Panel(f"body {k}", moved(held), moved(held), True))
    return panels


def _mean_velocity(simulation: Simulation) -> Array:
    """Mean horizontal velocity, m/s."""
    position, t = simulation.part("position"), simulation.t
    mean = (position[:, -1] - position[:, 0]) / (t[-1] - t[0])
    return np.asarray(mean * [1.0, 1.0, 0.0])


def extent(panels: Sequence[Panel]) -> tuple[Array, Array]:
    """Least and largest coordinates (3,) of all panels at all times, m."""
    points = [edge for panel in panels for edge in (panel.front, panel.back)]
    low = np.min([edge.min(axis=(0, 2)) for edge in points], axis=0)
    return low, np.max([edge.max(axis=(0, 2)) for edge in points], axis=0)
