"""The program that compares exported functions with reference vectors from Python."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.export.c_function import (
    COMPROMISE,
    STARTS,
    STATIONARITY,
    VIOLATION,
    WEIGHTS,
    CFunction,
)
from curvcasadi.export.wrappers import Wrapper
from curvcasadi.kinematics.weights import tolerated_bounds
from curvcasadi.symbolic.expressions import Array, Real, expression, is_numeric

#: Largest error over the largest entry of an output (at least 1), by type: rounding, and what a
#: solver makes of it where it may stop at its tolerance.
_TOLERANCE = {
    ("double", False): 1e-13,
    ("double", True): 1e-6,
    ("float", False): 5e-6,
    ("float", True): 1e-3,
}
_SAMPLES = 5
_HALVINGS = 40  #: of random weights until no element turns too far


def fields(
    wrappers: Sequence[Wrapper], reference_inputs: Mapping[str, Sequence[Sequence[Any]]]
) -> dict[str, str]:
    """What the template check.c.in needs: one test per function, and the list of them."""
    names = [w.export.name for w in wrappers]
    unknown = sorted(set(reference_inputs) - set(names))
    if unknown:
        raise ValueError(f"reference_inputs: expected names of {names}, found {unknown}")
    tests = [_test(w, reference_inputs.get(w.export.name)) for w in wrappers]
    return {
        "TESTS": "\n".join(tests),
        "CALLS": "\n".join(
            f'#ifdef CHECK_{n}\n  failed |= report("{n}", check_{n}(), {_tolerance(w)!r});\n#endif'
            for n, w in zip(names, wrappers, strict=True)
        ),
        "SELECTED": "\n".join(f"#define CHECK_{name}" for name in names),
    }


def _tolerance(wrapper: Wrapper) -> float:
    given = wrapper.export.tolerance
    return float(given or _TOLERANCE[wrapper.real, wrapper.export.is_solver])


def _test(wrapper: Wrapper, given: Sequence[Sequence[Any]] | None) -> str:
    """C that calls one function at every sample; returns its largest error, or what went wrong."""
    export, name = wrapper.export, wrapper.export.name
    if given is None and export.is_solver:
        shapes = [f"{key} {export.function.size_in(key)}" for key in export.function.name_in()]
        raise ValueError(
            f"reference_inputs: expected inputs of the solver {name!r}, which random ones are not: "
            f"reference_inputs={{{name!r}: [[{', '.join(export.function.name_in())}], ...]}}, a "
            f"list for each comparison, with {', '.join(shapes)}"
        )
    inputs = _random_inputs(wrapper) if given is None else _listed(name, given)
    samples = [_sample(wrapper, values) for values in inputs]
    outputs = [_outputs(export, sample) for sample in samples]
    statuses = [_status(export, output) for output in outputs]
    rest = _at_rest(wrapper, samples)
    if rest:
        samples.append(rest[0])
        outputs.append(rest[1])
        statuses.append("OK")
    if "OK" not in statuses:
        raise ValueError(
            f"reference_inputs: expected one at least that {name!r} solves, found "
            + "; ".join(map(_outcome, statuses, outputs))
        )

    lines = [f"#ifdef CHECK_{name}"]
    for k, (key, _, size) in enumerate(wrapper.inputs):
        i = export.function.index_in(key)
        rows = [_row(sample[i].nonzeros(), wrapper.real) for sample in samples]
        lines.append(f"static const @REAL_TYPE@ {name}_in{k}[][{size}] = {{{', '.join(rows)}}};")
    over_tolerances = (VIOLATION, STATIONARITY, COMPROMISE)
    compared = [o for o in wrapper.outputs if o[0] not in over_tolerances]
    for k, (key, _, size) in enumerate(compared):
        rows = [_row(ca.DM(output[key]).nonzeros(), "double") for output in outputs]
        lines.append(f"static const double {name}_out{k}[][{size}] = {{{', '.join(rows)}}};")
    prefix = wrapper.prefix.upper()
    lines.append(
        f"static const {wrapper.prefix}_status {name}_status[] = "
        f"{{{', '.join(f'{prefix}_{s}' for s in statuses)}}};"
    )
    arguments = [
        f"{name}_in{k}[i]" + ("[0]" if size == 1 else "")
        for k, (_, _, size) in enumerate(wrapper.inputs)
    ]
    call = f"{wrapper.name}({', '.join([*arguments, '&out'])})"
    lines += [
        f"static double check_{name}(void) {{",
        f"  static {wrapper.name}_out out;",
        "  double worst = 0;",
        "  int i;",
        f"  for (i = 0; i < {len(samples)}; ++i) {{",
        f"    {wrapper.prefix}_status status;",
        "    fill(&out, sizeof out);",
        "    CHECK_BEGIN",
        f"    status = {call};",
        f'    CHECK_END("{name}")',
        f"    if (status != {name}_status[i]) return wrong_status(i, (int)status);",
        f"    if (status != {prefix}_OK) {{",
        "      if (!untouched(&out, sizeof out)) return touched(i);",
        "      continue;",
        "    }",
        *(
            f"    worst = larger(worst, error({'&' if size == 1 else ''}out.{c}, "
            f"{name}_out{k}[i], {size}));"
            for k, (_, c, size) in enumerate(compared)
        ),
        "  }",
    ]
    lines += _bad_input(wrapper, arguments)
    lines += ["  return worst;", "}", "#endif"]
    return "\n".join(lines) + "\n"


def _bad_input(wrapper: Wrapper, arguments: list[str]) -> list[str]:
    """A call with NaN in the first input must be refused."""
    name = wrapper.export.name
    checked = [
        (k, size)
        for k, (key, _, size) in enumerate(wrapper.inputs)
        if key not in wrapper.export.missing
    ]
    if not checked:
        return []
    k, size = checked[0]
    arguments = [a.replace("[i]", "[0]") for a in arguments]
    arguments[k] = "bad" if size > 1 else "bad[0]"
    call = f"{wrapper.name}({', '.join([*arguments, '&out'])})"
    return [
        "  {",
        f"    static @REAL_TYPE@ bad[{size}];",
        f"    for (i = 0; i < {size}; ++i) bad[i] = {name}_in{k}[0][i];",
        f"    bad[{size - 1}] = (@REAL_TYPE@)NAN;",
        "    fill(&out, sizeof out);",
        f"    if ({call} != {wrapper.prefix.upper()}_BAD_INPUT) return wrong_status(-1, 0);",
        "    if (!untouched(&out, sizeof out)) return touched(-1);",
        "  }",
    ]


def _at_rest(
    wrapper: Wrapper, samples: list[list[ca.DM]]
) -> tuple[list[ca.DM], dict[str, ca.DM]] | None:
    """The first sample with weights, states and guesses at zero, where a loop begins, and outputs.

    None where one of the samples is that, where zero is out of bounds or cannot be evaluated, and
    where a solver does not solve it.
    """
    export = wrapper.export
    starts = [i for i, key in enumerate(export.function.name_in()) if _is_start(export, key)]
    if not starts or any(all(s[i].is_zero() for i in starts) for s in samples):
        return None
    sample = [
        ca.DM(value.sparsity(), 0) if i in starts else value for i, value in enumerate(samples[0])
    ]
    try:
        sample = _sample(wrapper, sample)
        outputs = _outputs(export, sample)
        is_solved = _status(export, outputs) == "OK"
    except ValueError:
        return None
    return (sample, outputs) if is_solved else None


def _is_start(export: CFunction, key: str) -> bool:
    return key in export.weights or key in WEIGHTS or (export.is_solver and key in STARTS)


def _outputs(export: CFunction, sample: list[ca.DM]) -> dict[str, ca.DM]:
    """What Python finds at a sample, by name."""
    try:
        return dict(zip(export.function.name_out(), export.function.call(sample), strict=True))
    except RuntimeError as error:
        raise ValueError(
            f"reference_inputs[{export.name!r}]: expected inputs at which it can be evaluated, "
            f"found: {error}"
        ) from None


def _outcome(status: str, output: Mapping[str, ca.DM]) -> str:
    """A failure in words, with the outputs that show it."""
    measures = [f"{key} {float(output[key]):.3g}" for key in (VIOLATION, STATIONARITY)]
    return f"{status} ({', '.join(measures)})"


def _status(export: CFunction, output: Mapping[str, ca.DM]) -> str:
    if not all(m.is_regular() for m in output.values()):
        raise ValueError(
            f"reference_inputs: expected inputs at which {export.name!r} is finite, found others; "
            "give others, or of an Mpc make a step before"
        )
    if not export.is_solver:
        return "OK"
    if float(output[VIOLATION]) > 1:
        return "INFEASIBLE"
    return "NOT_CONVERGED" if float(output[STATIONARITY]) > 1 else "OK"


def _listed(name: str, given: Any) -> list[Sequence[Any]]:
    """Samples, each a list with a value for every input."""
    lists = (list, tuple)
    if not isinstance(given, lists) or not given or not all(isinstance(g, lists) for g in given):
        raise ValueError(
            f"reference_inputs[{name!r}]: expected a list of samples, each a list with a value for "
            f"every input, found {type(given).__name__} {given!r:.60}"
        )
    return list(given)


def _sample(wrapper: Wrapper, values: Sequence[Any]) -> list[ca.DM]:
    """One value per input, of its shape and sparsity, as numbers of the exported type."""
    f = wrapper.export.function
    where = f"reference_inputs[{f.name()!r}]"
    if len(values) != f.n_in():
        raise ValueError(f"{where}: expected {f.n_in()} inputs, found {len(values)}")
    kind = np.float32 if wrapper.real == "float" else float
    inputs = []
    for i, value in enumerate(values):
        key = f.name_in(i)
        if not is_numeric(value):
            raise ValueError(f"{where}, {key}: expected numbers, found the symbol {value}")
        missing = np.zeros((1, 1), dtype=bool)
        if key in wrapper.export.missing:
            value = ca.DM(value).full()
            missing = np.isnan(value)
            value[missing] = 0.0
        dense = ca.DM(expression(f"{where}, {key}", value, f.size_in(i))).full()
        with np.errstate(over="ignore"):
            rounded = np.where(missing, np.nan, dense.astype(kind))
        if np.any(np.isinf(rounded)):
            raise ValueError(f"{where}, {key}: expected numbers that {kind.__name__} has")
        _check_weights(wrapper, key, rounded, where)
        inputs.append(ca.project(ca.DM(rounded), f.sparsity_in(i)))
    return inputs


def _check_weights(wrapper: Wrapper, key: str, values: Array, where: str) -> None:
    """Weights that the wrapper refuses are no reference."""
    if key not in wrapper.export.weights:
        return
    kind = np.float32 if wrapper.real == "float" else float
    real: Real = "float" if wrapper.real == "float" else "double"
    limits = tolerated_bounds(wrapper.export.weights[key], real)
    lower, upper = (side.astype(kind)[:, None] for side in limits)
    if not np.all((values >= lower) & (values <= upper)) or _angle(wrapper, key, values) > 1:
        raise ValueError(
            f"{where}, {key}: expected weights within the bounds and the largest element angle of "
            f"their beam, found others"
        )


def _angle(wrapper: Wrapper, key: str, values: Array) -> float:
    """Largest squared element angle over its limit, of any column; 0 where bounds keep it."""
    angle = wrapper.angles.get(key)
    return max(float(angle(column)) for column in values.T) if angle is not None else 0.0


def _random_inputs(wrapper: Wrapper) -> list[list[Array]]:
    f, random = wrapper.export.function, np.random.default_rng(0)
    samples = []
    for _ in range(_SAMPLES):
        sample = []
        for i in range(f.n_in()):
            value = random.uniform(-0.05, 0.05, f.size_in(i))
            beam = wrapper.export.weights.get(f.name_in(i))
            if beam is not None:
                lower, upper = beam.bounds
                value = np.clip(value, lower[:, None], upper[:, None])
                for _ in range(_HALVINGS):
                    if _angle(wrapper, f.name_in(i), value) > 0.9:
                        value = np.clip(value / 2, lower[:, None], upper[:, None])
            sample.append(value)
        samples.append(sample)
    return samples


def _row(values: Iterable[float], real: str) -> str:
    suffix = "f" if real == "float" else ""
    return "{" + ", ".join(_number(float(x), suffix) for x in values) + "}"


def _number(x: float, suffix: str) -> str:
    if np.isnan(x):  # a sample that is missing
        return "NAN"
    text = repr(x)
    return (text if "." in text or "e" in text else f"{text}.0") + suffix
