"""Equilibria against published and exact results, one case of tests/reference a section.

The required errors are positions over the length. Where a basis or a grid is named with the
requirement the test takes it; otherwise eight Legendre weights a channel and 24 Lobatto elements.
"""

from __future__ import annotations

import json
from functools import cache

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.conftest import REFERENCE
from tests.support.oracle import rotation

UP = np.array([0.0, 0.0, 1.0])
CLAMP = cc.Pose.identity()


@cache
def case(prefix):
    """A published case by the beginning of its file name."""
    (path,) = REFERENCE.glob(f"{prefix}*.json")
    return json.loads(path.read_text())


def legendre(torsion=0, out_of_plane=0, in_plane=0):
    """Legendre functions of each channel that has any."""
    counts = {"torsion": torsion, "out_of_plane": out_of_plane, "in_plane": in_plane}
    return cc.ChannelBasis(**{name: cc.Legendre(n) for name, n in counts.items() if n})


def cantilever(length=1.0, basis=None, grid=None, section=None, **fields):
    """A beam of unit stiffness, bent out of plane, unless fields say otherwise."""
    return cc.Beam(
        length=length,
        basis=basis or legendre(out_of_plane=8),
        grid=grid or cc.Grid.lobatto(24),
        section=section or cc.Section(GJ=1, EI_y=1, EI_z=1),
        **fields,
    )


def rolled(degrees):
    """A root turned about the span, rad from `degrees`."""
    return cc.Pose(rotation=rotation([np.deg2rad(degrees), 0, 0]), position=[0, 0, 0])


def position(beam, equilibrium, xi=1.0, offset=(0, 0, 0)):
    """A point of the section at xi, m, parent axes."""
    pose = cc.pose_at(beam, equilibrium.q, xi)
    return (pose.position + pose.rotation @ ca.DM(offset)).full().ravel()


def distance(beam, equilibrium, expected, xi=1.0):
    """How far the station xi is from `expected`, over the length."""
    return np.linalg.norm(position(beam, equilibrium, xi) - expected) / beam.length


# Case 01: the problem of GXBeam's `tipmoment` example, exact circles.


@pytest.mark.parametrize("frame", ["dead", "follower"])
@pytest.mark.parametrize(
    "axis, channel, side",
    [
        ((0, 1, 0), "out_of_plane", (0, 0, -1)),
        ((0, -1, 0), "out_of_plane", (0, 0, 1)),
        ((0, 0, 1), "in_plane", (0, 1, 0)),
    ],
    ids=["y", "-y", "z"],
)
def test_01_a_tip_moment_rolls_the_beam_into_two_circles(frame, axis, channel, side):
    beam = cantilever(basis=legendre(**{channel: 1}), grid=cc.Grid.uniform(16))
    for row in case("01")["reference"]:
        found = cc.solve_equilibrium(beam, [cc.PointMoment(1.0, row["M"] * np.array(axis), frame)])
        expected = np.array([row["x_tip"], 0, 0]) + row["h_tip"] * np.array(side)
        # A constant curvature is in the basis; ten digits are given, and 4 π has an error of 4e-10.
        assert distance(beam, found, expected) <= 1e-9


def test_01_a_torsional_moment_twists_without_displacement():
    beam = cantilever(basis=legendre(torsion=1), section=cc.Section(GJ=0.5, EI_y=1, EI_z=1))
    found = cc.solve_equilibrium(beam, [cc.PointMoment(1.0, [1.25, 0, 0])])
    assert_allclose(found.shape.tip.rotation.full(), rotation([2.5, 0, 0]), atol=1e-11)
    assert distance(beam, found, [1, 0, 0]) <= 1e-14


# Case 02: exact elastica (elliptic integrals); K. Mattiasson, IJNME 17 (1981) 145-153.


