"""Static equilibrium of a loaded beam: S q = Q(q)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam, numeric_length
from curvcasadi.errors import ConvergenceError
from curvcasadi.kinematics.shape import Shape, shape_map
from curvcasadi.kinematics.weights import exceeded_limit
from curvcasadi.loads.stations import Load
from curvcasadi.statics.balance import balance
from curvcasadi.symbolic.expressions import AnyExpr, Array, expression
from curvcasadi.symbolic.functions import free_symbols
from curvcasadi.symbolic.text import described, shown

#: Residual that counts as zero, over the largest of the elastic and the applied forces.
TOLERANCE = 1e-11
#: Largest step of a weight times the length, rad, that one Newton iteration takes.
_LARGEST_STEP = 1.5
#: Largest change, rad, of a weight times the length from predictor to corrector on the same branch.
_SAME_BRANCH = 1.0
_ITERATIONS = 20
_LEAST_LOAD_STEP = 1e-7
#: Largest load step over which the tangent may become singular, as it does at a bifurcation.
_CROSSING_STEP = 2e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class Equilibrium:
    """Weights at which the elastic moments balance the loads.

    Attributes
    ----------
    q : DM, shape (n, 1)
        Curvature weights, rad/m.
    shape : Shape
        Shape at these weights.
    residual_norm : float
        Largest entry of S q − Q, N m².
    iterations : int
        Newton iterations, of all load steps.
    load_steps : int
        Number of load steps; 1 where the full load was solved at once.
    load_factor : float
        Part of the loads that is balanced; 1 for all.
    message : str
        What was found, in words.
    """

    q: ca.DM
    shape: Shape
    residual_norm: float
    iterations: int
    load_steps: int
    load_factor: float = 1.0
    message: str = "the loads are balanced"

    @property
    def success(self) -> bool:
        """Whether all of the loads are balanced."""
        return self.load_factor == 1

    def __repr__(self) -> str:
        return f"<Equilibrium: {self.message}>"

    def __str__(self) -> str:
        rows = {
            "q": shown(self.q, "rad/m"),
            "tip": str(self.shape.tip),
            "residual": f"{self.residual_norm:.2g} N m², the largest of S q − Q",
            "solved": f"{self.iterations} Newton iterations in {self.load_steps} load steps",
        }
        return described(f"Equilibrium: {self.message}", rows)


def solve_equilibrium(
    beam: Beam,
    loads: Sequence[Load],
    q_guess: AnyExpr | None = None,
    *,
    attitude: AnyExpr | None = None,
) -> Equilibrium:
    """Equilibrium of `beam` under `loads`, on the branch that grows from the unloaded shape.

    Newton's method with the structured tangent. If that goes further from the unloaded shape than
    1.5 rad (a weight times the length), fails, or ends where the branch cannot have come without a
    singular tangent, the loads grow in steps: each is predicted along the tangent of the branch and
    corrected by Newton. A step that leaves the predictor's neighbourhood is repeated at half its
    size, and only a small one may pass a singular tangent, as a bifurcation has.

    Parameters
    ----------
    beam : Beam
        Numeric, with a section.
    loads : sequence of loads
        Such as `Gravity` and `PointForce`.
    q_guess : array, shape (n, 1), optional
        Weights near the equilibrium looked for, rad/m; with them the full load is tried first.
    attitude : array, shape (3, 3), optional
        Rotation from parent to inertial axes, for dead loads and gravity; the identity unless
        given.

    Returns
    -------
    Equilibrium
        Weights, shape, and what it took to find them.

    Raises
    ------
    ConvergenceError
        If the loads cannot be reached, or not within `Beam.weight_bounds` and `Grid.max_angle`; its
        `result` is the last equilibrium, with its load factor and shape.
    ValueError
        For symbols and loads off the beam.
    """
    n = beam.basis.n
    length = numeric_length(beam, "solve_equilibrium")
    newton = _Newton(_loaded_function(beam, loads, attitude), length)
    guess = np.zeros(n)
    if q_guess is not None:
        guess = expression("q_guess", q_guess, (n, 1)).full().ravel()

    q = newton.correct(guess, 1.0, largest=np.inf if q_guess is not None else _LARGEST_STEP)
    if q is not None and not exceeded_limit(beam, q):
        if q_guess is not None or not newton.crossings(q, 1.0):
            return _equilibrium(beam, newton, q, 1.0, steps=1)
    return _continue(beam, newton, np.zeros(n))


def _loaded_function(beam: Beam, loads: Sequence[Load], attitude: AnyExpr | None) -> ca.Function:
    """(q, load factor) -> elastic forces S q, applied forces Q, tangent, all numeric otherwise."""
    q, factor = ca.MX.sym("q", beam.basis.n), ca.MX.sym("load_factor")
    forces = balance(beam, q, loads, attitude, tangent=True)
    tangent = forces.stiffness - factor * forces.applied_slope
    outputs = [forces.elastic, factor * forces.applied, tangent]
    missing = [name for output in outputs for name in free_symbols(output, [q, factor])]
    if missing:
        raise ValueError(
            f"loads: solve_equilibrium needs numbers, found the symbols {', '.join(missing)}; "
            "use equilibrium_function"
        )
    return ca.Function("loaded", [q, factor], outputs, {"cse": True})


class _Newton:
    """Newton's method at a load factor, counting iterations."""

    def __init__(self, function: ca.Function, length: float) -> None:
        self._function, self._length = function, length
        self.iterations = 0

    def evaluate(self, q: Array, factor: float) -> tuple[Array, float, Array]:
        """(residual, the size beside which it counts, tangent)."""
        elastic, applied, tangent = (m.full() for m in self._function(q, factor))
        scale = max(np.max(np.abs(elastic)), np.max(np.abs(applied)))
        return (elastic - applied).ravel(), float(scale), tangent

    def predict(self, q: Array, factor: float) -> Array:
        """dq/d(load factor) along the branch: tangent⁻¹ Q at the full loads."""
        _, _, tangent = self.evaluate(q, factor)
        _, full, _ = self._function(q, 1.0)
        return np.asarray(np.linalg.solve(tangent, full.full().ravel()))

    def correct(self, q: Array, factor: float, largest: float) -> Array | None:
        """Equilibrium near `q`, or None: singular, not converged, or further off than `largest`."""
        start = q
        residual, scale, tangent = self.evaluate(q, factor)
        for _ in range(_ITERATIONS):
            if np.max(np.abs(residual)) <= TOLERANCE * scale:
                return q
            try:
                step = np.linalg.solve(tangent, -residual)
            except np.linalg.LinAlgError:
                return None
            self.iterations += 1
            bend = self._length * np.max(np.abs(step))
            if not np.isfinite(bend):
                return None
            q = q + step * min(1.0, _LARGEST_STEP / bend) if bend else q
            if self._length * np.max(np.abs(q - start)) > largest:
                return None
            residual, scale, tangent = self.evaluate(q, factor)
        return q if np.max(np.abs(residual)) <= 100 * TOLERANCE * scale else None

    def crossings(self, q: Array, factor: float) -> int:
        """Real eigenvalues of the tangent below zero: how often it was singular on the way here.

        It starts positive definite; what jumped to another branch may have one that never crossed.
        """
        _, _, tangent = self.evaluate(q, factor)
        eigenvalues = np.linalg.eigvals(tangent)
        real = np.abs(eigenvalues.imag) <= 1e-9 * np.max(np.abs(eigenvalues))
        return int(np.sum(real & (eigenvalues.real < 0)))


