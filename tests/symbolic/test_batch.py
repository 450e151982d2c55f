"""Batches on vector lanes: the values of the virtual machine, each member of a batch for itself."""

from __future__ import annotations

import pickle
import shutil

import casadi as ca
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import curvcasadi as cc
from curvcasadi.control.iteration import iterated
from curvcasadi.reference_wings import hale_wing
from curvcasadi.symbolic import compiled as cached
from tests.support.strip_wings import hale

needs_compiler = pytest.mark.skipif(shutil.which("g++") is None, reason="compiles C++")

#: No whole number of lanes, neither in double nor in single precision.
SIZE = 21
ROOT = cc.RootMotion(gravity=[0, 0, -9.81])
#: Over the largest entry of an output: rounding, summed over some thousand operations.
TOLERANCE = {"double": 1e-12, "float": 1e-6}


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield


def samples(f, size=SIZE, seed=0, **fields):
    """Random inputs of `f`, (batch, rows, columns) without the last axis where it is one."""
    rng = np.random.default_rng(seed)
    arrays = []
    for i in range(f.n_in()):
        shape = f.size_in(i) if f.size_in(i)[1] != 1 else (f.size1_in(i),)
        low, high = fields.get(f.name_in(i), (-0.03, 0.03))
        arrays.append(rng.uniform(low, high, (size, *shape)))
    return arrays


def one_by_one(f, arrays):
    """The outputs of `f` for each member, as the virtual machine has them."""
    rows = []
    for values in zip(*arrays, strict=True):
        inputs = [ca.project(ca.DM(v), f.sparsity_in(i)) for i, v in enumerate(values)]
        rows.append([output.full() for output in f.call(inputs)])
    return [np.array(column) for column in zip(*rows, strict=True)]


def assert_same(f, arrays, real="double", **options):
    """A batch of `f` has the values of the virtual machine."""
    outputs = cc.compile_batch(f, real, **options)(*arrays)
    outputs = outputs if isinstance(outputs, tuple) else (outputs,)
    for value, expected in zip(outputs, one_by_one(f, arrays), strict=True):
        size = max(1.0, np.abs(expected).max(initial=0))
        atol = TOLERANCE[real] * size
        assert_allclose(value.reshape(expected.shape), expected, rtol=0, atol=atol)


def model():
    """A small wing in unsteady flow, with lag and gust states."""
    lag = cc.IndicialLag(poles=2, modes=2)
    return cc.wing_model(hale((1, 2, 1), 3), density=0.0889, lag=lag, gust=cc.GustEntry())


FLOW = {"p": (0.0, 20.0), "x": (-0.02, 0.02)}
WING = hale_wing(2, 2, 1, grid=cc.Grid.uniform(4))
SENSORS = [
    cc.RateGyro(xi=1.0, noise_density=1e-3, rate=100),
    cc.AttitudeSensor(xi=1.0, noise=0.01),
    cc.Camera(xi=1.0, pose=cc.Pose(rotation=np.eye(3), position=[10.0, 0, -5]), noise=1e-3),
]


def sensor_function():
    q, q_dot, q_ddot = (ca.MX.sym(name, WING.basis.n) for name in ("q", "q_dot", "q_ddot"))
    readings = cc.measure([*SENSORS, cc.Accelerometer(xi=0.5, noise_density=1e-3, rate=100)],
                          WING, q, q_dot, q_ddot, root=ROOT).values  # fmt: skip
    return cc.function("readings", {"q": q, "q_dot": q_dot, "q_ddot": q_ddot}, {"z": readings})


def ekf(step):
    sensors = SENSORS[:2]
    filter_ = cc.shape_ekf(WING, sensors, process="white_acceleration", density=0.01,
                           acceleration=0.05, root=ROOT)  # fmt: skip
    return getattr(filter_, step)


def model_ekf(step):
    """Of a shaft with an estimated torque that fades, a gyro and a gauge."""
    shaft = cc.Beam(
        length=2.0,
        basis=cc.ChannelBasis(torsion=cc.Legendre(1)),
        grid=cc.Grid.lobatto(2),
        section=cc.Section(GJ=30.0, EI_y=1.0, EI_z=1.0, mass_per_length=1.0,
                           inertia=np.diag([0.02, 1, 1])),
    )  # fmt: skip
    torque = ca.MX.sym("torque")
    load = cc.PointMoment(xi=1.0, moment=ca.vertcat(torque, 0, 0), frame="follower")
    process = cc.ModelProcess(
        model=cc.beam_model(shaft, [load], parameters={"torque": torque}, damping=0.003),
        density={"q_dot": 0.3, "torque": 0.2},
        estimated={"torque": 0.5},
    )
    sensors = [SENSORS[0], cc.ShearGauge(xi=0.3, noise=1e-3)]
    return getattr(cc.shape_ekf(shaft, sensors, process=process, outputs={"q": 0.02}), step)