@pytest.mark.parametrize("channel, side", [("out_of_plane", (0, 0, 1)), ("in_plane", (0, 1, 0))])
@pytest.mark.parametrize(
    "weights, grid, required",
    [
        (6, cc.Grid.lobatto(24), 6e-6),
        (10, cc.Grid.lobatto(24), 1e-6),
        (10, cc.Grid.lobatto(16, rule="magnus6"), 1e-6),
    ],
    ids=["6-magnus4", "10-magnus4", "10-magnus6"],
)
def test_02_elastica_under_all_dead_tip_forces(weights, grid, required, channel, side):
    beam = cantilever(basis=legendre(**{channel: weights}), grid=grid)
    rows = case("02")["reference"]
    for row in rows if channel == "out_of_plane" else rows[::-4]:
        found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, row["PL2_EI"] * np.array(side))])
        expected = np.array([1 - row["u_over_L"], 0, 0]) + row["w_over_L"] * np.array(side)
        assert distance(beam, found, expected) <= required


def test_02_elastica_against_mattiasson():
    beam = cantilever(basis=legendre(out_of_plane=10))
    for row in case("02")["published_mattiasson_rows_read"]:
        found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, row["PL2_EI"] * UP)])
        expected = [1 - row["u_over_L"], 0, row["w_over_L"]]
        assert_allclose(position(beam, found), expected, atol=6e-6)  # five digits are printed


def test_02_tip_slope_and_root_curvature():
    beam = cantilever(basis=legendre(out_of_plane=10), grid=cc.Grid.lobatto(16, rule="magnus6"))
    for row in case("02")["reference"]:
        found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, row["PL2_EI"] * UP)])
        tangent = found.shape.tip.rotation.full()[:, 0]
        slope = np.arctan2(tangent[2], tangent[0])
        assert_allclose(slope, row["theta_tip_rad"], atol=1e-6)  # as the position
        # Pointwise a curvature of ten polynomials is less exact than what it integrates to.
        root = found.shape.curvatures.full()[1, 0]
        assert_allclose(-root, row["root_curvature_times_L"], rtol=2e-4)


# Case 03: J.C. Simo, L. Vu-Quoc, CMAME 58 (1986); exact, integrated from the tip.


def test_03_follower_force_turns_the_tip_by_more_than_half_a_turn():
    beam = cantilever(basis=legendre(out_of_plane=12))
    for row in case("03")["reference"]:
        force = cc.PointForce(1.0, row["FL2_EI"] * UP, frame="follower")
        found = cc.solve_equilibrium(beam, [force])
        assert distance(beam, found, [1 + row["tip_u_x"], 0, row["tip_w_z"]]) <= 1e-4
        turned = -float(found.q[0])  # of the mean curvature: P_0 is constant
        # The same grid error as the position, over the same length.
        assert_allclose(turned, row["tip_rotation_rad_towards_force"], atol=1e-4)


# Case 04: K.-J. Bathe, S. Bolourchi, IJNME 14 (1979) 961-986; J.C. Simo, L. Vu-Quoc (1986).


def bend(rigidity, weights=8, grid=None):
    """The 45 degree bend of radius 100 in, lb and in; torsional rigidity `rigidity`."""
    data = case("04")
    section = data["section"]
    return cantilever(
        length=data["geometry"]["L"],
        basis=legendre(weights, weights, weights),
        grid=grid,
        section=cc.Section(GJ=rigidity, EI_y=section["EIy"], EI_z=section["EIz"]),
        initial_curvature=data["geometry"]["initial_curvature_body"],
    )


@pytest.mark.parametrize(
    "rows, rigidity",
    [("kirchhoff_GJ_J=1/6", "GJ_polar"), ("kirchhoff_GJ_J=0.141", "GJ_0141")],
)
@pytest.mark.parametrize("force", [300, 450, 600])
def test_04_bend_under_a_dead_force(rows, rigidity, force):
    data = case("04")
    (row,) = [r for r in data["reference"]["computed_exact"][rows] if r["F"] == force]
    beam = bend(data["section"][rigidity])
    found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, force * UP)])
    assert distance(beam, found, row["tip_position"]) <= 1e-6
    # The rotation of the tip from the root axes; its error is that of the position over L.
    got = found.shape.tip.rotation.full()
    assert_allclose(got, rotation(row["tip_rotvec"]), atol=3e-6)


