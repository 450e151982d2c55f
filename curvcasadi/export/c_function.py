"""What is exported: a CasADi Function, and what its wrapper in C shall check and say."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from curvcasadi.beam.beam import Beam
from curvcasadi.ocp.mpc import Mpc
from curvcasadi.solvers.embedded import SolverFunction
from curvcasadi.symbolic.expressions import instance, positive

#: Inputs that hold weights where `export_c` is given a beam.
WEIGHTS = ("q", "q_guess")

#: Inputs of solvers that are zero where a loop begins at rest.
STARTS = ("x", "u_previous", "guess")

#: Outputs by which a Function that solves says whether it did: met where at most 1.
VIOLATION, STATIONARITY = "violation", "stationarity"

#: Output by which a Function with weighted targets says whether it reached them: where at most 1.
COMPROMISE = "compromise"

#: What CasADi calls solvers that can fail and still become C.
_PROGRAMS = {"Sqpmethod", "Qrqp"}
_SOLVERS = _PROGRAMS | {"FastNewton"}

#: Words for the inputs and outputs of this package's Functions, by name.
_WORDS = {
    "q": "rad/m, curvature weights",
    "q_guess": "rad/m, curvature weights to start from",
    "q_dot": "rad/(m s), rates of the weights",
    "q_ddot": "rad/(m s²), accelerations of the weights",
    "position": "m, parent axes",
    "positions": "m, parent axes, one target a column",
    "rotation": "local to parent; its columns are the local axes",
    "rotations": "local to parent, one target three columns",
    "jacobian": "body Jacobian: m above, m² below, local axes; twist = J q_dot",
    "distances": "m, by which the positions are missed",
    "angles": "rad, by which the rotations are missed",
    "x": "state",
    "u": "input to apply now",
    "p": "disturbance",
    "u_previous": "input applied before",
    "guess": "plan of the step before; zeros at first",
    "plan": "guess of the next step",
    "states": "states, one a column",
    "slack": "excess over soft bounds, one stage a column",
    "residual": "N m², generalized force",
    VIOLATION: "largest violation over its tolerance; kept where at most 1",
    STATIONARITY: "distance from optimality over its tolerance; converged where at most 1",
    COMPROMISE: "largest error of a weighted target over the tolerance of one to be met; reached "
    "where at most 1, else a compromise",
}

#: Names that C, its library or the generated files have taken.
TAKEN = frozenset(
    """auto break case char const continue default do double else enum extern float for goto if
    inline int long register restrict return short signed sizeof static struct switch typedef
    union unsigned void volatile while main printf abs acos asin atan atan2 ceil cos cosh div
    erf exp exp2 expm1 fabs floor fma fmax fmin fmod frexp gamma hypot index isfinite isinf
    isnan ldexp lgamma log log10 log1p log2 modf nan pow round signbit sin sinh sqrt tan tanh
    tgamma time trunc y0 y1 j0 j1 class new delete this template private public protected friend
    bool true false namespace using virtual operator try catch throw typename explicit mutable
    export memset all_finite all_within none_infinite
    DBL_MAX FLT_MAX HUGE_VAL INFINITY LARGEST NAN NULL UNTOUCHED""".split()
)

#: Names that headers of C, the self-test or targets of CMake have.
TAKEN_FILES = frozenset(
    """assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal
    stdalign stdarg stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads
    time uchar wchar wctype all check clean edit_cache help install package rebuild_cache test
    """.split()
)

_LONGEST_NAME = 60


@dataclass(frozen=True, eq=False, kw_only=True)
class CFunction:
    """A Function for C, with the limits that its wrapper checks.

    A Function with outputs `violation` and `stationarity` is a solver: its wrapper gives out what
    it found only where both are at most 1. Another that holds a solver is refused, as its C would
    call every result a success.

    Attributes
    ----------
    function : casadi.Function
        With a name of its own.
    weights : mapping of str to Beam
        By name of an input that holds weights, one vector a column, the beam whose bounds and
        element angles are checked.
    missing : tuple of str
        Names of inputs in which NaN means "no sample"; everywhere else it is bad input.
    descriptions : mapping of str to str
        Unit and frame of inputs and outputs, by name, where the package's own words do not fit.
    tolerance : float or None
        Tolerance of the self-test: largest error over the largest entry of an output, at least 1.
    unchecked : bool
        True exports a solver without those outputs: its status is OK whatever it finds.
    """

    function: ca.Function
    weights: Mapping[str, Beam] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    descriptions: Mapping[str, str] = field(default_factory=dict)
    tolerance: float | None = None
    unchecked: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.function, ca.Function):
            raise ValueError(
                f"functions: expected one or more casadi.Function or CFunction, "
                f"found {self.function!r}"
            )
        inputs = self.function.name_in()
        for key, beam in instance("CFunction.weights", self.weights, Mapping).items():
            _known("CFunction.weights", key, inputs)
            rows = self.function.size1_in(key)
            if rows != instance(f"CFunction.weights[{key!r}]", beam, Beam).basis.n:
                raise ValueError(
                    f"CFunction.weights[{key!r}]: expected a beam of {rows} weights, "
                    f"found {beam.basis.n}"
                )
            if not self.function.sparsity_in(key).is_dense():
                raise ValueError(f"CFunction.weights[{key!r}]: expected a dense input, found zeros")
        missing = [self.missing] if isinstance(self.missing, str) else self.missing
        if not isinstance(missing, Iterable):
            raise ValueError(f"CFunction.missing: expected names of inputs, found {missing!r}")
        object.__setattr__(self, "missing", tuple(missing))
        for key in self.missing:
            _known("CFunction.missing", key, inputs)
        for key in instance("CFunction.descriptions", self.descriptions, Mapping):
            _known("CFunction.descriptions", key, [*inputs, *self.function.name_out()])
            if "*/" in str(self.descriptions[key]):
                raise ValueError(
                    f"CFunction.descriptions[{key!r}]: expected words without the end of a comment "
                    f"in C, found {self.descriptions[key]!r}"
                )
        if self.tolerance is not None:
            positive("CFunction.tolerance", self.tolerance)

    @property
    def name(self) -> str:
        """Name of the Function."""
        return str(self.function.name())

    @property
    def is_solver(self) -> bool:
        """Whether it says by its outputs if it solved its problem."""
        return {VIOLATION, STATIONARITY} <= set(self.function.name_out())

    @property
    def solves_programs(self) -> bool:
        """Whether it holds a solver of quadratic programs."""
        parts = {f.class_name() for f in [self.function, *self.function.find_functions()]}
        return isinstance(self.function, SolverFunction) or not _PROGRAMS.isdisjoint(parts)

    def refuse_unchecked_solver(self) -> None:
        """Refuse a solver that cannot be checked, as generated solvers always report success."""
        parts = {f.class_name() for f in [self.function, *self.function.find_functions()]}
        solvers = sorted(parts & _SOLVERS)
        if solvers and not self.is_solver and not self.unchecked:
            raise ValueError(
                f"functions: {self.name!r} holds a solver ({', '.join(solvers)}), whose C calls "
                f"every result a success: expected outputs {VIOLATION!r} and {STATIONARITY!r}, at "
                "most 1 where it solved its problem, as equilibrium_function(checked=True) has "
                "them; or CFunction(unchecked=True)"
            )

    def words(self, name: str) -> str:
        """Unit and frame of an input or output.

        Parameters
        ----------
        name : str
            Name of an input or output.

        Returns
        -------
        str
            Unit and frame.
        """
        return str(self.descriptions.get(name, _WORDS.get(name, "")))


def c_functions(functions: Any, beam: Beam | None) -> list[CFunction]:
    """`functions` as CFunctions with different names, none of them taken, nothing left free."""
    found = [functions] if isinstance(functions, ca.Function | CFunction | Mpc) else functions
    if not isinstance(found, Iterable) or isinstance(found, str | bytes):
        found = [found]
    exported = [f if isinstance(f, CFunction) else _plain(f, beam) for f in found]
    if not exported:
        raise ValueError(
            f"functions: expected one or more casadi.Function or CFunction, found {functions!r}"
        )
    names = [f.name for f in exported]
    if len(set(names)) < len(names):
        raise ValueError(f"functions: expected different names, found {names}")
    for f in exported:
        if f.name in TAKEN | {"status", "real"} or f.name.startswith(("check_", "casadi_")):
            raise ValueError(
                "functions: expected names other than C's keywords, those of its library, of "
                f"CasADi and of the check program, found {f.name!r}"
            )
        if len(f.name) > _LONGEST_NAME:
            raise ValueError(
                f"functions: expected names of at most {_LONGEST_NAME} characters, found {f.name!r}"
            )
        if not f.function.nnz_out():
            raise ValueError(f"functions: expected outputs to compute, {f.name!r} has none")
        if f.function.has_free():
            raise ValueError(
                f"functions: {f.name!r} has free symbols {f.function.get_free()}; "
                "make each one an input"
            )
    return exported


def _plain(function: Any, beam: Beam | None) -> CFunction:
    if isinstance(function, Mpc):
        return CFunction(function=function.function, descriptions=function.descriptions)
    if beam is None or not isinstance(function, ca.Function):
        return CFunction(function=function)
    n = instance("beam", beam, Beam).basis.n
    held = [k for k in function.name_in() if k in WEIGHTS]
    for key in held:
        if function.size1_in(key) != n:
            raise ValueError(
                f"beam: expected one of {function.size1_in(key)} weights, those of {key!r} of "
                f"{function.name()!r}, found {n}"
            )
    return CFunction(function=function, weights=dict.fromkeys(held, beam))


def _known(where: str, key: str, names: list[str]) -> None:
    if key not in names:
        raise ValueError(f"{where}: expected names among {', '.join(names)}, found {key!r}")
