"""Curvature bases from modes; oracle: the exact modes of a uniform cantilever.

Bending φ_k with cosh β cos β = −1 and torsion sin((k − 1/2) π ξ), as in case D01 (the wing of M.J.
Patil, D.H. Hodges, C.E.S. Cesnik, J. Aircraft 38(1), 2001, doi 10.2514/2.2738).
"""

import csv
import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from curvcasadi.beam.basis import VectorBasis
from curvcasadi.beam.modal import Modes, round_trip_error
from curvcasadi.files.modes import COLUMNS, load_modes, modal_basis
from curvcasadi.loads.kinds import PointForce
from curvcasadi.reference_wings import hale_wing
from curvcasadi.statics.equilibrium import solve_equilibrium

LENGTH = 16.0
BETAS = (1.875104068711961, 4.694091132974174, 7.854757438237613, 10.995540734875467)
XI = np.linspace(0, 1, 401)


def bending(k, xi, derivative):
    """φ_k and its derivatives with respect to xi, closed form."""
    beta = BETAS[k]
    x = beta * xi
    sigma = (np.sinh(beta) - np.sin(beta)) / (np.cosh(beta) + np.cos(beta))
    form = [
        np.cosh(x) - np.cos(x) - sigma * (np.sinh(x) - np.sin(x)),
        np.sinh(x) + np.sin(x) - sigma * (np.cosh(x) - np.cos(x)),
        np.cosh(x) + np.cos(x) - sigma * (np.sinh(x) + np.sin(x)),
    ][derivative]
    return beta**derivative * form


def torsion(k, xi, derivative):
    omega = (k + 0.5) * np.pi
    return omega**derivative * (np.sin if derivative == 0 else np.cos)(omega * xi)


def exact_modes(stations=30, out_of_plane=3, twisting=2, in_plane=1, length=LENGTH):
    """Exact modes at evenly spaced stations, of various amplitudes and signs."""
    xi = np.linspace(0, 1, stations)
    u, r, labels = [], [], []
    for k in range(out_of_plane):
        w, slope = bending(k, xi, 0), bending(k, xi, 1) / length
        u.append([0 * xi, 0 * xi, w])
        r.append([0 * xi, -slope, 0 * xi])
        labels.append(f"flap {k + 1}")
    for k in range(twisting):
        u.append([0 * xi] * 3)
        r.append([-3 * torsion(k, xi, 0), 0 * xi, 0 * xi])
        labels.append(f"torsion {k + 1}")
    for k in range(in_plane):
        v, slope = bending(k, xi, 0), bending(k, xi, 1) / length
        u.append([0 * xi, 0.01 * v, 0 * xi])
        r.append([0 * xi, 0 * xi, 0.01 * slope])
        labels.append(f"edge {k + 1}")
    return Modes(
        stations=xi * length,
        displacements=np.array(u),
        rotations=np.array(r),
        labels=tuple(labels),
    )


@pytest.fixture
def modes_csv(tmp_path):
    """Writes modes as a CSV file, columns of rotations left empty if named."""

    def write(modes, empty=(), s=None):
        path = tmp_path / "modes.csv"
        stations = modes.stations if s is None else s
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            for label, u, r in zip(modes.labels, modes.displacements, modes.rotations, strict=True):
                for k, station in enumerate(stations):
                    line = dict(zip(COLUMNS, [label, station, *u[:, k], *r[:, k]], strict=True))
                    writer.writerow("" if c in empty else line[c] for c in COLUMNS)
        return path

    return write


def sampled(basis):
    return np.array([basis(xi) for xi in XI])


def largest_error(stations):
    """Of the curvature functions of exact bending and torsion modes, against φ'' and θ'."""
    phi = sampled(modal_basis(exact_modes(stations)).basis)
    # Largest at the root: φ''(0) = 2 β² > 0 as amplitudes go; out of plane K_y = −φ''.
    flap = [-bending(k, XI, 2) / bending(k, 0.0, 2) for k in range(3)]
    twist = [-torsion(k, XI, 1) / torsion(k, 0.0, 1) for k in range(2)]
    edge = [bending(0, XI, 2) / bending(0, 0.0, 2)]
    zero = [0 * XI] * 6
    expected = [zero[:3] + twist + zero[:1], flap + zero[:3], zero[:5] + edge]
    return np.max(np.abs(phi - np.moveaxis(expected, 2, 0)), axis=(0, 1))


