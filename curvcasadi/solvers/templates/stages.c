/* Stages of a model in time, condensed to the inputs u: x_(k+1) = F(x_k, u_k, p), errors r_k of
   x_(k+1), moves u_k - u_(k-1), and limits of (x_k, u_k, x_(k+1)). dx is the error state, of nd
   entries. Rows of the sensitivities G_k = dx_k/du and of the limits have fixed patterns. */

struct gn_stages {
  int count, inputs, nx, nd, nu, np, nr, nc;
  int nt, goals;              /* errors of the end of the last stage; goals of a stage */
  int p_step;                 /* from the p of a stage to that of the next */
  const short *held;          /* of each stage, which of the inputs it has */
  const short *goal_sizes;    /* of one stage */
  gn_function error;          /* (x_end, p, goals ...) -> r, its Jacobian by dx_end */
  gn_function step;           /* (x, u, p) -> x_end, A', B' */
  gn_function limits;         /* (x, u, x_end, p) -> c, its transposed Jacobian by (dx, u, dx_end) */
  gn_function terminal;       /* (x_end) -> r, its Jacobian by dx_end; of the last stage, too, or 0 */
  const short *a_row, *a_col; /* rows of A, B and of the limits' Jacobian */
  const short *b_row, *b_col, *c_row, *c_col;
  const short *g_row, *g_col; /* rows of G_1 ... G_N in turn */
  qp_real move, input;        /* weights of |u_k - u_(k-1)|^2, of |u_k|^2, */
  qp_real damping;            /* and of |u - guess|^2, */
  int relative;               /* in units of the largest diagonal entry of h below 1 */
};

#define GN_ENTRIES(row, n) ((n) ? (row)[n] : 0)

/* line += f (row i of G_k), of which g holds the entries */
static void gn_add_sensitivity(const gn_stages *s, int k, int i, qp_real f, const qp_real *g,
                               qp_real *line) {
  if (k > 0) {
    const short *row = s->g_row + (k - 1) * s->nd;
    int e;
    for (e = row[i]; e < row[i + 1]; ++e) {
      line[s->g_col[e]] += f * g[e - row[0]];
    }
  }
}

/* The entries of a row out of a full line, which is left empty */
static void gn_gather(const short *col, int n, qp_real *line, qp_real *to) {
  int e;
  for (e = 0; e < n; ++e) {
    to[e] = line[col[e]];
    line[col[e]] = 0;
  }
}

/* The end of stage k: x_(k+1), A, B of scratch results 0 to 2 */
static int gn_stage_step(const gn_stages *s, const qp_real *x, const qp_real *u, const qp_real *p,
                         const gn_scratch *c) {
  c->arg[0] = x;
  c->arg[1] = u;
  c->arg[2] = p;
  return s->step(c->arg, c->res, c->iw, c->w, 0);
}

static int gn_stage_limits(const gn_stages *s, const qp_real *x, const qp_real *u,
                           const qp_real *end, const qp_real *p, const gn_scratch *c) {
  c->arg[0] = x;
  c->arg[1] = u;
  c->arg[2] = end;
  c->arg[3] = p;
  return s->limits(c->arg, c->res, c->iw, c->w, 0);
}

/* G_(k+1) = A G_k + B du_k */
static void gn_propagate(const gn_stages *s, int k, const qp_real *a, const qp_real *b,
                         const qp_real *g, qp_real *line, qp_real *g_end) {
  const short *row = s->g_row + k * s->nd;
  const int first = s->held[k] * s->nu;
  int i, e;
  for (i = 0; i < s->nd; ++i) {
    for (e = s->a_row[i]; e < s->a_row[i + 1]; ++e) {
      gn_add_sensitivity(s, k, s->a_col[e], a[e], g, line);
    }
    for (e = s->b_row[i]; e < s->b_row[i + 1]; ++e) {
      line[first + s->b_col[e]] += b[e];
    }
    gn_gather(s->g_col + row[i], row[i + 1] - row[i], line, g_end + (row[i] - row[0]));
  }
}

