"""Notebooks are stored with the results of their scripts, and code hosts show them whole."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "notebooks"
NAMES = [path.stem for path in sorted(FOLDER.glob("*.py"))]
HASH = "0123"
PICTURE = {"output_type": "display_data", "metadata": {}, "data": {"image/png": "iVBO"}}


@pytest.fixture
def notebooks(monkeypatch):
    """The module that makes notebooks."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    import notebooks

    return notebooks


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_has_the_results_of_its_script(notebooks, name):
    stored = (FOLDER / f"{name}.ipynb").read_bytes()
    assert notebooks.faults(stored, notebooks.script_hash(name)) == []


def test_every_script_has_a_notebook_a_picture_and_a_line_in_the_list(notebooks):
    readme = (FOLDER / "README.md").read_text()
    listed = re.findall(r"^\| \[[^]]+\]\((\w+)\.ipynb\) \|.*pictures/\1\.png", readme, re.M)
    assert listed[0] == "02_comparing_tolerances"
    pictures = sorted((FOLDER / "pictures").iterdir())
    assert sorted(listed) == NAMES == sorted(path.stem for path in FOLDER.glob("*.ipynb"))
    assert [path.stem for path in pictures] == NAMES
    assert max(path.stat().st_size for path in pictures) <= notebooks.MAX_PICTURE_SIZE


def notebook(*outputs, sha256=HASH, count=1):
    """Return a notebook with one cell."""
    cell = {"cell_type": "code", "execution_count": count, "outputs": list(outputs)}
    return {"metadata": {"tubeplanner": {"script_sha256": sha256}}, "cells": [cell]}


def stream(text, name="stdout"):
    return {"output_type": "stream", "name": name, "text": text}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (notebook(PICTURE, sha256="4567"), r"the script has changed .*; run `make notebooks`"),
        (notebook(PICTURE, stream("x" * 500_000)), r"500 kB are more than 400 kB; .*`make note"),
        (notebook(), r"no output is a picture; run `make notebooks`"),
        (notebook(PICTURE, count=None), r"not every cell has run, in order; run `make notebooks`"),
        (
            notebook(PICTURE, {"output_type": "error", "ename": "KeyError", "evalue": "'q'"}),
            r"cell 1: error KeyError: 'q'",
        ),
        (notebook(PICTURE, stream(["old", " name"], "stderr")), r"cell 1: warning: old name"),
        (notebook(PICTURE, stream("in /tmp/a1/t.csv")), r"cell 1: path .*: /tmp/a1/t\.csv"),
        (
            notebook(PICTURE, {**PICTURE, "data": {"text/html": "<iframe>"}}),
            r"cell 1: code hosts show no text/html",
        ),
    ],
)
def test_a_fault_of_a_notebook_is_named(notebooks, content, message):
    (fault,) = notebooks.faults(json.dumps(content).encode(), HASH)
    assert re.match(message, fault)


def test_words_and_durations_of_results_are_compared(notebooks):
    stored = notebook(PICTURE, stream("3 moves in 0.50 s:\n[ 0.1 -2] rad\n"))
    same = notebook(PICTURE, stream("4 moves in 0.52 s:\n[-0.3  1.5] rad\n"))
    assert notebooks.differences(stored, same) == []
    slower = notebook(PICTURE, stream("3 moves in 0.58 s:\n[0.1 -2] rad\n"))
    assert notebooks.differences(stored, slower) == ["0.50 s is 0.58 s now"]
    other = notebook(PICTURE, stream("3 legs in 0.50 s:\n[0.1 -2] rad\n"))
    assert notebooks.differences(stored, other)[-2:] == ["-# moves in # s:", "+# legs in # s:"]
    assert notebooks.differences(stored, notebook(*stored["cells"][0]["outputs"][1:])) != []
