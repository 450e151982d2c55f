"""How fast do a geometric law, LQR and MPC turn the tip of a very flexible wing?

    Ψ = ½ tr(I − R_dᵀ R),  e_R = ½ (R_dᵀ R − Rᵀ R_d)^∨

Left: rates of the weights are free (`attitude_law`, lagging actuators): 20 starts with errors up to
120°, beside tan(θ/2) = tan(θ_0/2) exp(−t/τ). Right: the HALE wing at 20 m/s with two flaps (±15°,
60°/s, 20 ms), 10° steps of the tip up and down. The geometric law (`attitude_feedback`) sees the
attitude of the tip alone; LQR and MPC are given the whole state of a model with fewer weights and
lag states than the wing has. `--animate` writes a GIF of the wing under the geometric law.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import brentq

import curvcasadi as cc
from curvcasadi.plotting import animate_shape
from curvcasadi.reference_wings import hale_wing

TAU, ACTUATORS = 0.5, 0.1  # s: of the law with free rates; of the actuators
DT, LAG = 0.05, 0.02  # s: of samples; of the flaps
LIMIT, RATE = np.deg2rad(15), np.deg2rad(60)  # rad, rad/s
P = {"airspeed": 20.0, "pitch": 0.03}
STEP, HELD = 10.0, 5.0  # °, s
SETTLED = 1.0  # °
FLAPS_TAU = 1.0  # s
CONTROLLERS = ("held deflections", "geometric law", "LQR", "MPC")
COLORS = ("0.6", "tab:blue", "tab:green", "tab:orange")


@dataclass(frozen=True)
class Goal:
    """A target that the flaps can hold, and the state and deflections that do, of the model."""

    target: np.ndarray  #: (3, 3)
    x: np.ndarray
    u: np.ndarray


#: (state of the wing, deflections, goal) -> command.
Controller = Callable[[np.ndarray, np.ndarray, Goal], np.ndarray]


def angle(rotation: np.ndarray, target: np.ndarray) -> float:
    """Between two attitudes, °."""
    cosine = (np.trace(target.T @ rotation) - 1) / 2
    return float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))


def free_rates(seconds: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Errors (20, T) over time, °, from starts of 6° to 120°."""
    beam, rng = hale_wing(), np.random.default_rng(0)
    law = cc.attitude_law(beam, time_constant=TAU)
    model, tip = cc.kinematic_model(beam, time_constant=ACTUATORS), cc.tip_function(beam)
    step = cc.rk4_step(model, 0.02)
    size = np.array([0.04, 0.02, 0.01, 0.08, 0.03, 0.01, 0.005, 0.004, 0.002])
    time, errors = np.arange(0, seconds, 0.02), []
    while len(errors) < 20:
        q, other = size * rng.uniform(-1, 1, (2, 9))
        target, k = tip(other)[1].full(), len(errors)
        if not 6 * k < angle(tip(q)[1].full(), target) <= 6 * (k + 1):
            continue
        error = []
        for _ in time:
            q_dot, _, _ = law(q, target, np.zeros(3))
            error.append(angle(tip(q)[1].full(), target))
            command = np.clip(q + ACTUATORS * q_dot.full()[:, 0], -0.15, 0.15)
            q = step(q, command, np.zeros(9)).full()[:, 0]
        errors.append(error)
    return time, np.array(errors)


def make(weights: tuple[int, int, int], elements: int, lag: cc.IndicialLag, name: str):
    """The wing with two flaps, and its model."""
    channels = zip(("torsion", "out_of_plane", "in_plane"), weights, strict=True)
    basis = cc.ChannelBasis(**{key: cc.Legendre(n) for key, n in channels})
    beam = replace(hale_wing(grid=cc.Grid.lobatto(elements)), basis=basis)
    flaps = [
        cc.ControlSurface(name=key, lift=3.5, moment=-0.6, start=a, end=b)
        for key, a, b in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
    ]
    strips = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, controls=tuple(flaps)
    )
    wing = cc.Wing(name="right", beam=beam, strips=strips)
    outputs = ("tip_rotation",)
    return wing, cc.wing_model(
        wing, density=0.0889, lag=lag, damping=0.002, outputs=outputs, name=name
    )


def equilibrium(model: cc.ControlModel, u: np.ndarray) -> np.ndarray:
    return cc.flutter(model, [18.0, P["airspeed"]], u=u, p={"pitch": P["pitch"]}).equilibria[-1]


