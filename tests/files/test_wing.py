"""Wing files, weight files and shape files."""

import csv
import json
import re
import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from curvcasadi.beam.along import Piecewise, Steps
from curvcasadi.beam.compliance import ComplianceBasis
from curvcasadi.beam.families import (
    BSpline,
    CantileverModes,
    Chebyshev,
    FreeTip,
    Legendre,
    Monomial,
    PiecewiseConstant,
    Tabulated,
)
from curvcasadi.beam.geometry import WingGeometry, wing_root
from curvcasadi.beam.section import Section, condense_axial
from curvcasadi.files import (
    FAMILIES,
    SHAPE_COLUMNS,
    load_beam,
    load_weights,
    load_wing,
    write_shape,
)
from curvcasadi.kinematics.history import shape_history
from curvcasadi.kinematics.shape import shape_map
from curvcasadi.loads.kinds import (
    DistributedForce,
    DistributedMoment,
    Gravity,
    PointForce,
    PointMoment,
)
from curvcasadi.reference_wings import hale_wing
from curvcasadi.statics.balance import root_wrench
from curvcasadi.statics.equilibrium import solve_equilibrium

EXAMPLES = Path(__file__).parents[2] / "ocp_examples"
REFERENCE = Path(__file__).parents[1] / "reference"
HALE_WING = EXAMPLES / "hale_wing.toml"
WING = {
    "beam": "length = 2.0",
    "basis": 'out_of_plane = { family = "legendre", n = 2 }',
    "grid": 'kind = "uniform"\nelements = 4',
    "section": "GJ = 1.0\nEI_y = 2.0\nEI_z = 3.0",
}


@pytest.fixture
def wing(tmp_path):
    """Writes a wing file, some tables replaced; a table of None is left out, a list an array."""

    def write(**tables):
        lines = [
            f"[[{name}]]\n{entry}" if isinstance(content, list) else f"[{name}]\n{entry}"
            for name, content in {**WING, **tables}.items()
            for entry in (content if isinstance(content, list) else [content])
            if entry is not None
        ]
        text = "\n".join(lines)
        path = tmp_path / "wing.toml"
        path.write_text(text)
        return path

    return write


@pytest.fixture
def history_csv(tmp_path):
    def write(text):
        path = tmp_path / "weights.csv"
        path.write_text(text)
        return path

    return write


def refused(path, message, load=load_beam):
    with pytest.raises(ValueError, match=re.escape(f"{path}: {message}")):
        load(path)