/* Rows of A of the limits of stage k, from their slopes c by (x, u, x_end) */
static void gn_limit_rows(const gn_stages *s, int k, const short *row, const short *col,
                          const qp_real *c, const qp_real *g, const qp_real *g_end, qp_real *line,
                          qp_real *a) {
  const int first = s->held[k] * s->nu;
  int i, e;
  for (i = 0; i < s->nc; ++i) {
    const int to = k * s->nc + i;
    for (e = s->c_row[i]; e < s->c_row[i + 1]; ++e) {
      const int by = s->c_col[e];
      if (by < s->nd) {
        gn_add_sensitivity(s, k, by, c[e], g, line);
      } else if (by < s->nd + s->nu) {
        line[first + by - s->nd] += c[e];
      } else {
        gn_add_sensitivity(s, k + 1, by - s->nd - s->nu, c[e], g_end, line);
      }
    }
    gn_gather(col + row[to], row[to + 1] - row[to], line, a + row[to]);
  }
}

/* Objective, gradient and Hessian of nr errors r at the end of stage k, of slope j by dx_(k+1) */
static void gn_add_error(const gn_stages *s, int k, int nr, const qp_real *r, const qp_real *j,
                         const qp_real *g_end, qp_real *slope, gn_point *at) {
  const short *row = s->g_row + k * s->nd;
  const int n = (s->held[k] + 1) * s->nu;
  qp_real *h = at->h;
  int i, e;
  qp_zero(nr * n, slope);
  for (i = 0; i < s->nd; ++i) {
    for (e = row[i]; e < row[i + 1]; ++e) {
      qp_add(nr, g_end[e - row[0]], j + i * nr, slope + s->g_col[e] * nr);
    }
  }
  at->f += qp_dot(nr, r, r) / 2;
  for (i = 0; i < n; ++i) {
    const qp_real *by = slope + i * nr;
    at->g[i] += qp_dot(nr, by, r);
    for (e = 0; e <= i; ++e) {
      h[e] += qp_dot(nr, by, slope + e * nr);
    }
    h += i + 1;
  }
}

/* The same of the inputs and their moves */
static void gn_add_inputs(const gn_stages *s, const qp_real *u, const qp_real *before, gn_point *at) {
  const int n = s->inputs * s->nu;
  int i;
  for (i = 0; i < n; ++i) {
    const qp_real move = u[i] - (i < s->nu ? before[i] : u[i - s->nu]);
    at->f += (s->move * move * move + s->input * u[i] * u[i]) / 2;
    at->g[i] += s->move * move + s->input * u[i];
    at->h[QP_PACKED(i) + i] += s->move + s->input;
    if (i >= s->nu) {
      at->g[i - s->nu] -= s->move * move;
      at->h[QP_PACKED(i - s->nu) + i - s->nu] += s->move;
      at->h[QP_PACKED(i) + i - s->nu] -= s->move;
    }
  }
}

/* The same of the damping toward the guess */
static void gn_add_damping(const gn_stages *s, gn_point *at) {
  const int n = s->inputs * s->nu;
  qp_real largest = 0;
  int i;
  for (i = 0; i < n && s->relative; ++i) {
    const qp_real entry = at->h[QP_PACKED(i) + i];
    largest = entry > largest ? entry : largest;
  }
  largest = largest > 0 && largest < 1 ? largest : 1;
  for (i = 0; i < n; ++i) {
    at->h[QP_PACKED(i) + i] += s->damping * largest;
  }
}

/* Entries of the largest of G_1 ... G_N: the last one is not where inputs are held */
static int gn_most_entries(const gn_stages *s) {
  int k, most = 0;
  for (k = 0; k < s->count; ++k) {
    const int entries = s->g_row[(k + 1) * s->nd] - s->g_row[k * s->nd];
    most = entries > most ? entries : most;
  }
  return most;
}

