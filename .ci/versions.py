"""Does the wheel install on every Python that the package is for, and do its names work there?

    python .ci/versions.py [3.12 ...]

Builds the wheel, and for each version installs it in a virtual environment of its own and runs the
tests of the public names outside of this repository. A version that cannot be found on the PATH or
below ~/.pyenv/versions is skipped by name. Exits with 1 if a version that was found fails.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSIONS = ("3.11", "3.12", "3.13")
#: Of the public names: their docstrings, conventions, refusals, pickles and texts.
TESTS = ("docstrings", "conventions", "refusals", "pickles", "printing", "reference_wings")
NEEDED = ("pytest", "numpydoc", "hypothesis", "mpmath", "control")


def interpreter(version: str) -> str | None:
    """A Python of the version."""
    installed = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
    for found in (*map(str, reversed(installed)), shutil.which(f"python{version}")):
        if found and run([found, "-c", "import ensurepip, venv"], check=False) == 0:
            return found
    return None


def run(command: list[str], check: bool = True, folder: Path = ROOT) -> int:
    """Exit code; what the command wrote is shown if it fails and must not."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if check and done.returncode:
        print(done.stdout[-6000:], done.stderr[-6000:], sep="\n", file=sys.stderr)
    return done.returncode


def tested(version: str, python: str, wheel: Path, folder: Path) -> bool:
    """Whether the wheel installs on this Python and its tests pass."""
    began = time.monotonic()
    place = folder / version
    own = place / "venv/bin/python"
    tests = place / "tests"
    shutil.copytree(ROOT / "tests", tests)
    shutil.copytree(ROOT / "ocp_examples", place / "ocp_examples")
    options = ["--quiet", "--disable-pip-version-check", "--no-compile"]
    pip = [str(own), "-m", "pip", "install", *options]
    names = [f"tests/claims/test_{name}.py" for name in TESTS]
    pytest = [str(own), "-m", "pytest", "-q", "--import-mode=importlib", "-p", "no:cacheprovider"]
    commands = [
        [python, "-m", "venv", str(place / "venv")],
        [*pip, str(wheel), *NEEDED],
        [*pytest, "-o", "pythonpath=.", "--rootdir", str(place), *names],
    ]
    passed = all(run(command, folder=place) == 0 for command in commands)
    print(f"Python {version}: {'passed' if passed else 'FAILED'}, {time.monotonic() - began:.0f} s")
    return passed


def main(versions: list[str]) -> int:
    """Exit code."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check"]
        if run([*build, "--no-deps", "--no-build-isolation", "-w", str(folder), str(ROOT)]):
            return 1
        (wheel,) = folder.glob("*.whl")
        failed = False
        for version in versions:
            python = interpreter(version)
            if python is None:
                print(f"Python {version}: skipped, none with venv on the PATH or in ~/.pyenv")
            else:
                failed = not tested(version, python, wheel, folder) or failed
    return int(failed)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or list(VERSIONS)))
