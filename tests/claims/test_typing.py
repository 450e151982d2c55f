"""Types reach the user's own script after the README's install."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT = """\
import casadi as ca
import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

beam = hale_wing()
reveal_type(cc.body_jacobian(beam, ca.MX.sym("q", 9)))
reveal_type(cc.strain_energy(beam, [0.0] * 9))
print(beam.lenght)
"""


def build(kind, source, folder):
    """The wheel that pip would make of `source`, in `folder`."""
    code = f"from setuptools import build_meta; build_meta.build_{kind}({str(folder)!r})"
    subprocess.run([sys.executable, "-c", code], cwd=source, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """A copy of what is installed: building leaves files beside it."""
    folder = tmp_path_factory.mktemp("source")
    shutil.copytree(ROOT / "curvcasadi", folder / "curvcasadi")
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(ROOT / name, folder)
    return folder


def test_a_wheel_holds_every_file_of_the_package(source, tmp_path):
    with zipfile.ZipFile(build("wheel", source, tmp_path)) as wheel:
        packed = {name for name in wheel.namelist() if name.startswith("curvcasadi/")}
    files = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "curvcasadi").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert "curvcasadi/py.typed" in files
    assert packed == files


def test_a_type_checker_sees_the_editable_install(source, tmp_path):
    """The install of the README, in an environment that sees nothing else of the package."""
    venv.EnvBuilder(symlinks=True).create(tmp_path / "env")
    (site,) = (tmp_path / "env").glob("lib/python*/site-packages")
    with zipfile.ZipFile(build("editable", source, tmp_path)) as wheel:
        wheel.extractall(site)
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    script = tmp_path / "user.py"
    script.write_text(SCRIPT)
    found = subprocess.run(
        [
            *(sys.executable, "-m", "mypy", "--cache-dir", os.devnull),
            *("--python-executable", str(tmp_path / "env" / "bin" / "python"), str(script)),
        ],
        cwd=tmp_path,
        env={key: value for key, value in os.environ.items() if key not in ("PYTHONPATH",)},
        capture_output=True,
        text=True,
    ).stdout
    assert 'note: Revealed type is "casadi.casadi.MX"' in found
    assert 'note: Revealed type is "casadi.casadi.DM"' in found
    assert 'error: "Beam" has no attribute "lenght"; maybe "length"?' in found
    assert "Found 1 error" in found