def test_04_bend_against_simo_and_vu_quoc():
    data = case("04")
    beam = bend(data["section"]["GJ_polar"], weights=5, grid=cc.Grid.lobatto(16))
    rows = [r for r in data["reference"]["published"] if r["who"].startswith("Simo")]
    for row in rows:
        found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, row["F"] * UP)])
        # Eight elements of 1986, with shear and extension: the spread of the literature.
        assert_allclose(position(beam, found), row["tip_position"], atol=0.2)


# Case 05: the same beam, follower force; exact, integrated from the tip.


def test_05_bend_under_a_follower_force():
    data = case("05")
    beam = bend(data["section"]["GJ"])
    undeformed = np.array([np.sin(np.pi / 4), 1 - np.cos(np.pi / 4), 0]) * data["geometry"]["R"]
    for row in data["reference"]["computed_exact"]["kirchhoff_GJ_J=1/6"]:
        force = cc.PointForce(1.0, row["F"] * UP, frame="follower")
        found = cc.solve_equilibrium(beam, [force])
        assert distance(beam, found, undeformed + row["tip_displacement"]) <= 1e-4


# Case 07: exact self weight, by two methods; AeroBeams.jl cantileverUnderSelfWeight.


@pytest.mark.parametrize(
    "load",
    [
        lambda q: (q / 9.81, cc.Gravity([0, 0, -9.81])),
        lambda q: (None, cc.DistributedForce([0, 0, -q])),
    ],
    ids=["gravity", "distributed"],
)
def test_07_self_weight(load):
    for row in case("07")["reference"]["exact"]:
        mass, weight = load(row["qL3_EI"])
        section = cc.Section(GJ=1, EI_y=1, EI_z=1, mass_per_length=mass)
        # Eight weights leave 3.1e-6 in the last row, whatever the grid: ten.
        beam = cantilever(basis=legendre(out_of_plane=10), section=section)
        found = cc.solve_equilibrium(beam, [weight])
        assert distance(beam, found, [1 - row["u_over_L"], 0, -row["w_over_L"]]) <= 3e-6


def test_07_self_weight_against_aerobeams():
    row = case("07")["reference"]["aerobeams_20_elements"]
    beam = cantilever()
    found = cc.solve_equilibrium(beam, [cc.DistributedForce([0, 0, -row["qL3_EI"]])])
    # Its twenty elements.
    assert_allclose(position(beam, found), [1 + row["tip_u1"], 0, row["tip_u3"]], atol=1e-4)


# Cases 09 and 10: C. Riso, C.E.S. Cesnik, J. Aircraft 2023, doi 10.2514/1.C036869; O. Avin et al.,
# AIAA J. 2022, doi 10.2514/1.J060621.

#: Midchord from the reference axis at 44.096 % of the chord of 98.9 mm, local axes, m.
MIDCHORD = np.array([0, (0.44096 - 0.5) * 0.0989, 0])
GRAVITY = [cc.Gravity([0, 0, -9.80665])]
PERCENT = 100.0


def nodes(data):
    """Stations of the nodes, and the semispan, m."""
    y = np.array(data["geometry"]["node_y"])
    return y / y[-1], float(y[-1])


def condensed(table):
    """Stiffness (3, 3) per element, from tables with axial strain."""
    full = np.zeros((15, 4, 4))
    for i in range(4):
        for j in range(i, 4):
            full[:, i, j] = full[:, j, i] = table[f"K{i + 1}{j + 1}"]
    return [cc.condense_axial(element) for element in full]


