"""Loops of sensors, filter, controller and actuators, on plants whose motion is known."""

import numpy as np
import pytest

import curvcasadi as cc

LAG = 0.1
TIMES = 0.05 * np.arange(21)


def integrator(x, u, p):
    """One of x' = u + p, which is exact; h = 0.05/substeps is the last parameter."""
    return x + p[:, 1:] * (u + p[:, :1])


def flown(control, substeps=10, drift=0.0, **options):
    lanes = np.array([[1.0], [-2.0]])
    arguments = {
        "actuators": cc.Actuators(lag=LAG),
        "p": lambda time: np.array([drift, 0.05 / substeps]),
        "u": [0.0],
        "substeps": substeps,
    }
    step = options.pop("step", integrator)
    return cc.closed_loop(step, lanes, control, TIMES, **arguments | options)


def test_inputs_follow_the_command_and_the_plant_its_inputs():
    errors = []
    for substeps in (2, 4):
        loop = flown(lambda time, x, u: np.ones((2, 1)), substeps, drift=0.5)
        np.testing.assert_allclose(loop.u[:, 0, 0], 1 - np.exp(-TIMES / LAG), atol=1e-14)
        exact = 1.5 * TIMES - LAG * (1 - np.exp(-TIMES / LAG))
        errors.append(np.abs(loop.x[:, :, 0] - [1.0, -2.0] - exact[:, None]).max())
    # The input of the middle of each step: second order.
    assert errors[0] < 1e-3 and errors[0] / errors[1] == pytest.approx(4, abs=0.1)
    np.testing.assert_array_equal(loop.t, TIMES)
    assert loop.p.shape == (21, 2, 2)


def test_commands_are_held_between_calls_and_know_the_state():
    called = []

    def control(time, x, u):
        called.append(time)
        return -x

    loop = flown(control, every=5)
    np.testing.assert_allclose(called, TIMES[::5])
    np.testing.assert_array_equal(loop.estimates[0], [[1.0], [-2.0]])
    np.testing.assert_array_equal(loop.estimates[7], loop.x[5])
    # Lanes do not know of each other, and the loop is linear.
    np.testing.assert_allclose(loop.x[:, 1], -2 * loop.x[:, 0], atol=1e-14)


def test_the_observer_is_given_what_arrives():
    class Watcher:
        def __init__(self):
            self.arrived = []

        def take(self, samples, u):
            self.arrived.append(samples)

        def present(self):
            return np.full((2, 3), 7.0)

    watcher = Watcher()
    loop = flown(
        lambda time, estimates, u: estimates[:, :1],
        read=lambda x, u, p: 10 * x,
        link=cc.SensorLink(noise=0.0, delay=3, seeds=(0, 1)),
        observer=watcher,
    )
    assert watcher.arrived[:3] == [None] * 3
    np.testing.assert_array_equal(watcher.arrived[3:], 10 * loop.x[:-3])
    assert np.all(loop.estimates == 7.0) and loop.u[-1, 0, 0] > 6.9


def test_what_is_not_finite_is_named_with_time_and_lane():
    def control(time, x, u):
        return np.where([[False], [time > 0.22]], np.nan, np.zeros((2, 1)))

    with pytest.raises(cc.ConvergenceError, match=r"command .* after 0.25 s, in lanes \[1\]") as e:
        flown(control)
    assert len(e.value.result.t) == 6
    with pytest.raises(cc.ConvergenceError, match=r"state is not finite after 0 s, .* \[0, 1\]"):
        flown(lambda time, x, u: u, step=lambda x, u, p: x + np.inf)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"substeps": 0}, "substeps: expected"),
        ({"every": 0}, "every: expected"),
        ({"u": np.zeros((3, 1))}, r"u: expected shape \(nu,\) or \(2, nu\), found \(3, 1\)"),
        ({"u": [0.0, 0.0]}, r"control: expected commands \(2, 2\), found \(2, 1\)"),
        ({"step": lambda x, u, p: x[:, 0]}, r"step: expected states \(2, 1\), found \(2,\)"),
        ({"actuators": None}, "actuators: expected an? Actuators"),
        ({"observer": object()}, "read: expected a function"),
        ({"p": np.zeros(2)}, "p: expected a function, found array"),
        ({"link": 3}, "link: expected a function, found 3"),
        ({"step": None}, "step: expected a function, found None"),
        ({"p": lambda time: [np.nan]}, "p: expected finite numbers"),
        ({"p": lambda time: np.zeros((3, 1))}, r"p: expected shape \(np,\) or \(2, np\)"),
    ],
)
def test_mistakes_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        flown(lambda time, x, u: 0 * u[:, :1], **options)


def test_uneven_times_are_refused():
    with pytest.raises(ValueError, match="times: expected at least two, evenly spaced"):
        cc.closed_loop(
            integrator,
            [[0.0]],
            lambda time, x, u: u,
            [0, 0.1, 0.3],
            substeps=1,
            actuators=cc.Actuators(lag=1),
            p=lambda time: [0.0, 0.1],
            u=[0.0],
        )
