"""Modes of Nastran files; oracle: the exact modes of which these were written.

`reference/nastran` holds a line of grid points in mm, swept by 20°, whose displacement axes are in
turn basic, CORD2R and CORD2C; bulk data, F06 and OP2 were written by pyNastran 1.4.1, the punch
file to the same format. A grid point 900 lies beside the line. The OP2 stands there in hexadecimal
digits.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from curvcasadi.files import load_beam, load_nastran_modes, modal_basis, write_modes
from curvcasadi.files.modes import load_modes
from tests.beam.test_modal import LENGTH, exact_modes

pytest.importorskip("pyyeti", reason="pyyeti, of the extra fem")

FILES = Path(__file__).parents[1] / "reference" / "nastran"
BDF = FILES / "wing.bdf"
GRIDS = range(101, 113)
LINE = {"grids": GRIDS, "leading_edge": [-1, 0, 0], "length_unit": 1e-3}


@pytest.fixture(scope="module")
def exact():
    return exact_modes(12, out_of_plane=2, twisting=1, in_plane=1)


@pytest.fixture(scope="module")
def op2(tmp_path_factory):
    path = tmp_path_factory.mktemp("nastran") / "wing.op2"
    path.write_bytes(bytes.fromhex((FILES / "wing.op2.hex").read_text()))
    return path


@pytest.mark.parametrize("ending", ["op2", "f06", "pch"])
def test_eigenvectors_become_modes_in_local_axes(exact, op2, ending):
    path = op2 if ending == "op2" else FILES / f"wing.{ending}"
    modes = load_nastran_modes(BDF, path, **LINE)
    assert modes.labels == ("mode 1", "mode 2", "mode 3", "mode 4")
    # Seven digits of the vectors, of the largest component; places in mm have four decimals.
    assert_allclose(modes.stations, exact.stations, atol=1e-6)
    for found, expected in (
        (modes.displacements, exact.displacements),
        (modes.rotations, exact.rotations),
    ):
        largest = np.abs(expected).max(axis=(1, 2), keepdims=True) + 1e-9
        assert_allclose(found / largest, expected / largest, atol=2e-6)


def test_the_basis_is_that_of_the_exact_modes(exact, op2):
    modes = load_nastran_modes(BDF, op2, **LINE)
    found, expected = modal_basis(modes).basis, modal_basis(exact).basis
    for xi in (0.0, 0.3, 0.77, 1.0):
        # Float vectors, differentiated by splines over 11 intervals.
        assert_allclose(found(xi), expected(xi), atol=1e-4)


def test_a_model_in_other_units_is_scaled(op2):
    in_metres = load_nastran_modes(BDF, op2, **LINE)
    in_km = load_nastran_modes(BDF, op2, **{**LINE, "length_unit": 1.0})
    assert_allclose(in_km.stations, 1000 * in_metres.stations)
    assert_allclose(in_km.displacements, 1000 * in_metres.displacements)
    assert_allclose(in_km.rotations, in_metres.rotations)


def test_written_modes_are_read_back(exact, tmp_path):
    path = tmp_path / "modes.csv"
    write_modes(path, exact)
    found = load_modes(path)
    assert found.labels == tuple(f"mode {label}" for label in exact.labels)
    np.testing.assert_array_equal(found.stations, exact.stations)
    np.testing.assert_array_equal(found.displacements, exact.displacements)
    np.testing.assert_array_equal(found.rotations, exact.rotations)
    write_modes(path, found)
    assert load_modes(path).labels == found.labels


def test_a_wing_file_takes_modes(exact, tmp_path):
    write_modes(tmp_path / "modes.csv", exact)
    path = tmp_path / "wing.toml"
    path.write_text(
        f'[beam]\nlength = {LENGTH}\n[basis]\nkind = "modal"\nmodes = "modes.csv"\nn = 3\n'
        '[grid]\nkind = "uniform"\nelements = 4\n'
    )
    beam = load_beam(path)
    assert beam.basis.n == 3
    assert_allclose(beam.basis(0.4), modal_basis(exact, 3).basis(0.4))
    path.write_text(path.read_text().replace("n = 3", 'torsion = { family = "legendre", n = 2 }'))
    with pytest.raises(ValueError, match=r"\[basis\] torsion: expected no channels with 'modal'"):
        load_beam(path)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"grids": [101, 999]}, r"grids: expected two or more grid points .* found 999"),
        ({"grids": [101]}, r"grids: expected two or more"),
        ({"grids": [101, 900, 112]}, r"expected grid points on a straight line"),
        ({"leading_edge": [np.sin(0.349065850399), np.cos(0.349065850399), 0]}, "across the line"),
        ({"leading_edge": [1, 0]}, r"leading_edge: expected shape \(3,\)"),
        ({"length_unit": 0.0}, "length_unit: expected"),
    ],
)
def test_a_wrong_line_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        load_nastran_modes(BDF, FILES / "wing.f06", **{**LINE, **changed})


def test_wrong_files_are_refused(tmp_path):
    (tmp_path / "wing.op2").write_bytes(b"no such format" * 20)
    (tmp_path / "wing.f06").write_text(" nothing here\n")
    (tmp_path / "wing.txt").write_text("\n")
    for name, message in (
        ("wing.op2", "wing.op2: expected an OP2 file"),
        ("wing.f06", "wing.f06: expected real eigenvectors, found none"),
        ("wing.txt", "expected a file that ends with .op2, .f06"),
    ):
        with pytest.raises(ValueError, match=message):
            load_nastran_modes(BDF, tmp_path / name, **LINE)
    broken = (FILES / "wing.pch").read_text().replace(" 2.227678E+01", " 2.2x7678E+01")
    (tmp_path / "wing.pch").write_text(broken)
    with pytest.raises(ValueError, match=r"line 10: expected a number, found '2.2x7678E\+01'"):
        load_nastran_modes(BDF, tmp_path / "wing.pch", **LINE)
    (tmp_path / "wing.bdf").write_text("GRID,101,,0.,x\n")
    with pytest.raises(ValueError, match=r"wing.bdf: GRID 101: expected numbers, found 'x'"):
        load_nastran_modes(tmp_path / "wing.bdf", FILES / "wing.f06", **LINE)


def test_numpy_prints_as_before():
    before = np.get_printoptions()
    load_nastran_modes(BDF, FILES / "wing.f06", **LINE)
    assert np.get_printoptions() == before


def test_a_missing_library_names_the_extra(monkeypatch):
    for name in ("pyyeti", "pyyeti.nastran", "pyyeti.nastran.bulk"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=r'pip install "curvcasadi\[fem\]"'):
        load_nastran_modes(BDF, FILES / "wing.f06", **LINE)
