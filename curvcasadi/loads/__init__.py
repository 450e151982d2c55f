"""Loads on a beam, and what they amount to at its stations."""
