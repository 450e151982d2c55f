"""Geometric feedback of the attitude of a wing station, on SO(3).

The potential Ψ = ½ tr(I − R_dᵀ R) = 1 − cos θ of the attitude error has the gradient
e_R = ½ (R_dᵀ R − Rᵀ R_d)^∨ of length sin θ, so that with the body rate Ω of the station and Ω_d of
its target

    dΨ/dt = e_R · (Ω − Rᵀ R_d Ω_d)

Its only critical points are the goal, a minimum, and the rotations by 180°, maximum and saddles. No
coordinates of the attitude are used: there is no singularity.

**The rates of the weights are free** (`attitude_law`). The station turns by Ω = J q_dot, J the
angular rows of its body Jacobian. With the stiffness S of the weights, A = J S⁻¹ Jᵀ is the
compliance of the station's attitude to moments there, and

    q_dot = S⁻¹ Jᵀ (A + μ I)⁻¹ Ω_wanted,   Ω_wanted = Rᵀ R_d Ω_d − e_R/τ

turns the station as wanted at the least strain energy of the rates. A and (A + μ I)⁻¹ commute, so
for a target at rest

    dΨ/dt = −(1/τ) e_Rᵀ A (A + μ I)⁻¹ e_R ≤ 0

Ψ is a Lyapunov function on all of SO(3). For μ → 0, where A is regular, dΨ/dt = −Ψ (2 − Ψ)/τ, or
tan(θ/2) = tan(θ_0/2) exp(−t/τ) along a great circle: every start converges but those at exactly
180°, which are unstable. τ is the time constant near the goal; from 120° to 1° it takes 5.3 τ.

**The inputs act through the wing** (`attitude_feedback`), as flaps do. About an equilibrium the
transfer from u to the rotation of the station is

    G(s) = −J A_x⁻¹ B − s J A_x⁻² B − … = G_0 (I − s T) + …,   T = G_0⁺ J A_x⁻² B

with the linear model (A_x, B). The law is proportional and integral in e_R,

    u = u_0 + z − T G_0⁺ e_R/τ,    dz/dt = −G_0⁺ e_R/τ

Its proportional part cancels the delay T of the wing: G(s) (I + s T) G_0⁺/(τ s) = I/(τ s) up to
second order in s, so τ is again the time constant. While the wing follows at once (τ large against
T) the station turns by Ω = G_0 du/dt, and the integral part alone gives dΨ/dt ≤ −e_Rᵀ G_0 G_0⁺
e_R/τ: the same Lyapunov argument, in the directions that the inputs can turn. e_R comes from
rotation matrices, so large angles of bending and of error are nothing special.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.control.linearize import linearize
from curvcasadi.control.model import ControlModel
from curvcasadi.control.signals import stacked
from curvcasadi.kinematics.jacobian import body_jacobian
from curvcasadi.kinematics.pose_function import pose_function
from curvcasadi.lie import so3
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import Array, Number, instance, positive, station

#: μ over the largest compliance of the straight wing.
DAMPING = 1e-6
#: Least authority of a direction over the largest.
AUTHORITY = 0.1


def attitude_law(
    beam: Beam,
    *,
    time_constant: float,
    xi: float = 1.0,
    damping: float = DAMPING,
    name: str = "attitude_law",
) -> ca.Function:
    """Rates of the weights that turn a station to a target attitude, from almost every start.

    The attitude error decays as tan(θ/2) = tan(θ_0/2) exp(−t/time_constant), without Euler angles:
    only an error of exactly 180° is a place of rest, and unstable. With `kinematic_model` the input
    is q plus its time constant times q_dot. Bounds of weights are not in the law.

    Parameters
    ----------
    beam : Beam
        Wing with numeric fields. With a section the rates have the least strain energy.
    time_constant : float
        τ, s: the error near the goal decays as exp(−t/τ).
    xi : float
        Station s/L.
    damping : float
        μ over the largest compliance of the straight wing. It bounds the rates where the weights
        cannot turn the station about every axis; what they can is then slower by this fraction.
    name : str
        Name of the Function, also in generated C.

    Returns
    -------
    casadi.Function
        (q, target (3, 3), target_rate (3, 1)) -> q_dot (n, 1), error (3, 1), potential. The target
        is a rotation from local to parent axes, its rate is in its own axes, rad/s; `error` is
        e_R and `potential` Ψ, from 0 to 2.

    Raises
    ------
    ValueError
        If the beam holds symbols, a number is not above zero, or no weight turns the station.
    """
    tau, mu = positive("time_constant", time_constant), positive("damping", damping)
    symbols = instance("beam", beam, Beam).design_symbols
    if symbols:
        raise ValueError(f"{next(iter(symbols))}: attitude_law needs numbers, found a symbol")
    xi, n = station("xi", xi), beam.basis.n
    weights = _stiffness(beam)
    inverse = np.linalg.inv(weights)
    straight = body_jacobian(beam, ca.DM.zeros(n), xi).full()[:3]
    if np.max(np.abs(straight)) <= np.finfo(float).eps * float(beam.length):
        raise ValueError(f"xi: expected a station that the weights turn, found {xi:g}")
    compliance = np.linalg.eigvalsh(straight @ inverse @ straight.T)

    q, target = ca.MX.sym("q", n), ca.MX.sym("target", 3, 3)
    target_rate = ca.MX.sym("target_rate", 3)
    _, rotation, jacobian = pose_function(f"{name}_pose", beam, (xi,), jacobian=True)(q)
    J = jacobian[:3, :]
    error = so3.attitude_error(rotation, target)
    wanted = rotation.T @ target @ target_rate - error / tau
    by_moment = ca.DM(inverse) @ J.T
    A = ca.densify(J @ by_moment) + float(mu * compliance[-1]) * ca.DM.eye(3)
    outputs = {
        "q_dot": by_moment @ ca.solve(A, wanted, "ldl"),
        "error": error,
        "potential": so3.configuration_error(rotation, target),
    }
    inputs = {"q": q, "target": target, "target_rate": target_rate}
    return ca.Function(name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs])


def _stiffness(beam: Beam) -> Array:
    """S of the weights; without a section the metric of their curvatures."""
    if beam.section is None:
        return np.eye(beam.basis.n)
    return np.asarray(ca.DM(stiffness_matrix(beam)).full())


@dataclass(frozen=True, eq=False, kw_only=True)
class AttitudeFeedback:
    """Proportional and integral feedback of the attitude of a station to inputs of a model.

    Attributes
    ----------
    step : casadi.Function
        (rotation (3, 3), target (3, 3), integral (nu, 1), dt) -> u (nu, 1), integral_after (nu, 1),
        error (3, 1), potential. Inputs lie within their bounds; so does u_0 + integral, so that the
        integral does not wind up.
    gain : array, shape (3, nu)
        G_0: rotation of the station by the inputs when the wing has settled, rad per unit.
    delay : array, shape (nu, nu)
        T, s.
    proportional, integral : array, shape (nu, 3)
        Gains of e_R: T G_0⁺/τ and G_0⁺/τ.
    eigenvalues : array
        Those of the closed loop about the equilibrium, complex, 1/s.
    u : array, shape (nu,)
        u_0, the inputs at the equilibrium.
    """

    step: ca.Function
    gain: Array
    delay: Array
    proportional: Array
    integral: Array
    eigenvalues: Array
    u: Array


def attitude_feedback(
    model: ControlModel,
    beam: Beam,
    x: Number | Mapping[str, Number],
    u: Number | Mapping[str, Number] | None = None,
    p: Number | Mapping[str, Number] | None = None,
    *,
    time_constant: float,
    xi: float = 1.0,
    bounds: Any = None,
    authority: float = AUTHORITY,
    name: str = "attitude_feedback",
) -> AttitudeFeedback:
    """Feedback that turns a wing station to a target attitude through the inputs of a model.

    Its gains follow from the linear model at an equilibrium, where the wing has to be stable, and
    from one time constant. Half of the wing's own delay is a choice that is not tight.

    Parameters
    ----------
    model : ControlModel
        Model with q in its state, as `wing_model`.
    beam : Beam
        The beam of the model.
    x : array, shape (nx,), or mapping of str to array
        Equilibrium.
    u, p : array or mapping, optional
        Inputs and parameters there, as of `linearize`.
    time_constant : float
        τ, s, of the closed loop.
    xi : float
        Station s/L.
    bounds : pair of float or array, optional
        Lowest and highest inputs; those of the model unless given.
    authority : float
        Least authority, over that of the strongest direction, of directions that are controlled.
        Flaps bend a wing well and twist it little: what they can hardly turn is left alone.
    name : str
        Name of the step, also in generated C.

    Returns
    -------
    AttitudeFeedback
        Its step as a Function, and its gains.

    Raises
    ------
    ValueError
        If parameters are missing, no input turns the station, u is not within the bounds, or the
        loop is not stable.
    """
    tau, xi = positive("time_constant", time_constant), station("xi", xi)
    instance("beam", beam, Beam)
    linear = linearize(model, x, u, p)
    u_0 = stacked("u", model.u, u)
    q = linear.x[model.x.slices["q"]]
    J = np.zeros((3, len(linear.A)))
    J[:, model.x.errors.slices["q"]] = body_jacobian(beam, q, xi).full()[:3]
    settled = np.linalg.solve(linear.A, linear.B)
    gain = -J @ settled
    inverse = np.linalg.pinv(gain, rcond=positive("authority", authority))
    if not np.any(gain):
        raise ValueError("model: expected inputs that turn the station, found none that does")
    delay = inverse @ J @ np.linalg.solve(linear.A, settled)
    lower, upper = model.u.bounds if bounds is None else bounds
    limits = [np.broadcast_to(np.asarray(side, float), u_0.shape) for side in (lower, upper)]
    if not np.all((limits[0] <= u_0) & (u_0 <= limits[1])):
        raise ValueError(
            f"bounds: expected lower and upper inputs about {u_0.tolist()}, found "
            f"{limits[0].tolist()} to {limits[1].tolist()}"
        )
    proportional, integral = delay @ inverse / tau, inverse / tau
    eigenvalues = _closed_loop(linear.A, linear.B, J, proportional, integral)
    if not np.all(eigenvalues.real < 0):
        raise ValueError(
            f"time_constant: expected one with which the loop is stable, above {tau:g} s; found "
            f"a root of {eigenvalues[np.argmax(eigenvalues.real)]:.3g} 1/s"
        )
    return AttitudeFeedback(
        step=_feedback_step(name, u_0, proportional, integral, limits),
        gain=gain,
        delay=delay,
        proportional=proportional,
        integral=integral,
        eigenvalues=eigenvalues,
        u=u_0,
    )


def _closed_loop(A: Array, B: Array, J: Array, proportional: Array, integral: Array) -> Array:
    """Eigenvalues, with the integrals of the directions that are controlled."""
    left, singular, _ = np.linalg.svd(integral)
    V = left[:, : int(np.sum(singular > 1e-9 * singular[0]))]
    rows = [[A - B @ proportional @ J, B @ V], [-V.T @ integral @ J, np.zeros((V.shape[1],) * 2)]]
    return np.asarray(np.linalg.eigvals(np.block(rows)))


def _feedback_step(
    name: str, u_0: Array, proportional: Array, integral: Array, limits: list[Array]
) -> ca.Function:
    rotation, target = ca.SX.sym("rotation", 3, 3), ca.SX.sym("target", 3, 3)
    z, dt = ca.SX.sym("integral", len(u_0)), ca.SX.sym("dt")
    error = so3.attitude_error(rotation, target)

    def clipped(value: Any) -> Any:
        return ca.fmax(ca.fmin(value, limits[1]), limits[0])

    held = clipped(u_0 + z - dt * (ca.DM(integral) @ error))
    outputs = {
        "u": clipped(held - ca.DM(proportional) @ error),
        "integral_after": held - u_0,
        "error": error,
        "potential": so3.configuration_error(rotation, target),
    }
    inputs = {"rotation": rotation, "target": target, "integral": z, "dt": dt}
    return ca.Function(
        name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs], {"cse": True}
    )
