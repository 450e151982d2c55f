"""A small flexible aircraft with a tail, for tests of free flight in air."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

import curvcasadi as cc
from curvcasadi.lie import so3

DENSITY = 0.9
#: Tail and wings stand askew, so that no term is zero by symmetry.
TAIL = cc.Pose(
    rotation=ca.DM([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) @ so3.exp(ca.DM([0.05, 0.1, 0.04])),
    position=[-4.0, 0.2, -0.3],
)


def strips(**fields):
    """Airfoil data with every coefficient, an aileron and three stations."""
    aileron = cc.ControlSurface(
        name="aileron", lift=2.0, moment=-0.4, drag=0.02, start=0.6, antisymmetric=True
    )
    return cc.StripAerodynamics(
        **{
            "chord": 1.1,
            "aerodynamic_center": 0.2,
            "lift_slope": 6.0,
            "zero_lift_angle": -0.03,
            "profile_drag": 0.012,
            "moment_coefficient": -0.02,
            "moment_slope": 0.1,
            "suction": 0.9,
            "stations": 3,
            "controls": (aileron,),
            **fields,
        }
    )


@cache
def aircraft(weights=(1, 2, 1), sweep=0.2):
    """Two half wings with ailerons, a rigid tail with an elevator, a body and an engine."""
    names = ("torsion", "out_of_plane", "in_plane")
    beam = cc.Beam(
        length=8.0,
        basis=cc.ChannelBasis(**{k: cc.Legendre(n) for k, n in zip(names, weights, strict=True)}),
        grid=cc.Grid.lobatto(6),
        section=cc.Section(
            GJ=1e4,
            EI_y=2e4,
            EI_z=2e5,
            mass_per_length=2.0,
            inertia=np.diag([0.1, 0.02, 0.09]),
            center_of_mass=(0, -0.05, 0.02),
        ),
        root=cc.wing_root(side="right", sweep=sweep, dihedral=0.05, position=[0.3, 0.4, -0.2]),
    )
    right = cc.Wing(name="right", beam=beam, strips=strips())
    elevator = cc.ControlSurface(name="elevator", lift=3.0, moment=-0.2)
    tail = cc.LiftingSurface(
        name="tail", area=1.5, pose=TAIL, strips=strips(chord=0.5, controls=(elevator,))
    )
    body = cc.RigidBody(
        mass=40.0, center_of_mass=[0.1, 0, 0.2], inertia=np.diag([40.0, 30, 50]) + 2
    )
    return cc.Aircraft(
        body=body,
        beams=(right, cc.mirror_wing(right, "left")),
        surfaces=(tail,),
        thrusts=(cc.Thrust(position=[0.5, 0.1, -0.3]),),
    )


def anywhere(model, seed=0):
    """A state (nx,), inputs and parameters of a model in flight at some 20 m/s, all of them set."""
    rng = np.random.default_rng(seed)
    sizes = {"position": 30.0, "twist": 0.2, "elevator": 0.1, "aileron": 0.1, "thrust": 30.0}
    drawn = (
        [sizes.get(part.name, 0.05) * rng.normal(size=part.size) for part in layout.parts]
        for layout in (model.x, model.u, model.p)
    )
    x, u, p = (np.concatenate([np.zeros(0), *parts]) for parts in drawn)
    attitude, speed = np.r_[1, 0.1 * rng.normal(size=3)], np.array([20.0, 1.0, 1.5])
    x[model.x.slices["quaternion_wxyz"]] = attitude / np.linalg.norm(attitude)
    twist = model.x.slices["twist"]
    x[twist.stop - 3 : twist.stop] += speed
    for part in model.x.parts:
        if part.name.startswith("lag"):
            x[model.x.slices[part.name]] += rng.normal(size=part.size)
    return x, u, p
