"""A filter on its way along a log: rows in, lines of estimates out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from curvcasadi.estimation.ekf.consistency import Tally
from curvcasadi.estimation.ekf.stream import History, RowStepper
from curvcasadi.files.estimation import INPUT_COLUMNS, EstimationFile
from curvcasadi.files.log import LogRow
from curvcasadi.symbolic.expressions import Array, rotation_matrix

MOST_SAMPLES = 2000  #: that a figure keeps


class LogFilter:
    """A filter on its way along a log."""

    def __init__(
        self,
        log: Path,
        wing: EstimationFile,
        stepper: RowStepper,
        columns: Sequence[str],
        first: LogRow,
    ) -> None:
        self.time = first.time
        self.count = self.outside = 0
        self.left = ""  #: where weights were first outside their bounds, in words
        self.history = History(columns, MOST_SAMPLES)
        self._log, self._wing, self._stepper = log, wing, stepper
        self.tally = Tally.of(wing.ekf.channels)
        names = wing.columns.inputs
        self._known = np.full(len(names), np.nan)
        self._places = {key: [names.index(n) for n in INPUT_COLUMNS[key]] for key in wing.inputs}
        self._attitudes = _attitudes(wing)
        self._form = ",".join(["%.9g"] * len(columns))
        self._lower, self._upper = wing.beam.bounds

    def step(self, row: LogRow) -> str:
        """The line of the output."""
        stepper, values = self._stepper, np.array(row.values)
        for where in self._attitudes:
            values[where] = self._attitude(row, where, values[where])
        if self._known.size:
            self._know(row, values[: self._known.size])
            values = values[self._known.size :]
        stepper.inputs["measured"][:] = values
        stepper.inputs["dt"][:] = row.time - self.time
        stepper.step()
        if not np.isfinite(stepper.shown).all():
            since = f"; weights left weight_bounds {self.left}" if self.outside else ""
            raise ValueError(
                f"{self._log}: line {row.line}: expected an estimate, found one that is no "
                f"number{since}: check the units of the log, time in s, and noise, density and "
                "deviation"
            )
        q = stepper.shown[: self._lower.size]
        if (q < self._lower).any() or (q > self._upper).any():
            if not self.outside:
                self.left = f"in line {row.line}, {row.time - self.time:g} s after the one before"
            self.outside += 1
        self.time = row.time
        self.count += 1
        self.tally.add(values, stepper.innovation, stepper.used)
        self.history.add(row.time, stepper.shown)
        return f"{row.time!r},{self._form % (*stepper.shown,)}"

    def _attitude(self, row: LogRow, where: slice, entries: Array) -> Array:
        """The rotation, by columns, that `entries` of a few digits mean; NaN where missing."""
        if np.isnan(entries).any():
            return entries
        names = [*self._wing.columns.inputs, *self._wing.columns.values][where]
        name = f"{self._log}: line {row.line}, columns {names[0]} to {names[-1]} of a rotation"
        rotation = rotation_matrix(name, entries.reshape(3, 3, order="F"))
        return np.asarray(rotation.full().ravel(order="F"))

    def _know(self, row: LogRow, given: Array) -> None:
        """Motion of the root keeps its last value."""
        np.copyto(self._known, given, where=~np.isnan(given))
        if np.isnan(self._known).any():
            column = self._wing.columns.inputs[int(np.isnan(self._known).argmax())]
            raise ValueError(
                f"{self._log}: line {row.line}, column {column}: expected a number in the first "
                "sample, as motion of the root keeps its last value; found a missing one"
            )
        for key, places in self._places.items():
            self._stepper.inputs[key][:] = self._known[places]


def _attitudes(wing: EstimationFile) -> list[slice]:
    """Where rows of a log hold the nine entries of rotation matrices."""
    names = [*wing.columns.inputs, *wing.columns.values]
    return [slice(k, k + 9) for k, name in enumerate(names) if name.endswith("R_xx")]
