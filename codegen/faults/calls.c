/* Calls one exported function at inputs from a file, and watches what it does to `out`.

   calls FUNCTION COUNT EVERY INPUTS RESULTS    statuses, and the outputs of every EVERYth call
   calls FUNCTION COUNT threads INPUTS          two threads against one after the other

   INPUTS holds COUNT records, the inputs of a call one after another; RESULTS as many statuses, a
   byte each, between them the outputs. Prints the seconds that the slowest call took. Exit status 0,
   or 1 with a line that says what was wrong. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "curv.h"

enum { MOST_INPUTS = 8 };
typedef struct {
  const char *name;
  int inputs;
  size_t sizes[MOST_INPUTS]; /* curv_real */
  size_t out, work;          /* bytes */
  /* The form `_with` where there is `work`, otherwise the plain one. */
  curv_status (*call)(curv_real *const *in, void *work, void *out);
} function_case;
#include "cases.h"

#define UNTOUCHED 0xA5

static void fail(const char *what, long call) {
  fprintf(stderr, "call %ld: %s\n", call, what);
  exit(1);
}

/* Exactly `size` bytes, so that the sanitizer sees what lies beside them. */
static void *memory(size_t size) {
  void *block = malloc(size);
  if (!block) fail("no memory", 0);
  memset(block, UNTOUCHED, size);
  return block;
}

static int untouched(const void *block, size_t size) {
  const unsigned char *byte = block;
  while (size--) {
    if (*byte++ != UNTOUCHED) return 0;
  }
  return 1;
}

static void read_record(const function_case *f, curv_real **in, FILE *from, long call) {
  int k;
  for (k = 0; k < f->inputs; ++k) {
    if (fread(in[k], sizeof(curv_real), f->sizes[k], from) != f->sizes[k]) fail("no input", call);
  }
}

static void new_inputs(const function_case *f, curv_real **in) {
  int k;
  for (k = 0; k < f->inputs; ++k) in[k] = memory(f->sizes[k] * sizeof(curv_real));
}

static double processor_time(void) {
  struct timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static curv_status call(const function_case *f, curv_real **in, void *work, void *out) {
  curv_status status;
  memset(out, UNTOUCHED, f->out);
  if (work) memset(work, UNTOUCHED, f->work); /* nothing may hang on what was in the buffers */
  status = f->call(in, work, out);
  return status;
}

static void all_calls(const function_case *f, long count, long every, FILE *from, FILE *to) {
  curv_real *in[MOST_INPUTS];
  void *work = memory(f->work), *out = memory(f->out), *again = memory(f->out);
  double slowest = 0;
  long i;
  new_inputs(f, in);
  for (i = 0; i < count; ++i) {
    curv_status status;
    double taken;
    read_record(f, in, from, i);
    taken = -processor_time();
    status = call(f, in, i % 2 ? work : NULL, out);
    taken += processor_time();
    if (taken > slowest) slowest = taken;
    if (status != CURV_OK && !untouched(out, f->out)) fail("wrote out in spite of status", i);
    if (i % 16 == 0 && (call(f, in, work, again) != status || memcmp(out, again, f->out))) {
      fail("the two forms differ", i);
    }
    fputc((int)status, to);
    if (i % every == 0) fwrite(out, 1, f->out, to);
  }
  printf("%.6f\n", slowest);
}

typedef struct {
  const function_case *f;
  long first, step, count;
  curv_real ***in;
  unsigned char *statuses, *outs;
} share;

static void *calls_of_a_thread(void *arguments) {
  const share *s = arguments;
  void *work = memory(s->f->work);
  long i;
  for (i = s->first; i < s->count; i += s->step) {
    s->statuses[i] = (unsigned char)call(s->f, s->in[i], work, s->outs + (size_t)i * s->f->out);
  }
  free(work);
  return NULL;
}

static share new_share(const function_case *f, long count, curv_real ***in) {
  share s = {f, 0, 1, count, in, NULL, NULL};
  s.statuses = memory((size_t)count);
  s.outs = memory((size_t)count * f->out);
  return s;
}

static void threads(const function_case *f, long count, FILE *from) {
  curv_real ***in = memory((size_t)count * sizeof *in);
  share alone, shares[2];
  pthread_t running[2];
  long i;
  for (i = 0; i < count; ++i) {
    in[i] = memory(MOST_INPUTS * sizeof *in[i]);
    new_inputs(f, in[i]);
    read_record(f, in[i], from, i);
  }
  alone = new_share(f, count, in);
  calls_of_a_thread(&alone);
  shares[0] = new_share(f, count, in);
  shares[0].step = 2;
  shares[1] = shares[0];
  shares[1].first = 1;
  for (i = 0; i < 2; ++i) {
    if (pthread_create(&running[i], NULL, calls_of_a_thread, &shares[i])) fail("no thread", i);
  }
  for (i = 0; i < 2; ++i) pthread_join(running[i], NULL);
  if (memcmp(alone.statuses, shares[0].statuses, (size_t)count) ||
      memcmp(alone.outs, shares[0].outs, (size_t)count * f->out)) {
    fail("two threads differ from one", count);
  }
}

int main(int argc, char **argv) {
  const size_t known = sizeof cases / sizeof *cases;
  const function_case *f = cases;
  FILE *from = argc > 4 ? fopen(argv[4], "rb") : NULL, *to;
  long count;
  if (!from) fail("expected FUNCTION COUNT EVERY|threads INPUTS [RESULTS]", 0);
  while (f < cases + known && strcmp(f->name, argv[1])) ++f;
  if (f == cases + known) fail("no such function", 0);
  count = atol(argv[2]);
  if (!strcmp(argv[3], "threads")) {
    threads(f, count, from);
    return 0;
  }
  to = argc > 5 ? fopen(argv[5], "wb") : NULL;
  if (!to) fail("no file for results", 0);
  all_calls(f, count, atol(argv[3]), from, to);
  fclose(to);
  return 0;
}
