/* From reset to main on a Cortex-M with a floating-point unit, and out again by semihosting: the exit
   status is that of main, and not 0 after a fault. */
#include <stdint.h>
#include <stdlib.h>

#define CPACR (*(volatile uint32_t *)0xE000ED88) /* access to coprocessors: 10 and 11 are the FPU */
#define ICSR (*(volatile uint32_t *)0xE000ED04)  /* lowest 9 bits: number of the exception */

/* Semihosting: zero-terminated text to the console; end of the program by an error. */
#define SYS_WRITE0 0x04
#define SYS_EXIT 0x18
#define RUN_TIME_ERROR 0x20023

extern uint32_t data_start, data_end, data_load, bss_start, bss_end, stack_top; /* linker script */
void initialise_monitor_handles(void);                                          /* newlib, rdimon */
int main(void);
void reset(void);
void sys_tick(void);

/* newlib calls these around constructors and destructors, which C has none of. */
void _init(void) {}
void _fini(void) {}

static void semihost(uint32_t operation, uintptr_t argument) {
  register uint32_t r0 __asm("r0") = operation;
  register uintptr_t r1 __asm("r1") = argument;
  __asm volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

void reset(void) {
  uint32_t *to;
  const uint32_t *from = &data_load;
  CPACR |= 0xFu << 20;
  __asm volatile("dsb\n isb" ::: "memory");
  for (to = &data_start; to < &data_end;) *to++ = *from++;
  for (to = &bss_start; to < &bss_end;) *to++ = 0;
  initialise_monitor_handles();
  exit(main());
}

static void fault(void) {
  static const char *const name[] = {"exception", "reset", "NMI",      "HardFault",
                                     "MemManage", "BusFault", "UsageFault"};
  const uint32_t number = ICSR & 0x1FF;
  semihost(SYS_WRITE0, (uintptr_t)name[number < sizeof name / sizeof *name ? number : 0]);
  semihost(SYS_WRITE0, (uintptr_t) ": the program is stopped\n");
  semihost(SYS_EXIT, RUN_TIME_ERROR);
  for (;;) {
  }
}

/* SysTick counts nothing unless a program defines `sys_tick`. */
__attribute__((weak)) void sys_tick(void) {}

typedef union {
  void *stack;
  void (*handler)(void);
} vector;

__attribute__((section(".vectors"), used)) static const vector vectors[16] = {
    {.stack = &stack_top}, {.handler = reset}, {.handler = fault}, {.handler = fault},
    {.handler = fault},    {.handler = fault}, {.handler = fault}, {.handler = fault},
    {.handler = fault},    {.handler = fault}, {.handler = fault}, {.handler = fault},
    {.handler = fault},    {.handler = fault}, {.handler = fault}, {.handler = sys_tick}};