class TestExactModes:
    def test_the_basis_is_the_curvature_of_the_modes(self):
        # Derivative of a cubic spline: h³ of the fourth derivative of the rotation, of a mode
        # (β h)³/24 at the ends: 1.1e-5, 1.8e-4, 8.3e-4 times a constant below 5.
        h = 1 / 29
        waves = np.array([*BETAS[:3], 0.5 * np.pi, 1.5 * np.pi, BETAS[0]])
        assert np.all(largest_error(30) <= 5 * (waves * h) ** 3 / 24)

    def test_the_curvature_converges_with_the_third_power_of_the_spacing(self):
        rates = np.log2(largest_error(30) / largest_error(59))
        assert_allclose(rates, 3, atol=0.2)

    def test_the_round_trip_gives_the_modes_back(self):
        errors = modal_basis(exact_modes(30)).round_trip_error
        # Rotations pass through the spline; displacements are its integral, of order h⁴.
        assert_allclose(errors, 0, atol=3e-6)
        assert_allclose(errors[3:5], 0, atol=1e-15)

    def test_the_round_trip_converges_with_the_fourth_power_of_the_spacing(self):
        errors = [round_trip_error(exact_modes(stations, twisting=0)) for stations in (30, 59)]
        assert np.all(np.log2(errors[0] / errors[1]) >= 3.8)

    def test_curvatures_of_displacements_alone_lack_only_the_twist(self, modes_csv):
        differences = []
        for stations in (59, 117):
            modes = exact_modes(stations, twisting=0)
            found = modal_basis(modes_csv(modes, empty=("r_x", "r_y", "r_z")))
            expected = sampled(modal_basis(modes).basis)
            differences.append(np.abs(sampled(found.basis) - expected).max(axis=(0, 1)))
            assert np.all(found.round_trip_error <= [1.4e-6, 2.2e-5, 1e-4, 1.4e-6])  # (β h)³/24
        # Slopes at the ends are known to h³, and differentiated once more.
        rates = np.log2(differences[0] / differences[1])
        assert_allclose(rates, 2, atol=0.2)

    def test_a_given_twist_stays_where_slopes_are_missing(self, modes_csv):
        modes = exact_modes(30, out_of_plane=1)
        found = modal_basis(modes_csv(modes, empty=("r_y", "r_z")))
        expected = sampled(modal_basis(modes).basis)
        assert_allclose(sampled(found.basis)[:, 0], expected[:, 0], atol=1e-14)


class TestModalBasis:
    def test_functions_have_the_sign_of_their_mode_and_a_largest_magnitude_of_1(self):
        modes = exact_modes(30)
        phi = np.array([modal_basis(modes).basis(xi) for xi in modes.stations / LENGTH])
        # The same spline at the same stations.
        assert_allclose(np.linalg.norm(phi, axis=1).max(axis=0), 1, rtol=1e-14)
        turned = replace(modes, displacements=-modes.displacements, rotations=-modes.rotations)
        assert_allclose(sampled(modal_basis(turned).basis), -sampled(modal_basis(modes).basis))

    def test_a_coupled_mode_keeps_its_ratio_of_twist_to_bending(self):
        modes = exact_modes(30, out_of_plane=1, twisting=1, in_plane=0)
        coupled = Modes(
            stations=modes.stations,
            displacements=modes.displacements.sum(axis=0, keepdims=True),
            rotations=modes.rotations.sum(axis=0, keepdims=True),
            labels=("coupled",),
        )
        k = modal_basis(coupled).basis(0.0)[:, 0]
        expected = [-3 * torsion(0, 0.0, 1) / LENGTH, -bending(0, 0.0, 2) / LENGTH**2, 0]
        assert_allclose(k, expected / np.linalg.norm(expected), atol=1e-4)  # the splines' error

    def test_it_takes_the_first_modes_and_their_labels(self):
        found = modal_basis(exact_modes(30), 4)
        assert isinstance(found.basis, VectorBasis) and found.basis.n == 4
        assert found.labels == ("flap 1", "flap 2", "flap 3", "torsion 1") == found.basis.labels
        assert found.round_trip_error.shape == (4,)
        assert_allclose(sampled(found.basis), sampled(modal_basis(exact_modes(30)).basis)[..., :4])

    def test_a_file_gives_the_basis_of_its_arrays(self, modes_csv):
        modes = exact_modes(12)
        found, expected = modal_basis(modes_csv(modes)), modal_basis(modes)
        assert found.labels == tuple(f"mode {label}" for label in modes.labels)
        # Every digit is written.
        np.testing.assert_array_equal(sampled(found.basis), sampled(expected.basis))
        np.testing.assert_array_equal(found.round_trip_error, expected.round_trip_error)

    def test_stations_may_be_normalized(self, modes_csv):
        modes = exact_modes(12)
        path = modes_csv(modes, s=modes.stations / LENGTH)
        assert_allclose(load_modes(path, length=LENGTH).stations, modes.stations, rtol=1e-15)
        assert_allclose(
            modal_basis(path, length=LENGTH).round_trip_error,
            modal_basis(modes).round_trip_error,
            atol=1e-15,
        )
        assert_allclose(load_modes(modes_csv(modes), length=LENGTH).stations, modes.stations)

    def test_stretch_and_shear_show_in_the_round_trip(self):
        modes = exact_modes(30, out_of_plane=1, twisting=0, in_plane=0)
        amplitude = np.abs(modes.rotations).max()
        stretched, sheared = modes.displacements.copy(), modes.displacements.copy()
        stretched[0, 0] = 0.01 * amplitude * modes.stations
        sheared[0, 2] += 0.02 * amplitude * modes.stations
        for moved, error in ((stretched, 0.01), (sheared, 0.02)):
            found = modal_basis(replace(modes, displacements=moved)).round_trip_error
            # Over the largest of u/L and r, here the slope at the tip; the splines' error remains.
            assert_allclose(found, error, atol=1e-6)

    def test_a_rigid_motion_beside_the_bending_is_no_error(self):
        modes = exact_modes(30, out_of_plane=1, twisting=0, in_plane=0)
        u, r = modes.displacements.copy(), modes.rotations.copy()
        u[0, 2] += 0.3 - 0.1 * modes.stations
        r[0, 1] += 0.1
        moved = modal_basis(replace(modes, displacements=u, rotations=r))
        assert_allclose(moved.round_trip_error, 0, atol=1e-6)  # the splines' error
        assert_allclose(sampled(moved.basis), sampled(modal_basis(modes).basis), atol=1e-12)

    def test_two_stations_make_a_constant_curvature(self):
        modes = Modes(
            stations=[0, 2.0],
            displacements=[[[0, 0], [0, 0], [0, 0]]],
            rotations=[[[0, 1.0], [0, 0], [0, 0]]],
            labels=("twist",),
        )
        assert_allclose(sampled(modal_basis(modes).basis)[:, :, 0], [[1.0, 0, 0]] * len(XI))


