"""Trim: attitude, inputs and shape of a flexible aircraft in steady flight, straight or turning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from curvcasadi.aero import LiftingLine
from curvcasadi.aircraft.parts import Aircraft
from curvcasadi.aircraft.trim_case import Case
from curvcasadi.aircraft.trim_problem import Hessian, Objective
from curvcasadi.aircraft.trim_result import TrimResult
from curvcasadi.aircraft.trim_solver import TrimSolver
from curvcasadi.aircraft.turn import Turn
from curvcasadi.loads.kinds import STANDARD_GRAVITY
from curvcasadi.symbolic.expressions import optional


def trim(
    aircraft: Aircraft,
    *,
    speed: float,
    density: float,
    gravity: float = STANDARD_GRAVITY,
    flight_path: float | None = 0.0,
    free: Sequence[str] = (),
    sideslip: float | None = None,
    turn: Turn | None = None,
    inputs: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    objective: Objective = None,
    hessian: Hessian = "exact",
    induced_flow: LiftingLine | None = None,
    guess: TrimResult | None = None,
    throw: bool = True,
) -> TrimResult:
    """Steady flight of `aircraft` at `speed`: straight, in sideslip, or in a turn.

    Unknowns are the angle of attack, the pitch angle, the weights of the wings and the inputs;
    conditions are the balance of forces and moments about the body origin, the flight path, and
    equilibrium of every wing. First the unknowns come as near to balance as bounds let them; then,
    if `objective` is given, it chooses among all that balance.

    Out of the plane of symmetry the roll angle is unknown as well, and inputs must roll and yaw the
    aircraft. A turn is coordinated: its sideslip is that at which the specific force at the body
    origin has no component along body y. Body and wings have their inertial forces, and every strip
    the velocity of its own place.

    Parameters
    ----------
    aircraft : Aircraft
        Aircraft with numeric fields.
    speed : float
        Airspeed, m/s.
    density : float
        Density of the air, kg/m³.
    gravity : float
        Acceleration of gravity, m/s².
    flight_path : float or None
        Climb angle, rad; None leaves it free, as in a glide with a given thrust.
    free : sequence of str
        Any of "sideslip" and "roll"; what is not named stays zero in straight flight. In a turn a
        free sideslip is one that nothing is asked of, for aircraft without a rudder.
    sideslip : float, optional
        Sideslip angle that is held, rad: straight flight with a bank angle that balances the side
        force, or a turn that slips.
    turn : Turn, optional
        Steady turn, by its rate, bank angle, radius or load factor; the body needs its inertia.
    inputs : mapping of str to float, optional
        Inputs that are held, by name, N or rad; all others are free. In symmetric flight the
        balances settle those that roll and yaw at zero.
    bounds : mapping of str to (float, float), optional
        Lower and upper bounds of angles and inputs by name. Unless given, angle of attack and
        sideslip stay within 0.35 rad, deflections within 0.5 rad, and thrusts above zero.
    objective : {"strain_energy", "drag", "root_bending"}, TipHeight or None
        What chooses among all states that balance; "root_bending" is the sum of squared
        out-of-plane moments at the roots. None where nothing is left to choose.
    hessian : {"exact", "limited_memory"}
        Hessian of the second solve; "exact" is that of the structured derivatives.
    induced_flow : LiftingLine, optional
        Induced flow of every wing and its downwash at the lifting surfaces; the drag then holds
        induced drag. Without one every strip is on its own.
    guess : TrimResult, optional
        An earlier result of the same aircraft.
    throw : bool
        Whether a state that does not balance raises; otherwise the result says so.

    Returns
    -------
    TrimResult
        The trimmed state, or what comes nearest to it.

    Raises
    ------
    ConvergenceError
        If something does not balance: the message says what, by how much, and which bounds hold;
        its `result` is the nearest state. A search that does not converge says so instead; its
        `result` is where it stopped, with `converged` False.
    ValueError
        For unknown names, bad numbers, and more free inputs than the balances settle.
    """
    optional("turn", turn, Turn)
    solver = TrimSolver(aircraft, objective, hessian, induced_flow, turning=turn is not None)
    case = Case(
        speed,
        density,
        gravity,
        flight_path,
        tuple(free),
        inputs or {},
        bounds or {},
        sideslip,
        turn,
    )
    return solver.solve(case, guess, throw)


def trim_sweep(
    aircraft: Aircraft,
    speeds: Sequence[float],
    *,
    density: float,
    gravity: float = STANDARD_GRAVITY,
    flight_path: float | None = 0.0,
    free: Sequence[str] = (),
    sideslip: float | None = None,
    turn: Turn | None = None,
    inputs: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    objective: Objective = None,
    hessian: Hessian = "exact",
    induced_flow: LiftingLine | None = None,
    throw: bool = False,
    progress: bool = True,
) -> list[TrimResult]:
    """Trim an aircraft at several speeds, each from the last one that was trimmed.

    Parameters
    ----------
    aircraft : Aircraft
        Aircraft with numeric fields.
    speeds : sequence of float
        Airspeeds, m/s.
    density, gravity, flight_path, free, sideslip, turn, inputs, bounds : optional
        As of `trim`.
    objective, hessian, induced_flow : optional
        As of `trim`.
    throw : bool
        Whether a speed at which nothing balances raises; otherwise its result says so.
    progress : bool
        Whether to show a progress bar.

    Returns
    -------
    list of TrimResult
        One per speed.
    """
    from tqdm import tqdm

    optional("turn", turn, Turn)
    solver = TrimSolver(aircraft, objective, hessian, induced_flow, turning=turn is not None)
    guess, results = None, []
    for speed in tqdm(speeds, desc="trim", unit="speed", disable=not progress):
        case = Case(
            speed,
            density,
            gravity,
            flight_path,
            tuple(free),
            inputs or {},
            bounds or {},
            sideslip,
            turn,
        )
        result = solver.solve(case, guess, throw)
        guess = result if result.trimmed else guess
        results.append(result)
    return results
