"""Controllers by name."""

import pytest

from stored_trajectories import REFINEMENT, stored_trajectory
from tubeplanner import OptionError
from tubeplanner.controllers.controllers import CONTROLLERS, judged_by


def test_each_has_its_own_name_and_limits(bundled):
    name = "panda/between_shelves"
    problem, file = bundled(name), stored_trajectory(name, REFINEMENT)
    found = {each: judged_by(each, problem, file) for each in CONTROLLERS}
    assert [verdict.name for verdict in found.values()] == list(CONTROLLERS)
    limits = {each.limit for each in found["fr3"].findings if each.unit == "rad/s^3"}
    assert {abs(limit) for limit in limits} == {5000}
    assert "Panda" in found["fer"].title
    assert (found["fer"].summary, found["jtc"].summary) == ("would abort", "accepted")


def test_an_unknown_one_is_refused(bundled):
    name = "panda/between_shelves"
    with pytest.raises(OptionError, match=r"unknown controller 'fr4'.*there is: fer, fr3, jtc"):
        judged_by("fr4", bundled(name), stored_trajectory(name, REFINEMENT))