FUNCTIONS = {
    "tip": lambda: cc.tip_function(WING),
    "unrolled tip": lambda: cc.tip_function(WING, "unrolled"),
    "tip and body Jacobian": lambda: cc.tip_function(WING, jacobian=True),
    "attached Jacobian": lambda: cc.tip_function(WING).jacobian(),
    "forward dynamics": lambda: cc.forward_dynamics_function(WING, [cc.Gravity([0, 0, 9.81])]),
    "step of Runge and Kutta": lambda: cc.rk4_step(model(), 1e-3),
    "implicit step": lambda: cc.step_function(model(), 1e-2, method="implicit_midpoint"),
    "sensors": sensor_function,
    "filter, prediction": lambda: ekf("predict"),
    "filter, update": lambda: ekf("update"),
    "filter on a model, prediction": lambda: model_ekf("predict"),
    "filter on a model, update": lambda: model_ekf("update"),
}


@needs_compiler
@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_batch_has_the_values_of_the_virtual_machine(name):
    f = FUNCTIONS[name]()
    assert_same(f, samples(f, factor=(0.5, 1.5), dt=(0.0, 0.02), **FLOW))


@needs_compiler
@pytest.mark.parametrize("name", ["tip", "attached Jacobian", "step of Runge and Kutta"])
def test_single_precision_is_right_to_a_millionth_of_the_length(name):
    f = FUNCTIONS[name]()
    arrays = [a.astype(np.float32) for a in samples(f, **FLOW)]
    assert_same(f, arrays, "float")


# Functions of one number -------------------------------------------------------------------------

SPECIAL = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e-30, 1e30, -1e30, 0.5, -0.5, 1e5, 1e7]


def of_two_numbers():
    """(x, y) -> every function of numbers that lanes have."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    names = "sqrt exp sin cos tan atan asin acos floor ceil fabs sign logic_not"
    values = {name: getattr(ca, name)(x) for name in names.split()}
    names = "atan2 fmax fmin copysign logic_and logic_or"
    values |= {name: getattr(ca, name)(y, x) for name in names.split()}
    values |= {"lt": x < y, "le": x <= y, "eq": x == y, "ne": x != y, "half": x / 2, "square": x**2}
    values |= {"inverse": 1 / x, "choice": ca.if_else(x < y, x, 3 * y), "zero": ca.if_else(x, y, 0)}
    return ca.Function("numbers", [x, y], [*values.values()], ["x", "y"], [*values])


@needs_compiler
@pytest.mark.parametrize(("real", "ulps"), [("double", 4), ("float", 4)])
def test_functions_of_numbers_are_those_of_c_for_special_values_too(real, ulps):
    kind = {"double": np.float64, "float": np.float32}[real]
    rng = np.random.default_rng(1)
    wide = rng.normal(size=(2, 3000)) * 10 ** rng.uniform(-6, 6, (2, 3000))
    near = rng.uniform(-1, 1, (2, 3000))
    pairs = np.array(np.meshgrid(SPECIAL, SPECIAL)).reshape(2, -1)
    x, y = np.hstack([pairs, wide, near]).astype(kind)
    f = of_two_numbers()
    outputs = cc.compile_batch(f, real)(x, y)
    expected = [r.full().ravel() for r in f.map(len(x))(x.astype(float), y.astype(float))]
    for name, value, exact in zip(f.name_out(), outputs, expected, strict=True):
        with np.errstate(invalid="ignore", over="ignore"):
            rounded = exact.astype(kind)
            distance = np.abs(value - exact) / np.abs(np.spacing(np.where(exact, rounded, 1)))
        same = (value == rounded) | (np.isnan(value) & np.isnan(exact))
        same |= (real == "float") & (value == 0) & (np.abs(exact) < np.finfo(kind).tiny)  # flushed
        worst = int(np.argmax(np.where(same, 0, distance)))
        # Each is some roundings of results of the size of its own.
        assert np.all(same | (distance <= ulps)), (name, x[worst], y[worst], value[worst])
        zero = (exact == 0) & (name not in ("fmax", "fmin"))  # of ±0 C may return either
        assert_array_equal(np.signbit(value[zero]), np.signbit(exact[zero]), err_msg=name)


# Matrices, loops and branches --------------------------------------------------------------------


def parts_of_a_graph():
    """(A, v, s) -> what CasADi's matrix graphs are made of."""
    A, v, s = ca.MX.sym("A", 3, 3), ca.MX.sym("v", 3), ca.MX.sym("s")
    x = ca.SX.sym("x", 3)
    f, g = ca.Function("f", [x], [ca.sin(x)]), ca.Function("g", [x], [x**2, x])
    definite = A @ A.T + 5 * ca.DM.eye(3)
    values = {
        "product": ca.tril(A) @ ca.triu(A) @ v,
        "solved": ca.solve(definite, v, "ldl"),
        "selected": ca.if_else(s > 0, v, 2 * v) + ca.if_else(v > 0, v, 0),
        "chosen": ca.conditional(s, [v, 2 * v], 3 * v),
        "branched": ca.if_else(s > 0, ca.sqrt(s) * v, v, True),
        "mapped": f.map(3)(A),
        "accumulated": f.mapaccum(3)(v),
        "left out": g(v)[1],
        "rows": ca.vertcat(A[1, :].T, v[::-1], s),
        "norms": ca.vertcat(ca.norm_2(v), ca.norm_1(v), ca.norm_inf(v), ca.mmax(v), ca.mmin(v)),
        "lower": ca.tril(A),
        "transposed": A[:2, :].T,
        "empty": ca.MX(0, 1),
    }
    names = ["A", "v", "s"]
    return ca.Function("parts", [A, v, s], [*values.values()], names, [*values])