class TestWingFile:
    def test_the_sample_file_is_the_published_wing(self):
        beam, published = load_beam(HALE_WING), hale_wing()
        assert beam.length == published.length and beam.basis.labels == published.basis.labels
        assert beam.section.GJ == 1e4 and beam.section.EI_y == 2e4 and beam.section.EI_z == 4e6
        assert beam.section.mass_per_length == 0.75
        np.testing.assert_array_equal(beam.stations, published.stations)
        np.testing.assert_array_equal(beam.bounds, published.bounds)
        q = np.linspace(-0.04, 0.05, 9)
        expected = shape_map(published, q).positions.full()
        # The same numbers by the same code.
        np.testing.assert_array_equal(shape_map(beam, q).positions.full(), expected)

    def test_the_root_may_be_angles_of_a_half_wing(self, wing):
        root = "root = { position = [1, -2, 0], side = 'left', sweep = 0.3, incidence = 0.05 }"
        beam = load_beam(wing(beam=f"length = 5\n{root}"))
        expected = wing_root(side="left", sweep=0.3, incidence=0.05, position=[1, -2, 0])
        np.testing.assert_array_equal(beam.root.rotation.full(), expected.rotation.full())
        np.testing.assert_array_equal(beam.root.position.full(), expected.position.full())

    def test_a_geometry_stands_for_root_and_initial_curvature(self, wing):
        text = """length = 5
            [beam.geometry]
            position = [0, 0.5, 0]
            sweep = 0.1
            dihedral = { xi = [0, 0.5, 1], values = [0, 0.3] }
            twist = { xi = [0, 0.5, 1], values = [0.1, 0.05, 0] }"""
        beam = load_beam(wing(beam=text))
        expected = WingGeometry(
            length=5,
            sweep=0.1,
            dihedral=Piecewise([0, 0.5, 1], [0, 0.3]),
            twist=Piecewise([0, 0.5, 1], [0.1, 0.05, 0]),
            position=[0, 0.5, 0],
        )
        np.testing.assert_array_equal(beam.root.rotation.full(), expected.root.rotation.full())
        for xi in (0.2, 0.5005, 0.8):
            np.testing.assert_array_equal(
                beam.initial_curvature_at(xi).full().ravel(), expected.initial_curvature(xi)
            )

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("sweep = 20", "[beam.geometry] sweep: expected an angle between -π/2 and π/2, rad, "),
            ("sweap = 0.2", "[beam.geometry] sweap: expected one of the keys side, position, sw"),
            ("twist = { xi = [0, 1], values = [0.1] }",
             "[beam.geometry] twist: expected a number or a Piecewise with one value per station"),
            ("twist = { xi = [0, 1] }", "[beam.geometry.twist] values: expected a list of finite"),
        ],
    )  # fmt: skip
    def test_a_wrong_geometry_is_named(self, wing, text, message):
        refused(path := wing(beam=f"length = 5\n[beam.geometry]\n{text}"), message)
        assert path.exists()

    def test_a_geometry_beside_a_root_is_refused(self, wing):
        text = (
            "length = 5\nroot = { position = [0, 0, 0], sweep = 0.1 }\n[beam.geometry]\nsweep = 1"
        )
        refused(wing(beam=text), "[beam] geometry: expected no root beside it, found both")

    @pytest.mark.parametrize(
        ("text", "family"),
        [
            ('{ family = "legendre", n = 3 }', Legendre(3)),
            ('{ family = "monomial", n = 3 }', Monomial(3)),
            ('{ family = "chebyshev", n = 3 }', Chebyshev(3)),
            ('{ family = "bspline", n = 5 }', BSpline(5)),
            ('{ family = "bspline", n = 5, degree = 2 }', BSpline(5, degree=2)),
            ('{ family = "cantilever_modes", n = 2 }', CantileverModes(2)),
            ('{ family = "free_tip", n = 3 }', FreeTip(3)),
            ('{ family = "free_tip", n = 3, order = 1 }', FreeTip(3, order=1)),
            ('{ family = "piecewise_constant", n = 4 }', PiecewiseConstant(4)),
            (
                '{ family = "tabulated", xi = [0, 0.4, 1], values = [[1, 0], [0.5, 2], [0, 1]] }',
                Tabulated([0, 0.4, 1], [[1, 0], [0.5, 2], [0, 1]]),
            ),
        ],
    )
    def test_every_family_has_a_name(self, wing, text, family):
        basis = load_beam(wing(basis=f"in_plane = {text}")).basis
        assert type(basis.in_plane) is type(family) and type(family) in FAMILIES.values()
        for xi in (0.0, 0.3, 0.9):
            np.testing.assert_array_equal(basis(xi), [0 * family(xi), 0 * family(xi), family(xi)])

    def test_a_basis_of_moments_takes_the_section_of_the_file(self, wing):
        section = "xi = [0, 0.4, 1]\nGJ = [1.0, 1.0]\nEI_y = [2.0, 0.5]\nEI_z = [3.0, 3.0]"
        channels = 'kind = "compliance"\nout_of_plane = { family = "free_tip", n = 2 }'
        beam = load_beam(wing(basis=channels, section=section))
        expected = ComplianceBasis(beam.section, out_of_plane=FreeTip(2))
        assert beam.basis.breaks == (0.4,) and isinstance(beam.basis, ComplianceBasis)
        for xi in (0.1, 0.7):
            np.testing.assert_array_equal(beam.basis(xi), expected(xi))

    def test_grids_are_uniform_lobatto_or_custom(self, wing):
        stations = load_beam(wing(grid='kind = "uniform"\nelements = 2')).stations
        np.testing.assert_allclose(stations, [0, 0.5, 1], atol=1e-15)
        stations = load_beam(wing(grid='kind = "lobatto"\nelements = 3')).stations
        # Interior Gauss-Lobatto points of four: (1 ± 1/√5)/2.
        np.testing.assert_allclose(stations[1:3], 0.5 + np.array([-0.5, 0.5]) / 5**0.5, atol=1e-15)
        stations = load_beam(wing(grid='kind = "custom"\nboundaries = [0, 0.3, 1]')).stations
        np.testing.assert_array_equal(stations, [0, 0.3, 1])

    def test_a_grid_carries_its_options(self, wing):
        options = 'rule = "midpoint"\nexponential = "rodrigues"\nmax_angle = 0.5\nreal = "float"'
        grid = load_beam(wing(grid=f"{WING['grid']}\n{options}")).grid
        assert (grid.rule, grid.exponential, grid.max_angle) == ("midpoint", "rodrigues", 0.5)
        assert grid.real == "float"

    def test_a_rotation_vector_turns_the_root(self, wing):
        root = "root = { position = [1, 2, 3], rotation_vector = [0, 0, 1.5707963267948966] }"
        pose = load_beam(wing(beam=f"length = 2.0\n{root}")).root
        # A quarter turn about z takes x to y and y to −x.
        expected = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
        np.testing.assert_allclose(pose.rotation.full(), expected, atol=1e-15)
        np.testing.assert_array_equal(pose.position.full(), [[1], [2], [3]])

    def test_a_root_without_a_position_is_at_the_origin(self, wing):
        for root in ("sweep = 0.1", "rotation_vector = [0.1, 0, 0]"):
            pose = load_beam(wing(beam=f"length = 2.0\nroot = {{ {root} }}")).root
            np.testing.assert_array_equal(pose.position.full(), np.zeros((3, 1)))

    def test_initial_curvature_is_constant_or_linear_between_samples(self, wing):
        beam = load_beam(wing(beam="length = 2.0\ninitial_curvature = [0.1, 0.2, 0.3]"))
        np.testing.assert_array_equal(
            beam.initial_curvature_at(0.7).full().ravel(), [0.1, 0.2, 0.3]
        )
        table = "{ xi = [0, 0.5, 1], values = [[0, 0, 0], [1, 2, 3], [1, 0, 3]] }"
        beam = load_beam(wing(beam=f"length = 2.0\ninitial_curvature = {table}"))
        assert beam.breaks == (0.5,)
        k0 = [beam.initial_curvature_at(xi).full().ravel() for xi in (0.25, 0.75)]
        np.testing.assert_allclose(k0, [[0.5, 1, 1.5], [1, 1, 3]], atol=1e-15)

    @pytest.mark.parametrize(
        ("text", "lower", "upper"),
        [
            ("0.2", [-0.2, -0.2], [0.2, 0.2]),
            ("[0.2, 0.3]", [-0.2, -0.3], [0.2, 0.3]),
            ("{ lower = -0.1, upper = [0.2, 0.3] }", [-0.1, -0.1], [0.2, 0.3]),
            ("{ lower = -inf, upper = 1 }", [-np.inf, -np.inf], [1, 1]),
        ],
    )
    def test_weight_bounds_are_one_number_several_or_a_pair(self, wing, text, lower, upper):
        beam = load_beam(wing(beam=f"length = 2.0\nweight_bounds = {text}"))
        np.testing.assert_array_equal(beam.bounds, [lower, upper])

    def test_a_section_is_optional(self, wing):
        assert load_beam(wing(section=None)).section is None

    @pytest.mark.parametrize(
        ("tables", "message"),
        [
            ({"grid": None}, "grid: expected a table, found no such key"),
            ({"baem": ""}, "baem: expected one of the keys beam, basis, grid, section, "
             "bodies, loads, aerodynamics, airstream, sensors, estimation, simulation; "
             "found an unknown key, nearest to beam"),
            ({"beam": "lenght = 2.0"}, "[beam] lenght: expected one of the keys length, root, "
             "geometry, initial_curvature, weight_bounds; found an unknown key, nearest to length"),
            ({"beam": ""}, "[beam] length: expected a finite number, found no such key"),
            ({"beam": "length = '2'"}, "[beam] length: expected a finite number, found '2'"),
            ({"beam": "length = true"}, "[beam] length: expected a finite number, found True"),
            ({"beam": "length = nan"}, "[beam] length: expected a finite number, found nan"),
            ({"beam": "length = -1"}, "[beam] length: expected a number above zero, found -1.0"),
            ({"basis": ""}, "[basis] expected a family for torsion, out_of_plane or in_plane, "
             "found none"),
            ({"basis": "torsion = 3"}, "[basis] torsion: expected a table of family, n, found 3"),
            ({"basis": "bending = {}"}, "[basis] bending: expected one of the keys torsion, "
             "out_of_plane, in_plane, kind; found an unknown key, nearest to "),
            ({"basis": "torsion = { n = 3 }"}, "[basis.torsion] family: expected one of legendre, "
             "monomial, chebyshev, bspline, cantilever_modes, free_tip, piecewise_constant, "
             "tabulated, found no such key"),
            ({"basis": 'kind = "moments"'},
             "[basis] kind: expected one of channels, compliance, modal, found 'moments'"),
            ({"basis": 'kind = "compliance"\ntorsion = { family = "legendre", n = 1 }',
              "section": None},
             "[basis] kind: expected a table [section] for 'compliance', found none"),
            ({"basis": 'torsion = { family = "free_tip", n = 3, order = 3 }'},
             "[basis.torsion] order: expected one of 1, 2; found 3"),
            ({"basis": 'torsion = { family = "legendr", n = 3 }'},
             "[basis.torsion] family: expected one of legendre, "),
            ({"basis": 'torsion = { family = "legendre" }'},
             "[basis.torsion] n: expected a whole number, found no such key"),
            ({"basis": 'torsion = { family = "legendre", n = 2.5 }'},
             "[basis.torsion] n: expected a whole number, found 2.5"),
            ({"basis": 'torsion = { family = "legendre", n = 0 }'},
             "[basis.torsion] n: expected a whole number of at least 1, found 0"),
            ({"basis": 'torsion = { family = "legendre", n = 2, degree = 3 }'},
             "[basis.torsion] degree: expected one of the keys family, n; found an unknown key, "
             "nearest to "),
            ({"basis": 'torsion = { family = "bspline", n = 3 }'},
             "[basis.torsion] n: expected a whole number of at least 4, found 3"),
            ({"basis": 'torsion = { family = "tabulated", xi = [0, 1], values = [[1], [1, 2]] }'},
             "[basis.torsion] values: expected a list of equally long rows of finite numbers, "
             "found [[1], [1, 2]]"),
            ({"basis": 'torsion = { family = "tabulated", xi = [0, 0.5], values = [[1], [1]] }'},
             "[basis.torsion] xi: expected increasing stations that cover 0 to 1"),
            ({"grid": "elements = 4"}, "[grid] kind: expected one of uniform, lobatto, custom, "
             "found no such key"),
            ({"grid": 'kind = "chebyshev"\nelements = 4'}, "[grid] kind: expected one of uniform, "
             "lobatto, custom, found 'chebyshev'"),
            ({"grid": 'kind = "custom"\nelements = 4'}, "[grid] elements: expected one of the keys "
             "kind, boundaries, rule, "),
            ({"grid": 'kind = "custom"\nboundaries = [0, 0.5]'},
             "[grid] boundaries: expected increasing stations that cover 0 to 1"),
            ({"grid": f'{WING["grid"]}\nrule = "magnus5"'},
             "[grid] rule: expected one of 'trapezoid', 'midpoint', 'magnus4', 'magnus6'; "
             "found 'magnus5'"),
            ({"grid": f"{WING['grid']}\nmax_angle = 9"},
             "[grid] max_angle: expected an angle in (0, π] rad, found 9"),
            ({"section": "GJ = 1.0\nEI_y = 2.0"},
             "[section] EI_z: expected a finite number, found no such key"),
            ({"section": f"{WING['section']}\nei_y = 1.0"}, "[section] ei_y: expected one of the "
             "keys GJ, EI_y, EI_z, coupling_xy, coupling_xz, coupling_yz, mass_per_length, "
             "inertia, center_of_mass, stiffness, xi; found an unknown key, nearest to EI_y"),
            ({"section": "GJ = -1.0\nEI_y = 2.0\nEI_z = 3.0"},
             "[section] GJ: expected a number above zero, found -1.0"),
        ],
    )  # fmt: skip
    def test_a_wrong_key_is_named_with_what_was_expected_and_found(self, wing, tables, message):
        refused(wing(**tables), message)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("root = { position = [0, 0, 0] }",
             "[beam.root] expected rotation, rotation_vector, or side, sweep, dihedral and "
             "incidence; found none of them"),
            ("root = { position = [0, 0, 0], rotation_vector = [0, 0, 0], "
             "rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]] }",
             "[beam.root] expected rotation, rotation_vector, or side, sweep, dihedral and "
             "incidence; found rotation, rotation_vector"),
            ("root = { rotation_vector = [0, 0, 90] }",
             "[beam.root] rotation_vector: expected a rotation vector of at most 2π rad, "
             "found [0.0, 0.0, 90.0] of length 90; degrees?"),
            ("root = { position = [0, 0], rotation_vector = [0, 0, 0] }",
             "[beam.root] position: expected 3 finite numbers, found [0, 0]"),
            ("root = { position = [0, 0, 0], rotation = [[1, 0, 0], [0, 1, 0]] }",
             "[beam.root] rotation: expected 3 rows of 3 finite numbers, found "
             "[[1, 0, 0], [0, 1, 0]]"),
            ("root = { position = [0, 0, 0], rotation = [[1, 0, 0], [0, 2, 0], [0, 0, 1]] }",
             "[beam.root] rotation: expected orthonormal columns, to 0.01; found "),
            ("root = { position = [0, 0, 0], rotation = [[1, 0, 0], [0, 1, 0], [0, 0, -1]] }",
             "[beam.root] rotation: expected a right-handed frame, found the reflection "),
            ("root = 3", "[beam] root: expected a table of position, rotation, found 3"),
            ("initial_curvature = [0, 0]", "[beam] initial_curvature: expected 3 finite numbers or "
             "a table of xi, values, found [0, 0]"),
            ("initial_curvature = { xi = [0, 1], values = [[0, 0, 0], [0, 0]] }",
             "[beam.initial_curvature] values: expected a list of rows of 3 finite numbers, "
             "found [[0, 0, 0], [0, 0]]"),
            ("initial_curvature = { xi = [0, 0.5, 1], values = [[0, 0, 0], [0, 0, 0]] }",
             "[beam.initial_curvature] values: expected shape (3, n), found (2, 3)"),
            ("weight_bounds = '1'", "[beam] weight_bounds: expected a number or a list of numbers "
             "or a table of lower, upper, found '1'"),
            ("weight_bounds = [1, 2, 3]", "[beam] weight_bounds: expected a number, 2 numbers or a "
             "pair (lower, upper) of these, found [1, 2, 3]"),
            ("weight_bounds = nan", "[beam] weight_bounds: expected lower bounds not above upper"),
            ("weight_bounds = { lower = 1 }", "[beam.weight_bounds] upper: expected a number or a "
             "list of numbers, found no such key"),
            ("weight_bounds = { lower = 1, upper = 0 }",
             "[beam] weight_bounds: expected lower bounds not above upper ones, found "),
        ],
    )  # fmt: skip
    def test_a_wrong_beam_value_is_named(self, wing, text, message):
        refused(wing(beam=f"length = 2.0\n{text}"), message)

    def test_invalid_toml_is_refused_with_its_line(self, wing):
        path = wing(beam="length = 2.0\nroot = ")
        with pytest.raises(ValueError, match=rf"{re.escape(str(path))}: expected TOML.* line 3"):
            load_beam(path)

    def test_a_file_that_is_no_text_is_refused(self, tmp_path):
        path = tmp_path / "wing.toml"
        path.write_bytes(b"\xff\xfe[beam]")
        refused(path, "line 1: expected UTF-8 text, found the byte 0xff; save the file as UTF-8")
        path.write_bytes("[beam]\nlength = 2.0  # für".encode("latin-1"))
        refused(path, "line 2: expected UTF-8 text, found the byte 0xfc; save the file as UTF-8")

    def test_a_missing_file_is_named(self, tmp_path):
        path = tmp_path / "no.toml"
        with pytest.raises(FileNotFoundError, match=re.escape(f"{path}: expected a readable file")):
            load_beam(path)


