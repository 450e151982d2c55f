"""Objects with defaults in place of keyword arguments give the same Functions."""

import numpy as np
import pytest

import curvcasadi as cc

ROD = cc.Beam(
    length=2.0,
    basis=cc.ChannelBasis(out_of_plane=cc.Legendre(2)),
    grid=cc.Grid.uniform(4),
    weight_bounds=0.6,
)
SENSORS = [
    cc.StrainGauge(xi=0.1, offset=(0.0, 0.01), noise=1e-5),
    cc.RateGyro(xi=1.0, noise_density=1e-3, rate=100.0),
]
NUMBERS = {"density": 0.1, "rate": 0.2}


def steps(**options):
    """The Functions of a moving-horizon estimator, an MPC step and a shape target."""
    model = cc.kinematic_model(ROD, time_constant=0.3)
    targets = [cc.Target(xi=1, position=[2, 0, 0], weight=1.0)]
    mhe = cc.shape_mhe(ROD, SENSORS, dt=0.1, window=1, process="random_walk", **NUMBERS, **options)
    return [
        mhe.step,
        cc.tip_path_step_function(model, dt=0.1, horizon=1, attitude_weight=0.0, **options),
        cc.shape_target_function(ROD, targets, **options),
    ]


def test_solver_settings_are_the_keyword_arguments():
    options = {"iterations": 2, "max_iter": 7, "qp_solver": "qrqp"}
    single = steps(**options)
    together = steps(settings=cc.SqpSettings(**options))
    for one, other in zip(single, together, strict=True):
        assert one.serialize() == other.serialize()
    assert steps()[2].serialize() == steps(settings=cc.SqpSettings())[2].serialize()
    assert steps()[2].serialize() != single[2].serialize()


def test_settings_and_keyword_arguments_exclude_each_other():
    with pytest.raises(ValueError, match=r"settings: expected settings, or iterations, .* both"):
        steps(settings=cc.SqpSettings(), max_iter=7)
    with pytest.raises(ValueError, match="settings: expected a SqpSettings, found 'fast'"):
        steps(settings="fast")
    with pytest.raises(ValueError, match="iterations: expected a whole number of at least 1"):
        cc.SqpSettings(iterations=0)


PROCESSES = {
    "random_walk": (cc.RandomWalk(**NUMBERS), NUMBERS),
    "white_acceleration": (cc.WhiteAcceleration(density=0.1), {"density": 0.1}),
}


@pytest.mark.parametrize("name", PROCESSES)
def test_a_process_model_is_its_name_and_numbers(name):
    model, numbers = PROCESSES[name]
    by_name, by_object = (
        cc.shape_ekf(ROD, SENSORS, **given)
        for given in ({"process": name, **numbers}, {"process": model})
    )
    assert by_name.predict.serialize() == by_object.predict.serialize()
    assert by_name.update.serialize() == by_object.update.serialize()
    common = {"dt": 0.1, "window": 1}
    by_name, by_object = (
        cc.shape_mhe(ROD, SENSORS, **common, **given)
        for given in ({"process": name, **numbers}, {"process": model})
    )
    assert by_name.step.serialize() == by_object.step.serialize()


def test_a_process_model_holds_all_numbers():
    with pytest.raises(ValueError, match="density: expected None beside the process RandomWalk"):
        cc.shape_ekf(ROD, SENSORS, process=cc.RandomWalk(**NUMBERS), density=np.ones(2))
    with pytest.raises(ValueError, match="density: expected the density of the process noise"):
        cc.shape_ekf(ROD, SENSORS, process="random_walk", rate=0.2)
