"""Equilibria against published and exact cases, their nodes and Newton iterations."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

import curvcasadi as cc
from benchmarks.table import Check, Table, checked
from curvcasadi.aero import AerodynamicLoad, Flow, StripAerodynamics, strip_forces
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.expressions import Array, Number

REFERENCE = Path(__file__).resolve().parents[1] / "tests" / "reference"
UP = np.array([0.0, 0.0, 1.0])
#: Midchord of the Pazy wing from its reference axis at 44.096 % of the chord of 98.9 mm, m.
MIDCHORD = np.array([0, (0.44096 - 0.5) * 0.0989, 0])
WEIGHT = (cc.Gravity([0, 0, -9.80665]),)


class Row(NamedTuple):
    """One requirement: the largest error of a case."""

    case: str
    reference: str
    errors: Iterator[float]  #: positions over the length
    required: float


@cache
def case(prefix: str) -> Any:
    """A case of tests/reference by the beginning of its file name."""
    (path,) = REFERENCE.glob(f"{prefix}_*.json")
    return json.loads(path.read_text())


def rod(
    weights: tuple[int, int, int],
    section: cc.Section | None = None,
    grid: cc.Grid | None = None,
    length: float = 1.0,
    **fields: Any,
) -> cc.Beam:
    """A beam of Legendre functions a channel, of unit stiffness and on 24 Lobatto elements."""
    names = ("torsion", "out_of_plane", "in_plane")
    return cc.Beam(
        length=length,
        basis=cc.ChannelBasis(
            **{k: cc.Legendre(n) for k, n in zip(names, weights, strict=True) if n}
        ),
        grid=grid or cc.Grid.lobatto(24),
        section=section or cc.Section(GJ=1, EI_y=1, EI_z=1),
        **fields,
    )


def rolled(degrees: float) -> cc.Pose:
    """A root that is turned about the span."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return cc.Pose(rotation=[[1, 0, 0], [0, c, -s], [0, s, c]], position=[0, 0, 0])


def tip(beam: cc.Beam, loads: Sequence[Any]) -> Array:
    """Tip position in equilibrium, m."""
    found = cc.solve_equilibrium(beam, loads).shape.tip.position
    return np.asarray(found.full().ravel())


def error(beam: cc.Beam, loads: Sequence[Any], expected: Any) -> float:
    """Distance of the tip from where it should be, over the length."""
    return float(np.linalg.norm(tip(beam, loads) - np.asarray(expected)) / beam.length)


def roll_up() -> Iterator[float]:
    beam = rod((0, 1, 0), grid=cc.Grid.uniform(16))
    for row in case("01")["reference"]:
        load = cc.PointMoment(1.0, [0, -row["M"], 0])
        yield error(beam, [load], [row["x_tip"], 0, row["h_tip"]])


def elastica(weights: int, rule: Any = "magnus4") -> Iterator[float]:
    grid = cc.Grid.lobatto(24 if rule == "magnus4" else 16, rule=rule)
    for counts, side in (((0, weights, 0), UP), ((0, 0, weights), np.array([0, 1, 0]))):
        beam = rod(counts, grid=grid)
        for row in case("02")["reference"]:
            expected = np.array([1 - row["u_over_L"], 0, 0]) + row["w_over_L"] * side
            yield error(beam, [cc.PointForce(1.0, row["PL2_EI"] * side)], expected)


def follower() -> Iterator[float]:
    beam = rod((0, 12, 0))
    for row in case("03")["reference"]:
        load = cc.PointForce(1.0, row["FL2_EI"] * UP, "follower")
        yield error(beam, [load], [1 + row["tip_u_x"], 0, row["tip_w_z"]])


def bend(rigidity: float = 833333.3333) -> cc.Beam:
    """The 45 degree bend of radius 100 in of Bathe and Bolourchi, lb and in."""
    section = cc.Section(GJ=rigidity, EI_y=833333.3333, EI_z=833333.3333)
    return rod((8, 8, 8), section, length=78.53981634, initial_curvature=[0, 0, 0.01])


def dead_bend() -> Iterator[float]:
    data = case("04")
    for rows, key in (("kirchhoff_GJ_J=1/6", "GJ_polar"), ("kirchhoff_GJ_J=0.141", "GJ_0141")):
        beam = bend(data["section"][key])
        for row in data["reference"]["computed_exact"][rows]:
            yield error(beam, [cc.PointForce(1.0, row["F"] * UP)], row["tip_position"])