def matrices(section, *stations):
    return [section.stiffness(xi).full() for xi in stations]


class TestSectionTable:
    def test_rigidities_and_couplings_make_a_full_stiffness(self, wing):
        text = f"{WING['section']}\ncoupling_xy = 0.1\ncoupling_xz = -0.2\ncoupling_yz = 0.3"
        (found,) = matrices(load_beam(wing(section=text)).section, 0.5)
        expected = [[1, 0.1, -0.2], [0.1, 2, 0.3], [-0.2, 0.3, 3]]
        np.testing.assert_array_equal(found, expected)

    def test_lists_hold_a_value_for_each_interval(self, wing):
        text = """
            xi = [0, 0.3, 0.7, 1]
            GJ = [1.0, 2.0, 3.0]
            EI_y = 2.0
            EI_z = [4, 5, 6]
            coupling_xy = [0.1, 0, 0.2]
            mass_per_length = [1.0, 0, 0.5]
            inertia = [[[1, 0, 0], [0, 1, 0], [0, 0, 1]],
                       [[2, 0, 0], [0, 1, 0], [0, 0, 1]], [[3, 0, 0], [0, 1, 0], [0, 0, 1]]]
            center_of_mass = [[0, 0.1, 0], [0, 0.2, 0], [0, 0.3, 0]]
        """
        beam = load_beam(wing(section=text))
        section = beam.section
        assert section.breaks == beam.breaks == (0.3, 0.7)
        for k, xi in enumerate((0.1, 0.5, 0.9)):
            c = [0.1, 0, 0.2][k]
            expected = [[k + 1, c, 0], [c, 2, 0], [0, 0, k + 4]]
            np.testing.assert_array_equal(section.stiffness(xi).full(), expected)
            assert section.mass_at(xi) == [1.0, 0, 0.5][k]
            assert section.inertia(xi)[0][0] == k + 1
            assert float(section.center_of_mass_at(xi)[1]) == [0.1, 0.2, 0.3][k]

    def test_a_full_stiffness_may_have_axial_strain_and_differ_by_interval(self, wing):
        full = np.diag([1e6, 1.0, 2.0, 3.0])
        full[0, 1] = full[1, 0] = 500.0
        plain = np.diag([4.0, 5.0, 6.0])
        section = load_beam(wing(section=f"stiffness = {full.tolist()}")).section
        (found,) = matrices(section, 0.5)
        np.testing.assert_array_equal(found, condense_axial(full))
        both = f"xi = [0, 0.5, 1]\nstiffness = [{full.tolist()}, {plain.tolist()}]"
        found = matrices(load_beam(wing(section=both)).section, 0.2, 0.8)
        np.testing.assert_array_equal(found, [condense_axial(full), plain])

    def test_bodies_are_read_in_order(self, wing):
        bodies = [
            "xi = 0.5\nmass = 2.0",
            "xi = 1.0\nmass = 1.0\noffset = [0, 0.1, 0]\n"
            "inertia = [[1, 0, 0], [0, 2, 0], [0, 0, 3]]",
        ]
        beam = load_beam(wing(bodies=bodies))
        assert [(body.xi, body.mass) for body in beam.bodies] == [(0.5, 2.0), (1.0, 1.0)]
        np.testing.assert_array_equal(beam.bodies[1].offset.full().ravel(), [0, 0.1, 0])
        np.testing.assert_array_equal(np.diag(beam.bodies[1].inertia.full()), [1, 2, 3])
        assert beam.breaks == (0.5,)

    @pytest.mark.parametrize(
        ("section", "message"),
        [
            ("EI_y = 1\nEI_z = 1\nGJ = [1, 2]", "GJ: expected a finite number, found [1, 2]"),
            ("xi = [0, 0.5, 1]\nGJ = [1, 2, 3, 4]\nEI_y = 1\nEI_z = 1",
             "GJ: expected a finite number or a list of 2 of these, one for each interval of xi, "
             "or 3, one for each station, found [1, 2, 3, 4]"),
            ("xi = [0, 0.5]\nGJ = [1]\nEI_y = 1\nEI_z = 1",
             "xi: expected increasing stations that cover 0 to 1"),
            ("xi = [0, 0.6, 0.5, 1]\nGJ = [1, 1, 1]\nEI_y = 1\nEI_z = 1",
             "xi: expected increasing stations that cover 0 to 1, found [0.0, 0.6, 0.5, 1.0]"),
            ("xi = 0.5\nGJ = 1\nEI_y = 1\nEI_z = 1",
             "xi: expected a list of finite numbers, found 0.5"),
            ("xi = [0, 0.5, 1]\nGJ = [1, -2]\nEI_y = 1\nEI_z = 1",
             "GJ at xi = 0.75: expected a number above zero, found -2.0"),
            ("xi = [0, 0.5, 1]\nGJ = 1\nEI_y = 1\nEI_z = 1\nmass_per_length = [1, -1]",
             "mass_per_length at xi = 0.75: expected a number not below zero, found -1.0"),
            ("xi = [0, 0.5, 1]\nGJ = [800, 600, 0]\nEI_y = 1\nEI_z = 1",
             "GJ at xi = 1: expected a number above zero, found 0.0"),
            ("xi = [0, 0.5, 1]\nGJ = [-300, 600, 800]\nEI_y = 1\nEI_z = 1",
             "GJ at xi = 0: expected a number above zero, found -300.0"),
            ("xi = [0, 0.5, 0.5, 1]\nGJ = [800, -100, 600, 800]\nEI_y = 1\nEI_z = 1",
             "GJ at xi = 0.5: expected a number above zero, found -"),
            ("GJ = 1\nEI_y = 1\nEI_z = 1\nmass_per_length = -1",
             "mass_per_length: expected a number above zero, found -1.0"),
            ("GJ = 1\nEI_y = 1\nEI_z = 1\ncoupling_xy = 2",
             "stiffness at xi = 0.5: expected a positive definite matrix, found "),
            ("GJ = 1\nEI_y = 1\nEI_z = 1\nxi = [0, 0.5, 1]\ncoupling_xy = [0, 2]",
             "stiffness at xi = 0.75: expected a positive definite matrix, found "),
            ("GJ = 1\nEI_y = 1\nEI_z = 1\ninertia = [[1, 1, 0], [0, 1, 0], [0, 0, 1]]",
             "inertia: expected a symmetric matrix, to 1e-08 of its largest entry; found "),
            ("stiffness = [[1, 2, 0], [0, 1, 0], [0, 0, 1]]",
             "stiffness: expected a symmetric matrix, to 1e-08 of its largest entry; found "),
            ("stiffness = [[1, 0, 0], [0, -1, 0], [0, 0, 1]]",
             "stiffness: expected a positive definite matrix, found "),
            ("stiffness = [[1, 0], [0, 1]]", "stiffness: expected 3 rows of 3 finite numbers or "
             "4 rows of 4 finite numbers, found [[1, 0], [0, 1]]"),
            ("xi = [0, 0.5, 1]\nstiffness = [[[1, 0, 0], [0, 1, 0], [0, 0, 1]],"
             " [[1, 2, 0], [2, 1, 0], [0, 0, 1]]]",
             "stiffness at xi = 0.75: expected a positive definite matrix, found "),
            ("GJ = 1\nEI_y = 1\nstiffness = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
             "expected GJ, EI_y, EI_z and couplings, or stiffness, found stiffness and GJ, EI_y"),
            ("GJ = 1\nEI_y = 1\nEI_z = 1\nmass_per_lenght = 1",
             "mass_per_lenght: expected one of the keys GJ, EI_y, EI_z, "),
        ],
    )  # fmt: skip
    def test_a_wrong_section_is_named(self, wing, section, message):
        refused(wing(section=section), f"[section] {message}")

    @pytest.mark.parametrize(
        ("body", "message"),
        [
            ("mass = 1", "xi: expected a finite number, found no such key"),
            ("xi = 1.2\nmass = 1", "xi: expected a number in [0, 1], found 1.2"),
            ("xi = 1\nmass = -1", "mass: expected a number not below zero, found -1.0"),
            ("xi = 1\nmass = 1\noffset = 0.1", "offset: expected 3 finite numbers, found 0.1"),
            ("xi = 1\nmas = 1", "mas: expected one of the keys xi, mass, inertia, offset; "
             "found an unknown key, nearest to mass"),
        ],
    )  # fmt: skip
    def test_a_wrong_body_is_named_by_its_number(self, wing, body, message):
        refused(wing(bodies=["xi = 0.5\nmass = 1", body]), f"[bodies 2] {message}")

    def test_bodies_are_an_array(self, wing):
        refused(wing(bodies="xi = 1\nmass = 1"), "bodies: expected tables, found {")


