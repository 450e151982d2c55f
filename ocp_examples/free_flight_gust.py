"""What does flexibility do to an aircraft that meets a gust in free flight?

    w = ½ w₀ (1 − cos 2π x/L),   met by every strip where it is

The HALE aircraft and the same one with wings a hundred times as stiff, both trimmed at 25 m/s, fly
through a gust of 3 m/s that is 40 m long and lies under the right wing alone.
"""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
from matplotlib.figure import Figure

import curvcasadi as cc

AIRCRAFT = Path(__file__).parent / "hale_aircraft.toml"
DENSITY, SPEED = 0.0889, 25.0  # kg/m³, m/s
AMPLITUDE, LENGTH, START = 3.0, 40.0, 20.0  # m/s, m, m
TIMES = np.arange(0, 6.01, 0.05)  # s
STEP = 0.01  # s
OUTPUTS = ("height", "load_factor", "tip_position_right", "root_moment_right", "root_moment_left")


def gust(position: ca.MX, time: ca.MX) -> ca.MX:
    """Velocity of the air: upward, to the right of the flight path."""
    wave = cc.OneMinusCosine(amplitude=AMPLITUDE, duration=LENGTH, start=START)
    right = (1 + ca.tanh(2 * position[1])) / 2
    return ca.vertcat(0, 0, -wave(position[0]) * right)


def stiffened(aircraft: cc.Aircraft, factor: float) -> cc.Aircraft:
    section = aircraft.beams[0].beam.section
    stiff = cc.Section(
        GJ=1e4 * factor,
        EI_y=2e4 * factor,
        EI_z=4e6 * factor,
        mass_per_length=section.mass_per_length,
        inertia=section.inertia,
    )
    right = replace(aircraft.beams[0], beam=replace(aircraft.beams[0].beam, section=stiff))
    return replace(aircraft, beams=(right, cc.mirror_wing(right, "left")))


def fly(aircraft: cc.Aircraft) -> cc.Simulation:
    trim = cc.trim(aircraft, speed=SPEED, density=DENSITY)
    model = cc.aircraft_model(aircraft, density=DENSITY, gust=cc.GustField(gust), outputs=OUTPUTS)
    x, u = cc.trimmed_state(model, trim, {"time": TIMES[0]})
    return cc.simulate(model, x, TIMES, u=u, method="implicit_midpoint", dt=STEP)


def plot(flights: dict[str, cc.Simulation]) -> Figure:
    figure = Figure(figsize=(6.4, 7.2), layout="constrained")
    load, bending, roll = figure.subplots(3, 1, sharex=True)
    for (label, flight), color in zip(flights.items(), ("black", "tab:blue"), strict=True):
        load.plot(TIMES, flight.part("load_factor")[0], color=color, label=label)
        for side, style in (("right", "-"), ("left", "--")):
            moment = np.abs(flight.part(f"root_moment_{side}")[1])
            name = f"{label}, {side}"
            bending.plot(TIMES, moment - moment[0], style, color=color, label=name)
        roll.plot(TIMES, np.degrees(flight.part("twist")[0]), color=color, label=label)
    load.set(ylabel="load factor of the body")
    bending.set(ylabel="root bending, grown by [N m]")
    roll.set(xlabel="time [s]", ylabel="roll rate [deg/s]")
    for axes in (load, bending, roll):
        axes.grid(color="0.9")
        axes.legend(frameon=False, fontsize="small")
    return figure


def main(directory: Path = Path("out")) -> dict[str, cc.Simulation]:
    flexible = cc.load_aircraft(AIRCRAFT)
    flights = {"flexible": fly(flexible), "stiff": fly(stiffened(flexible, 100.0))}
    print("              most of: load factor, growth of root bending [N m], roll rate [deg/s]")
    for label, flight in flights.items():
        moment = np.abs(flight.part("root_moment_right")[1])
        rate = np.degrees(np.abs(flight.part("twist")[0]).max())
        load = flight.part("load_factor")[0].max()
        print(f"{label:<22}{load:8.3f}{(moment - moment[0]).max():10.1f}{rate:10.2f}")
    directory.mkdir(exist_ok=True)
    plot(flights).savefig(directory / "free_flight_gust.png", dpi=150)
    return flights


if __name__ == "__main__":
    main()
