"""Shape filters as C: what the header says, statuses, and samples that are missing or wrong."""

from __future__ import annotations

import subprocess
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from codegen import benchmark_functions
from curvcasadi.estimation import ud
from tests.support import oracle

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror")
#: Largest error of an update in C, in standard deviations of what it estimates: the rounding of an
#: attitude, 1e-16 or 6e-8 of 1, over its noise of 1e-2 rad, in some tens of operations.
TOLERANCE = {"double": 1e-12, "float": 1e-4}
TYPES = {"double": np.float64, "float": np.float32}
OK, BAD_INPUT = 0, 3
SENSORS = (
    cc.AttitudeSensor(xi=1.0, noise=0.01),
    cc.RateGyro(xi=0.7, noise_density=1e-3, rate=100),
)

#: Reads calls, a line each: 0 for a prediction or 1 for an update, and its inputs. Prints the
#: status, whether the outputs are as they were before, and the outputs.
PROGRAM = """\
#include <stdio.h>
#include <string.h>
#include "curv.h"
enum {
  X = CURV_EKF_PREDICT_N_STATE,
  P = CURV_EKF_PREDICT_N_FACTOR,
  M = CURV_EKF_UPDATE_N_MEASURED
};
static void show(const void *out, size_t size) {
  const unsigned char *bytes = out;
  const curv_real *numbers = out;
  size_t i;
  for (i = 0; i < size && bytes[i] == 0x5A; ++i) {}
  printf(" %d", i == size);
  for (i = 0; i < size / sizeof(curv_real); ++i) printf(" %.17g", (double)numbers[i]);
  printf("\\n");
}
int main(void) {
  static curv_ekf_predict_out predicted;
  static curv_ekf_update_out updated;
  curv_real in[X + P + M];
  double number;
  int update, i;
  while (scanf("%d", &update) == 1) {
    for (i = 0; i < X + P + (update ? M : 1); ++i) {
      if (scanf("%lf", &number) != 1) return 1;
      in[i] = (curv_real)number;
    }
    memset(&predicted, 0x5A, sizeof predicted);
    memset(&updated, 0x5A, sizeof updated);
    printf("%d", (int)(update ? curv_ekf_update(in, in + X, in + X + P, &updated)
                              : curv_ekf_predict(in, in + X, in[X + P], &predicted)));
    if (update) show(&updated, sizeof updated);
    else show(&predicted, sizeof predicted);
  }
  return 0;
}
"""


class Exported(NamedTuple):
    """A filter of a tip with an attitude sensor and a gyro, and a program that calls its C."""

    ekf: cc.ShapeEkf
    start: cc.Estimate
    program: str
    real: str

    def given(self, last):
        """Start and last argument as numbers of the precision; of the factor what is not zero."""
        factor = self.start.factor.T[np.tril_indices(len(self.start.factor))]  # by columns
        with np.errstate(over="ignore"):
            numbers = np.concatenate([self.start.state, factor, np.ravel(last)])
            return numbers.astype(TYPES[self.real]).astype(float)

    def called(self, update, last):
        """Status of a call in C, and its outputs by name where it is OK."""
        line = " ".join(map(repr, self.given(last).tolist()))
        text = f"{int(update)} {line}"
        done = subprocess.run(
            [self.program], input=text, capture_output=True, text=True, check=True
        )
        status, untouched, *numbers = map(float, done.stdout.split())
        assert untouched == (status != OK)
        return int(status), self._outputs(update, np.array(numbers)) if status == OK else None

    def checked(self, update, last):
        """Outputs of a call in C, which are those of Python in double from the same numbers."""
        status, found = self.called(update, last)
        assert status == OK
        f = self._function(update)
        ends = np.cumsum([f.nnz_in(i) for i in range(f.n_in())])
        parts = np.split(self.given(last), ends[:-1])
        outputs = f.call([ca.DM(f.sparsity_in(i), part) for i, part in enumerate(parts)])
        expected = self._outputs(update, np.concatenate([x.nonzeros() for x in outputs]))
        deviations = np.sqrt(np.diag(expected["covariance"]))
        scales = {"state_after": deviations, "covariance": np.outer(deviations, deviations)}
        assert set(found) == set(expected)
        for name, value in expected.items():
            scale = scales.get(name, np.maximum(1, np.abs(value)))
            error = (found[name] - value) / scale
            assert_allclose(error, 0, atol=TOLERANCE[self.real], err_msg=name)
        return found

    def _function(self, update):
        return self.ekf.update if update else self.ekf.predict

    def _outputs(self, update, numbers):
        f = self._function(update)
        ends = np.cumsum([f.nnz_out(i) for i in range(f.n_out())])
        found = dict(zip(f.name_out(), np.split(numbers, ends[:-1]), strict=True))
        factor = ca.DM(f.sparsity_out("factor_after"), found.pop("factor_after"))
        return {**found, "covariance": ud.covariance_of(factor.full())}


