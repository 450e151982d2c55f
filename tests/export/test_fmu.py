"""Functional mock-up units against `simulate`; FMPy checks and runs them."""

import zipfile
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic.compiled import compile_c
from tests.support import models
from tests.support.wing import light_wing

fmpy = pytest.importorskip("fmpy", reason="fmpy, of the extra test")
validation = pytest.importorskip("fmpy.validation")

TIMES = np.linspace(0, 0.5, 11)
FORCE = 20.0


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory):
    """A body with an attitude, an input, a parameter and a lag state, and its FMU."""
    model = models.pendulum(stiffness=100.0, damping=0.2)
    start = {"configuration": [1.0, 0.02], "rates": [-0.5, 0.1], "lag": [0.3]}
    path = tmp_path_factory.mktemp("fmu") / "pendulum.fmu"
    cc.export_fmu(model, path, dt=0.005, x0=start, u=[0.4], p=[9.81], inputs=["gravity"])
    return SimpleNamespace(model=model, start=start, path=path)
