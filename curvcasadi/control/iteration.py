"""Iterations that end when they correct little, in Python and in generated C alike."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.symbolic.expressions import Real

#: Most iterations of one loop; more are loops of loops.
LONGEST = 6


def iterated(better: ca.Function, iterations: int, tolerance: float) -> ca.Function:
    """(z, constants …) -> z, residual, count of the iteration z, size ← better(z, constants …).

    It goes on while the size of the last correction is above the tolerance. It is a loop in
    generated C, too; CasADi's `fold` has no constants, so they are handed through.

    Parameters
    ----------
    better : casadi.Function
        (z, constants …) -> better z, relative size of the correction.
    iterations : int
        Most iterations.
    tolerance : float
        Size that is small enough; a NaN ends the iteration, and is its residual.

    Returns
    -------
    casadi.Function
    """
    shapes = [better.sparsity_in(i) for i in range(better.n_in())]
    z, *constants = (ca.MX.sym(f"c{i}", shape) for i, shape in enumerate(shapes))
    n = z.numel()
    ends = np.cumsum([0, n, 1, 1, *(constant.numel() for constant in constants)]).tolist()
    state = ca.MX.sym("state", ends[-1])
    now, _, count, *held = ca.vertsplit(state, ends)
    held = [ca.reshape(new, *old.shape) for new, old in zip(held, constants, strict=True)]
    z_next, size = better(now, *held)
    once = ca.Function("iterate", [state], [ca.veccat(z_next, size, count + 1, *held)])
    body, left = _unless_done(once, n, tolerance), iterations
    while (block := _block(left)) > 1:
        left //= block
        # Loops of loops, so that what is left of an iteration is skipped at once.
        body = _unless_done(body.fold(block), n, tolerance)
    end = body(ca.veccat(z, np.inf, 0, *constants))
    return ca.Function("loop", [z, *constants], [end[:n], end[n], end[n + 1]])


def _unless_done(body: ca.Function, n: int, tolerance: float) -> ca.Function:
    """(state) -> state: `body`, or nothing where the residual, entry n, is small or NaN."""
    state = ca.MX.sym("state", body.numel_in(0))
    keep = ca.Function("keep", [state], [state])
    chosen = ca.Function.if_else("unless_done", body, keep)
    return ca.Function("body", [state], [chosen(state[n] > tolerance, state)])


def _block(iterations: int) -> int:
    """Iterations of one loop: a divisor that is no more than LONGEST, or all of them."""
    if iterations <= LONGEST:
        return iterations
    return max((k for k in range(2, LONGEST + 1) if iterations % k == 0), default=iterations)


def relative_size(change: ca.MX, size: ca.MX, real: Real) -> ca.MX:
    """|change|/size, zero where both are. Sums carry a NaN on, which largest entries do not."""
    tiny = float(np.finfo("float32" if real == "float" else "float64").tiny)
    return ca.norm_1(change) / ca.fmax(size, tiny)
