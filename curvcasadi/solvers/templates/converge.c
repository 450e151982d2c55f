/* The step with a damping, or with the least larger one with which the program can be solved in this
   precision; what is infeasible stays so */
static qp_status gn_damped_step(gn_state *s, qp_real *damping, int is_first) {
  const qp_real unit = gn_unit(s);
  qp_real added = *damping;
  qp_status status = QP_LIMIT;
  int i, k;
  for (k = 0; k < GN_DAMPINGS && (status == QP_LIMIT || status == QP_NOT_CONVEX); ++k) {
    if (k > 0) {
      added = gn_larger(GN_DAMPING * *damping, GN_LEAST_DAMPING) - *damping;
      *damping += added;
    }
    for (i = 0; i < s->problem->n; ++i) {
      s->at.h[QP_PACKED(i) + i] += added * unit;
    }
    status = gn_step(s, s->x, is_first);
  }
  return status;
}

static void gn_try(gn_state *s, qp_real shrink) {
  int i;
  for (i = 0; i < s->problem->n; ++i) {
    s->tried[i] = s->x[i] + shrink * s->d[i];
  }
  gn_clip(s->problem, s->tried);
}

static qp_real gn_largest(int n, const qp_real *x) {
  qp_real largest = 0;
  int i;
  for (i = 0; i < n; ++i) {
    largest = gn_larger(largest, qp_abs(x[i]));
  }
  return largest;
}

/* Steps until the optimality conditions hold */
static int gn_converge(gn_state *s, gn_judgement *found) {
  const gn_problem *p = s->problem;
  qp_real shrink = 0, merit = GN_FAR, change = 0, penalty = 0, damping = p->first_damping;
  int i, k, halved = 0, is_first = 1, is_done = 0, failed = 0;
  qp_zero(p->n + p->m, s->lam);
  qp_zero(p->n, s->d); /* halved where the guess itself is worse than anything */
  for (i = 0; i < p->n; ++i) {
    s->tried[i] = s->x[i];
  }
  found->distance = GN_FAR;
  for (k = 0; k < p->passes && !is_done && !failed; ++k) {
    qp_real excess = 0, allowed;
    failed = gn_linearize(s, s->tried);
    for (i = 0; i < p->m; ++i) {
      excess += gn_excess(p, p->n + i, s->at.c[i]);
    }
    allowed = merit + GN_ARMIJO * shrink * change + 16 * QP_EPS * qp_abs(merit);
    allowed += p->noise * QP_SQRT(qp_abs(merit));
    if (!(s->at.f + penalty * excess <= allowed) && halved < p->halvings) {
      shrink /= 2;
      ++halved;
      damping = gn_larger(GN_DAMPING * damping, GN_LEAST_DAMPING);
      gn_try(s, shrink);
    } else {
      const qp_real moved = shrink * gn_largest(p->n, s->d);
      for (i = 0; i < p->n; ++i) {
        s->x[i] = s->tried[i];
      }
      found->distance = gn_distance(s, s->x, 0);
      is_done = gn_larger(found->distance, gn_violation(s, s->x) / p->limit) <= p->enough;
      is_done = is_done || (shrink > 0 && moved <= p->step);
      if (!is_done) {
        qp_status status;
        damping = halved < 1 ? damping / GN_DAMPING : damping;
        damping = damping < GN_LEAST_DAMPING ? 0 : damping;
        status = gn_damped_step(s, &damping, is_first);
        is_first = 0;
        if (status != QP_SOLVED) {
          is_done = 1;
          found->distance = GN_FAR;
          found->violation = status == QP_INFEASIBLE ? 2 * p->limit : 0;
        }
        penalty = gn_larger(penalty, GN_PENALTY * gn_largest(p->m, s->lam + p->n));
        merit = s->at.f + penalty * excess;
        change = qp_dot(p->n, s->at.g, s->d) - penalty * excess;
        shrink = 1;
        halved = 0;
        gn_try(s, shrink);
      }
    }
  }
  return failed;
}
