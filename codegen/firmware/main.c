/* A flight computer that keeps a wing tip on a path, 100 times a second.

   In a tick it takes the next pose of the path from a stream, computes tip pose and Jacobian from
   the measured weights, and by one real-time iteration of the tip-path MPC the input to apply. When
   the MPC vouches for nothing it holds the input that it applied before. Here the stream is a file,
   one pose a line, and the wing is the model: weights that follow their commands with a lag. Prints
   what it did, and fails unless the tip ends on its path. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "curv.h"
#include "measure.h"

#define N CURV_TIP_N_Q
#define POSE 12 /* numbers of a pose: position, rotation by columns */
#define STAGES (CURV_TIP_PATH_STEP_N_POSITIONS / 3)
#define SETTLED 0.01f /* m, to the path at the end */

/* Poses of the path at the ends of the stages of the MPC, and the oldest of them. */
static curv_real positions[3 * STAGES], rotations[9 * STAGES];

static curv_real q[N], q_dot[N], u[N], plan[CURV_TIP_PATH_STEP_N_GUESS];
static const curv_real no_disturbance[N];

/* The next pose of the stream becomes the last stage; numbers that are missing are NaN. 0: the end. */
static int receive(FILE *stream) {
  char line[256], *at = line;
  curv_real pose[POSE];
  int i;
  if (!fgets(line, sizeof line, stream)) return 0;
  for (i = 0; i < POSE; ++i) {
    char *end;
    pose[i] = strtof(at, &end);
    if (end == at) pose[i] = NAN;
    at = end;
  }
  memmove(positions, positions + 3, sizeof positions - 3 * sizeof *positions);
  memmove(rotations, rotations + 9, sizeof rotations - 9 * sizeof *rotations);
  memcpy(positions + 3 * (STAGES - 1), pose, 3 * sizeof *pose);
  memcpy(rotations + 9 * (STAGES - 1), pose + 3, 9 * sizeof *pose);
  return 1;
}

/* What a tick computes: the tip, and the next input unless the status says that there is none. */
static curv_status control(curv_tip_out *tip) {
  static curv_tip_path_step_out step;
  curv_status status = curv_tip(q, tip);
  if (status != CURV_OK) return status;
  status = curv_tip_path_step(q, no_disturbance, u, positions, rotations, plan, &step);
  if (status != CURV_OK) return status;
  memcpy(u, step.u, sizeof u);
  memcpy(plan, step.plan, sizeof plan);
  return CURV_OK;
}

/* The wing for one tick, and the rates that its sensors read at its end. */
static curv_status simulate(void) {
  static curv_kinematic_step_out next;
  const curv_status status = curv_kinematic_step(q, u, no_disturbance, &next);
  int i;
  if (status != CURV_OK) return status;
  for (i = 0; i < N; ++i) q_dot[i] = (next.x_next[i] - q[i]) / TICK;
  memcpy(q, next.x_next, sizeof q);
  return CURV_OK;
}

static curv_real norm(const curv_real x[3]) { return sqrtf(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]); }

/* Speed of the tip: the lower half of its twist J q_dot. */
static curv_real speed(const curv_tip_out *tip) {
  curv_real velocity[3] = {0, 0, 0};
  int i, j;
  for (j = 0; j < N; ++j) {
    for (i = 0; i < 3; ++i) velocity[i] += tip->jacobian[6 * j + 3 + i] * q_dot[j];
  }
  return norm(velocity);
}

int main(void) {
  static curv_tip_out tip;
  int counts[CURV_BAD_INPUT + 1] = {0}, ticks = 0, i;
  unsigned long worst = 0, instructions;
  curv_real goal[3], off = 0, fastest = 0;
  FILE *stream = fopen("path.txt", "r");
  if (!stream) {
    printf("path.txt is missing\n");
    return EXIT_FAILURE;
  }
  for (i = 0; i < STAGES - 1; ++i) receive(stream);
  while (receive(stream)) { /* waits for the timer where there is one */
    curv_status status;
    measure_begin();
    status = control(&tip);
    instructions = measure_end();
    ++counts[status];
    ++ticks;
    if (instructions > worst) worst = instructions;
    memcpy(goal, positions, sizeof goal);
    if (simulate() != CURV_OK || curv_tip(q, &tip) != CURV_OK) {
      printf("the wing left its model\n");
      return EXIT_FAILURE;
    }
    for (i = 0; i < 3; ++i) goal[i] -= tip.position[i];
    off = norm(goal);
    fastest = fmaxf(fastest, speed(&tip));
  }
  fclose(stream);
  printf("ticks %d, held %d: infeasible %d, not converged %d, bad input %d\n", ticks,
         ticks - counts[CURV_OK], counts[CURV_INFEASIBLE], counts[CURV_NOT_CONVERGED],
         counts[CURV_BAD_INPUT]);
  printf("tip: fastest %.2f m/s, at the end %.1e m from its path\n", (double)fastest, (double)off);
  printf("a tick: at most %lu instructions, %.0f million a second\n", worst,
         (double)worst / (double)TICK / 1e6);
  return off < SETTLED ? EXIT_SUCCESS : EXIT_FAILURE;
}
