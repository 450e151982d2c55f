/* Strictly convex quadratic programs

       min ½ x'Hx + g'x   subject to   lo <= (x, A x) <= up

   by the dual active-set method of Goldfarb and Idnani (Math. Programming 27, 1983), with two-sided
   limits, equalities (lo = up), sparse rows, a warm start by the set of active limits, and a bound on
   the number of changes of that set.

   With H = L L', the columns of J satisfy J'HJ = 1; the first q of them and the triangle R factor the
   normals N of the active limits: J'N = (R, 0)'. Solutions are corrected by residuals of the original
   numbers, and called solved only if those satisfy the optimality conditions; a program is called
   infeasible only with a proof in its own numbers. C99, nothing is allocated. */

typedef enum {
  QP_SOLVED = 0,     /* the optimality conditions hold within the tolerances */
  QP_INFEASIBLE = 1, /* proved: no x keeps all limits, even if each may be missed by `primal` */
  QP_LIMIT = 2,      /* neither, within the allowed changes or the precision of the numbers */
  QP_NOT_CONVEX = 3  /* H is not positive definite, or a number is not finite */
} qp_status;

typedef struct {
  int n, m;               /* unknowns, rows of A */
  const short *row, *col; /* rows of A, compressed: row[m + 1] begins, col[row[m]] columns */
  const qp_real *a;       /* entries of A, row by row */
  const qp_real *h, *g;   /* lower triangle of H by rows, packed; g */
  const qp_real *lo, *up; /* n + m limits of x and A x; none where beyond +-QP_NONE */
  qp_real reach;            /* of x where it has no limits, for a proof that none is feasible */
  qp_real primal;         /* a limit missed by less is met */
  qp_real dual;           /* stationarity and multipliers below are zero; over the largest H_ii */
  int max_changes;        /* of the active set */
} qp_problem;

#define QP_NONE ((qp_real)1e30)
#define QP_PACKED(n) ((n) * ((n) + 1) / 2)
#define QP_REALS(n) ((n) * (n) + QP_PACKED(n) + 5 * (n))
#define QP_RETRIES 4
#define QP_CORRECTIONS 6

typedef struct {
  const qp_problem *p;
  qp_real *j;       /* n columns of n */
  qp_real *r;       /* q columns, packed: column k has k + 1 entries */
  qp_real *x, *u;   /* solution, multipliers of the set: not below zero but of equalities */
  qp_real *d, *z;   /* J'a of the limit in question, direction of x */
  qp_real *t, *y;   /* R^-1 d, work */
  int *set;         /* the active limits, q of them */
  int *side;        /* -1 lower, 1 upper, 0 not active, QP_ASIDE left alone */
  qp_real largest;  /* of the diagonal of H */
  qp_real dependent; /* part of a normal's square below which the active ones span it */
  int q, changes, most_changes;
} qp_state;

#define QP_ASIDE 2

static qp_real qp_abs(qp_real a) { return a < 0 ? -a : a; }

static qp_real qp_dot(int n, const qp_real *a, const qp_real *b) {
  qp_real sum = 0;
  int i;
  for (i = 0; i < n; ++i) {
    sum += a[i] * b[i];
  }
  return sum;
}

static void qp_add(int n, qp_real f, const qp_real *a, qp_real *y) {
  int i;
  for (i = 0; i < n; ++i) {
    y[i] += f * a[i];
  }
}

static void qp_zero(int n, qp_real *y) {
  int i;
  for (i = 0; i < n; ++i) {
    y[i] = 0;
  }
}

/* Normal of limit i times y */
static qp_real qp_value(const qp_problem *p, int i, const qp_real *y) {
  qp_real sum = 0;
  int k;
  if (i < p->n) {
    return y[i];
  }
  for (k = p->row[i - p->n]; k < p->row[i - p->n + 1]; ++k) {
    sum += p->a[k] * y[p->col[k]];
  }
  return sum;
}

/* y += f (normal of limit i) */
static void qp_add_normal(const qp_problem *p, int i, qp_real f, qp_real *y) {
  int k;
  if (i < p->n) {
    y[i] += f;
  } else {
    for (k = p->row[i - p->n]; k < p->row[i - p->n + 1]; ++k) {
      y[p->col[k]] += f * p->a[k];
    }
  }
}

