"""Time columns of logs, in any unit that their name says."""

from __future__ import annotations

from collections.abc import Sequence

#: Seconds of each unit.
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: Names of time columns, and their units; `time` itself is in s.
TIME_COLUMNS = {
    "time": "s",
    **{f"{name}_{unit}": unit for name in ("time", "timestamp") for unit in UNITS},
    **{f"{name} [{unit}]": unit for name in ("time", "timestamp") for unit in UNITS},
}
#: No clock shows so many seconds, nor do those since 1970; milliseconds since then are more.
LARGEST = 1e11
#: Whole steps from here on are likely no seconds.
LONG_STEP = 2.0


def time_column(present: Sequence[str]) -> str:
    """The name of the time column of a log; `time` where there is none."""
    return next((name for name in present if name in TIME_COLUMNS), "time")


def seconds(column: str) -> float:
    """Seconds of the unit of a time column."""
    return UNITS[TIME_COLUMNS[column]]


def unit_of(column: str) -> str:
    """Its unit."""
    return TIME_COLUMNS[column]


def doubt(column: str, before: float, time: float) -> str:
    """What speaks against seconds, from the first two times of a log; or nothing."""
    names = "name the column time_ms, time_us or time_ns if it has that unit"
    step = time - before
    if column in ("time", "time_s") and step >= LONG_STEP and step == round(step):
        return f"column {column}: the first step of {step:g} is taken as seconds; {names}"
    return ""


def impossible(column: str, time: float) -> str:
    """Why a time cannot be one in seconds; or nothing."""
    if time * seconds(column) < LARGEST:
        return ""
    likely = next(u for u in (*[*UNITS][1:], "ns") if time * UNITS[u] < LARGEST or u == "ns")
    return (
        f"expected a time in {unit_of(column)}, found {time:g}, which looks like {likely} since "
        f"1970: name the column time_{likely}"
    )
