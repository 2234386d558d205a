"""Which files are cycles or studies, and what is said of a file of another kind."""

import pytest

from small_cycle import SMALL
from tubeplanner import ProblemError, load_problem
from tubeplanner.files.problem_file import read_fields
from tubeplanner.problem.document_kind import is_cycle, is_study, require_study


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ({"format": "tubeplanner/cycle"}, True),
        ({"moves": []}, True),
        ({"format": "tubeplanner/problem", "tube": {}}, False),
        ({}, False),
        (["moves"], False),
        (None, False),
    ],
)
def test_a_cycle_is_known_by_its_format_or_its_moves(document, expected):
    assert is_cycle(document) is expected


@pytest.mark.parametrize("read", [load_problem, read_fields])
def test_what_takes_problems_refuses_cycles_and_says_what_takes_them(read, tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(SMALL)
    with pytest.raises(ProblemError, match=r"c\.yaml: this is a cycle, .*; plan, check, info"):
        read(path)


@pytest.mark.parametrize(
    ("document", "expected"),
    [({"format": "tubeplanner/study"}, True), ({"study": {}}, True), ({"moves": []}, False)],
)
def test_a_study_is_known_by_its_format_or_its_study(document, expected):
    assert is_study(document) is expected


@pytest.mark.parametrize("read", [load_problem, read_fields])
def test_what_takes_problems_refuses_studies_and_says_what_takes_them(read, tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text("format: tubeplanner/study\n")
    with pytest.raises(ProblemError, match=r"s\.yaml: this is a study, .*; study takes it"):
        read(path)


def test_what_takes_studies_says_what_takes_others():
    require_study({"study": {}}, "s")
    for document, kind in (({"tube": {}}, "a problem"), ({"moves": []}, "a cycle")):
        with pytest.raises(ProblemError, match=f"^s: this is {kind}, where a study .*plan takes"):
            require_study(document, "s")
