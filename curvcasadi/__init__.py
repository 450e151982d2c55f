"""Curvature bases for very flexible wings, as CasADi expressions.

Conventions

| what | convention |
|---|---|
| units | SI and radians everywhere; weights `q` in rad/m, basis functions dimensionless |
| vectors | columns (n, 1); arrays over stations (3, N), one station per column |
| station | normalized arc length xi = s/L in [0, 1] |
| frames | parent: the frame in which `Beam.root` is given (for a wing, body axes); root: the local axes at xi = 0; local: the section axes at a station |
| local axes | x along the reference curve to the tip, y to the leading edge, z = x × y: up on a right wing, down on a left wing |
| aircraft | body axes x forward, y right, z down |
| total curvature | K = (K_x, K_y, K_z) in local axes: torsion, out-of-plane, in-plane bending; on a right wing tip-up is K_y < 0, leading edge up K_x > 0; both flip on a left wing |
| mirror | `mirror(beam)` is the other half wing: the same q gives the mirror image |
| rotation | R takes local components to parent ones; its columns are the local axes; R' = R [K×] |
| deformation map | D = Rᵀ takes parent components to local ones; dD/ds = −[K×] D |
| pose | T = (R, p), T' = T ξ^ with the strain ξ = (K, e_x): inextensible, unshearable |
| 6-vectors | angular part first: twist (Ω, v), strain (K, ε); local axes |
| Jacobian | body Jacobian: twist = J(q) q_dot; the perturbation stands on the right, R exp(φ) |
| rate | Ω is what a gyro strapped to the station reads; dΩ/ds = dK/dt + Ω × K |

Symbols of the paper (IFASD, "Nonlinear curvature basis functions for strain-based geometrically
nonlinear beams for very flexible aircraft modeling") and their names here

| paper | here |
|---|---|
| K_0, Φ, q (Eq. 3) | `Beam.initial_curvature`, `Beam.basis`, the argument `q` |
| K (Eqs. 3 and 7) | `curvature`, `Shape.curvatures` |
| D (Eqs. 2 and 9) | `Pose.deformation_map`; its transpose is `Pose.rotation` |
| p (Eq. 4) | `Pose.position` |
| Ω (Eq. 1) | first three rows of `body_twist` |
| element exponential (Eqs. 5–13) | `Grid.rule`, `Grid.exponential` |
| approximations (Eqs. 15, 16–18) | `exponential="small_angle_sine"`, `"small_angle"` |
| segment length (section 3.1) | `elements_for` |
"""

from typing import TYPE_CHECKING as _TYPE_CHECKING, Any as _Any

from curvcasadi import errors as _errors  # first: how the command ends at Ctrl-C  # noqa: F401

# isort: split
from curvcasadi import (
    aero,
    aircraft,
    beam,
    control,
    dynamics,
    estimation,
    export,
    files,
    kinematics,
    loads,
    ocp,
    sensors,
    solvers,
    statics,
    symbolic,
)
from curvcasadi.aero import *
from curvcasadi.aircraft import *
from curvcasadi.beam import *
from curvcasadi.control import *
from curvcasadi.dynamics import *
from curvcasadi.errors import ConvergenceError
from curvcasadi.estimation import *
from curvcasadi.export import *
from curvcasadi.files import *
from curvcasadi.kinematics import *
from curvcasadi.loads import *
from curvcasadi.ocp import *
from curvcasadi.sensors import *
from curvcasadi.solvers import *
from curvcasadi.statics import *
from curvcasadi.symbolic import *

if _TYPE_CHECKING:
    from curvcasadi.plotting import *

__version__ = "0.1.0"

#: Of `curvcasadi.plotting`, which is imported at their first use: matplotlib is slow to load.
_PICTURES = (
    "animate_flight",
    "animate_shape",
    "plot_basis",
    "plot_estimate",
    "plot_flight",
    "plot_flutter",
    "plot_modes",
    "plot_motion",
    "plot_placement",
    "plot_root_locus",
    "plot_shape",
    "plot_trim",
    "save_figure",
)


def __getattr__(name: str) -> _Any:
    if name in _PICTURES:
        from curvcasadi import plotting

        return getattr(plotting, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


# The face of each room says what it offers.
__all__ = ["ConvergenceError", *_PICTURES]
__all__ += aero.__all__
__all__ += aircraft.__all__
__all__ += beam.__all__
__all__ += control.__all__
__all__ += dynamics.__all__
__all__ += estimation.__all__
__all__ += export.__all__
__all__ += files.__all__
__all__ += kinematics.__all__
__all__ += loads.__all__
__all__ += ocp.__all__
__all__ += sensors.__all__
__all__ += solvers.__all__
__all__ += statics.__all__
__all__ += symbolic.__all__