/* y += H x */
static void qp_add_hessian(const qp_problem *p, const qp_real *x, qp_real *y) {
  const qp_real *h = p->h;
  int i, k;
  for (i = 0; i < p->n; ++i) {
    qp_real sum = h[i] * x[i];
    for (k = 0; k < i; ++k) {
      sum += h[k] * x[k];
      y[k] += h[k] * x[i];
    }
    y[i] += sum;
    h += i + 1;
  }
}

static int qp_is_equality(const qp_problem *p, int i) { return p->lo[i] >= p->up[i]; }

/* By how much x, whose value is given, misses limit i; *side tells which one */
static qp_real qp_excess(const qp_problem *p, int i, qp_real value, int *side) {
  const qp_real below = p->lo[i] > -QP_NONE ? p->lo[i] - value : -QP_NONE;
  const qp_real above = p->up[i] < QP_NONE ? value - p->up[i] : -QP_NONE;
  *side = below > above ? -1 : 1;
  return below > above ? below : above;
}

/* Normals of active limits point to where they are kept: sign a'x >= sign limit */
static qp_real qp_sign(int side) { return side < 0 ? (qp_real)1 : (qp_real)-1; }

/* Of an equality whose limits cross by rounding, their mean */
static qp_real qp_limit(const qp_problem *p, int i, int side) {
  qp_real limit = side < 0 ? p->lo[i] : p->up[i];
  if (qp_is_equality(p, i)) {
    limit = p->lo[i] + (p->up[i] - p->lo[i]) / 2;
  }
  return limit;
}

static qp_real *qp_column(const qp_state *s, int k) { return s->r + QP_PACKED(k); }

static qp_real qp_largest_diagonal(const qp_problem *p) {
  qp_real largest = 0;
  int i;
  for (i = 0; i < p->n; ++i) {
    const qp_real diagonal = p->h[QP_PACKED(i) + i];
    largest = diagonal > largest ? diagonal : largest;
  }
  return largest;
}

/* L by rows, packed, with L L' = H + shift; 0 where that is not positive definite. What counts as none
   is relative to each diagonal entry: units of unknowns do not matter. */
static int qp_cholesky(const qp_problem *p, qp_real shift, qp_real *l) {
  int i, k, is_definite = 1;
  for (i = 0; i < p->n && is_definite; ++i) {
    const qp_real diagonal = p->h[QP_PACKED(i) + i] + shift;
    qp_real *li = l + QP_PACKED(i), rest;
    for (k = 0; k < i; ++k) {
      const qp_real *lk = l + QP_PACKED(k);
      li[k] = (p->h[QP_PACKED(i) + k] - qp_dot(k, li, lk)) / lk[k];
    }
    rest = diagonal - qp_dot(i, li, li);
    is_definite = rest > QP_EPS * diagonal;
    li[i] = is_definite ? QP_SQRT(rest) : 0;
  }
  return is_definite;
}

/* J = L'^-1; 0 where H is not positive definite */
static int qp_factor(qp_state *s) {
  const int n = s->p->n;
  const qp_real *l = s->r; /* free until limits are active */
  int i, k;
  s->largest = qp_largest_diagonal(s->p);
  if (!qp_cholesky(s->p, 0, s->r)) {
    return 0;
  }
  /* Row c of L^-1 is column c of J: (e_c - sum_k L_ck row_k) / L_cc */
  for (i = 0; i < n; ++i) {
    const qp_real *li = l + QP_PACKED(i);
    qp_real *j = s->j + i * n;
    qp_zero(n, j);
    for (k = 0; k < i; ++k) {
      qp_add(k + 1, -li[k], s->j + k * n, j);
    }
    j[i] = 1;
    for (k = 0; k <= i; ++k) {
      j[k] /= li[i];
    }
  }
  return 1;
}

/* d = J'a of the oriented normal a of limit i */
static void qp_project(qp_state *s, int i, int side) {
  const qp_problem *p = s->p;
  const int n = p->n;
  const qp_real sign = qp_sign(side);
  int k;
  for (k = 0; k < n; ++k) {
    s->d[k] = sign * qp_value(p, i, s->j + k * n);
  }
}

/* Whether d is that of a normal which the active ones do not span */
static int qp_is_independent(const qp_state *s) {
  const int n = s->p->n;
  const qp_real rest = qp_dot(n - s->q, s->d + s->q, s->d + s->q);
  return rest > s->dependent * qp_dot(n, s->d, s->d);
}

