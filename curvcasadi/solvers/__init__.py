"""Solvers that become C, and certificates of their results."""

from curvcasadi.solvers.settings import SqpSettings

__all__ = ["SqpSettings"]
