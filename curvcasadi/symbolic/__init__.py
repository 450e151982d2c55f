"""CasADi expressions and their checks, named and native Functions, named parts of vectors."""

from curvcasadi.symbolic.batch import Batch, compile_batch
from curvcasadi.symbolic.compiled import compile_function
from curvcasadi.symbolic.derivatives import jacobian_function
from curvcasadi.symbolic.functions import function
from curvcasadi.symbolic.layout import (
    Layout,
    Part,
)
from curvcasadi.symbolic.sweep import Sweep, sweep

__all__ = [
    "Batch",
    "Layout",
    "Part",
    "Sweep",
    "compile_batch",
    "compile_function",
    "function",
    "jacobian_function",
    "sweep",
]
