"""Cross sections along the span, and discrete bodies: stiffness and mass in local axes."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from operator import itemgetter
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.along import Along, Check, breaks_of, is_table, mapped, scalar, vector
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    Number,
    expression,
    is_numeric,
    own_fields,
    positive,
    station,
    symmetric,
)
from curvcasadi.symbolic.text import described, shown

#: Rigidities in the order of K_x, K_y, K_z, and the couplings of two of them.
RIGIDITIES = ("GJ", "EI_y", "EI_z")
COUPLINGS = {"coupling_xy": (0, 1), "coupling_xz": (0, 2), "coupling_yz": (1, 2)}
_PLACES = {name: (i, i) for i, name in enumerate(RIGIDITIES)} | COUPLINGS


#: An eigenvalue of an inertia may be negative by this fraction of the largest: rounding of tables.
_ROUNDING = 1e-9
#: A principal moment of a body may exceed the sum of the others by this fraction of it.
_TABLES = 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class Section:
    """Cross-section stiffness and mass about the local axes.

    Every field is a number, a CasADi symbol, or a function of xi = s/L that returns one; a function
    with jumps has `breaks`, as `Steps` has.

    Attributes
    ----------
    GJ : float, symbol or callable
        Torsional rigidity, N m².
    EI_y : float, symbol or callable
        Out-of-plane bending rigidity, N m².
    EI_z : float, symbol or callable
        In-plane bending rigidity, N m².
    coupling_xy : float, symbol or callable
        Coupling of torsion with out-of-plane bending, N m².
    coupling_xz : float, symbol or callable
        Coupling of torsion with in-plane bending, N m².
    coupling_yz : float, symbol or callable
        Coupling of out-of-plane with in-plane bending, N m².
    mass_per_length : float, symbol, callable or None
        Mass per length, kg/m; None where no model uses it.
    inertia : array, symbol, callable or None, shape (3, 3)
        Inertia per length about the centre of mass, local axes, kg m.
    center_of_mass : array, symbol or callable, shape (3,)
        Centre of mass from the reference curve, local axes, m.
    breaks : tuple of float
        Interior stations at which a field jumps; those of `Steps` are added.
    """

    GJ: Number
    EI_y: Number
    EI_z: Number
    coupling_xy: Number = 0.0
    coupling_xz: Number = 0.0
    coupling_yz: Number = 0.0
    mass_per_length: Number | None = None
    inertia: Number | None = None
    center_of_mass: Number = (0.0, 0.0, 0.0)
    breaks: tuple[float, ...] = ()

    _quantities: dict[str, Along] = field(init=False, repr=False)
    _uniform: AnyExpr | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        own_fields(self)
        if self.mass_per_length is not None and not callable(self.mass_per_length):
            positive("Section.mass_per_length", self.mass_per_length)
        quantities = {
            name: Along(f"Section.{name}", getattr(self, name), check)
            for name, check in _CHECKS.items()
            if getattr(self, name) is not None
        }
        object.__setattr__(self, "_quantities", quantities)
        breaks = breaks_of(self, *self._quantities.values())
        object.__setattr__(self, "breaks", breaks)
        if not any(self._quantities[name].varies for name in (*RIGIDITIES, *COUPLINGS)):
            object.__setattr__(self, "_uniform", self.stiffness(0.5))

    @classmethod
    def from_stiffness(cls, stiffness: Number, **mass: Number) -> Section:
        """A section with a full stiffness matrix, symmetric and positive definite.

        Parameters
        ----------
        stiffness : array, symbol or callable, shape (3, 3)
            Stiffness, N m², or a function of xi that returns it; rows and columns K_x, K_y, K_z.
        **mass : float, array, symbol or callable
            The fields `mass_per_length`, `inertia` and `center_of_mass`.

        Returns
        -------
        Section
            With that stiffness.
        """

        whole = Along("stiffness", stiffness, partial(symmetric, definite=True)).value
        if callable(whole):
            whole = _Latest(whole)  # six entries ask for the same matrix

        def entry(row: int, column: int) -> Number:
            return mapped(whole, itemgetter((row, column)))

        return cls(**{name: entry(*place) for name, place in _PLACES.items()}, **mass)

    def __str__(self) -> str:
        return described("Section", {name: shown(*of) for name, of in self._entries.items()})

    @property
    def stiffness_varies(self) -> bool:
        """Whether the stiffness is a function of xi."""
        return self._uniform is None

    @property
    def stiffness_is_smooth_between_breaks(self) -> bool:
        """Whether the stiffness is a number, a symbol or a table, which has no unknown features."""
        fields = [self._quantities[name] for name in (*RIGIDITIES, *COUPLINGS)]
        return all(is_table(quantity) for quantity in fields if quantity.varies)

    @property
    def summary(self) -> str:
        """The fields that are set, in a line."""
        return "; ".join(f"{name} {shown(*of)}" for name, of in self._entries.items())

    @property
    def _entries(self) -> dict[str, tuple[Number, str]]:
        """Value and unit of the fields that say something."""
        set_fields = {name: along.value for name, along in self._quantities.items()}
        zeros = [*COUPLINGS, "center_of_mass"]
        return {
            name: (value, _UNITS[name])
            for name, value in set_fields.items()
            if not (name in zeros and _is_zero(value))
        }

    def stiffness(self, xi: float) -> AnyExpr:
        """Stiffness (3, 3), N m², local axes: moment = stiffness (K − K_0).

        Parameters
        ----------
        xi : float
            Station s/L in [0, 1].

        Returns
        -------
        SX, MX or DM, shape (3, 3)
            Stiffness, N m², local axes.
        """
        if self._uniform is not None:
            return type(self._uniform)(self._uniform)
        rows: list[list[Any]] = [[0.0] * 3 for _ in range(3)]
        for name, (i, j) in _PLACES.items():
            value = self._quantities[name](xi)
            rows[i][j] = rows[j][i] = float(value) if is_numeric(value) else value
        name = f"Section stiffness at xi = {xi:g}"
        if all(is_numeric(entry) for row in rows for entry in row):
            return symmetric(name, np.array(rows), definite=True)
        return ca.vertcat(*(ca.horzcat(*row) for row in rows))

    def mass_at(self, xi: float) -> Number:
        """Mass per length, kg/m.

        Parameters
        ----------
        xi : float
            Station s/L in [0, 1].

        Returns
        -------
        float or symbol
            Mass per length, kg/m.
        """
        return self._needed("mass_per_length", "kg/m")(xi)

    def inertia_at(self, xi: float) -> AnyExpr:
        """Inertia per length about the centre of mass.

        Parameters
        ----------
        xi : float
            Station s/L in [0, 1].

        Returns
        -------
        SX, MX or DM, shape (3, 3)
            Inertia per length, kg m, local axes.
        """
        return self._needed("inertia", "shape (3, 3), kg m")(xi)

    def center_of_mass_at(self, xi: float) -> AnyExpr:
        """Centre of mass from the reference curve.

        Parameters
        ----------
        xi : float
            Station s/L in [0, 1].

        Returns
        -------
        SX, MX or DM, shape (3, 1)
            Centre of mass, m, local axes.
        """
        return self._quantities["center_of_mass"](xi)

    def _needed(self, name: str, expected: str) -> Along:
        if name not in self._quantities:
            raise ValueError(f"Section.{name}: expected {expected}, found None")
        return self._quantities[name]


@dataclass(frozen=True, eq=False, kw_only=True)
class Body:
    """A rigid body fixed to the beam at a station.

    Attributes
    ----------
    xi : float
        Station s/L in [0, 1].
    mass : float or symbol
        Mass, kg.
    inertia : array or symbol, shape (3, 3)
        Inertia about the body's centre of mass, local axes, kg m².
    offset : array or symbol, shape (3,)
        Centre of mass from the reference curve, local axes, m.
    """

    xi: float
    mass: Number
    inertia: Number = field(default_factory=lambda: np.zeros((3, 3)))
    offset: Number = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        own_fields(self)
        object.__setattr__(self, "xi", station("Body.xi", self.xi))
        positive("Body.mass", self.mass, zero=True)
        object.__setattr__(self, "inertia", rigid_inertia("Body.inertia", self.inertia))
        object.__setattr__(self, "offset", expression("Body.offset", self.offset, (3, 1)))


def condense_axial(stiffness: Number) -> Array:
    """Stiffness of an inextensible beam from one with axial strain.

    Rows and columns are ε, K_x, K_y, K_z. The axial force is zero: S_KK − S_Kε S_εK/S_εε. To leave
    out the axial strain instead makes a beam whose reference curve is not its tension axis too
    stiff.

    Parameters
    ----------
    stiffness : array, shape (4, 4)
        Symmetric, positive definite stiffness of the axial strain and the three curvatures.

    Returns
    -------
    ndarray, shape (3, 3)
        Stiffness of the curvatures, N m².
    """
    matrix = symmetric("stiffness", stiffness, size=4, definite=True).full()
    return np.asarray(matrix[1:, 1:] - np.outer(matrix[1:, 0], matrix[0, 1:]) / matrix[0, 0])


@dataclass(frozen=True, eq=False)
class _Latest:
    """A function of xi that remembers its value at the station that it was last asked for."""

    source: Along
    _latest: dict[float, AnyExpr] = field(init=False, repr=False, default_factory=dict)

    @property
    def breaks(self) -> tuple[float, ...]:
        return self.source.breaks

    def __call__(self, xi: float) -> AnyExpr:
        if xi not in self._latest:
            value = self.source(xi)
            self._latest.clear()
            self._latest[xi] = value
        return self._latest[xi]


def semidefinite(name: str, value: Number) -> AnyExpr:
    """`value`, a symmetric matrix (3, 3) without negative eigenvalues; symbols as they are."""
    matrix = symmetric(name, value)
    if is_numeric(matrix):
        eigenvalues = np.linalg.eigvalsh(matrix.full())
        if eigenvalues[0] < -_ROUNDING * np.max(np.abs(eigenvalues)):
            raise ValueError(
                f"{name}: expected a matrix without negative eigenvalues, "
                f"found the eigenvalues {eigenvalues.tolist()}"
            )
    return matrix


def rigid_inertia(name: str, value: Number) -> AnyExpr:
    """`value`, the inertia (3, 3) of a rigid body; symbols as they are.

    Of any distribution of mass no principal moment exceeds the sum of the others.
    """
    matrix = semidefinite(name, value)
    if is_numeric(matrix):
        least, middle, largest = np.linalg.eigvalsh(matrix.full())
        if largest > (least + middle) * (1 + _TABLES):
            raise ValueError(
                f"{name}: expected principal moments of which none exceeds the sum of the other "
                f"two, kg m², found {least:.4g}, {middle:.4g} and {largest:.4g}"
            )
    return matrix


def _is_zero(value: Number) -> bool:
    return is_numeric(value) and not callable(value) and not np.any(np.asarray(value, dtype=float))


_UNITS = {
    **dict.fromkeys((*RIGIDITIES, *COUPLINGS), "N m²"),
    "mass_per_length": "kg/m",
    "inertia": "kg m",
    "center_of_mass": "m",
}
#: What the fields of a section that may vary along the span must fulfil.
_CHECKS: dict[str, Check] = {
    **dict.fromkeys(RIGIDITIES, positive),
    **dict.fromkeys(COUPLINGS, scalar),
    "mass_per_length": partial(positive, zero=True),
    "inertia": semidefinite,
    "center_of_mass": vector,
}
