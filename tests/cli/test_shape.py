"""The command line, run in this process and once as a program."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.optimize import brentq

from curvcasadi.cli.main import main
from curvcasadi.kinematics.shape import pose_at, shape_map
from curvcasadi.lie import so3
from curvcasadi.loads.kinds import Gravity
from curvcasadi.reference_wings import hale_wing
from curvcasadi.statics.energy import strain_energy
from curvcasadi.statics.equilibrium import solve_equilibrium

HALE_WING = str(Path(__file__).parents[2] / "ocp_examples" / "hale_wing.toml")
BENT = np.array([0.01, 0, 0, -0.05, 0.05, 0, 0, 0.005, 0])
BENT_TEXT = ",".join(map(str, BENT))


def refused(capsys, *arguments, command="shape", code=2):
    """The message of a command that must fail; no traceback, nothing but the message."""
    assert main([command, *map(str, arguments)]) == code
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("curvcasadi: error: ")
    return message.removeprefix("curvcasadi: error: ")


def table(text):
    """Numbers of the printed table, a row for each sample."""
    rows = [line.split() for line in text.splitlines() if line.startswith("  ")][1:]
    return np.array(rows, dtype=float)


def rows(text):
    """Values of the table of `equilibrium` by label; labels are padded to 18 columns."""
    return {line[:18].strip(): line[19:] for line in text.splitlines()}


def leading(text, n):
    """The first `n` numbers of a value."""
    return np.array(text.split()[:n], dtype=float)


@pytest.fixture
def history(tmp_path):
    """A history file of 11 samples that bends and straightens again; its path and weights."""
    times = np.linspace(0, 1, 11)
    weights = np.outer(np.sin(np.pi * times), BENT)
    path = tmp_path / "history.csv"
    header = "time," + ",".join(f"q{k}" for k in range(9))
    columns = np.column_stack([times, weights])
    np.savetxt(path, columns, delimiter=",", header=header, comments="", fmt="%.17g")
    return path, weights


def test_without_weights_the_wing_is_straight(capsys):
    assert main(["shape", HALE_WING]) == 0
    np.testing.assert_array_equal(table(capsys.readouterr().out), [[0, 0, 16, 0, 0, 0, 0, 0]])


def test_the_table_has_tip_position_and_rotation_and_the_largest_element_angle(capsys):
    assert main(["shape", HALE_WING, "--weights", BENT_TEXT]) == 0
    wing = hale_wing()
    shape = shape_map(wing, BENT)
    turn = np.degrees(so3.log(wing.root.rotation.T @ shape.tip.rotation).full().ravel())
    angles = [
        np.degrees(np.linalg.norm(so3.log(a.rotation.T @ b.rotation).full()))
        for a, b in zip(shape.poses[:-1], shape.poses[1:], strict=True)
    ]
    (row,) = table(capsys.readouterr().out)
    # Printed with four decimals of a metre and three of a degree.
    np.testing.assert_allclose(row[1:4], shape.tip.position.full().ravel(), atol=0.5001e-4)
    np.testing.assert_allclose(row[4:7], turn, atol=0.5001e-3)
    np.testing.assert_allclose(row[7], max(angles), atol=0.5001e-3)


@pytest.mark.parametrize("form", [["--weights=-0.01,0,0,0,0,0,0,0,0"],
                                  ["--weights", "-0.01,0,0,0,0,0,0,0,0"],
                                  ["--weights", "-.01,0,0,0,0,0,0,0,0"]])  # fmt: skip
def test_weights_may_begin_with_a_minus_sign(capsys, form):
    assert main(["shape", HALE_WING, *form]) == 0
    (row,) = table(capsys.readouterr().out)
    # Uniform torsion turns the tip by L q0 about the straight span.
    assert row[4] == pytest.approx(np.degrees(16 * -0.01), abs=0.5001e-3)


def test_a_history_is_written_sample_by_sample(capsys, terminal, tmp_path, history):
    path, weights = history
    out = tmp_path / "p.npz"
    assert main(["shape", HALE_WING, "--weights", str(path), "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert f"wrote {out}" in printed.out and "shapes: 100%" in printed.err
    # First, most bent and last sample.
    np.testing.assert_array_equal(table(printed.out)[:, 0], [0, 0.5, 1])
    with np.load(out) as arrays:
        for k, q in enumerate(weights):
            expected = shape_map(hale_wing(), q).positions.full()
            # 17 digits are read back exactly: rounding on 16 m remains.
            np.testing.assert_allclose(arrays["p"][k], expected, atol=1e-13)


def test_a_constant_shape_is_written_as_csv(tmp_path):
    out = tmp_path / "p.csv"
    assert main(["shape", HALE_WING, "--weights", BENT_TEXT, "--out", str(out)]) == 0
    rows = np.genfromtxt(out, delimiter=",", names=True)
    tip = shape_map(hale_wing(), BENT).tip.position.full().ravel()
    np.testing.assert_allclose([rows[k][-1] for k in ("p_x", "p_y", "p_z")], tip, atol=1e-13)


def test_figures_and_animation_are_written(tmp_path, history, capsys, terminal):
    options = {"--plot": "wing.png", "--basis-plot": "basis.png", "--animate": "wing.gif"}
    arguments = [text for key, name in options.items() for text in (key, str(tmp_path / name))]
    assert main(["shape", HALE_WING, "--weights", str(history[0]), "--half", *arguments]) == 0
    assert Image.open(tmp_path / "wing.png").format == "PNG"
    assert Image.open(tmp_path / "basis.png").format == "PNG"
    assert Image.open(tmp_path / "wing.gif").n_frames == 11
    printed = capsys.readouterr()
    assert "wing.gif: 100%" in printed.err
    assert [line for line in printed.out.splitlines() if line.startswith("wrote")] == [
        f"wrote {tmp_path / name}" for name in ("basis.png", "wing.png", "wing.gif")
    ]


class TestEquilibrium:
    GRAVITY = "gravity acceleration=0,0,9.81"

    def test_the_table_has_what_the_solver_found(self, capsys):
        assert main(["equilibrium", HALE_WING, "--load", self.GRAVITY]) == 0
        printed = rows(capsys.readouterr().out)
        wing, loads = hale_wing(), [Gravity([0, 0, 9.81])]
        found = solve_equilibrium(wing, loads)
        assert printed["loads"] == "1" and printed["load steps"] == "1"
        assert int(printed["Newton iterations"]) == found.iterations <= 6
        turn = wing.root.rotation.T @ found.shape.tip.rotation
        weights = leading(printed["weights"].replace(",", " "), 9)
        # Printed with four decimals; six and nine digits.
        tip = found.shape.tip.position.full().ravel()
        np.testing.assert_allclose(leading(printed["tip position"], 3), tip, atol=0.5001e-4)
        turned = np.degrees(so3.log(turn).full().ravel())
        np.testing.assert_allclose(leading(printed["tip rotation"], 3), turned, atol=0.5001e-4)
        np.testing.assert_allclose(weights, found.q.full().ravel(), rtol=1e-8)
        (energy,) = leading(printed["strain energy"], 1)
        assert energy == pytest.approx(float(strain_energy(wing, found.q)), rel=1e-5)
        curvatures = np.linalg.norm(found.shape.curvatures.full(), axis=0)
        (largest,) = leading(printed["largest curvature"], 1)
        assert largest == pytest.approx(curvatures.max(), rel=1e-5)
        (residual,) = leading(printed["residual"], 1)
        assert residual == pytest.approx(found.residual_norm, rel=0.1, abs=1e-9)

    def test_the_largest_curvature_is_that_of_the_elastic_part(self, tmp_path, capsys):
        bent = (
            Path(HALE_WING)
            .read_text()
            .replace("[beam]", "[beam]\ninitial_curvature = [0, 0.05, 0]", 1)
        )
        path = tmp_path / "bent.toml"
        path.write_text(bent)
        load = "point_force xi=1 force=0,0,-1"
        assert main(["equilibrium", str(path), "--load", load]) == 0
        assert leading(rows(capsys.readouterr().out)["largest curvature"], 1)[0] < 0.01

    def test_the_root_moment_is_the_weight_on_its_arm(self, capsys):
        assert main(["equilibrium", HALE_WING, "--load", self.GRAVITY]) == 0
        moment = leading(rows(capsys.readouterr().out)["root moment"], 3)
        wing = hale_wing()
        q = solve_equilibrium(wing, [Gravity([0, 0, 9.81])]).q
        nodes, weights = np.polynomial.legendre.leggauss(12)
        arms = [float(pose_at(wing, q, (1 + node) / 2).position[1]) for node in nodes]
        expected = 0.75 * 9.81 * 8 * np.dot(weights, arms)
        # A polynomial of high degree, by two quadratures, printed with six digits.
        np.testing.assert_allclose(moment, [0, expected, 0], rtol=1e-5)

    def test_the_root_moment_is_about_the_root_in_its_axes(self, capsys, tmp_path):
        path = tmp_path / "wing.toml"
        moved = Path(HALE_WING).read_text().replace("position = [0, 0, 0]", "position = [3, 2, 1]")
        path.write_text(moved)
        load = "point_force xi=0 force=0,0,100 frame=dead offset=0.5,0,0"
        assert main(["equilibrium", str(path), "--load", load]) == 0
        moment = leading(rows(capsys.readouterr().out)["root moment"], 3)
        # Half a metre out along x of the root axes, 100 N against their z: e_x × −e_z = e_y.
        np.testing.assert_allclose(moment, [0, 50, 0], atol=1e-12)

    def test_loads_of_the_file_and_of_the_options_add_up(self, capsys, tmp_path):
        load = '[[loads]]\ntype = "point_force"\nxi = 1\nforce = [0, 0, -30]\n'
        path = tmp_path / "wing.toml"
        path.write_text(f"{Path(HALE_WING).read_text()}\n{load}")
        more = ["--load", "point_force xi = 1 force=0, 0, -20"]
        assert main(["equilibrium", str(path), *more]) == 0
        both = rows(capsys.readouterr().out)
        one = ["--load", "point_force xi=1 force=0,0,-50 frame=dead"]
        assert main(["equilibrium", HALE_WING, *one]) == 0
        single = rows(capsys.readouterr().out)
        assert (both["loads"], single["loads"]) == ("2", "1")
        assert both["tip position"] == single["tip position"]

    def test_shape_draws_the_printed_weights_as_they_were_found(self, capsys):
        assert main(["equilibrium", HALE_WING, "--load", self.GRAVITY]) == 0
        printed = rows(capsys.readouterr().out)
        assert main(["shape", HALE_WING, "--weights", printed["weights"]]) == 0
        (row,) = table(capsys.readouterr().out)
        # Four decimals each.
        np.testing.assert_allclose(row[1:4], leading(printed["tip position"], 3), atol=1.01e-4)

    @pytest.mark.parametrize("name", ["p.csv", "p.npz"])
    def test_files_and_figure_are_written(self, capsys, tmp_path, name):
        out, plot = tmp_path / name, tmp_path / "wing.png"
        wing = str(Path(HALE_WING).with_name("hale_wing_loaded.toml"))
        assert main(["equilibrium", wing, "--out", str(out), "--plot", str(plot)]) == 0
        printed = capsys.readouterr().out
        assert printed.splitlines()[-2:] == [f"wrote {out}", f"wrote {plot}"]
        assert Image.open(plot).format == "PNG"
        if name == "p.npz":
            with np.load(out) as arrays:
                tip = arrays["p"][0, :, -1]
        else:
            lines = np.genfromtxt(out, delimiter=",", names=True)
            tip = [lines[column][-1] for column in ("p_x", "p_y", "p_z")]
        np.testing.assert_allclose(tip, leading(rows(printed)["tip position"], 3), atol=0.5001e-4)

    def test_loads_beyond_balance_name_the_part_that_was_reached(self, capsys, tmp_path):
        """A unit torsion bar, GJ = 1, that lifts a weight on an arm: θ = λ (12 − 10 sin θ)."""
        path = tmp_path / "bar.toml"
        path.write_text(
            '[beam]\nlength = 1\n[basis]\ntorsion = { family = "legendre", n = 1 }\n'
            '[grid]\nkind = "lobatto"\nelements = 8\n[section]\nGJ = 1\nEI_y = 1\nEI_z = 1\n'
            '[[loads]]\ntype = "point_moment"\nxi = 1\nmoment = [12, 0, 0]\n'
        )
        weight = "point_force xi=1 force=0,0,-10 offset=0,0,-1"
        assert main(["equilibrium", str(path), "--load", weight]) == 3
        printed = capsys.readouterr()
        assert printed.out == ""
        start = "curvcasadi: error: loads: equilibrium is lost beyond "
        assert printed.err.startswith(start)
        # λ = θ/(12 − 10 sin θ) has its first maximum where its slope vanishes.
        slope = lambda x: 12 - 10 * np.sin(x) + 10 * x * np.cos(x)  # noqa: E731
        twist = brentq(slope, np.pi / 2, np.pi)
        limit = twist / (12 - 10 * np.sin(twist))
        reached = float(printed.err.removeprefix(start).split()[0])
        # Load steps are not shorter than 1e-4; four digits are printed.
        assert limit - 6e-4 <= reached <= limit + 1e-4

    @pytest.mark.parametrize(
        ("load", "message"),
        [
            ("force xi=1 force=0,0,1", "type: expected one of gravity, point_force, point_moment, "
             "distributed_force, distributed_moment, found 'force'"),
            ("", "type: expected one of gravity, "),
            ("point_force xi=1 force=0,0",
             "force: expected 3 finite numbers in N, found [0.0, 0.0]"),
            ("point_force xi=1 force=0,0,100N",
             "force: expected 3 finite numbers in N, found '0,0,100N'"),
            ("point_force xi=1 force=0,0,nan", "force: expected 3 finite numbers in N, found "),
            ("point_force xi=16 force=0,0,1", "xi: expected a number in [0, 1], found 16.0"),
            ("point_force force=0,0,1", "xi: expected a finite number, found no such key"),
            ("point_force xi=1 force=0,0,1 frame=wind",
             "frame: expected one of 'dead', 'follower', 'body'; found 'wind'"),
            ("point_force xi=1 forc=0,0,1", "forc: expected one of the keys type, xi, force, "
             "frame, offset; found an unknown key, nearest to force"),
            ("point_force xi=1 xi=1 force=0,0,1", "expected each key once, as key=value, "
             "found 'xi=1'"),
            ("point_force 1 force=0,0,1", "expected each key once, as key=value, found '1'"),
        ],
    )  # fmt: skip
    def test_a_wrong_load_is_quoted(self, capsys, load, message):
        found = refused(capsys, HALE_WING, "--load", load, command="equilibrium")
        assert found.startswith(f'--load "{load}": {message}')

    def test_a_wing_without_loads_is_refused(self, capsys):
        found = refused(capsys, HALE_WING, command="equilibrium")
        expected = "expected [[loads]], [airstream] or the option --load, found none"
        assert found == f"{HALE_WING}: {expected}"

    def test_a_wing_without_stiffness_or_mass_is_refused(self, capsys, tmp_path):
        path = tmp_path / "wing.toml"
        text = Path(HALE_WING).read_text()
        path.write_text(text[: text.index("[section]")])
        load = ["--load", "point_force xi=1 force=0,0,1"]
        found = refused(capsys, path, *load, command="equilibrium")
        assert found == "Beam.section: expected a Section with stiffness, found None"
        path.write_text(text.replace("mass_per_length = 0.75", ""))
        found = refused(capsys, path, "--load", self.GRAVITY, command="equilibrium")
        assert found.startswith("Gravity: expected a Section with mass_per_length or bodies")

    def test_a_shape_beyond_the_weight_bounds_is_named(self, capsys):
        load = ["--load", "point_force xi=1 force=0,0,-2000"]
        found = refused(capsys, HALE_WING, *load, command="equilibrium", code=3)
        assert found.startswith("loads: ") and "Beam.weight_bounds" in found

    def test_help_says_what_the_exit_codes_mean(self, capsys):
        with pytest.raises(SystemExit) as exit_:
            main(["equilibrium", "--help"])
        text = " ".join(capsys.readouterr().out.split())
        assert exit_.value.code == 0
        assert "3 if the loads cannot be balanced" in text


class TestErrors:
    def test_a_wrong_number_of_weights_names_the_expected_ones(self, capsys):
        labels = ", ".join(hale_wing().basis.labels)
        message = refused(capsys, HALE_WING, "--weights", "0.1,0")
        assert message == f"--weights: expected 9 numbers ({labels}), found 2"

    def test_text_among_the_weights_is_named(self, capsys):
        message = refused(capsys, HALE_WING, "--weights", "0.1,a,0")
        assert message.startswith("--weights: expected numbers") and message.endswith("found 'a'")

    def test_weights_beyond_their_bounds_are_named(self, capsys):
        message = refused(capsys, HALE_WING, "--weights", "0,1,0,0,0,0,0,0,0")
        assert message == (
            "--weights[1] (torsion: Legendre 1): expected within Beam.weight_bounds "
            "[-0.15, 0.15] rad/m, found 1"
        )

    def test_weights_beyond_their_bounds_are_named_with_the_line_of_the_file(
        self, capsys, tmp_path
    ):
        path = tmp_path / "w.csv"
        path.write_text(",".join(f"q{k}" for k in range(9)) + "\n" + 2 * ("0," * 8 + "0\n"))
        with path.open("a") as file:
            file.write("0," * 8 + "0.2\n")
        message = refused(capsys, HALE_WING, "--weights", path)
        assert message.startswith(f"{path}: line 4: q[8] (in_plane: Legendre 1): expected within")

    def test_a_weight_file_with_missing_columns_lists_the_labels(self, capsys, tmp_path):
        path = tmp_path / "w.csv"
        path.write_text("q0\n1\n")
        message = refused(capsys, HALE_WING, "--weights", path)
        assert "expected 9 columns of weights (q0 torsion: Legendre 0, " in message

    def test_a_wrong_wing_file_is_named(self, capsys, tmp_path):
        path = tmp_path / "wing.toml"
        path.write_text(Path(HALE_WING).read_text().replace("EI_y", "EIy"))
        message = refused(capsys, path)
        assert message.startswith(f"{path}: [section] EIy: expected one of the keys GJ, EI_y")
        assert message.endswith("nearest to EI_y")

    def test_a_missing_wing_file_is_named(self, capsys):
        assert refused(capsys, "no.toml") == (
            "no.toml: expected a readable file, found: No such file or directory"
        )

    @pytest.mark.parametrize("option", ["--out", "--plot"])
    def test_a_missing_directory_is_named(self, capsys, tmp_path, option):
        path = tmp_path / "no" / ("p.csv" if option == "--out" else "p.png")
        with pytest.raises(SystemExit) as stop:
            main(["shape", HALE_WING, option, str(path)])
        assert stop.value.code == 2
        message = f"{option}: expected a file to write, found no folder {path.parent}"
        assert message in capsys.readouterr().err

    def test_constant_weights_are_no_animation(self, capsys, tmp_path):
        message = refused(capsys, HALE_WING, "--animate", tmp_path / "wing.gif")
        assert message == "--animate: expected --weights FILE.csv, found constant weights"

    def test_a_missing_command_shows_the_usage(self, capsys):
        with pytest.raises(SystemExit) as exit_:
            main([])
        assert exit_.value.code == 2 and "usage: curvcasadi" in capsys.readouterr().err


def test_help_says_what_the_files_hold(capsys):
    with pytest.raises(SystemExit) as exit_:
        main(["shape", "--help"])
    text = " ".join(capsys.readouterr().out.split())
    assert exit_.value.code == 0
    assert "Both are of the beam in the file only" in text and "--weights=-0.1,0" in text


def test_it_runs_as_a_program(tmp_path):
    command = [sys.executable, "-m", "curvcasadi", "shape"]
    run = subprocess.run([*command, HALE_WING], capture_output=True, text=True, check=False)
    assert run.returncode == 0 and "16.0000" in run.stdout and run.stderr == ""
    run = subprocess.run([*command, "no.toml"], capture_output=True, text=True, check=False)
    assert run.returncode == 2 and run.stdout == ""
    assert run.stderr.startswith("curvcasadi: error: no.toml: ") and "Traceback" not in run.stderr
