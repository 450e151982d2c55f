"""CasADi expressions: their types and checks, named Functions, named parts of vectors."""

from curvcasadi.symbolic.functions import (
    function,
    jacobian_function,
)
from curvcasadi.symbolic.layout import (
    Layout,
    Part,
)

__all__ = [
    "Layout",
    "Part",
    "function",
    "jacobian_function",
]
