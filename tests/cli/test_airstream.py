"""`curvcasadi equilibrium` of a wing in an airstream that its file describes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.cli.main import main

HALE_WING = Path(__file__).parents[2] / "ocp_examples" / "hale_wing_loaded.toml"
AIR = """
[aerodynamics]
chord = 1.0
aerodynamic_center = 0.25
lift_slope = 6.283185307179586
zero_lift_angle = -0.03
[airstream]
density = 0.0889
velocity = [20.0, 0, 0]
"""


@pytest.fixture
def wing(tmp_path):
    path = tmp_path / "wing.toml"
    path.write_text(HALE_WING.read_text() + AIR)
    return path


def test_airloads_of_the_file_bend_the_wing(wing, capsys):
    assert main(["equilibrium", str(wing)]) == 0
    line = next(x for x in capsys.readouterr().out.splitlines() if x.startswith("weights"))
    weights = np.array([float(x) for x in line.split()[1].split(",")])
    plain = cc.load_wing(HALE_WING)
    strips = cc.StripAerodynamics(
        chord=1.0, aerodynamic_center=0.25, lift_slope=2 * np.pi, zero_lift_angle=-0.03
    )
    flow = cc.Flow(density=0.0889, velocity=(20.0, 0, 0))
    loads = [*plain.loads, cc.AerodynamicLoad(strips=strips, flow=flow)]
    expected = cc.solve_equilibrium(plain.beam, loads).q.full().ravel()
    # Nine digits are printed.
    np.testing.assert_allclose(weights, expected, rtol=1e-8, atol=1e-12)
    without = cc.solve_equilibrium(plain.beam, plain.loads).q.full().ravel()
    assert np.max(np.abs(expected - without)) > 1e-4


def test_an_airstream_without_airfoil_data_is_refused(wing, capsys):
    wing.write_text(HALE_WING.read_text() + AIR[AIR.index("[airstream]") :])
    assert main(["equilibrium", str(wing)]) == 2
    assert "airstream: expected a table [aerodynamics] beside it" in capsys.readouterr().err