class TestLoads:
    def test_every_type_becomes_its_load(self, wing):
        file = load_wing(wing(loads=[
            'type = "gravity"\nacceleration = [0, 0, -9.81]',
            'type = "point_force"\nxi = 1\nforce = [1, 2, 3]\nframe = "follower"\n'
            "offset = [0, 0.1, 0]",
            'type = "point_moment"\nxi = 0.5\nmoment = [4, 5, 6]\nframe = "body"',
            'type = "distributed_force"\nforce = [7, 8, 9]',
            'type = "distributed_moment"\nxi = [0, 0.4, 1]\nmoment = [[1, 0, 0], [2, 0, 0]]',
        ]))  # fmt: skip
        gravity, force, moment, spread, twist = file.loads
        kinds = [Gravity, PointForce, PointMoment, DistributedForce, DistributedMoment]
        assert [type(load) for load in file.loads] == kinds
        assert [load.frame for load in file.loads[1:]] == [
            "follower", "body", "dead", "dead"
        ]  # fmt: skip
        vectors = [gravity.acceleration, force.force, force.offset, moment.moment, spread.force]
        np.testing.assert_array_equal(
            [vector.full().ravel() for vector in vectors],
            [[0, 0, -9.81], [1, 2, 3], [0, 0.1, 0], [4, 5, 6], [7, 8, 9]],
        )
        assert (force.xi, moment.xi) == (1, 0.5)
        assert twist.moment.breaks == (0.4,)
        assert [twist.moment(xi) for xi in (0.2, 0.8)] == [[1, 0, 0], [2, 0, 0]]

    def test_a_beam_is_read_from_a_file_with_loads(self, wing):
        path = wing(loads=['type = "point_force"\nxi = 1\nforce = [1, 2, 3]'])
        assert load_beam(path).length == 2.0
        assert load_wing(wing()).loads == ()

    @pytest.mark.parametrize(
        ("load", "message"),
        [
            ("xi = 1", "type: expected one of gravity, point_force, point_moment, "
             "distributed_force, distributed_moment, found no such key"),
            ('type = "force"', "type: expected one of gravity, point_force, point_moment, "
             "distributed_force, distributed_moment, found 'force'"),
            ('type = "gravity"', "acceleration: expected 3 finite numbers in m/s², "
             "found no such key"),
            ('type = "point_force"\nforce = [0, 0, 1]',
             "xi: expected a finite number, found no such key"),
            ('type = "point_force"\nxi = 1.5\nforce = [0, 0, 1]',
             "xi: expected a number in [0, 1], found 1.5"),
            ('type = "point_force"\nxi = 1\nforce = [0, 1]',
             "force: expected 3 finite numbers in N, found [0, 1]"),
            ('type = "point_force"\nxi = 1\nforce = [0, 0, 1]\nframe = "fixed"',
             "frame: expected one of 'dead', 'follower', 'body'; found 'fixed'"),
            ('type = "point_moment"\nxi = 1\nmoments = [0, 0, 1]',
             "moments: expected one of the keys type, xi, moment, frame; found an unknown key, "
             "nearest to moment"),
            ('type = "distributed_force"\nxi = [0, 0.5, 1]\nforce = [[0, 0, 1]]',
             "force: expected 3 finite numbers in N/m or a list of 2 of these, one for each "
             "interval of xi, or 3, one for each station, found [[0, 0, 1]]"),
            ('type = "distributed_moment"\nxi = [0.5, 1]\nmoment = [[0, 0, 1]]',
             "xi: expected increasing stations that cover 0 to 1, found [0.5, 1.0]"),
        ],
    )  # fmt: skip
    def test_a_wrong_load_is_named_by_its_number(self, wing, load, message):
        refused(wing(loads=[load]), f"[loads 1] {message}", load_wing)
        refused(wing(loads=[load]), f"[loads 1] {message}", load_beam)


