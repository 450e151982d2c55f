"""Flow that the wings of a flying aircraft induce at its rigid surfaces."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from curvcasadi.aero import line_functions
from curvcasadi.aero.unsteady import circulations_follow, line_of_load
from curvcasadi.aircraft.flying_wing import air_symbols
from curvcasadi.aircraft.free_air import FreeAir
from curvcasadi.aircraft.parts import Wing
from curvcasadi.dynamics.inertia import inertial_mesh
from curvcasadi.kinematics import chain
from curvcasadi.kinematics.jacobian import jacobian_states, unpack_sums
from curvcasadi.symbolic.derivatives import with_jacobian
from curvcasadi.symbolic.expressions import AnyExpr


def wing_wash_function(
    wing: Wing, air: FreeAir, points: Sequence[AnyExpr], name: str
) -> ca.Function:
    """Velocity of the air that the horseshoes of a wing induce off it, with structured derivatives.

    (q, twist, lag, deflections …) -> wash (3, points), m/s, body axes. Its circulations are those
    that the lag states hold; without lag those of the shape and of the motion of the body. The way
    from the wing to a point takes no time.
    """
    beam = wing.beam
    states, deflections = air_symbols(wing, air)
    states.pop("gust", None)
    q, twist = ca.MX.sym("q", beam.basis.n), ca.MX.sym("twist", 6)
    others = {"twist": twist, **states, **deflections}
    load = air.load(wing, states.get("lag", ca.MX(0, 1)), deflections, velocity=twist[3:])
    follows = circulations_follow(load, ca.DM.eye(3))
    if follows.moving:
        follows = follows._replace(motion=(twist[3:], twist[:3]), moving=False)
    line = line_of_load(load, beam, follows)
    data = ca.vertcat(line.data, *points)
    boundaries = inertial_mesh(beam, [load, *wing.loads]).stations
    along = chain.build(beam, load.points, boundaries=boundaries)
    poses = along.march([chain.pose_step(along.pattern)], beam.root.packed, q)
    value = line_functions.wash(line.key, len(points))(ca.horzcat(*poses), data)
    marched = jacobian_states(along, q, beam.root.packed)
    motions = ca.horzcat(*(state[:12] for state in marched))
    by_motions, by_data = line_functions.wash_slopes(line.key, len(points))(motions, data)
    moves = ca.vertcat(*(part for state in marched for part in unpack_sums(state)))
    changes = ca.densify(ca.jacobian(data, ca.veccat(*others.values())))
    slopes = ca.horzcat(by_motions @ moves, by_data @ changes)
    return with_jacobian(name, {"q": q, **others}, {"wash": value}, {"wash": slopes})
