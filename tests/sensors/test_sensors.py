"""Sensors against motions differentiated in time, and their derivatives against AD."""

from __future__ import annotations

from dataclasses import fields, replace

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.export import export_c, run_check
from curvcasadi.lie import so3
from tests.support import oracle
from tests.support.oracle import CURLED_WEIGHTS

RNG = np.random.default_rng(5)
RATE = 0.3 * np.sin(1.0 + np.arange(12))
ACCELERATION = 0.8 * np.cos(0.5 + np.arange(12))
ROOT = cc.Pose(rotation=oracle.rotation([0.4, -1.2, 0.8]), position=[0.3, 1.0, -0.2])
MOUNT = {
    "offset": [0.1, 0.3, -0.2],
    "mounting": oracle.rotation([0.3, 0.2, -0.9]),
    "bias": [0.01, -0.02, 0.03],
}
IMU = {"noise_density": 1e-3, "rate": 100.0}
GRAVITY = np.array([0.3, 0.2, 9.7])
FIELD = np.array([2e-5, -1e-6, 4e-5])

#: Motion of the parent, and of the root in it: pose(t) = POSE exp(t TWIST + t²/2 TURN).
POSE = oracle.homogeneous(oracle.rotation([1.0, 0.5, -2.0]), [10.0, -5.0, 3.0])
TWIST = np.array([0.5, -0.3, 0.8, 2.0, -1.0, 0.7])
TURN = np.array([-0.4, 0.6, 0.2, 0.5, 1.5, -0.8])
CAMERA = cc.Pose(rotation=oracle.rotation([0.1, 0.2, 0.3]), position=[1.0, 2.0, -30.0])

GYRO = cc.RateGyro(xi=0.47, **IMU, **MOUNT)
ACCELEROMETER = cc.Accelerometer(xi=0.47, **IMU, **MOUNT)
TIP_ACCELEROMETER = cc.Accelerometer(xi=1.0, **IMU, **MOUNT)
MAGNETOMETER = cc.Magnetometer(xi=0.2, **IMU, **MOUNT)
ATTITUDE = cc.AttitudeSensor(xi=1.0, noise=0.01, mounting=MOUNT["mounting"], bias=MOUNT["bias"])
STRAIN = cc.StrainGauge(xi=0.3, offset=[0.1, -0.05], noise=1e-6, bias=2e-6)
SHEAR = cc.ShearGauge(xi=0.3, noise=1e-5)
MARKER = cc.Marker(xi=0.9, noise=1e-3, offset=MOUNT["offset"], bias=MOUNT["bias"])
VIEW = cc.Camera(xi=0.9, pose=CAMERA, noise=1e-3, offset=MOUNT["offset"], bias=[0.1, 0.2])
ALL = [
    GYRO,
    ACCELEROMETER,
    TIP_ACCELEROMETER,
    MAGNETOMETER,
    ATTITUDE,
    STRAIN,
    SHEAR,
    MARKER,
    VIEW,
]
VARIABLES = ("q", "q_dot", "q_ddot", "attitude", "position", "twist", "twist_rate")


def initial(xi):
    return np.array([0.01 * xi, -0.02, 0.005 * xi**2])


def root_pose(t):
    """Of the root, in inertial axes; at t = 0 its body twist is TWIST, and the rate of it TURN."""
    R_0 = oracle.homogeneous(ROOT.rotation.full(), ROOT.position.full())
    return POSE @ R_0 @ oracle.expm(oracle.twist_matrix(t * TWIST + t**2 / 2 * TURN))


def moving_root():
    pose = cc.Pose(rotation=POSE[:3, :3], position=POSE[:3, 3])
    return cc.RootMotion(
        pose=pose, twist=TWIST, twist_rate=TURN, gravity=GRAVITY, magnetic_field=FIELD
    )


def sensor_pose(beam, xi, t):
    """Section axes at `xi` in inertial axes at the time t, (4, 4)."""
    q = CURLED_WEIGHTS + t * RATE + t**2 / 2 * ACCELERATION
    at_root = replace(beam, root=cc.Pose.identity())
    station = cc.pose_at(at_root, q, xi)
    return root_pose(t) @ oracle.homogeneous(station.rotation.full(), station.position.full())


def differences(f, order, d=2e-3):
    """First or second derivative of f at 0 by central differences of order eight."""
    first = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
    second = {1: 8 / 5, 2: -1 / 5, 3: 8 / 315, 4: -1 / 560}
    if order == 1:
        return sum(c * (f(k * d) - f(-k * d)) for k, c in first.items()) / d
    total = sum(c * (f(k * d) + f(-k * d)) for k, c in second.items()) - 205 / 72 * f(0.0)
    return total / d**2


