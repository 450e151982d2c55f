/* Instructions and stack of a call, on a Cortex-M that `qemu-system-arm -icount shift=1` emulates.

   There SysTick ticks once in 20 instructions: counts are instructions, not cycles, exact to a tick.
   As CHECK_HOOKS of the self-test this measures every call at a reference input. */
#ifndef MEASURE_H
#define MEASURE_H

#include <stdint.h>

#define CHECK_BEGIN measure_begin();
#define CHECK_END(name) measure_end();
#define CHECK_DONE(name) measure_print(name);

#define MEASURE_STACK_WORDS 16384 /* that are painted below the caller's frame: 64 KiB */
#define MEASURE_PAINT 0x5AFE57ACu

extern uint32_t *measure_top; /* stack pointer of the caller */

void measure_start(void);

/* Ends a measurement; returns its instructions. Its own frame of some 32 bytes counts as stack. */
uint32_t measure_end(void);

/* Prints the worst of the calls since the last print: `measured NAME instructions=N stack=BYTES`. */
void measure_print(const char *name);

/* Paints the stack below the caller's frame and starts to count. Inline: a frame of its own would
   lie in what it paints. */
static inline __attribute__((always_inline)) void measure_begin(void) {
  volatile uint32_t *word;
  __asm volatile("mov %0, sp" : "=r"(measure_top));
  for (word = measure_top; word > measure_top - MEASURE_STACK_WORDS;) *--word = MEASURE_PAINT;
  measure_start();
}

#endif