class TestLoadedWings:
    def test_the_loaded_sample_is_the_published_wing_with_a_pod(self):
        file, bare = load_wing(EXAMPLES / "hale_wing_loaded.toml"), load_beam(HALE_WING)
        q = np.linspace(-0.04, 0.05, 9)
        without = replace(file.beam, bodies=())
        # The same numbers by the same code.
        np.testing.assert_array_equal(
            shape_map(without, q).positions.full(), shape_map(bare, q).positions.full()
        )
        assert [body.mass for body in file.beam.bodies] == [2.0]
        found = solve_equilibrium(file.beam, file.loads)
        weight = 9.81 * (16 * 0.75 + 2.0)
        force = root_wrench(file.beam, found.q, file.loads).full().ravel()[3:]
        # Follower lift of 358.4 N in all, tilted most at the tip; z points down.
        upright = -float(found.shape.tip.rotation[2, 2])
        assert upright * 358.4 - weight < -force[2] < 358.4 - weight

    def test_a_pazy_like_file_gives_the_equilibrium_of_the_published_data(self, tmp_path):
        """Case 09 (C. Riso, C.E.S. Cesnik, doi 10.2514/1.C036869) written as TOML."""
        data = json.loads((REFERENCE / "09_pazy_beam_model.json").read_text())["geometry"]
        skin, nodes = data["skin0"], np.array(data["node_y"])
        xi, length = (nodes / nodes[-1]).tolist(), float(nodes[-1])
        k = skin["stiffness_per_element"]
        stiffness = [
            [[k[f"K{min(i, j)}{max(i, j)}"][e] for j in range(1, 5)] for i in range(1, 5)]
            for e in range(len(xi) - 1)
        ]
        bodies = [
            f"[[bodies]]\nxi = {x}\nmass = {mass}\n"
            for x, mass in zip(xi, skin["inertia_per_node"]["mass"], strict=True)
        ]
        path = tmp_path / "pazy.toml"
        path.write_text(
            f"[beam]\nlength = {length}\n[basis]\n"
            'torsion = { family = "legendre", n = 4 }\n'
            'out_of_plane = { family = "legendre", n = 6 }\n'
            'in_plane = { family = "legendre", n = 3 }\n'
            '[grid]\nkind = "lobatto"\nelements = 15\n'
            f"[section]\nxi = {xi}\nstiffness = {stiffness}\n" + "".join(bodies) +
            '[[loads]]\ntype = "gravity"\nacceleration = [0, 0, -9.80665]\n'
            '[[loads]]\ntype = "point_force"\nxi = 1\nforce = [0, 0, -10]\n'
            "offset = [0, -0.005839, 0]\n"
        )  # fmt: skip
        file = load_wing(path)
        condensed = skin["condensed_3x3_Kx_Ky_Kz_per_element"]
        centres = [(a + b) / 2 for a, b in pairwise(xi)]
        # The published file prints ten digits.
        np.testing.assert_allclose(
            matrices(file.beam.section, *centres), condensed, rtol=1e-8, atol=1e-9
        )
        found = solve_equilibrium(file.beam, file.loads)
        by_hand = replace(
            file.beam, section=Section.from_stiffness(Steps(xi, condensed)), bodies=()
        )
        loads = [
            PointForce(xi=x, force=[0, 0, -9.80665 * mass])
            for x, mass in zip(xi, skin["inertia_per_node"]["mass"], strict=True)
        ]
        tip = PointForce(xi=1.0, force=[0, 0, -10], offset=[0, -0.005839, 0])
        expected = solve_equilibrium(by_hand, [*loads, tip])
        # Stiffnesses of ten digits, and residuals of 1e-11.
        np.testing.assert_allclose(
            found.shape.tip.position.full(), expected.shape.tip.position.full(), atol=1e-8 * length
        )
        assert float(found.shape.tip.position[2]) < -0.1 * length


