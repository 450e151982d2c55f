"""The unknowns, conditions and objectives of steady flight, and the NLPs made of them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import casadi as ca
import numpy as np

from curvcasadi.aero import Flow, LiftingLine
from curvcasadi.aircraft.balance import (
    inertial_wrench,
    rigid_wrenches,
    surface_points,
    wing_function,
)
from curvcasadi.aircraft.parts import Aircraft, Flight, Wing
from curvcasadi.aircraft.symmetry import check_images
from curvcasadi.beam.beam import numeric_length
from curvcasadi.kinematics.pose_function import tip_function
from curvcasadi.lie import so3
from curvcasadi.statics.energy import strain_energy
from curvcasadi.symbolic.expressions import AnyExpr, Array, choice, expression

ANGLES = ("angle_of_attack", "pitch", "sideslip", "roll")
#: Unknowns of the motion and their units.
MOTION = {**dict.fromkeys(ANGLES, "rad"), "turn_rate": "rad/s"}
#: The balances in order: forces and moments, body axes.
BALANCES = (
    "force along x",
    "force along y",
    "force along z",
    "moment about x (roll)",
    "moment about y (pitch)",
    "moment about z (yaw)",
)
#: Those that no motion within the plane of symmetry disturbs.
LATERAL = (1, 3, 5)
#: Further conditions, before those of the wings, by what is said where they are missed.
PATH = ("the flight path is missed", "the turn is not coordinated")
#: What counts as zero, in the scales of `TrimProblem`.
TOLERANCE = 1e-8
#: What the balances and objectives take beside the unknowns.
PARAMETERS = ("speed", "density", "gravity", "sine_of_path", "weight")


@dataclass(frozen=True, eq=False, kw_only=True)
class TipHeight:
    """Objective: the tip of a wing as near as possible to a height above its root.

    Attributes
    ----------
    wing : str
        Name of the wing.
    height : float
        Height, m, above the root along −z of the body.
    """

    wing: str
    height: float

    def __post_init__(self) -> None:
        expression("TipHeight.height", self.height, (1, 1))


#: Least strain energy, drag, or sum of squared bending moments at the roots; or a tip height.
Objective: TypeAlias = Literal["strain_energy", "drag", "root_bending"] | TipHeight | None
Hessian = Literal["exact", "limited_memory"]
OBJECTIVES = ("strain_energy", "drag", "root_bending")


class TrimProblem:
    """Steady flight of an aircraft, straight or `turning`, as expressions of scaled unknowns x.

    x = (angles, turn rate, inputs, L q of each wing), thrusts over the weight and the turn rate
    over g/V. The balances are forces over the weight W and moments over `arm` W, `arm` a tenth of
    the longest wing: an aircraft short of lift still holds its pitch. Residuals of the wings count
    in W L². The twist of the body is constant in its axes, and turns about the vertical:

        u = V (cos α cos β, sin β, sin α cos β),      −(R u)_z = V sin γ,      R = R_y(θ) R_x(φ)
        ω = ψ̇ Rᵀ e_z,      a − g = ω × u − g Rᵀ e_z

    A coordinated flight has no (a − g)_y: nothing in it slides sideways.
    """

    def __init__(
        self,
        aircraft: Aircraft,
        induced_flow: LiftingLine | None = None,
        *,
        turning: bool = False,
    ) -> None:
        self.aircraft, self.induced_flow, self.turning = aircraft, induced_flow, turning
        check_images(aircraft, induced_flow)
        self.names = (*MOTION, *aircraft.inputs)
        self.units = {**MOTION, **aircraft.inputs}
        wings = [wing.name for wing in aircraft.beams]
        if len({*self.names, *wings}) < len(self.names) + len(wings):
            raise ValueError(
                f"aircraft: expected names of wings and inputs other than {', '.join(MOTION)}, "
                f"each once; found {', '.join((*wings, *aircraft.inputs))}"
            )
        self.sizes = [wing.beam.basis.n for wing in aircraft.beams]
        lengths = [numeric_length(wing.beam, "trim") for wing in aircraft.beams]
        self.length = max(lengths, default=1.0)
        self.arm = self.length / 10
        self.x = ca.MX.sym("x", len(self.names) + sum(self.sizes))
        self.p = ca.MX.sym("p", len(PARAMETERS))
        self._parameter = dict(zip(PARAMETERS, ca.vertsplit(self.p), strict=True))
        unknown = self.unknowns(self.x, self.p)
        self.q = {wing.name: unknown[wing.name] for wing in aircraft.beams}
        self.inputs = {name: unknown[name] for name in aircraft.inputs}
        self.flight = self._flight(unknown)
        self._build()

    def scales(self, p: Any) -> list[Any]:
        """What a scaled unknown of one counts, of those with names; `p` are the parameters."""
        speed, _, gravity, _, weight = (p[k] for k in range(len(PARAMETERS)))
        by_unit = {"N": weight, "rad/s": gravity / speed}
        return [by_unit.get(self.units[name], 1.0) for name in self.names]

    def unknowns(self, x: AnyExpr, p: AnyExpr) -> dict[str, AnyExpr]:
        """Angles, rad, turn rate, inputs and weights of the wings, rad/m, by name."""
        count, scales = len(self.names), self.scales(p)
        named = {name: x[i] * scales[i] for i, name in enumerate(self.names)}
        edges = np.cumsum([0, *self.sizes]).tolist()
        for wing, (a, b) in zip(self.aircraft.beams, pairwise(edges), strict=True):
            named[wing.name] = x[count + a : count + b] / self.length
        return named

    def _flight(self, unknown: dict[str, ca.MX]) -> Flight:
        alpha, pitch, beta, roll = (unknown[name] for name in ANGLES)
        direction = flight_direction(alpha, beta)
        p = self._parameter
        rate: ca.MX = unknown["turn_rate"] * attitude_matrix(roll, pitch)[2, :].T
        omega = rate if self.turning else ca.DM.zeros(3)
        return _flight(p["speed"] * direction, roll, pitch, p["density"], p["gravity"], omega)

    def _build(self) -> None:
        """Balances and residuals from one Function per wing."""
        p, flow = self._parameter, self.flight.flow
        roll, pitch = self.x[3], self.x[1]
        motion = [flow.velocity, roll, pitch, flow.density, p["gravity"]]
        if self.turning:
            motion.append(flow.angular_rate)
        y = ca.vertcat(*motion, *self.inputs.values())
        symbols = ca.MX.sym("y", y.numel())
        velocity, scalars, rest = ca.vertsplit(symbols, [0, 3, 7, y.numel()])
        omega = rest[:3] if self.turning else ca.DM.zeros(3)
        flight = _flight(velocity, scalars[0], scalars[1], scalars[2], scalars[3], omega)
        controls = ca.vertsplit(rest[3 * self.turning :])
        deflections = dict(zip(self.inputs, controls, strict=True))
        self.wrenches: dict[str, ca.MX] = {}
        residuals = []
        wash: AnyExpr = None
        points = surface_points(self.aircraft)
        if self.induced_flow is not None:
            wash = ca.MX(3, len(points))
        for wing in self.aircraft.beams:
            function = wing_function(
                wing,
                flight,
                deflections,
                symbols,
                self.induced_flow,
                points,
                turning=self.turning,
            )
            residual, self.wrenches[wing.name], *washes = function(self.q[wing.name], y)
            residuals.append(residual / (p["weight"] * self.length**2))
            for induced in washes:
                wash = wash + induced
        self.rigid = rigid_wrenches(self.aircraft, self.flight, self.inputs, wash)
        total = sum([*self.rigid.values(), *self.wrenches.values()], ca.MX(6, 1))
        down = self.flight.attitude[2, :].T
        felt = ca.cross(flow.angular_rate, flow.velocity) / p["gravity"] - down
        if self.turning:
            total = total + inertial_wrench(self.aircraft, self.flight)
        climb = -ca.dot(down, flow.velocity) / p["speed"] - p["sine_of_path"]
        self.wrench = total
        self.balances = ca.vertcat(total[3:], total[:3] / self.arm) / p["weight"]
        self.residuals = ca.vertcat(climb, felt[1], *residuals)

    def drag(self) -> ca.MX:
        """Power of everything but thrust and weight over −V, N: the force against a straight path.

        Inertial forces have no power in steady flight, and the weight has that of the descent,
        which a centre of mass off the body origin shares.
        """
        p, flow = self._parameter, self.flight.flow
        thrust = sum((self.rigid[t.name] for t in self.aircraft.thrusts), ca.MX(6, 1))
        twist = ca.vertcat(flow.angular_rate, flow.velocity)
        descent = p["weight"] * ca.dot(self.flight.attitude[2, :].T, flow.velocity)
        return (descent - ca.dot(twist, self.wrench - thrust)) / p["speed"]

    def root_load(self, wing: Wing) -> ca.MX:
        """Wrench of a wing on the body, (6, 1), at its root in its root axes."""
        return at_root(wing, self.wrenches[wing.name])

    def objective(self, objective: Objective) -> ca.MX:
        """The objective, of order one."""
        scale = self._parameter["weight"] * self.length
        wings = self.aircraft.beams
        if isinstance(objective, TipHeight):
            names = [wing.name for wing in wings]
            wing = wings[names.index(choice("TipHeight.wing", objective.wing, names))]
            tip, _ = tip_function(wing.beam)(self.q[wing.name])
            height = wing.beam.root.position[2] - tip[2]
            return ca.sumsqr((height - objective.height) / self.length)
        choice("objective", objective, OBJECTIVES)
        if objective == "drag":
            return self.drag() / self._parameter["weight"]
        if objective == "root_bending":
            return sum(((self.root_load(w)[1] / scale) ** 2 for w in wings), ca.MX(1, 1))
        energy = [strain_energy(wing.beam, self.q[wing.name]) / scale for wing in wings]
        return sum(energy, ca.MX(1, 1))

    def nearest(self) -> ca.Function:
        """NLP: least squares of the balances, on the path, the wings in equilibrium.

        Its Hessian is that of Gauss and Newton.
        """
        slope = ca.jacobian(self.balances, self.x)
        of_objective = ca.MX.sym("lam_f")
        hessian = ca.Function(
            "hessian",
            [self.x, self.p, of_objective, ca.MX.sym("lam_g", self.residuals.shape[0])],
            [ca.triu(of_objective * (slope.T @ slope))],
            ["x", "p", "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        )
        objective: AnyExpr = ca.sumsqr(self.balances) / 2
        return self._nlp("nearest", objective, self.residuals, {"hess_lag": hessian})

    def best(self, objective: Objective, hessian: Hessian) -> ca.Function:
        """NLP: the objective, with balances and equilibrium as constraints."""
        constraints = ca.vertcat(self.balances, self.residuals)
        choice("hessian", hessian, ("exact", "limited_memory"))
        options = {"ipopt.hessian_approximation": hessian.replace("_", "-")}
        return self._nlp("best", self.objective(objective), constraints, options)

    def _nlp(
        self, name: str, objective: ca.MX, constraints: ca.MX, options: dict[str, Any]
    ) -> ca.Function:
        nlp = {"x": self.x, "p": self.p, "f": objective, "g": constraints}
        return ca.nlpsol(name, "ipopt", nlp, {**_IPOPT, **options})


_IPOPT: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-11,
    "ipopt.constr_viol_tol": 1e-11,
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.mu_strategy": "adaptive",
    "ipopt.max_iter": 200,
}


def _flight(
    velocity: AnyExpr,
    roll: AnyExpr,
    pitch: AnyExpr,
    density: AnyExpr,
    gravity: AnyExpr,
    angular_rate: AnyExpr,
) -> Flight:
    flow = Flow(density=density, velocity=velocity, angular_rate=angular_rate)
    return Flight(flow=flow, attitude=attitude_matrix(roll, pitch), gravity=gravity)


def flight_direction(alpha: AnyExpr, beta: AnyExpr) -> AnyExpr:
    """Direction of the velocity, (3, 1), body axes, at angles of attack and sideslip, rad."""
    return ca.vertcat(ca.cos(alpha) * ca.cos(beta), ca.sin(beta), ca.sin(alpha) * ca.cos(beta))


def attitude_matrix(roll: AnyExpr, pitch: AnyExpr) -> AnyExpr:
    """Attitude R_y(pitch) R_x(roll), (3, 3), body to inertial axes, heading north."""
    c, s = ca.cos(pitch), ca.sin(pitch)
    c_roll, s_roll = ca.cos(roll), ca.sin(roll)
    about_y = ca.vertcat(ca.horzcat(c, 0, s), ca.horzcat(0, 1, 0), ca.horzcat(-s, 0, c))
    about_x = ca.vertcat(
        ca.horzcat(1, 0, 0), ca.horzcat(0, c_roll, -s_roll), ca.horzcat(0, s_roll, c_roll)
    )
    return about_y @ about_x


def at_root(wing: Wing, wrench: AnyExpr) -> AnyExpr:
    """A wrench about the body origin, body axes, at the root of `wing` in its root axes."""
    root = wing.beam.root
    moment = wrench[:3] - so3.hat(root.position) @ wrench[3:]
    return ca.vertcat(root.rotation.T @ moment, root.rotation.T @ wrench[3:])


def bounds_of(problem: TrimProblem) -> tuple[Array, Array]:
    """Bounds of the named unknowns and of the weights, unless the user says otherwise.

    Angles of attack and sideslip within 0.35 rad and deflections within 0.5 rad, where slopes mean
    something; thrusts not below zero; weights within `Beam.weight_bounds`.
    """
    motion = dict(zip(MOTION, (0.35, np.pi / 2, 0.35, np.pi / 2, np.inf), strict=True))
    units = problem.aircraft.inputs
    largest = {**motion, **{name: np.inf if u == "N" else 0.5 for name, u in units.items()}}
    upper = [largest[name] for name in problem.names]
    lower = [0.0 if units.get(n) == "N" else -u for n, u in zip(problem.names, upper, strict=True)]
    sides = [wing.beam.bounds for wing in problem.aircraft.beams]
    weights = [np.concatenate([np.zeros(0), *side]) for side in zip(*sides, strict=True)]
    weights = weights or [np.zeros(0), np.zeros(0)]
    return (
        np.concatenate([lower, weights[0] * problem.length]),
        np.concatenate([upper, weights[1] * problem.length]),
    )
