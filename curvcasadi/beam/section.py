"""Cross sections along the span, and discrete bodies: stiffness and mass in local axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    expression,
    is_numeric,
    numbers,
    positive,
    station,
)

#: Rigidities in the order of K_x, K_y, K_z, and the couplings of two of them.
RIGIDITIES = ("GJ", "EI_y", "EI_z")
COUPLINGS = {"coupling_xy": (0, 1), "coupling_xz": (0, 2), "coupling_yz": (1, 2)}


@dataclass(frozen=True, eq=False)
class Steps:
    """A quantity that is constant between jumps: for tables of section data.

    Parameters
    ----------
    xi : (m + 1,) increasing stations from 0 to 1
    values : m values, one per interval; of any shape
    """

    xi: Sequence[float]
    values: Sequence[Any]

    def __post_init__(self) -> None:
        xi = numbers("Steps.xi", self.xi)
        if xi.ndim != 1 or len(xi) < 2 or np.any(np.diff(xi) <= 0) or xi[0] != 0 or xi[-1] != 1:
            raise ValueError(
                f"Steps.xi: expected increasing stations that cover 0 to 1, found {xi.tolist()}"
            )
        if len(self.values) != len(xi) - 1:
            raise ValueError(
                f"Steps.values: expected {len(xi) - 1} values, one per interval, "
                f"found {len(self.values)}"
            )
        object.__setattr__(self, "xi", xi)

    @property
    def breaks(self) -> tuple[float, ...]:
        """Where the quantity jumps."""
        return tuple(float(x) for x in np.asarray(self.xi)[1:-1])

    def __call__(self, xi: float) -> Any:
        return self.values[int(np.searchsorted(self.breaks, xi, side="right"))]


@dataclass(frozen=True, eq=False, kw_only=True)
class Section:
    """Cross-section stiffness and mass about the local axes.

    A field is a number, a CasADi symbol, or a function of xi = s/L that returns one; a function
    with jumps has `breaks`, as `Steps` has.
    """

    GJ: Number  #: torsional rigidity, N m²
    EI_y: Number  #: out-of-plane bending rigidity, N m²
    EI_z: Number  #: in-plane bending rigidity, N m²
    coupling_xy: Number = 0.0  #: torsion with out-of-plane bending, N m²
    coupling_xz: Number = 0.0  #: torsion with in-plane bending, N m²
    coupling_yz: Number = 0.0  #: out-of-plane with in-plane bending, N m²
    mass_per_length: Number | None = None  #: kg/m; None where no model uses it
    inertia: Number | None = None  #: (3, 3) about the centre of mass, kg m
    center_of_mass: Number = (0.0, 0.0, 0.0)  #: (3,) from the reference curve, m
    breaks: tuple[
        float, ...
    ] = ()  #: interior xi at which a field jumps; those of `Steps` are added

    def __post_init__(self) -> None:
        for name in RIGIDITIES:
            _check(self, name, positive)
        for name in COUPLINGS:
            _check(self, name, lambda name, value: expression(name, value, (1, 1)))
        if self.mass_per_length is not None:
            _check(self, "mass_per_length", positive)
        if self.inertia is not None:
            _check(self, "inertia", symmetric)
        _check(self, "center_of_mass", lambda name, value: expression(name, value, (3, 1)))
        jumps = {x for f in fields(self) for x in getattr(getattr(self, f.name), "breaks", ())}
        object.__setattr__(self, "breaks", tuple(sorted(jumps | set(self.breaks))))
        if not any(callable(getattr(self, name)) for name in (*RIGIDITIES, *COUPLINGS)):
            self.stiffness(0.5)

    @classmethod
    def from_stiffness(cls, stiffness: Number, **mass: Number) -> Section:
        """A section with a full stiffness (3, 3), N m²: symmetric and positive definite.

        Parameters
        ----------
        stiffness : numbers, a symbol, or a function of xi, rows and columns K_x, K_y, K_z
        mass : `mass_per_length`, `inertia`, `center_of_mass`
        """

        def entry(row: int, column: int) -> Number:
            if callable(stiffness):
                return _Entry(stiffness, row, column)
            return symmetric("stiffness", stiffness, definite=True)[row, column]

        couplings = {name: entry(*place) for name, place in COUPLINGS.items()}
        rigidities = {name: entry(i, i) for i, name in enumerate(RIGIDITIES)}
        return cls(**rigidities, **couplings, **mass)

    def stiffness(self, xi: float) -> AnyExpr:
        """Stiffness (3, 3), N m², local axes: moment = stiffness (K − K_0)."""
        rows = [[ca.DM(0)] * 3 for _ in range(3)]
        for i, name in enumerate(RIGIDITIES):
            rows[i][i] = _at(self, name, xi)
        for name, (i, j) in COUPLINGS.items():
            rows[i][j] = rows[j][i] = _at(self, name, xi)
        matrix = ca.vertcat(*(ca.horzcat(*row) for row in rows))
        return symmetric(f"Section stiffness at xi = {xi}", matrix, definite=True)

    def mass_at(self, xi: float) -> Number:
        """Mass per length, kg/m."""
        if self.mass_per_length is None:
            raise ValueError("Section.mass_per_length: expected kg/m, found None")
        return positive(
            f"Section.mass_per_length at xi = {xi}", _at(self, "mass_per_length", xi), zero=True
        )

    def center_of_mass_at(self, xi: float) -> AnyExpr:
        """Centre of mass (3, 1) from the reference curve, m, local axes."""
        return expression("Section.center_of_mass", _at(self, "center_of_mass", xi), (3, 1))


@dataclass(frozen=True, eq=False)
class _Entry:
    """One entry of a stiffness that varies along the span."""

    stiffness: Any
    row: int
    column: int

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(getattr(self.stiffness, "breaks", ()))

    def __call__(self, xi: float) -> AnyExpr:
        matrix = symmetric(f"stiffness at xi = {xi}", self.stiffness(xi), definite=True)
        return matrix[self.row, self.column]


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """A rigid body fixed to the beam at a station."""

    xi: float  #: station s/L
    mass: Number  #: kg
    inertia: Number = field(default_factory=lambda: np.zeros((3, 3)))  #: about its centre, kg m²
    offset: Number = (0.0, 0.0, 0.0)  #: its centre from the reference curve, m, local axes

    def __post_init__(self) -> None:
        station("Body.xi", self.xi)
        positive("Body.mass", self.mass, zero=True)
        symmetric("Body.inertia", self.inertia)
        object.__setattr__(self, "offset", expression("Body.offset", self.offset, (3, 1)))


def condense_axial(stiffness: Number) -> Array:
    """Stiffness (3, 3) of an inextensible beam from one with axial strain (4, 4).

    Rows and columns ε, K_x, K_y, K_z; the axial force is zero: S_KK − S_Kε S_εK/S_εε. Leaving the
    axial strain out instead makes a beam whose reference curve is not its tension axis too stiff.
    """
    matrix = symmetric("stiffness", stiffness, size=4, definite=True).full()
    return np.asarray(matrix[1:, 1:] - np.outer(matrix[1:, 0], matrix[0, 1:]) / matrix[0, 0])


def symmetric(name: str, value: Number, *, size: int = 3, definite: bool = False) -> AnyExpr:
    """`value`, a symmetric matrix, positive definite if `definite`; symbols as they are."""
    matrix = expression(name, value, (size, size))
    if not is_numeric(matrix):
        return matrix
    entries = matrix.full()
    if not np.allclose(entries, entries.T, rtol=1e-9, atol=0):
        raise ValueError(f"{name}: expected a symmetric matrix, found {entries.tolist()}")
    if definite and np.linalg.eigvalsh(entries)[0] <= 0:
        raise ValueError(f"{name}: expected a positive definite matrix, found {entries.tolist()}")
    return matrix


def _check(section: Section, name: str, check: Any) -> None:
    value = getattr(section, name)
    if not callable(value):
        check(f"Section.{name}", value)


def _at(section: Section, name: str, xi: float) -> Number:
    value = getattr(section, name)
    if not callable(value):
        return value
    found = value(xi)
    if name in RIGIDITIES:
        return positive(f"Section.{name} at xi = {xi}", found)
    return found
