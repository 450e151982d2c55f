"""Sensors and a shape filter from the tables `[[sensors]]` and `[estimation]` of a wing file.

Errors are those of wing files: `path: [table] key: expected …, found …`.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import casadi as ca

from curvcasadi import sensors as kinds
from curvcasadi.beam.beam import Beam
from curvcasadi.estimation.ekf.filter import Estimate, ShapeEkf, shape_ekf
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.wing import read_wing, root_of
from curvcasadi.lie import so3
from curvcasadi.sensors import RootMotion, Sensor
from curvcasadi.sensors.channels import sensor_channels

#: Sensors by their kind in a wing file; their keys there are the fields of the class.
SENSOR_KINDS: dict[str, type[Sensor]] = {
    "rate_gyro": kinds.RateGyro,
    "accelerometer": kinds.Accelerometer,
    "attitude": kinds.AttitudeSensor,
    "magnetometer": kinds.Magnetometer,
    "strain_gauge": kinds.StrainGauge,
    "shear_gauge": kinds.ShearGauge,
    "marker": kinds.Marker,
    "camera": kinds.Camera,
}

_ONE_OR_EACH = toml.NUMBER | toml.NUMBERS
_TWIST = toml.list_of(toml.NUMBER, "6 finite numbers", 6)
_FLAG = toml.Kind("true or false", lambda value: isinstance(value, bool))
_NAMES = toml.list_of(toml.TEXT, "a list of texts")

_POINT = {"offset": toml.VECTOR}
_MOUNTING = {"mounting": toml.MATRIX | toml.table_of("rotation_vector")}
_NOISE = {"noise": _ONE_OR_EACH}
_SAMPLED: tuple[dict[str, toml.Kind], dict[str, toml.Kind]] = (
    {"noise_density": _ONE_OR_EACH, "rate": toml.NUMBER},
    {**_POINT, **_MOUNTING},
)
#: Keys of each kind besides kind, xi, name and bias: those that it needs, those that it may have.
_KEYS: dict[str, tuple[dict[str, toml.Kind], dict[str, toml.Kind]]] = {
    "rate_gyro": _SAMPLED,
    "accelerometer": _SAMPLED,
    "magnetometer": _SAMPLED,
    "attitude": (_NOISE, _MOUNTING),
    "strain_gauge": ({**_NOISE, "offset": toml.list_of(toml.NUMBER, "y and z, m", 2)}, {}),
    "shear_gauge": (_NOISE, {}),
    "marker": (_NOISE, _POINT),
    "camera": ({**_NOISE, "pose": toml.table_of("position", "rotation")}, _POINT),
}

#: Arguments of `shape_ekf`, of the same names.
_FILTER = {
    "density": _ONE_OR_EACH,
    "rate": _ONE_OR_EACH,
    "acceleration": _ONE_OR_EACH,
    "attitude": _FLAG,
    "root_gyro_density": toml.NUMBER,
    "gyro_bias": _FLAG,
    "bias_density": toml.NUMBER,
    "root_inputs": _NAMES,
    "gate": toml.NUMBER,
    "iterations": toml.WHOLE,
}
#: Fields of `RootMotion`; `parent` is its pose.
_ROOT = {
    "parent": toml.table_of("position", "rotation"),
    "twist": _TWIST,
    "twist_rate": _TWIST,
    "gravity": toml.VECTOR,
    "magnetic_field": toml.VECTOR,
}
_PARTS = ("q", "q_dot", "attitude", "gyro_bias", "root_gyro_bias")

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
    """What a wing file says of an estimation."""

    beam: Beam
    sensors: tuple[Sensor, ...]
    ekf: ShapeEkf
    start: Estimate  #: at time zero
    inputs: tuple[str, ...]  #: names of inputs of the filter's Functions that a log holds
    columns: LogColumns


def load_estimation(path: str | Path) -> EstimationFile:
    """Beam, sensors and filter of a wing file with the tables [[sensors]] and [estimation].

    Parameters
    ----------
    path : wing file; SI units, radians

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
    ekf, start = _filter(table, beam, sensors)
    inputs = (*ekf.predict.name_in()[3:], *ekf.update.name_in()[3:])
    names = [name for key in inputs for name in INPUT_COLUMNS[key]]
    columns = LogColumns(tuple(dict.fromkeys(names)), labels)
    twice = [n for n, k in Counter(("time", *columns.inputs, *columns.values)).items() if k > 1]
    if twice:
        raise file.error(
            f"sensors: expected other names than columns of a log, found {', '.join(twice)} twice"
        )
    return EstimationFile(
        beam=beam, sensors=sensors, ekf=ekf, start=start, inputs=inputs, columns=columns
    )


def read_sensor(table: toml.Table) -> Sensor:
    """Sensor of a table: its kind, and the fields of that class of `curvcasadi.sensors`."""
    kind = table.one_of("kind", tuple(SENSOR_KINDS))
    required, optional = _KEYS[kind]
    values = table.read(
        {"kind": toml.TEXT, "xi": toml.NUMBER, **required},
        {"name": toml.TEXT, "bias": _ONE_OR_EACH, **optional},
    )
    del values["kind"]
    if isinstance(values.get("mounting"), dict):
        turn = table.table("mounting").read({"rotation_vector": toml.VECTOR})
        values["mounting"] = so3.exp(ca.DM(turn["rotation_vector"]))
    if "pose" in values:
        values["pose"] = root_of(table.table("pose"))
    with table.owning_errors():
        return SENSOR_KINDS[kind](**values)


def _filter(
    table: toml.Table, beam: Beam, sensors: tuple[Sensor, ...]
) -> tuple[ShapeEkf, Estimate]:
    required = {"process": toml.TEXT, "density": _ONE_OR_EACH, "deviation": toml.table_of("q")}
    values = table.read(required, {**_FILTER, **_ROOT, "mean": toml.table_of("q")})
    deviation = table.table("deviation").read({"q": _ONE_OR_EACH}, _parts(_ONE_OR_EACH))
    mean = {}
    if "mean" in values:
        mean = table.table("mean").read({}, _parts(_ONE_OR_EACH) | {"attitude": toml.MATRIX})
    motion = {key: values[key] for key in _ROOT if key in values}
    if "parent" in motion:
        motion["pose"] = root_of(table.table("parent"))
        del motion["parent"]
    options = {key: values[key] for key in _FILTER if key in values}
    with table.owning_errors():
        root = RootMotion(**motion)
        ekf = shape_ekf(beam, sensors, process=values["process"], root=root, **options)
        return ekf, ekf.initial(deviation, mean)


def _parts(kind: toml.Kind) -> dict[str, toml.Kind]:
    return dict.fromkeys(_PARTS, kind)