@needs_compiler
def test_graphs_of_matrices_loops_and_branches():
    f = parts_of_a_graph()
    assert_same(f, samples(f, A=(-1, 1), v=(-1, 1), s=(-1, 2)))


@needs_compiler
def test_each_lane_iterates_as_often_as_it_needs():
    z, c = ca.MX.sym("z"), ca.MX.sym("c")
    heron = ca.Function("heron", [z, c], [(z + c / z) / 2, ca.fabs(z - c / z)])
    root = iterated(heron, 40, 1e-8)
    c = 10.0 ** np.arange(16)
    found, _, iterations = cc.compile_batch(root)(np.float64(1), c)
    assert_allclose(found, np.sqrt(c), rtol=1e-15)  # quadratic convergence beyond the tolerance
    assert_array_equal(iterations, [float(root(1, value)[2]) for value in c])
    assert iterations[0] < iterations[-1]


@needs_compiler
@pytest.mark.parametrize("real", ["double", "float"])
def test_a_nan_stays_in_its_lane(real):
    step = cc.rk4_step(model(), 1e-3)
    x, u, p = samples(step, **FLOW)
    batch = cc.compile_batch(step, real)
    clean = batch(x, u, p)
    for bad in (np.nan, np.inf):
        x[5, 1], x[20, 0] = bad, bad
        value = batch(x, u, p)
        assert np.isnan(value[[5, 20]]).any(axis=1).all()
        others = np.delete(np.arange(SIZE), [5, 20])
        assert_array_equal(value[others], clean[others])


@needs_compiler
def test_single_precision_flushes_denormal_numbers_in_the_batch_alone():
    x = ca.SX.sym("x")
    half = ca.Function("half", [x], [x / 4])
    smallest = float(np.finfo(np.float32).tiny)
    assert cc.compile_batch(half, "float")(np.full(3, smallest)).max() == 0
    assert np.float32(smallest) / np.float32(4) > 0  # this thread is as it was
    tiny = np.finfo(np.float64).tiny
    assert cc.compile_batch(half)(np.full(3, tiny)).min() == tiny / 4


# Arrays ------------------------------------------------------------------------------------------


def shapes():
    """A column, a matrix and a scalar in; a matrix, a scalar and a sparse matrix out."""
    x, y, z = ca.SX.sym("x", 3), ca.SX.sym("y", 2, 4), ca.SX.sym("z")
    outputs = [x @ y[0, :], z * ca.sumsqr(y), z * ca.diag(x)]
    return ca.Function("shapes", [x, y, z], outputs, ["x", "y", "z"], ["a", "b", "c"])


@pytest.fixture(scope="module", params=["native", "mapped"])
def compiler(request):
    """A compiler, or none: what holds of arrays holds with both."""
    if request.param == "native" and shutil.which("g++") is None:
        pytest.skip("compiles C++")
    return {"native": "g++", "mapped": "no-such-c++"}[request.param]


def compiled(f, compiler, **options):
    if compiler == "g++":
        return cc.compile_batch(f, **options)
    with pytest.warns(UserWarning, match="mapped in"):
        return cc.compile_batch(f, compiler=compiler, **options)


