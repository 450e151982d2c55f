"""CasADi expressions and their checks, named and native Functions, named parts of vectors."""

from curvcasadi.symbolic.compiled import compile_function
from curvcasadi.symbolic.derivatives import jacobian_function
from curvcasadi.symbolic.functions import function
from curvcasadi.symbolic.layout import (
    Layout,
    Part,
)

__all__ = [
    "Layout",
    "Part",
    "compile_function",
    "function",
    "jacobian_function",
]
