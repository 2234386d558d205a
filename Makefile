# Two commands on a fresh machine: `make demo` plans the bundled UR5 problem, `make test` runs the tests.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PROBLEM ?= example:ur5/over_the_wall

.PHONY: demo test lint clean

demo: $(VENV)/.installed
	mkdir -p output
	$(BIN)/tubeplanner plan $(PROBLEM) -o output/trajectory.json --csv output/trajectory.csv --plot output/trajectory.png

test: $(VENV)/.installed-test lint
	$(BIN)/python -m pytest

lint: $(VENV)/.installed-test
	$(BIN)/ruff check src tests
	$(BIN)/ruff format --check src tests

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
