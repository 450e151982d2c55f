"""Mistakes of a new user are named: the argument, what was expected, what was found."""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.lie import series
from curvcasadi.plotting.figures import save_figure
from curvcasadi.plotting.shape import plot_shape
from curvcasadi.reference_wings import hale_wing

WING = hale_wing()
GOAL = [cc.Target(xi=1, position=[0, 14.3, -6])]
LENGTH = ca.MX.sym("length")


def beam_of_symbolic_length():
    basis = cc.ChannelBasis(out_of_plane=cc.Legendre(2))
    return cc.Beam(length=LENGTH, basis=basis, grid=cc.Grid.uniform(4))


MISTAKES = {
    "no beam": (lambda: cc.tip_function(None), "beam: expected a Beam, found None"),
    "no beam to reach": (lambda: cc.reach_shape(None, GOAL), "beam: expected a Beam"),
    "arguments swapped": (lambda: cc.shape_map(np.zeros(9), WING), "beam: expected a Beam"),
    "a beam as model": (lambda: cc.rk4_step(WING, 0.1), "model: expected a ControlModel"),
    "a beam as model of an MPC": (
        lambda: cc.tip_path_step_function(WING, dt=0.1, horizon=2),
        "model: expected a ControlModel",
    ),
    "one load": (
        lambda: cc.solve_equilibrium(WING, cc.Gravity([0, 0, 9.81])),
        "loads: expected a sequence, found Gravity",
    ),
    "one load of a moving wing": (
        lambda: cc.forward_dynamics(WING, np.zeros(9), np.zeros(9), cc.Gravity([0, 0, 9.81])),
        "loads: expected a sequence, found Gravity",
    ),
    "one body": (
        lambda: replace(WING, bodies=cc.Body(xi=1, mass=1)),
        "Beam.bodies: expected a sequence, found Body",
    ),
    "one value of a table": (
        lambda: cc.Piecewise([0, 1], 3),
        "Piecewise.values: expected a sequence, found 3",
    ),
    "a position that is no number": (
        lambda: cc.WingGeometry(length=1.0, position=[0, np.nan, 0]),
        "WingGeometry.position: expected finite numbers",
    ),
    "name with a space": (
        lambda: cc.pose_function("a b", WING, [1.0]),
        "name: expected letters, digits",
    ),
    "name of a solver with a space": (
        lambda: cc.shape_target_function(WING, GOAL, name="a b"),
        "name: expected letters, digits",
    ),
    "unknown QP solver": (
        lambda: cc.shape_target_function(WING, GOAL, qp_solver="nosuch"),
        "qp_solver: expected 'own' or a QP solver of CasADi, found 'nosuch'",
    ),
    "unknown NLP solver": (
        lambda: cc.reach_shape(WING, GOAL, solver="nosuch"),
        "solver: expected an NLP solver of CasADi, found 'nosuch'",
    ),
    "parameters as a list": (
        lambda: cc.tip_function(beam_of_symbolic_length(), parameters=[LENGTH]),
        "parameters: expected a Mapping",
    ),
    "one symbol twice": (
        lambda: cc.tip_function(beam_of_symbolic_length(), parameters={"a": LENGTH, "b": LENGTH}),
        "parameters: expected each symbol once",
    ),
    "name of an output": (
        lambda: cc.tip_function(beam_of_symbolic_length(), parameters={"position": LENGTH}),
        "parameters: expected names of their own, found position",
    ),
    "degree for a negative angle": (
        lambda: series.degree_for(-1),
        r"max_angle: expected an angle in \(0, 2 π\] rad, found -1",
    ),
    "negative order": (
        lambda: series.c(-1, ca.DM(1)),
        "k, degree: expected numbers not below zero",
    ),
    "no body": (
        lambda: cc.Beam(length=1, basis=WING.basis, grid=WING.grid, bodies=(3,)),
        "Beam.bodies: expected a Body, found 3",
    ),
    "no basis function": (
        lambda: cc.VectorBasis(3, 2),
        "VectorBasis.function: expected a function",
    ),
    "break off the beam": (
        lambda: cc.VectorBasis(lambda xi: np.zeros((3, 1)), 1, breaks=(1.3,)),
        r"VectorBasis.breaks: expected a number in \[0, 1\], found 1.3",
    ),
    "None for numbers": (lambda: cc.shape_map(WING, None), "q: expected numbers, found None"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_named(mistake):
    call, message = MISTAKES[mistake]
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("name", ["double", "sin", "main"])
def test_names_that_c_has_taken_are_refused(name, tmp_path):
    with pytest.raises(ValueError, match=f"found '{name}'"):
        cc.export_c([cc.pose_function(name, WING, [1.0])], tmp_path)


@pytest.mark.parametrize("name", ["figure", "figure.xyz"])
def test_figures_without_a_known_extension_are_refused(name, tmp_path):
    with pytest.raises(ValueError, match=r"expected a file name that ends in one of .*png"):
        save_figure(plot_shape(WING, np.zeros(9)), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_reached_target_whose_best_shape_was_not_found_is_told():
    result = cc.reach_shape(WING, GOAL, solver_options={"ipopt.max_iter": 0})
    assert result.reached and not result.converged
    assert "the best shape among those that reach was not found" in result.message


def test_the_whole_wing_is_drawn():
    (axes,) = plot_shape(WING, np.zeros(9)).axes
    # matplotlib clips to a square that a wide wing leaves.
    assert not any(artist.get_clip_on() for artist in [*axes.lines, *axes.collections])


def hale_aircraft():
    return cc.load_aircraft(Path(__file__).parents[2] / "ocp_examples" / "hale_aircraft.toml")


def surface_named(name):
    plane = hale_aircraft()
    return lambda: replace(plane, surfaces=(replace(plane.surfaces[0], name=name),))


AIRCRAFT_MISTAKES = {
    "surface named as the weight": (surface_named("weight"), "Aircraft: expected different names"),
    "surface named as the thrust": (surface_named("thrust"), "Aircraft: expected different names"),
    "direction of two": (
        lambda: cc.Thrust(direction=[2, 0, 0]),
        r"Thrust\.direction: expected a unit vector",
    ),
    "pose that is no rotation": (
        lambda: replace(
            hale_aircraft().surfaces[0], pose=cc.Pose(rotation=2 * np.eye(3), position=[0, 0, 0])
        ),
        r"Pose\.rotation: expected orthonormal columns",
    ),
    "weight twice": (
        lambda: replace(hale_aircraft().beams[0], loads=(cc.Gravity([0, 0, 9.81]),)),
        r"Wing\.loads: expected loads beside the weight, found Gravity",
    ),
    "climb of ten degrees in degrees": (
        lambda: cc.trim(hale_aircraft(), speed=28, density=0.0889, flight_path=10),
        "flight_path: expected an angle within ±π/2 rad, found 10",
    ),
    "attitude that is no rotation": (
        lambda: cc.generalized_force(
            WING, np.zeros(9), [cc.Gravity([0, 0, 9.81])], attitude=2 * np.eye(3)
        ),
        "attitude: expected orthonormal columns",
    ),
}


@pytest.mark.parametrize("mistake", AIRCRAFT_MISTAKES)
def test_mistakes_with_loads_and_aircraft_are_named(mistake):
    call, message = AIRCRAFT_MISTAKES[mistake]
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("kind", ["uniform", "lobatto"])
def test_breaks_do_not_spoil_distributed_loads(kind):
    edges = (0, 0.1, 0.2, 0.35, 0.5, 0.77, 1)
    beams = [
        cc.Beam(
            length=16.0,
            basis=cc.ChannelBasis(out_of_plane=cc.Legendre(5)),
            grid=getattr(cc.Grid, kind)(elements),
            section=cc.Section(GJ=1e4, EI_y=EI, EI_z=4e6),
        )
        for EI, elements in ((cc.Steps(edges, [2e4] * 6), 8), (2e4, 64))
    ]
    load = [cc.DistributedForce([0, 0, 1.0])]
    broken, whole = (cc.generalized_force(beam, np.zeros(5), load).full() for beam in beams)
    # Three elements to a panel: Gauss–Lobatto is exact to degree 5, other weights to degree 3, of a
    # displacement of degree 6. With one element to a panel the error was 4e-3.
    tolerance = {"lobatto": 1e-5, "uniform": 1e-4}[kind]
    np.testing.assert_allclose(broken, whole, atol=tolerance * np.abs(whole).max())
