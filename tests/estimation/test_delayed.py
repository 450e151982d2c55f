"""A filter whose samples are late knows the present all the same."""

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

DT = 0.01


@pytest.fixture(scope="module")
def shaft():
    """A beam that only twists under a torque: its model, and a filter on it."""
    beam = cc.Beam(
        length=2.0,
        basis=cc.ChannelBasis(torsion=cc.Legendre(2)),
        grid=cc.Grid.lobatto(3),
        section=cc.Section(
            GJ=30.0, EI_y=1.0, EI_z=1.0, mass_per_length=1.0, inertia=np.diag([0.02, 1, 1])
        ),
    )
    torque, gust = ca.MX.sym("torque"), ca.MX.sym("gust")
    load = cc.PointMoment(xi=1.0, moment=ca.vertcat(torque + gust, 0, 0), frame="follower")
    model = cc.beam_model(beam, [load], {"torque": torque}, {"gust": gust}, damping=0.003)
    sensors = [
        cc.RateGyro(xi=1.0, noise_density=2e-3, rate=1 / DT),
        cc.ShearGauge(xi=0.3, noise=1e-3),
    ]
    process = cc.ModelProcess(model=model, density={"q_dot": 0.1})
    ekf = cc.shape_ekf(beam, sensors, process=process)
    return beam, model, sensors, ekf


def history(shaft, lanes):
    """States and readings without noise, in a torque that jumps from sample to sample."""
    beam, model, sensors, _ = shaft
    step, rng = cc.rk4_step(model, DT), np.random.default_rng(0)
    x, rows = rng.normal(scale=0.05, size=(lanes, 4)), []
    for _ in range(30):
        u = rng.normal(size=(lanes, 1))
        x = np.array([
            step(each, torque, p).full().ravel()
            for each, torque, p in zip(x, u, np.array([0.3, -0.2])[:lanes], strict=True)
        ])  # fmt: skip
        values = [cc.measure(sensors, beam, q[:2], q[2:]).values.full().ravel() for q in x]
        rows.append((x, u, np.array(values)))
    return rows


@pytest.mark.parametrize("delay", [0, 3])
def test_the_present_is_exact_where_the_model_is(shaft, delay):
    rows, ekf = history(shaft, 2), shaft[-1]
    link = cc.SensorLink(noise=0.0, delay=delay, loss=0.2, seeds=(0, 1))
    start = ekf.initial({"q": 1.0, "q_dot": 1.0})
    late = cc.DelayedFilter(
        ekf, start, dt=DT, delay=delay, lanes=2, p=[[0.3], [-0.2]], compiled=False
    )
    for x, u, values in rows:
        late.take(link(values), u)
        error = np.abs(late.present()[:, :4] - x)
    # Samples without noise leave what their assumed noise over thirty of them does not forget.
    assert late.present().shape[0] == 2
    assert error[:, :2].max() < 1e-3 and error[:, 2:].max() < 5e-3
    if delay:
        # Without prediction the state of three samples ago is far off.
        assert np.abs(rows[-1 - delay][0] - rows[-1][0]).max() > 0.1


def test_it_is_run_ekf_to_the_sample_and_predictions_from_there(shaft):
    rows, ekf = history(shaft, 1), shaft[-1]
    start, delay = ekf.initial({"q": 0.1, "q_dot": 1.0}), 2
    late = cc.DelayedFilter(ekf, start, dt=DT, delay=delay, p={"gust": 0.3}, compiled=False)
    for k, (_, u, _) in enumerate(rows):
        late.take(rows[k - delay][2] if k >= delay else None, u)
    samples = [
        (DT * (k + 1), values[0], {"u": u[0], "p": [0.3]})
        for k, (_, u, values) in enumerate(rows[:-delay])
    ]
    *_, last = cc.run_ekf(ekf, start, samples)
    state, factor = last.state, last.factor
    for _, u, _ in rows[-delay:]:
        state, factor = ekf.predict(state, factor, DT, u[0], [0.3])
    np.testing.assert_allclose(late.present()[0], np.array(state).ravel(), rtol=1e-12)


