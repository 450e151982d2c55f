"""What sensors on a wing read while a model of it moves."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.control.model import ControlModel, symbols_of
from curvcasadi.kinematics.root_motion import RootMotion
from curvcasadi.sensors import Sensor, measure
from curvcasadi.symbolic.expressions import instance


def readings_function(
    model: ControlModel,
    beam: Beam,
    sensors: Sequence[Sensor],
    *,
    root: RootMotion | None = None,
) -> ca.Function:
    """Readings of sensors, without noise, from state, inputs and parameters of a model.

    Accelerations of the weights are the model's own, so that accelerometers feel inputs and gusts.

    Parameters
    ----------
    model : ControlModel
        Model of one wing whose state has the parts q and q_dot, such as `wing_model`.
    beam : Beam
        Its wing.
    sensors : sequence of Sensor
        Sensors on the wing.
    root : RootMotion, optional
        Motion of the root, as of `measure`.

    Returns
    -------
    casadi.Function
        (x, u, p) -> readings (m, 1), rows as in `sensor_channels(sensors)`; for `compile_batch`.

    Raises
    ------
    ValueError
        If the state has no such parts of the beam's size, or as `measure`.
    """
    instance("model", model, ControlModel)
    n = instance("beam", beam, Beam).basis.n
    sizes = {part.name: part.size for part in model.x.parts}
    if any(sizes.get(name) != n for name in ("q", "q_dot")):
        raise ValueError(
            f"model: expected a state with parts q and q_dot of {n} entries, as the beam has "
            f"weights, found {sizes}"
        )
    x, u, p = symbols_of(model)
    state, rates = model.x.split(x), model.x.split(model.xdot(x, u, p))
    measured = measure(sensors, beam, state["q"], state["q_dot"], rates["q_dot"], root)
    return ca.Function(
        f"{model.name}_readings",
        [x, u, p],
        [measured.values],
        ["x", "u", "p"],
        ["readings"],
        {"cse": True},
    )
