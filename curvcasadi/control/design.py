"""How linear models, and what they say, change with parameters: design derivatives.

A steady state x(p) of r(x, p) = 0 moves by dx/dp = −T⁻¹ ∂r/∂p, T = ∂r/∂x, and every matrix about it
changes by its partial derivative and by that along dx/dp:

    dA/dp = ∂A/∂p + (∂A/∂x) dx/dp

These are forward derivatives of the structured slopes of the equations, one direction a parameter.
All else is algebra: of a root λ with left and right eigenvectors l and r

    dλ/dp = lᴴ (dA/dp) r/(lᴴ r),

of a response H = C X + D with (iω − A) X = B and Y (iω − A) = C

    dH/dp = dC/dp X + dD/dp + Y (dA/dp X + dB/dp).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from curvcasadi.control.flutter import Flutter
from curvcasadi.control.linearize import LinearModel, linearize
from curvcasadi.control.model import ControlModel, SecondOrder, symbols_of
from curvcasadi.control.roots import GROWTH
from curvcasadi.symbolic.expressions import Array, choice, instance, sequence
from curvcasadi.symbolic.layout import Layout
from curvcasadi.symbolic.text import grouped

#: What Newton's method may correct of a steady state, relative to it or to a small one, rad/m.
AT_REST, SMALLEST = 1e-6, 1e-6


@dataclass(frozen=True, eq=False, kw_only=True)
class DesignDerivatives:
    """A linear model about a steady state and its derivatives by m entries of parameters.

    Attributes
    ----------
    linear : LinearModel
        The linear model.
    labels : tuple of str
        Name and index of each parameter.
    x : array, shape (nx, m)
        Of the steady state.
    A, B, C, D, B_p, D_p : array, shape (m, rows, columns)
        Of the matrices of the linear model, the moving steady state included.
    """

    linear: LinearModel
    labels: tuple[str, ...]
    x: Array
    A: Array
    B: Array
    C: Array
    D: Array
    B_p: Array
    D_p: Array

    def __repr__(self) -> str:
        return f"<DesignDerivatives of {self.linear.model.name} by {grouped(self.labels)}>"

    @property
    def roots(self) -> tuple[Array, Array]:
        """Eigenvalues of A, (nx,), and their derivatives, (nx, m), 1/s; single ones.

        The order is that of `LinearModel.eigenvalues`.
        """
        from scipy.linalg import eig

        values, left, right = eig(self.linear.A, left=True, right=True)
        order = np.argsort(np.abs(values), kind="stable")
        left, right = left[:, order], right[:, order]
        across = np.einsum("ik,mij,jk->km", left.conj(), self.A, right)
        return values[order], across / np.sum(left.conj() * right, axis=0)[:, None]

    @property
    def damping_ratios(self) -> tuple[Array, Array]:
        """−Re λ/|λ| of the roots, (nx,), and its derivatives, (nx, m)."""
        roots, slopes = self.roots
        size = np.abs(roots)[:, None]
        growth = np.real(roots.conj()[:, None] * slopes) / size
        ratios = -roots.real / np.abs(roots)
        return ratios, -(slopes.real + ratios[:, None] * growth) / size


def design_derivatives(linear: LinearModel, names: Sequence[str]) -> DesignDerivatives:
    """Derivatives of a linear model about a steady state by parameters of the model.

    Parameters
    ----------
    linear : LinearModel
        About a steady state of a model with equations of motion, such as those of `Flutter`.
    names : sequence of str
        Parts of p: airspeed, pitch, and the `parameters` of a `wing_model`.

    Returns
    -------
    DesignDerivatives
        Exact: derivatives of the structured slopes, the moving steady state included.

    Raises
    ------
    ValueError
        If a name is unknown, the state is not steady, or the model has no equations of motion or
        holds an attitude.
    """
    instance("linear", linear, LinearModel)
    model, motion = linear.model, motion_of(linear.model)
    columns, labels = columns_of(model.p, names)
    at = SteadySlopes.of(model, motion, linear.x, linear.u, linear.p)
    n, output = at.n, _functions(model, motion).output
    right = np.column_stack([at.rest, at.blocks["p"][:, columns]])
    correction, *changes_of_rest = -np.linalg.solve(at.tangent, right).T
    _refuse_motion(at.x, n, correction)
    moved = np.zeros((len(at.x), len(columns)))
    moved[at.free] = np.transpose(changes_of_rest)

    changes: dict[str, list[Array]] = {key: [] for key in ("A", "B", "B_p", "C", "D", "D_p")}
    sources = output(x=at.x, u=at.u, p=at.p)
    nominal = {f"out_{key}": sources[key] for key in output.name_out()}
    along = _functions(model, motion).along_output
    for by_x, by_p in zip(moved.T, np.eye(len(at.p))[columns], strict=True):
        for key, change in _matrices(n, at.blocks, at.along(by_x, by_p)).items():
            changes[key].append(change)
        seeds = {"fwd_x": by_x, "fwd_u": np.zeros(len(at.u)), "fwd_p": by_p}
        found = along(x=at.x, u=at.u, p=at.p, **nominal, **seeds)
        for key in output.name_out():
            changes[key].append(found[f"fwd_{key}"].full())
    arrays = {key: np.array(change) for key, change in changes.items()}
    return DesignDerivatives(linear=linear, labels=labels, x=moved, **arrays)


def flutter_derivatives(found: Flutter, names: Sequence[str]) -> dict[str, Array]:
    """Derivatives of the flutter speed by parameters of the model, about the moving equilibrium.

    At flutter Re λ = 1e-5 |λ| for the root of `found`; its derivatives by airspeed and parameters
    move that speed.

    Parameters
    ----------
    found : Flutter
        With a flutter speed.
    names : sequence of str
        Parts of p other than airspeed.

    Returns
    -------
    dict of str to array
        The derivative by each entry of a part, m/s over its unit.

    Raises
    ------
    ValueError
        If nothing flutters, or as `design_derivatives`.
    """
    instance("found", found, Flutter)
    if found.speed is None or found.frequency is None or found.equilibrium is None:
        raise ValueError("found: expected a sweep with a flutter speed, found none")
    derived = _at(found, found.equilibrium, found.speed, names)
    roots, slopes = derived.roots
    k = int(np.argmin(np.abs(roots - 1j * found.frequency)))
    growth = slopes[k].real - GROWTH * np.real(roots[k].conj() * slopes[k]) / abs(roots[k])
    return parts_of(found.model.p, names, -growth[1:] / growth[0])


def beside_airspeed(names: Sequence[str]) -> tuple[str, ...]:
    """`names` of design parameters, none of which is the airspeed that they change."""
    names = sequence("names", names)
    if "airspeed" in names:
        raise ValueError("names: expected parameters other than airspeed, found it")
    return names


def _at(found: Flutter, x: Array, speed: float, names: Sequence[str]) -> DesignDerivatives:
    names = beside_airspeed(names)
    p = found.p.copy()
    p[found.model.p.slices["airspeed"]] = speed
    return design_derivatives(linearize(found.model, x, found.u, p), ["airspeed", *names])


def parts_of(layout: Layout, names: Sequence[str], values: Array) -> dict[str, Array]:
    """Entries of parts of a layout by their names."""
    sizes = [layout.slices[name].stop - layout.slices[name].start for name in names]
    return dict(zip(names, np.split(values, np.cumsum(sizes)[:-1]), strict=True))


def motion_of(model: ControlModel) -> SecondOrder:
    """Its equations of motion, which hold no attitude."""
    if model.second_order is None or any(part.attitude for part in model.x.parts):
        raise ValueError(
            "linear: expected a model with equations of motion and without attitudes, as "
            f"wing_model makes it; found {model!r}"
        )
    return model.second_order


def columns_of(layout: Layout, names: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
    """Indices of the entries of parts, and a label of each."""
    known = [part.name for part in layout.parts]
    found: list[int] = []
    labels: list[str] = []
    for name in sequence("names", names):
        rows = range(layout.size)[layout.slices[choice("names", name, known)]]
        found += rows
        labels += [f"{name}[{i}]" for i in range(len(rows))]
    return np.array(found, dtype=int), tuple(labels)


def _refuse_motion(x: Array, n: int, correction: Array) -> None:
    """Refuse a state that is not steady: that Newton's method would correct, or that moves."""
    size = max(float(np.abs(x[:n]).max()), SMALLEST)
    missed = float(np.abs(correction[:n]).max())
    if np.any(x[n : 2 * n] != 0) or missed > AT_REST * size:
        raise ValueError(
            "linear: expected a linear model about a steady state, such as `Flutter.equilibria`; "
            f"found one {missed:.3g} rad/m from it"
        )


