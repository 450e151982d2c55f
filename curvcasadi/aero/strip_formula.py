"""What acts on a strip of unsteady air, and the rates of the states that it drives there."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from curvcasadi.aero import section
from curvcasadi.aero.gust import GustEntry
from curvcasadi.aero.lag_states import IndicialLag
from curvcasadi.symbolic.expressions import AnyExpr


@dataclass(frozen=True)
class StripFormula:
    """The function of a `LocalFormula`: wrench of a strip, then the rates of the values there.

    Attributes
    ----------
    lag, entry : tuple of float
        Rates of the poles of the circulation, and of the entry states.
    first : bool
        Whether the entry state stands in front of the lag states.
    """

    lag: tuple[float, ...]
    entry: tuple[float, ...]
    first: bool

    @classmethod
    def of(cls, lag: IndicialLag | None, entry: GustEntry | None) -> StripFormula:
        """That of a model of the circulation and of the entry into gusts."""
        return cls(
            () if lag is None else tuple(lag.rates.tolist()),
            () if entry is None else tuple(entry.poles.rates.tolist()),
            entry is not None and entry.kind == "lag",
        )

    @property
    def vectors(self) -> int:
        """Vectors that it takes: the stream and, where something follows a gust, the gust."""
        return 2 if self.entry else 1

    @property
    def count(self) -> int:
        """Values at the station: of the poles, then of the entry states."""
        return len(self.lag) + len(self.entry)

    def __call__(
        self, vectors: AnyExpr, data: AnyExpr, twist: AnyExpr, acceleration: AnyExpr
    ) -> AnyExpr:
        """Moment, force and rates, (6 + count, 1), N m, N and m/s².

        Parameters
        ----------
        vectors : SX, MX or DM, shape (3, vectors)
            Velocity of the parent through the air, and of the air in a gust, m/s, local axes.
        data : SX, MX or DM, shape (2 + count + 11, 1)
            φ₀, what else adds to u_e, the values, and `SectionData`.
        twist, acceleration : SX, MX or DM, shape (6, 1)
            As of `Load.wrench`.
        """
        ends = [0, 1, 2, 2 + self.count, 2 + self.count + section.SIZE]
        parts: list[AnyExpr] = ca.vertsplit(data, ends)
        direct, gained, values, packed = parts
        strip, omega = section.unpack(packed), twist[:3]
        velocity = twist[3:] + vectors[:, 0]
        followed = section.circulation(velocity, omega, strip)
        u = followed.velocity
        wrench = section.circulatory_wrench(velocity, omega, strip, u, direct * u + gained)
        rate = acceleration[3:] - ca.cross(omega, velocity)
        wrench += section.apparent_wrench(velocity, omega, rate, acceleration[:3], strip)
        pace = followed.speed / (strip.chord / 2)
        x, g = values[: len(self.lag)], values[len(self.lag) :]
        target = u + (g[0] if self.first else 0)
        rates = [b * pace * (target - x[i]) for i, b in enumerate(self.lag)]
        if self.entry:
            u_g = section.gust_velocity(velocity, omega, vectors[:, 1], strip)
            rates += [b * pace * (u_g - g[i]) for i, b in enumerate(self.entry)]
        return ca.vertcat(wrench, *rates)