def goals(beam: cc.Beam, model: cc.ControlModel, direction: np.ndarray) -> list[Goal]:
    """Where the tip is 10° up and 10° down, held by deflections in one direction."""
    tip, n = cc.tip_function(beam), beam.basis.n
    start = tip(equilibrium(model, np.zeros(2))[:n])[1].full()

    def goal(size: float) -> Goal:
        x = equilibrium(model, size * direction)
        return Goal(tip(x[:n])[1].full(), x, size * direction)

    sizes = [
        brentq(lambda a: angle(goal(a).target, start) - STEP, *bracket, xtol=1e-5)
        for bracket in ((0.01, 0.2), (-0.2, -0.01))
    ]
    return [goal(size) for size in sizes]


def geometric(wing: cc.Beam, feedback: cc.AttitudeFeedback) -> Controller:
    tip, n, integral = cc.tip_function(wing), wing.basis.n, np.zeros(2)

    def command(x: np.ndarray, flaps: np.ndarray, goal: Goal) -> np.ndarray:
        nonlocal integral
        u, after, _, _ = feedback.step(tip(x[:n])[1], goal.target, integral, DT)
        integral = after.full()[:, 0]
        return u.full()[:, 0]

    return command


def lqr(beam: cc.Beam, plant: cc.ControlModel, linear: cc.LinearModel) -> Controller:
    """It weighs the attitude of the tip against commands, and knows the lag of the flaps."""
    n, nx = beam.basis.n, len(linear.A)
    A = np.block([[linear.A, linear.B], [np.zeros((2, nx)), -np.eye(2) / LAG]])
    B = np.vstack([np.zeros((nx, 2)), np.eye(2) / LAG])
    step = expm(DT * np.block([[A, B], [np.zeros((2, nx + 4))]]))
    A, B = step[: nx + 2, : nx + 2], step[: nx + 2, nx + 2 :]
    J = np.zeros((3, nx + 2))
    J[:, :n] = cc.body_jacobian(beam, linear.x[:n]).full()[:3]
    R = 0.02 * np.eye(2)
    S = solve_discrete_are(A, B, J.T @ J, R)
    K = np.linalg.solve(R + B.T @ S @ B, B.T @ S @ A)

    def command(x: np.ndarray, flaps: np.ndarray, goal: Goal) -> np.ndarray:
        state = cc.project_state(plant, x, linear.model)
        return goal.u - K @ np.concatenate([state - goal.x, flaps - goal.u])

    return command


def predictive(plant: cc.ControlModel, model: cc.ControlModel) -> Controller:
    names = [part.name for part in model.u.parts]
    mpc = cc.Mpc(
        model,
        dt=DT,
        horizon=24,
        blocks=[1] * 4 + [2] * 4 + [4] * 3,
        outputs={"tip_rotation": 1.0},
        inputs=dict.fromkeys(names, 0.002),
        moves=dict.fromkeys(names, 0.02),
        bounds=dict.fromkeys(names, (-LIMIT, LIMIT)),
        rate_bounds=dict.fromkeys(names, RATE),
    )

    def command(x: np.ndarray, flaps: np.ndarray, goal: Goal) -> np.ndarray:
        reference = {"tip_rotation": goal.target.ravel(order="F")}
        reference |= dict(zip(names, goal.u, strict=True))
        return mpc.step(cc.project_state(plant, x, model), P, reference).u

    return command


def fly(
    wing: cc.Beam, step, start: np.ndarray, steps: list[Goal], controller: Controller
) -> dict[str, np.ndarray]:
    """The wing over the steps: error of the tip, °, deflections and weights."""
    tip, n, x, flaps = cc.tip_function(wing), wing.basis.n, start, np.zeros(2)
    rows: dict[str, list] = {"error": [], "flaps": [], "q": []}
    for goal in steps:
        for _ in range(round(HELD / DT)):
            command = np.clip(controller(x, flaps, goal), -LIMIT, LIMIT)
            for _ in range(50):  # the actuators, at 1 ms
                change = (command - flaps) * (1 - np.exp(-DT / 50 / LAG))
                flaps = flaps + np.clip(change, -RATE * DT / 50, RATE * DT / 50)
            x = step(x, flaps, [*P.values()])[0].full()[:, 0]
            rows["error"].append(angle(tip(x[:n])[1].full(), goal.target))
            rows["flaps"].append(flaps)
            rows["q"].append(x[:n])
    return {key: np.array(values).T for key, values in rows.items()}


