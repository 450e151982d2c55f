# `make demo` and `make test` set up their own virtual environment; they need Python >= 3.11 with
# venv, and a C compiler for the generated code.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test quick docs target-test pil fault-test versions benchmarks figures clean

demo: $(VENV)/installed
	@command -v gcc >/dev/null || { echo "make demo compiles C: gcc is missing (Debian: apt-get install gcc)"; exit 1; }
	$(BIN)/curvcasadi demo

test: $(VENV)/installed-test
	@command -v gcc >/dev/null || { echo "make test compiles C: gcc is missing (Debian: apt-get install gcc)"; exit 1; }
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/mypy --strict --follow-imports=silent -p curvcasadi.symbolic -p curvcasadi.lie -p curvcasadi.beam -p curvcasadi.kinematics -p curvcasadi.solvers -p curvcasadi.loads -p curvcasadi.aero -p curvcasadi.statics
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2

# While working: lint, and the tests that are not `slow`, those of folders and files that solve,
# compile or draw (tests/conftest.py lists them), in at most a fifth of the processor time of
# `make test`. Beside it run the folder that you work on, as in `.venv/bin/pytest tests/estimation`.
quick: $(VENV)/installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 -m "not slow"

target-test: $(VENV)/installed-test
	$(BIN)/python -m codegen.target
	$(BIN)/python -m codegen.firmware.run

# Processor in the loop: filter and controller of the gust case on emulated processors.
pil: $(VENV)/installed-test
	$(BIN)/python -m codegen.loop.run

fault-test: $(VENV)/installed-test
	$(BIN)/python -m codegen.faults
	$(BIN)/python -m codegen.faults.programs

versions: $(VENV)/installed-test
	$(BIN)/python .ci/versions.py

benchmarks: $(VENV)/installed-test
	$(BIN)/python -m benchmarks

docs: $(VENV)/installed-docs
	@command -v gcc >/dev/null || { echo "make docs compiles C: gcc is missing (Debian: apt-get install gcc)"; exit 1; }
	$(BIN)/python -m sphinx -q -W --keep-going -b html docs build/docs
	@echo "build/docs/index.html"

figures: $(VENV)/installed
	$(BIN)/python -m docs.figures
	$(BIN)/python -m docs.published
	$(BIN)/python -m docs.euler_angles

$(VENV)/installed: pyproject.toml
	@$(MAKE) --no-print-directory $(VENV)/bin/pip
	$(BIN)/pip install --quiet --disable-pip-version-check --editable .
	@touch $@

$(VENV)/installed-test: pyproject.toml
	@$(MAKE) --no-print-directory $(VENV)/bin/pip
	$(BIN)/pip install --quiet --disable-pip-version-check --editable ".[test]"
	@touch $@ $(VENV)/installed

$(VENV)/installed-docs: pyproject.toml
	@$(MAKE) --no-print-directory $(VENV)/bin/pip
	$(BIN)/pip install --quiet --disable-pip-version-check --editable ".[docs]"
	@touch $@ $(VENV)/installed

$(VENV)/bin/pip:
	@command -v $(PYTHON) >/dev/null || { echo "Python 3.11 or later is missing (Debian: apt-get install python3)"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "$(PYTHON) is older than 3.11: name a newer one, make PYTHON=python3.12 ..."; exit 1; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { echo "Python's venv module is missing (Debian: apt-get install python3-venv)"; exit 1; }
	$(PYTHON) -m venv $(VENV)

clean:
	rm -rf $(VENV) build out docs/generated *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
