"""The residual of one sample as a `casadi.Function` with its structured Jacobian attached."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.estimation.samples import or_zero
from curvcasadi.kinematics.root_motion import ROOT_INPUTS
from curvcasadi.sensors import RootMotion, Sensor, measurement_function, sensor_channels
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.layout import Layout


def sample_residual(
    name: str,
    beam: Beam,
    sensors: Sequence[Sensor],
    node: Layout,
    known: Sequence[str] = (),
    root: RootMotion | None = None,
) -> ca.Function:
    """Residuals over their noise, 0 where a sample is missing or its point is not in view.

    Parameters
    ----------
    node : parts "q" and others of `measurement_function`'s inputs
    known : inputs among `ROOT_INPUTS`, numbers that no derivative is taken by
    root : numbers for what is no input; gravity and magnetic field

    Returns
    -------
    casadi.Function
        (node (v, 1), samples (m, 1), seen (r, 1), known …) -> residual (r, 1). CasADi's derivative
        by the node is the structured one; the other inputs are declared not differentiable.
    """
    channels = sensor_channels(sensors)
    inputs = {
        "node": ca.MX.sym("node", node.size),
        "samples": ca.MX.sym("samples", channels.layout.size),
        "seen": ca.MX.sym("seen", channels.residual_layout.size),
        **{key: ca.MX.sym(key, *ROOT_INPUTS[key]) for key in known},
    }
    parts = node.split(inputs["node"])
    read = measurement_function(f"{name}_readings", sensors, beam, [*parts, *known], root)
    given = {key: inputs[key] for key in known}
    found = read(**parts, **given, measured=inputs["samples"])
    weight = inputs["seen"] / ca.DM(channels.noise)
    residual = weight * found["residual"]
    if any(sensor.may_be_hidden for sensor in sensors):
        residual = or_zero(residual.shape[0])(residual)
    slopes = ca.horzcat(*(found[f"residual_{key}"] for key in parts))

    return with_jacobian(
        name,
        inputs,
        {"residual": residual},
        {"residual": ca.diag(weight) @ slopes},
        held=[*inputs][1:],
    )
