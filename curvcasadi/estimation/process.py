"""What the state of a shape filter is, and how it goes on with time.

Random walk:           q' = w                 Q = S dt
White acceleration:    q' = q_dot, q_dot' = w Q = S [[dt³/3, dt²/2], [dt²/2, dt]]   (exact)
Attitude C of the parent, C_true = C exp(φ), driven by the measured rate u = rate − bias − noise of
a gyro at the root (root axes, R_0 in the parent):

    C ← C exp(R_0 u dt),    φ ← exp(R_0 u dt)ᵀ φ − J_r(R_0 u dt) R_0 dt (δbias + noise)

Biases of gyros: random walks.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import casadi as ca

from curvcasadi.estimation import ud
from curvcasadi.lie import so3
from curvcasadi.symbolic.expressions import AnyExpr, Array, Number, choice
from curvcasadi.symbolic.layout import Layout, Part

ProcessName = Literal["random_walk", "white_acceleration"]
PROCESSES: tuple[ProcessName, ...] = ("random_walk", "white_acceleration")


@dataclass(frozen=True, eq=False, kw_only=True)
class RandomWalk:
    """Weights that are driven by white noise: q' = w.

    Attributes
    ----------
    density : float or array, shape (n,)
        Density of w, rad/(m √s); after the time t the weights have wandered by density √t.
    rate : float or array, shape (n,), or None
        Standard deviation of q_dot, rad/(m s), which gyros and accelerometers read.
    acceleration : float or array, shape (n,), or None
        Standard deviation of q_ddot, rad/(m s²), which accelerometers read.
    """

    kind: ClassVar[ProcessName] = "random_walk"
    density: Number
    rate: Number | None = None
    acceleration: Number | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class WhiteAcceleration:
    """Weights whose rates are driven by white noise: q' = q_dot, q_dot' = w.

    Attributes
    ----------
    density : float or array, shape (n,)
        Density of w, rad/(m s √s); after the time t the rates have wandered by density √t.
    acceleration : float or array, shape (n,), or None
        Standard deviation of q_ddot, rad/(m s²), which accelerometers read.
    """

    kind: ClassVar[ProcessName] = "white_acceleration"
    density: Number
    acceleration: Number | None = None
    rate: ClassVar[None] = None  #: which is in the state


def process_model(
    process: ProcessName | RandomWalk | WhiteAcceleration, **keywords: Number
) -> tuple[ProcessName, Number, Number, Number]:
    """(kind, density, rate, acceleration) of a model, or of its name and keyword arguments."""
    if not isinstance(process, RandomWalk | WhiteAcceleration):
        return choice("process", process, PROCESSES), *keywords.values()
    for name, value in keywords.items():
        if value is not None:
            raise ValueError(f"{name}: expected None beside the process {process!r}, found {value}")
    return process.kind, process.density, process.rate, process.acceleration


#: The part of a state that counts rejected updates, which is not estimated.
REJECTIONS = "rejections"

#: Outputs of both Functions; CasADi wants other names than those of inputs.
AFTER = ("state_after", "factor_after")

#: Degree of exponentials of what turns by less than 1 rad: rotations in a step, corrections.
DEGREE = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class Process:
    """Checked description of the state and of what drives it."""

    kind: ProcessName
    density: Array  #: (n,), of the white noise: rad/(m √s), or rad/(m s √s) of q_dot
    root_rotation: AnyExpr  #: R_0 (3, 3)
    attitude: bool = False  #: whether that of the parent is in the state
    rate_density: float | None = None  #: of the root's gyro, rad/√s; with `attitude`
    biases: int = 0  #: number of gyros on the wing whose bias is in the state
    root_bias: bool = False  #: whether that of the root's gyro is
    bias_density: float | None = None  #: rad/(s √s); with biases
    counters: int = 0  #: kinds of sensors whose rejections are counted

    @property
    def n(self) -> int:
        """Number of weights."""
        return len(self.density)

    @property
    def error(self) -> Layout:
        """The error state; that of the attitude is the rotation vector φ, parent axes."""
        return self._layout(Part("attitude", 3, "rad"))

    @property
    def state(self) -> Layout:
        """The nominal state; the attitude is C by columns, counters of rejections are last."""
        counters = (Part(REJECTIONS, self.counters, "1"),) if self.counters else ()
        return Layout((*self._layout(Part("attitude", 9, "1")).parts, *counters))

    def _layout(self, attitude: Part) -> Layout:
        parts = [attitude] if self.attitude else []
        parts.append(Part("q", self.n, "rad/m"))
        if self.kind == "white_acceleration":
            parts.append(Part("q_dot", self.n, "rad/(m s)"))
        if self.biases:
            parts.append(Part("gyro_bias", 3 * self.biases, "rad/s"))
        if self.root_bias:
            parts.append(Part("root_gyro_bias", 3, "rad/s"))
        return Layout(tuple(parts))


def predict_function(name: str, process: Process) -> ca.Function:
    """(state, factor, dt and, with the attitude, rate) -> state_after, factor_after.

    A factor is NaN after a negative dt, as √dt is.
    """
    error = process.error
    state = ca.MX.sym("state", process.state.size)
    factor = ca.MX.sym("factor", ca.Sparsity.upper(error.size))
    dt, rate = ca.MX.sym("dt"), ca.MX.sym("rate", 3)
    inputs = {"state": state, "factor": factor, "dt": dt}
    if process.attitude:
        inputs["rate"] = rate
    arguments = [*inputs.values()]
    state_after, factor_after = _transition(process)(*arguments)
    step = ud.add_noise(error.size)
    for direction, variance in _noise(process, dt):
        factor_after = step(factor_after, direction, variance)
    return ca.Function(
        name, arguments, [state_after, factor_after], [*inputs], [*AFTER], {"cse": True}
    )


def _transition(process: Process) -> ca.Function:
    """State and factor of Φ P Φᵀ, without noise.

    In the order (attitude, q, q_dot, biases), Φ is unit upper triangular but for the attitude, and
    so is Φ U; the rows of the attitude alone are made triangular again.
    """
    layout, error = process.state, process.error
    state, dt, rate = ca.SX.sym("state", layout.size), ca.SX.sym("dt"), ca.SX.sym("rate", 3)
    factor = ca.SX.sym("factor", ca.Sparsity.upper(error.size))
    d, unit = ca.diag(factor), _with_diagonal(factor, ca.SX.ones(error.size))
    at = error.slices
    parts: dict[str, AnyExpr] = layout.split(state)
    rows = unit[:, :]
    if process.kind == "white_acceleration":
        parts["q"] = parts["q"] + dt * parts["q_dot"]
        rows[at["q"], :] = unit[at["q"], :] + dt * unit[at["q_dot"], :]
    arguments = [state, factor, dt]
    if process.attitude:
        arguments.append(rate)
        angle = dt * process.root_rotation @ (rate - parts.get("root_gyro_bias", 0))
        turn = so3.exp(angle, DEGREE)
        parts["attitude"] = ca.vec(so3.orthonormal(ca.reshape(parts["attitude"], 3, 3) @ turn))
        turned = turn.T @ unit[at["attitude"], :]
        if process.root_bias:
            lever = dt * so3.right_jacobian(angle, DEGREE) @ process.root_rotation
            turned -= lever @ unit[at["root_gyro_bias"], :]
        upper, d_attitude = ud.triangular(ca.vertsplit(turned[:, :3]), d[:3])
        rows[:3, :] = turned
        rows[:3, :3] = upper
        d = ca.vertcat(d_attitude, d[3:])
    moved = ca.project(_with_diagonal(rows, d), factor.sparsity())
    return ca.Function("transition", arguments, [layout.join(parts), moved], {"cse": True})


def _with_diagonal(matrix: ca.SX, diagonal: ca.SX) -> ca.SX:
    changed = matrix[:, :]
    for i in range(matrix.shape[0]):
        changed[i, i] = diagonal[i]
    return changed


def _noise(process: Process, dt: ca.MX) -> list[tuple[ca.MX, ca.MX]]:
    """Directions (N, 1) and variances of what is added to the covariance in a step.

    With a = dt/2:  [[dt³/3, dt²/2], [dt²/2, dt]] = dt³/12 e_1 e_1ᵀ + dt (a e_1 + e_2)(a e_1 + e_2)ᵀ

    A variance is the square of a deviation, density √dt; CasADi would simplify (√dt)² to dt.
    """
    root = ca.sqrt(dt)
    error = process.error
    at = error.slices
    unit = _unit_vectors(error.size)
    found = []
    for k, density in enumerate(process.density):
        along_q = unit[at["q"].start + k]
        if process.kind == "random_walk":
            found.append((along_q, (density * root) ** 2))
        else:
            along_rate = unit[at["q_dot"].start + k]
            found.append((along_q, (density / 12**0.5 * dt * root) ** 2))
            found.append((dt / 2 * along_q + along_rate, (density * root) ** 2))
    for name, density in (
        ("attitude", process.rate_density),
        ("gyro_bias", process.bias_density),
        ("root_gyro_bias", process.bias_density),
    ):
        if name in at and density:
            for i in range(at[name].start, at[name].stop):
                found.append((unit[i], (density * root) ** 2))
    return found


def _unit_vectors(size: int) -> list[ca.MX]:
    """Columns of the identity as parts of one vector, a short table in generated C."""
    window = ca.MX(ca.vertcat(ca.DM.zeros(size - 1), 1, ca.DM.zeros(size - 1)))
    return [window[size - 1 - i : 2 * size - 1 - i] for i in range(size)]
