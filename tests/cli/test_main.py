"""What all commands share."""

import tomllib
from pathlib import Path

import pytest

from curvcasadi.cli import equilibrium, trim
from curvcasadi.cli.main import main
from curvcasadi.errors import ConvergenceError

EXAMPLES = Path(__file__).parents[2] / "ocp_examples"
WING, AIRCRAFT = EXAMPLES / "hale_wing.toml", EXAMPLES / "hale_aircraft.toml"


def gives_up(*_, **__):
    raise ConvergenceError("no solve is needed here", None)


@pytest.mark.parametrize(
    ("command", "arguments", "code"),
    [
        ("shape", [WING], 0),
        ("equilibrium", [WING, "--load", "point_force xi=1 force=0,0,-1"], 3),
        ("trim", [AIRCRAFT, "--speed", "25"], 3),
    ],
)
def test_a_command_parses_its_file_once(monkeypatch, command, arguments, code):
    parsed, parse = [], tomllib.loads

    def loads(text):
        parsed.append(text)
        return parse(text)

    monkeypatch.setattr(tomllib, "loads", loads)
    monkeypatch.setattr(equilibrium, "solve_equilibrium", gives_up)
    monkeypatch.setattr(trim, "trim_sweep", gives_up)
    assert main([command, *map(str, arguments)]) == code
    assert len(parsed) == 1