def lumped(xi, table):
    """Masses of the nodes but the clamped one; source axes are x aft, y along the span."""
    return [
        cc.Body(
            xi=float(xi[k]),
            mass=table["mass"][k],
            offset=[table["cgy"][k], -table["cgx"][k], table["cgz"][k]],
        )
        for k in range(1, 16)
    ]


def pazy(data, model, tip_mass, offset=MIDCHORD, root=CLAMP, moments=None):
    """The Pazy wing with a mass in its tip section: an element between two nodes.

    Its basis are Legendre functions of the curvatures, or `moments` by channel.
    """
    xi, semispan = nodes(data)
    tip = cc.Body(xi=1.0, mass=tip_mass, offset=offset)
    section = cc.Section.from_stiffness(cc.Steps(xi, condensed(model["stiffness_per_element"])))
    return cc.Beam(
        length=semispan,
        basis=cc.ComplianceBasis(section, **moments) if moments else legendre(4, 6, 3),
        grid=cc.Grid.lobatto(15),
        section=section,
        bodies=(*lumped(xi, model["inertia_per_node"]), tip),
        root=root,
    )


def swept(data, model, masses, **fields):
    """(beam, weights) for each tip mass, each from the equilibrium before it."""
    mass = ca.MX.sym("mass")
    equilibrium = cc.equilibrium_function(
        pazy(data, model, mass, **fields), GRAVITY, {"mass": mass}
    )
    beam = pazy(data, model, 0.0, **fields)
    q, found = ca.DM.zeros(beam.basis.n), []
    for value in masses:
        q = equilibrium(q, value)
        found.append(q)
    return beam, found


def point(beam, q, offset=MIDCHORD):
    """A point of the tip section, m, parent axes."""
    tip = cc.shape_map(beam, q).tip
    return (tip.position + tip.rotation @ ca.DM(offset)).full().ravel()


@pytest.mark.parametrize("skin", ["skin0", "skin1"])
def test_09_axial_strain_is_condensed_out_of_the_section(skin):
    model = case("09")["geometry"][skin]
    expected = model["condensed_3x3_Kx_Ky_Kz_per_element"]
    got = condensed(model["stiffness_per_element"])
    assert_allclose(got, expected, rtol=1e-9, atol=0)  # ten digits are printed


@pytest.mark.parametrize("skin", ["skin0", "skin1"])
def test_10_pazy_wing_bent_by_a_tip_mass(skin):
    data, rows = case("09"), case("10")["reference"][skin]
    masses = [row[0] for row in rows["umnast_beam"]["rows"]]
    beam, weights = swept(data, data["geometry"][skin], masses)
    start = point(beam, weights[0])
    moved = {
        m: PERCENT * (point(beam, q) - start) / beam.length
        for m, q in zip(masses, weights, strict=True)
    }
    for mass, vertical, axial in rows["umnast_beam"]["rows"]:
        assert_allclose(moved[mass][[2, 0]], [vertical, axial], atol=0.2)
    kirchhoff = rows["computed_kirchhoff_condensed"]
    for row in kirchhoff["relative_to_self_weight"]:
        expected = [row[f"d_{name}_pct"] for name in ("axial", "towards_LE")]
        got = moved[row["tip_mass_kg"]]
        assert_allclose(got, [*expected, row["d_vertical_pct_semispan"]], atol=0.05)  # same model
    sag = start - [beam.length, 0, 0] - MIDCHORD
    expected = kirchhoff["self_weight_only"]["u_mid_lib_m"]
    assert_allclose(sag, expected, atol=5e-4 * beam.length)  # 0.05 % as well


def chord_angle(beam, q):
    """Elevation of the tip's chord, degrees."""
    return np.rad2deg(np.arcsin(cc.shape_map(beam, q).tip.rotation.full()[2, 1]))


