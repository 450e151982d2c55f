"""The test wing, written by hand for JAX: a scan over elements, vmap over wings, jit, one thread.

`python -m benchmarks.jax_rod SIZE ELEMENTS` prints seconds per wing of a batch and the tip error.
The elements are those of this package's default: two Gauss points, the Magnus rule of order 4, one
exponential with polynomial coefficients. Vectors and matrices are written out by components, which
JAX makes loops over the batch of; with small matrices it is several times slower. The Jacobian is
JAX's own, forward mode, as its users take it.
"""

from __future__ import annotations

import json
import os
import sys
from math import sqrt
from typing import Any

#: Before JAX is imported: no threads of its own.
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.contender import batch_weights
from benchmarks.timing import seconds
from curvcasadi.lie.series import c
from tests.support.wing import LENGTH, WEIGHTS, position_error, wing

jax.config.update("jax_enable_x64", True)

Vector = tuple[Any, Any, Any]
#: Degree of the coefficient polynomials up to 1 rad an element.
DEGREE = 8


def main(size: int, elements: int) -> None:
    """Print what was measured as JSON."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    data = _basis_rows(elements)

    def pose(q: Any) -> Any:
        return _pose(q, data)

    q = jnp.asarray(batch_weights(size).T)
    one = jax.jit(pose)
    batches = [jax.jit(jax.vmap(f)) for f in (pose, lambda q: (pose(q), jax.jacfwd(pose)(q)))]
    times = [seconds(lambda f=f: jax.block_until_ready(f(q)), budget=1.0) / size for f in batches]
    error = position_error(np.asarray(one(jnp.asarray(WEIGHTS)))[9:])
    print(json.dumps({"pose": times[0], "jacobian": times[1], "error": error}))


def _basis_rows(elements: int) -> Any:
    """Rows of the basis at the two Gauss points of each element, (elements, 2, 3, n)."""
    basis = wing(elements).basis
    points = (np.arange(elements)[:, None] + 0.5 + np.array([-1, 1]) * sqrt(3) / 6) / elements
    return jnp.asarray(np.array([[basis(xi) for xi in pair] for pair in points]))


def _pose(q: Any, data: Any) -> Any:
    """Rows of R, then p, (12,)."""
    h = LENGTH / len(data)

    def step(state: tuple[Vector, ...], rows: Any) -> tuple[tuple[Vector, ...], None]:
        *rotation, position = state
        first, second = (tuple(row @ q for row in point) for point in rows)
        turn, way = _element(first, second, h)
        moved = tuple(p + _dot(row, way) for p, row in zip(position, rotation, strict=True))
        columns = tuple(zip(*turn, strict=True))
        turned = (tuple(_dot(row, column) for column in columns) for row in rotation)
        return (*turned, moved), None

    one, zero = 1.0 + 0.0 * q[0], 0.0 * q[0]
    start = ((one, zero, zero), (zero, one, zero), (zero, zero, one), (zero, zero, zero))
    end, _ = jax.lax.scan(step, start, data)
    return jnp.stack([entry for row in end for entry in row])


def _element(k1: Vector, k2: Vector, h: float) -> tuple[tuple[Vector, ...], Vector]:
    """Rotation by rows and translation of an element: θ = h/2 (K1 + K2) + √3/12 h² K1 × K2."""
    a = sqrt(3) / 12 * h**2
    cross = _cross(k1, k2)
    x, y, z = (h / 2 * (p + q) + a * r for p, q, r in zip(k1, k2, cross, strict=True))
    v = (h, a * (k1[2] - k2[2]), -a * (k1[1] - k2[1]))  # h e_x + a (K1 - K2) × e_x
    squared = x * x + y * y + z * z
    c2, c3 = c(2, squared, DEGREE), c(3, squared, DEGREE)
    c1 = 1 - squared * c3
    rows = _exponential((x, y, z), squared, c1, c2)
    w = _cross((x, y, z), v)
    ww = _cross((x, y, z), w)
    return rows, tuple(p + c2 * q + c3 * r for p, q, r in zip(v, w, ww, strict=True))


def _exponential(k: Vector, squared: Any, c1: Any, c2: Any) -> tuple[Vector, ...]:
    """I + c1 [k×] + c2 [k×]², by rows."""
    x, y, z = k
    return (
        (1 + c2 * (x * x - squared), c2 * x * y - c1 * z, c2 * x * z + c1 * y),
        (c2 * x * y + c1 * z, 1 + c2 * (y * y - squared), c2 * y * z - c1 * x),
        (c2 * x * z - c1 * y, c2 * y * z + c1 * x, 1 + c2 * (z * z - squared)),
    )


def _dot(a: Vector, b: Vector) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
