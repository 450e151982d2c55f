"""A steady turn, by the one number that says how tight it is."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from curvcasadi.symbolic.expressions import number


@dataclass(frozen=True, eq=False, kw_only=True)
class Turn:
    """A steady turn about the vertical, given by one of its numbers.

    At the airspeed V and the climb angle γ, with the rate of the heading ψ̇,

        radius = V cos γ/ψ̇,      load factor = cos γ √(1 + (V ψ̇/g)²),

    and in a coordinated level turn tan(bank) ≈ V ψ̇/g. Rate, bank and radius are above zero to the
    right and below zero to the left.

    Attributes
    ----------
    rate : float, optional
        Rate of the heading ψ̇, rad/s.
    bank : float, optional
        Bank angle, the roll angle of the body, rad.
    radius : float, optional
        Radius of the path, m.
    load_factor : float, optional
        Force normal to the path over the weight, at least cos γ; the turn is one to the right.
    """

    rate: float | None = None
    bank: float | None = None
    radius: float | None = None
    load_factor: float | None = None

    def __post_init__(self) -> None:
        given = [field.name for field in fields(self) if getattr(self, field.name) is not None]
        if len(given) != 1:
            raise ValueError(
                "Turn: expected one of rate, bank, radius and load_factor, found "
                f"{' and '.join(given) or 'none'}"
            )
        (name,) = given
        value = number(f"Turn.{name}", getattr(self, name))
        object.__setattr__(self, name, value)
        if name == "bank" and not abs(value) < np.pi / 2:
            raise ValueError(
                f"Turn.bank: expected an angle within ±π/2 rad, found {value:g}; {value:g} degrees "
                f"are {np.deg2rad(value):.4g} rad"
            )
        if name == "radius" and value == 0:
            raise ValueError("Turn.radius: expected a number other than zero, found 0")
        if name == "load_factor" and not value > 0:
            raise ValueError(f"Turn.load_factor: expected a number above zero, found {value:g}")

    def __str__(self) -> str:
        units = {"rate": "rad/s", "bank": "rad", "radius": "m", "load_factor": ""}
        name, value = next((k, v) for k, v in vars(self).items() if v is not None)
        return f"turn with {name.replace('_', ' ')} {value:g} {units[name]}".rstrip()

    def rate_at(self, speed: float, gravity: float, flight_path: float | None) -> float:
        """Rate of the heading at an airspeed and a climb angle; not of a bank angle.

        Parameters
        ----------
        speed : float
            Airspeed, m/s.
        gravity : float
            Acceleration of gravity, m/s².
        flight_path : float or None
            Climb angle, rad; None where it is not known, which a rate does not need.

        Returns
        -------
        float
            Rate, rad/s.

        Raises
        ------
        ValueError
            Of a bank angle, whose rate follows from a trim; without a path, where it is needed; and
            if the load factor is below that of straight flight.
        """
        if self.rate is not None:
            return self.rate
        if self.bank is not None:
            raise ValueError("Turn.bank: expected another number; its rate follows from a trim")
        if flight_path is None:
            raise ValueError(
                "turn: expected rate or bank where flight_path is None, as radius and load_factor "
                "follow the path"
            )
        level = float(np.cos(flight_path))
        if self.radius is not None:
            return speed * level / self.radius
        factor = number("Turn.load_factor", self.load_factor)
        pull = factor / level
        if pull < 1:
            raise ValueError(
                f"Turn.load_factor: expected at least {level:.4g}, that of straight flight, found "
                f"{factor:g}"
            )
        return gravity / speed * float(np.sqrt(pull**2 - 1))
