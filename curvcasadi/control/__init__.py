"""Models as a control engineer sees them: x, u, p, y."""

from curvcasadi.control.actuators import Actuators
from curvcasadi.control.aircraft_model import aircraft_model
from curvcasadi.control.attitude_law import AttitudeFeedback, attitude_feedback, attitude_law
from curvcasadi.control.beam_model import beam_model
from curvcasadi.control.closed_loop import ClosedLoop, Observer as Observer, closed_loop
from curvcasadi.control.damping import modal_damping
from curvcasadi.control.design import (
    DesignDerivatives,
    design_derivatives,
    flutter_derivatives,
)
from curvcasadi.control.divergence import divergence_derivatives
from curvcasadi.control.error_state import difference, retract
from curvcasadi.control.flight_modes import (
    FlightMode,
    FlightModes,
    flight_modes,
    modes_table,
)
from curvcasadi.control.flutter import Flutter, flutter
from curvcasadi.control.flutter_function import flutter_speed_function
from curvcasadi.control.kinematic_model import kinematic_model
from curvcasadi.control.linearize import LinearModel, linearize
from curvcasadi.control.model import ControlModel, SecondOrder
from curvcasadi.control.peaks import Peak, gust_peak, response_peak
from curvcasadi.control.projection import project_state
from curvcasadi.control.readings import readings_function
from curvcasadi.control.response import frequency_response, power_spectrum, rms_in_turbulence
from curvcasadi.control.second_order import second_order_model
from curvcasadi.control.simulation import Simulation, simulate
from curvcasadi.control.step import rk4_step, step_function
from curvcasadi.control.trimmed_state import TrimmedState, trimmed_state
from curvcasadi.control.wing_model import wing_model

__all__ = [
    "Actuators",
    "AttitudeFeedback",
    "ClosedLoop",
    "ControlModel",
    "DesignDerivatives",
    "FlightMode",
    "FlightModes",
    "Flutter",
    "LinearModel",
    "Peak",
    "SecondOrder",
    "Simulation",
    "TrimmedState",
    "aircraft_model",
    "attitude_feedback",
    "attitude_law",
    "beam_model",
    "closed_loop",
    "design_derivatives",
    "difference",
    "divergence_derivatives",
    "flight_modes",
    "flutter",
    "flutter_derivatives",
    "flutter_speed_function",
    "frequency_response",
    "gust_peak",
    "kinematic_model",
    "linearize",
    "modal_damping",
    "modes_table",
    "power_spectrum",
    "project_state",
    "readings_function",
    "response_peak",
    "retract",
    "rk4_step",
    "rms_in_turbulence",
    "second_order_model",
    "simulate",
    "step_function",
    "trimmed_state",
    "wing_model",
]
