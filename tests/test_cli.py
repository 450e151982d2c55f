"""The command line, run in this process and once as a program."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from curvcasadi.cli import main
from curvcasadi.lie import so3
from curvcasadi.reference_wings import hale_wing
from curvcasadi.shape import shape_map

HALE_WING = str(Path(__file__).parent.parent / "ocp_examples" / "hale_wing.toml")
BENT = np.array([0.01, 0, 0, -0.05, 0.05, 0, 0, 0.005, 0])
BENT_TEXT = ",".join(map(str, BENT))


def refused(capsys, *arguments):
    """The message of a command that must fail; no traceback, nothing but the message."""
    assert main(["shape", *map(str, arguments)]) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("curvcasadi: error: ")
    return message.removeprefix("curvcasadi: error: ")


def table(text):
    """Numbers of the printed table, a row for each sample."""
    rows = [line.split() for line in text.splitlines() if line.startswith("  ")][1:]
    return np.array(rows, dtype=float)


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


def test_a_history_is_written_sample_by_sample(capsys, tmp_path, history):
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


def test_figures_and_animation_are_written(tmp_path, history, capsys):
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
        message = refused(capsys, HALE_WING, option, path)
        assert message == f"{path}: No such file or directory"

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
    command = [sys.executable, "-m", "curvcasadi.cli", "shape"]
    run = subprocess.run([*command, HALE_WING], capture_output=True, text=True, check=False)
    assert run.returncode == 0 and "16.0000" in run.stdout and run.stderr == ""
    run = subprocess.run([*command, "no.toml"], capture_output=True, text=True, check=False)
    assert run.returncode == 2 and run.stdout == ""
    assert run.stderr.startswith("curvcasadi: error: no.toml: ") and "Traceback" not in run.stderr