def read(sensor, beam, **fields):
    arguments = {
        "q": CURLED_WEIGHTS,
        "q_dot": RATE,
        "q_ddot": ACCELERATION,
        "root": moving_root(),
        **fields,
    }
    return cc.measure([sensor], beam, **arguments).values.full()[:, 0]


@pytest.fixture
def beam(wing):
    return wing(5, root=ROOT, initial_curvature=initial)


# What sensors read -----------------------------------------------------------------------------


def test_a_gyro_reads_the_turning_of_its_axes(beam):
    def attitude(t):
        return sensor_pose(beam, GYRO.xi, t)[:3, :3] @ MOUNT["mounting"]

    skew = attitude(0.0).T @ differences(attitude, 1)
    expected = [skew[2, 1], skew[0, 2], skew[1, 0]]
    # Rounding 1e-15/2e-3, and (2e-3 × some 10 rad/s)^8.
    assert_allclose(read(GYRO, beam), np.add(expected, MOUNT["bias"]), atol=1e-11)


def test_a_gyro_reads_equation_1(beam):
    """dD/dt = −[Ω×] D, in local axes, of a beam whose root stands still."""
    plain = cc.RateGyro(xi=0.47, **IMU)

    def deformation(t):
        return cc.pose_at(beam, CURLED_WEIGHTS + t * RATE, 0.47).deformation_map.full()

    expected = -differences(deformation, 1) @ deformation(0.0).T
    got = cc.measure([plain], beam, CURLED_WEIGHTS, RATE).values.full()
    assert_allclose(oracle.hat(got), expected, atol=1e-11)  # as above


@pytest.mark.parametrize("sensor", [ACCELEROMETER, TIP_ACCELEROMETER], ids=["inner", "tip"])
def test_an_accelerometer_reads_acceleration_minus_gravity(beam, sensor):
    point = np.array([*MOUNT["offset"], 1.0])

    def position(t):
        return (sensor_pose(beam, sensor.xi, t) @ point)[:3]

    to_inertial = sensor_pose(beam, sensor.xi, 0.0)[:3, :3] @ MOUNT["mounting"]
    expected = to_inertial.T @ (differences(position, 2) - GRAVITY) + MOUNT["bias"]
    # Rounding of 20 m, 4e-15/(2e-3)², on some 100 m/s².
    assert_allclose(read(sensor, beam), expected, atol=2e-8)


def test_without_an_acceleration_of_the_weights_its_part_is_left_out(beam):
    sensor = replace(ACCELEROMETER, mounting=np.eye(3))
    J = cc.body_jacobian(beam, CURLED_WEIGHTS, sensor.xi).full()
    lever = J[3:] - oracle.hat(MOUNT["offset"]) @ J[:3]
    difference = read(sensor, beam) - read(sensor, beam, q_ddot=None)
    assert_allclose(difference, lever @ ACCELERATION, atol=1e-12)  # rounding of 100 m/s²


def test_at_rest_an_accelerometer_reads_one_g_upwards():
    straight = cc.Beam(
        length=2.0,
        basis=cc.ChannelBasis(out_of_plane=cc.Legendre(2)),
        grid=cc.Grid.uniform(2),
        root=cc.Pose(rotation=[[0, 1, 0], [1, 0, 0], [0, 0, -1]], position=[0, 0, 0]),
    )
    root = cc.RootMotion(gravity=[0, 0, 9.81])  # north-east-down
    still = np.zeros(2)
    value = cc.measure([cc.Accelerometer(xi=1.0, **IMU)], straight, still, still, root=root).values
    assert_allclose(value, [[0], [0], [9.81]], atol=0)  # local z of a right wing is up


def test_an_attitude_sensor_reads_its_axes_and_a_bias_turns_them(beam):
    R = sensor_pose(beam, 1.0, 0.0)[:3, :3] @ MOUNT["mounting"] @ oracle.rotation(MOUNT["bias"])
    measurement = cc.measure([ATTITUDE], beam, CURLED_WEIGHTS, root=moving_root())
    assert_allclose(measurement.values.full().reshape(3, 3).T, R, atol=1e-14)  # rounding
    assert measurement.labels[:4] == (
        "attitude_1_R_xx",
        "attitude_1_R_yx",
        "attitude_1_R_zx",
        "attitude_1_R_xy",
    )


def test_a_residual_of_an_attitude_is_a_rotation_vector(beam):
    R = sensor_pose(beam, 1.0, 0.0)[:3, :3] @ MOUNT["mounting"] @ oracle.rotation(MOUNT["bias"])
    error = np.array([0.3, -1.0, 2.0])
    measured = (R @ oracle.rotation(-error)).T.ravel()
    got = cc.measurement_residual([ATTITUDE], beam, measured, CURLED_WEIGHTS, root=moving_root())
    assert_allclose(got.full()[:, 0], error, atol=1e-13)  # rounding


