/* Arithmetic on as many wings at once as a vector register of this machine holds.

   LANES_REAL is the type of a lane. Every function here works on each lane alone, so a NaN or an
   infinity stays in its lane. Constants that depend on the type are in lanes::Constants. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

namespace lanes {

typedef LANES_REAL Real;
#if defined(__AVX512F__)
enum { BYTES = 64 };
#elif defined(__AVX__)
enum { BYTES = 32 };
#else
enum { BYTES = 16 };
#endif
enum { COUNT = BYTES / sizeof(Real) };

template <class> struct Integer;
template <> struct Integer<double> { typedef int64_t type; };
template <> struct Integer<float> { typedef int32_t type; };

typedef Real Values __attribute__((vector_size(BYTES)));
typedef Integer<Real>::type Mask __attribute__((vector_size(BYTES))); /* 0 or -1, or a number */

#define LANES_INLINE static inline __attribute__((always_inline))

/* What generated C takes for a number. */
struct alignas(BYTES) Number {
  Values v;
  Number() = default;
  constexpr Number(Values x) : v(x) {}
  constexpr Number(double x) : v(Values{} + (Real)x) {}
  constexpr Number(float x) : v(Values{} + (Real)x) {}
  constexpr Number(int x) : v(Values{} + (Real)x) {}
};

LANES_INLINE Number operator+(Number a, Number b) { return a.v + b.v; }
LANES_INLINE Number operator-(Number a, Number b) { return a.v - b.v; }
LANES_INLINE Number operator*(Number a, Number b) { return a.v * b.v; }
LANES_INLINE Number operator/(Number a, Number b) { return a.v / b.v; }
LANES_INLINE Number operator-(Number a) { return -a.v; }
LANES_INLINE Number &operator+=(Number &a, Number b) { a.v += b.v; return a; }
LANES_INLINE Number &operator-=(Number &a, Number b) { a.v -= b.v; return a; }
LANES_INLINE Number &operator*=(Number &a, Number b) { a.v *= b.v; return a; }
LANES_INLINE Number &operator/=(Number &a, Number b) { a.v /= b.v; return a; }

/* Selection. A NaN is true, as it is in C. */
LANES_INLINE Values choose(Mask on, Values a, Values b) { return on ? a : b; }
LANES_INLINE Number truth(Mask on) { return choose(on, Number(1).v, Number(0).v); }
LANES_INLINE Mask is(Number a) { return a.v != Number(0).v; }
LANES_INLINE Number operator<(Number a, Number b) { return truth(a.v < b.v); }
LANES_INLINE Number operator<=(Number a, Number b) { return truth(a.v <= b.v); }
LANES_INLINE Number operator==(Number a, Number b) { return truth(a.v == b.v); }
LANES_INLINE Number operator!=(Number a, Number b) { return truth(a.v != b.v); }
LANES_INLINE Number operator!(Number a) { return truth(a.v == Number(0).v); }
LANES_INLINE Number operator&&(Number a, Number b) { return truth(is(a) & is(b)); }
LANES_INLINE Number operator||(Number a, Number b) { return truth(is(a) | is(b)); }
LANES_INLINE Number if_else_zero(Number on, Number a) { return choose(is(on), a.v, Number(0).v); }

LANES_INLINE bool any(Mask on) {
  Integer<Real>::type found = 0;
  for (int l = 0; l < COUNT; ++l) found |= on[l];
  return found != 0;
}

