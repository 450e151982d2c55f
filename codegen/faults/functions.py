"""The functions that are called with faulty inputs, and what ordinary inputs of each are."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from codegen import benchmark_functions as benchmark
from codegen.faults import checks

REALS = {"float": np.float32, "double": np.float64}

Arrays = dict[str, Any]  #: inputs or outputs by name, one call a row


@dataclass(frozen=True, eq=False, kw_only=True)
class Case:
    """A function, how often it is called in each precision, and what is asked of its results."""

    name: str
    build: Callable[[cc.Beam], ca.Function]
    ordinary: Callable[[cc.Beam, Any, int], Arrays]  #: (beam, random, calls): typical inputs
    #: (real, one call's inputs, its outputs) -> what is wrong, or ""; rounding included
    check: Callable[[str, Arrays, Arrays], str]
    calls: int = 5_000
    #: part of the ordinary calls that must end with OK
    solved: float = 1.0
    bounded: bool = True  #: False: a beam whose weights only the angle of its elements limits
    weights: tuple[str, ...] = field(default=())
    #: as `ordinary`: starts from rest and far away, and the part of them that must end with OK
    hard: Callable[[cc.Beam, Any, int], Arrays] | None = None
    solved_hard: float = 1.0

    def beam(self, real: str) -> cc.Beam:
        return _beam(real, self.bounded)

    def exported(self, real: str) -> cc.CFunction:
        return _exported(self, real)


@cache
def _beam(real: str, bounded: bool) -> cc.Beam:
    beam = benchmark.wing(real=real)
    return beam if bounded else replace(beam, weight_bounds=None)


@cache
def _exported(case: Case, real: str) -> cc.CFunction:
    beam = case.beam(real)
    return cc.CFunction(function=case.build(beam), weights=dict.fromkeys(case.weights, beam))


def _one(functions: Callable[[cc.Beam], list[ca.Function]], k: int) -> Callable[[cc.Beam], Any]:
    return lambda beam: functions(beam)[k]


def weights(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    return {"q": random.uniform(-0.1, 0.1, (calls, beam.basis.n))}


def strong_weights(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    """Some beyond the angle that an element may turn."""
    return {"q": random.uniform(-0.2, 0.2, (calls, beam.basis.n))}


def tips(beam: cc.Beam, q: Any) -> tuple[Any, Any]:
    """Tip positions and rotations, a row of 3 and of 9 for each row of weights."""
    position, rotation = cc.tip_function(beam).map(len(q))(q.T)
    return position.full().T, rotation.full().T.reshape(len(q), 9)


def goal(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    """A slight bend, and the tip of another shape."""
    n = beam.basis.n
    positions, _ = tips(beam, random.uniform(-0.04, 0.04, (calls, n)))
    return {"q_guess": random.uniform(0.005, 0.015, (calls, n)), "positions": positions}


def goal_nearby(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    q = random.uniform(-0.04, 0.04, (calls, beam.basis.n))
    return {"q_guess": q + random.uniform(-1e-3, 1e-3, q.shape), "positions": tips(beam, q)[0]}


def path(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    """A state, and a path from near it."""
    n = beam.basis.n
    start, slope = (random.uniform(-a, a, (calls, n)) for a in (0.03, 0.02))
    poses = [tips(beam, start + slope * checks.DT * (k + 1)) for k in range(checks.STAGES)]
    return {
        "x": start,
        "p": random.uniform(-1e-3, 1e-3, (calls, n)),
        "u_previous": start,
        "positions": np.hstack([position for position, _ in poses]),
        "rotations": np.hstack([rotation for _, rotation in poses]),
        "guess": np.tile(start, 2 * checks.STAGES),
    }


def preview(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    """A state, and positions near it that ask for more than the soft bound."""
    n = beam.basis.n
    start, slope = (random.uniform(-a, a, (calls, n)) for a in (0.03, 0.02))
    goals = [tips(beam, start + slope * checks.DT * (k + 1))[0] for k in range(checks.STAGES)]
    return {
        "x": start,
        "p": random.uniform(-1e-3, 1e-3, (calls, n * checks.STAGES)),
        "u_previous": start,
        "reference": _with_inputs(beam, goals),
        "guess": np.tile(start, checks.STAGES),
    }


def _with_inputs(beam: cc.Beam, goals: list[Any]) -> Any:
    """Columns of positions, and inputs of zero, stage after stage."""
    rest = np.zeros((len(goals[0]), beam.basis.n))
    return np.hstack([part for goal in goals for part in (goal, rest)])


def far_preview(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    """Rest or nearly so, without a plan, and a position far away."""
    found = far_path(beam, random, calls)
    n = beam.basis.n
    return {
        "x": found["x"],
        "p": np.zeros((calls, n * checks.STAGES)),
        "u_previous": found["u_previous"],
        "reference": _with_inputs(beam, np.hsplit(found["positions"], checks.STAGES)),
        "guess": np.zeros((calls, n * checks.STAGES)),
    }


def far_goal(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    """The tip of a strongly bent wing: from rest, and from any other shape."""
    shape = (calls, beam.basis.n)
    guess = random.uniform(-0.05, 0.05, shape)
    guess[::2] = 0
    return {"q_guess": guess, "positions": tips(beam, random.uniform(-0.06, 0.06, shape))[0]}


def far_path(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    """Rest or nearly so, without a plan, and a pose far away."""
    n = beam.basis.n
    start = random.uniform(-0.005, 0.005, (calls, n))
    start[::2] = 0
    position, rotation = tips(beam, random.uniform(-0.03, 0.03, (calls, n)))
    return {
        "x": start,
        "p": np.zeros((calls, n)),
        "u_previous": start,
        "positions": np.tile(position, checks.STAGES),
        "rotations": np.tile(rotation, checks.STAGES),
        "guess": np.zeros((calls, 2 * n * checks.STAGES)),
    }


def far_force(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    """The usual forces: from rest, and from shapes that these do not make."""
    guess = random.uniform(-0.01, 0.01, (calls, beam.basis.n))
    guess[::2] = 0
    return {"q_guess": guess, "force": random.uniform(-30, 30, (calls, 3))}


def force(beam: cc.Beam, random: Any, calls: int) -> Arrays:
    return {
        "q_guess": random.uniform(-1e-3, 1e-3, (calls, beam.basis.n)),
        "force": random.uniform(-30, 30, (calls, 3)),
    }


def _shape_target(name: str, **options: Any) -> Callable[[cc.Beam], ca.Function]:
    """The whole solve for a tip position; the numbers of the target are those of its kind."""
    weight = options.pop("weight", None)
    target = cc.Target(xi=1.0, position=[15.0, 0, 3], weight=weight)
    return lambda beam: cc.shape_target_function(beam, [target], name=name, **options)


def _tip_path(name: str, iterations: int | None) -> Callable[[cc.Beam], ca.Function]:
    return lambda beam: cc.tip_path_step_function(
        cc.kinematic_model(beam, time_constant=checks.TIME_CONSTANT),
        dt=checks.DT,
        horizon=checks.STAGES,
        position_weight=checks.POSITION_WEIGHT,
        attitude_weight=checks.ATTITUDE_WEIGHT,
        move_weight=checks.MOVE_WEIGHT,
        rate_bound=checks.RATE_BOUND,
        iterations=iterations,
        max_iter=20,
        damping=0.0,  # the check knows the program itself
        name=name,
    )


def _predictive(beam: cc.Beam) -> ca.Function:
    """`Mpc` to convergence: a tip position, inputs and moves weighed, a soft bound."""
    model = cc.kinematic_model(beam, time_constant=checks.TIME_CONSTANT)
    mpc = cc.Mpc(
        model,
        dt=checks.DT,
        horizon=checks.STAGES,
        outputs={"position": checks.POSITION_WEIGHT},
        inputs={"q_command": checks.INPUT_WEIGHT},
        moves={"q_command": checks.MOVE_WEIGHT},
        bounds={"curvature": (-checks.SOFT_BOUND, checks.SOFT_BOUND)},
        soft={"curvature": checks.SOFT_WEIGHT},
        solver="sqp",
        max_iter=40,
        damping=0.0,
        name="predictive",
    )
    return mpc.function


_WEIGHTED = {"weight": 1.0, "regularization": checks.REGULARIZATION}

CASES = (
    Case(
        name="tip",
        build=_one(benchmark.tips, 0),
        ordinary=weights,
        check=checks.tip,
        calls=250_000,
        weights=("q",),
    ),
    Case(
        name="tip_jacobian",
        build=_one(benchmark.tips, 1),
        ordinary=weights,
        check=checks.tip_jacobian,
        calls=200_000,
        weights=("q",),
    ),
    Case(
        name="strong_tip",
        build=lambda beam: cc.pose_function("strong_tip", beam, (1.0,)),
        ordinary=strong_weights,
        check=checks.tip,
        calls=50_000,
        solved=0.0,
        bounded=False,
        weights=("q",),
    ),
    Case(
        name="shape_target",
        build=_shape_target("shape_target", **_WEIGHTED, max_iter=40),
        ordinary=goal,
        check=checks.shape_target,
        hard=far_goal,
        solved_hard=0.98,
        solved=0.95,
        weights=("q_guess",),
    ),
    Case(
        name="free_shape_target",
        build=_shape_target("free_shape_target", **_WEIGHTED, max_iter=40),
        ordinary=goal,
        check=checks.free_shape_target,
        hard=far_goal,
        solved_hard=0.9,
        calls=1_000,  # 32 constraints: each takes as long as twenty others
        solved=0.95,
        bounded=False,
        weights=("q_guess",),
    ),
    Case(
        name="shape_target_step",
        build=_shape_target("shape_target_step", **_WEIGHTED, iterations=1, damping=0.0),
        ordinary=goal_nearby,
        check=checks.shape_target_step,
        hard=far_goal,
        weights=("q_guess",),
    ),
    Case(
        name="shape_target_met",
        build=_shape_target("shape_target_met", max_iter=20),
        ordinary=goal,
        check=checks.shape_target_met,
        hard=far_goal,
        solved=0.98,
        weights=("q_guess",),
    ),
    Case(
        name="tip_path",
        build=_tip_path("tip_path", None),
        ordinary=path,
        check=checks.tip_path,
        hard=far_path,
        solved_hard=0.98,
    ),
    Case(
        name="tip_path_step",
        build=_tip_path("tip_path_step", 1),
        ordinary=path,
        check=checks.tip_path_step,
        hard=far_path,
    ),
    Case(
        name="predictive",
        build=_predictive,
        ordinary=preview,
        check=checks.predictive,
        hard=far_preview,
        solved_hard=0.98,
        calls=1_500,  # each takes as long as five of the others
    ),
    Case(
        name="equilibrium",
        build=_one(benchmark.equilibrium, 0),
        ordinary=force,
        check=checks.equilibrium,
        hard=far_force,
        weights=("q_guess",),
    ),
)


def export(real: str, folder: Path) -> Mapping[str, Any]:
    """All cases in one library."""
    samples = {}
    for case in CASES:
        exported = case.exported(real)
        inputs = case.ordinary(case.beam(real), np.random.default_rng(0), 5)
        if exported.is_solver:
            samples[case.name] = reference(exported.function, inputs)
        elif not case.bounded:
            samples[case.name] = [(0.1 * row,) for row in inputs["q"]]
    functions = [case.exported(real) for case in CASES]
    return cc.export_c(functions, folder, real=real, reference_inputs=samples)


def reference(function: ca.Function, inputs: Arrays) -> list[tuple[Any, ...]]:
    """Rows of `inputs` in the shapes of the function."""
    return [
        tuple(
            row.reshape(function.size_in(key), order="F")
            for key, row in zip(function.name_in(), rows, strict=True)
        )
        for rows in zip(*(inputs[key] for key in function.name_in()), strict=True)
    ]
