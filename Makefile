# Two commands on a fresh machine: `make demo` plans a bundled cycle, `make test` runs the tests.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PROBLEM ?= example:panda/tray_to_the_next_shelf
JOBS ?= 2
SEED ?= 1
# A budget of `make study` for each of its parts [s].
SECONDS ?= 1800
NUMERICS := planning optimizer certificate geometry first_guess trajectory limits robot native
# One thread of linear algebra per worker: more would fight for the same cores. Small pieces of the
# tests are handed out in their order, cheap ones first.
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n $(JOBS) --dist load --maxschedchunk 16
# At the desk the first failure ends a run; CI shows up to twenty.
FAILURES := --maxfail $(if $(CI),20,1)
CHEAP := -m "not slow and not dear"
# The last ones take longest, and begin first.
NOTEBOOKS := $(patsubst %.py,%.ipynb,$(shell ls -r notebooks/*.py))

.PHONY: demo test quick test-slow test-all test-processors test-pure test-lowest study trajectories
.PHONY: lint style types layers lint-repo notebooks check-notebooks docs gallery wheel clean

demo: $(VENV)/.installed
	mkdir -p output
	$(BIN)/tubeplanner plan $(PROBLEM) -o output/trajectory.json --csv output/trajectory.csv --plot output/trajectory.png --html output/trajectory.html

# Style, types and layers are checked beside the tests.
test: $(VENV)/.installed-test
	$(MAKE) --no-print-directory -j 4 lint quick

quick: $(VENV)/.installed-test
	$(PYTEST) -q $(FAILURES) -m "not slow"

test-slow: $(VENV)/.installed-test
	$(PYTEST) -q $(FAILURES) --durations 5 -m "slow and not study"

test-all: test test-slow

# The cheap tests of numerics again, rounded as another processor rounds.
test-processors: $(VENV)/.installed-test
	$(BIN)/python tests/helpers/other_processors.py '$(PYTEST) -q $(FAILURES) $(CHEAP)' $(PROCESSORS)

# The cheap tests of numerics again, by NumPy alone, as where there is no compiler.
test-pure: $(VENV)/.installed-test
	TUBEPLANNER_PURE=1 $(PYTEST) -q $(FAILURES) $(CHEAP) $(addprefix tests/,$(NUMERICS))

# The cheap tests of numerics again, with the oldest versions that pyproject.toml allows.
LOWEST := output/lowest
test-lowest: $(LOWEST)/.installed
	TEST_COVERS=lowest/covers $(PYTEST:$(BIN)/python=$(LOWEST)/bin/python) -q $(FAILURES) $(CHEAP) $(addprefix tests/,$(NUMERICS))

# Before a release: what is too long for CI, each part with a seed and a budget in seconds.
study: $(VENV)/.installed-test
	$(PYTEST) -q -m study
	$(MAKE) --no-print-directory test-lowest
	$(BIN)/python tests/helpers/other_processors.py '$(PYTEST) -q $(CHEAP)'
	$(BIN)/python benchmarks/mutants.py --sample 100000 --seed $(SEED) --seconds $(SECONDS)
	$(BIN)/python benchmarks/campaign.py --count 100000 --seed $(SEED)000 --pairs --processes $(JOBS) --seconds $(SECONDS)
	$(BIN)/python benchmarks/fuzz.py --seed $(SEED)000 --minutes $$(( $(SECONDS) / 60 ))
	$(BIN)/python benchmarks/interruptions.py --seed $(SEED) --seconds $(SECONDS)

# Those that tests only look at, planned again; needed when a bundled problem changes.
trajectories: $(VENV)/.installed-test
	$(BIN)/python tests/helpers/stored_trajectories.py

lint: style types layers

style: $(VENV)/.installed-test
	$(BIN)/ruff check src tests benchmarks notebooks docs
	$(BIN)/ruff format --check src tests benchmarks notebooks docs

types: $(VENV)/.installed-test
	$(BIN)/mypy

layers: $(VENV)/.installed-test
	$(BIN)/lint-imports --no-cache --no-logo

# Workflow files, forms, the recipe for conda and the hygiene of all files, by what
# .pre-commit-config.yaml lists; ruff and mypy again.
lint-repo: $(VENV)/.installed-test $(VENV)/.installed-lint
	$(BIN)/pre-commit run --all-files --show-diff-on-failure

# Every script in notebooks runs from its first cell to its last and becomes a notebook with results.
# One alone: make notebooks/NAME.ipynb.
notebooks: $(VENV)/.installed-notebooks
	$(MAKE) --no-print-directory --keep-going --jobs=$(JOBS) $(NOTEBOOKS)

# The same runs without a change of files: words and durations must be those of the notebooks.
check-notebooks: $(VENV)/.installed-notebooks
	$(MAKE) --no-print-directory --keep-going --jobs=$(JOBS) $(NOTEBOOKS) NOTEBOOK_OPTIONS=--check

# Always run: the results depend on all of the package. One thread of linear algebra each.
$(NOTEBOOKS): $(VENV)/.installed-notebooks FORCE
	OPENBLAS_NUM_THREADS=1 $(BIN)/python docs/notebooks.py $(NOTEBOOK_OPTIONS) $(basename $(@F))

FORCE:

# Tables of fields, commands and names in the pages, from the sources; a test compares them.
.PHONY: docs-tables
docs-tables: $(VENV)/.installed-test
	$(BIN)/python docs/tables.py

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
		"import tubeplanner; from tubeplanner.cli.main import main; assert 'installed' in tubeplanner.__file__; raise SystemExit(main(['plan', '$(PROBLEM)']))"

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

$(VENV)/.installed-lint: | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet 'pre-commit>=4.4'
	touch $@

$(LOWEST)/.installed: pyproject.toml
	$(PYTHON) -m venv --clear $(LOWEST)
	$(LOWEST)/bin/python -m pip install --quiet uv
	$(LOWEST)/bin/uv pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct --compile-bytecode --editable '.[test]'
	touch $@

# All of these by one resolution and one build, for CI. The package's stamp is the oldest, as the
# others need it.
$(VENV)/.installed-all: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --editable '.[test,notebooks,docs]'
	cd $(VENV) && touch .installed .installed-test .installed-notebooks .installed-docs .installed-all