@pytest.mark.parametrize("scale", [-1, 0, 2, 1.02])
def test_a_residual_of_what_is_no_attitude_is_refused(beam, scale):
    measured = scale * np.eye(3).ravel()
    with pytest.raises(ValueError, match="measured of attitude_1: expected "):
        cc.measurement_residual([ATTITUDE], beam, measured, CURLED_WEIGHTS)
    near = cc.measurement_residual([ATTITUDE], beam, 1.001 * np.eye(3).ravel(), CURLED_WEIGHTS)
    assert np.isfinite(near.full()).all()


def test_a_magnetometer_reads_the_field_in_its_axes(beam):
    to_inertial = sensor_pose(beam, 0.2, 0.0)[:3, :3] @ MOUNT["mounting"]
    expected = to_inertial.T @ FIELD + MOUNT["bias"]
    assert_allclose(read(MAGNETOMETER, beam), expected, atol=1e-17)  # rounding


@pytest.mark.parametrize("reference", ["unloaded", "straight"])
def test_strain_gauges_read_the_curvature_beyond_that_of_their_reference(beam, reference):
    K = cc.curvature(beam, CURLED_WEIGHTS, 0.3).full()[:, 0]
    K -= initial(0.3) if reference == "unloaded" else 0
    y, z = 0.1, -0.05
    strain, shear = (replace(gauge, reference=reference) for gauge in (STRAIN, SHEAR))
    assert_allclose(read(strain, beam), [K[1] * z - K[2] * y + 2e-6], rtol=1e-13)  # rounding
    assert_allclose(read(shear, beam), [K[0]], rtol=1e-13)  # rounding


def test_gauges_bonded_to_the_unloaded_wing_read_zero_there(beam):
    gauges = [replace(STRAIN, bias=None), SHEAR]
    values = cc.measure(gauges, beam, np.zeros(beam.basis.n)).values.full()
    assert np.all(values == 0)
    fit = cc.fit_shape(beam, gauges, values, prior=(np.zeros(beam.basis.n), 0.1))
    assert_allclose(fit.q.full(), 0, atol=1e-12)


def test_the_reference_of_a_gauge_is_one_of_two():
    with pytest.raises(ValueError, match=r"ShearGauge\.reference: expected one of"):
        replace(SHEAR, reference="bent")


def test_strain_is_the_stretch_of_a_fibre(beam):
    """ε = |d(p + R r)/ds| − 1 to first order in the offset."""
    y, z = 1e-5, -2e-5
    gauge = cc.StrainGauge(xi=0.3, offset=[y, z], noise=1e-6)
    [(R, _)] = oracle.integrate(oracle.curled_curvature, 16.0, [0.3])
    bent = np.cross(oracle.curled_curvature(0.3), [0, y, z])
    tangent = R @ (np.array([1, 0, 0]) + bent)
    plain = replace(beam, initial_curvature=None)
    # The part of second order is |K r|², 1e-11.
    assert_allclose(read(gauge, plain), [np.linalg.norm(tangent) - 1], atol=1e-11)


def test_a_marker_is_a_point_of_the_wing(beam):
    point = sensor_pose(beam, 0.9, 0.0) @ [*MOUNT["offset"], 1.0]
    assert_allclose(read(MARKER, beam), point[:3] + MOUNT["bias"], atol=1e-13)  # rounding


def test_a_camera_sees_the_point_in_its_own_axes(beam):
    still = replace(moving_root(), pose=cc.Pose.identity())
    in_parent = read(replace(MARKER, bias=None), beam, root=still)
    x, y, z = CAMERA.rotation.full().T @ (in_parent - CAMERA.position.full()[:, 0])
    # A camera on the aircraft does not see where the aircraft flies.
    assert_allclose(read(VIEW, beam), [x / z + 0.1, y / z + 0.2], atol=1e-15)  # rounding