/* (a, b) turned to (length, 0): cosine, sine; squares of small numbers would underflow in float */
static qp_real qp_givens(qp_real a, qp_real b, qp_real *c, qp_real *s) {
  const qp_real x = qp_abs(a), y = qp_abs(b);
  const qp_real most = x > y ? x : y, least = x > y ? y : x;
  const qp_real length = most > 0 ? most * QP_SQRT(1 + (least / most) * (least / most)) : 0;
  *c = length > 0 ? a / length : 1;
  *s = length > 0 ? b / length : 0;
  return length;
}

static void qp_rotate(int n, qp_real *a, qp_real *b, qp_real c, qp_real s) {
  int i;
  for (i = 0; i < n; ++i) {
    const qp_real x = a[i], y = b[i];
    a[i] = c * x + s * y;
    b[i] = c * y - s * x;
  }
}

/* Limit i, of which d is known, becomes the last of the set */
static void qp_append(qp_state *s, int i, int side, qp_real multiplier) {
  const int n = s->p->n;
  qp_real *d = s->d, *column = qp_column(s, s->q), c, sine;
  int k;
  for (k = n - 1; k > s->q; --k) {
    if (d[k] < 0 || d[k] > 0) {
      d[k - 1] = qp_givens(d[k - 1], d[k], &c, &sine);
      qp_rotate(n, s->j + (k - 1) * n, s->j + k * n, c, sine);
    }
  }
  for (k = 0; k <= s->q; ++k) {
    column[k] = d[k];
  }
  s->u[s->q] = multiplier;
  s->set[s->q] = i;
  s->side[i] = side;
  ++s->q;
}

/* The limit at `place` of the set leaves it */
static void qp_drop(qp_state *s, int place) {
  const int n = s->p->n;
  qp_real *below = s->y; /* entries under the diagonal that the later columns now have */
  int k, c;
  s->side[s->set[place]] = 0;
  --s->q;
  for (c = place; c < s->q; ++c) {
    const qp_real *from = qp_column(s, c + 1);
    qp_real *to = qp_column(s, c);
    for (k = 0; k <= c; ++k) {
      to[k] = from[k];
    }
    below[c] = from[c + 1];
    s->u[c] = s->u[c + 1];
    s->set[c] = s->set[c + 1];
  }
  for (k = place; k < s->q; ++k) {
    qp_real *column = qp_column(s, k), cosine, sine;
    column[k] = qp_givens(column[k], below[k], &cosine, &sine);
    for (c = k + 1; c < s->q; ++c) {
      qp_real *other = qp_column(s, c);
      const qp_real x = other[k], y = other[k + 1];
      other[k] = cosine * x + sine * y;
      other[k + 1] = cosine * y - sine * x;
    }
    qp_rotate(n, s->j + k * n, s->j + (k + 1) * n, cosine, sine);
  }
}

/* y = R^-1 y */
static void qp_solve_triangle(const qp_state *s, qp_real *y) {
  int k;
  for (k = s->q - 1; k >= 0; --k) {
    const qp_real *column = qp_column(s, k);
    y[k] /= column[k];
    qp_add(k, -y[k], column, y);
  }
}

/* y = R'^-1 y */
static void qp_solve_transposed(const qp_state *s, qp_real *y) {
  int k;
  for (k = 0; k < s->q; ++k) {
    const qp_real *column = qp_column(s, k);
    y[k] = (y[k] - qp_dot(k, column, y)) / column[k];
  }
}

/* left = H x + g - N u */
static void qp_gradient(const qp_state *s, qp_real *left) {
  const qp_problem *p = s->p;
  int k;
  for (k = 0; k < p->n; ++k) {
    left[k] = p->g[k];
  }
  qp_add_hessian(p, s->x, left);
  for (k = 0; k < s->q; ++k) {
    qp_add_normal(p, s->set[k], -qp_sign(s->side[s->set[k]]) * s->u[k], left);
  }
}

/* Newton's step to the solution of the active set, from residuals of the program itself */
static void qp_correct(qp_state *s) {
  const qp_problem *p = s->p;
  const int n = p->n;
  qp_real *left = s->z, *y = s->t, *dx = s->y;
  int k;
  qp_gradient(s, left);
  for (k = 0; k < s->q; ++k) {
    const int i = s->set[k], side = s->side[i];
    y[k] = qp_sign(side) * (qp_limit(p, i, side) - qp_value(p, i, s->x));
  }
  qp_solve_transposed(s, y);
  for (k = s->q; k < n; ++k) {
    y[k] = -qp_dot(n, s->j + k * n, left);
  }
  qp_zero(n, dx);
  for (k = 0; k < n; ++k) {
    qp_add(n, y[k], s->j + k * n, dx);
  }
  /* N du = left + H dx, and J'HJ = 1 */
  for (k = 0; k < s->q; ++k) {
    y[k] += qp_dot(n, s->j + k * n, left);
  }
  qp_solve_triangle(s, y);
  qp_add(s->q, 1, y, s->u);
  qp_add(n, 1, dx, s->x);
}

