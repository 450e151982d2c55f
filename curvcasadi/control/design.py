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
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from curvcasadi.control.flutter import Flutter
from curvcasadi.control.linearize import LinearModel, linearize
from curvcasadi.control.model import ControlModel, SecondOrder
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
    model, motion = linear.model, _motion(linear.model)
    columns, labels = _columns(model.p, names)
    n, x, p = motion.velocities, linear.x, linear.p
    at = {"x": x, "a": np.zeros(n), "u": linear.u, "p": p}
    equations, output, *along = _functions(model, motion)
    values = equations(**at)
    blocks = {key: values[f"by_{key}"].full() for key in ("x", "a", "u", "p")}
    free = np.r_[0:n, 2 * n : len(x)]
    right = np.column_stack([values["rest"].full(), blocks["p"][:, columns]])
    correction, *changes_of_rest = -np.linalg.solve(blocks["x"][:, free], right).T
    _refuse_motion(x, n, correction)
    moved = np.zeros((len(x), len(columns)))
    moved[free] = np.transpose(changes_of_rest)

    changes: dict[str, list[Array]] = {key: [] for key in ("A", "B", "B_p", "C", "D", "D_p")}
    directions = np.zeros((len(columns), len(p)))
    directions[np.arange(len(columns)), columns] = 1.0
    sources = output(x=x, u=linear.u, p=p)
    for by_x, by_p in zip(moved.T, directions, strict=True):
        seeds = {"fwd_x": by_x, "fwd_a": np.zeros(n), "fwd_p": by_p}
        seeds["fwd_u"] = np.zeros(len(linear.u))
        nominal = {f"out_{key}": values[key] for key in equations.name_out()}
        found = along[0](**at, **nominal, **seeds)
        slopes = {key: found[f"fwd_by_{key}"].full() for key in blocks}
        for key, change in _matrices(n, blocks, slopes).items():
            changes[key].append(change)
        nominal = {f"out_{key}": sources[key] for key in output.name_out()}
        seeds.pop("fwd_a")
        found = along[1](x=x, u=linear.u, p=p, **nominal, **seeds)
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
    return _split(found.model.p, names, -growth[1:] / growth[0])


def divergence_derivatives(found: Flutter, names: Sequence[str]) -> dict[str, Array]:
    """Derivatives of the divergence speed by parameters of the model.

    Of a wing whose equilibrium at divergence does not depend on speed and parameters, as that of a
    straight one in level flow: there a root is zero.

    Parameters
    ----------
    found : Flutter
        With a divergence speed.
    names : sequence of str
        Parts of p other than airspeed.

    Returns
    -------
    dict of str to array
        The derivative by each entry of a part, m/s over its unit.

    Raises
    ------
    ValueError
        If there is no divergence, or as `design_derivatives`.
    """
    instance("found", found, Flutter)
    if found.divergence_speed is None or found.divergence_equilibrium is None:
        raise ValueError("found: expected a sweep with a divergence speed, found none")
    derived = _at(found, found.divergence_equilibrium, found.divergence_speed, names)
    roots, slopes = derived.roots
    k = int(np.argmin(np.abs(roots)))
    return _split(found.model.p, names, -slopes[k, 1:].real / slopes[k, 0].real)


def _at(found: Flutter, x: Array, speed: float, names: Sequence[str]) -> DesignDerivatives:
    names = sequence("names", names)
    if "airspeed" in names:
        raise ValueError("names: expected parameters other than airspeed, found it")
    p = found.p.copy()
    p[found.model.p.slices["airspeed"]] = speed
    return design_derivatives(linearize(found.model, x, found.u, p), ["airspeed", *names])


def _split(layout: Layout, names: Sequence[str], values: Array) -> dict[str, Array]:
    sizes = [layout.slices[name].stop - layout.slices[name].start for name in names]
    return dict(zip(names, np.split(values, np.cumsum(sizes)[:-1]), strict=True))


def _motion(model: ControlModel) -> SecondOrder:
    if model.second_order is None or any(part.attitude for part in model.x.parts):
        raise ValueError(
            "linear: expected a model with equations of motion and without attitudes, as "
            f"wing_model makes it; found {model!r}"
        )
    return model.second_order


def _columns(layout: Layout, names: Sequence[str]) -> tuple[Array, tuple[str, ...]]:
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


#: What differentiates a model: made once, as long as it lives.
_MADE: WeakKeyDictionary[ControlModel, tuple[ca.Function, ...]] = WeakKeyDictionary()


def _functions(model: ControlModel, motion: SecondOrder) -> tuple[ca.Function, ...]:
    """Slopes of the equations and of the outputs, and the derivatives of both along a direction."""
    if model not in _MADE:
        equations, output = _slopes_function(model, motion), _output_function(model)
        _MADE[model] = equations, output, equations.forward(1), output.forward(1)
    return _MADE[model]


def _slopes_function(model: ControlModel, motion: SecondOrder) -> ca.Function:
    """x, a, u, p -> the equations r, and their slopes by each."""
    symbols = [
        ca.MX.sym(key, motion.balance.size1_in(i)) for i, key in enumerate(("x", "a", "u", "p"))
    ]
    rest = ca.vertcat(*motion.balance(*symbols))
    slopes = [ca.densify(ca.jacobian(rest, symbol)) for symbol in symbols]
    names = ["x", "a", "u", "p"]
    outputs = ["rest", *(f"by_{name}" for name in names)]
    return ca.Function("equations", symbols, [rest, *slopes], names, outputs)


def _output_function(model: ControlModel) -> ca.Function:
    """x, u, p -> C, D, D_p."""
    symbols = [
        ca.MX.sym(key, layout.size)
        for key, layout in (("x", model.x), ("u", model.u), ("p", model.p))
    ]
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
