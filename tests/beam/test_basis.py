"""Curvature bases: the matrix Φ of Eq. 3."""

from __future__ import annotations

from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import eval_legendre

import curvcasadi as cc
from curvcasadi.beam.basis import MirroredBasis


def test_channels_stack_torsion_out_of_plane_in_plane():
    basis = cc.ChannelBasis(
        in_plane=cc.Monomial(1), torsion=cc.Legendre(2), out_of_plane=cc.Monomial(3)
    )
    xi = 0.3
    expected = np.zeros((3, 6))
    expected[0, :2] = eval_legendre([0, 1], 2 * xi - 1)
    expected[1, 2:5] = [1, xi, xi**2]
    expected[2, 5] = 1
    assert basis.n == 6
    assert_allclose(basis(xi), expected, rtol=1e-15)  # rounding


def test_channels_may_be_absent():
    basis = cc.ChannelBasis(in_plane=cc.Legendre(2))
    assert basis.n == 2
    assert_allclose(basis(0.25), [[0, 0], [0, 0], [1, -0.5]], rtol=1e-15)


def test_labels_name_the_channel_and_the_function():
    basis = cc.ChannelBasis(torsion=cc.Legendre(1), in_plane=cc.Monomial(2))
    assert basis.labels == ("torsion: Legendre 0", "in_plane: Monomial 0", "in_plane: Monomial 1")


def test_breaks_of_the_channels_are_merged():
    basis = cc.ChannelBasis(
        torsion=cc.PiecewiseConstant(2),
        out_of_plane=cc.PiecewiseConstant(4),
        in_plane=cc.Legendre(3),
    )
    assert basis.breaks == (0.25, 0.5, 0.75)


def test_channel_basis_refuses_to_be_empty():
    with pytest.raises(ValueError, match=r"ChannelBasis: expected a family.*found none"):
        cc.ChannelBasis()


@pytest.mark.parametrize("family", [3, "legendre", cc.Legendre, np.ones(3)], ids=str)
def test_channel_basis_refuses_what_is_not_a_family(family):
    with pytest.raises(ValueError, match=r"ChannelBasis\.out_of_plane: expected a family.*found"):
        cc.ChannelBasis(out_of_plane=family)


def test_vector_basis_passes_coupled_functions_through():
    basis = cc.VectorBasis(lambda xi: [[1, xi], [xi, 0], [0, -1]], 2, breaks=(0.5,))
    assert_allclose(basis(0.25), [[1, 0.25], [0.25, 0], [0, -1]], rtol=0)
    assert basis.n == 2
    assert basis.breaks == (0.5,)
    assert len(set(basis.labels)) == 2


@pytest.mark.parametrize(
    "function", [lambda xi: np.ones((3, 3)), lambda xi: np.ones(3), lambda xi: [[1], [2]]]
)
def test_vector_basis_refuses_a_wrong_shape(function):
    with pytest.raises(ValueError, match=r"VectorBasis\.function: expected finite \(3, 2\).*found"):
        cc.VectorBasis(function, 2)


def test_vector_basis_refuses_nan_wherever_it_is_evaluated():
    basis = cc.VectorBasis(lambda xi: np.full((3, 1), np.nan if xi == 0.3 else 1.0), 1)
    with pytest.raises(ValueError, match=r"VectorBasis\.function at xi = 0\.3: expected"):
        basis(0.3)


@pytest.mark.parametrize("n", [0, -2, 1.5])
def test_vector_basis_refuses_to_be_empty(n):
    with pytest.raises(ValueError, match=r"VectorBasis\.n: expected a whole number.*found"):
        cc.VectorBasis(lambda xi: np.ones((3, 1)), n)


def test_mirrored_basis_flips_torsion_and_out_of_plane():
    original = cc.VectorBasis(lambda xi: np.ones((3, 2)), 2, breaks=(0.5,))
    mirrored = MirroredBasis(original)
    assert_allclose(mirrored(0.1), [[-1, -1], [-1, -1], [1, 1]], rtol=0)
    assert (mirrored.n, mirrored.labels, mirrored.breaks) == (2, original.labels, (0.5,))


def test_bases_are_frozen():
    basis = cc.ChannelBasis(torsion=cc.Legendre(1))
    with pytest.raises(FrozenInstanceError):
        basis.torsion = cc.Legendre(2)
