"""The same beam with other stiffness and mass: a wing that differs from its model."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from curvcasadi.beam.along import mapped
from curvcasadi.beam.beam import Beam
from curvcasadi.beam.section import Section
from curvcasadi.symbolic.expressions import AnyExpr, Number, instance, is_numeric, positive


def perturbed_beam(beam: Beam, *, GJ: Number = 1.0, EI: Number = 1.0, mass: Number = 1.0) -> Beam:
    """`beam` with its stiffness and mass times factors; its basis functions stay.

    The stiffness C becomes F C F, F = diag(√GJ, √EI, √EI), which keeps it positive definite with
    couplings too. Masses and inertias of section and bodies are multiplied by `mass`.

    Parameters
    ----------
    beam : Beam
        A beam with a section.
    GJ, EI : float or symbol
        Factors of the torsional rigidity and of both bending rigidities, above zero.
    mass : float or symbol
        Factor of all masses and inertias, above zero.

    Returns
    -------
    Beam
        The beam that differs.

    Raises
    ------
    ValueError
        If a factor is not above zero, or the beam has no section.
    """
    section = instance("beam", beam, Beam).section
    if section is None:
        raise ValueError("beam: expected a beam with a section, found none")
    torsion, bending = positive("GJ", GJ), positive("EI", EI)
    mass = positive("mass", mass)
    both = ca.sqrt(torsion * bending)
    both = float(both) if is_numeric(both) else both
    factors = {
        "GJ": torsion,
        "EI_y": bending,
        "EI_z": bending,
        "coupling_xy": both,
        "coupling_xz": both,
        "coupling_yz": bending,
        "mass_per_length": mass,
        "inertia": mass,
    }
    bodies = tuple(
        replace(body, mass=_times(body.mass, mass), inertia=_times(body.inertia, mass))
        for body in beam.bodies
    )
    return replace(beam, section=_scaled(section, factors), bodies=bodies)


def _scaled(section: Section, factors: dict[str, Number]) -> Section:
    return replace(
        section,
        **{
            name: mapped(getattr(section, name), _Factor(factor))
            for name, factor in factors.items()
        },
    )


def _times(value: Number, factor: Number) -> AnyExpr:
    value = ca.DM(value) if is_numeric(value) else value
    return value * factor


class _Factor:
    """Multiplication by a factor, as a function that can be pickled."""

    def __init__(self, factor: Number) -> None:
        self.factor = factor

    def __call__(self, value: Number) -> AnyExpr:
        return _times(value, self.factor)