def test_mistakes_are_named(shaft):
    beam, _, sensors, ekf = shaft
    start = ekf.initial({"q": 0.1, "q_dot": 1.0})
    plain = cc.shape_ekf(beam, sensors, process="white_acceleration", density=1.0)
    for mistake, words in (
        (lambda: cc.DelayedFilter(plain, start, dt=DT), "ekf: expected a filter on a control"),
        (lambda: cc.DelayedFilter(ekf, None, dt=DT), "start: expected an Estimate"),
        (lambda: cc.DelayedFilter(ekf, start, dt=0), "dt: expected a number above zero"),
        (lambda: cc.DelayedFilter(ekf, start, dt=DT, delay=-1, p=[0]), "delay: expected"),
        (lambda: cc.DelayedFilter(ekf, start, dt=DT, p=[1, 2]), r"p: expected shape \(1,\)"),
        (lambda: cc.DelayedFilter(ekf, start, dt=DT), r"p: expected gust \(SI\), which the model"),
        (lambda: cc.DelayedFilter(ekf, start, dt=DT, p=[]), r"p: expected shape \(1,\)"),
    ):
        with pytest.raises(ValueError, match=words):
            mistake()
    late = cc.DelayedFilter(ekf, start, dt=DT, p=[0.0], compiled=False)
    with pytest.raises(ValueError, match=r"u: expected shape \(1, 1\)"):
        late.take(None, [0.0, 0.0])
    with pytest.raises(ValueError, match=r"samples: expected shape \(1, 4\)"):
        late.take(np.zeros((1, 3)), [[0.0]])


def test_arrays_that_are_no_readings_change_nothing(shaft):
    ekf = shaft[-1]
    late = cc.DelayedFilter(
        ekf, ekf.initial({"q": 0.1, "q_dot": 1.0}), dt=DT, p=[0.3], compiled=False
    )
    late.take(np.full((1, 4), 0.01), [[0.1]])
    before = late.present()
    for samples, u, words in (
        (np.zeros((1, 4)), [[np.nan]], "u: expected finite numbers"),
        (np.zeros((1, 4)), None, "u: expected numbers, found None"),
        ([[0.0, np.inf, 0.0, 0.0]], [[0.1]], r"samples\[0, 1\]: expected finite numbers or NaN"),
        (np.zeros((1, 3)), [[0.1]], r"samples: expected shape \(1, 4\)"),
    ):
        with pytest.raises(ValueError, match=words):
            late.take(samples, u)
    np.testing.assert_array_equal(late.present(), before)


@pytest.mark.parametrize("delay", [0, 2])
def test_none_after_the_first_samples_means_that_all_are_lost(shaft, delay):
    rows, ekf = history(shaft, 1), shaft[-1]
    filters = [
        cc.DelayedFilter(
            ekf, ekf.initial({"q": 0.1, "q_dot": 1.0}), dt=DT, delay=delay, p=[0.3], compiled=False
        )
        for _ in range(2)
    ]
    for lost, late in zip((None, np.full((1, 4), np.nan)), filters, strict=True):
        for k, (_, u, _) in enumerate(rows):
            values = rows[k - delay][2] if k >= delay else None
            late.take(lost if k in (9, 10, 20) else values, u)
    np.testing.assert_array_equal(filters[0].present(), filters[1].present())


def test_a_filter_on_a_model_without_inputs_takes_none():
    """A lane is `run_ekf`; steps beyond the stability of Runge-Kutta's method are refused."""
    beam = hale_wing(1, 2, 1, grid=cc.Grid.lobatto(3))
    gauges = [cc.StrainGauge(xi=0.1, offset=[0, 0.05], noise=1e-5)]
    ekf = cc.shape_ekf(beam, gauges, process=cc.beam_model(beam), density=0.1)
    start = ekf.initial({"q": 0.01, "q_dot": 0.1})
    late = cc.DelayedFilter(ekf, start, dt=DT, lanes=2, compiled=False)
    for value in (1e-5, -2e-5):
        late.take([[value], [0.0]], np.zeros((2, 0)))
    *_, last = cc.run_ekf(ekf, start, [(DT, [1e-5]), (2 * DT, [-2e-5])])
    np.testing.assert_allclose(late.present()[0], np.ravel(last.state), rtol=1e-9, atol=1e-15)
    with pytest.raises(ValueError, match="dt: steps of 10 s of Runge"):
        cc.DelayedFilter(ekf, start, dt=10.0, compiled=False)