def _continue(beam: Beam, newton: _Newton, q: Array) -> Equilibrium:
    factor, step, steps, crossings = 0.0, 0.25, 0, 0
    reason = "the loads may have a limit there, or be far too large"
    while factor < 1:
        target = min(1.0, factor + step)
        slope = newton.predict(q, factor)
        ahead = (target - factor) * slope
        bend = beam.length * np.max(np.abs(ahead))
        found = None
        if bend <= _LARGEST_STEP:
            found = newton.correct(q + ahead, target, _SAME_BRANCH)
        crossed = crossings if found is None else newton.crossings(found, target)
        if crossed != crossings and step > _CROSSING_STEP:
            found = None  # on the branch itself a small step finds the same crossing
        exceeded = "" if found is None else exceeded_limit(beam, found)
        if exceeded:
            found, reason = None, f"the beam is at its limit: {exceeded}"
        if found is not None:
            q, factor, steps, crossings = found, target, steps + 1, crossed
            step *= 1.5
            continue
        step /= 2
        if step < _LEAST_LOAD_STEP:
            message = (
                f"loads: equilibrium is lost beyond {factor:.4g} of the loads, with the largest "
                f"weight {np.max(np.abs(q)):.3g} rad/m; {reason}"
            )
            last = _equilibrium(beam, newton, q, factor, steps)
            raise ConvergenceError(message, replace(last, message=message))
    return _equilibrium(beam, newton, q, 1.0, steps)


def _equilibrium(beam: Beam, newton: _Newton, q: Array, factor: float, steps: int) -> Equilibrium:
    residual, _, _ = newton.evaluate(q, factor)
    return Equilibrium(
        q=ca.DM(q),
        shape=shape_map(beam, q),
        residual_norm=float(np.max(np.abs(residual))),
        iterations=newton.iterations,
        load_steps=steps,
        load_factor=factor,
    )
