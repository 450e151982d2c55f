"""Lie groups of attitude and pose, in SX, MX and DM alike."""

from curvcasadi.lie import quaternion, se3, series, so3

__all__ = ["quaternion", "se3", "series", "so3"]
