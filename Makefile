# Two commands on a fresh machine: `make demo` plans the bundled UR5 problem, `make test` runs the tests.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PROBLEM ?= example:ur5/over_the_wall
JOBS ?= 2
NUMERICS := planning refinement verification collision branches trajectory constraints robot native
# One thread of linear algebra per worker: more would fight for the same cores.
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n $(JOBS) --dist worksteal

.PHONY: demo test test-slow test-all test-processors test-pure trajectories lint notebooks docs gallery wheel clean

demo: $(VENV)/.installed
	mkdir -p output
	$(BIN)/tubeplanner plan $(PROBLEM) -o output/trajectory.json --csv output/trajectory.csv --plot output/trajectory.png --html output/trajectory.html

test: $(VENV)/.installed-test lint
	$(PYTEST) -m "not slow"

test-slow: $(VENV)/.installed-test
	$(PYTEST) -m slow

test-all: $(VENV)/.installed-test lint
	$(PYTEST)

# The numerics again, rounded as other processors round.
test-processors: $(VENV)/.installed-test
	$(BIN)/python tests/other_processors.py "$(PYTEST)"

# The numerics again, by numpy alone, as where there is no compiler.
test-pure: $(VENV)/.installed-test
	TUBEPLANNER_PURE=1 $(PYTEST) -m "not slow" $(addprefix tests/,$(NUMERICS))

# Those that tests only look at, planned again; needed when a bundled problem changes.
trajectories: $(VENV)/.installed-test
	$(BIN)/python tests/refresh_trajectories.py

lint: $(VENV)/.installed-test
	$(BIN)/ruff check src tests benchmarks notebooks docs
	$(BIN)/ruff format --check src tests benchmarks notebooks docs
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache --no-logo

# Every notebook runs from its first cell to its last, and becomes a page in output/notebooks.
notebooks: $(VENV)/.installed-notebooks
	mkdir -p output/notebooks
	for source in notebooks/*.py; do \
		target=output/notebooks/$$(basename $$source .py) && \
		$(BIN)/jupytext --quiet --to ipynb --output $$target.ipynb $$source && \
		$(BIN)/jupyter-nbconvert --log-level ERROR --execute --to html $$target.ipynb || exit 1; \
	done

# Pages in output/docs; a name or a link that leads nowhere ends the build.
docs: $(VENV)/.installed-docs
	rm -rf output/docs
	$(BIN)/python -m sphinx --quiet --fail-on-warning --keep-going docs output/docs

# The pictures of README and docs; one alone: python docs/gallery.py NAME.
gallery: $(VENV)/.installed
	$(BIN)/python docs/gallery.py

# The built wheel alone, away from the checkout, must list and plan the bundled problems.
wheel: $(VENV)/.installed
	rm -rf output/wheel
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir output/wheel .
	$(BIN)/python -m pip install --quiet --no-deps --target output/wheel/installed output/wheel/*.whl
	cd output/wheel && PYTHONPATH=installed ../../$(BIN)/python -c \
		"import tubeplanner; from tubeplanner.commands.cli import main; assert 'installed' in tubeplanner.__file__; raise SystemExit(main(['plan', '$(PROBLEM)']))"

clean:
	rm -rf $(VENV) output

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/.installed-test: pyproject.toml $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable '.[test]'
	touch $@

$(VENV)/.installed-notebooks: pyproject.toml $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable '.[notebooks]'
	touch $@

$(VENV)/.installed-docs: pyproject.toml $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@