def test_a_mirrored_wing_reads_the_mirror_image(wing):
    right = wing(4, root=ROOT, initial_curvature=initial)
    flips = {
        cc.RateGyro: np.array([-1, -1, 1]),
        cc.Accelerometer: np.array([1, 1, -1]),
    }
    space, local = np.diag([1, -1, 1]), np.array([1, 1, -1])
    # A root that moves within the mirror plane: parent twist (0, ω, 0; v_x, 0, v_z).
    parent_twist, parent_rate = np.array([0, 0.4, 0, 3, 0, -1]), np.array([0, 1.0, 0, 0.5, 0, 2])

    def twist(beam, value):
        R, p = beam.root.rotation.full(), beam.root.position.full()[:, 0]
        return np.concatenate([R.T @ value[:3], R.T @ (value[3:] + np.cross(value[:3], p))])

    def motion(beam, pull):
        return cc.RootMotion(
            twist=twist(beam, parent_twist), twist_rate=twist(beam, parent_rate), gravity=pull
        )

    left, pull = cc.mirror(right), np.array([0.1, 0.0, 9.8])
    assert_allclose(space @ pull, pull, atol=0)
    for kind, flip in flips.items():
        sensor = kind(xi=0.6, **IMU, offset=MOUNT["offset"])
        image = replace(sensor, offset=local * np.array(MOUNT["offset"]))
        there, here = (
            read(s, b, root=motion(b, pull)) for s, b in ((sensor, right), (image, left))
        )
        assert_allclose(here, flip * there, atol=1e-12)  # rounding of 100 m/s²
    strain = cc.StrainGauge(xi=0.6, offset=[0.1, 0.2], noise=1e-6)
    image = replace(strain, offset=[0.1, -0.2])
    assert_allclose(read(image, left), read(strain, right), atol=1e-16)  # rounding


# Stacks ----------------------------------------------------------------------------------------


def test_stacked_measurements_are_those_of_each_sensor_and_say_what_they_are(beam):
    both = cc.measure(ALL, beam, CURLED_WEIGHTS, RATE, ACCELERATION, moving_root())
    each = np.concatenate([read(sensor, beam) for sensor in ALL])
    assert_allclose(both.values.full()[:, 0], each, atol=0)
    channels = cc.sensor_channels([replace(GYRO, name="root_gyro"), GYRO, ATTITUDE, STRAIN])
    assert channels.labels[:4] == ("root_gyro_x", "root_gyro_y", "root_gyro_z", "gyro_2_x")
    assert channels.labels[-1] == "strain_1"
    assert channels.residual_labels[6:] == (
        "attitude_1_x",
        "attitude_1_y",
        "attitude_1_z",
        "strain_1",
    )
    assert channels.units[:1] + channels.units[-2:] == ("rad/s", "1", "1")
    assert channels.residual_units[6] == "rad"
    # N √f = 1e-3 √100.
    assert_allclose(channels.noise, [*[0.01] * 6, *[0.01] * 3, 1e-6], rtol=1e-15)
    assert channels.layout.size == 16
    assert channels.residual_layout.size == 10


def test_measurements_agree_in_all_kinds(beam, evaluate):
    root = moving_root()

    def values(q, q_dot, twist, offset):
        moved = replace(root, twist=twist)
        sensors = [replace(ACCELEROMETER, offset=offset), *ALL]
        return cc.measure(sensors, beam, q, q_dot, root=moved).values

    arguments = [CURLED_WEIGHTS, RATE, TWIST, np.array(MOUNT["offset"])]
    got = evaluate(values, *arguments)
    assert_allclose(got, values(*arguments), atol=1e-13)  # the same operations


def test_every_field_of_the_root_may_be_a_symbol(beam, evaluate):
    root, shapes = moving_root(), ((3, 3), (3, 1), (6, 1), (6, 1), (3, 1), (3, 1))

    def values(*columns):
        fields = [ca.reshape(column, *shape) for column, shape in zip(columns, shapes, strict=True)]
        rotation, position, twist, twist_rate, gravity, field = fields
        motion = cc.RootMotion(
            pose=cc.Pose(rotation=rotation, position=position),
            twist=twist,
            twist_rate=twist_rate,
            gravity=gravity,
            magnetic_field=field,
        )
        return cc.measure(ALL, beam, CURLED_WEIGHTS, RATE, ACCELERATION, motion).values

    C, p = POSE[:3, :3], POSE[:3, 3]
    got = evaluate(values, C.T.ravel(), p, TWIST, TURN, GRAVITY, FIELD)
    expected = cc.measure(ALL, beam, CURLED_WEIGHTS, RATE, ACCELERATION, root).values
    assert_allclose(got, expected, atol=1e-12)  # the same operations, rounding of 100 m/s²


def test_sensors_take_design_symbols(wing, symbolic):
    length, y = symbolic.sym("L"), symbolic.sym("y")
    beam = wing(3, length=length)
    gauge = replace(STRAIN, offset=ca.vertcat(y, 0.1), bias=None)
    values = cc.measure([gauge, MARKER], beam, CURLED_WEIGHTS / 3).values
    f = ca.Function("f", [length, y], [values])
    plain = [replace(gauge, offset=[0.2, 0.1]), MARKER]
    expected = cc.measure(plain, wing(3, length=8.0), CURLED_WEIGHTS / 3).values
    assert_allclose(f(8.0, 0.2), expected, atol=1e-15)  # the same operations