class TestEquilibrium:
    FORCE = (PointForce(1.0, [0, 0, -100.0]),)

    def solved(self, basis):
        wing = replace(hale_wing(), basis=basis, weight_bounds=None)
        return solve_equilibrium(wing, self.FORCE).shape.tip.position.full().ravel()

    def test_few_modes_bend_the_wing_under_a_tip_force(self):
        """The wing of case D01, its tip raised by 6 m of 16: nonlinear by far."""
        expected = self.solved(hale_wing(3, 8, 4).basis)
        assert 0.35 * LENGTH < -expected[2] < 0.45 * LENGTH
        counts = (2, 3, 4)
        errors = [
            np.linalg.norm(self.solved(modal_basis(exact_modes(30, n)).basis) - expected)
            for n in counts
        ]
        # A tip force bends with a slope of K_y at the tip, where those of all φ'' vanish. Mode k
        # brings 4/β⁴ of the linear compliance of the tip, 1/3; nonlinearly the tip is stiffer.
        lost = [1 - 3 * sum(4 / beta**4 for beta in BETAS[:n]) for n in counts]
        assert np.all(np.array(errors) <= np.multiply(lost, -expected[2]))


HEADER = ",".join(COLUMNS)


class TestErrors:
    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", f"line 1: expected the columns {', '.join(COLUMNS)}, found no mode, s, u_x, "),
            ("mode,s,u_x,u_y,u_z,r_x,r_y\n", "line 1: expected the columns mode, s, u_x, u_y, u_z, "
             "r_x, r_y, r_z, found no r_z"),
            (f"{HEADER},f\n", f"line 1: expected the columns {', '.join(COLUMNS)}, found the "
             "unknown f"),
            (f"{HEADER}\n", "line 2: expected a station of a mode, found none"),
            (f"{HEADER}\n1,0,0,0,0,0,0\n", "line 2: expected 8 cells, as in line 1, found 7"),
            (f"{HEADER}\n,0,0,0,0,0,0,0\n", "line 2, column mode: expected the name of a mode, "
             "found ''"),
            (f"{HEADER}\n1,0,0,0,0,0,0,0\n1,1,0,0,nan,0,0.1,0\n",
             "line 3, column u_z: expected a finite number, found 'nan'"),
            (f"{HEADER}\n1,0,0,0,0,0,0,0\n1,1,0,0,0,0,,0\n1,2,0,0,0,0,1,0\n",
             "line 3, column r_y: expected a finite number, found ''"),
            (f"{HEADER}\n1,0,,0,0,0,0,0\n1,1,,0,0,0,0,0\n",
             "line 2, column u_x: expected a finite number, found ''"),
            (f"{HEADER}\n1,0,0,0,0,0,0,0\n1,b,0,0,0,0,1,0\n",
             "line 3, column s: expected a finite number, found 'b'"),
            (f"{HEADER}\n1,0.5,0,0,0,0,0,0\n1,1,0,0,0,0,1,0\n",
             "line 2, column s: expected 0, the root, first, found 0.5"),
            (f"{HEADER}\n1,0,0,0,0,0,0,0\n1,2,0,0,0,0,1,0\n1,1,0,0,0,0,0,0\n",
             "line 4, column s: expected above 2, the station of mode 1 before, found 1"),
            (f"{HEADER}\n1,0,0,0,0,0,0,0\n1,1,0,0,0,0,1,0\n1,1,0,0,0,0,0,0\n",
             "line 4, column s: expected above 1, the station of mode 1 before, found 1"),
            (f"{HEADER}\n1,0,0,0,0,0,0,0\n",
             "line 2, column s: expected more for mode 1, found 1"),
            (f"{HEADER}\n1,0,0,0,0,0,0,0\n1,1,0,0,0,0,1,0\n2,0,0,0,0,0,0,0\n2,1.1,0,0,0,0,1,0\n",
             "line 5, column s: expected 1, station 2 of mode 1, for mode 2, too, found 1.1"),
            (f"{HEADER}\n1,0,0,0,0,0,0,0\n1,1,0,0,0,0,1,0\n2,0,0,0,0,0,0,0\n",
             "line 4, column s: expected 2 stations as of mode 1 for mode 2, found 1"),
            (f"{HEADER}\n1,0,0,0,0,0,0,0\n1,1,0,0,0,0,1,0\n2,0,0,0,0,0,0,0\n2,1,0,0,0,1,0,0\n"
             "2,2,0,0,0,1,0,0\n",
             "line 6, column s: expected 2 stations as of mode 1 for mode 2, found 3"),
        ],
    )  # fmt: skip
    def test_a_wrong_file_is_refused_with_line_and_column(self, tmp_path, text, message):
        path = tmp_path / "modes.csv"
        path.write_text(text)
        with pytest.raises(ValueError, match=re.escape(f"{path}: {message}")):
            modal_basis(path)

    def test_a_length_that_is_not_the_last_station_is_refused(self, modes_csv):
        path = modes_csv(exact_modes(5, 1, 0, 0))
        message = f"{path}: line 6, column s: expected 1 or 15 m, the tip, last, found 16"
        with pytest.raises(ValueError, match=re.escape(message)):
            modal_basis(path, length=15.0)

    def test_a_missing_file_is_named(self, tmp_path):
        with pytest.raises(FileNotFoundError, match=r"no\.csv: expected a readable file"):
            modal_basis(tmp_path / "no.csv")

    def test_more_modes_than_there_are_are_refused(self):
        with pytest.raises(ValueError, match="n: expected at most 6, the modes given, found 7"):
            modal_basis(exact_modes(30), 7)

    def test_a_mode_of_a_rigid_body_is_named(self):
        modes = exact_modes(30)
        u, r = modes.displacements.copy(), modes.rotations.copy()
        u[1] = np.array([[0], [0], [-0.1]]) * modes.stations
        r[1] = [[0], [0.1], [0]]
        rigid = replace(modes, displacements=u, rotations=r)
        with pytest.raises(ValueError, match="flap 2: expected a mode that bends or twists"):
            modal_basis(rigid)
        assert modal_basis(rigid, 1).labels == ("flap 1",)

    def test_a_mode_of_zeros_is_named(self):
        modes = exact_modes(30)
        u, r = modes.displacements.copy(), modes.rotations.copy()
        u[1], r[1] = 0, 0
        with pytest.raises(ValueError, match="flap 2: expected a mode that moves"):
            replace(modes, displacements=u, rotations=r)

    def test_a_mode_given_twice_is_named(self):
        modes = exact_modes(30)
        u, r = modes.displacements.copy(), modes.rotations.copy()
        u[2], r[2] = 2 * u[0], 2 * r[0]
        with pytest.raises(ValueError, match="flap 3: expected a curvature of its own"):
            modal_basis(replace(modes, displacements=u, rotations=r))

    @pytest.mark.parametrize(
        ("fields", "message"),
        [
            ({"stations": [0, 2, 1]}, "Modes.stations: expected two or more increasing numbers"),
            ({"stations": [0]}, "Modes.stations: expected two or more increasing numbers from 0"),
            ({"stations": [0, 1]},
             "Modes.displacements: expected shape (2, 3, 2), found (2, 3, 3)"),
            ({"rotations": np.zeros((2, 3))}, "Modes.rotations: expected shape (2, 3, 3), found"),
            ({"rotations": np.full((2, 3, 3), np.nan)}, "Modes.rotations: expected finite numbers"),
        ],
    )  # fmt: skip
    def test_wrong_arrays_are_named(self, fields, message):
        with pytest.raises(ValueError, match=re.escape(message)):
            replace(exact_modes(3, 2, 0, 0), **fields)
