"""Measurements of a set of sensors, stacked: values, residuals, and structured derivatives."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import Pose
from curvcasadi.kinematics.root_motion import ROOT_INPUTS, RootMotion, numeric_root
from curvcasadi.kinematics.shape import poses
from curvcasadi.sensors.channels import Channels, checked_sensors, sensor_channels
from curvcasadi.sensors.optical import WIDEST, Camera
from curvcasadi.sensors.readout import Readout
from curvcasadi.sensors.sensor import Sensor
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Array,
    choice,
    expression,
    function_name,
    instance,
    is_numeric,
    same_kind,
)
from curvcasadi.symbolic.functions import function

RATES = ("q", "q_dot", "q_ddot")
#: What a measurement varies with: columns of the derivatives. That of an attitude is on the right.
VARIABLES = (*RATES, *ROOT_INPUTS)
KINDS: dict[str, Any] = {"compact": ca.MX, "unrolled": ca.SX}


@dataclass(frozen=True, eq=False)
class Measurement:
    """Stacked measurements of sensors, without noise."""

    values: AnyExpr  #: (m, 1)
    channels: Channels  #: what stands in which row

    @property
    def labels(self) -> tuple[str, ...]:
        """One per value."""
        return self.channels.labels

    @property
    def units(self) -> tuple[str, ...]:
        """One per value."""
        return self.channels.units

    @property
    def noise(self) -> Array:
        """Standard deviation of a sample of each residual."""
        return self.channels.noise


def measure(
    sensors: Sequence[Sensor],
    beam: Beam,
    q: AnyExpr,
    q_dot: AnyExpr | None = None,
    q_ddot: AnyExpr | None = None,
    root: RootMotion | None = None,
) -> Measurement:
    """What `sensors` on `beam` read, as expressions of the kind of the arguments.

    Parameters
    ----------
    sensors : sequence of Sensor
        Sensors on the wing.
    beam : Beam
        Wing.
    q : SX, MX, DM or array, shape (n, 1)
        Curvature weights, rad/m.
    q_dot : SX, MX, DM or array, shape (n, 1), optional
        Rates of the weights, rad/(m s); needed by gyros and accelerometers.
    q_ddot : SX, MX, DM or array, shape (n, 1), optional
        Accelerations of the weights, rad/(m s²); accelerometers leave their part out where None.
    root : RootMotion, optional
        Motion of the root, clamped to the ground where None. Accelerometers need its gravity,
        magnetometers its magnetic field.

    Returns
    -------
    Measurement
        Values (m, 1) and the names of their rows.

    Raises
    ------
    ValueError
        As `shape_map`; if something that a sensor reads is missing; and, of numbers, if a camera
        does not see its point.
    """
    readout = Readout.of(sensors, beam, q, q_dot, q_ddot, root)
    if readout.order and q_dot is None:
        raise ValueError(
            f"q_dot: expected shape {(beam.basis.n, 1)} for gyros and accelerometers, found None; "
            "zeros are a wing at rest"
        )
    values = readout.kind(readout.values())
    if readout.kind is ca.DM and not values.is_regular():
        check_in_view(sensors, beam, q)
    return Measurement(values, readout.channels)


def check_in_view(
    sensors: Sequence[Sensor], beam: Beam, q: AnyExpr, at: str = "", names: Collection[str] = ()
) -> None:
    """ValueError that names a camera which does not see its point at the numbers `q`.

    Parameters
    ----------
    at : which q, in words
    names : of the sensors that matter; all where there are none
    """
    for part, camera in zip(sensor_channels(sensors).layout.parts, sensors, strict=True):
        if not isinstance(camera, Camera) or (names and part.name not in names):
            continue
        (local,) = poses(beam, ca.DM(q), [camera.xi])
        offset = Pose(rotation=ca.DM.eye(3), position=camera.offset)
        x, y, z = (camera.pose.inverse() @ local @ offset).position.full().ravel()
        if not (z > 0 and np.hypot(x, y) < WIDEST * z):
            raise ValueError(
                f"{part.name}: expected the point before the camera, z > 0 and "
                f"|(x, y)| < {WIDEST:g} z in camera axes; found it at ({x:g}, {y:g}, {z:g}) m{at}"
            )


def measurement_residual(
    sensors: Sequence[Sensor],
    beam: Beam,
    measured: AnyExpr,
    q: AnyExpr,
    q_dot: AnyExpr | None = None,
    q_ddot: AnyExpr | None = None,
    root: RootMotion | None = None,
) -> AnyExpr:
    """Prediction minus measurement; of attitudes log(R_measuredᵀ R).

    Parameters
    ----------
    sensors : sequence of Sensor
        Sensors on the wing.
    beam : Beam
        Wing.
    measured : SX, MX, DM or array, shape (m, 1)
        Readings, rows as in `measure`.
    q, q_dot, q_ddot, root : optional
        As of `measure`.

    Returns
    -------
    SX, MX or DM, shape (r, 1)
        Residuals; those of an attitude are three, rad.

    Raises
    ------
    ValueError
        As `measure`; and for numbers in place of an attitude that are no rotation to 1e-2.
    """
    predicted = measure(sensors, beam, q, q_dot, q_ddot, root)
    layout = predicted.channels.layout
    measured = expression("measured", measured, (layout.size, 1))
    same_kind(measured=measured, values=predicted.values)
    found, given = layout.split(predicted.values), layout.split(measured)
    for sensor, part in zip(sensors, layout.parts, strict=True):
        if is_numeric(given[part.name]):
            given[part.name] = sensor.checked_sample(f"measured of {part.name}", given[part.name])
    rows = [
        sensor.residual(found[part.name], given[part.name])
        for sensor, part in zip(sensors, layout.parts, strict=True)
    ]
    return ca.vertcat(*rows)


def measurement_function(
    name: str,
    sensors: Sequence[Sensor],
    beam: Beam,
    inputs: Sequence[str] | None = None,
    root: RootMotion | None = None,
    form: Literal["compact", "unrolled"] = "compact",
) -> ca.Function:
    """Measurements and their structured derivatives as one Function.

    Parameters
    ----------
    name : str
        Name of the Function, also in generated C.
    sensors : sequence of Sensor
        Sensors on the wing.
    beam : Beam
        Wing.
    inputs : sequence of str, optional
        Inputs in order, out of "q", "q_dot", "q_ddot" (n, 1), "attitude" (3, 3) of the parent to
        inertial axes, "position" (3, 1) of the parent in inertial axes, and the root's "twist" and
        "twist_rate" (6, 1), root axes. Where None: q, and q_dot if a sensor reads rates. Rates of q
        that are no inputs are zero; of the root, those of `root`.
    root : RootMotion, optional
        Numbers for what is no input; gravity and magnetic field.
    form : {"compact", "unrolled"}
        "compact" is a chain of calls in MX (small C), "unrolled" is SX.

    Returns
    -------
    casadi.Function
        Inputs `inputs`, then measured (m, 1). Outputs values (m, 1), residual (r, 1) as
        `measurement_residual` has it, and for each of `inputs` "residual_<input>", the derivative
        of the residual, (r, columns). That by the attitude C has three columns, the rotation vector
        φ in C exp([φ×]), rad, parent axes. A NaN in `measured` stays in the residual of its sensor
        and, of an attitude sensor, in its rows of the derivatives. The derivative of a reading by
        the sensor's own bias is the identity, and no output. Derivatives are values only: their own
        are not attached.
    """
    function_name("name", name)
    checked = checked_sensors(sensors)
    instance("beam", beam, Beam)
    n = beam.basis.n
    kind = KINDS[choice("form", form, KINDS)]
    shapes = dict.fromkeys(RATES, (n, 1)) | ROOT_INPUTS
    names = _inputs(inputs, max(sensor.order for sensor in checked))
    symbols = {key: kind.sym(key, *shapes[key]) for key in names}
    root = numeric_root(root, names).with_inputs(symbols)
    readout = Readout.of(
        checked, beam, symbols["q"], symbols.get("q_dot"), symbols.get("q_ddot"), root
    )
    measured = kind.sym("measured", readout.channels.layout.size)
    columns = {key: 3 if key == "attitude" else shapes[key][0] for key in names}
    outputs = readout.derivatives(measured, columns)
    return function(name, {**symbols, "measured": measured}, outputs)


def _inputs(inputs: Sequence[str] | None, order: int) -> list[str]:
    if inputs is None:
        return ["q", "q_dot"] if order else ["q"]
    names = [*inputs] if np.iterable(inputs) and not isinstance(inputs, str) else [inputs]
    for key in names:
        choice("inputs", key, VARIABLES)
    if len(set(names)) < len(names) or "q" not in names:
        raise ValueError(f"inputs: expected 'q' and others, each once, found {names}")
    return names