# Derivatives -----------------------------------------------------------------------------------


def by_ad(beam, sensors):
    """Residual and derivatives from the unrolled chain: the oracle of the structured ones."""
    n, root = beam.basis.n, moving_root()
    variation = {
        **{name: ca.SX.sym(name, n) for name in ("q", "q_dot", "q_ddot")},
        **{"attitude": ca.SX.sym("phi", 3), "position": ca.SX.sym("position", 3)},
        **{name: ca.SX.sym(name, 6) for name in ("twist", "twist_rate")},
    }
    attitude = ca.SX.sym("attitude", 3, 3)
    measured = ca.SX.sym("measured", cc.sensor_channels(sensors).layout.size)
    motion = replace(
        root,
        pose=cc.Pose(
            rotation=attitude @ so3.exp(variation["attitude"]), position=variation["position"]
        ),
        twist=variation["twist"],
        twist_rate=variation["twist_rate"],
    )
    weights = [variation[name] for name in ("q", "q_dot", "q_ddot")]
    error = cc.measurement_residual(sensors, beam, measured, *weights, motion)
    slopes = [ca.jacobian(error, value) for value in variation.values()]
    zero_angle = ca.substitute(slopes, [variation["attitude"]], [ca.SX.zeros(3)])
    error = ca.substitute(error, variation["attitude"], ca.SX.zeros(3))
    inputs = [attitude if name == "attitude" else value for name, value in variation.items()]
    return ca.Function("ad", [*inputs, measured], [error, *zero_angle])


def arguments_of(beam, sensors, q):
    """Inputs of a measurement Function, with measurements some way from the prediction."""
    n = beam.basis.n
    values = cc.measure(sensors, beam, q, RATE[:n], ACCELERATION[:n], moving_root())
    found = values.channels.layout.split(values.values)
    for name, part in found.items():
        if name.startswith("attitude"):
            turned = part.full().reshape(3, 3).T @ oracle.rotation([0.2, -0.4, 0.1])
            found[name] = ca.vec(ca.DM(turned))
        else:
            found[name] = part + 0.01
    measured = values.channels.layout.join(found)
    pose = POSE[:3, :3], POSE[:3, 3]
    return [q, RATE[:n], ACCELERATION[:n], *pose, TWIST, TURN, measured]


@pytest.mark.parametrize("form", ["compact", "unrolled"])
@pytest.mark.parametrize("rule", ["trapezoid", "magnus4", "magnus6"])
def test_structured_derivatives_equal_ad_of_the_chain(wing, rule, form):
    beam = wing(4, rule, root=ROOT, initial_curvature=initial)
    f = cc.measurement_function("m", ALL, beam, VARIABLES, moving_root(), form=form)
    assert f.name_out() == ["values", "residual", *(f"residual_{name}" for name in VARIABLES)]
    reference = by_ad(beam, ALL)
    for q in (CURLED_WEIGHTS, np.zeros(12)):
        arguments = arguments_of(beam, ALL, q)
        got, expected = f(*arguments)[1:], reference(*arguments)
        for name, value, by_chain in zip(["residual", *VARIABLES], got, expected, strict=True):
            a, b = np.array(value), np.array(by_chain)
            scale = np.abs(b).max(axis=1, keepdims=True)
            # Both are exact; rounding of derivatives of third order.
            assert_allclose(a, b, rtol=0, atol=1e-12 * scale.max(), err_msg=name)


@pytest.mark.parametrize("sensor", ALL, ids=lambda s: type(s).__name__ + str(s.xi))
def test_each_sensor_alone_has_its_derivatives(wing, sensor):
    """A march of the sensor's own order; each row to its own largest entry."""
    beam = wing(3, root=ROOT)
    f = cc.measurement_function("m", [sensor], beam, VARIABLES, moving_root())
    arguments = arguments_of(beam, [sensor], CURLED_WEIGHTS)
    got, expected = f(*arguments)[1:], by_ad(beam, [sensor])(*arguments)
    for value, by_chain in zip(got, expected, strict=True):
        a, b = np.array(value), np.array(by_chain)
        scale = np.abs(b).max(axis=1, keepdims=True)
        assert np.all(np.abs(a - b) <= 1e-12 * scale.max())  # rounding


