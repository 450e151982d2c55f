"""Lagrange's equations of a beam by automatic differentiation: the oracle of the dynamics.

Kinetic and potential energy are written with poses alone, velocities are directional derivatives,
and everything else is AD of the whole chain. Only the poses and the quadrature are the package's.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.dynamics.inertia import inertial_mesh
from curvcasadi.kinematics import chain
from curvcasadi.lie import so3
from curvcasadi.statics.energy import strain_energy


def lumps(beam, mesh):
    """(station index, mass, centre (3,), inertia (3, 3) about it) of sections and bodies."""
    section = beam.section
    if section.mass_per_length is not None:
        for panel in mesh.panels:
            for node, xi, weight in zip(panel.nodes, panel.xi, panel.weights, strict=True):
                length = weight * beam.length
                inertia = np.zeros((3, 3))
                if section.inertia is not None:
                    inertia = ca.DM(section.inertia_at(xi)).full()
                mass = section.mass_at(xi)
                yield node, length * mass, section.center_of_mass_at(xi), length * inertia
    for body in beam.bodies:
        node = int(np.argmin(np.abs(mesh.stations - body.xi)))
        yield node, body.mass, body.offset, body.inertia


def root_path(root, t):
    """Pose of the root itself over the time t, from body twist and its rate, to second order."""
    omega, v = root.twist[:3], root.twist[3:]
    alpha, v_dot = root.twist_rate[:3], root.twist_rate[3:]
    turned = so3.exp(omega * t + alpha * t**2 / 2)
    moved = v * t + (v_dot + ca.cross(omega, v)) * t**2 / 2
    return turned, moved


def relative_poses(beam, q, mesh):
    """(R, p) of the stations of a mesh in the root's axes."""
    built = chain.build(beam, mesh.stations.tolist(), boundaries=mesh.stations)
    states = built.march([chain.pose_step(built.pattern)], chain.IDENTITY, q)
    return [chain.unpack_pose(state) for state in states]


def energies(beam, q, t, rates, gravity, root=None, loads=()):
    """Kinetic energy T(q, rates, t) and potential energy V(q, t); `rates` are those of q."""
    mesh = inertial_mesh(beam, loads)
    kinetic, potential = 0, strain_energy(beam, q)
    base_rotation, base_position = beam.root.rotation, beam.root.position
    turned, moved = ca.DM.eye(3), ca.DM.zeros(3)
    if root is not None:
        base_position = root.pose.position + root.pose.rotation @ base_position
        base_rotation = root.pose.rotation @ base_rotation
        turned, moved = root_path(root, t)
    placed = []
    for relative in relative_poses(beam, q, mesh):
        rotation = base_rotation @ turned @ relative[0]
        position = base_position + base_rotation @ (moved + turned @ relative[1])
        placed.append((rotation, position))
    for node, mass, center, inertia in lumps(beam, mesh):
        rotation, position = placed[node]
        at = position + rotation @ ca.DM(center)
        along = lambda x: ca.jtimes(x, q, rates) + ca.jacobian(x, t)  # noqa: E731
        velocity = along(at)
        omega = so3.vee(rotation.T @ ca.reshape(along(ca.vec(rotation)), 3, 3))
        kinetic += mass * ca.sumsqr(velocity) / 2 + omega.T @ ca.DM(inertia) @ omega / 2
        potential -= mass * ca.dot(ca.DM(gravity), at)
    return kinetic, potential


def lagrange_function(beam, gravity=(0, 0, 0), root=None, loads=()):
    """(q, q_dot, q_ddot) -> residual, mass matrix, kinetic energy, potential energy."""
    n = beam.basis.n
    q, q_dot, q_ddot = (ca.MX.sym(name, n) for name in ("q", "q_dot", "q_ddot"))
    t = ca.MX.sym("t")
    kinetic, potential = energies(beam, q, t, q_dot, gravity, root, loads)
    momentum = ca.gradient(kinetic, q_dot)
    force = ca.jtimes(momentum, ca.vertcat(q, q_dot), ca.vertcat(q_dot, q_ddot))
    force += ca.jacobian(momentum, t) - ca.gradient(kinetic, q) + ca.gradient(potential, q)
    outputs = [force, ca.jacobian(momentum, q_dot), kinetic, potential]
    outputs = [ca.substitute(ca.MX(x), t, 0) for x in outputs]
    return ca.Function("lagrange", [q, q_dot, q_ddot], outputs)
