#include "measure.h"

#include <stdio.h>
#include <stdlib.h>

#define SYST_CSR (*(volatile uint32_t *)0xE000E010)
#define SYST_RVR (*(volatile uint32_t *)0xE000E014)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018)
#define ENABLE 7u          /* with its interrupt, from the clock of the CPU */
#define LAP 0x1000000u     /* ticks: the counter has 24 bits, down from LAP - 1 */
#define INSTRUCTIONS 20u   /* per tick */

uint32_t *measure_top;
static volatile uint32_t laps;
static uint32_t empty, most_instructions, most_stack;

void sys_tick(void) { ++laps; }

static void start(void) {
  SYST_RVR = LAP - 1;
  SYST_CVR = 0; /* reloaded at the next tick */
  laps = 0;
  SYST_CSR = ENABLE;
}

static uint32_t instructions(void) {
  uint32_t lap, ticks;
  do { /* again if a lap ended in between */
    lap = laps;
    ticks = (LAP - SYST_CVR) % LAP;
  } while (lap != laps);
  return (lap * LAP + ticks) * INSTRUCTIONS;
}

void measure_start(void) {
  start();
  empty = instructions();
  start();
}

uint32_t measure_end(void) {
  const uint32_t found = instructions() - empty;
  const uint32_t *word = measure_top - MEASURE_STACK_WORDS;
  uint32_t stack;
  SYST_CSR = 0;
  if (*word != MEASURE_PAINT) {
    printf("the stack is deeper than what is painted\n");
    exit(EXIT_FAILURE);
  }
  while (word < measure_top && *word == MEASURE_PAINT) ++word;
  stack = (uint32_t)((const char *)measure_top - (const char *)word);
  if (found > most_instructions) most_instructions = found;
  if (stack > most_stack) most_stack = stack;
  return found;
}

void measure_print(const char *name) {
  printf("measured %s instructions=%lu stack=%lu\n", name, (unsigned long)most_instructions,
         (unsigned long)most_stack);
  most_instructions = most_stack = 0;
}