def test_the_batch_is_the_first_axis_or_the_last(compiler):
    f = shapes()
    x, y, z = samples(f)
    z = z[:, 0]
    expected = one_by_one(f, [x, y, z])
    first = compiled(f, compiler)(x, y, z)
    assert [a.shape for a in first] == [(SIZE, 3, 4), (SIZE,), (SIZE, 3, 3)]
    last = compiled(f, compiler, axis=-1)(x.T, np.moveaxis(y, 0, -1), z)
    assert [a.shape for a in last] == [(3, 4, SIZE), (SIZE,), (3, 3, SIZE)]
    for one, other, value in zip(first, last, expected, strict=True):
        assert_allclose(one.reshape(value.shape), value, atol=1e-15)
        assert_array_equal(np.moveaxis(other, -1, 0), one)


def test_arrays_need_not_be_contiguous_nor_of_the_type(compiler):
    f = shapes()
    batch = compiled(f, compiler)
    x, y, z = samples(f)
    z = z[:, 0]
    expected = batch(x, y, z)
    reversed_ = [np.ascontiguousarray(a[::-1])[::-1] for a in (x, y, z)]
    strided = [np.repeat(a, 2, axis=0)[::2] for a in (x, y, z)]
    fortran = [np.asfortranarray(a) for a in (x, y, z)]
    record = np.zeros(SIZE, [("tag", "u1"), ("x", float, 3)])  # steps of 25 bytes
    record["x"] = x
    for arrays in (reversed_, strided, fortran, [record["x"], y, z]):
        for value, other in zip(batch(*arrays), expected, strict=True):
            assert_array_equal(value, other)
    whole = batch(np.ones((2, 3), int), np.ones((2, 2, 4), np.int8), np.ones(2, np.float32))
    assert_array_equal(whole[1], [8, 8])


def test_a_value_without_the_axis_is_that_of_all(compiler):
    f = shapes()
    batch = compiled(f, compiler)
    x, y, z = samples(f)
    alone = batch(x[0], y[0], z[:, 0])
    for value, other in zip(alone, batch(np.tile(x[0], (SIZE, 1)), np.tile(y[0], (SIZE, 1, 1)),
                                         z[:, 0]), strict=True):  # fmt: skip
        assert_array_equal(value, other)


def test_empty_batches_and_batches_of_one(compiler):
    f = shapes()
    batch = compiled(f, compiler)
    empty = batch(np.zeros((0, 3)), np.zeros((0, 2, 4)), np.zeros(0))
    assert [a.shape for a in empty] == [(0, 3, 4), (0,), (0, 3, 3)]
    x, y, z = samples(f, size=1)
    for value, other in zip(batch(x, y, z), one_by_one(f, [x, y, z]), strict=True):
        assert_allclose(value.reshape(other.shape), other, atol=1e-15)


def test_threads_and_outputs_of_ones_own(compiler):
    f = shapes()
    batch = compiled(f, compiler)
    x, y, z = samples(f, size=1000)
    expected = batch(x, y, z)
    for threads in (2, 3, None):
        for value, other in zip(batch(x, y, z, threads=threads), expected, strict=True):
            assert_array_equal(value, other)
    out = [np.full_like(a, np.nan) for a in expected]
    wide = np.full((1000, 3, 8), np.nan)
    out[0] = wide[:, :, ::2]
    returned = batch(x, y, z, out=out)
    assert all(a is b for a, b in zip(returned, out, strict=True))
    for value, other in zip(out, expected, strict=True):
        assert_array_equal(value, other)
    assert np.isnan(wide[:, :, 1::2]).all()


X, Y, Z = np.zeros((5, 3)), np.zeros((5, 2, 4)), np.zeros(5)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((X, Y), {}, r"shapes: expected 3 arrays \(x, y, z\), found 2"),
        ((X.T, Y, Z), {}, r"x: expected an array \(batch, 3\), or \(3,\) for .*\(3, 5\); axis=-1"),
        ((X, Y[:, 0], Z), {}, r"y: expected an array \(batch, 2, 4\)"),
        ((X, Y, np.zeros((5, 2))), {}, r"z: expected an array \(batch,\), or \(\) for"),
        ((X, Y, Z[:4]), {}, "expected batches of one length, found x 5, y 5, z 4"),
        ((X[0], Y[0], 1.0), {}, r"expected an array with the axis of the batch \(\(batch, 3\), "),
        ((X + 1j, Y, Z), {}, "x: expected an array of numbers, found dtype complex128"),
        ((X, Y.astype(object), Z), {}, "y: expected an array of numbers, found dtype object"),
        ((X, Y, ["a"] * 5), {}, "z: expected an array of numbers, found dtype <U1"),
        ((X, Y, Z), {"threads": 0}, "threads: expected a whole number of at least 1, found 0"),
        ((X, Y, Z), {"out": [X]}, "out: expected 3 arrays, found 1"),
        ((X, Y, Z), {"out": [np.zeros((5, 3, 4)), Z, np.zeros((5, 3))]}, r"out\[2\]: .*\(5, 3\)"),
        ((X, Y, Z), {"out": [np.zeros((5, 3, 4), "f"), Z, Z]}, r"out\[0\]: .*float64, found.*32"),
    ],
)
def test_arrays_that_do_not_fit_are_named(compiler, arguments, options, message):
    with pytest.raises(ValueError, match=message):
        compiled(shapes(), compiler)(*arguments, **options)


