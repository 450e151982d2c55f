"""Libraries that a reader needs and an extra of the package brings."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def needed(module: str, reader: str, extra: str) -> Any:
    """The module; an ImportError says who needs it and how to install it."""
    try:
        return import_module(module)
    except ImportError as error:
        library = module.partition(".")[0]
        raise ImportError(f'{reader} needs {library}: pip install "curvcasadi[{extra}]"') from error