def follower_bend() -> Iterator[float]:
    start = 100 * np.array([np.sin(np.pi / 4), 1 - np.cos(np.pi / 4), 0])
    for row in case("05")["reference"]["computed_exact"]["kirchhoff_GJ_J=1/6"]:
        load = cc.PointForce(1.0, row["F"] * UP, "follower")
        yield error(bend(), [load], start + row["tip_displacement"])


def self_weight() -> Iterator[float]:
    for row in case("07")["reference"]["exact"]:
        section = cc.Section(GJ=1, EI_y=1, EI_z=1, mass_per_length=row["qL3_EI"])
        expected = [1 - row["u_over_L"], 0, -row["w_over_L"]]
        yield error(rod((0, 10, 0), section), [cc.Gravity(-UP)], expected)


def composite() -> Iterator[float]:
    data = case("14")
    section = cc.Section.from_stiffness(data["section"]["stiffness_Kx_Ky_Kz_3x3"])
    beam = rod((8, 8, 8), section, length=10.0)
    for row in data["reference"]["computed"]["kirchhoff"]:
        expected = np.add([10, 0, 0], row["tip_displacement"])
        yield error(beam, [cc.PointForce(1.0, row["P"] * UP)], expected)


def strips() -> Iterator[float]:
    data = case("16")
    for name, rows in data["reference"]["computed_kirchhoff"].items():
        strip, _, angle = name.partition("_theta")
        constants = data["section"][strip]
        stiffness = np.diag(constants["diag"][3:])
        stiffness[0, 1] = stiffness[1, 0] = constants.get("K_twist_flap_45", 0)
        section = cc.Section.from_stiffness(stiffness)
        beam = rod((6, 6, 6), section, length=0.55, root=rolled(float(angle)))
        for row in rows:
            weight = row["load_gram"] * 1e-3 * 9.80665
            expected = np.add([0.55, 0, 0], row["u_tip_550mm"])
            yield error(beam, [cc.PointForce(1.0, -weight * UP)], expected)


def sharpy() -> Iterator[float]:
    beam = rod((0, 8, 0), cc.Section(GJ=1e6, EI_y=9.346e6, EI_z=9.346e6), length=5.0)
    for frame, rows in case("17")["reference"]["computed"]["kirchhoff"].items():
        for row in rows:
            load = cc.PointForce(1.0, -row["F"] * UP, frame)
            yield error(beam, [load], [5 + row["u_x"], 0, row["u_z"]])


def helix() -> Iterator[float]:
    grid = cc.Grid.uniform(32, rule="magnus6")
    beam = rod((8, 8, 8), cc.Section(GJ=0.6, EI_y=1, EI_z=1), grid)
    for row in case("18")["reference"]:
        load = cc.PointMoment(1.0, row["tip_moment_root_frame"])
        yield error(beam, [load], row["tip_position"])


def offset_weight() -> Iterator[float]:
    data = case("19")
    for row in data["reference"]:
        section = cc.Section.from_stiffness(
            data["section"]["stiffness_Kx_Ky_Kz_3x3"],
            mass_per_length=row["weight_per_length"],
            center_of_mass=data["section"]["cg_offset_section_xyz"],
        )
        beam = rod((8, 8, 8), section, root=rolled(row["root_rotation_about_x_deg"]))
        yield error(beam, [cc.Gravity(-UP)], row["tip_position"])


def strain_based() -> Iterator[float]:
    beam = rod((2, 6, 2), cc.Section(GJ=80, EI_y=50, EI_z=1250))
    for row in case("20")["reference"]:
        for frame in ("dead", "follower"):
            load = cc.PointForce(1.0, row["F"] * UP, frame)  # type: ignore[arg-type]
            yield error(beam, [load], [1 + row[frame]["u_x"], 0, row[frame]["u_z"]])


def partial_load() -> Iterator[float]:
    """Over the deflection of 4e-8 L."""
    grid = cc.Grid.lobatto(16, rule="magnus6")
    beam = rod((0, 6, 0), cc.Section(GJ=1e9, EI_y=1e9, EI_z=1e9), grid)
    load = cc.DistributedForce(cc.Steps([0, 0.3, 0.7, 1], [[0, 0, 0], [0, 0, 1000], [0, 0, 0]]))
    expected = case("22")["reference"]["tip_deflection"]
    yield abs(float(tip(beam, [load])[2]) / expected - 1)