def export(real, folder, sensors, measured):
    """A filter from a bent wing in motion, compiled; `measured` is a sample to test its C with."""
    beam = cc.Beam(
        length=4.0,
        basis=cc.ChannelBasis(torsion=cc.Legendre(1), out_of_plane=cc.Legendre(2)),
        grid=cc.Grid.uniform(4, real=real),
    )
    ekf = cc.shape_ekf(beam, sensors, process="white_acceleration", density=0.1)
    start = ekf.initial(
        {"q": 0.01, "q_dot": 0.1}, {"q": [0.02, -0.03, 0.01], "q_dot": [0.1, 0.2, -0.1]}
    )
    steps = [
        cc.CFunction(function=ekf.predict, descriptions=ekf.descriptions["predict"]),
        cc.CFunction(
            function=ekf.update, descriptions=ekf.descriptions["update"], missing=("measured",)
        ),
    ]
    at = start.state, start.factor
    samples = {"ekf_predict": [(*at, 0.01)], "ekf_update": [(*at, measured)]}
    cc.export_c(steps, folder, real=real, reference_inputs=samples)
    (folder / "program.c").write_text(PROGRAM)
    sources = ("program.c", "curv.c", "curv_functions.c")
    command = ["gcc", *STRICT, "-Wno-unused-parameter", "-Wno-unused-function", *sources]
    subprocess.run([*command, "-o", "program", "-lm"], cwd=folder, check=True)
    return Exported(ekf, start, str(folder / "program"), real)


