"""Symbols in what a model is made of: of the wrong kind, and named ones that act on nothing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import casadi as ca

from curvcasadi.dynamics.system import System
from curvcasadi.statics.energy import stiffness_matrix
from curvcasadi.symbolic.expressions import Number


def refuse_sx(*descriptions: Any) -> None:
    """ValueError of an SX symbol in a field of beams, loads or strips: models are made of MX."""
    for description in descriptions:
        if isinstance(description, tuple | list):
            refuse_sx(*description)
        elif is_dataclass(description):
            for entry in fields(description):
                value = getattr(description, entry.name)
                if isinstance(value, ca.SX):
                    raise ValueError(
                        f"{type(description).__name__}.{entry.name}: expected numbers or MX "
                        f"symbols in a control model, found {value}"
                    )
                refuse_sx(value)


def refuse_idle(
    argument: str, symbols: Mapping[str, ca.MX], built: System, others: Sequence[Number] = ()
) -> None:
    """ValueError of symbols that stand in no load, in no field of the beam and in none of `others`.

    Parameters
    ----------
    argument : str
        The argument that named them.
    symbols : mapping of str to MX symbol
        By their names.
    built : System
        The beam with its loads and the motion of its root.
    others : sequence of numbers or expressions
        What else they may stand in.
    """
    loads = [data for station in built.loads for _, data in station]
    loads += [data for coupled in built.couplings for data in (coupled.data, *coupled.own)]
    fields = [stiffness_matrix(built.beam), *built.beam.design_symbols.values()]
    used = ca.veccat(*loads, *built.inertias.data, built.parent.gravity, *fields, *others)
    for name, symbol in symbols.items():
        if not ca.depends_on(ca.MX(used), symbol):
            raise ValueError(
                f"{argument}: expected symbols in loads or fields, found {name!r}, which acts on "
                "nothing"
            )