@pytest.mark.parametrize(
    ("skin", "counts", "percents"),
    [
        # Under 3.5 kg the tip goes down by half the semispan.
        ("skin0", (2, 4, 1), {2.5: 0.001, 3.5: 0.002}),
        ("skin1", (2, 4, 1), {2.5: 0.001, 3.5: 0.002}),
        ("skin1", (3, 4, 2), {3.5: 0.001}),
    ],
)
def test_10_pazy_wing_by_few_moments_of_its_jumping_section(skin, counts, percents):
    """Seven or nine weights against the exact Kirchhoff rod; 24 of curvatures leave 0.024 %."""
    data = case("09")
    exact = case("10")["reference"][skin]["computed_kirchhoff_condensed"]
    rows = [row for row in exact["relative_to_self_weight"] if row["tip_mass_kg"] in percents]
    names = ("torsion", "out_of_plane", "in_plane")
    moments = {name: cc.Legendre(n) for name, n in zip(names, counts, strict=True)}
    beam, weights = swept(data, data["geometry"][skin], [0.0, *percents], moments=moments)
    start, twist = point(beam, weights[0]), chord_angle(beam, weights[0])
    assert_allclose(twist, exact["self_weight_only"]["twist_deg"], atol=4e-4)
    for row, q, percent in zip(rows, weights[1:], percents.values(), strict=True):
        expected = [row[f"d_{name}"] for name in ("axial_pct", "towards_LE_pct")]
        expected.append(row["d_vertical_pct_semispan"])
        moved = PERCENT * (point(beam, q) - start) / beam.length
        assert np.linalg.norm(moved - expected) <= percent
        turned = chord_angle(beam, q) - twist
        assert_allclose(turned, row["d_twist_deg_nose_up"], atol=4e-4)


def test_10_pazy_wing_from_straight_under_its_largest_mass():
    data = case("09")
    model = data["geometry"]["skin0"]
    _, (expected,) = swept(data, model, [3.5])
    found = cc.solve_equilibrium(pazy(data, model, 3.5), GRAVITY)
    assert_allclose(found.q.full(), expected.full(), atol=1e-7)  # 1e-11 of the moments, K_z stiff


# Case 13: A. Drachinsky, D.E. Raveh, AIAA SciTech 2021; Riso & Cesnik, Goizueta et al. 2021.


@pytest.mark.parametrize(
    "rows, model",
    [
        ("umnast_bending_wo_skin", "wo"),
        ("umnast_bending_w_skin", "w"),
        ("sharpy_bending_wo_skin", "wo"),
    ],
)
def test_13_pre_pazy_bending(rows, model):
    data = case("13")
    table = data["reference"]["other_codes"][rows]
    beam, weights = swept(data, data["geometry"]["models"][model], [row[0] for row in table])
    for (_, *expected), q in zip(table, weights, strict=True):
        moved = point(beam, q) - [beam.length, 0, 0] - MIDCHORD
        got = moved[[2, 0]][: len(expected)]
        assert_allclose(got, expected, atol=0.005 * beam.length)  # as the notes of the case


@pytest.mark.parametrize("rows", ["umnast_torsion_wo_skin", "sharpy_torsion_wo_skin"])
def test_13_pre_pazy_torsion(rows):
    data = case("13")
    ahead = np.array([0, 0.44096 * 0.0989 + 0.08, 0])  # 80 mm ahead of the leading edge
    table = data["reference"]["other_codes"][rows]
    masses = [row[0] for row in table]
    beam, weights = swept(data, data["geometry"]["models"]["wo"], masses, offset=ahead)
    for (_, height, twist, *_), q in zip(table, weights, strict=True):
        assert_allclose(point(beam, q)[2], height, atol=0.005 * beam.length)
        chord = cc.shape_map(beam, q).tip.rotation.full()[:, 1]
        # 0.5 % of span over the chord would be 1.6 degrees; the codes differ by 0.06.
        assert_allclose(np.rad2deg(np.arctan2(chord[2], chord[1])), twist, atol=0.1)