/* Place of the lowest multiplier below -zero of a limit that is no equality, or -1 */
static int qp_lowest(const qp_state *s, qp_real zero) {
  qp_real least = -zero;
  int k, lowest = -1;
  for (k = 0; k < s->q; ++k) {
    if (s->u[k] < least && !qp_is_equality(s->p, s->set[k])) {
      least = s->u[k];
      lowest = k;
    }
  }
  return lowest;
}

/* The solution of the active set, less the limits that would have to pull */
static void qp_settle(qp_state *s) {
  int lowest;
  do {
    qp_correct(s);
    lowest = qp_lowest(s, 0);
    if (lowest >= 0) {
      qp_drop(s, lowest);
      ++s->changes;
    }
  } while (lowest >= 0);
}

/* The limit that is missed most, and its side; -1 if none is */
static int qp_worst(qp_state *s, int *side) {
  const qp_problem *p = s->p;
  qp_real most = p->primal / 2;
  int i, worst = -1, which;
  for (i = 0; i < p->n + p->m; ++i) {
    if (s->side[i] == 0) {
      const qp_real excess = qp_excess(p, i, qp_value(p, i, s->x), &which);
      if (excess > most) {
        most = excess;
        worst = i;
        *side = which;
      }
    }
  }
  return worst;
}

/* Whether the active limits, limit i and those of x exclude each other, with room for rounding and
   for a miss of `primal` of each: its oriented normal is N t + rest with t <= 0 but at equalities, so
   that a'x <= t'b + rest'x wherever they are kept, less than its limit. */
static int qp_excludes(qp_state *s, int i, int side) {
  const qp_problem *p = s->p;
  qp_real *rest = s->y;
  qp_real excess = qp_sign(side) * qp_limit(p, i, side), size = qp_abs(excess), slack = p->primal;
  int k;
  qp_zero(p->n, rest);
  qp_add_normal(p, i, qp_sign(side), rest);
  for (k = 0; k < s->q; ++k) {
    const int c = s->set[k];
    if (s->t[k] <= 0 || qp_is_equality(p, c)) {
      const qp_real f = qp_sign(s->side[c]) * s->t[k], part = f * qp_limit(p, c, s->side[c]);
      qp_add_normal(p, c, -f, rest);
      excess -= part;
      size += qp_abs(part);
      slack += p->primal * qp_abs(f);
    }
  }
  for (k = 0; k < p->n; ++k) {
    const qp_real limit = qp_limit(p, k, rest[k] > 0 ? 1 : -1);
    const qp_real most = qp_abs(limit) < QP_NONE ? limit : (rest[k] > 0 ? p->reach : -p->reach);
    excess -= rest[k] * most;
    size += qp_abs(rest[k] * most);
    slack += p->primal * qp_abs(rest[k]);
  }
  return excess > slack + 8 * QP_EPS * size;
}

/* Direction z of x, and t = R^-1 d, along which limit i is approached at the cost of the others;
   returns the step to it, or QP_NONE where the active limits span its normal */
static qp_real qp_direction(qp_state *s, int i, int side) {
  const qp_problem *p = s->p;
  const int n = p->n;
  qp_real step = QP_NONE;
  int k;
  qp_project(s, i, side);
  for (k = 0; k < s->q; ++k) {
    s->t[k] = s->d[k];
  }
  qp_solve_triangle(s, s->t);
  if (s->q < n && qp_is_independent(s)) {
    const qp_real rest = qp_dot(n - s->q, s->d + s->q, s->d + s->q);
    qp_zero(n, s->z);
    for (k = s->q; k < n; ++k) {
      qp_add(n, s->d[k], s->j + k * n, s->z);
    }
    step = qp_sign(side) * (qp_limit(p, i, side) - qp_value(p, i, s->x)) / rest;
    step = step > 0 ? step : 0;
  }
  return step;
}

