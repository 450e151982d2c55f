/* A function of lanes over a batch in numpy's memory, in threads. */
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include <atomic>

enum { MOST_THREADS = 256 };

namespace {

/* What a call works on. Strides are in numbers: along the batch, rows, columns. */
struct Job {
  const Real *const *in;
  const ptrdiff_t (*in_strides)[3];
  Real *const *out;
  const ptrdiff_t (*out_strides)[3];
  ptrdiff_t size;
  std::atomic<ptrdiff_t> next;
  std::atomic<int> failed;
};

/* Numbers below the smallest normal one count as zero while this lives: they are many times slower. */
struct FlushToZero {
#if LANES_FLUSH && defined(__SSE__)
  unsigned before = __builtin_ia32_stmxcsr();
  FlushToZero() { __builtin_ia32_ldmxcsr(before | 0x8040); }
  ~FlushToZero() { __builtin_ia32_ldmxcsr(before); }
#elif LANES_FLUSH && defined(__aarch64__)
  uint64_t before;
  FlushToZero() {
    asm volatile("mrs %0, fpcr" : "=r"(before));
    asm volatile("msr fpcr, %0" : : "r"(before | (1 << 24)));
  }
  ~FlushToZero() { asm volatile("msr fpcr, %0" : : "r"(before)); }
#endif
};

/* Wings `begin` to `begin + count` of an input; lanes beyond them repeat the first. */
inline void load(Number *to, const Port &port, const Real *from, const ptrdiff_t *stride, int count) {
  for (int k = 0; k < port.nonzeros; ++k) {
    const Real *x = from + port.row[k] * stride[1] + port.column[k] * stride[2];
    if (count < COUNT) {
      for (int l = 0; l < COUNT; ++l) to[k].v[l] = x[(l < count ? l : 0) * stride[0]];
    } else if (stride[0] == 1) {
      memcpy(&to[k].v, x, sizeof(Values));
    } else {
      Values t;
#pragma GCC unroll 16
      for (int l = 0; l < COUNT; ++l) t[l] = x[l * stride[0]];
      to[k].v = t;
    }
  }
}

inline void store(Real *to, const Port &port, const Number *from, const ptrdiff_t *stride, int count) {
  if (stride[0] == 1) {
    for (int k = 0; k < port.nonzeros; ++k)
      memcpy(to + port.row[k] * stride[1] + port.column[k] * stride[2], &from[k].v,
                  count * sizeof(Real));
    return;
  }
  const Real *numbers = reinterpret_cast<const Real *>(from);
  for (int l = 0; l < count; ++l)
    for (int k = 0; k < port.nonzeros; ++k)
      to[l * stride[0] + port.row[k] * stride[1] + port.column[k] * stride[2]] =
          numbers[k * COUNT + l];
}

void *work(void *given_job) {
  Job *job = static_cast<Job *>(given_job);
  FlushToZero flush;
  Number *memory = static_cast<Number *>(aligned_alloc(BYTES, sizeof(Number) * MEMORY));
  if (!memory) {
    job->failed = 1;
    return nullptr;
  }
  const Number *arg[ARGUMENTS];
  Number *res[RESULTS];
  int iw[INTEGERS];
  Number *w = memory;
  Number *given[INPUTS + 1];
  for (int i = 0; i < INPUTS; ++i) {
    given[i] = w;
    w += inputs[i].nonzeros;
    for (int k = 0; k < inputs[i].nonzeros && !job->in_strides[i][0]; ++k)
      given[i][k] = Number(job->in[i][inputs[i].row[k] * job->in_strides[i][1] +
                                      inputs[i].column[k] * job->in_strides[i][2]]);
  }
  Number *made[OUTPUTS + 1];
  for (int i = 0; i < OUTPUTS; ++i) {
    made[i] = w;
    w += outputs[i].nonzeros;
  }
  const ptrdiff_t together = 8 * COUNT;
  for (;;) {
    const ptrdiff_t begin = job->next.fetch_add(together);
    if (begin >= job->size || job->failed) break;
    const ptrdiff_t end = begin + together < job->size ? begin + together : job->size;
    for (ptrdiff_t b = begin; b < end; b += COUNT) {
      const int count = end - b < COUNT ? (int)(end - b) : (int)COUNT;
      for (int i = 0; i < INPUTS; ++i) {
        const ptrdiff_t *stride = job->in_strides[i];
        if (stride[0]) load(given[i], inputs[i], job->in[i] + b * stride[0], stride, count);
        arg[i] = given[i];
      }
      for (int i = 0; i < OUTPUTS; ++i) res[i] = made[i];
      if (EVALUATE(arg, res, iw, w, 0)) job->failed = 1;
      for (int i = 0; i < OUTPUTS; ++i) {
        const ptrdiff_t *stride = job->out_strides[i];
        store(job->out[i] + b * stride[0], outputs[i], made[i], stride, count);
      }
    }
  }
  free(memory);
  return nullptr;
}

} /* namespace */

extern "C" int batch(const Real *const *in, const ptrdiff_t (*in_strides)[3], Real *const *out,
                     const ptrdiff_t (*out_strides)[3], ptrdiff_t size, int threads) {
  Job job = {in, in_strides, out, out_strides, size, {0}, {0}};
  pthread_t others[MOST_THREADS];
  int started = 0; /* where the system has no more threads, fewer do the same */
  while (started < threads - 1 && started < MOST_THREADS &&
         !pthread_create(&others[started], nullptr, work, &job))
    ++started;
  work(&job);
  for (int k = 0; k < started; ++k) pthread_join(others[k], nullptr);
  return job.failed;
}
