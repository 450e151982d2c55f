"""Model predictive control of any control model."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from curvcasadi.control.linearize import LinearModel
from curvcasadi.control.model import ControlModel
from curvcasadi.control.signals import stacked
from curvcasadi.control.step import Method
from curvcasadi.ocp.mpc import arguments, reasons, signals
from curvcasadi.ocp.mpc.functions import ModelFunctions
from curvcasadi.ocp.mpc.plan import Plan
from curvcasadi.ocp.mpc.problem import MpcProblem
from curvcasadi.ocp.mpc.result import MpcStep
from curvcasadi.ocp.mpc.solver import MpcSolver, Solver, default_tolerance
from curvcasadi.ocp.mpc.terminal import terminal_cost
from curvcasadi.solvers.embedded import SolverFunction
from curvcasadi.symbolic.expressions import (
    Array,
    Number,
    choice,
    copied,
    count,
    function_name,
    instance,
    is_numeric,
    positive,
)
from curvcasadi.symbolic.layout import Layout

_SOLVERS = ("rti", "sqp", "ipopt")
_QP_SOLVERS = ("own", "hpipm", "qpoases", "daqp", "qrqp", "osqp", "piqp", "proxqp")
#: Calls that are kept as examples for the self-test of exported C.
_EXAMPLES = 4


class Mpc:
    """Model predictive control of a `ControlModel`.

    At every step it minimizes, over inputs that are held over the stages,

        ½ Σ_k Σ_outputs weight |y_k − reference_k|² + ½ Σ_k Σ_inputs weight |u_k − reference_k|²
          + ½ Σ_k moves |u_k − u_{k−1}|² + ½ Σ_k soft slack_k² + terminal cost

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
        another of CasADi's QP solvers, such as "hpipm", for Python alone; none with IPOPT.
    states : mapping of str to float or array
        Weights of parts of the state.
    terminal : LinearModel, optional
        `linearize(model, x, u, p)` at an equilibrium: the end of the last stage then costs what the
        linear regulator needs from there in infinite time without bounds, ½ zᵀ P z of Riccati's
        equation with the weights above. References and the trimmed input are those of the
        equilibrium unless given; others do not move the end that the cost asks for.
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
        other, a horizon without stages, and a terminal cost that does not exist.
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
        terminal: LinearModel | None = None,
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
        self._arguments = copied({key: value for key, value in locals().items() if key != "self"})
        function_name("name", name)
        self.model: ControlModel = instance("model", model, ControlModel)
        if not model.u.size:
            raise ValueError(f"model: expected a model with inputs, found {model!r}")
        method = arguments.method(model, method)
        choice("solver", solver, _SOLVERS)
        choice("qp_solver", qp_solver, _QP_SOLVERS)
        if solver == "ipopt" and qp_solver != "own":
            raise ValueError(
                "qp_solver: expected 'own', the default, with solver='ipopt', which solves no "
                f"quadratic programs, found {qp_solver!r}"
            )
        if not is_numeric(dt):
            raise ValueError(f"dt: expected a number, found the symbol {dt}")
        self.dt, self.horizon = float(positive("dt", dt)), count("horizon", horizon)
        bounds, rate_bounds = bounds or {}, rate_bounds or {}
        limits = arguments.limits(model, bounds, rate_bounds, soft or {})
        lower, upper = arguments.input_bounds(model, bounds)
        if u_trim is None and isinstance(terminal, LinearModel):
            u_trim = terminal.u
        self.u_trim = arguments.inputs_at_rest(model, u_trim, lower, upper)
        functions = ModelFunctions(
            model=model,
            dt=self.dt,
            method=method,
            substeps=count("substeps", substeps),
            newton=bool(newton),
        )
        self._problem = MpcProblem(
            model=model,
            name=name,
            dt=self.dt,
            hold=arguments.hold(blocks, self.horizon),
            penalties=arguments.all_penalties(model, outputs or {}, states or {}, inputs or {}),
            moves=arguments.input_weights("moves", model.u, moves or {}),
            limits=limits,
            lower=lower,
            upper=upper,
            rates=arguments.input_rates(model, rate_bounds),
            scale=arguments.scales(model.u, scales or {}, lower, upper),
            is_implicit=method != "rk4",
            damping=float(positive("damping", damping, zero=True)),
        )
        if terminal is not None:
            cost = terminal_cost(self._problem, functions, terminal)
            self._problem = replace(self._problem, terminal=cost)
        self._solver = MpcSolver(
            problem=self._problem,
            functions=functions,
            solver=solver,
            qp_solver=qp_solver,
            max_iter=count("max_iter", max_iter),
            tolerance=float(positive("tolerance", tolerance))
            if tolerance is not None
            else default_tolerance(model.real, solver),
            compiled=model.second_order is not None if compiled is None else bool(compiled),
        )
        self._calls: deque[list[Array]] = deque(maxlen=_EXAMPLES)
        self._at_rest = signals.rest(self._problem, self.u_trim)
        self._plan = Plan(self.u_trim, self.horizon)

    def __repr__(self) -> str:
        return (
            f"<Mpc {self._problem.name}: {self.model.name}, {self.horizon} stages of {self.dt:g} s>"
        )

    @property
    def function(self) -> SolverFunction:
        """A step as a Function that `export_c` writes as C."""
        return self._solver.function

    def copy(self, **changes: Any) -> Mpc:
        """Another controller with a plan of its own, which shares what is compiled of the model.

        Parameters
        ----------
        **changes
            Arguments of `Mpc` that are to be others: weights, bounds, horizon, solver. Of another
            model, `dt`, `method`, `substeps` or `newton` the model is compiled anew.

        Returns
        -------
        Mpc
            It starts from the trimmed input.
        """
        other = Mpc(**{**self._arguments, **changes})
        if not changes:
            other._solver = self._solver
        elif other._solver.functions == self._solver.functions:
            other._solver = replace(other._solver, functions=self._solver.functions)
        return other

    def __copy__(self) -> Mpc:
        return self.copy()

    def __deepcopy__(self, memo: Any) -> Mpc:
        return self.copy()

    def __reduce__(self) -> Any:
        """In a pickle: what it was made of, and its plan."""
        return _made, (self._arguments,), self._plan

    def __setstate__(self, plan: Plan) -> None:
        self._plan = plan

    def reset(self, u: Number | Mapping[str, Number] | None = None) -> None:
        """Forget the plan: the next step starts from the trimmed input.

        Parameters
        ----------
        u : array or mapping, optional
            Input that was applied last; the trimmed one unless given.
        """
        self._plan.reset(self.u_trim if u is None else stacked("u", self.model.u, u))

    @property
    def examples(self) -> list[list[Array]]:
        """Inputs of `function` in the last steps that succeeded: what exported C is tested with.

        Before there is one: those of a step from rest, with all parameters zero.
        """
        if self._calls:
            return [*self._calls]
        return [self._inputs({}, np.zeros(self.model.p.size), {}, {})]

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
            Parameters over the whole horizon. Those that the model has a nominal value of, such as
            gusts, may be left out; others, such as the airspeed, may not. A part "time", s, is that
            of now, and every stage takes that of its middle.
        reference : mapping of str to array, optional
            By name of an output, state or input with a weight: values, or columns, one for the end
            of each stage; a rotation as a matrix (3, 3), or columns (9, N). Zero unless given, for
            attitudes the identity, for inputs the trimmed one; with a `terminal` cost those of its
            equilibrium.
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
            For unknown names, wrong sizes, parameters that are missing, and numbers that are not
            finite. The controller is as it was then: `fallback` gives an input.
        """
        inputs = self._inputs(x, p, reference or {}, preview or {})
        host = self._solver.host
        try:
            found = dict(zip(host.name_out(), host.call(inputs), strict=True))
        except RuntimeError as error:  # some solvers of CasADi raise where they find nothing
            return self.fallback(reasons.raised(error))
        numeric = {key: value.full() for key, value in found.items()}
        violation, stationarity = (float(numeric[k][0, 0]) for k in ("violation", "stationarity"))
        solved = all(np.all(np.isfinite(value)) for value in numeric.values()) and stationarity <= 1
        if not solved:
            reason = reasons.unsolved(violation, stationarity, self._solver.tolerance)
            return self.fallback(reason, violation, stationarity)
        u, later, states = numeric["u"].ravel(), numeric["plan"], numeric["states"]
        self._plan.accept(u, later)
        plan, message = np.column_stack([u, later[:, :-1]]), "solved"
        kept = violation <= 1
        if kept:
            self._calls.append(inputs)
        else:
            message = reasons.exceeded(self._solver, states, plan, inputs[1], violation)
        return MpcStep(
            u=u.copy(),
            plan=plan,
            states=states,
            success=kept,
            message=message,
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
        plan, planned = self._plan.go_on()
        what = "the input planned before" if planned else "the trimmed input"
        return MpcStep(
            u=plan[:, 0].copy(),
            plan=plan,
            states=np.full((self.model.x.size, self.horizon + 1), np.nan),
            success=False,
            message=f"{message}; {what} is applied",
            violation=violation,
            stationarity=stationarity,
            slack=self._slacks(np.full((len(self._problem.soft), self.horizon), np.nan)),
        )

    def _inputs(
        self, x: Any, p: Any, reference: Mapping[str, Number], preview: Mapping[str, Number]
    ) -> list[Array]:
        """Inputs of `function`."""
        if x is None:
            raise ValueError(f"x: expected the state ({_listed(self.model.x)}), found None")
        return [
            stacked("x", self.model.x, x)[:, None],
            signals.parameters(self.model.p, p, preview, self.horizon, self.dt),
            self._plan.applied[:, None],
            signals.references(self._problem, self._at_rest, reference),
            self._plan.inputs,
        ]

    def _slacks(self, rows: Array) -> dict[str, Array]:
        return {limit.name: row for limit, row in zip(self._problem.soft, rows, strict=True)}


def _made(arguments: dict[str, Any]) -> Mpc:
    return Mpc(**arguments)


def _listed(layout: Layout) -> str:
    return ", ".join(f"{part.name} ({part.size}, {part.unit})" for part in layout.parts) or "none"
