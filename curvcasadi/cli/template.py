"""The command `curvcasadi template`: a commented file to start from."""

from __future__ import annotations

import argparse
from importlib.resources import files
from pathlib import Path
from typing import Any

KINDS = ("wing", "aircraft", "sensors")


def add_parser(commands: Any) -> None:
    """Add the command to the subparsers of `argparse`."""
    parser = commands.add_parser(
        "template",
        help="a commented wing, aircraft or sensor file to start from",
        description="Print a commented file, or write it with --out.",
    )
    parser.add_argument("kind", choices=KINDS, help="what the file describes")
    parser.add_argument("--out", type=Path, metavar="FILE.toml", help="file that must not exist")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print or write the file; returns the exit code."""
    text = template(arguments.kind)
    if arguments.out is None:
        print(text, end="")
        return 0
    try:
        with arguments.out.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise ValueError(f"{arguments.out}: expected a new file, found one") from None
    print(f"wrote {arguments.out}")
    return 0


def template(kind: str) -> str:
    """The text of a commented file of one of `KINDS`."""
    return (files("curvcasadi.files") / "templates" / f"{kind}.toml").read_text(encoding="utf-8")
