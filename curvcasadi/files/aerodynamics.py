"""Airfoil data and control surfaces, from the tables `aerodynamics` of aircraft files."""

from __future__ import annotations

from itertools import pairwise

from curvcasadi.aero import ControlSurface, ExponentialTipLoss, StripAerodynamics
from curvcasadi.aero.strip import QUANTITIES
from curvcasadi.files import toml_reader as toml
from curvcasadi.files.sections import piecewise
from curvcasadi.files.toml_reader import Key, Keys

_QUANTITY = toml.NUMBER | toml.table_of("xi", "values")

AERODYNAMICS = Keys(
    place="[beams.aerodynamics] and [surfaces.aerodynamics]",
    meaning="Airfoil data: each a number, or a table of values along the span.",
    required={
        "chord": Key(_QUANTITY, "chord", "m"),
        "aerodynamic_center": Key(_QUANTITY, "distance ahead of the reference curve", "m"),
        "lift_slope": Key(_QUANTITY, "2 π of a thin airfoil", "1/rad"),
    },
    optional={
        "zero_lift_angle": Key(
            _QUANTITY, "angle of attack without lift; negative for positive camber", "rad"
        ),
        "profile_drag": Key(_QUANTITY, "drag coefficient of the profile"),
        "moment_coefficient": Key(
            _QUANTITY, "about the aerodynamic centre, positive leading edge up"
        ),
        "moment_slope": Key(
            _QUANTITY, "of that moment by the angle of attack, positive leading edge up", "1/rad"
        ),
        "suction": Key(
            _QUANTITY,
            "part of the leading-edge suction: 1: lift normal to the flow; 0: to the chord",
        ),
        "stations": Key(toml.WHOLE, "number of stations at which airloads are integrated"),
        "upper_side": Key(
            toml.WHOLE,
            "1: local z points out of the upper side; -1: the lower; needed where the root is "
            "upright, else as its attitude says",
        ),
        "tip_loss": Key(toml.table_of("decay"), "loss of lift towards the tip"),
        "controls": Key(toml.TABLES, "control surfaces"),
    },
    describes=StripAerodynamics,
)
VARIED = Keys(
    place="[beams.aerodynamics.<quantity>]",
    meaning="A quantity that varies along the span, constant or linear between stations.",
    required={
        "xi": Key(toml.NUMBERS, "m + 1 stations from 0 to 1"),
        "values": Key(
            toml.NUMBERS,
            "m values, each constant between two stations, or m + 1, linear between stations",
            "that of the quantity",
        ),
    },
)
TIP_LOSS = Keys(
    place="[beams.aerodynamics.tip_loss]",
    meaning="The factor 1 - exp(-decay (1 - xi)) on the lift.",
    required={"decay": Key(toml.NUMBER, "lift is 63 % at 1/decay of the length from the tip")},
)
CONTROL = Keys(
    place="[[beams.aerodynamics.controls]]",
    meaning="A control surface: increments of the coefficients per angle of deflection.",
    required={
        "name": Key(toml.TEXT, "of the input that deflects it"),
        "lift": Key(toml.NUMBER, "increment of the lift coefficient", "1/rad"),
    },
    optional={
        "moment": Key(toml.NUMBER, "of the moment coefficient, positive leading edge up", "1/rad"),
        "drag": Key(toml.NUMBER, "of the drag coefficient", "1/rad"),
        "start": Key(toml.NUMBER, "station s/L at which it begins"),
        "end": Key(toml.NUMBER, "station s/L at which it ends"),
        "antisymmetric": Key(
            toml.FLAG, "deflects the other way on a mirrored wing, as ailerons do"
        ),
    },
    describes=ControlSurface,
)


def read_strips(table: toml.Table) -> StripAerodynamics:
    """Airfoil data: numbers, or tables along the span."""
    varied = [key for key in QUANTITIES if isinstance(table.content.get(key), dict)]
    values = table.read(AERODYNAMICS)
    values |= {key: piecewise(table.table(key), VARIED) for key in varied}
    if "tip_loss" in values:
        values["tip_loss"] = _tip_loss(table.table("tip_loss"))
    values["controls"] = tuple(_control(entry) for entry in table.tables("controls"))
    with table.owning_errors():
        strips = StripAerodynamics(**values)
        for left, right in pairwise((0.0, *strips.breaks, 1.0)):
            for name in QUANTITIES:
                strips.at(name, round((left + right) / 2, 12))
    return strips


def _tip_loss(table: toml.Table) -> ExponentialTipLoss:
    values = table.read(TIP_LOSS)
    with table.owning_errors():
        return ExponentialTipLoss(**values)


def _control(table: toml.Table) -> ControlSurface:
    values = table.read(CONTROL)
    with table.owning_errors():
        return ControlSurface(**values)
