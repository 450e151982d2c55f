#include "controller.h"

#include <stddef.h>
#include <string.h>

#include "controller_data.h"

#define INPUTS ((uint32_t)CONTROLLER_INPUTS)
#define STAGES ((uint32_t)CURV_MPC_N_GUESS / INPUTS)

static curv_real state[CURV_EKF_UPDATE_N_STATE];
static curv_real factor[CURV_EKF_UPDATE_N_FACTOR];
static curv_real applied[CONTROLLER_INPUTS];
static curv_real plan[CURV_MPC_N_GUESS]; /* a stage a column, the first for the next period */
static uint32_t stages_left;             /* of the plan that an optimum stands behind */
static uint32_t blind;                   /* periods since the last estimate */
static uint32_t late;
static uint32_t periods;
static controller_record records[CONTROLLER_RECORDS];

static void trim(void) {
  uint32_t k;
  for (k = 0U; k < STAGES; ++k) {
    (void)memcpy(&plan[k * INPUTS], controller_trim, sizeof controller_trim);
  }
  stages_left = 0U;
}

void controller_start(void) {
  (void)memcpy(state, controller_state, sizeof state);
  (void)memcpy(factor, controller_factor, sizeof factor);
  (void)memcpy(applied, controller_trim, sizeof applied);
  (void)memset(records, 0, sizeof records);
  blind = 0U;
  late = 0U;
  periods = 0U;
  trim();
}

/* The state from the samples; the predicted one stays where there is no update. */
static void estimate(const curv_real measured[CONTROLLER_SAMPLES], controller_record *record) {
  static curv_ekf_update_out updated;
  record->update = curv_ekf_update(state, factor, measured, UPDATE_INPUTS &updated);
  if (record->update == CURV_OK) {
    (void)memcpy(state, updated.state_after, sizeof state);
    (void)memcpy(factor, updated.factor_after, sizeof factor);
    record->nis = updated.nis;
    blind = (updated.dof > 0) ? 0U : (blind + 1U);
  } else {
    blind += 1U;
  }
}

/* This period's optimum, from the estimate. */
static void optimize(controller_record *record) {
  static curv_mpc_out step;
  static curv_deviation_out deviation;
  record->control = curv_deviation(state, &deviation);
  if (record->control == CURV_OK) {
    record->control = curv_mpc(deviation.x, deviation.p, applied, controller_reference, plan, &step);
  }
  if (record->control == CURV_OK) {
    record->source = CONTROLLER_SOLVED;
    record->violation = step.violation;
    record->stationarity = step.stationarity;
    (void)memcpy(applied, step.u, sizeof applied);
    (void)memcpy(plan, step.plan, sizeof plan);
    stages_left = STAGES - 1U;
  }
}

/* The plan's next input; when it is used up, the trimmed one. */
static void fall_back(controller_record *record) {
  record->source = (stages_left > 0U) ? CONTROLLER_PLANNED : CONTROLLER_TRIMMED;
  (void)memcpy(applied, plan, sizeof applied);
  (void)memmove(plan, &plan[INPUTS], sizeof(plan) - sizeof(applied));
  if (stages_left > 1U) {
    stages_left -= 1U;
  } else {
    trim();
  }
}

/* The state at the next period; where there is none, the filter starts again. */
static void predict(controller_record *record) {
  static curv_ekf_predict_out predicted;
  record->predict = curv_ekf_predict(state, factor, controller_period, applied, PREDICT_INPUTS &predicted);
  if (record->predict == CURV_OK) {
    (void)memcpy(state, predicted.state_after, sizeof state);
    (void)memcpy(factor, predicted.factor_after, sizeof factor);
  } else {
    (void)memcpy(state, controller_state, sizeof state);
    (void)memcpy(factor, controller_factor, sizeof factor);
  }
}

controller_source controller_step(const curv_real measured[CONTROLLER_SAMPLES],
                                  curv_real u[CONTROLLER_INPUTS]) {
  controller_record *const record = &records[periods % CONTROLLER_RECORDS];
  (void)memset(record, 0, sizeof *record);
  record->period = periods;
  record->late = late;
  record->control = CURV_NOT_CONVERGED;
  record->source = CONTROLLER_TRIMMED;
  estimate(measured, record);
  if (blind > CONTROLLER_PATIENCE) {
    trim();
  } else {
    optimize(record);
  }
  if (record->control != CURV_OK) {
    fall_back(record);
  }
  (void)memcpy(u, applied, sizeof applied);
  predict(record);
  periods += 1U;
  return record->source;
}

void controller_late(void) { late += 1U; }

int controller_is_healthy(void) {
  const controller_record *const last = controller_log(0U);
  return (last != NULL) && (last->source != CONTROLLER_TRIMMED);
}

const controller_record *controller_log(uint32_t ago) {
  const controller_record *found = NULL;
  if ((ago < periods) && (ago < CONTROLLER_RECORDS)) {
    found = &records[(periods - 1U - ago) % CONTROLLER_RECORDS];
  }
  return found;
}
