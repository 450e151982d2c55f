"""The description of a beam."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from curvcasadi.beam.along import Along, breaks_of, vector
from curvcasadi.beam.basis import Basis, refuse_at_tip
from curvcasadi.beam.grid import Grid
from curvcasadi.beam.pose import Pose, checked_pose
from curvcasadi.beam.section import Body, Section
from curvcasadi.symbolic.expressions import (
    COINCIDENT,
    AnyExpr,
    Array,
    Number,
    instance,
    is_numeric,
    own_fields,
    positive,
    sequence,
    station,
)
from curvcasadi.symbolic.text import described, grouped, shown

_Result = TypeVar("_Result")


@dataclass(frozen=True, eq=False, kw_only=True)
class Beam:
    """An inextensible, unshearable beam whose curvature is K = K_0 + Φ q (Eq. 3).

    `length`, `root`, `initial_curvature` and the fields of `section` may hold CasADi symbols.

    Attributes
    ----------
    length : float or symbol
        Length L of the reference curve, m.
    basis : Basis
        Basis functions Φ, such as `ChannelBasis` or `VectorBasis`; dimensionless, so that the
        weights q are in rad/m.
    grid : Grid
        Elements along the span, and the rule within an element.
    section : Section or None
        Stiffness and mass; needed by what depends on them.
    root : Pose
        Local frame at xi = 0 in parent axes: the inertial axes of a lone beam, the body axes of a
        wing of an aircraft.
    initial_curvature : array, symbol, callable or None, shape (3,)
        Curvature K_0 of the unloaded beam, rad/m, local axes, or a function of xi that returns it;
        zero where None.
    weight_bounds : float, array, tuple or None
        Bounds of the weights, rad/m: the largest absolute value b of all, (b_1 … b_n), or a pair
        (lower, upper) of these.
    bodies : tuple of Body
        Rigid bodies that are fixed to stations.
    """

    length: Number
    basis: Basis
    grid: Grid
    section: Section | None = None
    root: Pose = field(default_factory=Pose.identity)
    initial_curvature: Number | None = None
    weight_bounds: Number | None = None
    bodies: tuple[Body, ...] = ()
    _initial: Along = field(init=False, repr=False)
    _bounds: tuple[Array, Array] = field(init=False, repr=False)
    _memory: OrderedDict[Hashable, Any] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        own_fields(self)
        object.__setattr__(self, "length", positive("Beam.length", self.length))
        instance("Beam.grid", self.grid, Grid)
        object.__setattr__(self, "root", checked_pose("Beam.root", self.root))
        object.__setattr__(self, "bodies", sequence("Beam.bodies", self.bodies or ()))
        for body in self.bodies:
            instance("Beam.bodies", body, Body)
        if self.section is not None and not isinstance(self.section, Section):
            raise ValueError(f"Beam.section: expected a Section, found {self.section!r}")
        n = getattr(self.basis, "n", 0)
        if not (callable(self.basis) and n >= 1 and np.shape(self.basis(0.5)) == (3, n)):
            raise ValueError(
                "Beam.basis: expected a basis such as ChannelBasis(out_of_plane=Legendre(4)), "
                f"found {self.basis!r}"
            )
        for body in self.bodies:
            at_tip = {"force": body.mass, "offset": body.offset, "moment": body.inertia}
            refuse_at_tip(self.basis, "Beam.bodies", body.xi, **at_tip)
        initial = np.zeros(3) if self.initial_curvature is None else self.initial_curvature
        object.__setattr__(self, "_initial", Along("Beam.initial_curvature", initial, vector))
        object.__setattr__(self, "_bounds", self._validated_bounds())
        object.__setattr__(self, "_memory", OrderedDict())

    def _validated_bounds(self) -> tuple[Array, Array]:
        n, bounds = self.basis.n, self.weight_bounds
        if bounds is None:
            return np.full(n, -np.inf), np.full(n, np.inf)
        try:
            lower, upper = (
                np.array(np.broadcast_to(np.asarray(side, dtype=float), (n,)))
                for side in (bounds if isinstance(bounds, tuple) else (-np.asarray(bounds), bounds))
            )
        except (TypeError, ValueError):
            raise ValueError(
                f"Beam.weight_bounds: expected a number, {n} numbers or a pair (lower, upper) of "
                f"these, found {bounds!r}"
            ) from None
        if not np.all(lower <= upper):  # also refuses NaN
            raise ValueError(
                "Beam.weight_bounds: expected lower bounds not above upper ones, "
                f"found {lower.tolist()} and {upper.tolist()}"
            )
        return lower, upper

    def __repr__(self) -> str:
        elements = len(self.stations) - 1
        return f"<Beam: {shown(self.length, 'm')}, {self.basis.n} weights, {elements} elements>"

    def __str__(self) -> str:
        lower, upper = self.bounds
        low, high = (side[:1] if np.all(side == side[0]) else side for side in (lower, upper))
        bounds = f"from {shown(low)} to {shown(high, 'rad/m')}"
        if self.weight_bounds is None:
            bounds = "none"
        rows = {
            "length": shown(self.length, "m"),
            "root": f"at {self.root}",
            "basis": f"{self.basis.n} weights, rad/m: {grouped(self.basis.labels)}",
            "weight bounds": bounds,
            "initial curvature": shown(self.initial_curvature, "rad/m"),
            "grid": str(self.grid),
            "elements": str(len(self.stations) - 1),
            "section": "none" if self.section is None else self.section.summary,
        }
        if self.bodies:
            rows["bodies"] = ", ".join(
                f"{shown(body.mass, 'kg')} at xi = {body.xi:g}" for body in self.bodies
            )
        return described("Beam", rows)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds (n,) of the weights, rad/m; infinite where none is declared."""
        lower, upper = self._bounds
        return lower.copy(), upper.copy()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_memory": OrderedDict()}

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Interior xi that no element crosses: breaks of the basis, K_0 and the section."""
        points = breaks_of(self.basis, self.initial_curvature, self.section)
        return merged_breaks([*points, *(body.xi for body in self.bodies)])

    @cached_property
    def stations(self) -> Array:
        """Element boundaries xi (N + 1,) from 0 to 1, read-only; every break is one."""
        stations = self.grid.stations(self.breaks)
        stations.setflags(write=False)
        return stations

    def initial_curvature_at(self, xi: float) -> AnyExpr:
        """K_0 (3, 1), rad/m, local axes, at the station `xi`.

        Parameters
        ----------
        xi : float
            Station s/L in [0, 1].

        Returns
        -------
        SX, MX or DM, shape (3, 1)
            The curvature K_0, rad/m, local axes.
        """
        return self._initial(xi)

    @cached_property
    def design_symbols(self) -> dict[str, AnyExpr]:
        """Fields that shape the beam and hold CasADi symbols, by name."""
        stations = self.stations
        sampled = np.concatenate([stations, (stations[1:] + stations[:-1]) / 2])
        sampled = sampled if self._initial.varies else sampled[:1]
        fields = {
            "Beam.length": self.length,
            "Beam.root.rotation": self.root.rotation,
            "Beam.root.position": self.root.position,
            "Beam.initial_curvature": ca.vertcat(
                *(self.initial_curvature_at(xi) for xi in sampled)
            ),
        }
        return {name: value for name, value in fields.items() if not is_numeric(value)}

    @property
    def shaping_symbols(self) -> dict[str, AnyExpr]:
        """Those of `design_symbols` that its root sees: in length and initial curvature."""
        symbols = self.design_symbols.items()
        return {name: value for name, value in symbols if not name.startswith("Beam.root")}


#: Results that a beam keeps, at most: those that were asked for last.
_KEPT = 64


def remembered(beam: Beam, key: Hashable, make: Callable[[], _Result]) -> _Result:
    """What `make` returns, which the beam keeps by `key`: it is dropped with the beam."""
    memory = beam._memory
    if key not in memory:
        memory[key] = make()
        while len(memory) > _KEPT:
            memory.popitem(last=False)
    memory.move_to_end(key)
    result: _Result = memory[key]
    return result


def merged_breaks(points: Iterable[float]) -> tuple[float, ...]:
    """Sorted interior stations without near-coincident ones."""
    ordered = sorted(station("breaks", x) for x in points)
    kept: list[float] = []
    for x in ordered:
        if x - (kept[-1] if kept else 0.0) > COINCIDENT and 1.0 - x > COINCIDENT:
            kept.append(x)
    return tuple(kept)


def numeric_length(beam: Beam, purpose: str) -> float:
    """The length of `beam`, m, where `purpose` needs a number."""
    if not is_numeric(beam.length):
        raise ValueError(f"Beam.length: {purpose} needs a number, found the symbol {beam.length}")
    return float(beam.length)
