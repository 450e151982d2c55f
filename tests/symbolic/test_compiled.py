"""Native Functions: the values and derivatives of CasADi's virtual machine, from compiled C."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import pickle
import shutil

import casadi as ca
import numpy as np
import pytest

import curvcasadi as cc
from curvcasadi.symbolic import compiled

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="compiles C")


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    """A cache of this module's own, in a folder with a space and an umlaut in its name."""
    folder = tmp_path_factory.mktemp("cäche folder")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield folder / "curvcasadi"


def sample(name="sample"):
    """Two outputs of a vector, a matrix and an empty input."""
    x, y, z = ca.SX.sym("x", 3), ca.SX.sym("y", 2, 2), ca.SX.sym("z", 0)
    outputs = [ca.sin(x) * y[0, 1], ca.sumsqr(x) * y[1, 1] ** 2]
    return ca.Function(name, [x, y, z], outputs, ["x", "y", "z"], ["a", "b"])


ARGUMENTS = (ca.DM([1, 2, 3]), ca.DM([[1, 2], [3, 4]]), ca.DM(0, 1))


def gradient(f):
    """x -> derivative of all outputs of `sample` by x, as CasADi routes it."""
    x = ca.MX.sym("x", 3)
    outputs = ca.veccat(*f(x, *ARGUMENTS[1:]))
    return ca.Function("gradient", [x], [ca.jacobian(outputs, x)])


def names(f):
    return {part.name() for part in f.find_functions()}


def test_values_and_signature_are_those_of_the_function():
    f = sample()
    native = cc.compile_function(f)
    assert str(native).split(" ")[0] == str(f).split(" ")[0]
    assert "sample_native" in names(native)
    for value, expected in zip(native(*ARGUMENTS), f(*ARGUMENTS), strict=True):
        # The same operations in the same order.
        np.testing.assert_allclose(value.full(), expected.full(), rtol=1e-15)


def test_derivatives_are_taken_from_the_compiled_jacobian():
    f = sample()
    derivative = gradient(cc.compile_function(f))
    assert names(derivative) == {"jac_sample", "jac_sample_native"}
    value, expected = (g(ARGUMENTS[0]).full() for g in (derivative, gradient(f)))
    np.testing.assert_allclose(value, expected, rtol=1e-15)


@pytest.mark.parametrize("form", ["compact", "unrolled"])
def test_an_attached_jacobian_is_compiled_and_used(wing, form):
    tip = cc.tip_function(wing(4), form)
    native = cc.compile_function(tip)
    q = ca.MX.sym("q", 12)
    gradients = [ca.Function("g", [q], [ca.gradient(ca.sumsqr(f(q)[0]), q)]) for f in (native, tip)]
    assert {"jac_tip", "jac_tip_native"} <= names(gradients[0])
    assert not any(name.startswith(("fwd", "adj")) for name in names(gradients[0]))
    weights = np.linspace(-0.1, 0.1, 12)
    value, expected = (g(weights).full() for g in gradients)
    np.testing.assert_allclose(value, expected, rtol=1e-13)
    straight = [g(np.zeros(12)).full() for g in gradients]
    np.testing.assert_allclose(*straight, atol=1e-13)


def test_second_derivatives_are_compiled_on_request():
    x = ca.MX.sym("x", 3)

    def hessian(f):
        return ca.Function("h", [x], [ca.hessian(f(x, *ARGUMENTS[1:])[1], x)[0]])

    value = hessian(cc.compile_function(sample(), derivatives=2))(ARGUMENTS[0])
    np.testing.assert_allclose(value.full(), 2 * 4**2 * np.eye(3), rtol=1e-15)
    with pytest.raises(RuntimeError, match="Derivatives cannot be calculated for jac_sample"):
        hessian(cc.compile_function(sample()))
    with pytest.raises(RuntimeError, match="Derivatives cannot be calculated for sample"):
        gradient(cc.compile_function(sample(), derivatives=0))


def test_nan_stays_nan():
    native = cc.compile_function(sample())
    for value in native(ca.DM([1, np.nan, 1]), *ARGUMENTS[1:]):
        assert np.isnan(value.full()).any()


@pytest.mark.parametrize("name", ["double", "sin", "malloc", "main", "jac_sample", "x1_native"])
def test_a_name_may_be_one_that_c_has_taken(name):
    native = cc.compile_function(sample(name))
    assert native.name() == name
    for value, expected in zip(native(*ARGUMENTS), sample(name)(*ARGUMENTS), strict=True):
        np.testing.assert_allclose(value.full(), expected.full(), rtol=1e-15)


def test_inputs_that_are_no_variables_stay_so():
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    f = ca.Function("f", [x, p], [p * x], ["x", "p"], ["y"], {"is_diff_in": [True, False]})
    assert cc.compile_function(f).is_diff_in() == [True, False]


