"""The other half wing."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from curvcasadi.beam.along import mapped
from curvcasadi.beam.basis import MirroredBasis
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.pose import Pose
from curvcasadi.beam.section import Body, Section
from curvcasadi.symbolic.expressions import AnyExpr, Number

#: Reflections: of parent axes at the plane y = 0, of local axes, and of curvatures in local axes.
PARENT, LOCAL, CURVATURE = ca.DM([1, -1, 1]), ca.DM([1, 1, -1]), ca.DM([-1, -1, 1])


def mirror(beam: Beam) -> Beam:
    """The other half wing: a mirror-symmetric shape has the same q on both.

    The mirror plane is y = 0 of the parent frame. With S = diag(1, −1, 1) in parent and
    S_l = diag(1, 1, −1) in local axes the root becomes (S R S_l, S p), so that x still runs to the
    tip and y to the leading edge; offsets become S_l r, inertias S_l J S_l; curvatures change by
    S_k = diag(−1, −1, 1): basis and K_0 rows S_k K, stiffness S_k C S_k.

    Parameters
    ----------
    beam : Beam
        A half wing.

    Returns
    -------
    Beam
        The half wing on the other side.
    """
    basis, section = beam.basis, beam.section
    return replace(
        beam,
        root=Pose(
            rotation=ca.diag(PARENT) @ beam.root.rotation @ ca.diag(LOCAL),
            position=PARENT * beam.root.position,
        ),
        basis=basis.original if isinstance(basis, MirroredBasis) else MirroredBasis(basis),
        initial_curvature=mapped(beam.initial_curvature, _curvature),
        section=None if section is None else _section(section),
        bodies=tuple(_body(body) for body in beam.bodies),
    )


def _section(section: Section) -> Section:
    return replace(
        section,
        coupling_xz=mapped(section.coupling_xz, _opposite),
        coupling_yz=mapped(section.coupling_yz, _opposite),
        inertia=mapped(section.inertia, _matrix),
        center_of_mass=mapped(section.center_of_mass, _offset),
    )


def _body(body: Body) -> Body:
    return replace(body, offset=_offset(body.offset), inertia=_matrix(body.inertia))


def _curvature(value: Number) -> AnyExpr:
    return CURVATURE * _column(value)


def _offset(value: Number) -> AnyExpr:
    return LOCAL * _column(value)


def _matrix(value: Number) -> AnyExpr:
    return ca.diag(LOCAL) @ _column(value) @ ca.diag(LOCAL)


def _opposite(value: Number) -> Number:
    return -value


def _column(value: Number) -> AnyExpr:
    return value if isinstance(value, (ca.SX, ca.MX)) else ca.DM(value)
