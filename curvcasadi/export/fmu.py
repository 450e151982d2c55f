"""Control models as functional mock-up units, FMI 3.0: model exchange and co-simulation."""

from __future__ import annotations

import hashlib
import platform
import sys
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import get_args

import casadi as ca

from curvcasadi.control.implicit_midpoint import TOLERANCE, midpoint_solver
from curvcasadi.control.model import ControlModel
from curvcasadi.control.signals import stacked, with_nominal
from curvcasadi.control.stability import warn_of_unstable_step
from curvcasadi.control.step import Method, midpoint_rule, rk4
from curvcasadi.export.casadi_c import generate as generated
from curvcasadi.export.fmu_description import build_description, model_description
from curvcasadi.symbolic.compiled import compile_c
from curvcasadi.symbolic.expressions import Array, Number, choice, function_name, instance, positive

_LIBRARY = ("-std=c99", "-O1", "-fPIC", "-shared", "-fvisibility=hidden")
_METHODS = {
    "rk4": "of the classical Runge-Kutta method of order 4",
    "implicit_midpoint": "of the implicit midpoint rule",
}
#: FMI's name of a system, and the ending of its libraries, by sys.platform.
_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}
_MACHINES = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
#: Entries of the archive have no time, so that the same model gives the same bytes.
_EPOCH = (1980, 1, 1, 0, 0, 0)


def export_fmu(
    model: ControlModel,
    path: str | Path,
    *,
    dt: float,
    method: Method = "rk4",
    x0: Number | Mapping[str, Number] | None = None,
    u: Number | Mapping[str, Number] | None = None,
    p: Number | Mapping[str, Number] | None = None,
    inputs: Sequence[str] = (),
    compiler: str | None = "gcc",
) -> Path:
    """Write a model as an FMU of FMI 3.0, for model exchange and co-simulation.

    Variables are named by the layouts of the model: ``x.q[0]``, ``der(x.q[0])``, ``u.flap``,
    ``p.airspeed``, ``y.tip[2]``, parts of one entry without an index. In co-simulation a step is
    that of `simulate` with the same `method` and `dt`, inputs held over it; an implicit step that
    does not converge is discarded and the state stays. In model exchange the importing tool
    integrates: attitudes keep their length only as well as it does.

    Parameters
    ----------
    model : ControlModel
        Model in double precision.
    path : str or Path
        File to write, which ends with .fmu.
    dt : float
        Longest step within a step of co-simulation, s.
    method : {"rk4", "implicit_midpoint"}
        Method of co-simulation; see `step_function`.
    x0, u, p : array or mapping of str to array, optional
        Start values: zero unless given, attitudes level, and parameters their nominal values; those
        without one, such as the airspeed, have to be given.
    inputs : sequence of str
        Parts of p that are inputs of the FMU, such as a gust, which may change at any time; the
        others are tunable parameters.
    compiler : str or None
        C compiler that takes the options of gcc, for this machine; None writes the sources alone,
        which every importing tool can compile.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ValueError
        If an argument has a wrong size or name, parameters are missing, or the model has a part
        that is no C.
    FileNotFoundError
        If there is no such folder, or no such compiler.
    """
    instance("model", model, ControlModel)
    choice("method", method, get_args(Method))
    choice("model.real", model.real, ("double",))
    path = Path(path)
    if path.suffix != ".fmu":
        raise ValueError(f"path: expected a file that ends with .fmu, found {str(path)!r}")
    if not path.parent.is_dir():
        raise FileNotFoundError(
            f"path: expected a file in an existing folder, found no folder {path.parent}"
        )
    name = function_name("model.name", model.name)
    longest = float(positive("dt", dt))
    parts = {part.name for part in model.p.parts}
    if isinstance(inputs, str):
        raise ValueError(f"inputs: expected a sequence of names, found {inputs!r}")
    unknown = sorted(set(inputs) - parts)
    if unknown:
        raise ValueError(f"inputs: expected parts of p among {sorted(parts)}, found {unknown}")
    start = {
        "x": stacked("x0", model.x, x0),
        "u": stacked("u", model.u, u),
        "p": stacked("p", model.p, with_nominal("p", model.p, p)),
    }
    if method == "rk4":
        warn_of_unstable_step("dt", model, longest, [*start.values()])
    sources = _sources(model, name, method, longest, start)
    token = hashlib.sha256("\0".join(sources.values()).encode()).hexdigest()[:36]
    sources = {file: text.replace("@TOKEN@", token) for file, text in sources.items()}
    archive: dict[str, bytes] = {
        "modelDescription.xml": model_description(
            model, name, token, start, inputs=set(inputs), step=longest
        ),
        "sources/buildDescription.xml": build_description(name, sources),
        **{f"sources/{file}": text.encode() for file, text in sources.items()},
    }
    if compiler is not None:
        place, content = _binary(name, sources, compiler)
        archive[place] = content
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for place, content in archive.items():
            file.writestr(zipfile.ZipInfo(place, _EPOCH), content, zipfile.ZIP_DEFLATED)
    return path


