/* Gauss-Newton sequential quadratic programming.

   At x a problem is its linearization: objective f, gradient g, Hessian H, values c of the constraints
   and their slopes A. Steps solve the quadratic program of that point. A number of steps is taken in
   full; otherwise steps are halved until the objective and a penalty of violations fall, but for what
   rounding adds, and the next ones are damped, as are those whose program this precision cannot solve.
   The result is judged by its own numbers: violation of the limits, and distance from the optimality conditions. */

#define GN_FAR ((qp_real)1e30)
#define GN_ARMIJO ((qp_real)1e-4)
#define GN_PENALTY ((qp_real)1.5)
#define GN_DAMPING ((qp_real)4)
#define GN_LEAST_DAMPING ((qp_real)1e-7)
#define GN_DAMPINGS 12 /* times GN_DAMPING, from the least to that of the objective */

/* A generated function */
typedef int (*gn_function)(const qp_real **arg, qp_real **res, int *iw, qp_real *w, int mem);

/* What generated functions work in */
typedef struct {
  const qp_real **arg;
  qp_real **res;
  int *iw;
  qp_real *w;
} gn_scratch;

typedef struct gn_stages gn_stages;

typedef struct {
  int n, m;               /* unknowns, constraints */
  const short *row, *col; /* rows of A, as in qp_problem */
  int x_period, c_period; /* after so many the limits repeat */
  const qp_real *x_lower, *x_upper, *c_lower, *c_upper;
  gn_function linearize;   /* (x, p) -> f, g, H, c, A; or */
  gn_function values;      /* (x, p) -> c, states */
  const gn_stages *stages; /* what these are condensed of, and then */
  int stage_reals;         /* its work */
  int iterations;          /* 0: until it converges */
  int passes, halvings, changes;
  qp_real reach, primal, dual;            /* of quadratic programs */
  qp_real step, limit, flat;              /* that count as none */
  qp_real stationarity;                   /* of gradient and idle multipliers; 0: not asked for */
  qp_real enough;                         /* part of tolerances at which it converged */
  qp_real decrement;                      /* of a residual; 0: not asked for */
  qp_real noise;                          /* of the objective by rounding, over its square root */
  qp_real first_damping;                  /* where it converges, times GN_DAMPING */
  int relative; /* whether what counts as none is relative to the Hessian */
} gn_problem;

typedef struct {
  qp_real f, *g, *h, *c, *a;
} gn_point;

typedef struct {
  const gn_problem *problem;
  const qp_real *p;
  gn_scratch scratch;
  gn_point at;
  qp_real *x, *tried, *d, *lam, *lower, *upper, *qp, *stage;
  int *set, *side;
} gn_state;

static qp_real *gn_take(qp_real **w, int n) {
  qp_real *taken = *w;
  *w += n;
  return taken;
}

static qp_real gn_larger(qp_real a, qp_real b) { return a > b ? a : b; }

@STAGES@
static int gn_linearize(gn_state *s, const qp_real *x) {
  const gn_problem *problem = s->problem;
  int failed;
@CONDENSED@
  {
    s->scratch.arg[0] = x;
    s->scratch.arg[1] = s->p;
    s->scratch.res[0] = &s->at.f;
    s->scratch.res[1] = s->at.g;
    s->scratch.res[2] = s->at.h;
    s->scratch.res[3] = s->at.c;
    s->scratch.res[4] = s->at.a;
    failed = problem->linearize(s->scratch.arg, s->scratch.res, s->scratch.iw, s->scratch.w, 0);
  }
  return failed;
}

static int gn_values(gn_state *s, const qp_real *x, qp_real *states) {
  const gn_problem *problem = s->problem;
  int failed;
@ROLLED@
  {
    s->scratch.arg[0] = x;
    s->scratch.arg[1] = s->p;
    s->scratch.res[0] = s->at.c;
    s->scratch.res[1] = states;
    failed = problem->values(s->scratch.arg, s->scratch.res, s->scratch.iw, s->scratch.w, 0);
  }
  return failed;
}

static qp_real gn_lower(const gn_problem *p, int i) {
  return i < p->n ? p->x_lower[i % p->x_period] : p->c_lower[(i - p->n) % p->c_period];
}

static qp_real gn_upper(const gn_problem *p, int i) {
  return i < p->n ? p->x_upper[i % p->x_period] : p->c_upper[(i - p->n) % p->c_period];
}

/* By how much a value exceeds the limits i */
static qp_real gn_excess(const gn_problem *p, int i, qp_real value) {
  const qp_real below = gn_lower(p, i) - value, above = value - gn_upper(p, i);
  return below > above ? (below > 0 ? below : 0) : (above < 0 ? 0 : above);
}