@pytest.mark.parametrize("sensor", [GYRO, MAGNETOMETER, MARKER], ids=lambda s: s.prefix)
def test_slopes_by_ad_of_a_station_are_those_in_closed_form(beam, sensor):
    class Plain(type(sensor)):
        slopes = cc.Sensor.__dict__["slopes"]

    values = {entry.name: getattr(sensor, entry.name) for entry in fields(sensor)}
    inputs = [name for name in VARIABLES if name not in ("q_ddot", "twist_rate")]
    found, expected = (
        cc.measurement_function("f", [s], beam, inputs=inputs, root=moving_root())
        for s in (Plain(**values), sensor)
    )
    at = {"q": CURLED_WEIGHTS, "q_dot": RATE, "attitude": POSE[:3, :3], "twist": TWIST}
    at |= {"position": POSE[:3, 3], "measured": [0, 0, 0]}
    for name in inputs:
        key = f"residual_{name}"
        scale = max(1e-300, float(ca.norm_inf(expected(**at)[key])))
        assert_allclose(found(**at)[key], expected(**at)[key], rtol=0, atol=1e-13 * scale)


def test_derivatives_of_a_mirrored_wing_and_of_a_broken_basis_equal_ad(wing):
    piecewise = cc.ChannelBasis(torsion=cc.PiecewiseConstant(2), in_plane=cc.PiecewiseConstant(3))
    broken = cc.Beam(length=6.0, basis=piecewise, grid=cc.Grid.lobatto(5))
    for beam in (cc.mirror(wing(3, root=ROOT, initial_curvature=initial)), broken):
        q = 0.05 * np.cos(np.arange(beam.basis.n))
        f = cc.measurement_function("m", ALL, beam, VARIABLES, moving_root())
        arguments = arguments_of(beam, ALL, q)
        for a, b in zip(f(*arguments)[1:], by_ad(beam, ALL)(*arguments), strict=True):
            assert_allclose(a, b, rtol=0, atol=1e-12 * max(1, np.abs(b.full()).max()))  # rounding


def test_what_a_camera_does_not_see_is_no_number_and_has_no_derivative(beam):
    for position, seen in (([0, 0, -1], 1), ([0, 0, 1], 0), ([0, 1, 0], 0), ([0, 0, 0], 0)):
        pose = cc.Pose(rotation=np.eye(3), position=position)
        f = cc.measurement_function("m", [cc.Camera(xi=0.0, pose=pose, noise=1.0)], beam)
        values, residual, by_q = (m.full() for m in f(CURLED_WEIGHTS, [0.1, 0.2]))
        assert np.isfinite([values, residual]).all() == seen
        assert np.isnan([values, residual]).all() != seen
        assert_allclose(by_q, np.zeros((2, 12)), rtol=0)


def test_rates_that_are_no_inputs_are_zero(beam):
    f = cc.measurement_function("m", [GYRO, ACCELEROMETER], beam, ["q"], moving_root())
    assert f.name_in() == ["q", "measured"]
    values, *_ = f(CURLED_WEIGHTS, np.zeros(6))
    expected = cc.measure(
        [GYRO, ACCELEROMETER], beam, CURLED_WEIGHTS, np.zeros(12), root=moving_root()
    )
    assert_allclose(values, expected.values, atol=1e-13)  # rounding


def test_a_missing_sample_harms_its_own_rows_alone(wing):
    beam = wing(3, root=ROOT)
    sensors = [GYRO, ATTITUDE, MARKER]
    f = cc.measurement_function("m", sensors, beam, ["q", "q_dot", "attitude"], moving_root())
    pose = POSE[:3, :3]
    measured = np.zeros(15)
    measured[3:12] = pose.T.ravel()
    whole = f(CURLED_WEIGHTS, RATE, pose, measured)
    measured[3:12], measured[0] = np.nan, np.nan
    parted = f(CURLED_WEIGHTS, RATE, pose, measured)
    kept = [1, 2, 6, 7, 8]
    for a, b in zip(whole[1:], parted[1:], strict=True):
        assert_allclose(np.array(b)[kept], np.array(a)[kept], atol=0)
    assert np.isnan(parted[1].full()).sum() == 4


def test_the_straight_wing_has_finite_values_and_derivatives_of_second_order(wing, symbolic):
    beam = wing(2)
    q, q_dot = symbolic.sym("q", 12), symbolic.sym("q_dot", 12)
    values = cc.measure(ALL, beam, q, q_dot, root=moving_root()).values
    slope = ca.jacobian(values, ca.vertcat(q, q_dot))
    bend = ca.jacobian(ca.sum1(ca.sum2(slope)), q)
    f = ca.Function("f", [q, q_dot], [values, slope, bend])
    for value in f(np.zeros(12), np.zeros(12)):
        assert np.all(np.isfinite(np.array(value)))


# Cost and C ------------------------------------------------------------------------------------

WEIGHTS_OF_SIX = cc.ChannelBasis(
    torsion=cc.Legendre(2), out_of_plane=cc.Legendre(3), in_plane=cc.Legendre(1)
)


