"""Sensors on a wing, from the tables [[sensors]] of a wing file."""

from __future__ import annotations

from curvcasadi import sensors as kinds
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.beam import root_of
from curvcasadi.files.toml_reader import Key, Keys
from curvcasadi.lie import so3
from curvcasadi.sensors import Sensor
from curvcasadi.symbolic.expressions import rotation_vector

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

_OFFSET = {"offset": Key(toml.VECTOR, "of its place from the reference curve, local axes", "m")}
_MOUNTING = {
    "mounting": Key(
        toml.MATRIX | toml.table_of("rotation_vector"),
        "rotation from sensor to local axes, a matrix or { rotation_vector = [...] }, rad",
    )
}
_REFERENCE = {
    "reference": Key(
        toml.TEXT, "shape at which it reads zero: `unloaded` or `straight`", default="unloaded"
    )
}
_POSE = {
    "pose": Key(toml.table_of("position", "rotation"), "of the camera, parent axes, as [beam.root]")
}


def _keys(kind: str, meaning: str, unit: str, noise: str, *optional: dict[str, Key]) -> Keys:
    """Keys of a kind of sensor; `noise` is the unit of what its data sheet states of the noise."""
    if "√Hz" in noise:
        sampled = {
            "noise_density": Key(toml.ONE_OR_EACH, "of the noise, all axes or each", noise),
            "rate": Key(toml.NUMBER, "samples per second", "Hz"),
        }
    else:
        sampled = {"noise": Key(toml.ONE_OR_EACH, "standard deviation of a sample", noise)}
    merged = {name: key for part in optional for name, key in part.items()}
    needed = {name for name in ("pose",) if name in merged} | (
        {"offset"} if kind == "strain_gauge" else set()
    )
    return Keys(
        place=f'[[sensors]] with kind = "{kind}"',
        meaning=meaning,
        required={
            "kind": Key(toml.TEXT, f"`{kind}`"),
            "xi": Key(toml.NUMBER, "station s/L, 0 to 1"),
            **sampled,
            **{name: merged[name] for name in merged if name in needed},
        },
        optional={
            "name": Key(toml.TEXT, "of the sensor in logs", default="its kind and a number"),
            "bias": Key(toml.ONE_OR_EACH, "known bias, added to what it reads", unit, "zero"),
            **{name: merged[name] for name in merged if name not in needed},
        },
        describes=SENSOR_KINDS[kind],
    )


#: Keys by the kind of a sensor.
SENSORS = {
    "rate_gyro": _keys(
        "rate_gyro", "Angular rate, sensor axes.", "rad/s", "rad/(s √Hz)", _OFFSET, _MOUNTING
    ),
    "accelerometer": _keys(
        "accelerometer",
        "Specific force: acceleration minus gravity, sensor axes.",
        "m/s²",
        "m/(s² √Hz)",
        _OFFSET,
        _MOUNTING,
    ),
    "magnetometer": _keys(
        "magnetometer", "Magnetic field, sensor axes.", "T", "T/√Hz", _OFFSET, _MOUNTING
    ),
    "attitude": _keys(
        "attitude", "Rotation from sensor to inertial axes.", "rad", "rad", _MOUNTING
    ),
    "strain_gauge": _keys(
        "strain_gauge",
        "Axial strain at a point of the section.",
        "1",
        "1",
        {
            "offset": Key(
                toml.list_of(toml.NUMBER, "y and z, m", 2), "of the point, local axes", "m"
            )
        },
        _REFERENCE,
    ),
    "shear_gauge": _keys("shear_gauge", "Elastic torsion.", "rad/m", "rad/m", _REFERENCE),
    "marker": _keys("marker", "Position of a point, inertial axes.", "m", "m", _OFFSET),
    "camera": _keys(
        "camera", "Bearing to a point: image coordinates x/z and y/z.", "1", "1", _POSE, _OFFSET
    ),
}
MOUNTING = Keys(
    place="[sensors.mounting]",
    meaning="Axes of a sensor.",
    required={"rotation_vector": Key(toml.VECTOR, "axis times angle, sensor to local", "rad")},
)


def read_sensor(table: toml.Table) -> Sensor:
    """Sensor of a table: its kind, and the fields of that class of `curvcasadi.sensors`."""
    kind = table.one_of("kind", tuple(SENSOR_KINDS))
    values = table.read(SENSORS[kind])
    del values["kind"]
    if isinstance(values.get("mounting"), dict):
        mounting = table.table("mounting")
        turn = mounting.read(MOUNTING)["rotation_vector"]
        with mounting.owning_errors():
            values["mounting"] = so3.exp(rotation_vector("rotation_vector", turn))
    if "pose" in values:
        values["pose"] = root_of(table.table("pose"))
    with table.owning_errors():
        return SENSOR_KINDS[kind](**values)