class TestWeightFile:
    def test_columns_stand_in_any_order(self, history_csv):
        times, weights = load_weights(history_csv("q1, time ,q0\n1,0.0,2\n3,0.5,4e-1\n\n"), 2)
        np.testing.assert_array_equal(times, [0, 0.5])
        np.testing.assert_array_equal(weights, [[2, 1], [0.4, 3]])

    def test_times_are_optional(self, history_csv):
        times, weights = load_weights(history_csv("q0\n1\n"), 1)
        assert times is None
        np.testing.assert_array_equal(weights, [[1]])

    def test_the_byte_order_mark_of_spreadsheets_is_read_over(self, tmp_path):
        path = tmp_path / "weights.csv"
        path.write_text('"q0","q1"\r\n1,2\r\n', encoding="utf-8-sig")
        np.testing.assert_array_equal(load_weights(path, 2)[1], [[1, 2]])

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "line 1: expected 2 columns of weights (q0, q1) and optionally time, "
             "found no q0, q1"),
            ("q0,time\n1,2\n", "line 1: expected 2 columns of weights (q0, q1) and optionally "
             "time, found no q1"),
            ("q0,q1,q2\n1,2,3\n", "line 1: expected 2 columns of weights (q0, q1) and optionally "
             "time, found the unknown q2"),
            ("q0,q1,q0\n1,2,3\n", "line 1: expected 2 columns of weights (q0, q1) and optionally "
             "time, found twice q0"),
            ("0.1,0.2\n", "line 1: expected 2 columns of weights (q0, q1) and optionally time, "
             "found no q0, q1; the unknown 0.1, 0.2"),
            ("q0;q1\n1;2\n", "line 1: expected 2 columns of weights (q0, q1) and optionally time, "
             "found no q0, q1; the unknown q0;q1; columns separated by semicolons, not by commas"),
            ("q0,q1\n", "line 2: expected a sample of q0, q1, found none"),
            ("q0,q1\n1,2\n1\n", "line 3: expected 2 cells, as in line 1, found 1"),
            ("q0,q1\n1,2\n\n1,2\n", "line 3: expected 2 cells, as in line 1, found 0"),
            ("q0,q1\n1,2,3\n", "line 2: expected 2 cells, as in line 1, found 3"),
            ("q0,q1\n1, abc\n", "line 2, column q1: expected a finite number, found 'abc'"),
            ("q0,q1\n1,2\nnan,2\n", "line 3, column q0: expected a finite number, found 'nan'"),
            ("q0,q1\n1,\n", "line 2, column q1: expected a finite number, found ''"),
            ("q0,q1,time\n1,2,0\n1,2,inf\n",
             "line 3, column time: expected a finite number, found 'inf'"),
            ("q0,q1,time\n1,2,0\n1,2,1\n1,2,1\n",
             "line 4, column time: expected above 1 s, the time of the line before, found 1"),
        ],
    )  # fmt: skip
    def test_a_wrong_file_is_refused_with_line_and_column(self, history_csv, text, message):
        refused(history_csv(text), message, lambda path: load_weights(path, 2))

    def test_labels_tell_what_the_columns_are(self, history_csv):
        path = history_csv("q0\n1\n")
        with pytest.raises(ValueError, match=r"q0 torsion, q1 bending.* found no q1"):
            load_weights(path, 2, ["torsion", "bending"])

    def test_a_missing_file_is_named(self, tmp_path):
        with pytest.raises(FileNotFoundError, match=r"no\.csv: expected a readable file"):
            load_weights(tmp_path / "no.csv", 2)


