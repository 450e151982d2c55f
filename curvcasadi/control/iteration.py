"""Iterations that end when they correct little, in Python and in generated C alike."""

from __future__ import annotations

import casadi as ca
import numpy as np

from curvcasadi.symbolic.expressions import Real


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
    names = ["z", *(f"c{i}" for i in range(1, better.n_in()))]
    z, *constants = (ca.MX.sym(n, better.sparsity_in(i)) for i, n in enumerate(names))
    residual, count = ca.MX.sym("residual"), ca.MX.sym("count")
    state = [z, residual, count, *constants]
    keys = ["z", "residual", "count", *names[1:]]
    next_keys = [f"{key}_" for key in keys]
    z_next, size = better(z, *constants)
    iterate = ca.Function("iterate", state, [z_next, size, count + 1, *constants], keys, next_keys)
    keep = ca.Function("keep", state, state, keys, next_keys)
    iterate_or_keep = ca.Function.if_else("iterate_or_keep", iterate, keep)

    packed = ca.MX.sym("state", sum(piece.numel() for piece in state))
    pieces = ca.vertsplit(packed, np.cumsum([0, *(piece.numel() for piece in state)]).tolist())
    pieces = [ca.reshape(new, *old.shape) for new, old in zip(pieces, state, strict=True)]
    body = ca.Function(
        "body", [packed], [ca.veccat(*iterate_or_keep.call([pieces[1] > tolerance, *pieces]))]
    )
    end = body.fold(iterations)(ca.veccat(z, np.inf, 0, *constants))
    n = z.numel()
    return ca.Function("loop", [z, *constants], [end[:n], end[n], end[n + 1]])


def relative_size(change: ca.MX, size: ca.MX, real: Real) -> ca.MX:
    """|change|/size, zero where both are. Sums carry a NaN on, which largest entries do not."""
    tiny = float(np.finfo("float32" if real == "float" else "float64").tiny)
    return ca.norm_1(change) / ca.fmax(size, tiny)
