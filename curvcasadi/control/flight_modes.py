"""Modes of an aircraft in trimmed flight, by name.

Position and heading are ignorable: they are left out, and with them four zero eigenvalues. What is
left are the tilt of the body about the horizontal axes, its twist, and the states of wings and air.
A state k takes part in a mode with left and right eigenvectors l and r by |l_k r_k|/|lᴴ r|, in
whatever unit it is; conjugate pairs count as one. A name goes to the mode in which its states take
part most, all names together. Phugoid and short period trade one state for another, so that of
these two the one with less part counts; the spiral is either of its two, and their mean counts:

    phugoid          pitch angle, velocity along x
    short period     pitch rate, velocity along z
    dutch roll       velocity along y
    spiral           roll angle, yaw rate
    roll             roll rate

In a very flexible aircraft these are motions of the wings as well: roll may oscillate with their
antisymmetric bending. The other modes are those of body, wings or air that take part most.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from curvcasadi.aircraft.trim_result import TrimResult
from curvcasadi.control.linearize import linearize
from curvcasadi.control.model import ControlModel
from curvcasadi.control.roots import OSCILLATING
from curvcasadi.control.trimmed_state import trimmed_state
from curvcasadi.lie import quaternion
from curvcasadi.symbolic.expressions import Array, Number
from curvcasadi.symbolic.text import table

Complex = NDArray[np.complex128]

#: States of the names among tilt (roll, pitch angle) and twist (p, q, r, u, v, w).
NAMED = {
    "phugoid": (1, 5),
    "short period": (3, 7),
    "dutch roll": (6,),
    "spiral": (0, 4),
    "roll": (2,),
}
#: Names of motions in which both states take part.
_TRADES = ("phugoid", "short period")
_RIGID = 8
#: Oscillations of the wings that are printed.
_SHOWN = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightMode:
    """A mode of trimmed flight.

    Attributes
    ----------
    name : str
        "phugoid", "short period", "dutch roll", "spiral" or "roll", once each; "body", "wings" or
        "air" of all others, as what takes part most.
    eigenvalue : complex
        1/s; of a conjugate pair the one with the positive imaginary part.
    shape : array, shape (nd,)
        Its eigenvector, complex, in the error state `model.x.errors`; position and heading, which
        follow the others, are zero. The largest entry is 1.
    """

    name: str
    eigenvalue: complex
    shape: Complex

    @property
    def frequency(self) -> float:
        """Of the oscillation, Im λ, rad/s; zero if there is none."""
        return float(self.eigenvalue.imag)

    @property
    def damping_ratio(self) -> float:
        """−Re λ/|λ|; 1 or −1 of an aperiodic mode."""
        size = abs(self.eigenvalue)
        return float(-self.eigenvalue.real / size) if size else 0.0

    @property
    def time_to_half(self) -> float:
        """Time in which it decays by half, s; of a growing one, below zero, that to double."""
        rate = self.eigenvalue.real
        return float(-np.log(2.0) / rate) if rate else float("inf")


@dataclass(frozen=True, eq=False, kw_only=True)
class FlightModes:
    """All modes of trimmed flight: the five with names, then the others, by their magnitude.

    Attributes
    ----------
    speed : float
        Airspeed, m/s.
    modes : tuple of FlightMode
        A conjugate pair is one mode.
    """

    speed: float
    modes: tuple[FlightMode, ...]

    def __getitem__(self, name: str) -> FlightMode:
        """The first mode of a name."""
        for mode in self.modes:
            if mode.name == name:
                return mode
        names = list(dict.fromkeys(mode.name for mode in self.modes))
        raise KeyError(f"expected one of {names}, found {name!r}")

    def __iter__(self) -> Iterator[FlightMode]:
        return iter(self.modes)

    @property
    def eigenvalues(self) -> Complex:
        """Eigenvalues of the modes in order, 1/s."""
        return np.array([mode.eigenvalue for mode in self.modes])

    @property
    def stable(self) -> bool:
        """Whether every mode decays."""
        return bool(np.all(self.eigenvalues.real < 0))

    @property
    def shown(self) -> tuple[FlightMode, ...]:
        """The five with names, slow oscillations of the wings, and whatever grows."""
        others = self.modes[len(NAMED) :]
        wings = [mode for mode in others if mode.name == "wings" and mode.frequency][:_SHOWN]
        growing = [mode for mode in others if mode.eigenvalue.real > 0]
        return tuple(dict.fromkeys([*self.modes[: len(NAMED)], *wings, *growing]))

    def __str__(self) -> str:
        return modes_table([self])


def modes_table(flights: Sequence[FlightModes]) -> str:
    """Modes of several flights as a table: `FlightModes.shown` of each.

    Parameters
    ----------
    flights : sequence of FlightModes
        Such as those of several speeds.

    Returns
    -------
    str
        A line per mode: speed, name, real and imaginary part, period, damping ratio, and the time
        in which it halves or doubles.
    """
    rows = []
    for flight in flights:
        for mode in flight.shown:
            half = mode.time_to_half
            rows.append(
                {
                    "V [m/s]": f"{flight.speed:.5g}",
                    "mode": mode.name,
                    "real [1/s]": f"{mode.eigenvalue.real:.5f}",
                    "imaginary [rad/s]": f"{mode.frequency:.5f}",
                    "period [s]": f"{2 * np.pi / mode.frequency:.3f}" if mode.frequency else "-",
                    "damping ratio": f"{mode.damping_ratio:.4f}",
                    "halves or doubles in [s]": f"{abs(half):.3f} {'/2' if half > 0 else 'x2'}",
                }
            )
    return table(rows)


def flight_modes(
    model: ControlModel,
    trim: TrimResult,
    p: Number | Mapping[str, Number] | None = None,
) -> FlightModes:
    """The modes of an aircraft in trimmed flight, the ones of the rigid aircraft by name.

    Parameters
    ----------
    model : ControlModel
        An `aircraft_model`.
    trim : TrimResult
        A trim of the same aircraft in the same air, straight or turning.
    p : array or mapping of str to number, optional
        Parameters of the model, as of `trimmed_state`.

    Returns
    -------
    FlightModes
        Modes of the linear model about `trimmed_state`.

    Raises
    ------
    ValueError, ConvergenceError
        As `trimmed_state`.
    """
    from scipy.linalg import eig

    at = trimmed_state(model, trim, p)
    basis = _reduction(model, at.x)
    values, left, right = eig(
        basis.T @ linearize(model, at.x, at.u, p).A @ basis, left=True, right=True
    )
    size = np.abs(values)
    values = np.where(np.abs(values.imag) > OSCILLATING * size, values, values.real)
    part = np.abs(left.conj() * right) / np.abs(np.sum(left.conj() * right, axis=0))
    kept = np.flatnonzero(values.imag >= 0)
    kept = kept[np.argsort(size[kept], kind="stable")]
    names = _names(part[:, kept] * np.where(values[kept].imag > 0, 2, 1), _lag_states(model))
    places = {name: k for k, name in enumerate(NAMED)}
    order = sorted(range(len(kept)), key=lambda k: places.get(names[k], len(places)))
    return FlightModes(
        speed=trim.speed,
        modes=tuple(
            FlightMode(
                name=names[k],
                eigenvalue=complex(values[kept[k]]),
                shape=_normalized(basis @ right[:, kept[k]]),
            )
            for k in order
        ),
    )


def _lag_states(model: ControlModel) -> int:
    """Number of the last states, those of the air."""
    return sum(part.size for part in model.x.parts if part.name.startswith("lag_"))


def _names(part: Array, lag: int) -> list[str]:
    """Names of modes (columns) from how states (rows) take part in them."""
    from scipy.optimize import linear_sum_assignment

    ends = [0, _RIGID, len(part) - lag, len(part)]
    shares = [np.sum(part[a:b], axis=0) for a, b in pairwise(ends)]
    names = [("body", "wings", "air")[k] for k in np.argmax(shares, axis=0)]
    scores = np.array(
        [
            (np.min if name in _TRADES else np.mean)(part[list(k)], axis=0)
            for name, k in NAMED.items()
        ]
    )
    for name, mode in zip(NAMED, linear_sum_assignment(-scores)[1], strict=True):
        names[mode] = name
    return names


def _normalized(vector: Complex) -> Complex:
    return np.asarray(vector / vector[np.argmax(np.abs(vector))])


def _reduction(model: ControlModel, x: Array) -> Array:
    """Columns for tilt about the horizontal axes, twist, and everything else but position."""
    slices, size = model.x.errors.slices, model.x.errors.size
    attitude, twist = slices["quaternion_wxyz"], slices["twist"]
    rotation = quaternion.rotation(ca.DM(x[:4])).full()
    tilt = np.zeros((size, 2))
    tilt[attitude] = rotation.T[:, :2]
    unit = np.eye(size)
    first = [slices[name] for name in ("quaternion_wxyz", "position", "twist")]
    others = [k for k in range(size) if not any(part.start <= k < part.stop for part in first)]
    return np.hstack([tilt, unit[:, twist], unit[:, others]])
