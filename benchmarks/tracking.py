"""Real-time iterations that follow the tip along a path: how their damping is chosen.

A path of 250 steps bends every one of six wings up and down and in the plane and back; a second one
leaves reach by 0.11 m, along the normal of what is within reach. One quadratic program a step from
the last step's solution, at first from rest, in the exported C: of shape targets, whose weights
follow at once, and of the tip-path MPC, whose weights follow its commands with a lag. The tables
hold the largest distance of the tip to where the path has it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from itertools import product
from typing import Any

import numpy as np

import curvcasadi as cc
from benchmarks.native import NativeFunction
from benchmarks.table import Check, Table, checked, compared

LENGTH, STEPS, BEYOND = 7.4, 250, 0.11
#: Largest distances allowed, m: on the path in reach, and on that out of reach.
IN_REACH, OUT_OF_REACH = 0.05, 0.15
#: Of the tip-path MPC, s.
STAGES, DT, TIME_CONSTANT = 4, 0.05, 0.25
REALS = ("double", "float")


def _channels(torsion: int, out_of_plane: int, in_plane: int) -> cc.ChannelBasis:
    return cc.ChannelBasis(
        torsion=cc.Legendre(torsion),
        out_of_plane=cc.Legendre(out_of_plane),
        in_plane=cc.Legendre(in_plane),
    )


@cache
def wings(real: str) -> dict[str, cc.Beam]:
    """Six wings in a precision, by name."""
    angle = np.deg2rad(25.0)
    swept = cc.Pose(
        rotation=[[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]],
        position=[0.3, 0, 0.1],
    )
    splines = cc.ChannelBasis(
        torsion=cc.BSpline(4), out_of_plane=cc.BSpline(5), in_plane=cc.BSpline(4)
    )
    different = {
        "sweep": {"basis": _channels(2, 3, 2), "root": swept},
        "dihedral": {
            "basis": _channels(2, 3, 2),
            "initial_curvature": lambda xi: [0, -0.1 * (1 - xi), 0],
        },
        "splines": {"basis": splines},
        "washout": {"basis": _channels(2, 3, 2), "initial_curvature": lambda xi: [-0.012, 0, 0]},
        "few weights": {"basis": _channels(1, 2, 1)},
        "many weights": {"basis": _channels(4, 6, 4)},
    }
    grid = cc.Grid.uniform(8, real=real)  # type: ignore[arg-type]
    return {
        name: cc.Beam(length=LENGTH, grid=grid, weight_bounds=0.3, **parts)  # type: ignore[arg-type]
        for name, parts in different.items()
    }


def _bent(beam: cc.Beam, t: float) -> Any:
    """Weights at t in [0, 1] of a path from rest and back."""
    basis = beam.basis
    size = np.sin(np.pi * t)
    turn = np.array([0.01 * np.sin(6 * t), -0.09 * np.cos(5 * t), 0.02 * np.sin(4 * t)])
    wanted = size * turn
    columns = np.array(basis(0.3))
    return np.linalg.lstsq(columns, wanted, rcond=None)[0]


@cache
def paths(name: str) -> dict[str, Any]:
    """Tip positions (steps, 3) in reach and out of it."""
    beam = wings("double")[name]
    t = np.linspace(0, 1, STEPS)
    position = cc.tip_function(beam)
    within = np.array([position(_bent(beam, s))[0].full().ravel() for s in t])
    root, tip = (
        cc.pose_at(beam, np.zeros(beam.basis.n), xi).position.full().ravel() for xi in (0.0, 1.0)
    )
    far = root + 1.3 * (tip - root)
    nearest = cc.reach_shape(beam, [cc.Target(xi=1.0, position=far, weight=1.0)])
    edge = position(nearest.q)[0].full().ravel()
    normal = (far - edge) / np.linalg.norm(far - edge)
    # Bent, then beyond the edge of what is within reach, and bent again.
    edges = np.clip(3 * np.minimum(t, 1 - t), 0, 1)
    bends = [a * nearest.q + _bent(beam, 0.9 * (1 - a) * a) for a in edges]
    held = np.array([position(q)[0].full().ravel() for q in bends])
    beyond = np.sin(np.pi * np.clip(3 * t - 1, 0, 1))[:, None] ** 2
    return {"in reach": within, "out of reach": held + BEYOND * beyond * normal}


#: (weights of the wing, where its tip should be, status) of every step along a path
Steps = Iterator[tuple[Any, Any, str]]


def _by_shape_targets(beam: cc.Beam, options: dict[str, Any]) -> Callable[[Any], Steps]:
    target = cc.Target(xi=1.0, position=[LENGTH, 0, 0], weight=1.0)
    step = cc.shape_target_function(beam, [target], iterations=1, **options)
    rest = np.zeros(beam.basis.n)
    native = NativeFunction.compiled(step, beam, [rest, cc.tip_function(beam)(rest)[0]])

    def follow(path: Any) -> Steps:
        q = rest
        for goal in path:
            status, out = native(q, goal)
            q = out["q"] if status == "OK" else q
            yield q, goal, status

    return follow


def _by_tip_path(beam: cc.Beam, options: dict[str, Any]) -> Callable[[Any], Steps]:
    model = cc.kinematic_model(beam, time_constant=TIME_CONSTANT)
    step = cc.tip_path_step_function(
        model, dt=DT, horizon=STAGES, attitude_weight=0, iterations=1, **options
    )
    plant, rest = cc.rk4_step(model, DT), np.zeros(beam.basis.n)
    at_rest = np.tile(cc.tip_function(beam)(rest)[0].full(), STAGES)
    native = NativeFunction.compiled(
        step, beam, [rest, rest, rest, at_rest, np.zeros(2 * STAGES * rest.size)]
    )

    def follow(path: Any) -> Steps:
        x = u = rest
        plan = np.zeros(2 * STAGES * rest.size)
        for k in range(len(path) - 1):
            ahead = path[np.minimum(k + 1 + np.arange(STAGES), len(path) - 1)]
            status, out = native(x, rest, u, ahead.T, plan)
            u, plan = (out["u"], out["plan"]) if status == "OK" else (u, plan)
            x = plant(x, u, rest).full().ravel()
            yield x, path[k + 1], status

    return follow


#: By what is followed: the loop, and the dampings that are compared.
LOOPS = {
    "shape target": (_by_shape_targets, (0.0, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)),
    "tip path": (_by_tip_path, (0.0, 1e-3, 1e-2, 1e-1, 1.0, 10.0)),
}


def worst(loop: str, name: str, real: str, damping: float | None) -> dict[str, tuple[float, int]]:
    """Largest distance of the tip, and steps that were refused, by path."""
    options = {} if damping is None else {"damping": damping}
    follow = LOOPS[loop][0](wings(real)[name], options)
    position = cc.tip_function(wings("double")[name])
    found = {}
    for key, path in paths(name).items():
        steps = list(follow(path))
        tips = (position(q)[0].full().ravel() for q, _, _ in steps)
        away = [np.linalg.norm(tip - goal) for tip, (_, goal, _) in zip(tips, steps, strict=True)]
        found[key] = float(max(away)), sum(status != "OK" for _, _, status in steps)
    return found


def chosen() -> Table:
    """Tracking with the dampings that are the defaults."""
    cases = [*product(LOOPS, wings("double"), REALS)]
    with ProcessPoolExecutor(2) as pool:
        results = pool.map(worst, *zip(*cases, strict=True), [None] * len(cases))
        found = dict(zip(cases, results, strict=True))
    checks = []
    for (loop, name, real), by_path in found.items():
        for key, (distance, refused) in by_path.items():
            limit = IN_REACH if key == "in reach" else OUT_OF_REACH
            what = f"{loop}, {name}, {real}, {key}"
            checks.append(Check(what=f"{what}: m", value=distance, high=limit))
            checks.append(Check(what=f"{what}: refused", value=refused, high=0))
    return checked("Real-time iterations that follow a path: largest distance of the tip", checks)


def shape_target_dampings() -> Table:
    """Shape targets with other dampings."""
    return _dampings("shape target")


def tip_path_dampings() -> Table:
    """The tip-path MPC with other dampings."""
    return _dampings("tip path")


def _dampings(loop: str) -> Table:
    """In reach / out of reach, largest of both precisions."""
    dampings = LOOPS[loop][1]
    cases = [*product([loop], wings("double"), REALS, dampings)]
    with ProcessPoolExecutor(2) as pool:
        found = dict(zip(cases, pool.map(worst, *zip(*cases, strict=True)), strict=True))
    rows = []
    for damping in dampings:
        cells = [f"{damping:g}"]
        for name in wings("double"):
            both = [found[loop, name, real, damping] for real in REALS]
            parts = [
                f"{max(d for d, _ in (at[key] for at in both)):.4f}"
                + (f" ({n} refused)" if (n := sum(at[key][1] for at in both)) else "")
                for key in ("in reach", "out of reach")
            ]
            cells.append(" / ".join(parts))
        rows.append(cells)
    return compared(
        f"Damping of real-time iterations of the {loop}: largest distance of the tip, m",
        ("damping", *wings("double")),
        rows,
    )
