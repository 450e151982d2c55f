"""Runs the code blocks of a page in the order in which a reader would.

Python blocks share a namespace. A block with a caption is a file of that name. Lines of shell
blocks that call `curvcasadi`, an example, gcc or a program of the folder are run; other lines, such
as `make test`, are for the reader. C blocks must compile. All this happens in a folder of its own.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

from curvcasadi.cli import main as curvcasadi

ROOT = Path(__file__).parents[1]
#: First words of the shell lines that are run; `./` begins a program that the page has built.
COMMANDS = ("curvcasadi", "python ocp_examples/", "gcc", "./")
C_FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")

_FENCE = re.compile(
    r"^```(?:\{code-block\} )?(?P<language>\w+)\n"
    r"(?::caption: (?P<file>[^\n]+)\n\n?)?"
    r"(?P<text>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Block:
    """A fenced code block of a page."""

    language: str
    file: str | None  #: name of the file that it holds
    text: str
    line: int  #: of its first line of code in the page
    end: int  #: offset of what follows it in the page


@dataclass(frozen=True)
class Result:
    """What a block printed, and the pictures that it drew."""

    block: Block
    output: str
    pictures: tuple[Path, ...]


def blocks(text: str) -> list[Block]:
    """The code blocks of a Markdown page."""
    return [
        Block(
            match["language"],
            match["file"],
            match["text"],
            text.count("\n", 0, match.start("text")) + 1,
            match.end(),
        )
        for match in _FENCE.finditer(text)
    ]


def run(text: str, name: str, folder: Path) -> Iterator[Result]:
    """Run the blocks of a page in `folder`, which then holds its files and pictures.

    Parameters
    ----------
    text : str
        The page, Markdown.
    name : str
        What a traceback calls the page.
    folder : Path
        An existing folder; it gains a link to `ocp_examples`.

    Raises
    ------
    Exception
        What a block raises; RuntimeError where a command fails.
    """
    link = folder / "ocp_examples"
    if not link.exists():
        link.symlink_to(ROOT / "ocp_examples")
    namespace: dict[str, Any] = {"__name__": "page"}
    with contextlib.chdir(folder), matplotlib.rc_context({"svg.hashsalt": "curvcasadi"}):
        for block in blocks(text):
            before = _pictures(folder)
            output = io.StringIO()
            with contextlib.redirect_stdout(output):
                _run(block, name, namespace)
            after = _pictures(folder)
            drawn = tuple(path for path in after if after[path] != before.get(path))
            yield Result(block, output.getvalue(), drawn)


def _pictures(folder: Path) -> dict[Path, int]:
    paths = (path for kind in ("png", "svg", "gif") for path in folder.glob(f"*.{kind}"))
    return {path: path.stat().st_mtime_ns for path in sorted(paths)}


def _run(block: Block, name: str, namespace: dict[str, Any]) -> None:
    if block.file:
        Path(block.file).write_text(block.text, encoding="utf-8")
    if block.language == "python":
        # Line numbers of a traceback are those of the page.
        exec(
            compile("\n" * (block.line - 1) + block.text, name, "exec", dont_inherit=True),
            namespace,
        )
    elif block.language == "shell":
        for command in block.text.replace("\\\n", " ").splitlines():
            _run_command(command.partition(" #")[0].strip())
    elif block.language == "toml":
        tomllib.loads(block.text)
    elif block.language == "c":
        _call(["gcc", *C_FLAGS, "-I", "c", "-x", "c", "-", "-c", "-o", os.devnull], block.text)


def _run_command(command: str) -> None:
    if not command.startswith(COMMANDS):
        return
    words = shlex.split(command)
    if words[0] == "python":
        words[0] = sys.executable
    if words[0] != "curvcasadi":
        print(_call(words), end="")
        return
    errors = io.StringIO()
    with contextlib.redirect_stderr(errors):
        code = curvcasadi(words[1:])
    if code:
        raise RuntimeError(f"{command}: exit code {code}: {errors.getvalue()}")


def _call(words: list[str], text: str | None = None) -> str:
    done = subprocess.run(words, input=text, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{shlex.join(words)}: {done.stdout}{done.stderr}")
    return done.stdout