def pazy(skin: str, tip_mass: Number) -> cc.Beam:
    """The Pazy wing of case 09 with a mass at the midchord of its tip."""
    geometry = case("09")["geometry"]
    y = np.array(geometry["node_y"])
    xi, model = y / y[-1], geometry[skin]
    stiffness, inertia = model["stiffness_per_element"], model["inertia_per_node"]
    full = np.zeros((15, 4, 4))
    for i in range(4):
        for j in range(i, 4):
            full[:, i, j] = full[:, j, i] = stiffness[f"K{i + 1}{j + 1}"]
    bodies = [
        cc.Body(
            xi=float(xi[k]),
            mass=inertia["mass"][k],
            offset=[inertia["cgy"][k], -inertia["cgx"][k], inertia["cgz"][k]],
        )
        for k in range(1, 16)
    ]
    return rod(
        (4, 6, 3),
        cc.Section.from_stiffness(cc.Steps(xi, [cc.condense_axial(table) for table in full])),
        cc.Grid.lobatto(15),
        float(y[-1]),
        bodies=(*bodies, cc.Body(xi=1.0, mass=tip_mass, offset=MIDCHORD)),
    )


def pazy_sweep(skin: str, masses: Sequence[float]) -> Array:
    """Midchord of the tip (3, masses) from that under self weight, percent of the semispan."""
    mass = ca.MX.sym("mass")
    equilibrium = cc.equilibrium_function(pazy(skin, mass), WEIGHT, {"mass": mass})
    beam = pazy(skin, 0.0)
    q, points = ca.DM.zeros(beam.basis.n), []
    for value in (0.0, *masses):
        q = equilibrium(q, value)
        end = cc.shape_map(beam, q).tip
        points.append((end.position + end.rotation @ ca.DM(MIDCHORD)).full())
    return np.asarray(100 * (np.hstack(points[1:]) - points[0]) / beam.length)


def pazy_errors(rows: str) -> Iterator[float]:
    """Vertical and axial errors over the semispan."""
    for skin in ("skin0", "skin1"):
        data = case("10")["reference"][skin]
        if rows == "umnast_beam":
            table = np.array(data[rows]["rows"])
        else:
            keys = ("tip_mass_kg", "d_vertical_pct_semispan", "d_axial_pct")
            found = data[rows]["relative_to_self_weight"]
            table = np.array([[row[key] for key in keys] for row in found])
        moved = pazy_sweep(skin, table[:, 0].tolist())
        yield float(np.abs(moved[[2, 0]].T - table[:, 1:]).max() / 100)


def smith_wing(angle: float, in_plane: float = 5e6) -> cc.Beam:
    """The wing of case D11, x along the span, y upstream, z up; root nose-up by `angle` degrees."""
    section = cc.Section(GJ=1e4, EI_y=2e4, EI_z=in_plane, mass_per_length=0.75)
    return rod((5, 6, 4), section, cc.Grid.lobatto(16), 16.0, root=rolled(angle))


def strip_load(speed: float, density: float = 0.08891) -> AerodynamicLoad:
    """Steady strips of case D11: lift slope 2 π at the quarter chord, the curve at half chord."""
    strips = StripAerodynamics(chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi)
    return AerodynamicLoad(strips=strips, flow=Flow(density=density, wind=[0, -speed, 0]))


@cache
def strip_errors() -> tuple[float, float]:
    """Case D11: tip over the semispan, and tip angle of attack, degrees; the worst of all rows."""
    tips, angles = [], []
    for name, row in case("D11")["reference"]["exact_strip_COMPUTED"].items():
        beam, air = smith_wing(float(name[0])), strip_load(25.0)
        loads = [air, cc.Gravity([0, 0, -9.754])] if name.endswith("_g") else [air]
        found = cc.solve_equilibrium(beam, loads)
        moved = found.shape.tip.position.full().ravel() - row["tip_xyz_wind_frame"]
        tips.append(float(np.linalg.norm(moved)) / 16.0)
        angle = float(strip_forces(beam, found.q, air, stations=[1.0]).angle_of_attack)
        angles.append(abs(float(np.degrees(angle)) - row["tip_angle_of_attack_deg"]))
    return max(tips), max(angles)