/* The linearization at the inputs u. Of parameters: x_0, p, the input before, goals. */
static int gn_condense(const gn_stages *s, const short *row, const short *col, const qp_real *u,
                       const qp_real *parameters, gn_point *at, qp_real *work,
                       const gn_scratch *scratch) {
  const int n = s->inputs * s->nu;
  const int entries = gn_most_entries(s);
  const qp_real *p = parameters + s->nx, *before = p + s->np, *x = parameters;
  qp_real *g = gn_take(&work, entries), *g_end = gn_take(&work, entries);
  const int nr = s->nr > s->nt ? s->nr : s->nt;
  qp_real *ends[2], *r = gn_take(&work, nr), *j = gn_take(&work, nr * s->nd);
  qp_real *a = gn_take(&work, s->a_row[s->nd]), *b = gn_take(&work, s->b_row[s->nd]);
  qp_real *c = gn_take(&work, GN_ENTRIES(s->c_row, s->nc));
  qp_real *line = gn_take(&work, n), *slope = gn_take(&work, nr * n);
  int i, k, failed = 0;
  ends[0] = gn_take(&work, s->nx);
  ends[1] = gn_take(&work, s->nx);
  at->f = 0;
  qp_zero(n, at->g);
  qp_zero(n, line);
  qp_zero(QP_PACKED(n), at->h);
  gn_add_inputs(s, u, before, at);
  for (k = 0; k < s->count && !failed; ++k) {
    const qp_real *goal = before + s->nu, *of_stage = p + k * s->p_step;
    const qp_real *input = u + s->held[k] * s->nu;
    qp_real *end = ends[k % 2], *last = g;
    scratch->res[0] = end;
    scratch->res[1] = a;
    scratch->res[2] = b;
    failed = gn_stage_step(s, x, input, of_stage, scratch);
    gn_propagate(s, k, a, b, g, line, g_end);
    if (s->nc > 0 && !failed) {
      scratch->res[0] = at->c + k * s->nc;
      scratch->res[1] = c;
      failed = gn_stage_limits(s, x, input, end, of_stage, scratch);
      gn_limit_rows(s, k, row, col, c, g, g_end, line, at->a);
    }
    scratch->arg[0] = end;
    scratch->arg[1] = of_stage;
    for (i = 0; i < s->goals; ++i) {
      scratch->arg[2 + i] = goal + k * s->goal_sizes[i];
      goal += s->count * s->goal_sizes[i];
    }
    scratch->res[0] = r;
    scratch->res[1] = j;
    failed = failed || s->error(scratch->arg, scratch->res, scratch->iw, scratch->w, 0);
    gn_add_error(s, k, s->nr, r, j, g_end, slope, at);
    x = end;
    g = g_end;
    g_end = last;
  }
  if (s->terminal && !failed) {
    scratch->arg[0] = x;
    scratch->res[0] = r;
    scratch->res[1] = j;
    failed = s->terminal(scratch->arg, scratch->res, scratch->iw, scratch->w, 0);
    gn_add_error(s, s->count - 1, s->nt, r, j, g, slope, at);
  }
  gn_add_damping(s, at);
  return failed;
}

/* Limits and states along the rollout of u */
static int gn_rollout(const gn_stages *s, const qp_real *u, const qp_real *parameters, qp_real *c,
                      qp_real *states, qp_real *work, const gn_scratch *scratch) {
  const qp_real *p = parameters + s->nx;
  int i, k, failed = 0;
  for (i = 0; i < s->nx; ++i) {
    states[i] = parameters[i];
  }
  for (k = 0; k < s->count && !failed; ++k) {
    const qp_real *x = states + k * s->nx, *input = u + s->held[k] * s->nu;
    const qp_real *of_stage = p + k * s->p_step;
    scratch->res[0] = states + (k + 1) * s->nx;
    scratch->res[1] = work;
    scratch->res[2] = work + s->a_row[s->nd];
    failed = gn_stage_step(s, x, input, of_stage, scratch);
    if (s->nc > 0 && !failed) {
      scratch->res[0] = c + k * s->nc;
      scratch->res[1] = work;
      failed = gn_stage_limits(s, x, input, x + s->nx, of_stage, scratch);
    }
  }
  return failed;
}
