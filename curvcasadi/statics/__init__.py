"""Strain energy, generalized forces, and equilibrium."""

from curvcasadi.statics.balance import (
    equilibrium_residual,
    equilibrium_tangent,
    generalized_force,
    root_wrench,
)
from curvcasadi.statics.energy import (
    strain_energy,
)
from curvcasadi.statics.equilibrium import (
    Equilibrium,
    solve_equilibrium,
)
from curvcasadi.statics.equilibrium_function import (
    equilibrium_function,
)

__all__ = [
    "Equilibrium",
    "equilibrium_function",
    "equilibrium_residual",
    "equilibrium_tangent",
    "generalized_force",
    "root_wrench",
    "solve_equilibrium",
    "strain_energy",
]
