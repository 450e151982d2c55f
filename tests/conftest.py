"""What the tests share: kinds of expression, the test wing, published cases."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import casadi as ca
import pytest

import curvcasadi as cc
from tests.support.oracle import WING_LENGTH

#: What `make quick` leaves out, relative to this folder: tests that solve, compile or draw.
SLOW = {
    "aircraft",
    "cli",
    "codegen",
    "control",
    "dynamics",
    "estimation/test_ekf.py",
    "estimation/test_ekf_export.py",
    "estimation/test_fit.py",
    "estimation/test_mhe.py",
    "estimation/test_model_mhe.py",
    "estimation/test_model_ekf.py",
    "estimation/test_placement.py",
    "export",
    "ocp",
    "plotting",
    "published",
    "claims/test_examples.py",
    "claims/test_docs.py",
    "claims/test_typing.py",
    "kinematics/test_resolution.py",
    "sensors/test_sensors.py",
    "symbolic/test_compiled.py",
    "statics/test_equilibrium.py",
    "solvers/test_qp.py",
    "solvers/test_gauss_newton.py",
    "files/test_study.py",
    "symbolic/test_batch.py",
    "symbolic/test_sweep.py",
}
TESTS = Path(__file__).parent
REFERENCE = Path(__file__).parent / "reference"


def pytest_collection_modifyitems(items):
    for item in items:
        place = item.path.relative_to(TESTS)
        if SLOW & {place.parts[0], place.as_posix()}:
            item.add_marker(pytest.mark.slow)


def _name(kind):
    return kind.__name__


@pytest.fixture(params=[ca.SX, ca.MX, ca.DM], ids=_name)
def kind(request):
    """SX, MX and DM."""
    return request.param


@pytest.fixture(params=[ca.SX, ca.MX], ids=_name)
def symbolic(request):
    """SX and MX."""
    return request.param


@pytest.fixture
def evaluate(kind):
    """f(*arguments) computed with expressions of `kind`, as an array."""

    def run(f, *arguments):
        values = [ca.DM(argument) for argument in arguments]
        if kind is ca.DM:
            result = f(*values)
            assert isinstance(result, ca.DM)
            return result.full()
        symbols = [kind.sym(f"a{i}", *value.shape) for i, value in enumerate(values)]
        result = f(*symbols)
        assert isinstance(result, kind)
        return ca.Function("f", symbols, [result])(*values).full()

    return run


@pytest.fixture
def wing():
    """Maker of the test wing: 16 m, four Legendre functions a channel; fields can be replaced."""

    def make(elements=16, rule="magnus4", *, kind="uniform", exponential="series", **fields):
        grid = getattr(cc.Grid, kind)(elements, rule=rule, exponential=exponential, max_angle=1.5)
        basis = cc.ChannelBasis(
            torsion=cc.Legendre(4), out_of_plane=cc.Legendre(4), in_plane=cc.Legendre(4)
        )
        return cc.Beam(**{"length": WING_LENGTH, "basis": basis, "grid": grid, **fields})

    return make


@pytest.fixture(scope="session")
def published():
    """Maker of a published case by the beginning of its file name."""

    def read(prefix):
        (path,) = REFERENCE.glob(f"{prefix}*.json")
        return json.loads(path.read_text())

    return read


@pytest.fixture
def terminal(capsys, monkeypatch):
    """Commands take standard error for a terminal, and so show their progress."""
    monkeypatch.setattr(type(sys.stderr), "isatty", lambda _: True)
