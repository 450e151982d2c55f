"""Natural frequencies against published and exact results, one case a section."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from tests.published.test_published_statics import case, condensed, legendre

HALE_INERTIA = np.diag([0.1, 5e-4, 0.0995])


def hale(basis, inertia=HALE_INERTIA):
    """The HALE wing, its root at the identity: z is up."""
    section = cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6, mass_per_length=0.75, inertia=inertia)
    return cc.Beam(length=16.0, basis=basis, grid=cc.Grid.lobatto(16), section=section)


# D01, uniform cantilever. The exact rows have no rotary inertia of bending.


def exact_first_five():
    exact = case("D01")["reference"]
    rows = [*exact["flap_exact"][:3], exact["torsion_exact"][0], exact["edge_exact"][0]]
    return np.sort(rows)


def free_tip(n):
    bending = cc.FreeTip(n)
    return cc.ChannelBasis(torsion=cc.FreeTip(n, order=1), out_of_plane=bending, in_plane=bending)


@pytest.mark.parametrize(
    ("basis", "percent"),
    [(legendre(6, 6, 6), 0.1), (free_tip(4), 0.15)],
    ids=["six Legendre weights", "four FreeTip weights"],
)
def test_d01_first_five_frequencies_of_the_cantilever(basis, percent):
    found = cc.natural_frequencies(hale(basis, np.diag([0.1, 0, 0])))
    assert_allclose(found[:5], exact_first_five(), rtol=percent / 100)


def test_d01_rotary_inertia_lowers_the_edge_mode_as_in_aerobeams():
    code = case("D01")["reference"]["AeroBeams_32_elements"]
    found = cc.natural_frequencies(hale(legendre(6, 6, 6)))
    # Its 32 elements leave 0.4 % on the second flap mode and 1 % on the third.
    assert_allclose(found[:5], code, rtol=0.01)
    assert_allclose(found[3], code[3], rtol=4e-4)


# D03, rotating cantilever: stiffness from geometry alone.


def rotating(eta, hub, channel, n):
    section = cc.Section(GJ=1, EI_y=1, EI_z=1, mass_per_length=1)
    beam = cc.Beam(
        length=1.0, basis=legendre(**{channel: n}), grid=cc.Grid.lobatto(32), section=section
    )
    hub_motion = cc.RootMotion(twist=[0, 0, eta, 0, eta * hub, 0])
    return cc.natural_frequencies(beam, root=hub_motion)


@pytest.mark.parametrize(("n", "tolerance"), [(6, 3e-3), (8, 1e-4)])
@pytest.mark.parametrize(
    ("row", "hub", "channel"),
    [
        ("flap_hub0", 0, "out_of_plane"),
        ("lag_hub0", 0, "in_plane"),
        ("flap_hub1", 1, "out_of_plane"),
    ],
)
def test_d03_frequencies_rise_with_the_speed_of_rotation(n, tolerance, row, hub, channel):
    table = case("D03")["reference"][row]
    modes = [values for key, values in table.items() if key.startswith("lambda")]
    found = [rotating(eta, hub, channel, n)[: len(modes)] for eta in table["eta"]]
    assert_allclose(np.array(found).T, modes, rtol=tolerance)


# D08, vibration about bent shapes: torsion and edge bending exchange their roles.


@cache
def bent(force):
    """Height of the tip, m, and the frequencies of the HALE wing under a dead tip force, N."""
    beam, loads = hale(legendre(3, 5, 4)), [cc.PointForce(1.0, [0, 0, force])]
    equilibrium = cc.solve_equilibrium(beam, loads)
    height = float(equilibrium.shape.tip.position[2])
    return height, cc.natural_frequencies(beam, equilibrium.q, loads)


@pytest.mark.parametrize("force", [6.0, 15.0, 25.0, 28.0])
def test_d08_torsion_and_edge_bending_part_as_the_wing_is_bent(force):
    height, found = bent(force)
    published = case("D08")["reference"]

    def read(curve):
        return np.interp(height, published[curve]["tip_z"], published[curve]["w"])

    # The file's tolerances: the axis of the digitised curves is short.
    assert_allclose(found[0], read("flap1"), rtol=0.02)
    assert_allclose(found[2], read("torsion_edge_mode_going_down"), rtol=0.07)
    rising = read("edge_torsion_mode_going_up")
    assert np.min(np.abs(found / rising - 1)) <= 0.03


# D13, the Pazy wing: a section that jumps at each rib, with couplings, and lumped masses.


def pazy(torsion, out_of_plane, in_plane):
    """The wing with its skin: nine weights of moments, or more."""
    data = case("D13")
    span = np.array(data["geometry"]["nodes_span_m"])
    (stiffness,) = (v for k, v in data["section"].items() if k.startswith("stiffness"))
    (table,) = (v for k, v in data["section"].items() if k.startswith("inertia"))
    section = cc.Section.from_stiffness(cc.Steps(span / span[-1], condensed(stiffness)))
    turn = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # their x aft, y along the span, z up
    bodies = []
    for k in range(1, len(span)):
        products = {pair: -table[f"I{pair}"][k] for pair in ("xy", "xz", "yz")}
        inertia = np.array(
            [
                [table["Ixx"][k], products["xy"], products["xz"]],
                [products["xy"], table["Iyy"][k], products["yz"]],
                [products["xz"], products["yz"], table["Izz"][k]],
            ]
        )
        offset = turn @ [table[key][k] for key in ("cgx", "cgy", "cgz")]
        bodies.append(
            cc.Body(
                xi=span[k] / span[-1],
                mass=table["mass"][k],
                inertia=turn @ inertia @ turn.T,
                offset=offset,
            )
        )
    families = {"torsion": torsion, "out_of_plane": out_of_plane, "in_plane": in_plane}
    moments = {name: cc.Legendre(n) for name, n in families.items()}
    return cc.Beam(
        length=span[-1],
        basis=cc.ComplianceBasis(section, **moments),
        grid=cc.Grid.lobatto(15),
        section=section,
        bodies=tuple(bodies),
    )


def hertz(beam, *equilibrium):
    return cc.natural_frequencies(beam, *equilibrium)[:5] / (2 * np.pi)


def test_d13_pazy_modes_by_nine_moments():
    published = case("D13")["reference"]
    beam = pazy(3, 4, 2)
    assert_allclose(hertz(beam), published["with_skin_Hz"]["UM/NAST beam"], rtol=0.015)
    weight = [cc.Gravity([0, 0, -9.80665])]
    sagging = cc.solve_equilibrium(beam, weight).q
    under_weight = published["under_own_weight_with_skin_UM/NAST"]
    assert_allclose(hertz(beam, sagging, weight), under_weight, rtol=0.015)


def test_d13_twelve_moments_are_converged():
    few, many = hertz(pazy(4, 5, 3)), hertz(pazy(5, 8, 3))
    assert_allclose(few[[0, 1, 2, 4]], many[[0, 1, 2, 4]], rtol=3e-3)
    assert_allclose(few[3], many[3], rtol=1.5e-2)