/* x moved to within its bounds */
static void gn_clip(const gn_problem *p, qp_real *x) {
  int i;
  for (i = 0; i < p->n; ++i) {
    const qp_real lower = gn_lower(p, i), upper = gn_upper(p, i);
    x[i] = x[i] < lower ? lower : x[i];
    x[i] = x[i] > upper ? upper : x[i];
  }
}

/* Euclidean norm of what x and the constraints' values exceed */
static qp_real gn_violation(const gn_state *s, const qp_real *x) {
  const gn_problem *p = s->problem;
  qp_real sum = 0;
  int i;
  for (i = 0; i < p->n + p->m; ++i) {
    const qp_real excess = gn_excess(p, i, i < p->n ? x[i] : s->at.c[i - p->n]);
    sum += excess * excess;
  }
  return QP_SQRT(sum);
}

static void gn_program(const gn_state *s, qp_problem *qp) {
  const gn_problem *p = s->problem;
  qp->n = p->n;
  qp->m = p->m;
  qp->row = p->row;
  qp->col = p->col;
  qp->a = s->at.a;
  qp->h = s->at.h;
  qp->g = s->at.g;
  qp->lo = s->lower;
  qp->up = s->upper;
  qp->reach = p->reach;
  qp->primal = p->primal;
  qp->dual = p->dual;
  qp->max_changes = p->changes;
}

/* Size of the objective: that of the Hessian, or 1 where it is scaled so */
static qp_real gn_unit(const gn_state *s) {
  qp_real largest = 0;
  int i;
  for (i = 0; i < s->problem->n; ++i) {
    largest = gn_larger(largest, s->at.h[QP_PACKED(i) + i]);
  }
  return s->problem->relative ? largest : 1;
}

/* Distance from the optimality conditions over its tolerance: of the quadratic program after the step
   d, or of the problem at x where d is not given. */
static qp_real gn_distance(gn_state *s, const qp_real *x, const qp_real *d) {
  const gn_problem *p = s->problem;
  const qp_real unit = gn_unit(s);
  qp_real *left = s->qp, sum = 0, gain = 0;
  qp_problem qp;
  int i;
  gn_program(s, &qp);
  for (i = 0; i < p->n; ++i) {
    left[i] = s->at.g[i];
  }
  if (d) {
    qp_add_hessian(&qp, d, left);
  }
  for (i = 0; i < p->n + p->m; ++i) {
    const qp_real here = i < p->n ? x[i] : s->at.c[i - p->n];
    const qp_real reached = d ? here + qp_value(&qp, i, d) : here;
    const qp_real slack = s->lam[i] > 0 ? gn_upper(p, i) - reached : reached - gn_lower(p, i);
    const qp_real multiplier = qp_abs(s->lam[i]) / unit;
    const qp_real least = multiplier < slack ? multiplier : slack;
    qp_add_normal(&qp, i, s->lam[i], left);
    if (p->stationarity > 0) {
      const qp_real idle = least < 0 ? 0 : least / p->stationarity;
      sum += idle * idle;
    } else {
      gain += least > 0 ? unit * multiplier * slack : 0;
    }
  }
  for (i = 0; i < p->n && p->stationarity > 0; ++i) {
    const qp_real part = left[i] / (unit * p->stationarity);
    sum += part * part;
  }
  if (p->decrement > 0) { /* left' (H + flat)^-1 left */
    qp_real *l = left + p->n;
    qp_real shift = unit * p->flat;
    int is_definite = qp_cholesky(&qp, shift, l);
    for (i = 0; i < GN_DAMPINGS && !is_definite; ++i) { /* but for rounding */
      shift = gn_larger(GN_DAMPING * shift, unit * GN_LEAST_DAMPING);
      is_definite = qp_cholesky(&qp, shift, l);
    }
    if (is_definite) {
      for (i = 0; i < p->n; ++i) {
        const qp_real *li = l + QP_PACKED(i);
        left[i] = (left[i] - qp_dot(i, li, left)) / li[i];
        gain += left[i] * left[i];
      }
      sum += gain / (p->decrement * p->decrement);
    } else {
      sum = GN_FAR;
    }
  }
  return QP_SQRT(sum);
}

