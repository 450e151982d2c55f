"""The gust case: a wing of nine weights in a stream, two flaps, a filter and a controller.

The plant is the nonlinear wing with unsteady air. The filter has its linearization about trimmed
flight in the same state, with the gust as an unknown; the controller has it in the coordinates of
its eigenvectors, where every stage is sparse.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.expressions import Array, Real

PERIOD = 0.025  #: s
STAGES = 20
BLOCKS = (1, 1, 1, 1, 2, 2, 3, 4, 5)  #: stages over which each unknown input is held
ELEMENTS = 6
AIRSPEED, PITCH = 22.0, 0.05  #: m/s, rad
DENSITY = 0.0889  #: kg/m³
DAMPING = 0.004  #: s
LARGEST = 0.3  #: rad, of a flap
PERIODS = 130
#: Periods whose samples do not arrive: two within the gust, and more than a filter is believed for.
MISSING = {30, 31, *range(105, 119)}
PATIENCE = 10  #: periods without samples after which the flaps are trimmed
GUST = cc.OneMinusCosine(amplitude=2.0, duration=2.0, start=0.5)
PLANT_STEPS = 3  #: of the plant in a period
_C, _S = float(np.cos(PITCH)), float(np.sin(PITCH))
ROOT = cc.RootMotion(
    pose=cc.Pose(rotation=[[_C, 0, _S], [0, 1, 0], [-_S, 0, _C]], position=[0, 0, 0]),
    gravity=[0, 0, 9.80665],
)
SENSORS = (
    *(cc.RateGyro(xi=xi, noise_density=1e-4, rate=1 / PERIOD) for xi in (0.5, 1.0)),
    *(cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=1e-5) for xi in (0.02, 0.3, 0.6)),
)
#: Densities of what drives the filter: rad/(m s √s), m/(s √s); times and deviations.
NOISE = {"q_dot": 0.02, "lag": 0.05, "gust": 1.0}
GUST_TIME = None  #: a random walk: no exponential is computed
DEVIATION = {"q": 5e-4, "q_dot": 5e-3, "lag": 0.02, "gust": 0.05}


@dataclass(frozen=True, eq=False, kw_only=True)
class Case:
    """Plant, filter and controller.

    Attributes
    ----------
    real : {"double", "float"}
        Arithmetic of filter and controller.
    """

    real: Real = "double"

    @cached_property
    def wing(self) -> cc.Wing:
        """The HALE wing with weights that fulfil the conditions of a free tip, and two flaps."""
        basis = cc.ChannelBasis(torsion=cc.FreeTip(4, order=1), out_of_plane=cc.FreeTip(5, order=2))
        grid = cc.Grid.lobatto(ELEMENTS, real=self.real)
        beam = replace(hale_wing(grid=grid), basis=basis, weight_bounds=None)
        flaps = tuple(
            cc.ControlSurface(name=name, lift=3.5, moment=-0.6, start=start, end=end)
            for name, start, end in (("inner", 0.2, 0.6), ("outer", 0.6, 0.95))
        )
        strips = cc.StripAerodynamics(
            chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, controls=flaps
        )
        return cc.Wing(name="right", beam=beam, strips=strips)

    @cached_property
    def plant(self) -> cc.ControlModel:
        """The nonlinear wing: 9 weights, their rates, 4 lag states and 2 of the gust's entry."""
        return cc.wing_model(
            self.wing,
            density=DENSITY,
            lag=cc.IndicialLag(poles=2, modes=2),
            gust=cc.GustEntry(kind="kussner", modes=1),
            damping=DAMPING,
            outputs=["curvature"],
            stations=[0.0],
        )

    @cached_property
    def trim(self) -> Array:
        """The state (24,) of steady flight without gust, by Newton's method."""
        model, x = self.plant, np.zeros(self.plant.x.size)
        for _ in range(20):
            A, _, _ = self._slopes(x)
            step = np.linalg.solve(A, model.xdot(x, [0, 0], self.still).full().ravel())
            x = x - step
            if np.abs(step).max() < 1e-12:
                return x
        raise RuntimeError("trim: Newton's method does not converge")

    @property
    def still(self) -> Array:
        """Parameters without gust."""
        return np.array([AIRSPEED, PITCH, 0.0])

    def _slopes(self, x: Array) -> tuple[Array, Array, Array]:
        """Derivatives of the rates by state, inputs and gust."""
        slopes = self._jacobian(x, [0, 0], self.still, 0)
        A, B, P = (block.full() for block in slopes)
        return A, B, P[:, 2:]

    @cached_property
    def _jacobian(self) -> ca.Function:
        return self.plant.xdot.jacobian()

    @cached_property
    def linear(self) -> tuple[Array, Array, Array]:
        """A (24, 24), B (24, 2) and G (24, 1) of the rates about `trim`."""
        return self._slopes(self.trim)

    @cached_property
    def filter(self) -> Any:
        """Filter on the linear model; the gust is estimated."""
        T, blocks = self.modes
        A, B, G = self.linear
        x, u, p = ca.MX.sym("x", 24), ca.MX.sym("u", 2), ca.MX.sym("p", 1)
        rest = ca.DM(np.linalg.solve(A, B)) @ u + ca.DM(np.linalg.solve(A, G)) @ p
        rate = ca.DM(T @ blocks @ np.linalg.inv(T)) @ (x - self.trim + rest)
        names = ["x", "u", "p"]
        model = cc.ControlModel(
            name="linear",
            x=self.plant.x,
            u=self.plant.u,
            p=cc.Layout((cc.Part("gust", 1, "m/s", nominal=0.0),)),
            y=cc.Layout(()),
            xdot=ca.Function("linear_xdot", [x, u, p], [rate], names, ["xdot"]),
            output=ca.Function("linear_output", [x, u, p], [ca.MX(0, 1)], names, ["y"]),
            real=self.real,
        )
        process = cc.ModelProcess(model=model, density=NOISE, estimated={"gust": GUST_TIME})
        return cc.shape_ekf(self.wing.beam, SENSORS, process=process, root=ROOT)

    @cached_property
    def start(self) -> Any:
        """What the filter begins with."""
        values = self.plant.x.split(self.trim)
        return self.filter.initial(DEVIATION, {k: v.full() for k, v in values.items()})

    @cached_property
    def modes(self) -> tuple[Array, Array]:
        """Real eigenvectors T (24, 24) of A, and rates of their coordinates, in blocks of 2 rows.

        With the rates Z of the blocks one Runge–Kutta step is the exact motion over a period:
        R(Z h) = exp(A h), R(z) = 1 + z + z²/2 + z³/6 + z⁴/24. With held inputs, x deviates from
        where they keep it, x* = −A⁻¹ B u, by the same factor: dx/dt = Z (x − x*).
        """
        values, vectors = np.linalg.eig(self.linear[0])
        columns: list[Array] = []
        blocks = np.zeros((24, 24))
        for value, vector in zip(values, vectors.T, strict=True):
            if value.imag < 0:
                continue
            k, rate = len(columns), _rate(value)
            if value.imag > 0:
                columns += [vector.real, vector.imag]
                blocks[k : k + 2, k : k + 2] = [[rate.real, rate.imag], [-rate.imag, rate.real]]
            else:
                columns.append(vector.real)
                blocks[k, k] = rate.real
        return np.column_stack(columns), blocks

    @cached_property
    def controller(self) -> cc.Mpc:
        """Keeps the bending of the root where it is in steady flight."""
        T, blocks = self.modes
        A, B, G = self.linear
        bending = np.zeros((1, 24))
        bending[0, :9] = self.wing.beam.basis(0.0)[1]
        z, u, p = ca.SX.sym("z", 24), ca.SX.sym("u", 2), ca.SX.sym("p", 1)
        still = [ca.DM(np.linalg.solve(A @ T, of)) for of in (B, G)]
        rate = ca.sparsify(ca.DM(blocks)) @ (z + still[0] @ u + still[1] @ p)
        names = ["x", "u", "p"]
        model = cc.ControlModel(
            name="modal",
            x=cc.Layout((cc.Part("modes", 24, "1"),)),
            u=self.plant.u,
            p=cc.Layout((cc.Part("gust", 1, "m/s", nominal=0.0),)),
            y=cc.Layout((cc.Part("bending", 1, "rad/m"),)),
            xdot=ca.Function("modal_xdot", [z, u, p], [rate], names, ["xdot"]),
            output=ca.Function("modal_output", [z, u, p], [ca.DM(bending @ T) @ z], names, ["y"]),
            real=self.real,
        )
        flaps = ("inner", "outer")
        return cc.Mpc(
            model,
            dt=PERIOD,
            horizon=STAGES,
            outputs={"bending": 1e6},
            inputs=dict.fromkeys(flaps, 0.1),
            moves=dict.fromkeys(flaps, 100.0),
            bounds=dict.fromkeys(flaps, (-LARGEST, LARGEST)),
            blocks=BLOCKS,
        )

    @cached_property
    def deviation(self) -> ca.Function:
        """Coordinates of the controller, and the gust at every stage, from the filter's state."""
        state = ca.MX.sym("state", self.filter.layout.size)
        parts = self.filter.layout.split(state)
        x = ca.vertcat(*(parts[part.name] for part in self.plant.x.parts))
        z = ca.DM(np.linalg.inv(self.modes[0])) @ (x - self.trim)
        gust = ca.repmat(parts["gust"], 1, STAGES)
        return ca.Function("deviation", [state], [z, gust], ["state"], ["x", "p"])

    @property
    def functions(self) -> list[Any]:
        """What becomes C."""
        ekf = self.filter
        return [
            self.controller,
            cc.CFunction(function=ekf.predict, descriptions=ekf.descriptions["predict"]),
            cc.CFunction(
                function=ekf.update,
                descriptions=ekf.descriptions["update"],
                missing=("measured",),
            ),
            self.deviation,
        ]

    @property
    def examples(self) -> dict[str, list[Any]]:
        """Inputs for the self-test of the C."""
        at, z = (self.start.state, self.start.factor), np.zeros(len(self.filter.channels.noise))
        return {
            "ekf_predict": [(*at, PERIOD, [0.0, 0.0])],
            "ekf_update": [(*at, z, [0.0, 0.0])],
            "deviation": [(self.start.state,)],
        }


def _rate(value: complex) -> complex:
    """The z/h nearest to an eigenvalue with R(z) = exp(value h); see `Case.modes`."""
    roots = np.roots([1 / 24, 1 / 6, 1 / 2, 1, 1 - np.exp(value * PERIOD)]) / PERIOD
    if value.imag == 0:
        roots = roots[np.abs(roots.imag) < 1e-9 * np.abs(roots)]
    return complex(roots[np.argmin(np.abs(roots - value))])