def test_a_function_without_inputs_and_one_that_holds_a_solver():
    constant = ca.Function("constant", [], [ca.DM([1, 2])], [], ["c"])
    np.testing.assert_array_equal(cc.compile_function(constant).call([])[0], [[1], [2]])
    v, p = ca.MX.sym("v"), ca.MX.sym("p")
    solver = ca.rootfinder("solver", "fast_newton", {"x": v, "p": p, "g": v**2 - p})
    root = cc.compile_function(ca.Function("root", [p], [solver(x0=1, p=p)["x"]], ["p"], ["r"]))
    np.testing.assert_allclose(float(root(9)), 3, rtol=1e-12)  # the solver's own tolerance
    slope = ca.Function("slope", [p], [ca.jacobian(root(p), p)])
    np.testing.assert_allclose(float(slope(9)), 1 / 6, rtol=1e-12)


def test_the_result_can_be_pickled_derivatives_included():
    f = sample("travels")
    native = pickle.loads(pickle.dumps(cc.compile_function(f)))
    np.testing.assert_allclose(native(*ARGUMENTS)[0], f(*ARGUMENTS)[0], rtol=1e-15)
    assert "jac_travels_native" in names(gradient(native))


def test_equal_functions_are_compiled_once(cache, monkeypatch):
    cc.compile_function(sample("once"))
    files = set(cache.iterdir())
    monkeypatch.setattr(compiled, "compile_c", None)  # cannot be called
    cc.compile_function(sample("once"))
    assert set(cache.iterdir()) == files


def test_a_damaged_file_of_the_cache_is_replaced(cache, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(compiled, "_build", lambda _, library, __: library.write_text("damaged"))
    with pytest.raises(RuntimeError):
        cc.compile_function(sample("damaged"))
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    native = cc.compile_function(sample("damaged"))
    np.testing.assert_allclose(native(*ARGUMENTS)[1], 14 * 16, rtol=1e-15)


def _compile_in_a_process(name):
    return float(cc.compile_function(sample(name))(*ARGUMENTS)[1])


def test_processes_that_compile_the_same_function_do_not_disturb_each_other(cache):
    context = multiprocessing.get_context("fork")
    with concurrent.futures.ProcessPoolExecutor(3, mp_context=context) as pool:
        values = list(pool.map(_compile_in_a_process, ["together"] * 6))
    assert values == [14 * 16] * 6
    assert not list(cache.glob("build-*"))


def test_without_a_cache_folder_a_temporary_one_serves(monkeypatch, tmp_path):
    blocked = tmp_path / "file"
    blocked.touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    native = cc.compile_function(sample("homeless"))
    np.testing.assert_allclose(native(*ARGUMENTS)[1], 14 * 16, rtol=1e-15)


def test_without_a_compiler_the_virtual_machine_serves_and_one_line_says_so():
    f = sample()
    with pytest.warns(UserWarning, match="no 'no-such-cc' on the PATH.*virtual machine") as record:
        assert cc.compile_function(f, compiler="no-such-cc") is f
    (warning,) = record
    assert "\n" not in str(warning.message)
    assert warning.filename == __file__


class _Double(ca.Callback):
    def __init__(self):
        ca.Callback.__init__(self)
        self.construct("doubled", {"enable_fd": True})

    def eval(self, arguments):
        return [2 * arguments[0]]


def test_what_is_no_c_is_refused_by_name():
    p = ca.MX.sym("p")
    free = ca.Function("loose", [p], [p * ca.MX.sym("a")], {"allow_free": True})
    with pytest.raises(ValueError, match=r"'loose' has free symbols.*a"):
        cc.compile_function(free)
    callback = _Double()
    with pytest.raises(ValueError, match="'f' holds 'doubled'"):
        cc.compile_function(ca.Function("f", [p], [callback(p)]))
    with pytest.raises(ValueError, match="'sample' holds 'sample_native', which is compiled"):
        cc.compile_function(cc.compile_function(sample()))
    options = {"ipopt.print_level": 0, "print_time": False}
    solver = ca.nlpsol("solver", "ipopt", {"x": p, "f": p**2}, options)
    with pytest.raises(ValueError, match=r"'optimum' holds a part .*: coin-or"):
        cc.compile_function(ca.Function("optimum", [p], [solver(x0=p)["x"]]), derivatives=0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"f": "sample"}, "f: expected a Function"),
        ({"real": "half"}, "real: expected one of"),
        ({"derivatives": 3}, "derivatives: expected one of 0, 1, 2; found 3"),
    ],
)
def test_arguments_are_checked(arguments, message):
    with pytest.raises(ValueError, match=message):
        cc.compile_function(**{"f": sample(), **arguments})
