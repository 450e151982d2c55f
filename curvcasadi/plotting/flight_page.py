"""A flight as one HTML page with a slider for the time, by plotly."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from curvcasadi.control.simulation import Simulation
from curvcasadi.plotting.animation import frames
from curvcasadi.plotting.flight_panels import BODY, TAIL, WING, Panel, extent


def write_page(
    path: Path, panels: Sequence[Panel], simulation: Simulation, title: str | None
) -> None:
    """One HTML page with the surfaces, a slider for the time, and all that it needs."""
    try:
        import plotly.graph_objects as go
    except ImportError:
        raise ValueError(
            f"{path}: a page needs plotly, which is not installed: pip install curvcasadi[flight]"
        ) from None
    samples, rate = frames(simulation.t)

    def surfaces(k: int) -> list[Any]:
        drawn = []
        for panel in panels:
            front, back = (
                np.round(edge[k] * [[1], [1], [-1]], 4) for edge in (panel.front, panel.back)
            )
            x, y, z = (np.vstack(pair) for pair in zip(front, back, strict=True))
            if np.array_equal(front, back):
                drawn.append(
                    go.Scatter3d(
                        x=front[0],
                        y=front[1],
                        z=front[2],
                        mode="lines",
                        name=panel.name,
                        line={"color": BODY, "width": 6},
                        hoverinfo="skip",
                    )
                )
                continue
            color = TAIL if panel.rigid else WING
            drawn.append(
                go.Surface(
                    x=x,
                    y=y,
                    z=z,
                    name=panel.name,
                    showscale=False,
                    opacity=0.9,
                    colorscale=[[0, color], [1, color]],
                    surfacecolor=np.zeros_like(x),
                )
            )
        return drawn

    low, high = extent(panels)
    figure = go.Figure(
        data=surfaces(samples[0]),
        frames=[go.Frame(data=surfaces(k), name=f"{simulation.t[k]:.2f}") for k in samples],
    )
    play = {
        "frame": {"duration": 1000 / rate, "redraw": True},
        "fromcurrent": True,
        "transition": {"duration": 0},
    }
    hold = {"frame": {"duration": 0, "redraw": True}, "mode": "immediate"}
    steps = [
        {"method": "animate", "label": frame.name, "args": [[frame.name], hold]}
        for frame in figure.frames
    ]
    figure.update_layout(
        title=title,
        showlegend=False,
        scene={
            "aspectmode": "data",
            "xaxis": {"title": "north [m]", "range": [low[0], high[0]]},
            "yaxis": {"title": "east [m]", "range": [high[1], low[1]]},
            "zaxis": {"title": "up [m]", "range": [-high[2], -low[2]]},
            "camera": {"eye": {"x": -1.9, "y": 1.7, "z": 0.8}},
        },
        sliders=[{"steps": steps, "currentvalue": {"prefix": "time [s] "}, "pad": {"t": 30}}],
        updatemenus=[
            {
                "type": "buttons",
                "showactive": False,
                "direction": "left",
                "x": 0.0,
                "y": 1.05,
                "buttons": [
                    {"label": "play", "method": "animate", "args": [None, play]},
                    {"label": "pause", "method": "animate", "args": [[None], hold]},
                ],
            }
        ],
        margin={"l": 0, "r": 0, "t": 60 if title else 30, "b": 0},
    )
    figure.write_html(
        path, include_plotlyjs=True, full_html=True, auto_play=False, default_height="95vh"
    )
