"""Models as a control engineer sees them: state x, input u, parameter p, output y."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca

from curvcasadi.control.spans import Span
from curvcasadi.lie import quaternion
from curvcasadi.symbolic.expressions import Real
from curvcasadi.symbolic.layout import Layout
from curvcasadi.symbolic.text import described


@dataclass(frozen=True, eq=False, kw_only=True)
class SecondOrder:
    """Equations of motion of a second-order model, in the form that its integrators use.

        configuration rate = kinematics(x)
        balance(x, acceleration, u, p) = 0
        rate of the other parts = other_rates(x, acceleration, u, p)

    The state holds the parts of the configuration, then the velocities, then the others (lag
    states of the air, say), so its error state has nv, nv and no entries.

    Attributes
    ----------
    configuration : int
        How many parts of the state form the configuration.
    velocities : int
        nv, the number of velocities and of error states of the configuration.
    kinematics : casadi.Function
        (x) -> rate (nv, 1) of the configuration's error state: body rate of an attitude, rad/s,
        and derivatives of the other parts.
    balance : casadi.Function
        (x, acceleration, u, p) -> balance (nv, 1), other_rates (no, 1). `acceleration` (nv, 1)
        holds the derivatives of the velocities. Its derivatives are attached and structured.
    matrices : casadi.Function
        (x, p) -> mass (nv, nv), damping (nv, nv), stiffness (nv, nv): derivatives of the balance
        by acceleration, velocities and configuration, of the last two the constant parts, which
        make a wing stiff; the air is not in them.
    momenta : casadi.Function or None
        (x) -> momenta (nv, 1), the derivatives of the kinetic energy by the velocities, and
        by_configuration (nv, 1), its derivative by the weights at fixed velocities, zero for the
        six of a free root; what the variational rule needs.
    decays : casadi.Function or None
        (x, p) -> rates (no, 1), 1/s, at which the other parts decay toward what they follow, on
        average: implicit steps converge faster where they are known.
    """

    configuration: int
    velocities: int
    kinematics: ca.Function
    balance: ca.Function
    matrices: ca.Function
    momenta: ca.Function | None = None
    decays: ca.Function | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class ControlModel:
    """dx/dt = xdot(x, u, p), y = output(x, u, p), in SI units.

    Attributes
    ----------
    name : str
        Its name, also in generated C.
    x, u, p, y : Layout
        Named parts of state, input, parameter and output, with their units and bounds. A part may
        be an attitude.
    xdot : casadi.Function
        (x, u, p) -> xdot (nx, 1).
    output : casadi.Function
        (x, u, p) -> y (ny, 1).
    real : {"double", "float"}
        Arithmetic that the model is made for, as in `Grid`.
    angles : casadi.Function or None
        (x) -> squared angles of elements over what they may turn, of those that the bounds of x do
        not keep from it.
    pose : casadi.Function or None
        (x) -> position (3, 1), rotation (3, 3) and body Jacobian by x (6, n), of the outputs of
        these names, from one evaluation.
    second_order : SecondOrder or None
        Its equations of motion, where it has inertia.
    element_angles : casadi.Function or None
        (x) -> squared angles of all elements over what they may turn: `simulate` refuses to start
        beyond one, and warns of going there.
    spans : mapping of str to tuple
        By name of a part of the state, the functions along the span whose weights it holds, in
        order; what `project_state` goes by.
    """

    name: str
    x: Layout
    u: Layout
    p: Layout
    y: Layout
    xdot: ca.Function
    output: ca.Function
    real: Real = "double"
    angles: ca.Function | None = None
    pose: ca.Function | None = None
    second_order: SecondOrder | None = None
    element_angles: ca.Function | None = None
    spans: Mapping[str, tuple[Span, ...]] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<ControlModel {self.name}: {self.x.size} states, {self.u.size} inputs>"

    def __str__(self) -> str:
        rows = {
            name: ", ".join(f"{p.name} ({p.size}, {p.unit})" for p in layout.parts) or "none"
            for name, layout in zip("xupy", (self.x, self.u, self.p, self.y), strict=True)
        }
        return described(f"ControlModel {self.name}: parts (entries, unit)", rows)

    @property
    def residual(self) -> ca.Function:
        """(x, x_dot, u, p) -> residual (nx, 1), zero along solutions; inertia is not inverted.

        For a second-order model (rate − kinematics, balance, rate − other_rates), else
        x_dot − xdot(x, u, p).
        """
        x, x_dot = ca.MX.sym("x", self.x.size), ca.MX.sym("x_dot", self.x.size)
        u, p = ca.MX.sym("u", self.u.size), ca.MX.sym("p", self.p.size)
        if self.second_order is None:
            residual = x_dot - self.xdot(x, u, p)
        else:
            residual = _second_order_residual(self, self.second_order, x, x_dot, u, p)
        names = ["x", "x_dot", "u", "p"]
        return ca.Function(
            f"{self.name}_residual", [x, x_dot, u, p], [residual], names, ["residual"]
        )


def symbols_of(model: ControlModel) -> list[ca.MX]:
    """Symbols x, u and p of the sizes that a model has."""
    layouts = {"x": model.x, "u": model.u, "p": model.p}
    return [ca.MX.sym(name, layout.size) for name, layout in layouts.items()]


def _second_order_residual(
    model: ControlModel, motion: SecondOrder, x: ca.MX, x_dot: ca.MX, u: ca.MX, p: ca.MX
) -> ca.MX:
    n_others = motion.balance.size1_out("other_rates")
    acceleration, others = x_dot[-(n_others + motion.velocities) :], ca.MX(0, 1)
    if n_others:
        ends = [0, motion.velocities, acceleration.numel()]
        acceleration, others = ca.vertsplit(acceleration, ends)
    balance, other_rates = motion.balance(x, acceleration, u, p)
    rates = configuration_rates(model.x, motion, x)
    return ca.vertcat(x_dot[: rates.numel()] - rates, balance, others - other_rates)


def configuration_rates(layout: Layout, motion: SecondOrder, x: ca.MX) -> ca.MX:
    """Derivatives of the components of the configuration, by its kinematics."""
    parts = layout.parts[: motion.configuration]
    values = layout.split(x)
    rates = Layout(parts).errors.split(motion.kinematics(x))
    return ca.vertcat(
        *(
            quaternion.rate(values[part.name], rates[part.name])
            if part.attitude
            else rates[part.name]
            for part in parts
        )
    )
