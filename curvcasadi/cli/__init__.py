"""The command line."""

from curvcasadi.cli.main import main

__all__ = ["main"]
