"""`tubeplanner links` says how closely links are covered, and what is not checked."""

import json


def test_links_are_listed_with_what_their_covers_stand_off(run):
    status, text, _ = run("links", "example:two_link/around_a_post", "--json")
    report = json.loads(text)
    assert (status, report["status"]) == (0, "success")
    assert {"link", "shapes", "outer_error", "closer_shapes", "closer_error"} == {
        *report["links"][0]
    }
    assert all(each["outer_error"] >= 0 for each in report["links"])
    for pair in report["left_out"]:
        assert pair["reason"] in ("neighbours", "always touching", "ignored")
    status, text, _ = run("links", "example:two_link/around_a_post")
    assert status == 0
    for each in report["links"]:
        assert each["link"] in text


def test_a_problem_that_is_not_there_is_refused(run):
    assert run("links", "nothing.yaml")[0] == 2


def test_meshes_are_measured(run):
    listed = json.loads(run("links", "example:ur5/over_the_wall", "--json")[1])["links"]
    assert any(each["outer_error"] > 1e-3 for each in listed)
