"""A shape filter along a stream of rows: one Function for each, called in memory that stays."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from curvcasadi.beam.beam import Beam
from curvcasadi.estimation.ekf.filter import Estimate, ShapeEkf
from curvcasadi.sensors import Marker, measurement_function
from curvcasadi.symbolic.expressions import Array, instance

#: What a row does not show: the attitude of the parent is known better by who uses it; counters
#: have no error.
_HIDDEN = ("attitude", "rejections")


class Point(NamedTuple):
    """A point of the reference curve that rows show."""

    name: str  #: begins its columns
    xi: float  #: station s/L


class RowFunction(NamedTuple):
    """Prediction, update, and what is shown of the estimate."""

    function: ca.Function
    columns: tuple[str, ...]  #: names of the entries of its output `shown`


def row_function(ekf: ShapeEkf, points: Sequence[Point]) -> RowFunction:
    """(state, factor, measured, dt, other inputs of the filter) -> state_after, factor_after, shown
    (k, 1), innovation, used.

    shown: the weights q0 … and their standard deviations, the same of rates and biases where the
    state holds them, and for every point its position, m, parent axes, and standard deviations,
    those of J P Jᵀ with J the derivative of the position by q.
    """
    inputs: dict[str, ca.MX] = {}
    for f in (ekf.predict, ekf.update):
        for key in f.name_in():
            inputs.setdefault(key, ca.MX.sym(key, f.sparsity_in(key)))
    dt = inputs.pop("dt")
    inputs["dt"] = dt
    given = {key: inputs[key] for key in ekf.predict.name_in()}
    predicted = ekf.predict(**given)
    given = {key: inputs[key] for key in ekf.update.name_in()}
    given |= {"state": predicted["state_after"], "factor": predicted["factor_after"]}
    found = ekf.update(**given)
    columns, shown = _shown(ekf, found["state_after"], found["factor_after"], points)
    outputs = {key: found[key] for key in ("state_after", "factor_after")}
    outputs |= {"shown": shown} | {key: found[key] for key in ("innovation", "used")}
    function = ca.Function(
        "estimate_row", [*inputs.values()], [*outputs.values()], [*inputs], [*outputs]
    )
    return RowFunction(function, columns)


def _shown(
    ekf: ShapeEkf, state: ca.MX, factor: ca.MX, points: Sequence[Point]
) -> tuple[tuple[str, ...], ca.MX]:
    size = ekf.error_layout.size
    d, unit = ca.diag(factor), ca.triu(ca.densify(factor), False) + ca.DM.eye(size)
    of_state, of_error = ekf.layout.slices, ekf.error_layout.slices
    columns: list[str] = []
    shown: list[ca.MX] = []

    def show(names: Sequence[str], values: ca.MX, rows: ca.MX) -> None:
        columns.extend((*names, *(f"std_{name}" for name in names)))
        shown.extend((values, ca.sqrt(rows**2 @ d)))

    for part in ekf.layout.parts:
        if part.name not in _HIDDEN:
            names = _names(part.name, part.size)
            show(names, state[of_state[part.name]], unit[of_error[part.name], :])
    beam = instance("ekf.beam", ekf.beam, Beam)
    positions, slopes = _positions(beam, state[of_state["q"]], [p.xi for p in points])
    names = [f"{point.name}_{axis}" for point in points for axis in "xyz"]
    for k in range(0, len(names), 3):
        show(names[k : k + 3], positions[k : k + 3], slopes[k : k + 3, :] @ unit[of_error["q"], :])
    return tuple(columns), ca.vertcat(*shown)


def _names(part: str, size: int) -> list[str]:
    if part in ("q", "q_dot"):
        return [f"{part}{k}" for k in range(size)]
    return [f"{part}{k // 3 + 1}_{'xyz'[k % 3]}" for k in range(size)]


def _positions(beam: Beam, q: ca.MX, stations: Sequence[float]) -> tuple[ca.MX, ca.MX]:
    """Positions (3 M, 1), m, parent axes, and their derivative by q."""
    markers = [Marker(xi=xi, noise=1.0) for xi in stations]
    f = measurement_function("points", markers, beam, ["q"])
    found = f(q=q, measured=np.zeros(3 * len(markers)))
    return found["values"], found["residual_q"]


def compiled(function: ca.Function) -> ca.Function:
    """The same Function as machine code, by gcc.

    Raises
    ------
    ValueError
        If there is no gcc.
    """
    if shutil.which("gcc") is None:
        raise ValueError("--compile: expected gcc on the PATH, found none; Debian: apt install gcc")
    symbols = function.mx_in()
    inputs, outputs = function.name_in(), function.name_out()
    with tempfile.TemporaryDirectory() as folder:
        options: dict[str, Any] = {
            "jit": True,
            "compiler": "shell",
            "jit_cleanup": False,  # the folder goes as a whole
            "jit_options": {"flags": ["-O2"], "directory": f"{folder}/", "cleanup": False},
        }
        called = function.call(symbols)
        return ca.Function(f"{function.name()}_c", symbols, called, inputs, outputs, options)


class RowStepper:
    """Calls a `RowFunction` row after row, in memory that stays where it is."""

    def __init__(self, function: ca.Function, start: Estimate) -> None:
        self.shown, self.innovation, self.used = (
            np.zeros(function.size1_out(key)) for key in ("shown", "innovation", "used")
        )
        buffer: Any
        buffer, self._call = function.buffer()
        self._buffer = buffer  # lives as long as its memory is called
        self._given = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self.inputs = dict(zip(function.name_in()[2:], self._given[2:], strict=True))
        self._after = [np.zeros(function.nnz_out(k)) for k in range(2)]
        outputs = (*self._after, self.shown, self.innovation, self.used)
        for k, values in enumerate(self._given):
            buffer.set_arg(k, values.data)
        for k, values in enumerate(outputs):
            buffer.set_res(k, values.data)
        factor = ca.project(ca.DM(start.factor), function.sparsity_in("factor"))
        self._given[0][:], self._given[1][:] = start.state, factor.nonzeros()

    def step(self) -> None:
        """From `inputs` and the state before to `shown`, `innovation` and `used`."""
        self._call()
        for given, after in zip(self._given[:2], self._after, strict=True):
            given[:] = after


class History:
    """Every k-th of the rows: when they are more than `most`, an even number, k doubles."""

    def __init__(self, columns: Sequence[str], most: int) -> None:
        self._columns = ("time", *columns)
        self._rows = np.empty((most, len(self._columns)))
        self._kept, self._count, self._stride = 0, 0, 1

    def add(self, time: float, shown: Array) -> None:
        """Keep a row, or not."""
        if self._count % self._stride == 0:
            if self._kept == len(self._rows):
                self._kept = self._kept // 2
                self._rows[: self._kept] = self._rows[::2]
                self._stride *= 2
            self._rows[self._kept, 0], self._rows[self._kept, 1:] = time, shown
            self._kept += 1
        self._count += 1

    @property
    def series(self) -> dict[str, Array]:
        """What is kept, by column."""
        return dict(zip(self._columns, self._rows[: self._kept].T, strict=True))
