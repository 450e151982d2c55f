"""Functions as C99 source for other programs, with a program that checks them."""

from curvcasadi.export.c import export_c
from curvcasadi.export.host import run_check

__all__ = ["export_c", "run_check"]