/* The step at which the first multiplier of the set would fall below zero, and its place */
static qp_real qp_first_to_leave(const qp_state *s, int *leaving) {
  qp_real first = QP_NONE, largest = 0;
  int k;
  for (k = 0; k < s->q; ++k) {
    largest = qp_abs(s->t[k]) > largest ? qp_abs(s->t[k]) : largest;
  }
  for (k = 0; k < s->q; ++k) {
    if (s->t[k] > 4 * QP_EPS * largest && !qp_is_equality(s->p, s->set[k])) {
      const qp_real ratio = (s->u[k] > 0 ? s->u[k] : 0) / s->t[k];
      if (ratio < first) {
        first = ratio;
        *leaving = k;
      }
    }
  }
  return first;
}

typedef enum { QP_ACTIVE, QP_STUCK, QP_EXCLUDED, QP_EXHAUSTED } qp_entry;

/* Limit i becomes active; others leave for it. */
static qp_entry qp_enter(qp_state *s, int i, int side) {
  qp_real multiplier = 0;
  qp_entry entry = QP_EXHAUSTED;
  int is_done = 0;
  while (!is_done && s->changes < s->most_changes) {
    int leaving = -1;
    const qp_real full = qp_direction(s, i, side), partial = qp_first_to_leave(s, &leaving);
    const qp_real step = full < partial ? full : partial;
    ++s->changes;
    if (step >= QP_NONE) {
      entry = qp_excludes(s, i, side) ? QP_EXCLUDED : QP_STUCK;
      is_done = 1;
    } else {
      if (full < QP_NONE) {
        qp_add(s->p->n, step, s->z, s->x);
      }
      qp_add(s->q, -step, s->t, s->u);
      multiplier += step;
      if (full <= partial) {
        qp_append(s, i, side, multiplier);
        entry = QP_ACTIVE;
        is_done = 1;
      } else {
        qp_drop(s, leaving);
      }
    }
  }
  return entry;
}

/* Certificate: whether x and the multipliers `lam` (above zero at upper limits) satisfy the optimality
   conditions of the program within its tolerances and the rounding of their own terms. It uses the
   program's numbers and nothing else; `work` holds 2 n numbers. */
static int qp_is_optimal(const qp_problem *p, const qp_real *x, const qp_real *lam, qp_real *work) {
  const int n = p->n;
  const qp_real largest = qp_largest_diagonal(p);
  qp_real *left = work, *size = work + n;
  int i, k, side, is_optimal = 1;
  for (i = 0; i < n; ++i) {
    left[i] = p->g[i];
    size[i] = qp_abs(p->g[i]);
  }
  qp_add_hessian(p, x, left);
  for (i = 0; i < n; ++i) {
    for (k = 0; k <= i; ++k) {
      const qp_real h = qp_abs(p->h[QP_PACKED(i) + k]);
      size[i] += h * qp_abs(x[k]);
      size[k] += k < i ? h * qp_abs(x[i]) : 0;
    }
  }
  for (i = 0; i < n + p->m; ++i) {
    const qp_real value = qp_value(p, i, x), scaled = qp_abs(lam[i]) / largest;
    const qp_real excess = qp_excess(p, i, value, &side);
    const qp_real slack = lam[i] > 0 ? p->up[i] - value : value - p->lo[i];
    qp_add_normal(p, i, lam[i], left);
    if (i < n) {
      size[i] += qp_abs(lam[i]);
    } else {
      for (k = p->row[i - n]; k < p->row[i - n + 1]; ++k) {
        size[p->col[k]] += qp_abs(lam[i] * p->a[k]);
      }
    }
    /* written so that NaN is no optimum */
    is_optimal = is_optimal && excess <= p->primal;
    is_optimal = is_optimal && (scaled <= p->dual || slack <= p->primal);
  }
  for (i = 0; i < n; ++i) {
    is_optimal = is_optimal && qp_abs(left[i]) <= p->dual * largest + 4 * QP_EPS * size[i];
  }
  return is_optimal;
}

static void qp_multipliers(const qp_state *s, qp_real *lam) {
  int k;
  qp_zero(s->p->n + s->p->m, lam);
  for (k = 0; k < s->q; ++k) {
    const int i = s->set[k];
    lam[i] = -qp_sign(s->side[i]) * s->u[k];
  }
}

/* Corrections until the certificate holds, or a limit is missed or has to leave: 1 if certified */
static int qp_is_certified(qp_state *s, qp_real *lam) {
  int k, side, is_certified = 0;
  for (k = 0; k < QP_CORRECTIONS && !is_certified; ++k) {
    int lowest;
    qp_correct(s);
    lowest = qp_lowest(s, s->p->dual * s->largest);
    if (lowest >= 0) {
      qp_drop(s, lowest);
      ++s->changes;
      k = s->changes < s->most_changes ? -1 : QP_CORRECTIONS;
    } else {
      qp_multipliers(s, lam);
      is_certified = qp_is_optimal(s->p, s->x, lam, s->z);
      if (!is_certified && qp_worst(s, &side) >= 0) {
        k = QP_CORRECTIONS;
      }
    }
  }
  return is_certified;
}