class _Functions(NamedTuple):
    """What differentiates a model: slopes of its equations and outputs, and both along a line."""

    equations: ca.Function
    output: ca.Function
    along_equations: ca.Function
    along_output: ca.Function


#: Made once, as long as the model lives.
_MADE: WeakKeyDictionary[ControlModel, _Functions] = WeakKeyDictionary()


def _functions(model: ControlModel, motion: SecondOrder) -> _Functions:
    if model not in _MADE:
        equations, output = _slopes_function(motion), _output_function(model)
        _MADE[model] = _Functions(equations, output, equations.forward(1), output.forward(1))
    return _MADE[model]


@dataclass(frozen=True, eq=False)
class SteadySlopes:
    """The equations r about a steady state, and their slopes by x, a, u and p."""

    functions: _Functions
    x: Array
    u: Array
    p: Array
    values: dict[str, ca.DM]
    n: int  #: number of velocities

    @classmethod
    def of(
        cls, model: ControlModel, motion: SecondOrder, x: Array, u: Array, p: Array
    ) -> SteadySlopes:
        """Those of a model at a state, inputs and parameters."""
        functions, n = _functions(model, motion), motion.velocities
        return cls(functions, x, u, p, functions.equations(x=x, a=np.zeros(n), u=u, p=p), n)

    @property
    def rest(self) -> Array:
        """r, (nv + no,)."""
        return np.asarray(self.values["rest"].full().ravel())

    @property
    def blocks(self) -> dict[str, Array]:
        """Slopes of r by x, a, u and p."""
        return {key: self.values[f"by_{key}"].full() for key in ("x", "a", "u", "p")}

    @property
    def free(self) -> Array:
        """Entries of the state that a steady state may choose: all but velocities."""
        return np.r_[0 : self.n, 2 * self.n : len(self.x)]

    @property
    def tangent(self) -> Array:
        """T = ∂r/∂z, (nv + no, nv + no)."""
        return self.blocks["x"][:, self.free]

    def along(self, by_x: Array, by_p: Array) -> dict[str, Array]:
        """Changes of the slopes along a direction of state and parameters."""
        nominal = {f"out_{key}": value for key, value in self.values.items()}
        seeds = {"fwd_x": by_x, "fwd_a": np.zeros(self.n), "fwd_p": by_p}
        at = {"x": self.x, "a": np.zeros(self.n), "u": self.u, "p": self.p}
        seeds["fwd_u"] = np.zeros(len(self.u))
        found = self.functions.along_equations(**at, **nominal, **seeds)
        return {key: found[f"fwd_by_{key}"].full() for key in ("x", "a", "u", "p")}


