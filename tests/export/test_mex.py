"""MEX files in Octave against CasADi."""

import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose

import curvcasadi as cc
from curvcasadi.reference_wings import hale_wing

WEIGHTS = 0.03 * np.cos(np.arange(9))


@pytest.mark.skipif(
    shutil.which("mkoctfile") is None or shutil.which("octave-cli") is None,
    reason="Octave with mkoctfile (Debian: apt-get install octave-dev)",
)
def test_a_mex_file_in_octave_gives_the_numbers_of_casadi(tmp_path):
    wing = hale_wing()
    q = ca.SX.sym("q", wing.basis.n)
    tip = cc.tip_function(wing)
    energy = cc.function("energy", {"q": q}, {"energy": cc.strain_energy(wing, q)})
    path = cc.export_mex([tip, energy], tmp_path)
    subprocess.run(["mkoctfile", "--mex", "-DMATLAB_MEX_FILE", path.name], cwd=tmp_path, check=True)
    script = (
        f"q = {[*WEIGHTS.tolist()]}'; [p, R] = curv_mex('tip', q); U = curv_mex('energy', q);"
        "printf('%.17g\\n', p, R, U)"
    )
    done = subprocess.run(
        ["octave-cli", "--norc", "--eval", script],
        cwd=tmp_path, check=True, capture_output=True, text=True,
    )  # fmt: skip
    found = np.array([float(line) for line in done.stdout.split()])
    position, rotation = tip(WEIGHTS)
    expected = [*position.full().ravel(), *rotation.full().ravel("F"), float(energy(WEIGHTS))]
    assert_allclose(found, expected, rtol=1e-12, atol=1e-13)


def test_what_is_no_c_is_refused(tmp_path):
    x, free = ca.SX.sym("x", 2), ca.SX.sym("free")
    f = ca.Function("f", [x], [ca.sumsqr(x)])
    with pytest.raises(ValueError, match=r"Functions of different names, found \['f', 'f'\]"):
        cc.export_mex([f, f], tmp_path)
    for other in (None, "f", [f, 1]):
        with pytest.raises(ValueError, match="functions: expected one or more casadi"):
            cc.export_mex(other, tmp_path)
    open_function = ca.Function("g", [x], [x * free], {"allow_free": True})
    with pytest.raises(ValueError, match="'g' has free symbols"):
        cc.export_mex(open_function, tmp_path)
    solver = ca.nlpsol("s", "ipopt", {"x": x, "f": ca.sumsqr(x)})
    with pytest.raises(ValueError, match="expected parts that CasADi generates as C"):
        cc.export_mex(solver, tmp_path)
