"""Pictures of a flight: what they show, and the page in a browser."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image

import curvcasadi as cc
from curvcasadi.lie import quaternion
from curvcasadi.plotting.flight_panels import extent, flight_panels
from tests.support.flying_aircraft import aircraft

TIMES = np.linspace(0, 0.5, 6)
_DRAWN = {"slider-group": 1, "slider-tick-rect": len(TIMES), "updatemenu-button": 2}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


@pytest.fixture(scope="module")
def flight():
    """A motion that is made up: a climbing roll, the wings bent more and more."""
    model = cc.aircraft_model(aircraft(), density=1.0, gravity=0, lag=None)
    parts = {part.name: np.zeros((part.size, len(TIMES))) for part in model.x.parts}
    turned = [quaternion.exp(ca.DM([0.8 * t, 0.1, 0])).full().ravel() for t in TIMES]
    parts["quaternion_wxyz"] = np.transpose(turned)
    parts["position"] = np.array([20 * TIMES, 2 * TIMES, -3 * TIMES**2])
    parts["q_right"] = parts["q_left"] = np.outer([0, -0.1, 0, 0], TIMES)
    parts["twist"][3] = 20.0
    x = np.vstack([parts[part.name] for part in model.x.parts])
    u = np.ones((model.u.size, len(TIMES))) * 0.1
    y = np.hstack([model.output(a, b, []).full() for a, b in zip(x.T, u.T, strict=True)])
    p = np.zeros((0, len(TIMES)))
    return cc.Simulation(
        model=model, t=TIMES, x=x, u=u, p=p, y=y, iterations=1.0, success=True, message="made up"
    )


def test_surfaces_stand_where_the_aircraft_is(flight):
    right, left, tail, *_ = flight_panels(aircraft(), flight)
    mean = np.array([20.0, 2.0, 0.0])
    for k, t in enumerate(TIMES):
        x = flight.model.x.split(ca.DM(flight.x[:, k]))
        attitude, seen = quaternion.rotation(x["quaternion_wxyz"]), x["position"] - mean * t
        wing = aircraft().beams[0]
        tip = cc.pose_at(wing.beam, x["q_right"], 1.0)
        ahead = 0.2 + 1.1 / 4  # of the aerodynamic centre, then to the leading edge
        edge = seen + attitude @ (tip.position + tip.rotation @ ca.DM([0, ahead, 0]))
        assert_allclose(right.front[k][:, [-1]], edge, atol=1e-12)
        for panel in (right, left):
            chord = np.linalg.norm(panel.front[k] - panel.back[k], axis=0)
            assert_allclose(chord, 1.1, rtol=1e-12)
        corners = np.linalg.norm(np.diff(tail.front[k], axis=1))
        assert_allclose(corners, 1.5 / 0.5, rtol=1e-12)
    low, high = extent([right, left])
    assert high[1] - low[1] > 14
    assert high[2] <= 3


def test_a_figure_shows_the_history_with_units(flight):
    figure = cc.plot_flight(flight, title="a flight")
    labels = " ".join(axes.get_ylabel() for axes in figure.axes)
    for unit in ("[m/s]", "[m]", "[deg]", "[deg/s]", "[N m]", "[N]"):
        assert unit in labels
    heights = figure.axes[1].lines[0].get_ydata()
    assert_allclose(heights, 3 * TIMES**2, atol=1e-12)
    roll = next(line for line in figure.axes[2].lines if line.get_label() == "roll")
    assert roll.get_ydata()[-1] > 20


def test_a_film_has_a_frame_for_each_sample(flight, tmp_path):
    path = tmp_path / "flight.gif"
    cc.animate_flight(aircraft(), flight, path, progress=False)
    with Image.open(path) as image:
        assert image.n_frames == len(TIMES)
        first = np.asarray(image.convert("RGB"), dtype=int)
        image.seek(len(TIMES) - 1)
        assert np.abs(np.asarray(image.convert("RGB"), dtype=int) - first).max() > 50


@pytest.fixture(scope="module")
def page(flight, tmp_path_factory):
    pytest.importorskip("plotly", reason="no plotly")
    path = tmp_path_factory.mktemp("page") / "flight.html"
    cc.animate_flight(aircraft(), flight, path, title="a flight", progress=False)
    return path


def test_a_page_needs_no_other_file(page):
    text = page.read_text(encoding="utf-8")
    outside = re.findall(r"<(?:script|link|img)[^>]*(?:src|href)=[^>]*>", text)
    assert not outside
    assert "a flight" in text


def test_a_browser_shows_the_page(page, tmp_path):
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip(f"no headless browser among {', '.join(BROWSERS)}")
    options = ["--headless", "--no-sandbox", "--enable-unsafe-swiftshader", "--window-size=900,700"]
    options += [f"--user-data-dir={tmp_path}", "--virtual-time-budget=8000", "--dump-dom"]
    found = subprocess.run(
        [browser, *options, page.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    # Drawn by the page's own script: the scene, a slider with a step for each sample, two buttons.
    drawn = {word: found.stdout.count(f'class="{word}"') for word in _DRAWN}
    assert "<canvas" in found.stdout
    assert drawn == _DRAWN


def test_what_a_picture_lacks_is_named(flight, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match=r"expected a file name that ends in \.gif or \.mp4 or"):
        cc.animate_flight(aircraft(), flight, tmp_path / "flight.avi")
    bare = cc.aircraft_model(aircraft(), density=0, outputs=())
    other = cc.Simulation(**{**vars(flight), "model": bare, "y": np.zeros((0, len(TIMES)))})
    with pytest.raises(ValueError, match="simulation: expected one of an aircraft_model with"):
        cc.plot_flight(other)
    monkeypatch.setitem(sys.modules, "plotly", None)
    monkeypatch.setitem(sys.modules, "plotly.graph_objects", None)
    with pytest.raises(ValueError, match=r"needs plotly, .* curvcasadi\[flight\]"):
        cc.animate_flight(aircraft(), flight, tmp_path / "flight.html")
