"""What became of the samples of a log, and what their innovations say of a filter."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from curvcasadi.sensors import Channels
from curvcasadi.symbolic.expressions import Array

#: Innovations of a filter that fits: mean square, and the largest part that is gated.
FITTING, FEW = (0.5, 2.0), 0.02


@dataclass(frozen=True, eq=False)
class Tally:
    """What became of the samples, for each residual of the sensors."""

    channels: Channels
    needs: Array  #: (r, m): 1 where a residual needs a value
    rows: Array  #: samples that could have been there
    seen: Array  #: of these, those that were
    used: Array  #: of these, those that were not gated
    squares: Array  #: sums of the squared normalized innovations of those used

    @staticmethod
    def of(channels: Channels) -> Tally:
        """One of nothing."""
        from scipy.linalg import block_diag

        blocks = [
            np.eye(values.size) if values.size == residuals.size else np.ones((3, 9))
            for values, residuals in zip(
                channels.layout.parts, channels.residual_layout.parts, strict=True
            )
        ]
        return Tally(channels, block_diag(*blocks), *np.zeros((4, len(channels.noise))))

    def add(self, measured: Array, innovation: Array, used: Array) -> None:
        """Count a row in."""
        self.rows[:] += 1
        self.seen[:] += self.needs @ np.isnan(measured) == 0
        self.used[:] += used
        self.squares[:] += np.where(used, innovation, 0) ** 2

    @property
    def sums(self) -> dict[str, tuple[int, int, int, float]]:
        """Rows, seen, used and squares by sensor."""
        counts = np.array([self.rows, self.seen, self.used, self.squares])
        found = {}
        for name, where in self.channels.residual_layout.slices.items():
            rows, seen, used, squares = counts[:, where].sum(axis=1).tolist()
            found[name] = int(rows), int(seen), int(used), float(squares)
        return found


def summary(tally: Tally, samples: int, seconds: float) -> str:
    """Table of the sensors, and sentences on what is not as it should be."""
    sums = tally.sums
    total = tuple(map(sum, zip(*sums.values(), strict=True)))
    width = max(len("sensor"), *map(len, sums))
    lines = [
        f"{samples} samples of {seconds:.6g} s",
        f"{'sensor':<{width}}"
        + "".join(f" {name:>9}" for name in ("values", "missing", "gated", "used", "mean NIS")),
    ]
    for name, (rows, seen, used, squares) in {**sums, "all": total}.items():
        nis = f"{squares / used:9.3f}" if used else f"{'-':>9}"
        lines.append(f"{name:<{width}} {rows:9} {rows - seen:9} {seen - used:9} {used:9} {nis}")
    lines.append("NIS: squared innovation over its variance, of the values used; 1 is expected")
    return "\n".join([*lines, *_verdicts(tally, total)])


def _verdicts(tally: Tally, total: tuple[float, ...]) -> Iterator[str]:
    _, seen, used, squares = total
    if not seen:
        yield "no sensor has a value: the estimate is a prediction from the start"
        return
    units = {part.name: part.unit for part in tally.channels.layout.parts}
    for name, (_, there, taken, _) in tally.sums.items():
        if there - taken > FEW * there:
            yield (
                f"{name}: {(there - taken) / there:.1%} of its values are gated, too far from what "
                f"the filter expects: check its unit ({units[name]}), mounting, bias and noise"
            )
    mean = squares / used if used else 0.0
    if mean > FITTING[1]:
        yield (
            f"mean NIS {mean:.2f}, far above 1: innovations are larger than the filter expects: "
            "check units, mountings and gravity, or raise noise or density"
        )
    elif used and mean < FITTING[0]:
        yield (
            f"mean NIS {mean:.2f}, far below 1: innovations are smaller than the filter expects: "
            "noise, density, rate or acceleration of the wing file may be lower"
        )
