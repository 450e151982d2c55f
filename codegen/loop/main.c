/* The controller in the loop with a plant on the host: a period for every set of samples.

   The link is the only part that a board replaces, by a serial line or a network: `receive` waits
   for the samples of a period, `send` returns what it computed. Here they are pipes, opened by
   semihosting. */
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "controller.h"
#include "measure.h"

typedef struct {
  curv_real u[CONTROLLER_INPUTS];
  curv_real nis, violation, stationarity;
  uint32_t update, control, predict, source, instructions, healthy;
} reply;

static int samples, results;

/* 1 with a whole set of samples; 0 at the end. */
static int receive(curv_real measured[CONTROLLER_SAMPLES]) {
  char *to = (char *)measured;
  size_t missing = CONTROLLER_SAMPLES * sizeof *measured;
  while (missing > 0) {
    const int count = (int)read(samples, to, missing);
    if (count <= 0) return 0;
    to += count;
    missing -= (size_t)count;
  }
  return 1;
}

static void send(const reply *answer) {
  if (write(results, answer, sizeof *answer) != (int)sizeof *answer) exit(EXIT_FAILURE);
}

int main(void) {
  static curv_real measured[CONTROLLER_SAMPLES];
  static reply answer;
  samples = open("samples", O_RDONLY);
  results = open("results", O_WRONLY);
  if (samples < 0 || results < 0) return EXIT_FAILURE;
  controller_start();
  while (receive(measured)) {
    const controller_record *record;
    memset(&answer, 0, sizeof answer);
    measure_begin();
    (void)controller_step(measured, answer.u);
    answer.instructions = measure_end();
    record = controller_log(0);
    answer.nis = record->nis;
    answer.violation = record->violation;
    answer.stationarity = record->stationarity;
    answer.update = record->update;
    answer.control = record->control;
    answer.predict = record->predict;
    answer.source = record->source;
    answer.healthy = (uint32_t)controller_is_healthy();
    send(&answer);
  }
  close(results);
  measure_print("period");
  return EXIT_SUCCESS;
}
