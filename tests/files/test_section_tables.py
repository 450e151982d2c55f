"""Full section matrices of BeamDyn and SHARPy files, condensed for a beam without shear."""

import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from curvcasadi.beam.section import condense_axial
from curvcasadi.beam.section_table import SectionTable, condense
from curvcasadi.files import load_beam, load_beamdyn_sections, load_sharpy_sections

#: In local axes, of (K_x, K_y, K_z, stretch, shear y, shear z): an uncoupled section.
EA, GA_y, GA_z, GJ, EI_y, EI_z = 2e7, 3e6, 1e6, 1.1e4, 2.2e4, 4.4e5
MASS, C_Y, C_Z = 3.0, 0.02, -0.01
J = np.array([[0.5, 0.0, 0.0], [0.0, 0.1, 0.02], [0.0, 0.02, 0.4]])  # about the centre of mass


def hat(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def local_matrices(y=0.0, scale=1.0):
    """Stiffness and mass of (angular, linear), the tension axis at `y` from the reference curve."""
    S = np.diag([GJ, EI_y, EI_z, EA, GA_y, GA_z]) * scale
    # A force at y: strain there is ε + K × (0, y, 0).
    shift = np.eye(6)
    shift[3:, :3] = -hat([0, y, 0])
    S = shift.T @ S @ shift
    c = np.array([0, C_Y, C_Z])
    M = np.zeros((6, 6))
    M[3:, 3:] = MASS * np.eye(3)
    M[:3, 3:] = MASS * hat(c)
    M[3:, :3] = MASS * hat(c).T
    M[:3, :3] = J + MASS * (c @ c * np.eye(3) - np.outer(c, c))
    return S, M


def beamdyn_matrices(S, M):
    """The same in BeamDyn's order and axes, written out component by component."""
    # (force, moment) along BeamDyn's x, y, z = local z, −y, x.
    place = [5, 4, 3, 2, 1, 0]
    sign = np.array([1, -1, 1, 1, -1, 1])
    return tuple(A[np.ix_(place, place)] * np.outer(sign, sign) for A in (S, M))


HEAD = """ ------- BEAMDYN V1.00.* INDIVIDUAL BLADE INPUT FILE --------------------------
 Test blade
------ Blade Parameters --------------------------------------------------------
{n:d}                      station_total    - Number of blade input stations (-)
1                       damp_type        - Damping type (switch)
------ Stiffness-Proportional Damping [used only if damp_type=1] ---------------
   mu1        mu2        mu3        mu4        mu5        mu6
   (-)        (-)        (-)        (-)        (-)        (-)
1.0E-03    1.0E-03    1.0E-03     0.0014      0.0022     0.0022
------ Distributed Properties --------------------------------------------------
"""


@pytest.fixture
def blade(tmp_path):
    """A BeamDyn file of three stations whose stiffness falls to half at the tip."""
    path = tmp_path / "blade.inp"
    text = HEAD.format(n=3)
    for eta, scale in ((0.0, 1.0), (0.5, 0.75), (1.0, 0.5)):
        text += f"  {eta:.6f}\n"
        for A in beamdyn_matrices(*local_matrices(0.1, scale)):
            text += "\n".join("".join(f"{v:16.8E}" for v in row) for row in A) + "\n\n"
    path.write_text(text)
    return path


@pytest.fixture
def structure(tmp_path):
    """A SHARPy file of a right and a left wing of two elements each."""
    h5py = pytest.importorskip("h5py", reason="h5py, of the extra fem")
    path = tmp_path / "case.fem.h5"
    S, M = local_matrices(0.1)
    half = np.array([0.0, 1.0, 2.0, 3.5, 5.0])
    y = np.r_[half, -half[1:]]
    order = [3, 4, 5, 0, 1, 2]  # SHARPy has forces first, in the same axes of a right wing
    turn = np.diag([1, -1, -1, 1, -1, -1])
    right = [A[np.ix_(order, order)] for A in (S, M)]
    left = [turn @ A @ turn for A in right]
    with h5py.File(path, "w") as file:
        file["coordinates"] = np.column_stack([0 * y, y, 0 * y])
        file["connectivities"] = np.array([[0, 2, 1], [2, 4, 3], [0, 6, 5], [6, 8, 7]])
        file["beam_number"] = np.array([0, 0, 1, 1])
        file["elem_stiffness"] = np.array([0, 1, 2, 3])
        file["elem_mass"] = np.array([0, 0, 1, 1])
        file["stiffness_db"] = np.array([right[0], 0.5 * right[0], left[0], 0.5 * left[0]])
        file["mass_db"] = np.array([right[1], left[1]])
    return path


def assert_is_the_test_section(section, xi, scale):
    S = local_matrices(0.1, scale)[0]
    assert_allclose(section.stiffness(xi).full(), condense(S), rtol=1e-7)
    # Without forces the place of the reference curve does not matter.
    expected = np.diag([GJ, EI_y, EI_z]) * scale
    assert_allclose(section.stiffness(xi).full(), expected, rtol=1e-7, atol=1e-3)
    assert_allclose(section.mass_at(xi), MASS)
    assert_allclose(np.asarray(section.center_of_mass_at(xi)).ravel(), [0, C_Y, C_Z], atol=1e-9)
    assert_allclose(np.asarray(section.inertia_at(xi)), J, atol=1e-8)


def test_condensing_is_the_flexibility_of_curvature_by_moments():
    random = np.random.default_rng(3).normal(size=(6, 6))
    S = random @ random.T + np.eye(6)
    assert_allclose(np.linalg.inv(condense(S)), np.linalg.inv(S)[:3, :3], rtol=1e-10)
    S[4:, :4] = S[:4, 4:] = 0  # no coupling with shear: the axial strain alone
    four = S[np.ix_([3, 0, 1, 2], [3, 0, 1, 2])]
    assert_allclose(condense(S), condense_axial(four), rtol=1e-12)


def test_a_beamdyn_file_gives_sections_in_local_axes(blade):
    table = load_beamdyn_sections(blade)
    for xi, scale in ((0.0, 1.0), (0.5, 0.75), (0.25, 0.875), (1.0, 0.5)):
        assert_is_the_test_section(table.section, xi, scale)


@pytest.mark.parametrize(("beam", "y"), [(0, "leading_edge"), (1, "trailing_edge")])
def test_a_sharpy_file_gives_sections_in_local_axes(structure, beam, y):
    table = load_sharpy_sections(structure, beam=beam, y=y)
    assert_allclose(table.length, 5.0)
    assert_allclose(table.xi, [0, 0.4, 1])
    assert_is_the_test_section(table.section, 0.2, 1.0)
    assert_is_the_test_section(table.section, 0.7, 0.5)
    assert table.section.breaks == (0.4,)


def test_the_shear_left_out_is_that_of_timoshenko():
    S, M = local_matrices()
    length = 4.0
    table = SectionTable(xi=[0, 1], stiffness=[S], mass=[M], length=length)
    report = table.condensation()
    for share, EI, GA in (
        (report.shear_share_y, EI_z, GA_y),
        (report.shear_share_z, EI_y, GA_z),
    ):
        shear, bending = length / GA, length**3 / (3 * EI)  # deflections by a unit tip force
        assert_allclose(share, shear / (shear + bending), rtol=1e-10)
    assert_allclose(report.stretch, length / EA, rtol=1e-10)
    assert_allclose(report.stiffening, 0, atol=1e-12)


def test_suppressed_strain_stiffens_a_section_off_its_tension_axis():
    S, M = local_matrices(0.1)
    report = SectionTable(xi=[0, 1], stiffness=[S], mass=[M]).condensation(4.0)
    # In-plane bending about the reference curve has EI_z + y² EA, torsion GJ + y² GA_z.
    shear = 0.1**2 * GA_z / GJ
    assert_allclose(report.stiffening, max(0.1**2 * EA / EI_z, shear), rtol=1e-9)
    assert "stiffer" in str(report) and "out of plane" in str(report)


def test_a_table_of_two_halves_is_integrated_by_intervals():
    S, M = local_matrices()
    table = SectionTable(xi=[0, 0.5, 1], stiffness=[S, S / 2], mass=[M, M])
    whole = table.condensation(2.0)
    assert_allclose(whole.stretch, 1.0 / EA + 2.0 / EA, rtol=1e-12)
    with pytest.raises(ValueError, match="length: expected a length, m, as the table has none"):
        table.condensation()


def test_a_wing_file_takes_a_table(blade, structure):
    wing = (
        '[beam]\nlength = 5.0\n[basis]\nout_of_plane = { family = "legendre", n = 2 }\n'
        '[grid]\nkind = "uniform"\nelements = 4\n[section]\n'
    )
    path = blade.parent / "wing.toml"
    path.write_text(wing + 'beamdyn = "blade.inp"\n')
    assert_is_the_test_section(load_beam(path).section, 0.5, 0.75)
    path.write_text(wing + 'sharpy = "case.fem.h5"\nbeam = 1\ny = "trailing_edge"\n')
    assert_is_the_test_section(load_beam(path).section, 0.7, 0.5)
    path.write_text(wing + 'beamdyn = "blade.inp"\nGJ = 1.0\n')
    with pytest.raises(ValueError, match=r"\[section\] GJ: expected one of the keys beamdyn"):
        load_beam(path)


def test_wrong_blade_files_are_refused(blade):
    text = blade.read_text()
    for changed, message in (
        (text.replace("station_total", "stations"), "found no line of station_total"),
        (text.replace("3     ", "4     ", 1), "expected 73 numbers for each of 4 stations"),
        (text.replace("0.500000\n", "half\n"), r"line \d+: expected numbers, found 'half'"),
        (text.replace("3.00000000E+00", "3.10000000E+00", 1), r"SectionTable.mass at xi = 0"),
        (text.replace("2.00000000E+07", "-2.00000000E+07"), "SectionTable.stiffness at xi = 0"),
        (text.replace("Distributed", ""), "heading 'Distributed Properties'"),
    ):
        blade.write_text(changed)
        with pytest.raises(ValueError, match=message):
            load_beamdyn_sections(blade)


def test_wrong_structural_files_are_refused(structure, tmp_path):
    import h5py

    with pytest.raises(ValueError, match=r"expected a beam 7 among \[0, 1\], found none"):
        load_sharpy_sections(structure, beam=7, y="leading_edge")
    with pytest.raises(ValueError, match="y: expected one of leading_edge, trailing_edge"):
        load_sharpy_sections(structure, beam=0, y="up")
    with h5py.File(structure, "a") as file:
        file["connectivities"][1] = [3, 4, 2]
    with pytest.raises(ValueError, match=r"begin at node 2, .* found node 3"):
        load_sharpy_sections(structure, beam=0, y="leading_edge")
    with h5py.File(structure, "a") as file:
        del file["mass_db"]
    with pytest.raises(ValueError, match="found no mass_db"):
        load_sharpy_sections(structure, beam=0, y="leading_edge")
    text = tmp_path / "text.h5"
    text.write_text("text")
    with pytest.raises(ValueError, match="expected an HDF5 file"):
        load_sharpy_sections(text, beam=0, y="leading_edge")


def test_a_missing_library_names_the_extra(monkeypatch, structure):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ImportError, match=r'pip install "curvcasadi\[fem\]"'):
        load_sharpy_sections(structure, beam=0, y="leading_edge")