/* Equalities and the guess of the active set, as far as their normals are independent */
static void qp_begin(qp_state *s) {
  const qp_problem *p = s->p;
  int i, pass;
  for (pass = 0; pass < 2; ++pass) {
    for (i = 0; i < p->n + p->m; ++i) {
      const int is_equality = qp_is_equality(p, i);
      if (is_equality == (pass == 0)) {
        const int side = is_equality ? 1 : s->side[i];
        s->side[i] = 0;
        if (side != 0 && s->q < p->n && qp_abs(qp_limit(p, i, side)) < QP_NONE) {
          qp_project(s, i, side);
          if (qp_is_independent(s)) {
            qp_append(s, i, side, 0);
          }
        }
      }
    }
  }
  qp_settle(s);
}

/* From a guess of the active set in s->side, to a solution, a proof that there is none, or neither */
static qp_status qp_attempt(qp_state *s, qp_real *lam) {
  const qp_problem *p = s->p;
  int i, which = 0, retries = QP_RETRIES, is_done = 0;
  qp_status status = QP_LIMIT;
  s->q = 0;
  qp_zero(p->n, s->x);
  if (qp_factor(s)) {
    qp_begin(s);
  } else {
    status = QP_NOT_CONVEX;
    is_done = 1;
  }
  while (!is_done && s->changes < s->most_changes && retries >= 0) {
    const int worst = qp_worst(s, &which);
    if (worst < 0) {
      is_done = qp_is_certified(s, lam);
      status = is_done ? QP_SOLVED : QP_LIMIT;
      retries -= !is_done && qp_worst(s, &which) < 0;
    } else {
      const qp_real excess = qp_excess(p, worst, qp_value(p, worst, s->x), &which);
      const qp_entry entry = qp_enter(s, worst, which);
      if (entry == QP_EXCLUDED) {
        status = QP_INFEASIBLE;
        is_done = 1;
      } else if (entry == QP_STUCK) {
        qp_settle(s);
        if (excess <= p->primal) {
          s->side[worst] = QP_ASIDE;
        } else {
          --retries;
        }
      } else {
        /* active, or no changes left */
      }
    }
  }
  for (i = 0; i < p->n + p->m; ++i) {
    s->side[i] = s->side[i] == QP_ASIDE ? 0 : s->side[i];
  }
  qp_multipliers(s, lam);
  return status;
}

/* Whether the limits of a value exclude each other */
static int qp_is_crossed(const qp_problem *p) {
  int i, is_crossed = 0;
  for (i = 0; i < p->n + p->m; ++i) {
    is_crossed = is_crossed || p->lo[i] - p->up[i] > 2 * p->primal;
  }
  return is_crossed;
}

/* x, multipliers lam (above zero at upper limits) and the active set of the solution. `side` holds a
   guess of the set (-1 lower, 1 upper, 0 not active) and receives that of x. w holds QP_REALS(n)
   numbers, set n. If rounding leads astray, a second attempt without the guess takes more normals for
   dependent. */
static qp_status qp_solve(const qp_problem *p, qp_real *x, qp_real *lam, int *side, qp_real *w,
                          int *set, int *changes) {
  qp_state state;
  qp_state *const s = &state;
  const int n = p->n, all = p->n + p->m;
  qp_status status;
  int i;
  s->p = p;
  s->x = x;
  s->side = side;
  s->set = set;
  s->j = w;
  s->r = s->j + n * n;
  s->u = s->r + QP_PACKED(n);
  s->d = s->u + n;
  s->z = s->d + n;
  s->y = s->z + n;
  s->t = s->y + n;
  s->changes = 0;
  s->dependent = QP_DEPENDENT;
  s->most_changes = p->max_changes / 2;
  status = qp_is_crossed(p) ? QP_INFEASIBLE : qp_attempt(s, lam);
  if (status == QP_LIMIT) {
    for (i = 0; i < all; ++i) {
      side[i] = 0;
    }
    s->dependent = 100 * QP_DEPENDENT;
    s->most_changes = p->max_changes;
    status = qp_attempt(s, lam);
  }
  *changes = s->changes;
  return status;
}
