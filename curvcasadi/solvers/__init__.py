"""Solvers that become C, and certificates of their results."""
