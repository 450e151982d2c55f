"""How fast do a geometric law, LQR and MPC turn the tip of a very flexible wing?

    Ψ = ½ tr(I − R_dᵀ R),  e_R = ½ (R_dᵀ R − Rᵀ R_d)^∨

Left: rates of the weights are free (`attitude_law`, lagging actuators): 20 starts with errors up to
120°, beside tan(θ/2) = tan(θ_0/2) exp(−t/τ). Right: HALE wings at 20 m/s with two flaps (±15°,
60°/s, 20 ms) turn their tips by 10° up, then down. They differ from the model of the controllers:
EI and GJ by up to 10 %, mass by 5 %, airspeed by 1 m/s, and more weights and lag states. Two IMUs
and three strain gauges at 100 Hz are noisy and 20 ms late, and one sample in twenty is missing. A
filter estimates the state of the model and an angle of the flow that stands for what differs. The
geometric law (`attitude_feedback`) takes the attitude of the tip alone, LQR and MPC the whole
state. `--animate` writes a GIF of a wing under the geometric law.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm, solve_discrete_are
from scipy.optimize import brentq

import curvcasadi as cc
from curvcasadi.lie import so3
from curvcasadi.plotting import animate_shape
from curvcasadi.reference_wings import hale_wing

TAU, ACTUATORS = 0.5, 0.1  # s: of the law with free rates; of the actuators
FINE, SAMPLE, DT, LATE, MISSING = 1e-3, 0.01, 0.05, 2, 0.05  # s; samples; their share
VARIED, SPEED = {"GJ": 0.1, "EI": 0.1, "mass": 0.05}, 1.0  # largest changes, relative and in m/s
LAG, LIMIT, RATE = 0.02, np.deg2rad(15), np.deg2rad(60)  # s, rad, rad/s: of the flaps
AIRSPEED, PITCH = 20.0, 0.03  # m/s, rad
CALM, STEP, HELD = 2.0, 10.0, 5.0  # s, °, s
SETTLED = 1.0  # °
FLAPS_TAU = 1.0  # s
FLIGHTS = 3
INPUTS = 0.02  # weight
CONTROLLERS = ("held deflections", "geometric law", "LQR", "MPC")
COLORS = ("0.6", "tab:blue", "tab:green", "tab:orange")
MODEL = {"weights": (2, 3, 1), "elements": 6, "poles": 2, "modes": 2}
PLANT = {"weights": (3, 4, 1), "elements": 8, "poles": 3, "modes": None}
NOISE = {"q_dot": 0.05, "lag": 0.2, "pitch": 0.01}  # densities that drive the filter's process
START = {"q": 0.005, "q_dot": 0.05, "lag": 0.3, "pitch": 0.02}
C, S = np.cos(PITCH), np.sin(PITCH)
ROOT = cc.RootMotion(
    pose=cc.Pose(rotation=[[C, 0, S], [0, 1, 0], [-S, 0, C]], position=[0, 0, 0]),
    gravity=[0, 0, 9.80665],
)
SENSORS = (
    *(cc.RateGyro(xi=xi, noise_density=1e-4, rate=1 / SAMPLE) for xi in (0.5, 1.0)),
    *(cc.Accelerometer(xi=xi, noise_density=2e-3, rate=1 / SAMPLE) for xi in (0.5, 1.0)),
    *(cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=1e-5) for xi in (0.05, 0.3, 0.6)),
)


class Goal(NamedTuple):
    """How far the tip is to turn, and what holds it there, of the model."""

    turn: np.ndarray  # (3, 3), from the attitude without deflections, parent axes
    rotation: np.ndarray  # (3, 3)
    linear: cc.LinearModel


class Flights(NamedTuple):
    """All wings under one controller: entries by time, then by wing."""

    times: np.ndarray  # s
    errors: np.ndarray  # of the attitude of the tip, °
    flaps: np.ndarray  # of the inner and the outer one, rad
    weights: np.ndarray  # rad/m


def angle(attitude, target):
    """Between two attitudes, °."""
    cosine = (np.trace(target.T @ attitude) - 1) / 2
    return float(np.rad2deg(np.arccos(np.clip(cosine, -1, 1))))


def free_rates(seconds=4.0):
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


def make(name, weights, elements, poles, modes, factors=None):
    """The wing with two flaps, and its model; `factors` of GJ, EI and mass become parameters."""
    flaps = tuple(
        cc.ControlSurface(name=key, lift=3.5, moment=-0.6, start=start, end=end)
        for key, start, end in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
    )
    strips = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, controls=flaps
    )
    beam = cc.perturbed_beam(hale_wing(*weights, grid=cc.Grid.lobatto(elements)), **factors or {})
    model = cc.wing_model(
        cc.Wing(name="right", beam=beam, strips=strips),
        density=0.0889,
        lag=cc.IndicialLag(poles=poles, modes=modes),
        damping=0.002,
        outputs=("tip_rotation",),
        parameters=factors or {},
        name=name,
    )
    return beam, model


def equilibrium(model, u=(0.0, 0.0), airspeed=AIRSPEED, **factors):
    speeds, others = [airspeed - 2, airspeed], {"pitch": PITCH, **factors}
    return cc.flutter(model, speeds, u=np.array(u), p=others).equilibria[-1]


def rotation(y):
    return np.reshape(y, (3, 3), order="F")


class Plant:
    """The wings that fly, one for each seed: their steps, readings and attitudes, in batches."""

    def __init__(self, seeds):
        symbols = {name: ca.MX.sym(name) for name in VARIED}
        beam, self.model = make("wing", **PLANT, factors=symbols)
        read = cc.readings_function(self.model, beam, SENSORS, root=ROOT)
        functions = (cc.rk4_step(self.model, FINE), read, self.model.output)
        self.step, self.read, self.output = map(cc.compile_batch, functions)
        draws = np.array([np.random.default_rng(seed).uniform(-1, 1, 4) for seed in seeds])
        factors, airspeed = 1 + draws[:, :3] * [*VARIED.values()], AIRSPEED + SPEED * draws[:, 3:]
        self.p = np.hstack([airspeed, PITCH + 0 * airspeed, factors])
        self.rest = np.array([
            equilibrium(self.model, airspeed=float(speed), **dict(zip(VARIED, each, strict=True)))
            for (speed,), each in zip(airspeed, factors, strict=True)
        ])  # fmt: skip
        attitudes = self.output(self.rest, np.zeros((len(seeds), 2)), self.p)
        self.attitudes = [rotation(y) for y in attitudes]

    def fly(self, control, targets, **sensed):
        """`targets` are two attitudes of each wing: up, and down."""
        loop = cc.closed_loop(
            self.step,
            self.rest,
            control,
            SAMPLE * np.arange(-round(CALM / SAMPLE), round(2 * HELD / SAMPLE)),
            substeps=round(SAMPLE / FINE),
            actuators=cc.Actuators(lag=LAG, rate=RATE, lower=-LIMIT, upper=LIMIT),
            p=lambda time: self.p,
            u=np.zeros(2),
            every=round(DT / SAMPLE),
            **sensed,
        )
        flown = loop.t >= HELD - SAMPLE / 2
        errors = [
            [angle(rotation(y), two[late]) for y, two in zip(now, targets, strict=True)]
            for now, late in zip(map(self.output, loop.x, loop.u, loop.p), flown * 1, strict=True)
        ]
        weights = loop.x[:, :, self.model.x.slices["q"]]
        return Flights(loop.t, np.array(errors), loop.u, weights)


def find_goals(model, direction):
    """10° up and 10° down, held by deflections of the model in one direction."""

    def goal(size):
        u = size * direction
        x = equilibrium(model, u)
        found = rotation(model.output(x, u, [AIRSPEED, PITCH]).full())
        linear = cc.linearize(model, x, u, [AIRSPEED, PITCH])
        return Goal(found @ start.T, found, linear)

    start = rotation(model.output(equilibrium(model), [0, 0], [AIRSPEED, PITCH]).full())
    brackets = ((0.01, 0.2), (-0.2, -0.01))
    return [
        goal(brentq(lambda a: angle(goal(a).turn, np.eye(3)) - STEP, *each, xtol=1e-5))
        for each in brackets
    ]


def held(goals):
    return lambda k, x, pitch, flaps, targets: np.array([goals[k].linear.u] * len(targets))


def geometric(beam, feedback):
    tip, integrals = cc.tip_function(beam), {}

    def command(k, x, pitch, flaps, targets):
        commands = []
        for i, (state, target) in enumerate(zip(x, targets, strict=True)):
            at = tip(state[: beam.basis.n])[1]
            u, integrals[i], _, _ = feedback.step(at, target, integrals.get(i, 0), DT)
            commands.append(u.full().ravel())
        return np.array(commands)

    return command


class Equilibria:
    """Of the model under an estimated angle of the flow, with the tip turned to a target.

    The target is met in the direction in which the flaps turn the tip; so deflections are found
    that the wing needs, which is not the model.
    """

    def __init__(self, beam, goal, direction):
        self.goal, self.direction, linear = goal, direction, goal.linear
        J = np.zeros((3, len(linear.A)))
        J[:, : beam.basis.n] = cc.body_jacobian(beam, linear.x[: beam.basis.n]).full()[:3]
        by_flaps = linear.B @ direction
        turned = J @ np.linalg.solve(linear.A, -by_flaps)
        self.row = turned / np.linalg.norm(turned)
        system = np.block([[linear.A, by_flaps[:, None]], [self.row @ J, 0.0]])
        self.inverse, self.jacobian = np.linalg.inv(system), J

    def __call__(self, pitch, target):
        """State and deflections."""
        linear = self.goal.linear
        error = so3.log(ca.DM(self.goal.rotation.T @ target)).full().ravel()
        known = linear.B_p[:, 1] * (pitch - PITCH)
        *x, size = self.inverse @ np.append(-known, self.row @ error)
        return linear.x + x, linear.u + size * self.direction


def lqr(equilibria):
    """It weighs the attitude of the tip against commands, and knows the lag of the flaps."""
    gains = []
    for each in equilibria:
        linear, nx = each.goal.linear, len(each.goal.linear.A)
        A = np.block([[linear.A, linear.B], [np.zeros((2, nx)), -np.eye(2) / LAG]])
        B = np.vstack([np.zeros((nx, 2)), np.eye(2) / LAG])
        step = expm(DT * np.block([[A, B], [np.zeros((2, nx + 4))]]))
        A, B = step[: nx + 2, : nx + 2], step[: nx + 2, nx + 2 :]
        J = np.hstack([each.jacobian, np.zeros((3, 2))])
        R = 0.02 * np.eye(2)
        P = solve_discrete_are(A, B, J.T @ J, R)
        gains.append(np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A))

    def command(k, x, pitch, flaps, targets):
        commands = []
        for state, flow, at, target in zip(x, pitch, flaps, targets, strict=True):
            goal, u = equilibria[k](flow, target)
            commands.append(u - gains[k] @ np.append(state - goal, at - u))
        return np.array(commands)

    return command


def predictive(model, equilibria, flights):
    names = [part.name for part in model.u.parts]
    mpc = cc.Mpc(
        model,
        dt=DT,
        horizon=24,
        blocks=[1] * 4 + [2] * 4 + [4] * 3,
        outputs={"tip_rotation": 1.0},
        inputs=dict.fromkeys(names, INPUTS),
        moves=dict.fromkeys(names, 0.02),
        bounds=dict.fromkeys(names, (-LIMIT, LIMIT)),
        rate_bounds=dict.fromkeys(names, RATE),
    )
    controllers = [mpc.copy() for _ in range(flights)]

    def command(k, x, pitch, flaps, targets):
        commands = []
        for each, state, flow, target in zip(controllers, x, pitch, targets, strict=True):
            _, u = equilibria[k](flow, target)
            reference = {"tip_rotation": target.ravel(order="F")}
            reference |= dict(zip(names, np.clip(u, -LIMIT, LIMIT), strict=True))
            commands.append(each.step(state, [AIRSPEED, flow], reference).u)
        return np.array(commands)

    return command


def observer(beam, model, flights):
    process = cc.ModelProcess(
        model=model, density=NOISE, estimated={"pitch": None}, acceleration=0.2
    )
    ekf = cc.shape_ekf(beam, SENSORS, process=process, root=ROOT)
    mean = {part: equilibrium(model)[where] for part, where in model.x.slices.items()}
    start = ekf.initial(START, mean | {"pitch": PITCH})
    return ekf.channels.noise, cc.DelayedFilter(
        ekf, start, dt=SAMPLE, delay=LATE, lanes=flights, p=[AIRSPEED]
    )


def simulate(seeds):
    """`Flights` by controller."""
    plant, (small, model) = Plant(seeds), make("control", **MODEL)
    x, p = equilibrium(model), {"airspeed": AIRSPEED, "pitch": PITCH}
    feedback = cc.attitude_feedback(
        model, small, x, None, p, time_constant=FLAPS_TAU, bounds=(-LIMIT, LIMIT)
    )
    direction = np.linalg.svd(feedback.gain)[2][0]
    direction *= np.sign(direction[1])
    goals = find_goals(model, direction)
    equilibria = [Equilibria(small, goal, direction) for goal in goals]
    targets = [[goal.turn @ attitude for goal in goals] for attitude in plant.attitudes]
    makers = {
        "held deflections": lambda: held(goals),
        "geometric law": lambda: geometric(small, feedback),
        "LQR": lambda: lqr(equilibria),
        "MPC": lambda: predictive(model, equilibria, len(seeds)),
    }
    found, nx = {}, model.x.size
    for name in CONTROLLERS:
        command = makers[name]()

        def control(time, estimates, flaps, command=command):
            if time < -SAMPLE / 2:
                return 0 * flaps
            k = int(time > HELD - SAMPLE / 2)
            goal = [two[k] for two in targets]
            return command(k, estimates[:, :nx], estimates[:, nx], flaps, goal)

        noise, late = observer(small, model, len(seeds))
        link = cc.SensorLink(noise=noise, delay=LATE, loss=MISSING, seeds=seeds)
        found[name] = plant.fly(control, targets, read=plant.read, link=link, observer=late)
    return found


def settling(flights):
    """Times (2, wings) of each step after which the error stays below 1°, s; HELD where not."""
    steps = np.split(flights.errors[flights.times > -SAMPLE / 2] > SETTLED, 2)
    return SAMPLE * np.array([
        [max(np.flatnonzero(wing), default=-1) + 1 for wing in step.T] for step in steps
    ])  # fmt: skip


def plot(time, errors, found):
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
    for name, color in zip(CONTROLLERS, COLORS, strict=False):
        run = found[name]
        lines = upper.plot(run.times, run.errors, color=color, lw=0.9)
        lines[0].set_label(name)
        lower.plot(run.times, np.rad2deg(run.flaps[:, :, 1]), color=color, lw=0.9)
    upper.axhline(SETTLED, color="black", lw=0.5, ls=":")
    upper.set(ylabel="attitude error [°]", ylim=(0, 26))
    upper.set_title(f"flaps at {AIRSPEED:.0f} m/s: 10° up, then 10° down", fontsize="medium")
    upper.legend(frameon=False, fontsize="small", ncols=2, loc="upper right")
    lower.set(xlabel="time [s]", ylabel="outer flap [°]", ylim=(-16, 16), xlim=(-0.5, 2 * HELD))
    return figure


def main(directory=Path("out"), animate=False):
    time, errors = free_rates()
    converged = int(np.sum(errors[:, -1] < 0.5))
    largest = errors[:, 0].max()
    print(f"free rates: {converged} of {len(errors)} starts up to {largest:.0f}° converge")
    found = simulate(range(FLIGHTS))
    times = {name: settling(flights) for name, flights in found.items()}
    for name, both in times.items():
        up, down = (", ".join(f"{t:.2f}" if t < HELD else "later" for t in row) for row in both)
        print(f"{name}: within {SETTLED:g}° after {up} s up, {down} s down")
    directory.mkdir(exist_ok=True)
    plot(time, errors, found).savefig(directory / "tip_attitude_tracking.png", dpi=150)
    if animate:
        run, file = found["geometric law"], directory / "tip_attitude_tracking.gif"
        animate_shape(hale_wing(*PLANT["weights"]), run.times[::5], run.weights[::5, 0], file)
    return errors, times


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--animate", action="store_true", help="write a GIF of the wing")
    main(animate=parser.parse_args().animate)
