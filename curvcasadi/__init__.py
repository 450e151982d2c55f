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

from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

from curvcasadi import errors as _errors  # first: how the command ends at Ctrl-C  # noqa: F401

# isort: split
from curvcasadi.aero import (
    AerodynamicLoad,
    ControlSurface,
    ExponentialTipLoss,
    Flow,
    GustEntry,
    GustField,
    IndicialLag,
    LiftingLine,
    OneMinusCosine,
    Planform,
    SampledGust,
    StepGust,
    StripAerodynamics,
    StripForces,
    Turbulence,
    UnsteadyAirload,
    frozen_gust,
    kussner,
    mirror_aero,
    planform,
    strip_forces,
)
from curvcasadi.aircraft import (
    Aircraft,
    Flight,
    FlightMomenta,
    LiftingSurface,
    NoBody,
    RigidBody,
    Thrust,
    TipHeight,
    TrimResult,
    Wing,
    aircraft_wrench,
    free_forward_dynamics,
    free_inverse_dynamics,
    free_inverse_dynamics_function,
    free_kinetic_energy,
    free_mass_matrix,
    free_momenta,
    free_strain_energy,
    mirror_wing,
    trim,
    trim_sweep,
    trim_table,
)
from curvcasadi.beam import (
    Beam,
    Body,
    BSpline,
    CantileverModes,
    ChannelBasis,
    Chebyshev,
    ComplianceBasis,
    FreeTip,
    Grid,
    Legendre,
    ModalBasis,
    Modes,
    Monomial,
    Piecewise,
    PiecewiseConstant,
    Pose,
    Section,
    Steps,
    Tabulated,
    VectorBasis,
    WingGeometry,
    condense_axial,
    mirror,
    wing_root,
)
from curvcasadi.control import (
    ControlModel,
    LinearModel,
    SecondOrder,
    Simulation,
    aircraft_model,
    beam_model,
    difference,
    kinematic_model,
    linearize,
    retract,
    rk4_step,
    second_order_model,
    simulate,
    step_function,
    wing_model,
)
from curvcasadi.dynamics import (
    VibrationModes,
    forward_dynamics,
    forward_dynamics_function,
    inverse_dynamics,
    inverse_dynamics_function,
    kinetic_energy,
    mass_matrix,
    natural_frequencies,
    potential_energy,
    vibration_modes,
)
from curvcasadi.errors import ConvergenceError
from curvcasadi.estimation import (
    Estimate,
    Placement,
    RandomWalk,
    ShapeDeviations,
    ShapeEkf,
    ShapeFit,
    ShapeMhe,
    WhiteAcceleration,
    WindowEstimate,
    fit_shape,
    information_matrix,
    place_sensors,
    run_ekf,
    run_mhe,
    shape_deviations,
    shape_ekf,
    shape_mhe,
)
from curvcasadi.export import CFunction, export_c
from curvcasadi.files import (
    EstimationFile,
    WingFile,
    load_aircraft,
    load_beam,
    load_estimation,
    load_modes,
    load_wing,
    modal_basis,
    write_simulation,
)
from curvcasadi.kinematics import (
    Shape,
    body_jacobian,
    body_jacobian_rate,
    body_twist,
    curvature,
    elements_for,
    pose_at,
    pose_function,
    shape_map,
    squared_element_angles,
    tip_function,
)
from curvcasadi.loads import (
    DistributedForce,
    DistributedMoment,
    Gravity,
    Load,
    PointForce,
    PointMoment,
)
from curvcasadi.ocp import (
    ShapeResult,
    Target,
    reach_shape,
    shape_target_function,
    target_residual_function,
    tip_path_step_function,
)
from curvcasadi.sensors import (
    Accelerometer,
    AttitudeSensor,
    Camera,
    Magnetometer,
    Marker,
    RateGyro,
    RootMotion,
    Sensor,
    ShearGauge,
    StrainGauge,
    measure,
    measurement_function,
    measurement_residual,
    sensor_channels,
)
from curvcasadi.solvers import SqpSettings
from curvcasadi.statics import (
    Equilibrium,
    equilibrium_function,
    equilibrium_residual,
    equilibrium_tangent,
    generalized_force,
    root_wrench,
    solve_equilibrium,
    strain_energy,
)
from curvcasadi.symbolic import (
    Layout,
    Part,
    compile_function,
    function,
    jacobian_function,
)

if _TYPE_CHECKING:
    from curvcasadi.plotting import (
        animate_shape,
        plot_basis,
        plot_estimate,
        plot_modes,
        plot_placement,
        plot_shape,
        plot_trim,
        save_figure,
    )

__version__ = "0.1.0"

