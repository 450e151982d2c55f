"""The motion of a beam's root, and the fields of the world that sensors read."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields

import casadi as ca
import numpy as np

from curvcasadi.beam.pose import Pose, checked_pose
from curvcasadi.symbolic.expressions import (
    AnyExpr,
    Number,
    expression,
    instance,
    is_numeric,
    own_fields,
)

#: What a Function may take of the root's motion, by name of the input: its shape.
ROOT_INPUTS = {"attitude": (3, 3), "position": (3, 1), "twist": (6, 1), "twist_rate": (6, 1)}
#: The fields of `RootMotion` that such an input stands for.
_FIELDS = {
    "attitude": "RootMotion.pose.rotation",
    "position": "RootMotion.pose.position",
    "twist": "RootMotion.twist",
    "twist_rate": "RootMotion.twist_rate",
}


def _rest() -> AnyExpr:
    return ca.DM.zeros(6)


@dataclass(frozen=True, eq=False, kw_only=True)
class RootMotion:
    """How the root moves in inertial axes. The defaults are a beam clamped to the ground.

    Fields may be symbols. For a wing of an aircraft `pose` is that of the body axes.

    Attributes
    ----------
    pose : Pose
        Pose of the parent axes in inertial axes.
    twist : array or symbol, shape (6, 1)
        The root's own body twist, rad/s and m/s, root axes, the parent's motion included.
    twist_rate : array or symbol, shape (6, 1)
        Time derivative of the components of `twist`, rad/s² and m/s².
    gravity : array, symbol or None, shape (3, 1)
        Acceleration of gravity, m/s², inertial axes.
    magnetic_field : array, symbol or None, shape (3, 1)
        Magnetic field, T, inertial axes.
    """

    pose: Pose = field(default_factory=Pose.identity)
    twist: Number = field(default_factory=_rest)
    twist_rate: Number = field(default_factory=_rest)
    gravity: Number | None = None
    magnetic_field: Number | None = None

    def __post_init__(self) -> None:
        own_fields(self)
        object.__setattr__(self, "pose", checked_pose("RootMotion.pose", self.pose))
        for name, size in (("twist", 6), ("twist_rate", 6), ("gravity", 3), ("magnetic_field", 3)):
            value = getattr(self, name)
            if value is not None or size == 6:
                checked = expression(f"RootMotion.{name}", value, (size, 1))
                object.__setattr__(self, name, checked)

    @property
    def symbols(self) -> dict[str, AnyExpr]:
        """Fields that hold CasADi symbols, by name."""
        values = {f"RootMotion.{f.name}": getattr(self, f.name) for f in fields(self)[1:]}
        values["RootMotion.pose.rotation"] = self.pose.rotation
        values["RootMotion.pose.position"] = self.pose.position
        return {name: v for name, v in values.items() if v is not None and not is_numeric(v)}

    def with_inputs(self, values: Mapping[str, AnyExpr]) -> RootMotion:
        """The same with `values` of some of `ROOT_INPUTS`.

        Parameters
        ----------
        values : mapping of str to expression
            Any of "attitude" (3, 3), "position" (3, 1), "twist" and "twist_rate" (6, 1).

        Returns
        -------
        RootMotion
            With these values in place of its own.
        """
        return RootMotion(
            pose=Pose(
                rotation=values.get("attitude", self.pose.rotation),
                position=values.get("position", self.pose.position),
            ),
            twist=values.get("twist", self.twist),
            twist_rate=values.get("twist_rate", self.twist_rate),
            gravity=self.gravity,
            magnetic_field=self.magnetic_field,
        )


def numeric_root(root: RootMotion | None, inputs: Collection[str]) -> RootMotion:
    """`root`, at rest where None, with numbers in every field that is not among `inputs`.

    Raises
    ------
    ValueError
        If another field holds a symbol.
    """
    checked: RootMotion = instance("root", RootMotion() if root is None else root, RootMotion)
    replaced = [_FIELDS[key] for key in inputs if key in _FIELDS]
    for name, symbol in checked.symbols.items():
        if name not in replaced:
            raise ValueError(f"{name}: expected numbers, found the symbol {symbol}")
    return checked


def root_input_names(names: Sequence[str]) -> tuple[str, ...]:
    """`names`, each one of `ROOT_INPUTS`, none twice."""
    found = tuple(names) if np.iterable(names) and not isinstance(names, str) else None
    # A name that is none of them, or that comes twice, makes those that are fewer than all.
    if found is None or sum(name in found for name in ROOT_INPUTS) < len(found):
        raise ValueError(
            f"root_inputs: expected names among {', '.join(ROOT_INPUTS)}, each once; "
            f"found {names!r}"
        )
    return found
