"""Cross sections: stiffness about the local axes, and mass."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from curvcasadi.expressions import AnyExpr, Number, positive


@dataclass(frozen=True, eq=False, kw_only=True)
class Section:
    """Cross-section stiffness about the local axes.

    A field is a number, a CasADi symbol, or a function of xi = s/L that returns one.
    """

    GJ: Number  #: torsional rigidity, N m²
    EI_y: Number  #: out-of-plane bending rigidity, N m²
    EI_z: Number  #: in-plane bending rigidity, N m²
    mass_per_length: Number | None = None  #: kg/m; None where no model uses it
    breaks: tuple[float, ...] = ()  #: interior xi at which a field jumps

    def __post_init__(self) -> None:
        for name in ("GJ", "EI_y", "EI_z", "mass_per_length"):
            value = getattr(self, name)
            if value is not None and not callable(value):
                positive(f"Section.{name}", value)

    def stiffness(self, xi: float) -> AnyExpr:
        """Stiffness matrix (3, 3), N m², local axes: moment = stiffness (K − K_0)."""
        rigidities = [
            _at(f"Section.{name}", getattr(self, name), xi) for name in CHANNEL_RIGIDITIES
        ]
        return ca.diag(ca.vertcat(*rigidities))


#: Rigidities in the order of K_x, K_y, K_z.
CHANNEL_RIGIDITIES = ("GJ", "EI_y", "EI_z")


def _at(name: str, value: Number, xi: float) -> Number:
    return positive(f"{name} at xi = {xi}", value(xi)) if callable(value) else value
