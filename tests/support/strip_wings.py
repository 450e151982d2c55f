"""Published wings in unsteady strip flow: those of cases D09, D12, D15 and D16."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import curvcasadi as cc
from curvcasadi.reference_wings import RIGHT_WING_ROOT

ROOT = cc.Pose(rotation=RIGHT_WING_ROOT.rotation, position=[0, 0, 0])


def strip_wing(beam, chord, ahead, **fields):
    """A wing of thin airfoils whose aerodynamic centre lies `ahead` m of the reference curve."""
    strips = cc.StripAerodynamics(
        chord=chord, aerodynamic_center=ahead, lift_slope=2 * np.pi, **fields
    )
    return cc.Wing(name="wing", beam=beam, strips=strips)


def hale(weights=(4, 4, 0), elements=8):
    """The HALE wing of D09: reference curve and centre of mass at half chord."""
    section = cc.Section(
        GJ=1e4,
        EI_y=2e4,
        EI_z=4e6,
        mass_per_length=0.75,
        inertia=np.diag([0.1, 5e-4, 0.0995]),
    )
    return strip_wing(_beam(16.0, section, weights, elements), 1.0, 0.25)


def goland(weights=(5, 5, 0), elements=8):
    """The Goland wing of D12 with SHARPy's properties: elastic axis at 33 % of the chord."""
    chord, mass = 1.8288, 35.71
    behind = 0.1 * chord
    # Its inertia is about the elastic axis; the exact rows have no rotary inertia of bending.
    section = cc.Section(
        GJ=987581.0,
        EI_y=9772210.0,
        EI_z=977221000.0,
        mass_per_length=mass,
        inertia=np.diag([8.64 - mass * behind**2, 1e-9, 8.64]),
        center_of_mass=[0, -behind, 0],
    )
    return strip_wing(_beam(6.096, section, weights, elements), chord, 0.08 * chord)


def pazy(case, beam, *, varying=True, suction=1.0):
    """The Pazy wing of D15 on its beam, with strips whose coefficients vary, or thin airfoils."""
    chord, span = 0.0989, beam.length
    (table,) = (v for k, v in case["aero"].items() if k.startswith("strip_theory_coefficients"))
    at, *columns = np.transpose(table)
    slopes = {"lift_slope": 2 * np.pi}
    if varying:
        slopes = {
            name: lambda xi, values=values: float(np.interp(xi * span, at, values))
            for name, values in zip(("lift_slope", "moment_slope"), columns, strict=True)
        }
    strips = cc.StripAerodynamics(
        chord=chord,
        aerodynamic_center=(0.44096 - 0.25) * chord,
        suction=suction,
        stations=8,
        **slopes,
    )
    return cc.Wing(name="pazy", beam=beam, strips=strips)


def last_growth(found):
    """Speed at which the first mode to flutter grows no more, linear in the sweep, m/s."""
    growths = np.where(found.roots.imag > 0, found.roots.real / np.abs(found.roots), -1.0)
    first = np.argmax((growths > 1e-5).any(axis=1))
    mode = growths[:, np.argmax(growths[first])]
    k = np.flatnonzero(mode > 0)[-1]
    share = mode[k] / (mode[k] - mode[k + 1])
    return found.speeds[k] + share * (found.speeds[k + 1] - found.speeds[k])


def tang_dowell(case, weights=(3, 5, 4), elements=6):
    """The wing of D16, whose tip store is slender along the chord."""
    data, chord = case["section"], 0.0508
    polar, rotary, store = (data[k] for k in ("polar_per_length", "rotary about y", "tip_store"))
    section = cc.Section(
        GJ=data["GJ"],
        EI_y=data["EI_out_of_plane"],
        EI_z=data["EI_in_plane"],
        mass_per_length=data["mass_per_length"],
        inertia=np.diag([polar, rotary, polar - rotary]),
        center_of_mass=[0, 0, 0.01 * chord],
    )
    inertia = np.diag([store["Izz"], store["Iyy"], store["Izz"]])
    tip = cc.Body(xi=1.0, mass=store["mass"], inertia=inertia)
    beam = replace(_beam(0.4508, section, weights, elements), bodies=(tip,))
    return strip_wing(beam, chord, chord / 4)


def _beam(length, section, weights, elements):
    names = ("torsion", "out_of_plane", "in_plane")
    return cc.Beam(
        length=length,
        basis=cc.ChannelBasis(
            **{k: cc.Legendre(n) for k, n in zip(names, weights, strict=True) if n}
        ),
        grid=cc.Grid.lobatto(elements),
        section=section,
        root=ROOT,
    )