def _rows() -> Iterator[Row]:
    exact = "exact"
    yield Row("01 roll-up to two circles, 1 weight", exact, roll_up(), 1e-9)
    yield Row("02 elastica, both planes, 6 weights", exact, elastica(6), 6e-6)
    yield Row("02 elastica, both planes, 10 weights", exact, elastica(10), 1e-6)
    yield Row("02 elastica, 10 weights, 16 magnus6", exact, elastica(10, "magnus6"), 1e-6)
    yield Row("03 follower force, 12 weights", exact, follower(), 1e-4)
    yield Row("04 45° bend, dead force, 8 a channel", "Kirchhoff", dead_bend(), 1e-6)
    yield Row("05 45° bend, follower force, 8 a channel", "Kirchhoff", follower_bend(), 1e-4)
    yield Row("07 self weight, 10 weights", exact, self_weight(), 3e-6)
    kirchhoff, umnast = pazy_errors("computed_kirchhoff_condensed"), pazy_errors("umnast_beam")
    yield Row("10 Pazy bending, with and without skin", "Kirchhoff", kirchhoff, 2e-3)
    yield Row("10 Pazy bending, with and without skin", "UM/NAST", umnast, 2e-3)
    yield Row("14 composite, coupled", "Kirchhoff", composite(), 1e-5)
    yield Row("16 composite strips, rolled root", "Kirchhoff", strips(), 1e-5)
    yield Row("17 cantilever, dead and follower force", "Kirchhoff", sharpy(), 1e-5)
    yield Row("18 helix, 8 a channel, 32 magnus6", exact, helix(), 1e-5)
    yield Row("19 self weight, coupled, offset, 8 a channel", "two methods", offset_weight(), 3e-6)
    yield Row("20 cantilever, dead and follower force", "Kirchhoff", strain_based(), 1e-5)
    yield Row("22 partial load, over the deflection", exact, partial_load(), 3e-6)
    moved, turned = strip_errors()
    yield Row("D11 strip equilibrium, four rows", "exact strip", iter([moved]), 1e-4)
    yield Row("D11 tip angle of attack, degrees", "exact strip", iter([turned]), 5e-3)


def published() -> Table:
    """Largest error of each published case."""
    lines, failures = [], 0
    for row in _rows():
        check = Check(what=row.case, value=max(row.errors), high=row.required, form="{:.1e}")
        what, *rest = check.cells()
        lines.append((what, row.reference, *rest))
        failures += check.failed
    return Table(
        title="Equilibria: largest tip error over the length, all rows of a case",
        headers=("case", "reference", "error", "required", ""),
        rows=tuple(lines),
        notes=("24 Lobatto elements of magnus4 where nothing else is said; 15 of the Pazy wing.",),
        failures=failures,
        requirements=len(lines),
    )


def nodes(elements: int) -> tuple[int, int]:
    """Nodes of the residual under a follower tip force, 8 weights, alone and with derivative."""
    beam = rod((3, 3, 2), grid=cc.Grid.lobatto(elements))
    q, force = ca.SX.sym("q", 8), ca.SX.sym("F", 3)
    load = [cc.PointForce(1.0, force, "follower")]
    outputs = [cc.equilibrium_residual(beam, q, load)], cc.equilibrium_tangent(beam, q, load)
    residual, both = (
        ca.Function("f", [q, force], [*output], {"cse": True}).n_instructions()
        for output in outputs
    )
    return int(residual), int(both)


def cost() -> Table:
    """Nodes of an equilibrium, and Newton iterations."""
    residual, both = (count / 16 for count in nodes(16))
    sizes = [nodes(n)[1] for n in (10, 20, 40)]
    wing = cc.solve_equilibrium(hale_wing(), [cc.Gravity([0, 0, 9.81])])
    hard = cc.solve_equilibrium(rod((0, 10, 0)), [cc.PointForce(1.0, 16 * UP)])
    return checked(
        "Cost of an equilibrium",
        [
            _count("follower tip force, 8 weights, 16 elements: nodes per element", residual, 500),
            _count("the same with its derivative: nodes per element", both, 4300),
            Check(
                what="nodes that 20 more elements add, over what 10 more add",
                value=(sizes[2] - sizes[1]) / (sizes[1] - sizes[0]),
                low=1.95,
                high=2.05,
                form="{:.2f}",
            ),
            _count("HALE wing, 1 g, from straight: Newton iterations", wing.iterations, 6),
            _count("HALE wing, 1 g, from straight: load steps", wing.load_steps, 1),
            _count("elastica at P L²/EI = 16, from straight: Newton iterations", hard.iterations),
            _count("elastica at P L²/EI = 16, from straight: load steps", hard.load_steps),
        ],
    )


def _count(what: str, value: float, high: float | None = None) -> Check:
    return Check(what=what, value=value, high=high, form="{:.0f}")
