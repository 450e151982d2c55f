"""Functions as C99 for other programs: checked wrappers, a self-test, build files."""

from curvcasadi.export.c_function import CFunction
from curvcasadi.export.export import export_c
from curvcasadi.export.fmu import export_fmu
from curvcasadi.export.host import run_check as run_check
from curvcasadi.export.mex import export_mex

__all__ = ["CFunction", "export_c", "export_fmu", "export_mex"]
