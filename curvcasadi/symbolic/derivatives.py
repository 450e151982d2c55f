"""Functions with structured derivatives of their own."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import casadi as ca
import numpy as np

from curvcasadi.symbolic.expressions import AnyExpr, same_kind


def with_jacobian(
    name: str,
    inputs: Mapping[str, AnyExpr],
    outputs: Mapping[str, AnyExpr],
    slopes: Mapping[str, AnyExpr],
    *,
    held: Collection[str] = (),
    nominal: Mapping[str, AnyExpr] | None = None,
) -> ca.Function:
    """A `casadi.Function` whose derivatives are `slopes` instead of those of its expressions.

    CasADi takes an attached Jacobian only under conditions that it does not check: those of
    `attached`; and it is named ``jac_<name>``, takes the inputs and one ``out_<output>`` per
    output, and gives one block ``jac_<output>_<input>`` for every pair. Blocks are dense, as
    missing entries would be taken for zeros. Where an output does not depend on an entry of an
    input, structurally, CasADi takes that derivative for zero, whatever the slopes are.

    Parameters
    ----------
    name : str
        Name of the Function.
    inputs : mapping of str to SX or MX symbols
        Inputs by name, in order, all of one kind.
    outputs : mapping of str to SX or MX
        Outputs by name, in order.
    slopes : mapping of str to SX, MX or DM, shape (entries of the output, columns)
        Derivative of each output by the entries of all inputs that are not `held`, in order. An
        output without one is a value only: its derivatives are NaN, never silently zero.
    held : collection of str
        Inputs by which no derivative is taken.
    nominal : mapping of str to SX or MX symbols, optional
        Symbols in `slopes` that stand for values of the outputs: what an implicit function needs,
        whose slopes are known where its value is.

    Returns
    -------
    casadi.Function
        Its second derivatives are those of the expressions in `slopes`.
    """
    kind: Any = same_kind(**inputs)
    sizes = [symbol.numel() for key, symbol in inputs.items() if key not in held]
    ends = np.cumsum([0, *sizes]).tolist()
    blocks = {}
    for output, value in outputs.items():
        shape = value.numel(), ends[-1]
        slope = ca.densify(kind(slopes[output] if output in slopes else ca.DM.nan(*shape)))
        if slope.shape != shape:
            raise ValueError(f"slopes[{output!r}]: expected shape {shape}, found {slope.shape}")
        pieces = iter(ca.horzsplit(slope, ends))
        for key, symbol in inputs.items():
            empty = kind(shape[0], symbol.numel())
            blocks[f"jac_{output}_{key}"] = empty if key in held else next(pieces)
    results = {key: kind.sym(f"out_{key}", *value.shape) for key, value in outputs.items()}
    results |= nominal or {}
    arguments = {**inputs, **{f"out_{key}": results[key] for key in outputs}}
    jacobian = ca.Function(
        f"jac_{name}",
        [*arguments.values()],
        [*blocks.values()],
        [*arguments],
        [*blocks],
        {"cse": True},
    )
    options = {"cse": True, "is_diff_in": [key not in held for key in inputs], **attached(jacobian)}
    return ca.Function(
        name, [*inputs.values()], [*outputs.values()], [*inputs], [*outputs], options
    )


def attached(jacobian: ca.Function) -> dict[str, Any]:
    """Options with which CasADi takes `jacobian` for the derivative of a Function.

    Without a penalty of zero it is ignored; a Function that may be inlined loses it where it is
    called with the symbols that it was made of.
    """
    return {"custom_jacobian": jacobian, "jac_penalty": 0, "never_inline": True}


def jacobian_function(f: ca.Function, name: str | None = None) -> ca.Function:
    """Derivatives of every output of `f` with respect to every input, as a Function of its inputs.

    A structured Jacobian that is attached to `f` is used. Unlike `f.jacobian()` it takes no nominal
    outputs: exported, it is called like `f`.

    Parameters
    ----------
    f : casadi.Function
        With any inputs and outputs.
    name : str, optional
        Name of the result; where None, the name of `f` behind ``jacobian_``.

    Returns
    -------
    casadi.Function
        Inputs as `f`. Outputs ``jac_<output>_<input>``, each (entries of the output, entries of the
        input), matrices by columns.
    """
    jacobian = f.jacobian()
    inputs = [ca.MX.sym(key, f.sparsity_in(key)) for key in f.name_in()]
    nominal = range(f.n_in(), jacobian.n_in())
    needed = any(
        jacobian.jac_sparsity(o, i).nnz() for o in range(jacobian.n_out()) for i in nominal
    )
    outputs = f.call(inputs) if needed else [ca.MX(*jacobian.size_in(i)) for i in nominal]
    blocks = jacobian.call([*inputs, *outputs])
    return ca.Function(
        name or f"jacobian_{f.name()}", inputs, blocks, f.name_in(), jacobian.name_out()
    )
