"""Commands given any problem or trajectory answer in one JSON object or in words."""

from contextlib import nullcontext

import pytest
from any_documents import PROBLEM, changed_documents, require_told, written
from any_values import examples
from hypothesis import given
from hypothesis import strategies as st

from tubeplanner.commands import explain_command
from tubeplanner.commands.cli import main
from tubeplanner.explanation import explain as explain_module
from tubeplanner.explanation import trials
from tubeplanner.measurement import tube_measurement
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning.plan_result import refused_result
from tubeplanner.problem.problem_format import problem_schema

NUMBERS = {"type": "array", "items": {"type": "number"}}
TRAJECTORY = {
    "type": "object",
    "properties": {
        "format": {"const": "tubeplanner/trajectory"},
        "version": {"const": 1},
        "joint_names": {"type": "array", "items": {"type": "string"}},
        "breakpoints": NUMBERS,
        "coefficients": {"type": "array", "items": {"type": "array", "items": NUMBERS}},
        "seams": {},
        "notes": {},
    },
}
MOTION = {
    "format": "tubeplanner/trajectory",
    "version": 1,
    "joint_names": ["joint1", "joint2"],
    "breakpoints": [0.0, 0.5, 1.0],
    "coefficients": [
        [[0.0, 0.1], [0.2, 0.0]],
        [[0.0, 0.0], [0.0, 0.0]],
        [[0.1, -1.0], [0.1, -1.0]],
    ],
}


@pytest.fixture(autouse=True, scope="module")
def nothing_is_planned():
    """Planning and measuring end at once without an answer."""
    blocked = Infeasible(PlanStatus.NO_TRAJECTORY, "not planned here", Place())

    def refused(*arguments, **named):
        return refused_result(blocked, "refinement")

    def raises(*arguments, **named):
        raise blocked

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(explain_command, "workers_of", lambda processes: nullcontext(None))
        patch.setattr(explain_module, "plan", refused)
        patch.setattr(trials, "plan_either", refused)
        patch.setattr(tube_measurement, "_segments_of_some_branch", raises)
        yield


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A file that every example writes anew."""
    return tmp_path_factory.mktemp("any") / "any.json"


@pytest.mark.dear("problems are explained and measured")
@pytest.mark.parametrize("command", ["explain", "measure"])
@examples(4)
@given(document=changed_documents(PROBLEM, problem_schema(), 2), as_json=st.booleans())
def test_any_problem_is_answered(capfd, file, command, document, as_json):
    if written(file, document):
        status = main([command, str(file), *(["--json"] * as_json)])
        out, err = capfd.readouterr()
        if command == "explain" and status == 2 and out and not as_json:
            assert ": bad_input: " in out.splitlines()[0]
            status = 1  # answered: what helps, or that nothing does
        require_told(status, out, err, as_json)


@examples(15)
@given(document=changed_documents(MOTION, TRAJECTORY), as_json=st.booleans())
def test_any_trajectory_is_judged_or_refused(capfd, file, document, as_json):
    if written(file, document):
        words = ["check", "example:two_link/around_a_post", str(file)]
        status = main([*words, *(["--json"] * as_json)])
        require_told(status, *capfd.readouterr(), as_json)
