/* So many full steps */
static int gn_iterate(gn_state *s, gn_judgement *found) {
  const gn_problem *p = s->problem;
  int k, failed = 0;
  qp_status status = QP_SOLVED;
  for (k = 0; k < p->iterations && !failed && status == QP_SOLVED; ++k) {
    failed = gn_linearize(s, s->x);
    status = failed ? QP_LIMIT : gn_step(s, s->x, k == 0);
    if (status == QP_SOLVED) {
      found->distance = gn_distance(s, s->x, s->d);
      qp_add(p->n, 1, s->d, s->x);
      gn_clip(p, s->x);
    }
  }
  if (status != QP_SOLVED) {
    found->distance = GN_FAR;
    found->violation = status == QP_INFEASIBLE ? 2 * p->limit : 0;
  }
  return failed;
}

