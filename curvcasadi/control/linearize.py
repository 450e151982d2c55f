"""Linear models about a state: A, B, C, D, exact and in error states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from curvcasadi.control.error_state import add, in_error_state
from curvcasadi.control.model import ControlModel, symbols_of
from curvcasadi.control.signals import held_within_bounds, stacked, with_nominal
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import Array, Number, instance
from curvcasadi.symbolic.layout import Layout


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearModel:
    """dδ/dt = A δ + B du + B_p dp, dy = C δ + D du + D_p dp, about a state of a control model.

    Attributes
    ----------
    model : ControlModel
        The model that was linearized; `model.x.errors` names the entries of δ.
    A : array, shape (nd, nd)
        Of the error state; for attitudes of a rotation vector, rad, in local axes.
    B, B_p : array, shape (nd, nu), (nd, np)
        By inputs and by parameters (gusts, say).
    C : array, shape (ny, nd)
        Of the outputs.
    D, D_p : array, shape (ny, nu), (ny, np)
        Of the outputs by inputs and parameters.
    x, u, p : array
        Where it was linearized.
    """

    model: ControlModel
    A: Array
    B: Array
    C: Array
    D: Array
    B_p: Array
    D_p: Array
    x: Array
    u: Array
    p: Array

    @property
    def eigenvalues(self) -> Array:
        """Eigenvalues of A, complex, 1/s, by their magnitude."""
        values = np.linalg.eigvals(self.A)
        return np.asarray(values[np.argsort(np.abs(values), kind="stable")])

    def to_control(self) -> Any:
        """A `control.StateSpace` of python-control with named states, inputs and outputs.

        Returns
        -------
        control.StateSpace
            With named states, inputs and outputs.

        Raises
        ------
        ImportError
            If python-control is not installed: ``pip install "curvcasadi[control]"``.
        """
        try:
            import control
        except ImportError as error:
            raise ImportError(
                'to_control needs python-control: pip install "curvcasadi[control]"'
            ) from error
        model = self.model
        names = {
            "states": _names(model.x.errors),
            "inputs": _names(model.u),
            "outputs": _names(model.y),
        }
        return control.ss(self.A, self.B, self.C, self.D, name=model.name, **names)

    def save_mat(self, path: str | Path) -> None:
        """Write the matrices, the point at which they hold and the labels to a MATLAB file.

        Parameters
        ----------
        path : str or Path
            File to write.
        """
        from scipy.io import savemat

        model = self.model
        arrays = {key: getattr(self, key) for key in ("A", "B", "C", "D", "B_p", "D_p")}
        columns = {key: getattr(self, key)[:, None] for key in ("x", "u", "p")}
        labels = {
            "states": np.array(model.x.errors.labels, dtype=object),
            "inputs": np.array(model.u.labels, dtype=object),
            "outputs": np.array(model.y.labels, dtype=object),
        }
        savemat(path, {**arrays, **columns, **labels})

    def __repr__(self) -> str:
        sizes = ", ".join(f"{len(m)} {n}" for m, n in ((self.A, "states"), (self.C, "outputs")))
        return f"<LinearModel of {self.model.name}: {sizes}>"

    def __str__(self) -> str:
        rows = [f"{self.model.name}, linear about a state: eigenvalues, 1/s"]
        for value in self.eigenvalues[:12]:
            rows.append(f"  {value.real:12.5g} {value.imag:+12.5g}j")
        if len(self.A) > 12:
            rows.append(f"  and {len(self.A) - 12} faster ones")
        return "\n".join(rows)


def linearize(
    model: ControlModel,
    x: Number | Mapping[str, Number],
    u: Number | Mapping[str, Number] | None = None,
    p: Number | Mapping[str, Number] | None = None,
) -> LinearModel:
    """The linear model about a state, by the model's structured derivatives.

    Parameters
    ----------
    model : ControlModel
        Model.
    x : array, shape (nx,), or mapping of str to array
        State; of a mapping, parts that it leaves out are zero, attitudes level. It need not be an
        equilibrium: A is then the derivative along the motion.
    u, p : array or mapping, optional
        Inputs, zero unless given, and parameters; those without a nominal value, such as the
        airspeed, have to be given.

    Returns
    -------
    LinearModel
        Matrices, and the point at which they hold.

    Raises
    ------
    ValueError
        If an argument has a wrong size, parameters are missing, or an input or parameter leaves its
        bounds (an angle without any: ±π/2).
    """
    instance("model", model, ControlModel)
    at = [
        stacked("x", model.x, x),
        held_within_bounds("u", model.u, u),
        held_within_bounds("p", model.p, with_nominal("p", model.p, p)),
    ]
    blocks = [block.full() for block in _derivatives(model)(*at)]
    a, b, b_p, c, d, d_p = blocks
    return LinearModel(model=model, A=a, B=b, C=c, D=d, B_p=b_p, D_p=d_p, x=at[0], u=at[1], p=at[2])


def _names(layout: Layout) -> list[str]:
    """Entries without their units, which python-control does not take."""
    return [label.partition(",")[0] for label in layout.labels]


#: Functions of models, as long as these live.
_MADE: WeakKeyDictionary[ControlModel, ca.Function] = WeakKeyDictionary()


def _derivatives(model: ControlModel) -> ca.Function:
    if model not in _MADE:
        _MADE[model] = _made(model)
    return _MADE[model]


def _made(model: ControlModel) -> ca.Function:
    """(x, u, p) -> A, B, B_p, C, D, D_p.

    With x = x0 ⊕ δ and the rates of δ, r(x) = E⁺(x) xdot(x) for attitudes q̇ = ½ q ∘ (0, Ω):
    dδ/dt = δΩ − Ω × δ, and plain differences of everything else.
    """
    x, u, p = symbols_of(model)
    delta = ca.MX.sym("delta", model.x.errors.size)
    moved = add(model.x, x, delta)
    rates, omegas = _error_rates(model, moved, model.xdot(moved, u, p))
    outputs = model.output(moved, u, p)
    slopes = [ca.jacobian(f, by) for f in (rates, outputs) for by in (delta, u, p)]
    for name, omega in omegas.items():
        rows = model.x.errors.slices[name]
        slopes[0][rows, rows] -= so3.hat(omega)
    slopes = ca.substitute(slopes, [delta], [ca.MX.zeros(*delta.shape)])
    return ca.Function("derivatives", [x, u, p], [ca.densify(slope) for slope in slopes])


def _error_rates(model: ControlModel, x: ca.MX, xdot: ca.MX) -> tuple[ca.MX, dict[str, ca.MX]]:
    """Rates of the state in its own axes, and body rates of its attitudes."""
    rates = in_error_state(model.x, x, xdot)
    parts = model.x.errors.split(rates)
    return rates, {part.name: parts[part.name] for part in model.x.parts if part.attitude}
