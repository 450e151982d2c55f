"""Sensors and a shape filter from the tables `[[sensors]]` and `[estimation]` of a wing file.

Errors are those of wing files: `path: [table] key: expected …, found …`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from curvcasadi.beam.beam import Beam
from curvcasadi.estimation.ekf.filter import Estimate, ShapeEkf
from curvcasadi.estimation.ekf.maker import shape_ekf
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.beam import root_of
from curvcasadi.files.sensors import read_sensor
from curvcasadi.files.toml_reader import Key, Keys
from curvcasadi.files.wing import read_wing
from curvcasadi.sensors import RootMotion, Sensor
from curvcasadi.sensors.channels import sensor_channels

#: Arguments of `shape_ekf`, of the same names.
_FILTER = {
    "density": Key(
        toml.ONE_OR_EACH,
        "of the process noise, of all weights or each",
        "rad/(m √s); white acceleration rad/(m s √s)",
    ),
    "rate": Key(
        toml.ONE_OR_EACH,
        "standard deviation of q_dot, for gyros and accelerometers in a random walk",
        "rad/(m s)",
    ),
    "acceleration": Key(
        toml.ONE_OR_EACH, "standard deviation of q_ddot, for accelerometers", "rad/(m s²)"
    ),
    "attitude": Key(toml.FLAG, "whether the attitude of the parent is estimated, by a root gyro"),
    "root_gyro_density": Key(toml.NUMBER, "noise of that gyro", "rad/√s"),
    "gyro_bias": Key(toml.FLAG, "whether biases of the gyros are estimated"),
    "bias_density": Key(toml.NUMBER, "of the random walk of the biases", "rad/(s √s)"),
    "root_inputs": Key(
        toml.list_of(toml.TEXT, "a list of texts"),
        "motion of the root that the log holds: `attitude`, `position`, `twist`, `twist_rate`",
    ),
    "gate": Key(toml.NUMBER, "innovation beyond which a sample is left out", "standard deviations"),
    "iterations": Key(toml.WHOLE, "linearizations of an update; five or more from a rough start"),
}
#: Fields of `RootMotion`; `parent` is its pose.
_ROOT = {
    "parent": Key(
        toml.table_of("position", "rotation"),
        "pose of the parent axes in inertial axes, as [beam.root]",
        default="at the origin, level",
    ),
    "twist": Key(
        toml.VECTOR_6, "angular rate and velocity of the root, root axes", "rad/s, m/s", "at rest"
    ),
    "twist_rate": Key(toml.VECTOR_6, "time derivative of twist", "rad/s², m/s²", "zero"),
    "gravity": Key(toml.VECTOR, "for accelerometers, inertial axes", "m/s²"),
    "magnetic_field": Key(toml.VECTOR, "for magnetometers, inertial axes", "T"),
}
ESTIMATION = Keys(
    place="[estimation]",
    meaning="An extended Kalman filter, `shape_ekf`.",
    required={
        "process": Key(toml.TEXT, "`random_walk` or `white_acceleration`"),
        "density": _FILTER["density"],
        "deviation": Key(toml.table_of("q"), "standard deviations at the start"),
    },
    optional={
        **{name: key for name, key in _FILTER.items() if name != "density"},
        **_ROOT,
        "mean": Key(toml.table_of("q"), "state at the start", default="zero, level"),
    },
    describes=shape_ekf,
)
_PARTS = {
    "q_dot": ("rates of the weights; of white acceleration", "rad/(m s)"),
    "attitude": ("attitude of the parent", "rad"),
    "gyro_bias": ("biases of the gyros on the wing", "rad/s"),
    "root_gyro_bias": ("bias of the gyro at the root", "rad/s"),
}
DEVIATION = Keys(
    place="[estimation.deviation]",
    meaning="Standard deviations at the start: of every part that the filter has, one number or "
    "one for each entry.",
    required={"q": Key(toml.ONE_OR_EACH, "weights", "rad/m")},
    optional={
        name: Key(toml.ONE_OR_EACH, meaning, unit, "needed if the filter has it")
        for name, (meaning, unit) in _PARTS.items()
    },
)
MEAN = Keys(
    place="[estimation.mean]",
    meaning="State at the start, as far as it is not zero.",
    optional={
        "q": Key(toml.ONE_OR_EACH, "weights", "rad/m", "zero"),
        **{
            name: Key(toml.ONE_OR_EACH, meaning, unit, "zero")
            for name, (meaning, unit) in _PARTS.items()
        },
        "attitude": Key(
            toml.MATRIX, "rotation from parent to inertial axes", default="the identity"
        ),
    },
)

_OMEGA = tuple(f"root_omega_{axis}" for axis in "xyz")
#: Columns of a log that hold what `shape_ekf` calls rate, and its root_inputs.
INPUT_COLUMNS: dict[str, tuple[str, ...]] = {
    "rate": _OMEGA,
    "attitude": tuple(f"parent_R_{row}{column}" for column in "xyz" for row in "xyz"),
    "position": tuple(f"parent_position_{axis}" for axis in "xyz"),
    "twist": (*_OMEGA, *(f"root_v_{axis}" for axis in "xyz")),
    "twist_rate": (
        *(f"root_omega_dot_{axis}" for axis in "xyz"),
        *(f"root_v_dot_{axis}" for axis in "xyz"),
    ),
}


class LogColumns(NamedTuple):
    """Names of the columns of a log, beside its `time`."""

    inputs: tuple[str, ...]  #: of the known motion of the root
    values: tuple[str, ...]  #: of the sensors, as the labels of `measure`


@dataclass(frozen=True, eq=False, kw_only=True)
class EstimationFile:
    """What a wing file says of an estimation.

    Attributes
    ----------
    beam : Beam
        The wing.
    sensors : tuple of Sensor
        Its sensors.
    ekf : ShapeEkf
        The filter.
    start : Estimate
        What is known at time zero.
    inputs : tuple of str
        Names of inputs of the filter's Functions that a log holds.
    columns : LogColumns
        Names of the columns of a log.
    root : RootMotion
        Motion of the root, gravity and magnetic field.
    """

    beam: Beam
    sensors: tuple[Sensor, ...]
    ekf: ShapeEkf
    start: Estimate
    inputs: tuple[str, ...]
    columns: LogColumns
    root: RootMotion


def load_estimation(path: str | Path) -> EstimationFile:
    """Beam, sensors and filter of a wing file with the tables [[sensors]] and [estimation].

    Parameters
    ----------
    path : str or Path
        Wing file; SI units, radians.

    Returns
    -------
    EstimationFile
        Ready to run along a log.

    Raises
    ------
    ValueError
        As `load_wing`; and for wrong sensors, or a filter that cannot be built.
    OSError
        If it cannot be read.
    """
    file = toml.load_table(path)
    beam = read_wing(file).beam
    tables = file.tables("sensors")
    if not tables:
        raise file.error("sensors: expected one or more tables [[sensors]], found none")
    if "estimation" not in file.content:
        raise file.error(
            "estimation: expected a table [estimation] with process, density and deviation, "
            "found none"
        )
    sensors = tuple(read_sensor(table) for table in tables)
    with file.owning_errors():
        labels = sensor_channels(sensors).labels
    table = file.table("estimation")
    ekf, start, root = _filter(table, beam, sensors)
    inputs = (*ekf.predict.name_in()[3:], *ekf.update.name_in()[3:])
    names = [name for key in inputs for name in INPUT_COLUMNS[key]]
    columns = LogColumns(tuple(dict.fromkeys(names)), labels)
    twice = [n for n, k in Counter(("time", *columns.inputs, *columns.values)).items() if k > 1]
    if twice:
        raise file.error(
            f"sensors: expected other names than columns of a log, found {', '.join(twice)} twice"
        )
    return EstimationFile(
        beam=beam,
        sensors=sensors,
        ekf=ekf,
        start=start,
        inputs=inputs,
        columns=columns,
        root=root,
    )


def _filter(
    table: toml.Table, beam: Beam, sensors: tuple[Sensor, ...]
) -> tuple[ShapeEkf, Estimate, RootMotion]:
    values = table.read(ESTIMATION)
    deviation = table.table("deviation").read(DEVIATION)
    mean = table.table("mean").read(MEAN) if "mean" in values else {}
    motion = {key: values[key] for key in _ROOT if key in values}
    if "parent" in motion:
        motion["pose"] = root_of(table.table("parent"))
        del motion["parent"]
    options = {key: values[key] for key in _FILTER if key in values}
    with table.owning_errors():
        root = RootMotion(**motion)
        ekf = shape_ekf(beam, sensors, process=values["process"], root=root, **options)
        return ekf, ekf.initial(deviation, mean), root