/* Functions of a lane alone. */
LANES_INLINE Mask bits(Values a) { return (Mask)a; }
LANES_INLINE Mask sign_bit() { return bits(-Values{}); } /* of minus zero */
LANES_INLINE Values with_sign(Values size, Values sign) {
  return (Values)((bits(size) & ~sign_bit()) | (bits(sign) & sign_bit()));
}
LANES_INLINE Number sq(Number a) { return a.v * a.v; }
LANES_INLINE Number fabs(Number a) { return (Values)(bits(a.v) & ~sign_bit()); }
LANES_INLINE Number copysign(Number a, Number b) { return with_sign(a.v, b.v); }
LANES_INLINE Number fmax(Number a, Number b) {
  return choose((a.v >= b.v) | (b.v != b.v), a.v, b.v); /* the number where one is NaN */
}
LANES_INLINE Number fmin(Number a, Number b) {
  return choose((a.v <= b.v) | (b.v != b.v), a.v, b.v);
}
LANES_INLINE Number sign(Number a) {
  return choose(a.v < 0, Number(-1).v, choose(a.v > 0, Number(1).v, a.v));
}

/* Loops that the compiler turns into one instruction. */
#define LANES_EACH(name, call)                              \
  LANES_INLINE Number name(Number a) {                      \
    Number result;                                          \
    for (int l = 0; l < COUNT; ++l) result.v[l] = call(a.v[l]); \
    return result;                                          \
  }
LANES_EACH(sqrt, std::sqrt)
LANES_EACH(floor, std::floor)
LANES_EACH(ceil, std::ceil)
LANES_EACH(exp, std::exp) /* of libm: no loop over time steps or stations calls it */

template <int N> LANES_INLINE Values polynomial(const Real (&c)[N], Values x) {
  Values sum = Values{} + c[0];
  for (int k = 1; k < N; ++k) sum = sum * x + c[k];
  return sum;
}

template <class> struct Constants;

/* Coefficients of the Cephes library (S. L. Moshier): atan(z)/z - 1 over z², sin and cos on
   |x| <= pi/4. pi/2 is the sum of `half_pi`, of which all but the last have spare trailing zeros:
   k times each is exact for |k| below 2^20 in double and 2^8 in float. */
template <> struct Constants<double> {
  static constexpr double atan_above[] = {-8.750608600031904122785e-1, -1.615753718733365076637e1,
      -7.500855792314704667340e1, -1.228866684490136173410e2, -6.485021904942025371773e1};
  static constexpr double atan_below[] = {1.0, 2.485846490142306297962e1, 1.650270098316988542046e2,
      4.328810604912902668951e2, 4.853903996359136964868e2, 1.945506571482613964425e2};
  static constexpr double sine[] = {1.58962301576546568060e-10, -2.50507477628578072866e-8,
      2.75573136213857245213e-6, -1.98412698295895385996e-4, 8.33333333332211858878e-3,
      -1.66666666666666307295e-1};
  static constexpr double cosine[] = {-1.13585365213876817300e-11, 2.08757008419747316778e-9,
      -2.75573141792967388112e-7, 2.48015872888517045348e-5, -1.38888888888730564116e-3,
      4.16666666666665929218e-2};
  static constexpr double half_pi[] = {1.57079632673412561417e+00, 6.07710050630396597660e-11,
      2.02226624879595063154e-21};
  static constexpr double largest_angle = 1e6;
};
template <> struct Constants<float> {
  static constexpr float atan_above[] = {8.05374449538e-2f, -1.38776856032e-1f, 1.99777106478e-1f,
      -3.33329491539e-1f};
  static constexpr float atan_below[] = {1.0f};
  static constexpr float sine[] = {-1.9515295891e-4f, 8.3321608736e-3f, -1.6666654611e-1f};
  static constexpr float cosine[] = {2.443315711809948e-5f, -1.388731625493765e-3f,
      4.166664568298827e-2f};
  static constexpr float half_pi[] = {1.5703125f, 4.837512969970703125e-4f,
      7.54978995489188216e-8f};
  static constexpr float largest_angle = 256.0f;
};
typedef Constants<Real> C;

/* The angle of (x, y), as in C: signed zeros, infinities and NaN included. Reduced to
   atan(t), |t| <= tan(pi/8), by atan(t) = pi/4 + atan((t - 1)/(t + 1)). */
