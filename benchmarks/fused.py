"""How fast a function could be: its fused multiply-adds, and how many a second there are."""

from __future__ import annotations

import ctypes
from collections import Counter

import casadi as ca

from benchmarks.timing import least
from curvcasadi.symbolic import batch_code, lanes
from curvcasadi.symbolic.compiled import loaded

_PRODUCTS = {ca.OP_MUL, ca.OP_SQ}
_SUMS = {ca.OP_ADD, ca.OP_SUB}
#: What costs an instruction beside them: x + x, −x, and a division as one (it takes many times as
#: long, so the limit stays one).
_OTHERS = {ca.OP_TWICE, ca.OP_NEG, ca.OP_DIV, ca.OP_INV}

#: Independent chains of fused multiply-adds: as many as hide the latency of one.
_CHAINS = 12
_PEAK = """
extern "C" void chains(long rounds, Real *result) {{
  Values a = Values{{}} + (Real)0.999999, b = Values{{}} + (Real)1e-6, {start};
  for (long i = 0; i < rounds; ++i) {{
    {steps}
    asm volatile("" : {kept});
  }}
  *result = ({end})[0];
}}
extern "C" int lane_count() {{ return COUNT; }}
"""


def fused_operations(f: ca.Function) -> int:
    """Arithmetic instructions of an SX Function, of which its C has a line each, after fusion.

    A product that goes into a single sum or difference is one instruction with it; a sum takes one
    product at most.
    """
    if not f.is_a("SXFunction"):
        raise ValueError(f"f: expected an SX Function, found {f.name()!r}, a {f.class_name()}")
    made: dict[int, int] = {}  # place in memory: the instruction whose result lies there
    products: set[int] = set()
    uses: Counter[int] = Counter()
    sums: list[tuple[int, ...]] = []
    instructions = 0
    for k in range(f.n_instructions()):
        operation = f.instruction_id(k)
        if operation == ca.OP_OUTPUT:
            uses[made[f.instruction_input(k)[0]]] += 1
            continue
        places = () if operation in (ca.OP_INPUT, ca.OP_CONST) else f.instruction_input(k)
        arguments = tuple(made[place] for place in places)
        uses.update(arguments)
        instructions += operation in _PRODUCTS | _SUMS | _OTHERS
        if operation in _SUMS:
            sums.append(arguments)
        if operation in _PRODUCTS:
            products.add(k)
        made[f.instruction_output(k)[0]] = k
    fusable = {k for k in products if uses[k] == 1}
    return instructions - sum(any(k in fusable for k in pair) for pair in sums)


def peak() -> float:
    """Fused multiply-adds a second in double precision, of all lanes together."""
    names = [f"x{k}" for k in range(_CHAINS)]
    text = _PEAK.format(
        start=", ".join(f"{x} = a" for x in names),
        steps=" ".join(f"{x} = {x} * a + b;" for x in names),
        kept=", ".join(f'"+v"({x})' for x in names),
        end=" + ".join(names),
    )
    text = f"#define LANES_REAL double\n{lanes.template('lanes.h')}{text}"
    library = loaded(text, batch_code.OPTIONS, "g++", "cpp")
    rounds, result = 50_000, ctypes.c_double()
    library.chains.argtypes = [ctypes.c_long, ctypes.c_void_p]
    once = least(lambda: library.chains(rounds, ctypes.addressof(result)))
    return float(rounds * _CHAINS * library.lane_count() / once)