def test_13_pre_pazy_bending_of_the_modal_rotations_method():
    """Only these rows are trusted, and only with the root droop that fits their first point."""
    data = case("13")
    table = data["reference"]["mrm"]["bending_wo_skin"]
    droop = cc.Pose(rotation=rotation([0, np.deg2rad(2.043), 0]), position=[0, 0, 0])
    masses = [row[0] for row in table]
    beam, weights = swept(data, data["geometry"]["models"]["wo"], masses, root=droop)
    got = [point(beam, q)[2] for q in weights]
    assert_allclose(got, [row[1] for row in table], rtol=0.02)


# Case 14: Q. Wang et al., Wind Energy 20 (2017) 1439-1462.


def composite():
    stiffness = np.array(case("14")["section"]["stiffness_Kx_Ky_Kz_3x3"])
    return cantilever(
        length=10.0, basis=legendre(8, 8, 8), section=cc.Section.from_stiffness(stiffness)
    )


def test_14_coupled_composite_beam():
    beam = composite()
    for row in case("14")["reference"]["computed"]["kirchhoff"]:
        found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, row["P"] * UP)])
        assert distance(beam, found, np.add([10, 0, 0], row["tip_displacement"])) <= 1e-5
        assert distance(beam, found, np.add([5, 0, 0], row["mid_displacement"]), 0.5) <= 1e-5
        got = found.shape.tip.rotation.full()
        assert_allclose(got, rotation(row["tip_rotvec_rad"]), atol=1e-5)


def test_14_coupled_composite_beam_against_beamdyn():
    published = case("14")["reference"]["published_P150"]["BeamDyn"]
    beam = composite()
    found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, 150 * UP)])
    moved = position(beam, found) - [10, 0, 0]
    # BeamDyn has shear: 3 % of the deflection, as the notes of the case say.
    assert np.linalg.norm(moved - published) <= 0.035 * np.linalg.norm(published)


# Case 16: P. Minguet, J. Dugundji, AIAA J. 1990, doi 10.2514/3.25255.


@pytest.mark.parametrize(
    "strip", ["beam1_theta0", "beam1_theta45", "beam2_theta0", "beam2_theta45"]
)
def test_16_composite_strips_under_a_tip_weight(strip):
    data = case("16")
    name, _, angle = strip.partition("_theta")
    constants = data["section"][name]
    stiffness = np.diag(constants["diag"][3:])
    stiffness[0, 1] = stiffness[1, 0] = constants.get("K_twist_flap_45", 0)
    beam = cantilever(
        length=data["geometry"]["L"],
        basis=legendre(6, 6, 6),
        section=cc.Section.from_stiffness(stiffness),
        root=rolled(float(angle)),
    )
    inboard = data["geometry"]["measured_at_x"]
    for row in data["reference"]["computed_kirchhoff"][strip]:
        weight = row["load_gram"] * 1e-3 * 9.80665
        found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, -weight * UP)])
        expected = np.add([beam.length, 0, 0], row["u_tip_550mm"])
        assert distance(beam, found, expected) <= 1e-5
        expected = np.add([inboard, 0, 0], row["u_at_500mm"])
        assert distance(beam, found, expected, inboard / beam.length) <= 1e-5


# Case 17: R.J.S. Simpson, R. Palacios, AIAA 2013-1634, after Géradin and Cardona.


@pytest.mark.parametrize("frame", ["dead", "follower"])
def test_17_cantilever_of_the_sharpy_test(frame):
    data = case("17")
    section = data["section"]
    beam = cantilever(
        length=data["geometry"]["L"],
        section=cc.Section(GJ=section["GJ"], EI_y=section["EI"], EI_z=section["EI"]),
    )
    for row in data["reference"]["computed"]["kirchhoff"][frame]:
        found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, -row["F"] * UP, frame)])
        assert distance(beam, found, [beam.length + row["u_x"], 0, row["u_z"]]) <= 1e-5
    if frame == "dead":
        for force, height in data["reference"]["sharpy_notebook_dead_tip_z"]:
            found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, -force * UP)])
            # SHARPy has shear and extension: 0.4 %.
            assert_allclose(position(beam, found)[2], height, rtol=0.005)


