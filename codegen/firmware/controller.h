/* The part of a flight program between its sensors and its actuators: estimate, optimize, fall back.

   A board calls controller_step once a period with the latest samples and applies what it returns,
   whatever it returns. Nothing is allocated, nothing waits, and the time is bounded by that of the
   exported functions. */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdint.h>

#include "curv.h"

#define CONTROLLER_INPUTS CURV_MPC_N_U_PREVIOUS
#define CONTROLLER_SAMPLES CURV_EKF_UPDATE_N_MEASURED
#define CONTROLLER_RECORDS 64U  /* periods that the log holds */
#define CONTROLLER_PATIENCE 10U /* periods without an estimate after which none is believed */

/* Where an input comes from, from the best to the last resort. */
typedef enum {
  CONTROLLER_SOLVED = 0,  /* this period's optimum */
  CONTROLLER_PLANNED = 1, /* what the last optimum planned for this period */
  CONTROLLER_TRIMMED = 2  /* the trimmed input: no plan is left, or nothing is known of the state */
} controller_source;

/* What a period vouches for. */
typedef struct {
  uint32_t period;
  curv_status update;
  curv_status control;
  curv_status predict;
  controller_source source;
  uint32_t late;          /* periods that the board reported as missed, so far */
  curv_real nis;          /* normalized innovation squared of the samples */
  curv_real violation;    /* of limits, over its tolerance: kept where at most 1 */
  curv_real stationarity; /* distance from optimality, over its tolerance */
} controller_record;

void controller_start(void);

/* One period: `measured` has NaN where a sample is missing; `u` is always written. */
controller_source controller_step(const curv_real measured[CONTROLLER_SAMPLES],
                                  curv_real u[CONTROLLER_INPUTS]);

/* The board tells that a period began before the one before had ended. */
void controller_late(void);

/* Whether the last period's input is fit to keep a watchdog quiet: solved, or planned for it. */
int controller_is_healthy(void);

/* The record of `ago` periods ago, 0 the last; NULL where the log holds none. */
const controller_record *controller_log(uint32_t ago);

#endif