# What is refused ---------------------------------------------------------------------------------


class _Callback(ca.Callback):
    def __init__(self):
        ca.Callback.__init__(self)
        self.construct("doubled", {"enable_fd": True})

    def eval(self, arguments):
        return [2 * arguments[0]]


def refused():
    """Functions that no lane can evaluate, and what names them."""
    v, s = ca.MX.sym("v", 3), ca.MX.sym("s")
    x = ca.SX.sym("x")
    A = ca.diag(v) + 1
    square = ca.Function("square", [v], [v**2])
    qp = ca.qpsol("qp", "qrqp", {"x": x, "f": x**2}, {"print_iter": False, "print_header": False})
    callback = _Callback()
    return {
        "'grown' calls log": ca.Function("grown", [x], [ca.log(x)]),
        "'powers' holds 'inner', which calls constpow, erf": ca.Function(
            "powers", [s], [ca.Function("inner", [x], [x**1.5 + ca.erf(x)]).call([s])[0]]
        ),
        r"'pivots' calls casadi_.*house": ca.Function("pivots", [v], [ca.solve(A, v, "qr")]),
        "'three' holds a part with a branch in more": ca.Function(
            "three", [v, s], [ca.conditional(s, [v, 2 * v], ca.sin(v), True)]
        ),
        "'table' holds 'lut', which is a LinearInterpolant": ca.Function(
            "table", [s], [ca.interpolant("lut", "linear", [[0, 1, 2]], [1, 2, 3])(s)]
        ),
        "'optimum' holds 'qp_qpsol', which is a Qrqp": ca.Function("optimum", [s], [qp(x0=s)["x"]]),
        "'python' holds 'doubled'": ca.Function("python", [s], [callback(s)]),
        "'native' holds 'square_native', which is compiled": ca.Function(
            "native", [v], [cc.compile_function(square, derivatives=0)(v)]
        ),
        "'loose' has free symbols": ca.Function("loose", [v], [v * s], {"allow_free": True}),
    }, callback


@needs_compiler
def test_what_does_not_work_on_lanes_is_refused_by_name():
    functions, _ = refused()
    for message, f in functions.items():
        with pytest.raises(ValueError, match=message):
            cc.compile_batch(f)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"f": "shapes"}, "f: expected a Function"),
        ({"real": "half"}, "real: expected one of 'double', 'float'; found 'half'"),
        ({"axis": 1}, "axis: expected one of 0, -1; found 1"),
    ],
)
def test_arguments_are_checked(arguments, message):
    with pytest.raises(ValueError, match=message):
        cc.compile_batch(**{"f": shapes(), **arguments})


def test_without_a_compiler_one_line_says_so():
    with pytest.warns(UserWarning, match="no 'no-such-c\\+\\+' on the PATH.*mapped") as record:
        batch = cc.compile_batch(shapes(), "float", compiler="no-such-c++")
    (warning,) = record
    assert "\n" not in str(warning.message)
    assert warning.filename == __file__
    assert not batch.is_native
    assert batch(X, Y, Z)[0].dtype == np.float32


@needs_compiler
def test_a_batch_may_be_pickled_and_its_library_comes_out_of_the_cache(monkeypatch):
    batch = cc.compile_batch(shapes(), axis=-1)
    x, y, z = samples(shapes())
    arrays = x.T, np.moveaxis(y, 0, -1), z[:, 0]
    monkeypatch.setattr(cached, "_build", None)  # the compiler is not asked again
    again = pickle.loads(pickle.dumps(batch))
    for value, other in zip(again(*arrays), batch(*arrays), strict=True):
        assert_array_equal(value, other)
    assert repr(again) == "<Batch of shapes: native, double, axis -1>"
