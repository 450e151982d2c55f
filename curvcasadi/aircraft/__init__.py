"""A flexible aircraft, and its trim."""
