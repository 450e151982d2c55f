"""Which side of a wing is the upper one, and the airfoil data of its mirror image."""

from __future__ import annotations

from dataclasses import replace

from curvcasadi.aero.strip import StripAerodynamics
from curvcasadi.symbolic.expressions import AnyExpr, is_numeric


def mirror_aero(strips: StripAerodynamics) -> StripAerodynamics:
    """Airfoil data of the other half wing, for the beam `mirror(beam)`.

    Local z of a mirrored beam points out of the other side of the airfoil; x and y, and with them
    chord and aerodynamic centre, are mirror images. Antisymmetric surfaces deflect the other way.

    Parameters
    ----------
    strips : StripAerodynamics
        Airfoil data of one half wing, with their upper side.

    Returns
    -------
    StripAerodynamics
        Airfoil data of the other one.

    Raises
    ------
    ValueError
        If `upper_side` is None. `mirror_wing` needs none: a wing knows its root.
    """
    if strips.upper_side is None:
        raise ValueError(
            "StripAerodynamics.upper_side: expected 1 or -1 of what is mirrored without its wing, "
            "found None; mirror_wing knows the root"
        )
    controls = tuple(
        replace(c, lift=-c.lift, moment=-c.moment, drag=-c.drag) if c.antisymmetric else c
        for c in strips.controls
    )
    return replace(strips, upper_side=-strips.upper_side, controls=controls)


#: Vertical part of local z below which a root stands upright.
_UPRIGHT = 1e-6


def with_upper_side(owner: str, strips: StripAerodynamics, rotation: AnyExpr) -> StripAerodynamics:
    """Airfoil data that know the upper side: as given, or that of the root's local z.

    Parameters
    ----------
    owner : str
        What has the data, for errors.
    strips : StripAerodynamics
        Airfoil data.
    rotation : SX, MX or DM, shape (3, 3)
        Of the root, local to body axes; body z points down.

    Raises
    ------
    ValueError
        If the rotation does not tell the upper side: of an upright root and of a symbol.
    """
    if strips.upper_side is not None:
        return strips
    down = rotation[2, 2]
    if not is_numeric(down) or abs(float(down)) < _UPRIGHT:
        found = "upright" if is_numeric(down) else "a symbol"
        raise ValueError(
            f"StripAerodynamics.upper_side of {owner}: expected 1 (local z points out of the upper "
            f"side) or -1 (out of the lower side) where the root does not tell; found None, and "
            f"its root is {found}"
        )
    return replace(strips, upper_side=1 if float(down) < 0 else -1)