#: Of `curvcasadi.plotting`, which is imported at their first use: matplotlib is slow to load.
_PICTURES = (
    "animate_shape",
    "plot_basis",
    "plot_estimate",
    "plot_modes",
    "plot_placement",
    "plot_shape",
    "plot_trim",
    "save_figure",
)


def __getattr__(name: str) -> _Any:
    if name in _PICTURES:
        from curvcasadi import plotting

        return getattr(plotting, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = [
    "Accelerometer",
    "AerodynamicLoad",
    "Aircraft",
    "AttitudeSensor",
    "BSpline",
    "Beam",
    "Body",
    "CFunction",
    "Camera",
    "CantileverModes",
    "ChannelBasis",
    "Chebyshev",
    "ComplianceBasis",
    "ControlModel",
    "ControlSurface",
    "ConvergenceError",
    "DistributedForce",
    "DistributedMoment",
    "Equilibrium",
    "Estimate",
    "EstimationFile",
    "ExponentialTipLoss",
    "Flight",
    "FlightMomenta",
    "Flow",
    "FreeTip",
    "Gravity",
    "Grid",
    "GustEntry",
    "GustField",
    "IndicialLag",
    "Layout",
    "Legendre",
    "LiftingLine",
    "LiftingSurface",
    "LinearModel",
    "Load",
    "Magnetometer",
    "Marker",
    "ModalBasis",
    "Modes",
    "Monomial",
    "NoBody",
    "OneMinusCosine",
    "Part",
    "Piecewise",
    "PiecewiseConstant",
    "Placement",
    "Planform",
    "PointForce",
    "PointMoment",
    "Pose",
    "RandomWalk",
    "RateGyro",
    "RigidBody",
    "RootMotion",
    "SampledGust",
    "SecondOrder",
    "Section",
    "Sensor",
    "Shape",
    "ShapeDeviations",
    "ShapeEkf",
    "ShapeFit",
    "ShapeMhe",
    "ShapeResult",
    "ShearGauge",
    "Simulation",
    "SqpSettings",
    "StepGust",
    "Steps",
    "StrainGauge",
    "StripAerodynamics",
    "StripForces",
    "Tabulated",
    "Target",
    "Thrust",
    "TipHeight",
    "TrimResult",
    "Turbulence",
    "UnsteadyAirload",
    "VectorBasis",
    "VibrationModes",
    "WhiteAcceleration",
    "WindowEstimate",
    "Wing",
    "WingFile",
    "WingGeometry",
    "aircraft_model",
    "aircraft_wrench",
    "animate_shape",
    "beam_model",
    "body_jacobian",
    "body_jacobian_rate",
    "body_twist",
    "compile_function",
    "condense_axial",
    "curvature",
    "difference",
    "elements_for",
    "equilibrium_function",
    "equilibrium_residual",
    "equilibrium_tangent",
    "export_c",
    "fit_shape",
    "forward_dynamics",
    "forward_dynamics_function",
    "free_forward_dynamics",
    "free_inverse_dynamics",
    "free_inverse_dynamics_function",
    "free_kinetic_energy",
    "free_mass_matrix",
    "free_momenta",
    "free_strain_energy",
    "frozen_gust",
    "function",
    "generalized_force",
    "information_matrix",
    "inverse_dynamics",
    "inverse_dynamics_function",
    "jacobian_function",
    "kinematic_model",
    "kinetic_energy",
    "kussner",
    "linearize",
    "load_aircraft",
    "load_beam",
    "load_estimation",
    "load_modes",
    "load_wing",
    "mass_matrix",
    "measure",
    "measurement_function",
    "measurement_residual",
    "mirror",
    "mirror_aero",
    "mirror_wing",
    "modal_basis",
    "natural_frequencies",
    "place_sensors",
    "planform",
    "plot_basis",
    "plot_estimate",
    "plot_modes",
    "plot_placement",
    "plot_shape",
    "plot_trim",
    "pose_at",
    "pose_function",
    "potential_energy",
    "reach_shape",
    "retract",
    "rk4_step",
    "root_wrench",
    "run_ekf",
    "run_mhe",
    "save_figure",
    "second_order_model",
    "sensor_channels",
    "shape_deviations",
    "shape_ekf",
    "shape_map",
    "shape_mhe",
    "shape_target_function",
    "simulate",
    "solve_equilibrium",
    "squared_element_angles",
    "step_function",
    "strain_energy",
    "strip_forces",
    "target_residual_function",
    "tip_function",
    "tip_path_step_function",
    "trim",
    "trim_sweep",
    "trim_table",
    "vibration_modes",
    "wing_model",
    "wing_root",
    "write_simulation",
]
