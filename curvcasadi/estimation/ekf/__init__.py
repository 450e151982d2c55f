"""The shape filter."""
