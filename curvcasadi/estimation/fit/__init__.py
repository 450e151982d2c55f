"""The fit of one sample."""
