"""Nodes of the shape map and its Jacobian."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from benchmarks.table import Check, Table, checked
from curvcasadi.beam.grid import RuleName
from curvcasadi.symbolic.expressions import AnyExpr
from tests.support.wing import elements_for, tip_error, wing

#: Numbers of elements that double; none is 16, of which each is 1 m long and CasADi drops products.
DOUBLINGS = (10, 20, 40, 80)


@lru_cache(maxsize=256)
def nodes(
    elements: int, rule: RuleName = "magnus4", jacobian: bool = False, per_channel: int = 4
) -> int:
    """Nodes of the unrolled tip function of the test wing."""
    beam = wing(elements, rule, per_channel=per_channel)
    return int(cc.tip_function(beam, form="unrolled", jacobian=jacobian).n_instructions())


def ad_function(beam: cc.Beam, kind: Any = ca.SX) -> ca.Function:
    """Tip position, rotation and their Jacobian (12, n) by CasADi's AD of the chain."""
    q = kind.sym("q", beam.basis.n)
    tip = cc.shape_map(beam, q).tip
    outputs = tip.position, tip.rotation, pose_jacobian(tip.position, tip.rotation, q)
    names = ["position", "rotation", "jacobian"]
    return ca.Function("tip", [q], [*outputs], ["q"], names, {"cse": True})


def pose_jacobian(position: AnyExpr, rotation: AnyExpr, q: AnyExpr) -> AnyExpr:
    """Derivative of (position, vec rotation), (12, n), by AD."""
    return ca.jacobian(ca.veccat(position, rotation), q)


def per_element() -> Table:
    """Nodes per element, with AD beside the structured Jacobian."""
    sizes = (16, 32, 64)
    pose = max(nodes(n) / n for n in sizes)
    with_jacobian = max(nodes(n, jacobian=True) / n for n in sizes)
    by_ad = ad_function(wing(16)).n_instructions()
    checks = [
        Check(
            what="forward map, SX, magnus4, 12 weights: nodes per element",
            value=pose,
            high=210,
            form="{:.0f}",
        ),
        Check(
            what="pose and 6 × 12 body Jacobian, SX, magnus4: nodes per element",
            value=with_jacobian,
            high=930,
            form="{:.0f}",
        ),
        Check(
            what="pose and Jacobian, share of AD's nodes, 16 elements",
            value=nodes(16, jacobian=True) / by_ad,
            high=0.3,
            form="{:.2f}",
        ),
        Check(
            what="pose and Jacobian by AD of the chain: nodes per element",
            value=by_ad / 16,
            form="{:.0f}",
        ),
        Check(
            what="pose and Jacobian, nodes over those of the pose",
            value=nodes(16, jacobian=True) / nodes(16),
            form="{:.1f}",
        ),
    ]
    return checked("Nodes per element: the largest of 16, 32 and 64 elements", checks)


def growth() -> Table:
    """Cost is linear in the elements and affine in the weights."""
    checks = []
    for jacobian, name in ((False, "pose"), (True, "pose and Jacobian")):
        for n in DOUBLINGS[:-1]:
            checks.append(
                Check(
                    what=f"{name}: nodes of {2 * n} over those of {n} elements",
                    value=_doubled(n, jacobian),
                    low=1.9,
                    high=2.1,
                    form="{:.3f}",
                )
            )
    for jacobian, name in ((False, "pose"), (True, "pose and Jacobian")):
        slope, offset, deviation = _affine_fit(jacobian)
        checks.append(
            Check(
                what=f"{name}: nodes per element {offset:.0f} + {slope:.1f} n, largest deviation",
                value=deviation,
                high=0.01,
                form="{:.4f}",
            )
        )
    return checked(
        "Growth: doubled elements, and the number n of weights (6 to 24)",
        checks,
        (
            "Deviations are relative to the value. Of elements of exactly 1 m CasADi drops the",
            "products with 1, so that 16 elements are 3 to 6 % cheaper and 16 to 32 elements give",
            f"{_doubled(16, False):.3f} and {_doubled(16, True):.3f}; the counts above avoid that.",
        ),
    )


def _doubled(elements: int, jacobian: bool) -> float:
    """Nodes of twice the elements over those of the elements."""
    return nodes(2 * elements, jacobian=jacobian) / nodes(elements, jacobian=jacobian)


def _affine_fit(jacobian: bool) -> tuple[float, float, float]:
    """Slope, offset and largest relative deviation of nodes per element over the weights."""
    counts = (2, 3, 4, 5, 6, 8)
    n = 3 * np.array(counts)
    values = np.array([nodes(20, jacobian=jacobian, per_channel=k) / 20 for k in counts])
    slope, offset = np.polyfit(n, values, 1)
    return float(slope), float(offset), float(np.abs(slope * n + offset - values).max() / values[0])


def against_the_trapezoid_rule() -> Table:
    """Nodes for a tip error of 1e-8 L, pose alone."""
    target = 1e-8
    elements: dict[RuleName, int] = {
        rule: elements_for(target, rule) for rule in ("trapezoid", "magnus4", "magnus6")
    }
    slope = (nodes(160, "trapezoid") - nodes(80, "trapezoid")) / 80
    paper = nodes(80, "trapezoid") + slope * (elements["trapezoid"] - 80)
    checks = [
        Check(
            what="trapezoid: elements for a tip error of 1e-8 L",
            value=elements["trapezoid"],
            form="{:.0f}",
        ),
        Check(
            what="trapezoid: tip error there, in L",
            value=tip_error(elements["trapezoid"], "trapezoid"),
            form="{:.3e}",
        ),
        Check(what="trapezoid: nodes", value=paper, form="{:.0f}"),
    ]
    required: dict[RuleName, float | None] = {"magnus6": 200.0, "magnus4": None}
    for rule, low in required.items():
        n = elements[rule]
        own = nodes(n, rule)
        checks += [
            Check(what=f"{rule}: nodes with {n} elements", value=own, form="{:.0f}"),
            Check(
                what=f"{rule}: times fewer nodes than the trapezoid rule",
                value=paper / own,
                low=low,
                form="{:.0f}",
            ),
        ]
    return checked(
        "Nodes for a tip error of 1e-8 L against the paper's trapezoid rule",
        checks,
        (
            "The trapezoid rule's elements follow from its order 2 and the errors at that number,",
            "which is evaluated in numbers; its nodes are extrapolated from 80 and 160 elements,",
            "nodes being affine in the elements.",
        ),
    )