class TestShapeFile:
    WEIGHTS = np.array([[0.01, 0, 0, -0.05, 0.05, 0, 0, 0, 0], [0, 0, 0, 0.02, 0, 0, 0, 0.01, 0]])

    @pytest.fixture
    def history(self):
        return shape_history(hale_wing(), self.WEIGHTS, [0.0, 0.25])

    def test_a_csv_file_has_a_line_for_each_sample_and_station(self, history, tmp_path):
        write_shape(tmp_path / "p.csv", history)
        with (tmp_path / "p.csv").open(newline="") as file:
            header, *lines = csv.reader(file)
        assert tuple(header) == SHAPE_COLUMNS
        assert header[2:7] == ["p_x", "p_y", "p_z", "D_11", "D_12"]
        rows = np.array(lines, dtype=float).reshape(2, 17, 14)
        for k, q in enumerate(self.WEIGHTS):
            shape = shape_map(hale_wing(), q)
            np.testing.assert_array_equal(rows[k, :, 0], history.times[k])
            np.testing.assert_array_equal(rows[k, :, 1], shape.stations)
            # Every digit is written; rounding of compact against numeric evaluation remains.
            np.testing.assert_allclose(rows[k, :, 2:5].T, shape.positions.full(), atol=1e-13)
            maps = [pose.deformation_map.full().ravel() for pose in shape.poses]
            np.testing.assert_allclose(rows[k, :, 5:], maps, atol=1e-14)

    def test_the_first_row_of_d_is_the_tangent(self, history, tmp_path):
        write_shape(tmp_path / "p.csv", history)
        root = np.genfromtxt(tmp_path / "p.csv", delimiter=",", names=True)[0]
        # A right wing in body axes starts to the right: local x along the parent's y.
        assert (root["D_11"], root["D_12"], root["D_13"]) == (0, 1, 0)

    def test_an_npz_file_has_named_arrays(self, history, tmp_path):
        write_shape(tmp_path / "p.NPZ", history)
        with np.load(tmp_path / "p.NPZ") as arrays:
            shapes = {name: arrays[name].shape for name in arrays}
            np.testing.assert_array_equal(arrays["p"], history.positions)
            np.testing.assert_array_equal(arrays["D"], history.deformation_maps)
            np.testing.assert_array_equal(arrays["q"], self.WEIGHTS)
        assert shapes == {
            "time": (2,), "xi": (17,), "p": (2, 3, 17), "D": (2, 17, 3, 3), "q": (2, 9)
        }  # fmt: skip

    @pytest.mark.parametrize(("name", "found"), [("p.txt", ".txt"), ("p", "no ending")])
    def test_another_extension_is_refused(self, history, tmp_path, name, found):
        expected = f"expected a file name that ends in .csv or .npz, found {found}"
        refused(tmp_path / name, expected, lambda path: write_shape(path, history))
        assert not (tmp_path / name).exists()


def test_a_table_of_estimates_holds_weights(tmp_path):
    path = tmp_path / "estimate.csv"
    path.write_text("time,q0,q1,std_q0,std_q1,tip_x\n0,1,2,0.1,0.1,nan\n1,3,4,0.1,0.1,5\n")
    times, weights = load_weights(path, 2)
    np.testing.assert_array_equal(times, [0, 1])
    np.testing.assert_array_equal(weights, [[1, 2], [3, 4]])
    path.write_text("time,q0,q1,std_q0\n0,1,2,0.1\n")
    with pytest.raises(ValueError, match="found the unknown std_q0"):
        load_weights(path, 2)


def test_a_curvature_that_is_likely_a_twist_in_degrees_is_doubted(tmp_path):
    text = (EXAMPLES / "hale_wing.toml").read_text()
    path = tmp_path / "wing.toml"
    for curvature, doubted in (("[0.02, 0, 0]", False), ("[3.0, 0, 0]", True)):
        line = f"weight_bounds = 0.15\ninitial_curvature = {curvature}"
        path.write_text(text.replace("weight_bounds = 0.15", line))
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            load_beam(path)
        words = [str(w.message) for w in found if "turns by 2750 degrees" in str(w.message)]
        assert len(words) == doubted
