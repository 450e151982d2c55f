"""Optimal control and shape targets built on the shape map."""
