"""What is kept so that nobody waits, and what is dropped so that no memory fills."""

from __future__ import annotations

import copy
import gc
import pickle
import subprocess
import sys
import weakref

import casadi as ca
import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

import curvcasadi as cc
from curvcasadi.kinematics import chain, numeric as numeric_module

Q = np.linspace(-0.05, 0.08, 12)


def used(beam):
    """Use `beam` in all that keeps results with it."""
    cc.shape_map(beam, Q)
    cc.pose_at(beam, Q, 0.3)
    cc.body_jacobian(beam, Q)
    cc.body_twist(beam, Q, Q, 0.7)
    cc.tip_function(beam)
    cc.strain_energy(beam, Q)
    sensors = [cc.AttitudeSensor(xi=xi, noise=0.01) for xi in (0.3, 0.6, 1.0)]
    cc.fit_shape(beam, sensors, cc.measure(sensors, beam, Q).values, throw=False)
    cc.mass_matrix(beam, Q)
    cc.solve_equilibrium(beam, [cc.PointForce(0.8, [0, 0, 1.0])])
    return weakref.ref(beam)


def test_no_cache_keeps_a_dropped_beam_alive(wing):
    section = cc.Section(GJ=1e4, EI_y=2e4, EI_z=4e6, mass_per_length=1.0, inertia=np.eye(3))
    references = [used(wing(2, section=section)) for _ in range(2)]
    for _ in range(100):
        beam = wing(2)
        cc.shape_map(beam, Q)
        references.append(weakref.ref(beam))
    del beam
    gc.collect()
    assert [ref() for ref in references if ref() is not None] == []


def test_a_beam_keeps_a_bounded_number_of_results(wing):
    beam = wing(2)
    for xi in np.linspace(0.01, 0.99, 100):
        cc.pose_at(beam, Q, float(xi))
    assert len(beam._memory) <= 64


def test_copies_of_a_beam_give_the_same_shape(wing):
    beam = wing(3, kind="lobatto")
    expected = cc.shape_map(beam, Q).positions
    twice = copy.deepcopy(beam)
    assert_array_equal(cc.shape_map(twice, Q).positions, expected)
    pickled = pickle.loads(pickle.dumps(beam))
    assert_array_equal(cc.shape_map(pickled, Q).positions, expected)


def test_stations_are_made_once_and_cannot_be_changed(wing):
    beam = wing(4, kind="lobatto")
    assert beam.stations is beam.stations
    assert not beam.stations.flags.writeable


def test_numeric_shapes_are_evaluated_without_a_chain_of_calls(wing, monkeypatch):
    beam = wing(5, root=cc.Pose(rotation=np.diag([-1.0, -1, 1]), position=[1, 2, 3]))
    first = cc.shape_map(beam, Q), cc.pose_at(beam, Q, 0.33), cc.body_jacobian(beam, Q)
    monkeypatch.setattr(chain, "build", None)  # a chain that is built again cannot be called
    monkeypatch.setattr(numeric_module, "_shape_function", None)
    again = cc.shape_map(beam, Q), cc.pose_at(beam, Q, 0.33), cc.body_jacobian(beam, Q)
    assert_array_equal(again[0].positions, first[0].positions)
    assert_array_equal(again[1].rotation, first[1].rotation)
    assert_array_equal(again[2], first[2])


def test_numeric_shapes_equal_symbolic_ones(wing):
    beam = wing(5, initial_curvature=lambda xi: [0.1, 0.02 * xi, 0.0])
    q = ca.SX.sym("q", 12)
    shape, symbolic = cc.shape_map(beam, Q), cc.shape_map(beam, q)
    outputs = [symbolic.positions, symbolic.curvatures, symbolic.poses[2].rotation]
    for value, expected in zip(
        (shape.positions, shape.curvatures, shape.poses[2].rotation),
        ca.Function("f", [q], outputs)(Q),
        strict=True,
    ):
        assert isinstance(value, ca.DM)
        assert_allclose(value, expected, atol=1e-14)
    assert len(shape.poses) == len(shape.poses[:]) == 6
    assert_array_equal(shape.poses[-1].position, shape.tip.position)
    assert_allclose(shape.positions[:, 2], shape.poses[2].position, rtol=0)


def test_a_numeric_result_belongs_to_its_caller(wing):
    beam = wing(3)
    shape = cc.shape_map(beam, Q)
    expected = shape.positions.full()
    shape.positions[:, :] = 0
    shape.poses[1].position[:] = 0
    cc.pose_at(beam, Q, 0.5).position[:] = 0
    assert_array_equal(shape.positions, expected)
    assert_array_equal(cc.shape_map(beam, Q).positions, expected)


def test_the_package_is_imported_without_scipy_and_progress_bars():
    code = "import sys, curvcasadi; sys.exit(any(m in sys.modules for m in ('scipy', 'tqdm')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