/* The step d from x, its multipliers and status; limits that x lies at are guessed to be active */
static qp_status gn_step(gn_state *s, const qp_real *x, int is_first) {
  const gn_problem *p = s->problem;
  qp_problem qp;
  int i, changes;
  for (i = 0; i < p->n + p->m; ++i) {
    const qp_real here = i < p->n ? x[i] : s->at.c[i - p->n];
    const qp_real lower = gn_lower(p, i), upper = gn_upper(p, i);
    s->lower[i] = lower > -QP_NONE ? lower - here : lower;
    s->upper[i] = upper < QP_NONE ? upper - here : upper;
    if (is_first) {
      const int is_low = s->lower[i] >= -p->primal, is_high = s->upper[i] <= p->primal;
      s->side[i] = is_low ? -1 : (is_high ? 1 : 0);
    }
  }
  gn_program(s, &qp);
  return qp_solve(&qp, s->d, s->lam, s->side, s->qp, s->set, &changes);
}

typedef struct {
  qp_real violation, distance;
} gn_judgement;

@ITERATE@
@CONVERGE@
/* Solution from the guess in s->x, its states, violation and distance from optimality */
static int gn_solve(gn_state *s, qp_real *states, qp_real *violation, qp_real *distance) {
  gn_judgement found = {0, 0};
  int failed;
  gn_clip(s->problem, s->x);
@SOLVE@
  failed = failed || gn_values(s, s->x, states);
  *violation = gn_larger(gn_violation(s, s->x), found.violation);
  *distance = found.distance;
  return failed;
}

/* A whole solver: its inputs, one or more rounds of the problem, its outputs */
typedef struct {
  const gn_problem *problem;
  int inputs, outputs, parameters, states;
  gn_function begin;       /* inputs -> guess, parameters */
  gn_function advance;     /* (x, parameters, settings) -> parameters of the next round */
  gn_function finish;      /* (inputs, x, states, violation, distance, that before) -> outputs */
  const qp_real *settings; /* of the rounds after the first */
  int more_rounds, settings_size;
} gn_solver;

/* Begin and end of the arguments that `finish` has beside the inputs */
#define GN_RESULTS 5

static int gn_run(const gn_solver *solver, const qp_real **arg, qp_real **res, int *iw, qp_real *w) {
  const gn_problem *problem = solver->problem;
  const int n = problem->n, m = problem->m;
  gn_state state;
  gn_state *const s = &state;
  qp_real *p, *next, *states, *judged;
  int i, k, failed;
  s->problem = problem;
  p = gn_take(&w, solver->parameters);
  next = gn_take(&w, solver->more_rounds ? solver->parameters : 0);
  states = gn_take(&w, solver->states);
  judged = gn_take(&w, 3);
  s->x = gn_take(&w, n);
  s->tried = gn_take(&w, n);
  s->d = gn_take(&w, n);
  s->lam = gn_take(&w, n + m);
  s->lower = gn_take(&w, n + m);
  s->upper = gn_take(&w, n + m);
  s->at.g = gn_take(&w, n);
  s->at.h = gn_take(&w, QP_PACKED(n));
  s->at.c = gn_take(&w, m);
  s->at.a = gn_take(&w, m ? problem->row[m] : 0);
  s->qp = w; /* one program at a time: or what it is made of, and generated functions behind that */
  s->stage = w;
  s->scratch.w = w + problem->stage_reals;
  s->set = iw;
  s->side = iw + n;
  s->scratch.iw = iw + 2 * n + m;
  s->scratch.arg = arg + solver->inputs + GN_RESULTS;
  s->scratch.res = res + solver->outputs;
  s->p = p;
  for (i = 0; i < solver->inputs; ++i) {
    s->scratch.arg[i] = arg[i];
  }
  s->scratch.res[0] = s->x;
  s->scratch.res[1] = p;
  failed = solver->begin(s->scratch.arg, s->scratch.res, s->scratch.iw, s->scratch.w, 0);
  judged[1] = 0;
  for (k = 0; k <= solver->more_rounds && !failed; ++k) {
    if (k > 0) {
      s->scratch.arg[0] = s->x;
      s->scratch.arg[1] = p;
      s->scratch.arg[2] = solver->settings + (k - 1) * solver->settings_size;
      s->scratch.res[0] = next;
      failed = solver->advance(s->scratch.arg, s->scratch.res, s->scratch.iw, s->scratch.w, 0);
      for (i = 0; i < solver->parameters; ++i) {
        p[i] = next[i];
      }
    }
    judged[2] = judged[1];
    failed = failed || gn_solve(s, states, &judged[0], &judged[1]);
    judged[2] = k > 0 ? judged[2] : judged[1];
  }
  if (!failed) {
    arg[solver->inputs] = s->x;
    arg[solver->inputs + 1] = states;
    arg[solver->inputs + 2] = &judged[0];
    arg[solver->inputs + 3] = &judged[1];
    arg[solver->inputs + 4] = &judged[2];
    failed = solver->finish(arg, res, s->scratch.iw, s->scratch.w, 0);
  }
  return failed;
}
