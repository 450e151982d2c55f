"""The functions whose size and speed on a Cortex-M are measured.

A library is what one call of `export_c` writes. Unless their names say otherwise, wings have 32
elements and 6 weights, two Legendre functions for each of the three curvatures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from codegen.budgets import Relation
from tests.support import wing as test_wing

CPUS = ("cortex-m7", "cortex-m4")

#: Poses, Jacobians, filters and equilibria are smaller and faster with these; solvers of programs
#: (up to a fourth) and the shortest poses grow and stay at -Os.
FAST = ("-O2", "-ffp-contract=fast")

#: Tip error, in lengths, that the midpoint rule and magnus4 are compared at.
TIP_ERROR = 1e-4

SAMPLES = 5


@dataclass(frozen=True, eq=False, kw_only=True)
class Library:
    """Functions of one beam that are exported together."""

    name: str
    beam: cc.Beam
    functions: Callable[[cc.Beam], Sequence[ca.Function | cc.CFunction]]
    #: by function, samples at which it is compared and measured; random weights unless given
    reference_inputs: Callable[[cc.Beam], Mapping[str, Any]] = field(default=lambda _: {})
    cpus: tuple[str, ...] = CPUS
    options: tuple[str, ...] = ()  #: of the compiler, after those of every library
    #: name of the program that calls all functions in turn, with shared buffers, if there is one
    together: str | None = None

    def export(self, directory: Any) -> dict[str, Any]:
        """The manifest of what is written into `directory`."""
        return cc.export_c(
            self.functions(self.beam),
            directory,
            real=self.beam.grid.real,
            beam=self.beam,
            reference_inputs=self.reference_inputs(self.beam),
            shared_buffers=self.together is not None,
        )


def wing(elements: int = 32, **grid: Any) -> cc.Beam:
    """16 m, 6 weights of at most 0.1 rad/m: no element turns by more than 0.2 rad."""
    two = cc.Legendre(2)
    options = {"rule": "midpoint", "real": "float", "max_angle": 0.2} | grid
    return cc.Beam(
        length=16.0,
        basis=cc.ChannelBasis(torsion=two, out_of_plane=two, in_plane=two),
        grid=cc.Grid.uniform(elements, **options),
        section=cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6),
        weight_bounds=0.1,
    )


def strongly_bent(rule: Any, max_angle: float) -> cc.Beam:
    """The test wing of the benchmark, with as few elements as its tip error allows."""
    elements = test_wing.elements_for(TIP_ERROR, rule)
    grid = cc.Grid.uniform(elements, rule=rule, real="float", max_angle=max_angle)
    return replace(test_wing.on_grid(grid), weight_bounds=np.abs(test_wing.WEIGHTS))


def tips(beam: cc.Beam) -> list[ca.Function]:
    return [
        cc.pose_function("tip", beam, (1.0,)),
        cc.pose_function("tip_jacobian", beam, (1.0,), jacobian=True),
    ]


def tip(beam: cc.Beam) -> list[ca.Function]:
    return [cc.tip_function(beam)]


def shape_target(beam: cc.Beam) -> list[ca.Function]:
    """The whole solve for a tip position, nearby, and one iteration of it."""
    target = cc.Target(xi=1.0, position=[15.0, 0, 3], weight=1.0)
    return [
        cc.shape_target_function(
            beam, [target], regularization=1e-6, max_iter=11, iterations=iterations, name=name
        )
        for name, iterations in (("shape_target", None), ("shape_target_step", 1))
    ]


def shape_target_samples(beam: cc.Beam) -> dict[str, Any]:
    """From a slight bend to strongly bent ones; one iteration from near the target."""
    random = np.random.default_rng(0)
    position = cc.tip_function(beam)
    goals = random.uniform(-0.04, 0.04, (SAMPLES, beam.basis.n))
    near = [goal + random.uniform(-1e-3, 1e-3, beam.basis.n) for goal in goals]
    slight = np.full(beam.basis.n, 0.01)
    return {
        "shape_target": [(slight, position(goal)[0]) for goal in goals],
        "shape_target_step": [
            (guess, position(goal)[0]) for guess, goal in zip(near, goals, strict=True)
        ],
    }


def shape_target_met(beam: cc.Beam) -> list[ca.Function]:
    """The solve for a tip position to be met to 1e-5 of the length, in stages."""
    target = cc.Target(xi=1.0, position=[15.0, 0, 3])
    return [cc.shape_target_function(beam, [target], max_iter=12, name="shape_target_met")]


def shape_target_met_samples(beam: cc.Beam) -> dict[str, Any]:
    return {"shape_target_met": shape_target_samples(beam)["shape_target"]}


STAGES, DT = 4, 0.05  # of the MPC, s


def tip_path(beam: cc.Beam) -> list[ca.Function]:
    """One step of the tip-path MPC: to convergence, and one real-time iteration."""
    model = cc.kinematic_model(beam, time_constant=0.25)
    return [
        cc.tip_path_step_function(
            model,
            dt=DT,
            horizon=STAGES,
            attitude_weight=25,
            iterations=iterations,
            max_iter=20,
            name=name,
        )
        for name, iterations in (("tip_path", None), ("tip_path_step", 1))
    ]


def tip_path_samples(beam: cc.Beam) -> dict[str, Any]:
    """Steps towards a path that begins near the state."""
    random = np.random.default_rng(0)
    n, tip = beam.basis.n, cc.tip_function(beam)
    samples = []
    for _ in range(SAMPLES):
        start, slope = random.uniform(-0.03, 0.03, n), random.uniform(-0.02, 0.02, n)
        poses = [tip(start + slope * DT * (k + 1)) for k in range(STAGES)]
        path = [ca.horzcat(*part) for part in zip(*poses, strict=True)]
        samples.append((start, np.zeros(n), start, *path, np.tile(start, 2 * STAGES)))
    return {"tip_path": samples, "tip_path_step": samples}


def bounded_tip_path(beam: cc.Beam) -> list[ca.Function]:
    """One real-time iteration, with rates and curvatures bounded."""
    return [
        cc.tip_path_step_function(
            cc.kinematic_model(beam, time_constant=0.25),
            dt=DT,
            horizon=STAGES,
            attitude_weight=25,
            iterations=1,
            rate_bound=0.1,
            curvature_bound=0.08,
            name="tip_path_step",
        )
    ]


def far_tip_path(beam: cc.Beam) -> list[ca.Function]:
    """The real-time iteration alone."""
    return tip_path(beam)[1:]


def far_samples(beam: cc.Beam) -> dict[str, Any]:
    """Steps from near rest to a pose far away, without a plan."""
    random = np.random.default_rng(1)
    n, tip = beam.basis.n, cc.tip_function(beam)
    samples = []
    for _ in range(SAMPLES):
        start, goal = random.uniform(-0.005, 0.005, n), random.uniform(-0.03, 0.03, n)
        pose = [ca.repmat(part, 1, STAGES) for part in tip(goal)]
        samples.append((start, np.zeros(n), start, *pose, np.zeros(2 * STAGES * n)))
    return {"tip_path_step": samples}


def equilibrium(beam: cc.Beam) -> list[ca.Function]:
    """Under a dead force at the tip, an input."""
    force = ca.MX.sym("force", 3)
    loads = [cc.PointForce(xi=1.0, force=force, frame="dead")]
    return [cc.equilibrium_function(beam, loads, {"force": force}, max_iter=15, checked=True)]


def equilibrium_samples(beam: cc.Beam) -> dict[str, Any]:
    forces = np.random.default_rng(0).uniform(-30, 30, (SAMPLES, 3))
    return {"equilibrium": [(np.zeros(beam.basis.n), force) for force in forces]}


IMUS = tuple(
    sensor
    for xi in (0.25, 0.5, 0.75, 1.0)
    for sensor in (
        cc.RateGyro(xi=xi, noise_density=1e-4, rate=100),
        cc.Accelerometer(xi=xi, noise_density=2e-3, rate=100),
    )
)
CLAMPED = cc.RootMotion(gravity=[0, 0, -9.81])


def shape_filter(beam: cc.Beam) -> cc.ShapeEkf:
    """State q, q_dot; four gyros and four accelerometers."""
    return cc.shape_ekf(
        beam, IMUS, process="white_acceleration", density=0.01, acceleration=0.05, root=CLAMPED
    )


def filter_steps(beam: cc.Beam) -> list[cc.CFunction]:
    """Predict and update. Innovations are differences over small standard deviations."""
    ekf = shape_filter(beam)
    predict, update = ekf.descriptions["predict"], ekf.descriptions["update"]
    return [
        cc.CFunction(function=ekf.predict, descriptions=predict, tolerance=1e-4),
        cc.CFunction(
            function=ekf.update, descriptions=update, missing=("measured",), tolerance=1e-4
        ),
    ]


def filter_samples(beam: cc.Beam) -> dict[str, Any]:
    """Slightly wrong states of a moving wing."""
    random, ekf = np.random.default_rng(0), shape_filter(beam)
    predictions, updates = [], []
    for _ in range(SAMPLES):
        q, q_dot = random.uniform(-0.01, 0.01, 6), random.uniform(-0.01, 0.01, 6)
        at = ekf.initial({"q": 1e-3, "q_dot": 1e-2}, {"q": q, "q_dot": q_dot})
        q_ddot = 0.05 * random.normal(size=6)
        read = cc.measure(IMUS, beam, q + 1e-4 * random.normal(size=6), q_dot, q_ddot, CLAMPED)
        predictions.append((at.state, at.factor, 0.01))
        updates.append((at.state, at.factor, read.values))
    return {ekf.predict.name(): predictions, ekf.update.name(): updates}


#: The wing of the solvers. On the test wing 8 such elements leave 2e-5 of the length at the tip,
#: 32 by the midpoint rule 3e-4, for more than twice the instructions.
FEW_ELEMENTS = wing(8, rule="magnus4", max_angle=0.7)

LIBRARIES = (
    Library(name="midpoint_32", beam=wing(), functions=tips, options=FAST),
    Library(name="midpoint_64", beam=wing(64), functions=tips, options=FAST),
    Library(
        name="double_32",
        beam=wing(real="double"),
        functions=tips,
        cpus=("cortex-m7",),
        options=FAST,
    ),
    Library(name="bent_midpoint", beam=strongly_bent("midpoint", 0.06), functions=tip),
    Library(name="bent_magnus4", beam=strongly_bent("magnus4", 0.7), functions=tip),
    Library(
        name="bent_jacobian",
        beam=strongly_bent("magnus4", 0.7),
        functions=lambda beam: tips(beam)[1:],
        cpus=("cortex-m4",),
        options=FAST,
    ),
    Library(
        name="target",
        beam=FEW_ELEMENTS,
        functions=shape_target,
        reference_inputs=shape_target_samples,
    ),
    Library(
        name="target_met",
        beam=FEW_ELEMENTS,
        functions=shape_target_met,
        reference_inputs=shape_target_met_samples,
    ),
    Library(name="mpc", beam=FEW_ELEMENTS, functions=tip_path, reference_inputs=tip_path_samples),
    Library(
        name="mpc_far",
        beam=FEW_ELEMENTS,
        functions=far_tip_path,
        reference_inputs=far_samples,
        cpus=("cortex-m4",),
    ),
    Library(
        name="mpc_bounded",
        beam=FEW_ELEMENTS,
        functions=bounded_tip_path,
        reference_inputs=far_samples,
        cpus=("cortex-m4",),
    ),
    Library(
        name="statics",
        beam=FEW_ELEMENTS,
        functions=equilibrium,
        reference_inputs=equilibrium_samples,
        options=FAST,
    ),
    Library(
        name="ekf",
        beam=FEW_ELEMENTS,
        functions=filter_steps,
        reference_inputs=filter_samples,
        together="ekf_step",
        options=FAST,
    ),
)

RELATIONS = (
    Relation(quantity="instructions", of="midpoint_64.tip", to="midpoint_32.tip", factor=2.05),
    Relation(
        quantity="instructions",
        of="midpoint_64.tip_jacobian",
        to="midpoint_32.tip_jacobian",
        factor=2.05,
    ),
    Relation(quantity="text", of="midpoint_64.tip", to="midpoint_32.tip", more=5 * 1024),
    Relation(
        quantity="text",
        of="midpoint_64.tip_jacobian",
        to="midpoint_32.tip_jacobian",
        more=5 * 1024,
    ),
    Relation(quantity="instructions", of="bent_magnus4.tip", to="bent_midpoint.tip", factor=1 / 3),
)
