"""Published case D21: a held airfoil in a 1-cosine gust, against Küssner's function.

Rows of `reference/D21_gust_1cos_airfoil.json`: Duhamel's integral of Küssner's function by R. T.
Jones, and RANS results of M. Mallik and D. E. Raveh, AIAA J. 57(8), 2019.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.special import jv, kv

import curvcasadi as cc
from curvcasadi.aero.section import SectionData, circulation, circulatory_wrench, gust_velocity

SPEED, HALF_CHORD, GUST = 68.06, 0.40663, 2.3748
CASES = {"H_pi": np.pi, "H_8pi": 8 * np.pi}
SECTION = SectionData(
    upper=1.0,
    pressure=HALF_CHORD,  # ½ ρ c of a density of one
    chord=2 * HALF_CHORD,
    center=HALF_CHORD / 2,
    slope=2 * np.pi,
    shift=0.0,
    drag=0.0,
    moment=0.0,
    moment_slope=0.0,
    suction=1.0,
    apparent=1.0,
)


def lift(s, half_length, entry, lag=None, amplitude=GUST):
    """Lift coefficient at `s` half chords of a gust of 2 `half_length`, by the entry states."""
    gust = cc.OneMinusCosine(amplitude=amplitude, duration=2 * half_length * HALF_CHORD / SPEED)
    velocity, still = ca.DM([0, SPEED, 0]), ca.DM.zeros(3)
    time, poles = ca.SX.sym("t"), entry.poles
    u_g = gust_velocity(velocity, still, ca.vertcat(0, 0, gust(time)), SECTION)
    amplitudes, rates = poles
    if lag is not None:
        amplitudes, rates = np.append(0, lag.amplitudes), np.append(rates, lag.rates)
    x = ca.SX.sym("x", len(rates))
    # Küssner's states follow the gust; those of the circulation, what the entry lag lets through.
    follows = u_g if lag is None else ca.vertcat(u_g, ca.repmat(x[0], lag.poles, 1))
    rate = rates * SPEED / HALF_CHORD * (follows - x)
    gained = ca.dot(amplitudes, x) + (0 if lag is None else (1 - sum(lag.amplitudes)) * x[0])
    u = circulation(velocity, still, SECTION).velocity
    force = circulatory_wrench(velocity, still, SECTION, u, u + gained)[5]
    motion = ca.Function("motion", [time, x], [rate, force / (HALF_CHORD * SPEED**2)])
    state, now, found = np.zeros(len(rates)), 0.0, []
    for end in np.asarray(s) * HALF_CHORD / SPEED:
        for stop in sorted({min(max(gust.duration, now), end), end}):
            if stop > now:
                run = solve_ivp(
                    lambda t, y: motion(t, y)[0].full().ravel(),
                    (now, stop),
                    state,
                    rtol=1e-8,
                    atol=1e-9 * amplitude,
                )
                state, now = run.y[:, -1], stop
        found.append(float(motion(now, state)[1]))
    return np.array(found)


@pytest.mark.parametrize("case", CASES)
def test_two_states_at_the_leading_edge_are_kussners_function(case, published):
    rows = np.array(
        published("D21")["reference"]["Kussner_COMPUTED_incompressible"][case]["[s,dcl]"]
    )
    entry = cc.GustEntry(kind="kussner")
    # Küssner's theory is linear: a thousandth of the gust. Six decimals are published.
    small = lift(rows[:, 0], CASES[case], entry, amplitude=1e-3 * GUST)
    assert_allclose(1e3 * small, rows[:, 1], atol=1e-6)
    # At an angle of 2 degrees W atan(w/V) is 2e-4 above w: 4e-5 of the lift coefficient.
    assert_allclose(lift(rows[:, 0], CASES[case], entry), rows[:, 1], atol=1e-4)


def test_one_entry_lag_before_the_wagner_states_meets_the_peak(published):
    row = published("D21")["reference"]["Kussner_COMPUTED_incompressible"]["H_pi"]
    s = row["at_s"] + np.linspace(-0.3, 0.3, 13)
    found = lift(s, np.pi, cc.GustEntry(kind="lag"), cc.IndicialLag(poles=3))
    assert_allclose(found.max(), row["peak"], rtol=5e-3)


def sears_lift(s, half_length):
    """Lift coefficient by the exact transfer function of a gust that enters the leading edge."""
    length, n = 2000.0, 2**15
    grid = np.arange(n) * length / n
    gust = np.where(grid <= 2 * half_length, GUST / 2 * (1 - np.cos(np.pi * grid / half_length)), 0)
    k = 2 * np.pi * np.arange(1, n // 2 + 1) / length
    theodorsen = kv(1, 1j * k) / (kv(0, 1j * k) + kv(1, 1j * k))
    sears = (jv(0, k) - 1j * jv(1, k)) * theodorsen + 1j * jv(1, k)
    transfer = np.append(1, sears * np.exp(-1j * k))
    found = np.fft.irfft(transfer * np.fft.rfft(gust), n)
    return np.interp(s, grid, 2 * np.pi / SPEED * found)


def test_in_a_long_gust_the_entry_lag_is_nearer_to_the_exact_lift_than_kussners_two_poles():
    s = np.linspace(24, 31, 29)
    exact = sears_lift(s, 8 * np.pi).max()
    lagged = lift(s, 8 * np.pi, cc.GustEntry(kind="lag"), cc.IndicialLag(poles=3)).max()
    two_poles = lift(s, 8 * np.pi, cc.GustEntry(kind="kussner")).max()
    assert abs(lagged / exact - 1) < 0.01 < 0.02 < abs(two_poles / exact - 1)


@pytest.mark.parametrize(("case", "limit"), [("H_pi", 0.12), ("H_8pi", 0.03)])
def test_peak_is_near_that_of_the_flow_solver(case, limit, published):
    rows = published("D21")["reference"][f"CFD_{case}"]
    s = np.linspace(0.85, 1.15, 31) * rows["at_s"]
    found = lift(s, CASES[case], cc.GustEntry(kind="kussner"))
    assert_allclose(found.max(), rows["peak"], rtol=limit)


def test_a_gust_on_the_whole_chord_at_once_misses_the_peak(published):
    row = published("D21")["reference"]["Kussner_COMPUTED_incompressible"]["H_pi"]
    s = np.linspace(0.5, 1.1, 25) * row["at_s"]
    lag, half = cc.IndicialLag(poles=3), HALF_CHORD
    gust = cc.OneMinusCosine(amplitude=GUST, duration=2 * np.pi * half / SPEED)

    def rate(t, x):
        return lag.rates * SPEED / half * (float(gust(t)) - x)

    run = solve_ivp(rate, (0, s[-1] * half / SPEED), np.zeros(3), t_eval=s * half / SPEED)
    found = [0.5 * float(gust(t)) + lag.amplitudes @ x for t, x in zip(run.t, run.y.T, strict=True)]
    assert 2 * np.pi / SPEED * np.max(found) > 1.1 * row["peak"]
