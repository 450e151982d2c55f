"""The condensed problem by IPOPT: another way to the same solution, for hosts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from curvcasadi.solvers.gauss_newton import GaussNewton, Solution
from curvcasadi.symbolic.derivatives import with_jacobian

_QUIET = {"print_time": False, "error_on_fail": False}
#: Bounds that are relaxed leave multipliers where the certificate finds none reached.
_IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-12,
    "acceptable_iter": 0,
    "bound_relax_factor": 0.0,
}


@dataclass(frozen=True, eq=False, kw_only=True)
class InteriorPoint(GaussNewton):
    """A `GaussNewton` problem that IPOPT solves, with the Gauss–Newton Hessian."""

    @property
    def is_embeddable(self) -> bool:
        """IPOPT becomes no C."""
        return False

    def __call__(self, guess: ca.MX, p: ca.MX) -> Solution:
        """Solution from a guess, which is moved to within the bounds first."""
        lower, upper = self.limits
        found = self._solver()(
            x0=self.within(guess),
            p=p,
            lbx=lower[: self.n],
            ubx=upper[: self.n],
            lbg=lower[self.n :],
            ubg=upper[self.n :],
        )
        x = self.within(found["x"])
        _, g, H, c, At = self.linearization.call([x, p])
        multipliers = ca.vertcat(found["lam_x"], found["lam_g"])
        stationarity = self.distance(H, g, At, ca.vertcat(x, c), multipliers)
        values, states = self.values(x, p)
        return Solution(x, values, states, self.violation(x, values), stationarity)

    def _solver(self) -> ca.Function:
        x, p = ca.MX.sym("x", self.n), ca.MX.sym("p", self.linearization.nnz_in(1))
        f, g, H, c, At = self.linearization.call([x, p])
        problem = with_jacobian(
            f"{self.name}_problem",
            {"x": x, "p": p},
            {"f": f, "c": c},
            {"f": g.T, "c": At.T},
            held=("p",),
        )
        of_f, of_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.m)
        names = ["x", "p", "lam_f", "lam_g"]
        hessian = ca.Function(
            f"{self.name}_hessian",
            [x, p, of_f, of_g],
            [of_f * H],
            names,
            ["triu_hess_gamma_x_x"],
        )
        objective, constraints = problem(x, p)
        program: Any = {"x": x, "p": p, "f": objective, "g": constraints}
        options: dict[str, Any] = {
            **_QUIET,
            "hess_lag": hessian,
            "ipopt": {**_IPOPT, "max_iter": 10 * self.max_iter},
        }
        return ca.nlpsol(f"{self.name}_ipopt", "ipopt", program, options)