def imus():
    """Four gyros and four accelerometers at elements' ends."""
    beam = cc.Beam(length=16.0, basis=WEIGHTS_OF_SIX, grid=cc.Grid.uniform(16))
    kinds = (cc.RateGyro, cc.Accelerometer)
    sensors = [
        kind(xi=xi, **IMU, offset=[0, 0.1, 0.05]) for xi in (0.25, 0.5, 0.75, 1) for kind in kinds
    ]
    return beam, sensors


def test_inertial_units_cost_sixty_thousand_nodes_at_most():
    beam, sensors = imus()
    root = cc.RootMotion(gravity=[0, 0, 9.81])
    f = cc.measurement_function("m", sensors, beam, ["q", "q_dot"], root, form="unrolled")
    assert f.n_instructions() <= 60_000


def test_compact_measurements_call_one_step(wing):
    beam, sensors = imus()
    root = cc.RootMotion(gravity=[0, 0, 9.81])
    f = cc.measurement_function("m", sensors, beam, root=root)
    called = {g.name() for g in f.find_functions(0)}
    assert called == {"element_motion", "differentiate_gyro", "differentiate_accelerometer"}


def test_measurements_compile_and_agree(tmp_path):
    beam, sensors = imus()
    more = [ATTITUDE, STRAIN, MARKER, VIEW, MAGNETOMETER]
    inputs = ["q", "q_dot", "attitude", "position", "twist"]
    root = cc.RootMotion(gravity=GRAVITY, magnetic_field=FIELD)
    f = cc.measurement_function("imus", [*sensors, *more], beam, inputs, root)
    q, still = 0.02 * np.cos(np.arange(6)), RATE[:6]
    pose = POSE[:3, :3]
    zeros = np.zeros(f.numel_in("measured") - 18)
    measured = np.concatenate([np.zeros(24), pose.T.ravel(), zeros, np.zeros(9)])[
        : f.numel_in("measured")
    ]
    samples = {"imus": [[q, still, pose, POSE[:3, 3], TWIST, measured]]}
    export_c([f], tmp_path, reference_inputs=samples)
    # Over the largest entry of each output: rounding.
    assert run_check(tmp_path)["imus"] <= 1e-12


# Bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: cc.RateGyro(xi=1.2, **IMU), r"RateGyro\.xi: expected a number in \[0, 1\]"),
        (lambda: cc.RateGyro(xi=0.5, noise_density=0, rate=1), r"noise_density: .*above zero"),
        (lambda: cc.RateGyro(xi=0.5, noise_density=1, rate=-1), r"RateGyro\.rate: .*above zero"),
        (lambda: cc.RateGyro(xi=0.5, noise_density=[1, 2], rate=1), r"expected 1 number or 3"),
        (lambda: replace(GYRO, bias=[1, 2]), r"RateGyro\.bias: expected shape \(3, 1\)"),
        (lambda: replace(GYRO, offset=1.0), r"RateGyro\.offset: expected shape \(3, 1\)"),
        (lambda: replace(GYRO, mounting=np.ones((3, 3))), r"RateGyro\.mounting: .*orthonormal"),
        (lambda: replace(GYRO, name="a b"), r"RateGyro\.name: expected letters"),
        (lambda: replace(ATTITUDE, noise=np.nan), r"AttitudeSensor\.noise: expected finite"),
        (
            lambda: replace(STRAIN, offset=[0, 1, 2]),
            r"StrainGauge\.offset: expected shape \(2, 1\)",
        ),
        (lambda: replace(VIEW, pose=np.eye(4)), r"Camera\.pose: expected a Pose"),
        (lambda: replace(VIEW, bias=[0, 0, 0]), r"Camera\.bias: expected shape \(2, 1\)"),
        (lambda: cc.RootMotion(twist=[1, 2]), r"RootMotion\.twist: expected shape \(6, 1\)"),
        (lambda: cc.RootMotion(gravity=9.81), r"RootMotion\.gravity: expected shape \(3, 1\)"),
        (lambda: cc.RootMotion(pose=None), r"RootMotion\.pose: expected a Pose"),
        (
            lambda: cc.RootMotion(gravity=np.array([ca.SX.sym("g"), 0, 0])),
            r"RootMotion\.gravity: expected numbers, found array\(\[SX\(g\)",
        ),
        (lambda: replace(MARKER, noise=ca.SX.sym("s")), r"Marker\.noise: expected numbers"),
    ],
)
def test_fields_that_cannot_be_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    "sensors, arguments, message",
    [
        ([], {}, r"sensors: expected one or more"),
        (GYRO, {}, r"sensors: expected a sequence"),
        ([3], {}, r"sensors\[0\]: expected a sensor"),
        ([GYRO], {"q_dot": None}, r"q_dot: expected shape \(12, 1\).*found None"),
        ([GYRO], {"q_dot": [1, 2]}, r"q_dot: expected shape \(12, 1\), found \(2, 1\)"),
        ([ACCELEROMETER], {"root": None}, r"RootMotion\.gravity: .*accelerometer_1; found None"),
        ([MAGNETOMETER], {"root": None}, r"RootMotion\.magnetic_field: .*magnetometer_1"),
        ([GYRO], {"root": ROOT}, r"root: expected a RootMotion"),
        ([replace(VIEW, pose=ROOT)], {}, r"camera_1: expected the point before the camera, z > 0"),
        ([replace(GYRO, name="a")] * 2, {}, r"sensors: expected different names"),
        ([replace(GYRO, offset=ca.MX.sym("r", 3))], {"q": ca.SX.sym("q", 12)}, r"gyro_1\.offset"),
        ([GYRO], {"q": np.ones(12)}, r"q: expected every element to turn at most"),
    ],
)
def test_measurements_that_cannot_be_are_refused(wing, sensors, arguments, message):
    given = {"q": CURLED_WEIGHTS, "q_dot": RATE, "root": moving_root(), **arguments}
    with pytest.raises(ValueError, match=message):
        cc.measure(sensors, wing(4), **given)


