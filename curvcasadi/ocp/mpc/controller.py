"""Model predictive control of any control model."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from curvcasadi.control.model import ControlModel
from curvcasadi.control.signals import stacked
from curvcasadi.control.step import Method
from curvcasadi.ocp.mpc import terms
from curvcasadi.ocp.mpc.problem import RESIDUAL, MpcProblem
from curvcasadi.ocp.mpc.solver import MpcSolver, Solver, default_tolerance
from curvcasadi.solvers.embedded import SolverFunction
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    choice,
    count,
    function_name,
    instance,
    is_numeric,
    numbers,
    positive,
    rotation_matrix,
)
from curvcasadi.symbolic.layout import Layout, Part
from curvcasadi.symbolic.text import described, shown

_SOLVERS = ("rti", "sqp", "ipopt")
_QP_SOLVERS = ("own", "hpipm", "qpoases", "daqp", "qrqp", "osqp", "piqp", "proxqp")
#: Calls that are kept as examples for the self-test of exported C.
_EXAMPLES = 4
#: Half a range from which on it tells nothing of the size of an input.
_UNBOUNDED = 1e10
#: What the length of a quaternion may differ from 1.
_LENGTH = 5e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class MpcStep:
    """What a predictive controller says at one time.

    Attributes
    ----------
    u : array, shape (nu,)
        Input to apply now, within its bounds whatever happened.
    plan : array, shape (nu, N)
        Inputs of all stages, `u` the first.
    states : array, shape (nx, N + 1)
        States along the plan, of the model; NaN where there is none.
    success : bool
        Whether `u` comes from a solution of this call.
    message : str
        What happened, in words.
    violation : float
        Excess over bounds that are not soft, over what counts as none: at most 1 where kept.
    stationarity : float
        Distance from the optimality conditions over its tolerance: at most 1 where they hold.
    slack : dict of str to array, shape (N,)
        Excess over each soft bound, by name, in its unit.
    """

    u: Array
    plan: Array
    states: Array
    success: bool
    message: str
    violation: float
    stationarity: float
    slack: dict[str, Array]

    def __repr__(self) -> str:
        return f"<MpcStep: {self.message.splitlines()[0]}>"

    def __str__(self) -> str:
        rows = {
            "u": shown(self.u),
            "plan": f"{self.plan.shape[1]} stages",
            "violation": f"{self.violation:.2g}, at most 1 where bounds are kept",
            "stationarity": f"{self.stationarity:.2g}, at most 1 at an optimum",
            **{f"slack of {name}": f"{np.max(v):.3g} at most" for name, v in self.slack.items()},
        }
        return described(f"Step of predictive control: {self.message}", rows)


class Mpc:
    """Model predictive control of a `ControlModel`.

    At every step it minimizes, over inputs that are held over the stages,

        ½ Σ_k Σ_outputs weight |y_k − reference_k|² + ½ Σ_k Σ_inputs weight |u_k − reference_k|²
          + ½ Σ_k moves |u_k − u_{k−1}|² + ½ Σ_k soft slack_k²

    over the stages k = 1 … N at whose ends outputs are taken, subject to the model's step, the
    bounds of its layouts and those given. Attitudes are compared on the group, by the rotation
    vector log(R_dᵀ R). Gauss–Newton on the problem condensed to its inputs; the derivatives of the
    stages are those of the model. The object keeps the plan of its last step, from which the next
    one starts, shifted by a stage.

    Parameters
    ----------
    model : ControlModel
        With one input at least.
    dt : float
        Length of a stage, and time between two steps, s.
    horizon : int
        Number N of stages.
    outputs : mapping of str to float or array
        Weights of parts of `model.y`, one or one for each entry; of a rotation one or three.
        Outputs with the word "rotation" in their name are rotations. In 1/unit² of the output.
    inputs, moves : mapping of str to float or array
        Weights of parts of `model.u`, and of their changes from stage to stage.
    bounds : mapping of str to pair
        (lower, upper), numbers or arrays, of inputs, outputs and parts of the state. Bounds of
        parts of the state replace those of the model, infinite ones remove them. Under the name
        "element_angles": squares of the angles of the elements over `Grid.max_angle`; at most 1
        unless given in a `kinematic_model` whose weights may exceed it.
    rate_bounds : mapping of str to float, array or pair
        Bounds of rates per second: of inputs from stage to stage, of parts of the state at the
        starts of stages.
    soft : mapping of str to float
        Weight of the squared excess of a bound of an output or state, which may be exceeded then;
        1/unit².
    solver : {"rti", "sqp", "ipopt"}
        A real-time iteration (one quadratic program, full step), programs until it converges, or
        IPOPT on the same problem.
    qp_solver : str
        "own" becomes self-contained C; in Python it is CasADi's DAQP on the same numbers. Or
        another of CasADi's QP solvers, such as "hpipm", for Python alone.
    states : mapping of str to float or array
        Weights of parts of the state.
    blocks : sequence of int, optional
        Numbers of stages over which each unknown input is held, together `horizon`; one each unless
        given.
    u_trim : array or mapping, optional
        Input that is applied where there is no plan, and the reference of inputs; zero within the
        bounds unless given.
    scales : mapping of str to float
        Sizes of inputs, by which they are made comparable: half their range where bounded, else 1.
    method, substeps, newton : {"rk4", "implicit_midpoint"}, int, bool
        Of the step over a stage, as in `step_function`; implicit for models with inertia unless
        given, and by Newton's method, which converges over long stages.
    damping : float
        Weight of ½ |u − guess|² of scaled inputs in every program, which keeps programs convex
        where no input has a weight, and steps short. Times the largest diagonal entry of the
        objective's Hessian where that is below 1. A converged plan is the same with any.
    max_iter : int
        Quadratic programs at most, where it converges.
    tolerance : float, optional
        Excess of a limit, over half its range, that counts as none: 1e-6 where it converges, 1e-2
        for a real-time iteration, whose plan meets limits that are linear only. Where one bound is
        10 000 times as far as the other, over the nearer one instead.
    compiled : bool, optional
        Whether the stages are compiled to native code; models with inertia are, unless given.
    name : str
        Name of its Functions, also in generated C.

    Attributes
    ----------
    function : casadi.Function
        A step for `export_c`: x, p (np, N), u_previous, reference (ng, N), guess (nu, N) -> u, plan
        (guess of the next step), states, slack, violation, stationarity.

    Raises
    ------
    ValueError
        For names that the model does not have, weights below zero, bounds that contradict each
        other, and a horizon without stages.
    """

    def __init__(
        self,
        model: ControlModel,
        *,
        dt: float,
        horizon: int,
        outputs: Mapping[str, Number] | None = None,
        inputs: Mapping[str, Number] | None = None,
        moves: Mapping[str, Number] | None = None,
        bounds: Mapping[str, Any] | None = None,
        rate_bounds: Mapping[str, Any] | None = None,
        soft: Mapping[str, float] | None = None,
        solver: Solver = "rti",
        qp_solver: str = "own",
        states: Mapping[str, Number] | None = None,
        blocks: Sequence[int] | None = None,
        u_trim: Number | Mapping[str, Number] | None = None,
        scales: Mapping[str, float] | None = None,
        method: Method | None = None,
        substeps: int = 1,
        newton: bool = True,
        damping: float = 1e-8,
        max_iter: int = 50,
        tolerance: float | None = None,
        compiled: bool | None = None,
        name: str = "mpc",
    ) -> None:
        function_name("name", name)
        self.model: ControlModel = instance("model", model, ControlModel)
        if not model.u.size:
            raise ValueError(f"model: expected a model with inputs, found {model!r}")
        choice("solver", solver, _SOLVERS)
        choice("qp_solver", qp_solver, _QP_SOLVERS)
        if not is_numeric(dt):
            raise ValueError(f"dt: expected a number, found the symbol {dt}")
        self.dt, self.horizon = float(positive("dt", dt)), count("horizon", horizon)
        bounds, rate_bounds = bounds or {}, rate_bounds or {}
        limits = terms.limits(model, bounds, rate_bounds, soft or {})
        lower, upper = terms.input_bounds(model, bounds)
        self.u_trim = terms.inputs_at_rest(model, u_trim, lower, upper)
        penalties = (
            *terms.penalties("outputs", "y", model.y, outputs or {}),
            *terms.penalties("states", "x", model.x, states or {}),
        )
        weighed = [penalty.part.name for penalty in penalties]
        if len(set(weighed)) < len(weighed):
            raise ValueError(f"states: expected other names than those of outputs, found {weighed}")
        if not penalties:
            raise ValueError(
                "outputs: expected a weight above zero of an output "
                f"({', '.join(part.name for part in model.y.parts)}), found none"
            )
        of_inputs = terms.penalties("inputs", "u", model.u, inputs or {})
        if method is None:
            method = "rk4" if model.second_order is None else "implicit_midpoint"
        self._problem = MpcProblem(
            model=model,
            name=name,
            dt=self.dt,
            hold=_hold(blocks, self.horizon),
            penalties=(*penalties, *of_inputs),
            moves=terms.input_weights("moves", model.u, moves or {}),
            limits=limits,
            lower=lower,
            upper=upper,
            rates=terms.input_rates(model, rate_bounds),
            scale=_scales(model.u, scales or {}, lower, upper),
            is_implicit=method != "rk4",
            damping=float(positive("damping", damping, zero=True)),
        )
        self._solver = MpcSolver(
            problem=self._problem,
            solver=solver,
            qp_solver=qp_solver,
            max_iter=count("max_iter", max_iter),
            tolerance=float(positive("tolerance", tolerance))
            if tolerance is not None
            else default_tolerance(model.real, solver),
            method=method,
            substeps=count("substeps", substeps),
            newton=bool(newton),
        )
        self._native = model.second_order is not None if compiled is None else bool(compiled)
        self._calls: deque[list[Array]] = deque(maxlen=_EXAMPLES)
        self.reset()

    def __repr__(self) -> str:
        return (
            f"<Mpc {self._problem.name}: {self.model.name}, {self.horizon} stages of {self.dt:g} s>"
        )

    @cached_property
    def function(self) -> SolverFunction:
        """A step as a Function that `export_c` writes as C."""
        return self._solver.function(native=False)

    @cached_property
    def _host(self) -> SolverFunction:
        return self._solver.function(native=True) if self._native else self.function

    def reset(self, u: Number | Mapping[str, Number] | None = None) -> None:
        """Forget the plan: the next step starts from the trimmed input.

        Parameters
        ----------
        u : array or mapping, optional
            Input that was applied last; the trimmed one unless given.
        """
        self._applied = self.u_trim.copy() if u is None else stacked("u", self.model.u, u)
        self._plan = np.tile(self.u_trim[:, None], self.horizon)
        self._left = 0

    @property
    def examples(self) -> list[list[Array]]:
        """Inputs of `function` in the last steps that succeeded: what exported C is tested with.

        Before there is one: those of a step from rest, with all parameters zero.
        """
        if self._calls:
            return [*self._calls]
        return [self._inputs({}, None, {}, {})]

    @property
    def descriptions(self) -> dict[str, str]:
        """Contents of the inputs and outputs of `function`, in words."""
        goals = ", ".join(f"{p.part.name} ({p.part.size})" for p in self._problem.penalties)
        soft = ", ".join(limit.name for limit in self._problem.soft)
        return {
            "x": f"state: {_listed(self.model.x)}",
            "p": f"parameters, one stage a column: {_listed(self.model.p)}",
            "u_previous": f"input applied before: {_listed(self.model.u)}",
            "reference": f"one stage a column: {goals}",
            "guess": "plan of the step before, one stage a column",
            "slack": f"excess over soft bounds, one stage a column: {soft or 'none'}",
        }

    def step(
        self,
        x: Number | Mapping[str, Number],
        p: Number | Mapping[str, Number] | None = None,
        reference: Mapping[str, Number] | None = None,
        preview: Mapping[str, Number] | None = None,
    ) -> MpcStep:
        """The input to apply now, from the state.

        Parameters
        ----------
        x : array, shape (nx,), or mapping of str to array
            State. Parts that a mapping leaves out are zero, attitudes the identity.
        p : array, shape (np,), or mapping of str to array, optional
            Parameters over the whole horizon; zero unless given.
        reference : mapping of str to array, optional
            By name of an output, state or input with a weight: values, or columns, one for the end
            of each stage; a rotation as a matrix (3, 3), or columns (9, N). Zero unless given, for
            attitudes the identity, for inputs the trimmed one.
        preview : mapping of str to array, optional
            By name of a parameter: columns, one for each stage, in place of p.

        Returns
        -------
        MpcStep
            Where the step has not succeeded, with the input that the last plan has for this time,
            or, where that is used up, the trimmed one.

        Raises
        ------
        ValueError
            For unknown names, wrong sizes, and numbers that are not finite. The controller is as it
            was then: `fallback` gives an input.
        """
        inputs = self._inputs(x, p, reference or {}, preview or {})
        found = dict(zip(self._host.name_out(), self._host.call(inputs), strict=True))
        numeric = {key: value.full() for key, value in found.items()}
        violation, stationarity = (float(numeric[k][0, 0]) for k in ("violation", "stationarity"))
        solved = all(np.all(np.isfinite(value)) for value in numeric.values()) and stationarity <= 1
        if not solved:
            return self.fallback(
                _unsolved(violation, stationarity, self._solver.tolerance), violation, stationarity
            )
        u, shifted = numeric["u"].ravel(), numeric["plan"]
        kept = violation <= 1
        if kept:
            self._calls.append(inputs)
        self._applied, self._plan, self._left = u, shifted, self.horizon - 1
        return MpcStep(
            u=u.copy(),
            plan=np.column_stack([u, shifted[:, :-1]]),
            states=numeric["states"],
            success=kept,
            message="solved" if kept else self._exceeded(numeric["states"], inputs, violation),
            violation=violation,
            stationarity=stationarity,
            slack=self._slacks(numeric["slack"]),
        )

    def fallback(
        self,
        message: str = "no measurement",
        violation: float = np.nan,
        stationarity: float = np.nan,
    ) -> MpcStep:
        """The input for a time without a solution: that of the last plan, then the trimmed one.

        Parameters
        ----------
        message : str
            Why there is none.
        violation, stationarity : float
            As in `MpcStep`.

        Returns
        -------
        MpcStep
            Without success; the controller goes on from its plan.
        """
        planned = self._left > 0
        u = self._plan[:, 0].copy() if planned else self.u_trim.copy()
        plan = self._plan.copy() if planned else np.tile(u[:, None], self.horizon)
        self._plan = np.column_stack([plan[:, 1:], plan[:, -1]])
        self._left = max(self._left - 1, 0)
        if not self._left:
            self._plan = np.tile(self.u_trim[:, None], self.horizon)
        self._applied = u
        what = "the input planned before" if planned else "the trimmed input"
        return MpcStep(
            u=u,
            plan=plan,
            states=np.full((self.model.x.size, self.horizon + 1), np.nan),
            success=False,
            message=f"{message}; {what} is applied",
            violation=violation,
            stationarity=stationarity,
            slack={limit.name: np.full(self.horizon, np.nan) for limit in self._problem.soft},
        )

    def _inputs(
        self, x: Any, p: Any, reference: Mapping[str, Number], preview: Mapping[str, Number]
    ) -> list[Array]:
        """Inputs of `function`."""
        if x is None:
            raise ValueError(f"x: expected the state ({_listed(self.model.x)}), found None")
        return [
            stacked("x", self.model.x, x)[:, None],
            self._parameters(p, preview),
            self._applied[:, None],
            self._references(reference),
            self._plan,
        ]

    def _exceeded(self, states: Array, inputs: list[Array], violation: float) -> str:
        """Why a plan of a solved program does not count."""
        problem, parameters = self._problem, inputs[1]
        if problem.is_implicit:
            step, plan = self._solver.step(), np.column_stack([self._applied, self._plan])
            residuals = [
                float(step(states[:, k], plan[:, k], parameters[:, k])[1])
                for k in range(self.horizon)
            ]
            worst = int(np.argmax(residuals))
            if not residuals[worst] <= RESIDUAL:
                return (
                    f"the model's step over stage {worst} does not converge, its residual is "
                    f"{residuals[worst]:.1g}; use a shorter dt or more substeps"
                )
        excess = violation * self._solver.tolerance
        return f"bounds exceeded along the plan by {excess:.2g} of half their range"

    def _slacks(self, values: Array) -> dict[str, Array]:
        return {
            limit.name: np.maximum(row, 0.0)
            for limit, row in zip(self._problem.soft, values, strict=True)
        }

    def _parameters(self, p: Any, preview: Mapping[str, Number]) -> Array:
        """(np, N) parameters of the stages."""
        layout = self.model.p
        values = np.tile(stacked("p", layout, p)[:, None], self.horizon)
        for key, value in instance("preview", preview, Mapping).items():
            part = _known("preview", layout.parts, key)
            values[layout.slices[key]] = _columns(f"preview[{key!r}]", part, value, self.horizon)
        return values

    def _references(self, reference: Mapping[str, Number]) -> Array:
        """(ng, N) references of the stages."""
        penalties = self._problem.penalties
        for key in instance("reference", reference, Mapping):
            _known("reference", tuple(penalty.part for penalty in penalties), key)
        rows = []
        for penalty in penalties:
            part, name = penalty.part, f"reference[{penalty.part.name!r}]"
            if part.name in reference:
                value = reference[part.name]
                if penalty.is_rotation and _shape(value) == (3, 3):
                    value = rotation_matrix(name, value).full().ravel(order="F")
                found = _columns(name, part, value, self.horizon)
                _check_attitudes(name, penalty, found)
                rows.append(found)
            else:
                rows.append(np.tile(self._neutral(penalty)[:, None], self.horizon))
        return np.concatenate([np.zeros((0, self.horizon)), *rows])

    def _neutral(self, penalty: terms.Penalty) -> Array:
        """The reference unless one is given."""
        if penalty.is_rotation:
            return np.tile(np.eye(3).ravel(), penalty.part.size // 9)
        if penalty.source == "u":
            return self.u_trim[self.model.u.slices[penalty.part.name]]
        size = penalty.part.size
        return np.eye(size)[0] if penalty.part.attitude else np.zeros(size)


def _hold(blocks: Sequence[int] | None, horizon: int) -> tuple[int, ...]:
    """Index of the unknown input of each stage."""
    if blocks is None:
        return tuple(range(horizon))
    lengths = [count("blocks", length) for length in instance("blocks", blocks, Iterable)]
    if sum(lengths) != horizon:
        raise ValueError(f"blocks: expected lengths of sum {horizon}, the horizon, found {blocks}")
    return tuple(i for i, length in enumerate(lengths) for _ in range(length))


def _scales(layout: Layout, scales: Mapping[str, float], lower: Array, upper: Array) -> Array:
    half = terms.sizes(lower, upper)
    found = np.where((half > 0) & (half < _UNBOUNDED), half, 1.0)
    for key, value in instance("scales", scales, Mapping).items():
        _known("scales", layout.parts, key)
        rows, scale = layout.slices[key], float(positive(f"scales[{key!r}]", value))
        least = np.min(half[rows], where=half[rows] > 0, initial=np.inf)
        if scale > terms.WIDE * least:
            raise ValueError(
                f"scales[{key!r}]: expected the size of an input with half the range {least:g}, "
                f"found {scale:g}"
            )
        found[rows] = scale
    return found


def _known(name: str, parts: Sequence[Part], key: str) -> Part:
    for part in parts:
        if part.name == key:
            return part
    names = ", ".join(part.name for part in parts) or "none"
    raise ValueError(f"{name}: expected names among {names}, found {key!r}")


def _shape(value: Number) -> tuple[int, ...]:
    """Shape of an array or of a DM, which numpy is not asked for."""
    return tuple(value.shape) if hasattr(value, "shape") else np.shape(value)


def _listed(layout: Layout) -> str:
    return ", ".join(f"{part.name} ({part.size}, {part.unit})" for part in layout.parts) or "none"


def _columns(name: str, part: Part, value: Number, n: int) -> Array:
    """(size, n) of numbers that are held, or of columns."""
    array = numbers(name, value)
    if array.size == part.size and (array.ndim < 2 or array.shape == (part.size, 1)):
        return np.tile(array.reshape(-1, 1), n)
    if array.shape == (part.size, n) or (part.size == 1 and array.shape == (n,)):
        return array.reshape(part.size, n)
    raise ValueError(
        f"{name}: expected {part.size} numbers or columns ({part.size}, {n}), "
        f"found shape {array.shape}"
    )


def _check_attitudes(name: str, penalty: terms.Penalty, columns: Array) -> None:
    """Refuse columns of rotations that are none, and quaternions of another length than 1."""
    if penalty.is_rotation:
        for matrix in columns.T.reshape(-1, 3, 3):
            rotation_matrix(name, matrix.T)
    elif penalty.part.attitude:
        lengths = np.linalg.norm(columns, axis=0)
        worst = lengths[np.argmax(np.abs(lengths - 1))]
        if abs(worst - 1) > _LENGTH:
            raise ValueError(f"{name}: expected unit quaternions, found one of length {worst:g}")


def _unsolved(violation: float, stationarity: float, tolerance: float) -> str:
    if not (np.isfinite(violation) and np.isfinite(stationarity)):
        return "the model leaves the numbers along the plan"
    if violation > 1:
        return (
            "no plan within the bounds found: the last one tried exceeds them by "
            f"{violation * tolerance:.2g} of half their range"
        )
    return f"not converged: {stationarity:.2g} times the tolerance from the optimality conditions"
