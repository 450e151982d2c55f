"""Quantities along the span: tables, functions with breaks, numbers and symbols."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.beam.along import Along, mapped, scalar


def test_steps_take_the_value_of_their_interval():
    steps = cc.Steps([0, 0.25, 0.5, 1], [1, [2], "three"])
    assert [steps(x) for x in (0, 0.2, 0.25, 0.3, 0.5, 1)] == [1, 1, [2], [2], "three", "three"]
    assert steps.breaks == (0.25, 0.5)


def test_a_table_with_a_value_per_interval_is_constant_between_stations():
    table = cc.Piecewise([0, 0.25, 1], [1.0, 2.0])
    assert [table(x) for x in (0, 0.2, 0.25, 1)] == [1, 1, 2, 2]
    assert not table.linear


def test_a_table_with_a_value_per_station_is_linear_between_them():
    table = cc.Piecewise([0, 0.25, 1], [[1.0, 0.0], [3.0, 1.0], [0.0, 4.0]])
    assert table.linear
    assert table.breaks == (0.25,)
    for xi in np.linspace(0, 1, 13):
        expected = [np.interp(xi, [0, 0.25, 1], column) for column in ([1, 3, 0], [0, 1, 4])]
        assert_allclose(table(xi), expected, atol=1e-15)  # rounding


def test_a_linear_table_may_hold_symbols(symbolic):
    tip = symbolic.sym("tip")
    value = cc.Piecewise([0, 1], [2.0, tip])(0.75)
    assert float(ca.Function("f", [tip], [value])(6)) == 5


def test_a_station_that_stands_twice_is_a_jump_of_a_linear_table():
    table = cc.Piecewise([0, 0.5, 0.5, 1], [1.0, 2.0, 10.0, 20.0])
    assert table.breaks == (0.5,)
    assert_allclose([table(x) for x in (0, 0.25, np.nextafter(0.5, 0), 0.5, 0.75, 1)],
                    [1, 1.5, 2, 10, 15, 20], rtol=1e-15)  # fmt: skip


@pytest.mark.parametrize(
    ("xi", "values", "message"),
    [
        (
            [0, 0.5],
            [1.0],
            r"xi: expected increasing stations that cover 0 to 1, found \[0\.0, 0\.5",
        ),
        ([0.1, 1], [1.0], r"xi: .*cover 0 to 1"),
        ([0, 0.6, 0.4, 1], [1, 2, 3], r"xi: expected increasing"),
        ([0, 0.5, 0.5, 1], [1, 2, 3], r"xi: expected increasing"),  # constant: a jump is one
        ([0, 0.5, 0.5, 0.5, 1], [1, 2, 3, 4, 5], r"xi: expected increasing"),
        ([0, 0, 1], [1, 2, 3], r"xi: expected increasing"),
        ([0, 0.5, 1], [1.0], r"values: expected 2 values, one per interval, or 3, .*found 1"),
        (0.0, [1.0], r"xi: expected increasing"),
    ],
)
def test_wrong_tables_are_refused(xi, values, message):
    with pytest.raises(ValueError, match=rf"Piecewise\.{message}"):
        cc.Piecewise(xi, values)


def test_what_varies_is_checked_where_it_is_evaluated_and_else_at_once():
    with pytest.raises(ValueError, match=r"^width: expected shape \(1, 1\)"):
        Along("width", [1, 2], scalar)
    width = Along("width", lambda xi: [1, 2] if xi > 0.5 else 3, scalar)
    assert float(width(0.5)) == 3
    with pytest.raises(ValueError, match=r"^width at xi = 0\.75: expected shape \(1, 1\)"):
        width(0.75)


def test_a_mapped_quantity_keeps_its_breaks():
    doubled = mapped(cc.Steps([0, 0.25, 1], [1, 2]), lambda value: 2 * value)
    assert doubled.breaks == (0.25,)
    assert [doubled(x) for x in (0.1, 0.9)] == [2, 4]
    assert mapped(3, lambda value: 2 * value) == 6
    assert mapped(None, lambda value: 2 * value) is None


def test_linear_tables_serve_section_and_airfoil_data_with_panels_that_end_at_their_kinks():
    xi, EI = [0, 0.3, 1], [2e4, 5e3, 1e3]
    section = cc.Section(GJ=1e4, EI_y=cc.Piecewise(xi, EI), EI_z=4e6)
    assert section.breaks == (0.3,)
    beam = cc.Beam(
        length=2.0,
        basis=cc.ChannelBasis(out_of_plane=cc.Legendre(1)),
        grid=cc.Grid.uniform(4),
        section=section,
    )
    # A constant curvature: U = ½ L K² ∫ EI dxi, the trapezoid's area exactly.
    energy = float(cc.strain_energy(beam, [0.1]))
    assert_allclose(energy, 0.5 * 2 * 0.01 * np.trapezoid(EI, xi), rtol=1e-13)
    strips = cc.StripAerodynamics(
        chord=cc.Piecewise(xi, [1.0, 0.8, 0.4]), aerodynamic_center=0.2, lift_slope=6.0
    )
    assert strips.breaks == (0.3,)
    assert_allclose(strips.at("chord", 0.65), 0.6, rtol=1e-15)


def test_rounded_ends_and_stations_that_rounding_doubled_are_one():
    xi = np.append(0, np.cumsum(np.full(10, 0.3)) / 3.0)
    assert xi[-1] != 1  # but for rounding
    assert cc.Steps(xi, range(10)).xi[-1] == 1
    steps = cc.Steps([0, 0.3, 0.3 + 1e-13, 1 - 1e-14, 1], [1, 2, 3, 4])
    assert [steps(x) for x in (0.1, 0.3, 0.9, 1)] == [1, 3, 3, 3]
    linear = cc.Piecewise([1e-14, 0.5, 1 - 1e-14, 1], [0.0, 1.0, 2.0, 3.0])
    assert_allclose([linear(x) for x in (0.25, 0.75)], [0.5, 2])
    jump = cc.Piecewise([0, 0.5, 0.5 + 1e-15, 1], [0.0, 0.0, 2.0, 2.0])
    assert [jump(x) for x in (0.4, 0.5, 0.6)] == [0, 2, 2]
