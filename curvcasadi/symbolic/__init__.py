"""CasADi expressions and their checks, named and native Functions, named parts of vectors."""

from curvcasadi.symbolic.batch import Batch, compile_batch
from curvcasadi.symbolic.compiled import compile_function
from curvcasadi.symbolic.derivatives import jacobian_function
from curvcasadi.symbolic.functions import function
from curvcasadi.symbolic.layout import (
    Layout,
    Part,
)

__all__ = [
    "Batch",
    "Layout",
    "Part",
    "compile_batch",
    "compile_function",
    "function",
    "jacobian_function",
]
