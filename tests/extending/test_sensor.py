"""A kind of sensor of the user's, defined in this file alone: a radio beacon's distance."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing
from curvcasadi.sensors import point


@dataclass(frozen=True, eq=False, kw_only=True)
class Rangefinder(cc.Sensor):
    """Distance from a point of the wing to a beacon on the ground, m."""

    beacon: Any  #: (3,), m, inertial axes
    noise: Any  #: standard deviation of one sample, m
    offset: Any = field(default_factory=lambda: [0.0, 0.0, 0.0])  #: (3,), m, local axes
    bias: Any = None  #: m; zero where None

    prefix = "range"
    components = residual_components = ("",)
    unit = residual_unit = "m"
    shapes: ClassVar[dict[str, tuple[int, int]]] = {"offset": (3, 1), "beacon": (3, 1)}

    @classmethod
    def value(cls, at, frames, mount):
        position, *_ = point(at, mount.offset)
        in_parent = frames.root_position + frames.root_rotation @ position
        in_inertial = frames.position + frames.attitude @ in_parent
        return ca.norm_2(in_inertial - mount.beacon) + mount.bias


WING = hale_wing()
SHAPE = 0.03 * np.sin(1 + np.arange(9))
BEACONS = [[5.0, 3.0, 8.0], [-6.0, 10.0, 4.0], [2.0, 14.0, 9.0], [7.0, 20.0, -12.0]]
RANGES = [
    Rangefinder(xi=xi, beacon=beacon, noise=1e-3, offset=[0.1, lever, 0.0])
    for xi in (0.4, 0.7, 1.0)
    for lever in (0.5, -0.5)
    for beacon in BEACONS
]


def test_it_reads_the_distance():
    turned = cc.Pose(rotation=[[0, -1, 0], [1, 0, 0], [0, 0, 1]], position=[1.0, -2.0, 3.0])
    read = cc.measure(RANGES, WING, SHAPE, root=cc.RootMotion(pose=turned))
    for sensor, found in zip(RANGES, read.values.full().ravel(), strict=True):
        local = turned @ cc.pose_at(WING, SHAPE, sensor.xi)
        place = local.position + local.rotation @ ca.DM(sensor.offset)
        assert_allclose(found, np.linalg.norm((place - ca.DM(sensor.beacon)).full()), rtol=1e-13)
    assert read.labels[:2] == ("range_1", "range_2")


def test_its_derivatives_follow_from_what_it_reads():
    f = cc.measurement_function("f", RANGES[:2], WING, inputs=["q", "attitude", "position"])
    q, angle = ca.MX.sym("q", 9), ca.MX.sym("angle", 3)
    origin, attitude = np.array([1.0, -2.0, 3.0]), np.eye(3)[[1, 2, 0]]
    turned = ca.DM(attitude) @ cc.lie.so3.exp(angle)

    def residual(q, attitude, position):
        return f(q=q, attitude=attitude, position=position, measured=[0, 0])["residual"]

    found = f(q=SHAPE, attitude=attitude, position=origin, measured=[0, 0])
    at = ca.Function("at", [q, angle], [residual(q, turned, origin)])
    step = 1e-5  # of central differences: errors of 1e-10 beside slopes of some ten metres
    for key, columns in (("residual_q", 9), ("residual_attitude", 3)):
        for k in range(columns):
            move = step * np.eye(columns)[k]
            ends = [
                at(SHAPE + s * move, [0, 0, 0]) if columns == 9 else at(SHAPE, s * move)
                for s in (1, -1)
            ]
            assert_allclose(found[key][:, k], (ends[0] - ends[1]) / (2 * step), atol=1e-7)
    assert_allclose(
        ca.norm_2(found["residual_position"][0, :]), 1, rtol=1e-14
    )  # a distance grows as fast as one moves away


def test_a_shape_is_found_from_distances():
    measured = cc.measure(RANGES, WING, SHAPE).values
    fit = cc.fit_shape(WING, RANGES, measured, q_guess=np.zeros(9))
    # Exact readings, more than weights: Gauss–Newton ends at its own tolerance.
    assert_allclose(fit.q.full().ravel(), SHAPE, atol=1e-7)


def test_it_is_placed_beside_other_kinds():
    gauges = [cc.StrainGauge(xi=xi, offset=[0, 0.05], noise=1e-4) for xi in (0.1, 0.5)]
    placed = cc.place_sensors(WING, [*RANGES, *gauges], 4, shapes=[SHAPE], prior=0.05)
    assert len(placed.sensors) == 4
    assert any(isinstance(sensor, Rangefinder) for sensor in placed.sensors)


def test_a_filter_with_it_runs_as_c(tmp_path):
    ekf = cc.shape_ekf(WING, RANGES[::4], process="random_walk", density=1e-3)
    start = ekf.initial({"q": 0.01})
    measured = cc.measure(RANGES[::4], WING, 0.1 * SHAPE).values
    update = cc.CFunction(function=ekf.update, missing=("measured",))
    samples = {"ekf_update": [(start.state, start.factor, measured)]}
    cc.export_c([update], tmp_path, reference_inputs=samples)
    assert cc.export.run_check(tmp_path)["ekf_update"] <= 1e-12


def test_a_missing_sample_is_left_out():
    measured = cc.measure(RANGES, WING, SHAPE).values.full().ravel()
    measured[3] = np.nan
    fit = cc.fit_shape(WING, RANGES, measured, q_guess=np.zeros(9))
    assert np.isnan(fit.residuals[3])
    assert_allclose(fit.q.full().ravel(), SHAPE, atol=1e-7)


@pytest.mark.parametrize(("field", "value"), [("beacon", [1, 2]), ("noise", -1), ("xi", 1.2)])
def test_its_fields_are_checked(field, value):
    fields = {"xi": 0.5, "beacon": [0, 0, 0], "noise": 1.0, field: value}
    with pytest.raises(ValueError, match=rf"Rangefinder\.{field}: expected"):
        Rangefinder(**fields)


def test_a_kind_that_does_not_say_what_it_reads_is_refused():
    class Silent(Rangefinder):
        value = cc.Sensor.value

    with pytest.raises(NotImplementedError, match=r"Sensor\.value"):
        cc.measure([Silent(xi=0.5, beacon=[0, 0, 0], noise=1.0)], WING, SHAPE)