# Case 18: exact helix.


@pytest.mark.parametrize("frame", ["dead", "follower"])
def test_18_a_tip_moment_with_torsion_makes_a_helix(frame):
    data = case("18")
    beam = cantilever(
        basis=legendre(8, 8, 8),
        grid=cc.Grid.uniform(32, rule="magnus6"),
        section=cc.Section(GJ=data["section"]["GJ"], EI_y=1, EI_z=1),
    )
    axes = {"dead": "tip_moment_root_frame", "follower": "tip_moment_tip_section_frame"}
    for row in data["reference"]:
        found = cc.solve_equilibrium(beam, [cc.PointMoment(1.0, row[axes[frame]], frame)])
        assert distance(beam, found, row["tip_position"]) <= 1e-5


# Case 19: computed by two independent methods.


def test_19_self_weight_with_coupling_and_an_offset_centre_of_mass():
    data = case("19")
    for row in data["reference"]:
        section = cc.Section.from_stiffness(
            data["section"]["stiffness_Kx_Ky_Kz_3x3"],
            mass_per_length=row["weight_per_length"],
            center_of_mass=data["section"]["cg_offset_section_xyz"],
        )
        beam = cantilever(
            basis=legendre(8, 8, 8),
            grid=cc.Grid.lobatto(16),
            section=section,
            root=rolled(row["root_rotation_about_x_deg"]),
        )
        found = cc.solve_equilibrium(beam, [cc.Gravity([0, 0, -1])])
        assert distance(beam, found, row["tip_position"]) <= 3e-6
        assert distance(beam, found, row["mid_position"], 0.5) <= 3e-6
        got = found.shape.tip.rotation.full()
        assert_allclose(got, row["tip_rotation_matrix"], atol=1e-5)  # as the case suggests


# Case 20: W. Su, PhD thesis, Univ. Michigan 2008, section 4.1.


@pytest.mark.parametrize("frame", ["dead", "follower"])
def test_20_strain_based_cantilever_of_su_and_cesnik(frame):
    data = case("20")
    constants = data["section"]
    section = cc.Section(
        GJ=constants["GJ"], EI_y=constants["EI_out_of_plane"], EI_z=constants["EI_in_plane"]
    )
    beam = cantilever(basis=legendre(2, 6, 2), section=section)
    for row in data["reference"]:
        found = cc.solve_equilibrium(beam, [cc.PointForce(1.0, row["F"] * UP, frame)])
        expected = [1 + row[frame]["u_x"], 0, row[frame]["u_z"]]
        assert distance(beam, found, expected) <= 1e-5


# Case 22: the problem of GXBeam's `cantilever` example; exact Euler-Bernoulli integrals.


@pytest.mark.parametrize("rule, required", [("magnus4", 3e-6), ("magnus6", 1e-6)])
def test_22_a_partial_load_of_a_stiff_beam_is_the_linear_limit(rule, required):
    data = case("22")
    stiffness = data["section"]["EI"]
    beam = cantilever(
        basis=legendre(out_of_plane=6),
        grid=cc.Grid.lobatto(16, rule=rule),
        section=cc.Section(GJ=stiffness, EI_y=stiffness, EI_z=stiffness),
    )
    load = cc.DistributedForce(cc.Steps([0, 0.3, 0.7, 1], [[0, 0, 0], [0, 0, 1000], [0, 0, 0]]))
    found = cc.solve_equilibrium(beam, [load])
    # The deflection is 4e-8 of the length: the error counts over the deflection itself.
    expected = data["reference"]["tip_deflection"]
    assert_allclose(position(beam, found)[2], expected, rtol=required)
    assert found.iterations == 1
