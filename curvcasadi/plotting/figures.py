"""What figures share: colours, stations of curves, and how a figure is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

AXIS_COLORS = ("tab:red", "tab:green", "tab:blue")
WING_COLOR, UNDEFORMED_COLOR = "black", "0.6"
#: Stations xi at which curves are drawn.
CURVE_STATIONS = np.linspace(0.0, 1.0, 61)


def save_figure(figure: Figure, path: str | Path) -> None:
    """Write a figure in the format that the extension of `path` names.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        The figure.
    path : str or Path
        File to write, such as wing.png, .svg or .pdf.

    Raises
    ------
    ValueError
        If there is no such format.
    """
    known = sorted(figure.canvas.get_supported_filetypes())
    if Path(path).suffix.lower().lstrip(".") not in known:
        raise ValueError(
            f"{path}: expected a file name that ends in one of {', '.join(known)}, "
            f"found {Path(path).suffix!r}"
        )
    try:
        figure.savefig(path, dpi=200)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
