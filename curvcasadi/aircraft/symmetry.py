"""Whether wings have the mirror images that their lifting lines count on."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.aero.induced import LiftingLine
from curvcasadi.aero.induced_load import plane_of
from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.aircraft.parts import Aircraft, Wing
from curvcasadi.kinematics.shape import poses
from curvcasadi.symbolic.expressions import Array, instance, is_numeric

#: Stations that are compared, and by how much they may differ, over the length of the beam.
_COMPARED, _SAME = (0.0, 0.5, 1.0), 1e-6


def check_images(aircraft: Aircraft, line: LiftingLine | None) -> None:
    """Refuse lifting lines with an image on wings that have none.

    Raises
    ------
    ValueError
        If no other wing is, unbent, the mirror image of a wing with airfoil data.
    """
    if line is None or not line.image:
        return
    winged = [wing for wing in aircraft.beams if wing.strips is not None]
    for wing in winged:
        normal = plane_of(line, wing.beam).full()
        own, size = _outline(wing), _SAME * float(wing.beam.length)
        if own is None:
            continue
        mirrored = own - 2 * normal @ (normal.T @ own)
        others = [_outline(other) for other in winged if other is not wing]
        if not any(x is None or np.allclose(x, mirrored, rtol=0, atol=size) for x in others):
            raise ValueError(
                f"LiftingLine.image: expected a mirror image of the wing {wing.name!r} beyond the "
                f"plane of normal {normal.ravel()}, found none among the wings "
                f"{[wing.name for wing in winged]}; with image=False wings have two free ends"
            )


def _outline(wing: Wing) -> Array | None:
    """Quarter points and trailing edges of the unbent wing, (3, 6), m; None where symbols are."""
    beam, points = wing.beam, []
    strips = instance("Wing.strips", wing.strips, StripAerodynamics)
    unbent = poses(beam, ca.DM.zeros(beam.basis.n), list(_COMPARED))
    for xi, pose in zip(_COMPARED, unbent, strict=True):
        ahead, chord = (strips.at(name, xi) for name in ("aerodynamic_center", "chord"))
        points += [pose.position + y * pose.rotation[:, 1] for y in (ahead, ahead - 0.75 * chord)]
    outline = ca.horzcat(*points)
    return ca.DM(outline).full() if is_numeric(outline) else None