def settling(error: np.ndarray) -> list[float]:
    """Time of each step after which the error stays below 1°, s; HELD where it does not."""
    last = [np.flatnonzero(part > SETTLED)[-1] + 1 for part in np.split(error, 2)]
    return [float(DT * k) for k in last]


def plot(time: np.ndarray, errors: np.ndarray, runs: dict[str, dict[str, np.ndarray]]) -> Figure:
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    grid = figure.add_gridspec(2, 2)
    left = figure.add_subplot(grid[:, 0])
    for error in errors:
        start = np.tan(np.deg2rad(error[0]) / 2)
        exact = 2 * np.rad2deg(np.arctan(start * np.exp(-time / TAU)))
        left.plot(time, error, color="tab:blue", lw=1, label="lagging actuators")
        left.plot(time, exact, "--", color="black", lw=0.6, label="closed form, no lag")
    left.legend(*[x[:2] for x in left.get_legend_handles_labels()], frameon=False)
    left.set(xlabel="time [s]", ylabel="attitude error of the tip [°]", ylim=(0, 125))
    left.set_xlim(0, time[-1])
    left.set_title("free rates of the weights: 20 starts", fontsize="medium")
    upper = figure.add_subplot(grid[0, 1])
    lower = figure.add_subplot(grid[1, 1], sharex=upper)
    upper.tick_params(labelbottom=False)
    for (name, run), color in zip(runs.items(), COLORS, strict=False):
        at = DT * (1 + np.arange(len(run["error"])))
        upper.plot(at, run["error"], color=color, lw=1.3, label=name)
        lower.plot(at, np.rad2deg(run["flaps"][1]), color=color, lw=1.3)
    upper.axhline(SETTLED, color="black", lw=0.5, ls=":")
    upper.set(ylabel="attitude error [°]", ylim=(0, 26))
    upper.set_title(f"flaps at {P['airspeed']:.0f} m/s: 10° up, then 10° down", fontsize="medium")
    upper.legend(frameon=False, fontsize="small", ncols=2, loc="upper right")
    lower.set(xlabel="time [s]", ylabel="outer flap [°]", ylim=(-16, 16), xlim=(0, 2 * HELD))
    return figure


def main(
    directory: Path = Path("out"), animate: bool = False
) -> tuple[np.ndarray, dict[str, list[float]]]:
    time, errors = free_rates()
    converged = int(np.sum(errors[:, -1] < 0.5))
    largest = errors[:, 0].max()
    print(f"free rates: {converged} of {len(errors)} starts up to {largest:.0f}° converge")

    wing, plant = make((3, 4, 1), 8, cc.IndicialLag(poles=3, modes=3), "wing")
    small, model = make((2, 3, 1), 6, cc.IndicialLag(poles=2, modes=2), "control")
    x = equilibrium(model, np.zeros(2))
    feedback = cc.attitude_feedback(
        model, small.beam, x, None, P, time_constant=FLAPS_TAU, bounds=(-LIMIT, LIMIT)
    )
    direction = np.linalg.svd(feedback.gain)[2][0]
    direction *= np.sign(direction[1])
    makers: dict[str, Callable[[], Controller]] = {
        "held deflections": lambda: lambda x, flaps, goal: goal.u,
        "geometric law": lambda: geometric(wing.beam, feedback),
        "LQR": lambda: lqr(small.beam, plant, cc.linearize(model, x, None, P)),
        "MPC": lambda: predictive(plant, model),
    }
    steps = goals(small.beam, model, direction)
    step = cc.compile_function(cc.step_function(plant, DT, substeps=20), derivatives=0)
    start = equilibrium(plant, np.zeros(2))
    runs = {name: fly(wing.beam, step, start, steps, makers[name]()) for name in CONTROLLERS}
    times = {name: settling(run["error"]) for name, run in runs.items()}
    for name, (up, down) in times.items():
        up_text, down_text = (f"{t:.2f} s" if t < HELD else "later" for t in (up, down))
        print(f"{name}: within {SETTLED:g}° after {up_text} up, {down_text} down")
    directory.mkdir(exist_ok=True)
    plot(time, errors, runs).savefig(directory / "tip_attitude_tracking.png", dpi=150)
    if animate:
        run, file = runs["geometric law"], directory / "tip_attitude_tracking.gif"
        animate_shape(wing.beam, DT * np.arange(run["q"].shape[1]), run["q"].T, file)
    return errors, times


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of the wing")
    main(animate=parser.parse_args().animate)
