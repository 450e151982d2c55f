"""The command line: its parser and exit codes."""

from __future__ import annotations

import argparse
import re
import signal
import sys
import warnings
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from curvcasadi.cli import (
    equilibrium as equilibrium_command,
    estimate as estimate_command,
    export as export_command,
    flutter as flutter_command,
    fly as fly_command,
    info as info_command,
    shape as shape_command,
    simulate as simulate_command,
    sweep as sweep_command,
    target as target_command,
    template as template_command,
    trim as trim_command,
)
from curvcasadi.cli.options import add_progress
from curvcasadi.errors import ConvergenceError, leave_at_interrupt

#: Options whose numbers may begin with a minus sign.
SIGNED = ("--weights", "--position", "--turn", "--pitch")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code.

    0; 2 after an error in the input; 3 if a solver did not reach what was asked for; 130 after
    Ctrl-C.
    """
    if signal.getsignal(signal.SIGINT) is leave_at_interrupt:  # the imports are over
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        arguments = _parser().parse_args(_joined(sys.argv[1:] if argv is None else argv))
        with warnings.catch_warnings():
            warnings.showwarning = _warn  # type: ignore[assignment]
            code: int = arguments.run(arguments)
        return code
    except ConvergenceError as error:
        return _refuse(str(error), 3)
    except KeyboardInterrupt:
        return _refuse("interrupted", 130)
    except RuntimeError as error:
        if "KeyboardInterrupt" not in str(error):  # which CasADi met within a Function
            raise
        return _refuse("interrupted", 130)
    except OSError as error:
        return _refuse(f"{error.filename}: {error.strerror}" if error.filename else str(error), 2)
    except ValueError as error:
        return _refuse(str(error), 2)


def _warn(message: Warning | str, *_: Any) -> None:
    print(f"curvcasadi: warning: {message}", file=sys.stderr)


def _refuse(message: str, code: int) -> int:
    print(f"curvcasadi: error: {message}", file=sys.stderr)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="curvcasadi", description="Curvature bases for very flexible wings."
    )
    commands = parser.add_subparsers(title="commands", required=True)

    parser.add_argument(
        "--version", action="version", version=f"curvcasadi {version('curvcasadi')}"
    )
    template_command.add_parser(commands)
    info_command.add_parser(commands)
    shape_command.add_parser(commands)
    target_command.add_parser(commands)
    equilibrium_command.add_parser(commands)
    simulate_command.add_parser(commands)
    sweep_command.add_parser(commands)
    flutter_command.add_parser(commands)
    trim_command.add_parser(commands)
    fly_command.add_parser(commands)
    estimate_command.add_parser(commands)
    export_command.add_parser(commands)

    demo = commands.add_parser("demo", help="a tour of the package, written to a directory")
    demo.add_argument("--out", type=Path, metavar="DIR", default=Path("out"), help="default: out")
    demo.set_defaults(run=_demo)
    for command in commands.choices.values():
        add_progress(command)
    return parser


def _joined(argv: Sequence[str]) -> list[str]:
    """`--weights -0.1,0` as `--weights=-0.1,0`: argparse would take the former for two options."""
    joined: list[str] = []
    for argument in argv:
        if joined and joined[-1] in SIGNED and re.match(r"-[\d.]", argument):
            joined[-1] += f"={argument}"
        else:
            joined.append(argument)
    return joined


def _demo(arguments: argparse.Namespace) -> int:
    from curvcasadi.cli.demo import run

    code: int = run(arguments.out)
    return code


if __name__ == "__main__":
    sys.exit(main())
