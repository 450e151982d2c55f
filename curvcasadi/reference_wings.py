"""Published wings, each with its source."""

from __future__ import annotations

from curvcasadi.beam.basis import ChannelBasis
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.families import Legendre
from curvcasadi.beam.grid import Grid
from curvcasadi.beam.pose import Pose
from curvcasadi.beam.section import Section

#: Right wing in body axes (x forward, y right, z down): local x to the right tip, y forward, z up.
RIGHT_WING_ROOT = Pose(rotation=[[0, 1, 0], [1, 0, 0], [0, 0, -1]], position=[0, 0, 0])

#: About the elastic axis, which the centres of mass are on; kg m.
_HALE_INERTIA = ((0.1, 0, 0), (0, 5e-4, 0), (0, 0, 0.0995))


def hale_wing(
    torsion: int = 3, out_of_plane: int = 4, in_plane: int = 2, *, grid: Grid | None = None
) -> Beam:
    """Right half wing of the high-altitude long-endurance aircraft: 16 m, uniform, unswept.

    Semispan, rigidities and mass of M.J. Patil, D.H. Hodges, C.E.S. Cesnik, "Nonlinear
    Aeroelasticity and Flight Dynamics of High-Altitude Long-Endurance Aircraft", J. Aircraft 38(1),
    2001. Its polar inertia, 0.1 kg m, is divided between flap and lag in proportion to EI_y and
    EI_z, as AeroBeams.jl does. Legendre curvatures with the given numbers of weights, bounded by
    0.15 rad/m; 16 Gauss–Lobatto elements unless `grid` is given.
    """
    return Beam(
        length=16.0,
        basis=ChannelBasis(
            torsion=Legendre(torsion),
            out_of_plane=Legendre(out_of_plane),
            in_plane=Legendre(in_plane),
        ),
        grid=grid or Grid.lobatto(16),
        section=Section(GJ=1e4, EI_y=2e4, EI_z=4e6, mass_per_length=0.75, inertia=_HALE_INERTIA),
        root=RIGHT_WING_ROOT,
        weight_bounds=0.15,
    )
