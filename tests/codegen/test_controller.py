"""The firmware's controller around functions whose statuses a script sets."""

from __future__ import annotations

from pathlib import Path

import pytest

from curvcasadi.symbolic.compiled import compile_c, run

FIRMWARE = Path(__file__).parents[2] / "codegen" / "firmware"
HEADER = """
#define CURV_EKF_UPDATE_N_STATE 1
#define CURV_EKF_UPDATE_N_FACTOR 1
#define CURV_EKF_UPDATE_N_MEASURED 1
#define CURV_MPC_N_U_PREVIOUS 1
#define CURV_MPC_N_GUESS 3
#define CURV_MPC_N_REFERENCE 1
typedef double curv_real;
typedef enum { CURV_OK, CURV_INFEASIBLE, CURV_NOT_CONVERGED, CURV_BAD_INPUT } curv_status;
typedef struct { curv_real state_after[1], factor_after[1], nis, dof; } curv_ekf_update_out;
typedef struct { curv_real state_after[1], factor_after[1]; } curv_ekf_predict_out;
typedef struct { curv_real x[1], p[1]; } curv_deviation_out;
typedef struct { curv_real u[1], plan[3], violation, stationarity; } curv_mpc_out;
curv_status curv_ekf_update(const curv_real *x, const curv_real *f, const curv_real *z,
                            const curv_real *u, curv_ekf_update_out *out);
curv_status curv_ekf_predict(const curv_real *x, const curv_real *f, curv_real h,
                             const curv_real *u, curv_ekf_predict_out *out);
curv_status curv_deviation(const curv_real *x, curv_deviation_out *out);
curv_status curv_mpc(const curv_real *x, const curv_real *p, const curv_real *u,
                     const curv_real *r, const curv_real *guess, curv_mpc_out *out);
"""
DATA = """
#define UPDATE_INPUTS applied,
#define PREDICT_INPUTS
static const curv_real controller_period = 0.1, controller_state[1] = {5}, controller_factor[1];
static const curv_real controller_trim[1] = {-1}, controller_reference[1];
"""
#: The state counts periods; the plan of an optimum at the state x is x, x + 0.1, x + 0.2, x + 0.3.
SCRIPT = """
#include <math.h>
#include <stdio.h>
#include "controller.h"
static curv_status optimum, prediction;
curv_status curv_ekf_update(const curv_real *x, const curv_real *f, const curv_real *z,
                            const curv_real *u, curv_ekf_update_out *out) {
  if (z[0] > 99) return CURV_BAD_INPUT;
  out->state_after[0] = x[0]; out->factor_after[0] = f[0]; out->nis = 2;
  out->dof = isnan(z[0]) ? 0 : 1;
  return CURV_OK;
}
curv_status curv_ekf_predict(const curv_real *x, const curv_real *f, curv_real h,
                             const curv_real *u, curv_ekf_predict_out *out) {
  if (prediction != CURV_OK) return prediction;
  out->state_after[0] = x[0] + 1; out->factor_after[0] = f[0];
  return CURV_OK;
}
curv_status curv_deviation(const curv_real *x, curv_deviation_out *out) {
  out->x[0] = x[0]; out->p[0] = 0;
  return CURV_OK;
}
curv_status curv_mpc(const curv_real *x, const curv_real *p, const curv_real *u,
                     const curv_real *r, const curv_real *guess, curv_mpc_out *out) {
  int k;
  if (optimum != CURV_OK) return optimum;
  out->u[0] = x[0]; out->violation = 0.5; out->stationarity = 0.25;
  for (k = 0; k < 3; ++k) out->plan[k] = x[0] + 0.1 * (k < 2 ? k + 1 : 2);
  return CURV_OK;
}
int main(void) {
  int z, control, predict;
  controller_start();
  printf("%d\\n", controller_is_healthy());
  while (scanf("%d %d %d", &z, &control, &predict) == 3) {
    curv_real measured = z < 0 ? NAN : z, u = 77;
    controller_source source;
    const controller_record *last;
    optimum = control; prediction = predict;
    source = controller_step(&measured, &u);
    last = controller_log(0);
    printf("%g %d %d %u %d %d %d %g\\n", u, source, controller_is_healthy(),
           (unsigned)last->period, last->update, last->control, last->predict, last->violation);
  }
  printf("%d %d\\n", controller_log(64) == NULL, controller_log(0)->late);
  controller_late();
  return 0;
}
"""


@pytest.fixture(scope="module")
def fly(tmp_path_factory):
    """Rows of what the controller did, from rows of sample, status of optimum and prediction."""
    folder = tmp_path_factory.mktemp("controller")
    for name, text in (("curv.h", HEADER), ("controller_data.h", DATA), ("script.c", SCRIPT)):
        (folder / name).write_text(text)
    sources = [FIRMWARE / "controller.c", "script.c"]
    options = ["-std=c99", "-O1", "-Wall", "-Wno-unused-parameter", f"-I{FIRMWARE}", "-I."]
    compile_c(sources, "script", options, folder=folder)

    def fly(rows):
        (folder / "in").write_text("".join(f"{z} {c} {p}\n" for z, c, p in rows))
        first, *lines, _ = run(["sh", "-c", "./script < in"], folder).splitlines()
        assert first == "0"  # nothing vouches for anything before the first period
        return [[float(x) for x in line.split()] for line in lines]

    return fly


SOLVED, PLANNED, TRIMMED = 0, 1, 2


def test_an_optimum_is_applied_and_logged(fly):
    found = fly([(0, 0, 0)] * 3)
    assert [row[0] for row in found] == [5, 6, 7]  # the state of the start, predicted
    assert [row[3] for row in found] == [0, 1, 2]
    assert all(row[1:3] == [SOLVED, 1] and row[4:] == [0, 0, 0, 0.5] for row in found)


def test_the_plan_is_applied_while_it_lasts_and_then_the_trimmed_input(fly):
    found = fly([(0, 0, 0), *[(0, 2, 0)] * 4, (0, 0, 0)])
    # Three stages: this period's and two that the optimum stands behind.
    assert [row[0] for row in found] == pytest.approx([5, 5.1, 5.2, -1, -1, 10])
    assert [row[1] for row in found] == [SOLVED, PLANNED, PLANNED, TRIMMED, TRIMMED, SOLVED]
    assert [row[2] for row in found] == [1, 1, 1, 0, 0, 1]


def test_without_samples_nothing_is_believed_after_a_while(fly):
    found = fly([(0, 0, 0), *[(-1, 0, 0)] * 12, (0, 0, 0)])
    assert [row[1] for row in found] == [*[SOLVED] * 11, TRIMMED, TRIMMED, SOLVED]
    assert [row[0] for row in found[-3:]] == [-1, -1, 18]


def test_a_refused_sample_leaves_the_predicted_state(fly):
    found = fly([(0, 0, 0), (100, 0, 0), (0, 0, 0)])
    assert [row[0] for row in found] == [5, 6, 7]
    assert found[1][4] == 3 and found[1][1] == SOLVED


def test_a_filter_that_fails_starts_again(fly):
    found = fly([(0, 0, 0), (0, 0, 3), (0, 0, 0)])
    assert [row[0] for row in found] == [5, 6, 5]
    assert found[1][6] == 3
