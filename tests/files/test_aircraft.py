"""Aircraft files."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from curvcasadi.aero import ExponentialTipLoss
from curvcasadi.aircraft.trim import trim
from curvcasadi.files import load_beam
from curvcasadi.files.aircraft import load_aircraft
from curvcasadi.loads.kinds import PointForce

EXAMPLES = Path(__file__).parents[2] / "ocp_examples"
HALE_AIRCRAFT = EXAMPLES / "hale_aircraft.toml"
MIRRORED = '[[beams]]\nname = "left"\nmirror_of = "right"\n'
CONTROL = '[[beams.aerodynamics.controls]]\nname = "aileron"\nlift = 2.0\n'


@pytest.fixture
def aircraft(tmp_path):
    """Writes the sample file with texts replaced, each of which it must have, and text added."""

    def write(replaced=None, *, added=""):
        text = HALE_AIRCRAFT.read_text()
        for old, new in (replaced or {}).items():
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "aircraft.toml"
        path.write_text(f"{text}\n{added}")
        return path

    return write


def test_file_and_example_trim_alike():
    example = runpy.run_path(str(EXAMPLES / "trim_level_flight.py"))
    case = {"speed": 26.0, "density": example["DENSITY"]}
    of_file, of_example = (
        trim(a, **case) for a in (load_aircraft(HALE_AIRCRAFT), example["aircraft"]())
    )
    assert of_file.input_units == of_example.input_units
    # The same numbers go in: only rounding, through Newton's method, may differ.
    np.testing.assert_allclose(of_file.unknowns, of_example.unknowns, rtol=1e-9, atol=1e-12)
    for wing, moments in of_example.root_loads.items():
        np.testing.assert_allclose(of_file.root_loads[wing], moments, rtol=1e-9, atol=1e-9)


def test_body_has_mass_position_and_inertia(aircraft):
    inertia = [[3.0, 0.1, 0], [0.1, 4, 0], [0, 0, 5]]
    given = "inertia = [[200, 0, 0], [0, 200, 0], [0, 0, 200]]"
    path = aircraft(
        {given: f"inertia = {inertia}", "position = [0, 0, 0]  ": "position = [0.1, 0, 0.2]  "}
    )
    body = load_aircraft(path).body
    assert body.mass == 50
    np.testing.assert_array_equal(body.center_of_mass, [[0.1], [0], [0.2]])
    np.testing.assert_array_equal(body.inertia, inertia)


def test_airfoil_data_may_differ_by_interval(aircraft):
    steps = "chord = { xi = [0, 0.25, 1], values = [1.0, 0.8] }"
    strips = load_aircraft(aircraft({"chord = 1.0": steps})).beams[0].strips
    assert (strips.chord(0.1), strips.chord(0.9), strips.breaks) == (1.0, 0.8, (0.25,))


def test_airfoil_data_may_be_linear_between_stations(aircraft):
    taper = "chord = { xi = [0, 0.5, 1], values = [1.0, 0.8, 0.4] }"
    strips = load_aircraft(aircraft({"chord = 1.0": taper})).beams[0].strips
    assert strips.chord(0.25) == pytest.approx(0.9, rel=1e-15)
    assert strips.chord(0.75) == pytest.approx(0.6, rel=1e-15)


def test_tip_loss_and_upper_side_are_read(aircraft):
    path = aircraft({"chord = 1.0": "chord = 1.0\nupper_side = -1\ntip_loss = { decay = 8.0 }"})
    strips = load_aircraft(path).beams[0].strips
    assert isinstance(strips.tip_loss, ExponentialTipLoss)
    assert (strips.tip_loss.decay, strips.upper_side) == (8.0, -1)


def test_a_left_wing_may_be_described_by_itself(aircraft):
    text = HALE_AIRCRAFT.read_text()
    first, last = text.index("[[beams]]"), text.index(MIRRORED)
    right = text[first:last]
    left = right.replace('"right"', '"left"').replace(
        "[[0, 1, 0], [1, 0, 0], [0, 0, -1]]", "[[0, 1, 0], [-1, 0, 0], [0, 0, 1]]"
    )
    wings = load_aircraft(aircraft({MIRRORED: left})).beams
    assert [(wing.name, wing.strips.upper_side) for wing in wings] == [("right", 1), ("left", -1)]


def test_an_upright_surface_needs_its_upper_side(aircraft):
    text = HALE_AIRCRAFT.read_text()
    tail = text[text.index("[[surfaces]]") : text.index("[[thrusts]]")]
    fin = tail.replace("[[0, 1, 0], [1, 0, 0], [0, 0, -1]]", "[[0, 1, 0], [0, 0, -1], [-1, 0, 0]]")
    with pytest.raises(ValueError, match=r"\[surfaces 1\].*upper_side.*root is upright"):
        load_aircraft(aircraft({tail: fin}))
    told = fin.replace("chord = 0.5", "chord = 0.5\nupper_side = -1")
    (surface,) = load_aircraft(aircraft({tail: told})).surfaces
    assert surface.strips.upper_side == -1


def test_antisymmetric_controls_deflect_the_other_way_on_the_mirror_image(aircraft):
    control = CONTROL + "moment = -0.3\ndrag = 0.01\nstart = 0.6\nend = 0.9\nantisymmetric = true\n"
    made = load_aircraft(aircraft({MIRRORED: control + MIRRORED}))
    (right,), (left,) = (wing.strips.controls for wing in made.beams)
    assert (right.start, right.end, right.lift, right.moment, right.drag) == (
        0.6,
        0.9,
        2,
        -0.3,
        0.01,
    )
    assert (left.start, left.end, left.lift, left.moment, left.drag) == (0.6, 0.9, -2, 0.3, -0.01)
    assert made.inputs == {"thrust": "N", "aileron": "rad", "elevator": "rad"}


def test_bodies_and_loads_belong_to_their_beam(aircraft):
    parts = (
        "[[beams.bodies]]\nxi = 0.5\nmass = 2.0\n"
        '[[beams.loads]]\ntype = "point_force"\nxi = 1\nforce = [0, 0, 5]\nframe = "follower"\n'
    )
    (right,) = load_aircraft(aircraft({MIRRORED: parts})).beams
    assert [body.mass for body in right.beam.bodies] == [2.0]
    (load,) = right.loads
    assert isinstance(load, PointForce)


def test_a_mirror_image_may_come_first_and_without_a_name(aircraft):
    path = aircraft({MIRRORED: "", "[[beams]]\n": '[[beams]]\nmirror_of = "right"\n[[beams]]\n'})
    left, right = load_aircraft(path).beams
    assert (left.name, right.name) == ("right_mirrored", "right")
    np.testing.assert_array_equal(left.beam.root.rotation, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    assert left.strips.upper_side == -1


def test_surfaces_and_thrusts_are_optional(aircraft):
    text = HALE_AIRCRAFT.read_text()
    path = aircraft({text[text.index("[[surfaces]]") :]: ""})
    made = load_aircraft(path)
    assert (made.surfaces, made.thrusts, made.inputs) == ((), (), {})


def test_a_wing_file_is_told_from_an_aircraft_file():
    wing = HALE_AIRCRAFT.with_name("hale_wing.toml")
    with pytest.raises(ValueError, match="expected an aircraft file, found a wing"):
        load_aircraft(wing)
    with pytest.raises(ValueError, match="expected a wing file, found an aircraft"):
        load_beam(HALE_AIRCRAFT)


WRONG = {
    "unknown table": (
        {"[[thrusts]]": "[[thrust]]"},
        r"thrust: expected one of the keys .* nearest to thrusts",
    ),
    "unknown key of the body": (
        {"mass = 50.0": "mass = 50.0\ninertias = 1"},
        r"\[body\] inertias: expected one of the keys .* nearest to inertia",
    ),
    "no mass": ({"mass = 50.0\n": ""}, r"\[body\] mass: expected a finite number, found no such"),
    "mass below zero": ({"mass = 50.0": "mass = -1.0"}, r"\[body\] mass: expected .*found -1"),
    "skew inertia": (
        {"inertia = [[200, 0, 0]": "inertia = [[200, 2, 0]"},
        r"\[body\] inertia: expected a symmetric matrix",
    ),
    "unknown key of a beam": (
        {"[beams.grid]": "[beams.grids]"},
        r"\[beams 1\] grids: .* nearest to grid",
    ),
    "key within a beam": (
        {'kind = "lobatto"': 'kind = "lobato"'},
        r"\[beams 1\.grid\] kind: expected one of uniform, lobatto, custom, found 'lobato'",
    ),
    "body of a beam": (
        {MIRRORED: "[[beams.bodies]]\nxi = 0.5\nmas = 1\n"},
        r"\[beams 1\.bodies 1\] mas: .* nearest to mass",
    ),
    "no section": ({"[beams.section]": "[beams.beam2]"}, r"\[beams 1\] beam2: .* nearest to beam"),
    "name": ({'name = "right"': 'name = "right wing"'}, r"\[beams 1\] name: expected letters"),
    "same names": ({'name = "left"': 'name = "right"'}, r"toml: beams: expected different names"),
    "mirror image of nothing": (
        {'mirror_of = "right"': 'mirror_of = "rigth"'},
        r"\[beams 2\] mirror_of: expected one of right, found 'rigth'",
    ),
    "mirror image with its own grid": (
        {'mirror_of = "right"': 'mirror_of = "right"\ngrid = {}'},
        r"\[beams 2\] grid: expected one of the keys mirror_of, name",
    ),
    "mirror image of loads": (
        {MIRRORED: '[[beams.loads]]\ntype = "point_force"\nxi = 1\nforce = [0, 0, 5]\n' + MIRRORED},
        r"\[beams 2\] mirror_of: expected a beam without loads.* found right",
    ),
    "weight as a load": (
        {MIRRORED: '[[beams.loads]]\ntype = "gravity"\nacceleration = [0, 0, 9.8]\n'},
        r"\[beams 1\.loads 1\] type: expected a load other than the weight",
    ),
    "no lift slope": (
        {"lift_slope = 6.283185307179586": ""},
        r"\[beams 1\.aerodynamics\] lift_slope: expected .* found no such key",
    ),
    "text for a chord": (
        {"chord = 1.0": 'chord = "1"'},
        r"\[beams 1\.aerodynamics\] chord: expected a finite number or a table of xi, values",
    ),
    "steps that do not cover the span": (
        {"chord = 1.0": "chord = { xi = [0, 0.5], values = [1] }"},
        r"\[beams 1\.aerodynamics\.chord\] xi: expected increasing stations that cover 0 to 1",
    ),
    "no chord in an interval": (
        {"chord = 1.0": "chord = { xi = [0, 0.5, 1], values = [1, 0] }"},
        r"\[beams 1\.aerodynamics\] chord at xi = 0\.75: expected",
    ),
    "tip loss below zero": (
        {"chord = 1.0": "chord = 1.0\ntip_loss = { decay = -1 }"},
        r"\[beams 1\.aerodynamics\.tip_loss\] decay: expected",
    ),
    "upper side": (
        {"chord = 1.0": "chord = 1.0\nupper_side = 2"},
        r"\[beams 1\.aerodynamics\] upper_side: expected .* found 2",
    ),
    "control that ends before it starts": (
        {MIRRORED: CONTROL + "start = 0.9\nend = 0.5\n" + MIRRORED},
        r"\[beams 1\.aerodynamics\.controls 1\] end: expected above start = 0\.9, found 0\.5",
    ),
    "antisymmetric as a number": (
        {MIRRORED: CONTROL + "antisymmetric = 1\n" + MIRRORED},
        r"\[beams 1\.aerodynamics\.controls 1\] antisymmetric: expected true or false, found 1",
    ),
    "surface without an area": (
        {"area = 2.5\n": ""},
        r"\[surfaces 1\] area: expected a finite number, found no such key",
    ),
    "attitude of a surface": (
        {"pose = { position = [-10, 0, 0], rotation": "pose = { position = [-10, 0, 0], rotations"},
        r"\[surfaces 1\.pose\] rotations: .* nearest to rotation",
    ),
    "airfoil data of a surface": (
        {"chord = 0.5": "chords = 0.5"},
        r"\[surfaces 1\.aerodynamics\] chords: .* nearest to chord",
    ),
    "direction of a thrust": (
        {"direction = [1, 0, 0]": "direction = [1, 0, 1]"},
        r"\[thrusts 1\] direction: expected a unit vector, found .* of length 1\.41421",
    ),
    "surface and thrust of one name": (
        {'name = "tail"': 'name = "thrust"'},
        r"expected different names of surfaces and thrusts.*found thrust, thrust",
    ),
    "surface named as the weight": (
        {'name = "tail"': 'name = "weight"'},
        r"none of them weight; found thrust, weight",
    ),
    "thrust and control of one name": (
        {'name = "elevator"': 'name = "thrust"'},
        r"thrusts: 'thrust' is the name of a control surface, too",
    ),
}


@pytest.mark.parametrize("replaced, message", WRONG.values(), ids=WRONG)
def test_wrong_files_are_refused_with_place_and_key(aircraft, replaced, message):
    path = aircraft(replaced)
    with pytest.raises(ValueError, match=message) as caught:
        load_aircraft(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_an_aircraft_without_beams_is_refused(tmp_path):
    path = tmp_path / "aircraft.toml"
    path.write_text("beams = []\n[body]\nmass = 1\nposition = [0, 0, 0]\n")
    with pytest.raises(ValueError, match=r"beams: expected one or more, found none"):
        load_aircraft(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(OSError, match=r"none\.toml: expected a readable file"):
        load_aircraft(tmp_path / "none.toml")