@pytest.fixture(scope="module", params=["double", "float"])
def exported(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(f"ekf_{request.param}")
    return export(request.param, folder, SENSORS, [*np.eye(3).ravel(), 0.0, 0.0, 0.0])


def read(exported, turn=(0.01, -0.005, 0.008)):
    """What the sensors read at the start, the attitude turned and the gyro off by some noise."""
    q, q_dot = (exported.ekf.part(exported.start, key) for key in ("q", "q_dot"))
    values = cc.measure(SENSORS, exported.ekf.beam, q, q_dot).values.full()[:, 0]
    values[:9] = (values[:9].reshape(3, 3).T @ oracle.rotation(turn)).T.ravel()
    values[9:] += (0.02, 0.05, -0.03)
    return values


def test_the_measured_filter_says_units_of_all_its_arguments():
    [library] = [x for x in benchmark_functions.LIBRARIES if x.name == "ekf"]
    for step in library.functions(library.beam):
        for name in (*step.function.name_in(), *step.function.name_out()):
            assert step.words(name), name
        assert step.words("state") == "q (6) rad/m, q_dot (6) rad/(m s)"


# Predictions -----------------------------------------------------------------------------------


@pytest.mark.parametrize("dt", [0.0, 0.01, 10.0])
def test_predictions_are_those_of_python(exported, dt):
    exported.checked(False, dt)


@pytest.mark.parametrize("dt", [-1e-3, -1.0, -1e30, np.nan, np.inf, -np.inf])
def test_a_step_back_in_time_is_bad_input(exported, dt):
    assert exported.called(False, dt) == (BAD_INPUT, None)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_state_or_covariance_that_is_not_finite_is_bad_input(exported, bad):
    state, factor = exported.start.state.copy(), exported.start.factor.copy()
    state[2] = factor[1, 4] = bad
    for field in ({"state": state}, {"factor": factor}):
        spoiled = exported._replace(start=exported.start._replace(**field))
        for update, last in ((False, 0.01), (True, read(exported))):
            assert spoiled.called(update, last) == (BAD_INPUT, None)


# Updates ---------------------------------------------------------------------------------------


def lost(exported, rows):
    """Outputs of an update without some of its values."""
    values = read(exported)
    values[rows] = np.nan
    return exported.checked(True, values)


def test_updates_are_those_of_python(exported):
    found = exported.checked(True, read(exported))
    assert_allclose(found["used"], np.ones(6), rtol=0)


def test_missing_samples_change_nothing(exported):
    before, after = exported.checked(False, 0.0), lost(exported, slice(None))
    for name, value in before.items():
        assert_allclose(after[name], value, rtol=1e-6)  # a product of a factor in single precision
    for name in ("innovation", "used", "nis", "dof"):
        assert not np.any(after[name]), name


@pytest.mark.parametrize("entry", [0, 5, 10])
@pytest.mark.parametrize("bad", [np.inf, -np.inf])
def test_samples_that_are_infinite_are_bad_input(exported, entry, bad):
    values = read(exported)
    values[entry] = bad
    assert exported.called(True, values) == (BAD_INPUT, None)


def assert_as_if_missing(found, expected, rows):
    """Rows of an outlier are not used, and all else is as without them, by the same arithmetic."""
    assert_allclose(np.flatnonzero(found["used"] == 0), rows, rtol=0)
    assert np.abs(found["innovation"][rows]).max() > 5  # the gate
    for name in ("state_after", "covariance", "used", "nis", "dof"):
        assert_allclose(found[name], expected[name], rtol=0, err_msg=name)


@pytest.mark.parametrize("size", [3.0, 1e10, 1e20, 1e30, 1e38])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_wrong_sample_is_as_if_it_was_missing(exported, size, sign):
    """Up to what a flipped bit of an exponent makes of a reading."""
    values = read(exported)
    values[10] = sign * size
    assert_as_if_missing(exported.checked(True, values), lost(exported, [10]), [4])


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_outlier_about_one_axis_of_an_attitude_takes_its_other_rows_with_it(exported, axis):
    turn = np.zeros(3)
    turn[axis] = 1.0
    found = exported.checked(True, read(exported, turn))
    assert_as_if_missing(found, lost(exported, slice(9)), [0, 1, 2])
    assert np.abs(found["innovation"][:3]).min() < 5


@pytest.mark.parametrize(
    "dead",
    [np.zeros(9), np.ones(9), -np.eye(3).ravel(), 1.02 * np.eye(3).ravel(), np.full(9, 1e38)],
    ids=["zeros", "ones", "reflection", "too long", "huge"],
)
def test_an_attitude_that_is_no_rotation_is_missing(exported, dead):
    values = read(exported)
    values[:9] = dead
    found, expected = exported.checked(True, values), lost(exported, slice(9))
    assert_allclose(found["used"], [0, 0, 0, 1, 1, 1], rtol=0)
    for name, value in expected.items():
        assert_allclose(found[name], value, rtol=0, err_msg=name)  # the same arithmetic


@pytest.mark.parametrize("real", ["double", "float"])
def test_a_camera_uses_what_it_sees_and_nothing_else(tmp_path, real):
    below, above = (
        cc.Camera(xi=1.0, noise=0.01, pose=cc.Pose(rotation=np.eye(3), position=[3.5, 0.5, z]))
        for z in (-5.0, 5.0)
    )
    exported = export(real, tmp_path, [below, above], np.full(4, 0.1))
    q = exported.ekf.part(exported.start, "q")
    seen = cc.measure([below], exported.ekf.beam, q).values.full()[:, 0] + [0.01, -0.005]
    found = exported.checked(True, [*seen, 0.1, 0.2])
    assert_allclose(found["used"], [1, 1, 0, 0], rtol=0)
    expected = exported.checked(True, [*seen, np.nan, np.nan])
    for name, value in expected.items():
        assert_allclose(found[name], value, rtol=0, err_msg=name)  # the same arithmetic