def _sources(
    model: ControlModel, name: str, method: Method, dt: float, start: Mapping[str, Array]
) -> dict[str, str]:
    """C by the names of its files, without the token of the FMU."""
    step, rates = _step(model, method)
    functions = [_called("xdot", model.xdot), _called("output", model.output)]
    functions.append(step)
    source, header, sizes = generated.generate(functions, f"{name}_functions", "double")
    fields: dict[str, object] = {
        "NAME": name,
        "METHOD": _METHODS[method],
        "DT": f"{dt!r}",
        "TOLERANCE": f"{TOLERANCE!r}",
        "NX": model.x.size,
        "NU": model.u.size,
        "NP": model.p.size,
        "NY": model.y.size,
        "NRATES": rates,
        "INTEGER": "int",
        **{f"{key.upper()}_START": _list(values) for key, values in start.items()},
    }
    for f in functions:
        fields[f.name().upper()] = generated.symbol(f, name)
        for what, size in sizes[f.name()].items():
            fields[f"{f.name().upper()}_{what.upper()}"] = size
    text = files("curvcasadi.export").joinpath("templates/fmu.c.in").read_text()
    for key in sorted(fields, key=len, reverse=True):
        text = text.replace(f"@{key}@", str(fields[key]))
    return {
        f"{name}_fmu.c": text,
        f"{name}_functions.c": source,
        f"{name}_functions.h": header,
    }


def _called(name: str, f: ca.Function) -> ca.Function:
    """A call of `f` under another name; of nothing, a zero, as arrays of C have a length."""
    inputs = [ca.MX.sym(key, f.sparsity_in(key)) for key in f.name_in()]
    outputs = f.call(inputs) if f.nnz_out(0) else [ca.MX(0.0)]
    return ca.Function(name, inputs, outputs, f.name_in(), f.name_out())


def _step(model: ControlModel, method: Method) -> tuple[ca.Function, int]:
    """(x, u, p, h, guess) -> x_next, residual, rates; and the number of rates."""
    x, u, p = (ca.MX.sym(key, getattr(model, key).size) for key in ("x", "u", "p"))
    h = ca.MX.sym("h")
    names = ["x", "u", "p", "h", "guess"], ["x_next", "residual", "rates"]
    if method == "rk4":
        guess = ca.MX.sym("guess", 1)
        outputs = [rk4(model, h, x, u, p), ca.MX(0), guess]
        return ca.Function("step", [x, u, p, h, guess], outputs, *names), 1
    rule = midpoint_rule(model)
    guess = ca.MX.sym("guess", rule.n_rates)
    end, residual, rates, _ = midpoint_solver(rule)(x, u, p, h, guess)
    outputs = [end, residual, rates]
    return ca.Function("step", [x, u, p, h, guess], outputs, *names), rule.n_rates


def _list(values: Array) -> str:
    return ", ".join(repr(float(value)) for value in values) or "0"


def _binary(name: str, sources: Mapping[str, str], compiler: str) -> tuple[str, bytes]:
    """The library of this machine and its place in the archive."""
    system, ending = _SYSTEMS.get(sys.platform, ("", ""))
    machine = _MACHINES.get(platform.machine().lower())
    if not system or machine is None:
        raise ValueError(
            f"compiler: expected None on {sys.platform} {platform.machine()}, found {compiler!r}"
        )
    with tempfile.TemporaryDirectory() as folder:
        for file, text in sources.items():
            Path(folder, file).write_text(text)
        library = name + ending
        names = [file for file in sources if file.endswith(".c")]
        compile_c(names, library, _LIBRARY, folder=folder, compiler=compiler)
        return f"binaries/{machine}-{system}/{library}", Path(folder, library).read_bytes()