LANES_INLINE Number atan2(Number y, Number x) {
  const Values pi = Number(3.14159265358979323846).v;
  const Values ay = fabs(y).v, ax = fabs(x).v;
  const Values low = fmin(ay, ax).v, high = fmax(ay, ax).v;
  const Mask steep = ay > ax;
  const Mask large = low > high * (Real)0.41421356237309504880;
  /* (low - high)/(low + high) beyond pi/8; both halved, so that their sum is finite */
  const Values half_low = (Real)0.5 * low, half_high = (Real)0.5 * high;
  Values t = choose(large, half_low - half_high, low) / choose(large, half_low + half_high, high);
  const Mask same = low == high; /* both zero, or both infinite */
  t = choose(same, Values{}, t);
  const Values z = t * t;
  Values angle = t + t * z * (polynomial(C::atan_above, z) / polynomial(C::atan_below, z));
  const Mask eighth = large | (same & (high > 0));
  angle = angle + choose(eighth, (Real)0.25 * pi, Values{});
  angle = choose(steep, (Real)0.5 * pi - angle, angle);
  angle = choose(bits(x.v) < 0, pi - angle, angle);
  angle = choose((x.v != x.v) | (y.v != y.v), x.v + y.v, angle);
  return choose(angle != angle, angle, with_sign(angle, y.v));
}

/* Sine or cosine: the quadrant, and what is left of the angle within it. Where a lane is too large
   for that, or no number, all take the function of libm. */
LANES_INLINE Number turned(Number a, Integer<Real>::type quarters, Real (*scalar)(Real)) {
  const Values x = a.v;
  if (__builtin_expect(any(~(fabs(a).v <= C::largest_angle)), 0)) {
    Number result;
    for (int l = 0; l < COUNT; ++l) result.v[l] = scalar(x[l]);
    return result;
  }
  const Values k = floor(x * (Real)0.63661977236758134308 + (Real)0.5).v;
  const Values r = ((x - k * C::half_pi[0]) - k * C::half_pi[1]) - k * C::half_pi[2];
  const Values z = r * r;
  const Values s = r + r * z * polynomial(C::sine, z);
  const Values c = (1 - (Real)0.5 * z) + z * z * polynomial(C::cosine, z);
  const Mask quadrant = __builtin_convertvector(k, Mask) + quarters;
  const Values value = choose((quadrant & 1) != 0, c, s);
  return choose((quadrant & 2) != 0, -value, value);
}
LANES_INLINE Number sin(Number a) { return turned(a, 0, std::sin); }
LANES_INLINE Number cos(Number a) { return turned(a, 1, std::cos); }
LANES_INLINE Number tan(Number a) { return sin(a) / cos(a); }
LANES_INLINE Number atan(Number a) { return atan2(a, 1); }
LANES_INLINE Number asin(Number a) { return atan2(a, sqrt((1 - a) * (1 + a))); }
LANES_INLINE Number acos(Number a) { return atan2(sqrt((1 - a) * (1 + a)), a); }

/* One of two functions for each lane: both where lanes differ, each into memory of its own. */
typedef int Part(const Number **, Number **, int *, Number *, int);
template <int... SIZES>
static int either(Number condition, Part yes, Part no, const Number **arg, Number **res, int *iw,
                  Number *w) {
  const Mask on = fabs(condition).v >= 1; /* what a whole number is made of it, not zero */
  if (!any(~on)) return yes(arg, res, iw, w, 0);
  if (!any(on)) return no(arg, res, iw, w, 0);
  constexpr int sizes[] = {SIZES..., 0};
  constexpr int outputs = sizeof...(SIZES);
  Number values[(SIZES + ... + 1)], *other[outputs + 1], *next = values;
  for (int i = 0; i < outputs; ++i, next += sizes[i - 1]) other[i] = next;
  if (yes(arg, res, iw, w, 0) || no(arg, other, iw, w, 0)) return 1;
  for (int i = 0; i < outputs; ++i)
    for (int k = 0; res[i] && k < sizes[i]; ++k)
      res[i][k] = choose(on, res[i][k].v, other[i][k].v);
  return 0;
}

} /* namespace lanes */

using namespace lanes;
