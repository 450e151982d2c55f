"""The functions whose size and speed on a Cortex-M are measured.

A library is what one call of `export_c` writes. Unless their names say otherwise, wings have 32
elements and 6 weights, two Legendre functions for each of the three curvatures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from benchmarks import wing as test_wing

CPUS = ("cortex-m7", "cortex-m4")

#: Tip error, in lengths, that the midpoint rule and magnus4 are compared at.
TIP_ERROR = 1e-4


@dataclass(frozen=True, eq=False, kw_only=True)
class Library:
    """Functions of one beam that are exported together."""

    name: str
    beam: cc.Beam
    functions: Callable[[cc.Beam], Sequence[ca.Function | cc.CFunction]]
    #: by function, samples at which it is compared and measured; random weights unless given
    reference_inputs: Callable[[cc.Beam], Mapping[str, Any]] = field(default=lambda _: {})
    cpus: tuple[str, ...] = CPUS

    def export(self, directory: Any) -> dict[str, Any]:
        """The manifest of what is written into `directory`."""
        return cc.export_c(
            self.functions(self.beam),
            directory,
            real=self.beam.grid.real,
            beam=self.beam,
            reference_inputs=self.reference_inputs(self.beam),
        )


def wing(elements: int = 32, **grid: Any) -> cc.Beam:
    """16 m, 6 weights of at most 0.1 rad/m: no element turns by more than 0.2 rad."""
    two = cc.Legendre(2)
    options = {"rule": "midpoint", "real": "float", "max_angle": 0.2} | grid
    return cc.Beam(
        length=16.0,
        basis=cc.ChannelBasis(torsion=two, out_of_plane=two, in_plane=two),
        grid=cc.Grid.uniform(elements, **options),
        section=cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6),
        weight_bounds=0.1,
    )


def strongly_bent(rule: Any, max_angle: float) -> cc.Beam:
    """The test wing of the benchmark, with as few elements as its tip error allows."""
    elements = test_wing.elements_for(TIP_ERROR, rule)
    grid = cc.Grid.uniform(elements, rule=rule, real="float", max_angle=max_angle)
    return replace(test_wing.on_grid(grid), weight_bounds=np.abs(test_wing.WEIGHTS))


def tips(beam: cc.Beam) -> list[ca.Function]:
    return [
        cc.pose_function("tip", beam, (1.0,)),
        cc.pose_function("tip_jacobian", beam, (1.0,), jacobian=True),
    ]


def tip(beam: cc.Beam) -> list[ca.Function]:
    return [cc.tip_function(beam)]


LIBRARIES = (
    Library(name="midpoint_32", beam=wing(), functions=tips),
    Library(name="midpoint_64", beam=wing(64), functions=tips),
    Library(name="double_32", beam=wing(real="double"), functions=tips, cpus=("cortex-m7",)),
    Library(name="bent_midpoint", beam=strongly_bent("midpoint", 0.06), functions=tip),
    Library(name="bent_magnus4", beam=strongly_bent("magnus4", 0.7), functions=tip),
)
