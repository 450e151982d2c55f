"""Strain energy, generalized forces, and equilibrium."""
