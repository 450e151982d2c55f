"""Shape filters as C: what the header says, statuses, and samples that are missing or wrong."""

from __future__ import annotations

from codegen import benchmark_functions


def test_the_measured_filter_says_units_of_all_its_arguments():
    [library] = [x for x in benchmark_functions.LIBRARIES if x.name == "ekf"]
    for step in library.functions(library.beam):
        for name in (*step.function.name_in(), *step.function.name_out()):
            assert step.words(name), name
        assert step.words("state") == "q (6) rad/m, q_dot (6) rad/(m s)"
