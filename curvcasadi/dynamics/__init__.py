"""Equations of motion of one beam: inertia, recursion along the elements, frequencies and modes."""

from curvcasadi.dynamics.energy import (
    kinetic_energy,
    potential_energy,
)
from curvcasadi.dynamics.forward import (
    forward_dynamics,
)
from curvcasadi.dynamics.frequencies import (
    VibrationModes,
    natural_frequencies,
    vibration_modes,
)
from curvcasadi.dynamics.functions import (
    forward_dynamics_function,
    inverse_dynamics_function,
    root_wrench_function,
)
from curvcasadi.dynamics.inverse import (
    inverse_dynamics,
)
from curvcasadi.dynamics.mass import (
    mass_matrix,
)
from curvcasadi.dynamics.rotation import (
    SteadyRotation,
)

__all__ = [
    "SteadyRotation",
    "VibrationModes",
    "forward_dynamics",
    "forward_dynamics_function",
    "inverse_dynamics",
    "inverse_dynamics_function",
    "kinetic_energy",
    "mass_matrix",
    "natural_frequencies",
    "potential_energy",
    "root_wrench_function",
    "vibration_modes",
]