@pytest.mark.parametrize(
    "inputs, message",
    [
        (["q_dot"], r"inputs: expected 'q' and others"),
        (["q", "q"], r"inputs: expected 'q' and others"),
        (["q", "speed"], r"inputs: expected one of 'q', .*found 'speed'"),
    ],
    ids=str,
)
def test_inputs_that_do_not_exist_are_refused(wing, inputs, message):
    with pytest.raises(ValueError, match=message):
        cc.measurement_function("m", [GYRO], wing(2), inputs)


ROOT_FIELDS = {
    "pose.rotation": lambda kind: {
        "pose": cc.Pose(rotation=kind.sym("C", 3, 3), position=[0, 0, 0])
    },
    "pose.position": lambda kind: {"pose": cc.Pose(rotation=np.eye(3), position=kind.sym("p", 3))},
    "twist": lambda kind: {"twist": kind.sym("V", 6)},
    "twist_rate": lambda kind: {"twist_rate": kind.sym("V_t", 6)},
    "gravity": lambda kind: {"gravity": kind.sym("g", 3)},
    "magnetic_field": lambda kind: {"magnetic_field": kind.sym("B", 3)},
}
WHITE = {"process": "white_acceleration", "density": 0.1}
#: What asks for a root in numbers; a symbol that the sensors do not read is named, too.
ASKING = {
    "function": lambda beam, root: cc.measurement_function("m", [ATTITUDE], beam, root=root),
    "filter": lambda beam, root: cc.shape_ekf(beam, [ATTITUDE], root=root, **WHITE),
    "estimator": lambda beam, root: cc.shape_mhe(
        beam, [ATTITUDE], root=root, dt=0.1, window=1, **WHITE
    ),
    "fit": lambda beam, root: cc.fit_shape(beam, [ATTITUDE], np.eye(3).ravel(), root=root),
    "information": lambda beam, root: cc.information_matrix(
        beam, [ATTITUDE], np.zeros(12), root=root
    ),
}


@pytest.mark.parametrize("asking", ASKING)
@pytest.mark.parametrize("field", ROOT_FIELDS)
def test_a_symbol_where_the_root_holds_numbers_is_named(wing, symbolic, field, asking):
    root = replace(cc.RootMotion(gravity=GRAVITY), **ROOT_FIELDS[field](symbolic))
    with pytest.raises(ValueError, match=rf"^RootMotion\.{field}: expected numbers, found the sym"):
        ASKING[asking](wing(2), root)


@pytest.mark.parametrize("asking", ASKING)
@pytest.mark.parametrize("root", [0, [1.0], np.zeros(3), ca.MX.sym("root"), ca.SX.sym("root", 3)])
def test_what_is_no_root_is_named(wing, root, asking):
    with pytest.raises(ValueError, match=r"^root: expected a RootMotion, found "):
        ASKING[asking](wing(2), root)


def test_a_symbol_that_an_input_stands_for_is_none_of_the_function(wing):
    root = replace(moving_root(), **ROOT_FIELDS["twist"](ca.SX))
    f = cc.measurement_function("m", [GYRO], wing(2), ["q", "twist"], root)
    assert f.name_in() == ["q", "twist", "measured"]


def test_functions_of_design_symbols_are_refused(wing):
    beam = wing(2, length=ca.MX.sym("L"))
    with pytest.raises(ValueError, match="found also L"):
        cc.measurement_function("m", [GYRO], beam)
