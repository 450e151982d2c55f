"""A beam with other stiffness and mass."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

WING = hale_wing(2, 2, 1, grid=cc.Grid.lobatto(4))
LOADED = replace(
    WING, bodies=(cc.Body(xi=0.5, mass=2.0, inertia=np.diag([1.0, 2.0, 2.5]), offset=[0, 0.1, 0]),)
)
FACTORS = {"GJ": 1.1, "EI": 0.9, "mass": 1.05}


def test_a_beam_that_is_stiffer_and_heavier_alike_swings_alike():
    heavier = cc.perturbed_beam(LOADED, GJ=1.3, EI=1.3, mass=1.3)
    frequencies = [cc.natural_frequencies(beam) for beam in (LOADED, heavier)]
    np.testing.assert_allclose(*frequencies, rtol=1e-10)


def test_frequencies_follow_the_factors():
    straight = cc.natural_frequencies(WING)
    softer = cc.natural_frequencies(cc.perturbed_beam(WING, EI=0.81, GJ=0.81))
    np.testing.assert_allclose(softer, 0.9 * straight, rtol=1e-10)
    heavier = cc.natural_frequencies(cc.perturbed_beam(WING, mass=4))
    np.testing.assert_allclose(heavier, straight / 2, rtol=1e-10)


def test_a_coupled_stiffness_that_varies_is_scaled_on_both_sides():
    matrix = np.array([[2.0, 0.9, 0.3], [0.9, 1.0, 0.2], [0.3, 0.2, 3.0]])
    section = cc.Section.from_stiffness(lambda xi: (1 + xi) * matrix, mass_per_length=1.0)
    beam = cc.perturbed_beam(replace(WING, section=section), **FACTORS)
    root = np.diag(np.sqrt([1.1, 0.9, 0.9]))
    np.testing.assert_allclose(
        beam.section.stiffness(0.5).full(), 1.5 * root @ matrix @ root, rtol=1e-14
    )
    assert float(beam.section.mass_at(0.3)) == pytest.approx(1.05)


def test_factors_may_be_symbols():
    symbols = {name: ca.MX.sym(name) for name in FACTORS}
    q, q_dot = np.full(5, 0.01), np.zeros(5)
    found = ca.Function(
        "acceleration",
        [*symbols.values()],
        [cc.forward_dynamics(cc.perturbed_beam(LOADED, **symbols), ca.MX(q), ca.MX(q_dot))],
    )(*FACTORS.values())
    beam = cc.perturbed_beam(LOADED, **FACTORS)
    np.testing.assert_allclose(found, cc.forward_dynamics(beam, ca.DM(q), ca.DM(q_dot)), rtol=1e-12)


@pytest.mark.parametrize(
    ("mistake", "words"),
    [
        (lambda: cc.perturbed_beam(None), "beam: expected a Beam"),
        (lambda: cc.perturbed_beam(replace(WING, section=None)), "beam: expected a beam with a"),
        (lambda: cc.perturbed_beam(WING, GJ=0), "GJ: expected a number above zero"),
        (lambda: cc.perturbed_beam(WING, EI=np.nan), "EI: expected finite numbers"),
        (lambda: cc.perturbed_beam(WING, mass=[1, 2]), "mass: expected shape"),
    ],
)
def test_mistakes_are_named(mistake, words):
    with pytest.raises(ValueError, match=words):
        mistake()
