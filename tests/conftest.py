"""What the tests share: kinds of expression, the test wing, published cases."""

from __future__ import annotations

import json
from pathlib import Path

import casadi as ca
import pytest

import curvcasadi as cc
from tests.support.oracle import WING_LENGTH

REFERENCE = Path(__file__).parent / "reference"


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


@pytest.fixture
def published():
    """Maker of a published case by the beginning of its file name."""

    def read(prefix):
        (path,) = REFERENCE.glob(f"{prefix}*.json")
        return json.loads(path.read_text())

    return read
