"""What the manifest and the header of exported C say of it, proved on the C."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from codegen import toolchain
from curvcasadi.export import run_check
from curvcasadi.reference_wings import hale_wing

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Werror")
#: Of the C library, all that exported functions may call: memory is moved, nothing else.
MEMORY = {"memcpy", "memmove", "memset"}
LIBM = {
    name + suffix
    for name in (
        "sin cos sincos tan asin acos atan atan2 sqrt pow hypot exp log fabs fmin fmax floor ceil "
        "copysign"
    ).split()
    for suffix in ("", "f")
}
#: What gcc calls the function behind a pointer.
INDIRECT = "__indirect_call"
#: Constant tables of the project's own solvers.
TABLE = re.compile(
    r"^static const \w+_gn_(?:problem|stages|solver) \w+ = \{(.*?)\};\n", re.M | re.S
)
TEMPLATES = Path(cc.__file__).parent / "solvers" / "templates"
#: What CasADi calls the derivatives that it takes by AD.
SWEEP = r"\b(fwd|adj)\d*_"
N = 5


def _beam(real):
    return hale_wing(2, 2, 1, grid=cc.Grid.lobatto(6, real=real))


def every_kind(beam):
    """A function of each kind: maps, derivatives, solvers, a limit of element angles."""
    position = cc.Target(xi=1.0, position=[0, 16, 0])
    weighted = replace(position, weight=1.0)
    model = cc.kinematic_model(beam, time_constant=0.5)
    force = ca.MX.sym("force", 3)
    load = cc.PointForce(xi=1.0, force=force, frame="dead")
    tip = cc.tip_function(beam)
    return [
        tip,
        tip.jacobian(),
        cc.pose_function("stations", beam, (0.5, 1.0), jacobian=True),
        cc.shape_target_function(beam, [weighted], regularization=1e-6, max_iter=9, name="near"),
        cc.shape_target_function(
            beam, [weighted], regularization=1e-6, iterations=1, name="near_step"
        ),
        cc.shape_target_function(beam, [position], max_iter=8, name="met"),
        cc.tip_path_step_function(model, dt=0.1, horizon=2, rate_bound=0.1, name="path"),
        cc.tip_path_step_function(model, dt=0.1, horizon=2, iterations=1, name="path_step"),
        cc.equilibrium_function(beam, [load], {"force": force}, max_iter=7, checked=True),
    ]


def _samples(beam):
    q = np.linspace(0.002, 0.004, N)
    pose = cc.pose_at(beam, q, 1.0)
    path = [ca.repmat(part, 1, 2) for part in (pose.position, pose.rotation)]
    step = (q, 0 * q, q, *path, np.tile(q, 4))
    targets = {name: [(q, pose.position)] for name in ("near", "near_step", "met")}
    return {**targets, "path": [step], "path_step": [step], "equilibrium": [(0 * q, [0, 0, 1])]}


def write(folder, real, **options):
    beam = _beam(real)
    functions = every_kind(beam)
    return cc.export_c(
        functions, folder, real=real, beam=beam, reference_inputs=_samples(beam), **options
    )


@pytest.fixture(scope="module", params=["double", "float"])
def exported(request, tmp_path_factory):
    """(folder, manifest) of an export with every kind of function, compiled without optimization

    At a fixed place, as on a target: what a loader moves must be written to, tables of addresses
    included.
    """
    folder = tmp_path_factory.mktemp(request.param)
    manifest = write(folder, request.param)
    options = ("-O0", "-fno-inline", "-fno-pie", "-fcallgraph-info")
    _gcc(folder, *options, "-c", "curv.c", "curv_functions.c")
    return folder, manifest


def _gcc(folder, *arguments, compiler="gcc"):
    done = subprocess.run(
        [compiler, *arguments], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[:2000]


def _symbols(folder, *files):
    """(kind, name) of the symbols of object files, as `nm` has them."""
    printed = subprocess.run(
        ["nm", *files], cwd=folder, capture_output=True, text=True, check=True
    ).stdout
    return re.findall(r"^[0-9a-f ]{16} (\w) (\S+)$", printed, re.M)


def call_graph(folder):
    """Callers and whom they call, of all functions that gcc compiled in `folder`."""
    graph = {}
    for file in folder.glob("*.ci"):
        for caller, called in re.findall(
            r'^edge: \{ sourcename: "(.*?)" targetname: "(.*?)"', file.read_text(), re.M
        ):
            graph.setdefault(_function(caller), set()).add(_function(called))
    return graph


def _function(title):
    """The name alone: static functions carry the name of their file."""
    return title.rpartition(":")[2]


def functions_of_tables(folder, *stems):
    """Functions whose addresses the tables of solvers hold; no other addresses are taken."""
    symbols = _symbols(folder, *(f"{stem}.o" for stem in stems))
    defined = {name for kind, name in symbols if kind in "tT"}
    text = "\n".join((folder / f"{stem}.c").read_text() for stem in stems)
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    held = defined & {word for table in TABLE.findall(text) for word in re.findall(r"\w+", table)}
    assert not defined & set(re.findall(r"\b(\w+)\b(?! *\()", TABLE.sub("", text)))
    return held


def _sorted(graph):
    return [*TopologicalSorter(graph).static_order()]


def test_no_exported_function_calls_itself_on_any_way(exported):
    folder, manifest = exported
    graph = call_graph(folder)
    # Own solvers, and they alone, call what they solve through pointers in their tables.
    solvers = "".join(path.read_text() for path in sorted(TEMPLATES.glob("*.c")))
    own = {f"curv_{name}" for name in re.findall(r"\bgn_\w+(?=\()", solvers)}
    callers = {name for name, called in graph.items() if INDIRECT in called}
    assert {"curv_gn_run", "curv_gn_condense"} <= callers <= own
    held = functions_of_tables(folder, "curv", "curv_functions")
    assert {"curv_casadi_met_solver_advance", "curv_casadi_path_stage_error"} <= held
    assert not held & callers
    graph[INDIRECT] = held
    _sorted(graph)  # raises CycleError where there is a cycle
    reached = {f"curv_{name}" for name in manifest["functions"]}
    while more := set().union(*(graph.get(name, set()) for name in reached)) - reached:
        reached |= more
    assert {"curv_tip_with", "curv_functions_qr"} | held <= reached
    assert manifest["recursion"] is False


def test_recursion_is_seen_in_the_call_graph(tmp_path):
    source = "int a(int x); static int b(int x) { return a(x - 1); }\n"
    (tmp_path / "loop.c").write_text(source + "int a(int x) { return x ? b(x) : 0; }\n")
    _gcc(tmp_path, "-O0", "-fcallgraph-info", "-c", "loop.c")
    with pytest.raises(CycleError):
        _sorted(call_graph(tmp_path))


@pytest.mark.parametrize("called", ["c(1)", "x"])
def test_recursion_through_a_table_is_seen_in_the_call_graph(tmp_path, called):
    source = (
        "typedef struct { int (*f)(int x); } curv_gn_problem;\n"
        "static int a(const curv_gn_problem *p, int x) { return p->f(x); }\n"
        "static int c(int x);\n"
        f"static int b(int x) {{ return {called}; }}\n"
        "static const curv_gn_problem near_problem = {b};\n"
        "static int c(int x) { return a(&near_problem, x); }\n"
        "int d(int x) { return c(x); }\n"
    )
    (tmp_path / "table.c").write_text(source)
    _gcc(tmp_path, "-O0", "-fno-pie", "-fcallgraph-info", "-c", "table.c")
    graph = call_graph(tmp_path) | {INDIRECT: functions_of_tables(tmp_path, "table")}
    assert graph[INDIRECT] == {"b"}
    if called == "x":
        assert _sorted(graph) == ["b", INDIRECT, "a", "c", "d"]
    else:
        with pytest.raises(CycleError):
            _sorted(graph)


def test_only_libm_and_moves_of_memory_are_called(exported):
    folder, manifest = exported
    symbols = _symbols(folder, "curv.o", "curv_functions.o")
    defined = {name for kind, name in symbols if kind != "U"}
    foreign = {name for kind, name in symbols if kind == "U"} - defined
    assert foreign <= MEMORY | LIBM
    assert manifest["dynamic_memory"] is False


def test_only_the_buffers_of_plain_wrappers_are_variables(exported):
    folder, manifest = exported
    variables = [s for s in _symbols(folder, "curv.o", "curv_functions.o") if s[0] in "bBdDCgGsS"]
    names = [re.sub(r"\.\d+$", "", name) for _, name in variables]
    assert names == ["buffers"] * len(manifest["functions"])
    assert {kind for kind, _ in variables} == {"b"}
    assert [manifest["static_state"], manifest["constant_tables"]] == [False, "const"]


def test_shared_buffers_are_one_variable_as_large_as_the_largest(tmp_path):
    x, y = ca.MX.sym("x"), ca.MX.sym("y", 8)
    small, large = ca.Function("small", [x], [-x]), ca.Function("large", [y], [2 * y])
    sizes = {}
    for shared in (False, True):
        folder = tmp_path / str(shared)
        manifest = cc.export_c([small, large], folder, shared_buffers=shared)
        assert manifest["shared_buffers"] is shared
        assert run_check(folder) == {"small": 0, "large": 0}
        _gcc(folder, "-c", "curv.c", "-o", "curv.o")
        printed = subprocess.run(
            ["nm", "-S", "curv.o"], cwd=folder, check=True, capture_output=True, text=True
        )
        sizes[shared] = [
            int(line.split()[1], 16) for line in printed.stdout.splitlines() if " b buffers" in line
        ]
    assert sizes[True] == [max(sizes[False])]
    assert "interrupts included" in (tmp_path / "True" / "curv.h").read_text()


def test_the_reentrant_forms_alone_keep_no_variable(exported, tmp_path):
    folder, _ = exported
    _gcc(
        folder,
        *("-O0", "-ffunction-sections", "-fdata-sections", "-shared", "-fPIC", "-nostdlib"),
        *("-Wl,--gc-sections", f"-Wl,--version-script={_only_with(tmp_path)}"),
        *("curv.c", "curv_functions.c", "-o", str(tmp_path / "with.so")),
    )
    kept = _symbols(tmp_path, "with.so")
    assert "curv_tip_with" in {name for _, name in kept}
    assert not [name for _, name in kept if name.startswith("buffers")]


def _only_with(folder):
    """A version script that lets the linker drop all but the reentrant forms."""
    script = folder / "with.map"
    script.write_text("{ global: curv_*_with; local: *; };\n")
    return script


def test_it_compiles_as_strict_c99_without_a_warning(exported):
    folder, manifest = exported
    single = ("-Wdouble-promotion", "-Wfloat-conversion", "-Wconversion")
    warnings = (*STRICT, *(single if manifest["real"] == "float" else ()))
    # -O0 and -O2 find different ones.
    for level in ("-O0", "-O2"):
        _gcc(folder, *warnings, level, "-fsyntax-only", "curv.c", "curv_functions.c", "check.c")


@pytest.mark.parametrize("exported", ["float"], indirect=True)
def test_float_exports_call_no_function_of_double(exported):
    folder, _ = exported
    called = {name for kind, name in _symbols(folder, "curv.o", "curv_functions.o") if kind == "U"}
    assert not [name for name in called if toolchain.DOUBLE.fullmatch(name)]
    assert "-fsingle-precision-constant" not in (folder / "CMakeLists.txt").read_text()


@pytest.mark.parametrize("language", ["c", "c++"])
def test_the_header_stands_alone_and_may_be_included_twice(exported, tmp_path, language):
    if language == "c++" and shutil.which("g++") is None:
        pytest.skip("g++ is missing (Debian: apt-get install g++)")
    source = tmp_path / "caller.src"
    source.write_text(
        '#include "curv.h"\n#include "curv.h"\n'
        "int main(void) { static curv_tip_out out; curv_real q[CURV_TIP_N_Q] = {0};\n"
        "  return curv_tip(q, &out) != CURV_OK || out.position[0] != out.position[0]; }\n"
    )
    compiler, standard = ("g++", "c++11") if language == "c++" else ("gcc", "c99")
    options = (f"-std={standard}", "-pedantic", "-Wall", "-Wextra", "-Werror", f"-I{exported[0]}")
    objects = [str(exported[0] / name) for name in ("curv.o", "curv_functions.o")]
    program = str(tmp_path / "caller")
    source_object = str(tmp_path / "caller.o")
    into = ("-c", str(source), "-o", source_object)
    _gcc(tmp_path, *options, "-x", language, *into, compiler=compiler)
    # Linked by gcc: the functions have the linkage of C.
    _gcc(tmp_path, "-no-pie", source_object, *objects, "-o", program, "-lm")
    assert subprocess.run([program], check=False).returncode == 0


def test_two_exports_with_different_names_link_into_one_program(tmp_path):
    beam = _beam("double")
    for name in ("left", "right"):
        cc.export_c(cc.tip_function(beam), tmp_path / name, name=name, beam=beam)
    (tmp_path / "both.c").write_text(
        '#include "left.h"\n#include "right.h"\n'
        "int main(void) { static left_tip_out a; static right_tip_out b; left_real q[5] = {0.01};\n"
        "  return left_tip(q, &a) || right_tip(q, &b) || a.position[2] != b.position[2]; }\n"
    )
    sources = [
        f"{name}/{name}{part}.c" for name in ("left", "right") for part in ("", "_functions")
    ]
    _gcc(tmp_path, *STRICT, "-Ileft", "-Iright", "both.c", *sources, "-o", "both", "-lm")
    assert subprocess.run([tmp_path / "both"], check=False).returncode == 0


def test_exports_of_both_precisions_link_into_one_program_beside_other_names(tmp_path):
    for real in ("double", "float"):
        cc.export_c(cc.tip_function(_beam(real)), tmp_path / real, real=real, name=real[:3])
    (tmp_path / "both.c").write_text(
        "typedef long real_t; /* as headers of other solvers have it */\n"
        '#include "dou.h"\n#include "flo.h"\n'
        "int main(void) { static dou_tip_out a; static flo_tip_out b; real_t wrong = 0;\n"
        "  dou_real q[5] = {0.01, 0.02, 0.03}; flo_real p[5] = {0.01f, 0.02f, 0.03f};\n"
        "  double error;\n"
        "  wrong = dou_tip(q, &a) || flo_tip(p, &b);\n"
        "  error = a.position[2] - (double)b.position[2];\n"
        "  return wrong || !(error * error < 1e-12 && error != 0); }\n"
    )
    sources = [f"{n}/{n[:3]}{part}.c" for n in ("double", "float") for part in ("", "_functions")]
    _gcc(tmp_path, *STRICT, "-Idouble", "-Ifloat", "both.c", *sources, "-o", "both", "-lm")
    assert subprocess.run([tmp_path / "both"], check=False).returncode == 0


def test_an_exported_library_reads_back_into_casadi(tmp_path):
    low = ca.MX.sym("low", ca.Sparsity.lower(3))
    spread = ca.Function("spread", [low], [ca.densify(low), low.T], ["low"], ["full", "transposed"])
    exports = [cc.tip_function(_beam("double")), spread]
    cc.export_c(exports, tmp_path)
    library = str(tmp_path / "read_back.so")
    # With the warnings of -Wextra, among them those of constants that nothing uses.
    _gcc(tmp_path, *STRICT, "-shared", "-fPIC", "curv_functions.c", "-o", library, "-lm")
    for function, argument in zip(exports, (np.linspace(-0.05, 0.05, 5), ca.DM(3)), strict=True):
        read = ca.external(f"curv_casadi_{function.name()}", library)
        assert (read.name_in(), read.name_out()) == (function.name_in(), function.name_out())
        for i in range(function.n_out()):
            assert read.sparsity_out(i) == function.sparsity_out(i)
        for found, expected in zip(read(argument), function(argument), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-13)  # rounding


def test_the_manifest_has_the_hash_and_the_version_of_what_was_generated(exported):
    folder, manifest = exported
    source = (folder / "curv_functions.c").read_bytes()
    assert manifest["sha256"] == hashlib.sha256(source).hexdigest()
    assert manifest["casadi"] == ca.CasadiMeta.version()
    assert json.loads((folder / "manifest.json").read_text()) == manifest


def test_the_manifest_tells_the_iterations_of_every_solver(exported):
    _, manifest = exported
    # Newton's: those asked for. Of the project's own solvers, linearizations: one of a single
    # program; otherwise two for each program of 9, of 8 and of 100 by default, since shorter steps
    # take some too; so many in every round, and rounds are six in double precision where targets
    # have to be met, five in single precision.
    # Changes of the active set: ten for each unknown and constraint, which are 5 weights and 4
    # elements; and in each of 2 stages 5 weights, 5 commands and their 5 rates, or no rates.
    rounds = {"double": 6, "float": 5}[manifest["real"]]
    assert manifest["iterations"] == {
        "equilibrium_solver": 7,
        "near": 2 * 9,
        "near_qp": 10 * (5 + 4),
        "near_step": 1,
        "near_step_qp": 10 * (5 + 4),
        "met": rounds * 2 * 8,
        "met_qp": 10 * (5 + 4),
        "path": 2 * 100,
        "path_qp": 10 * 2 * (5 + 5 + 5),
        "path_step": 1,
        "path_step_qp": 10 * 2 * (5 + 5),
    }


def test_the_manifest_tells_the_sizes_that_the_c_has(exported, tmp_path):
    folder, manifest = exported
    lines = []
    for name, function in manifest["functions"].items():
        sizes = function["buffers"]
        real = {"double": 8, "float": 4}[manifest["real"]]
        outputs = sum(rows * columns for rows, columns in function["outputs"].values())
        expected = {
            f"sizeof(curv_{name}_out)": outputs * real,
            f"sizeof(((curv_{name}_work *)0)->w)": max(sizes["w"], 1) * real,
            f"sizeof(((curv_{name}_work *)0)->iw) / sizeof(int)": max(sizes["iw"], 1),
            f"sizeof(((curv_{name}_work *)0)->arg) / sizeof(void *)": sizes["arg"],
            f"sizeof(((curv_{name}_work *)0)->res) / sizeof(void *)": sizes["res"],
        }
        for key in ("arg", "res", "iw", "w"):  # at least what CasADi asks for
            expected[f"({sizes[key]} >= {name}_SZ_{key.upper()})"] = 1
        for key, (rows, columns) in function["inputs"].items():
            if rows * columns:
                expected[f"CURV_{name.upper()}_N_{key.upper()}"] = rows * columns
        lines += [f"  if ({found} != {size}) return 1;" for found, size in expected.items()]
    (tmp_path / "sizes.c").write_text(
        f'#include "curv.h"\n#include "curv_functions.h"\nint main(void) {{\n{chr(10).join(lines)}'
        "\n  return 0;\n}\n"
    )
    _gcc(tmp_path, f"-I{folder}", "sizes.c", "-o", "sizes")
    assert subprocess.run([tmp_path / "sizes"], check=False).returncode == 0


def test_nodes_are_the_instructions_of_the_expanded_function(tmp_path):
    x = ca.SX.sym("x", 2)
    inner = ca.Function("inner", [x], [ca.sin(x[0]) * x[1]])
    y = ca.MX.sym("y", 2)
    plain = ca.Function("plain", [x], [ca.sin(x[0]) * x[1]])
    # Two calls, each of its instructions, an input, a sum, an output.
    calling = ca.Function("calling", [y], [inner(y) + inner(2 * y)])
    functions = cc.export_c([plain, calling], tmp_path)["functions"]
    assert functions["plain"]["nodes"] == plain.n_instructions()
    calls = [k for k in range(calling.n_instructions()) if calling.instruction_id(k) == ca.OP_CALL]
    assert len(calls) == 2
    own = calling.n_instructions() - len(calls)
    assert functions["calling"]["nodes"] == own + 2 * inner.n_instructions()


def test_the_manifest_tells_bounds_and_the_largest_angle_that_they_allow(exported):
    _, manifest = exported
    beam = _beam(manifest["real"])
    limits = manifest["functions"]["tip"]["weights"]["q"]
    lower, upper = beam.bounds
    assert limits["lower"] == [None if np.isinf(x) else x for x in lower]
    assert limits["upper"] == [None if np.isinf(x) else x for x in upper]
    assert limits["allowed_element_angle"] == beam.grid.max_angle
    assert (limits["elements"], limits["rule"]) == (beam.grid.elements, beam.grid.rule)


def test_the_largest_angle_is_one_that_weights_within_bounds_nearly_reach(tmp_path):
    beam = replace(_beam("double"), weight_bounds=0.05)
    manifest = cc.export_c(cc.tip_function(beam), tmp_path, beam=beam)
    said = manifest["functions"]["tip"]["weights"]["q"]["largest_element_angle"]
    corners = np.array(np.meshgrid(*[[-0.05, 0.05]] * N)).reshape(N, -1)
    angles = [np.sqrt(cc.squared_element_angles(beam, ca.DM(q)).full()) for q in corners.T]
    reached = np.max(angles)
    # A bound of the angle, sharp up to what the maxima of several curvatures at one place lose.
    assert reached <= said <= 1.5 * reached


@pytest.mark.parametrize("exported", ["float"], indirect=True)
def test_the_bytes_do_not_depend_on_pythons_hashes(exported, tmp_path):
    """Written by this process, and by one that hashes otherwise."""
    program = (
        "import sys; from tests.export.test_export_proofs import write; write(sys.argv[1], 'float')"
    )
    other = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"
    subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)],
        cwd=tmp_path,
        env={
            **os.environ,
            "PYTHONHASHSEED": other,
            "PYTHONPATH": str(Path(__file__).parents[2]),
        },
        check=True,
    )
    written = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert {"curv.c", "curv_functions.c", "manifest.json"} <= set(written)
    assert written == {name: (exported[0] / name).read_bytes() for name in written}


def test_the_float_tip_of_the_hale_wing_is_within_1e_5_lengths_of_double(tmp_path):
    single, double = (
        hale_wing(grid=cc.Grid.lobatto(16, real=real)) for real in ("float", "double")
    )
    bound = 0.06  # rad/m: with 6 weights, a wing rolled up to a circle and more
    random = np.random.default_rng(0)
    q = random.uniform(-bound, bound, (200, double.basis.n))
    q[50:100] = bound * np.sign(q[50:100])
    q[0] = 0  # or the self-test adds it
    q = q.astype(np.float32).astype(float)
    cc.export_c(
        cc.CFunction(function=cc.tip_function(single), tolerance=1e-5),
        tmp_path,
        real="float",
        reference_inputs={"tip": [[row] for row in q]},
    )
    # The reference is that of the double model; the check divides by the largest coordinate.
    exact = cc.tip_function(double)
    text = (tmp_path / "check.c").read_text()
    for k in range(2):
        rows = ", ".join(
            "{" + ", ".join(repr(float(x)) for x in ca.DM(exact(row)[k]).nonzeros()) + "}"
            for row in q
        )
        text, found = re.subn(rf"(tip_out{k}\[\]\[\d+\] = )\{{.*\}};", rf"\g<1>{{{rows}}};", text)
        assert found == 1
    (tmp_path / "check.c").write_text(text)
    # Over the largest entry, which is at most the length: over the length it is less.
    assert run_check(tmp_path)["tip"] <= 1e-5


def test_a_model_for_float_has_fewer_nodes(tmp_path):
    nodes = {}
    for real in ("float", "double"):
        manifest = cc.export_c(every_kind(_beam(real))[:3], tmp_path / real, real=real)
        nodes[real] = {name: f["nodes"] for name, f in manifest["functions"].items()}
    for name in nodes["float"]:
        assert nodes["float"][name] < nodes["double"][name]


def _tip_derivatives(beam):
    """The Jacobian of the tip, and the Gauss–Newton block of its position."""
    q = ca.MX.sym("q", beam.basis.n)
    jacobian = ca.jacobian(cc.tip_function(beam)(q)[0], q)
    return [cc.tip_function(beam).jacobian(), ca.Function("gram", [q], [jacobian.T @ jacobian])]


@pytest.mark.parametrize("k", [0, 1], ids=["jacobian", "gauss_newton"])
def test_exported_derivatives_are_the_structured_ones(tmp_path, k):
    beam = _beam("double")
    f = _tip_derivatives(beam)[k]
    assert not [g.name() for g in f.find_functions() if re.match(SWEEP, g.name())]
    q, *nominal = [np.full(N, 0.01), *(ca.DM(*f.size_in(i)) for i in range(1, f.n_in()))]
    cc.export_c(f, tmp_path, reference_inputs={f.name(): [[q, *nominal]]})
    source = (tmp_path / "curv_functions.c").read_text()
    assert "jac_tip(" in source or "jac_tip:" in source
    assert not re.search(SWEEP, source)
    assert run_check(tmp_path)[f.name()] <= 1e-13


def test_derivatives_by_ad_would_be_seen(tmp_path):
    q, seed = ca.MX.sym("q", N), ca.MX.sym("seed", N)
    chain = ca.Function("chain", [q], [ca.sin(q) * q], {"never_inline": True})
    f = ca.Function("f", [q, seed], [ca.jtimes(chain(q), q, seed)])
    cc.export_c(f, tmp_path)
    assert re.search(SWEEP, (tmp_path / "curv_functions.c").read_text())