def _slopes_function(motion: SecondOrder) -> ca.Function:
    """x, a, u, p -> the equations r, and their slopes by each."""
    names = ["x", "a", "u", "p"]
    symbols = [ca.MX.sym(name, motion.balance.size1_in(i)) for i, name in enumerate(names)]
    rest = ca.vertcat(*motion.balance(*symbols))
    slopes = [ca.densify(ca.jacobian(rest, symbol)) for symbol in symbols]
    outputs = ["rest", *(f"by_{name}" for name in names)]
    return ca.Function("equations", symbols, [rest, *slopes], names, outputs)


def _output_function(model: ControlModel) -> ca.Function:
    """x, u, p -> C, D, D_p."""
    symbols = symbols_of(model)
    outputs = model.output(*symbols)
    slopes = [ca.densify(ca.jacobian(outputs, symbol)) for symbol in symbols]
    return ca.Function("outputs", symbols, slopes, ["x", "u", "p"], ["C", "D", "D_p"])


def _matrices(n: int, blocks: dict[str, Array], changes: dict[str, Array]) -> dict[str, Array]:
    """Changes of A, B and B_p from those of the slopes: accelerations are −M⁻¹ of the balance."""
    mass, d_mass = blocks["a"][:n], changes["a"][:n]
    found = {}
    for name, key in (("A", "x"), ("B", "u"), ("B_p", "p")):
        solved = -np.linalg.solve(mass, blocks[key][:n])
        d_solved = -np.linalg.solve(mass, changes[key][:n] + d_mass @ solved)
        others = changes[key][n:] + changes["a"][n:] @ solved + blocks["a"][n:] @ d_solved
        found[name] = np.vstack([np.zeros((n, solved.shape[1])), d_solved, others])
    return found
