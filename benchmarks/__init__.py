"""Benchmarks of curvcasadi: `python -m benchmarks` prints one set of tables.

Every table holds ratios of one run, node counts, errors or bytes. "nodes" means
`Function.n_instructions()` of a Function built with `{"cse": True}`.
"""
