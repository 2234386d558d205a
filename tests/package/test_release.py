"""A release: one version everywhere; what former ones promised is still there."""

import re
from pathlib import Path

import pytest
from promises import STORED, promises
from ruamel.yaml import YAML

import tubeplanner

ROOT = Path(__file__).parents[2]


def test_changelog_citation_and_recipe_have_the_version():
    """A version with .dev is on its way to the release after the newest of the changelog."""
    changelog = (ROOT / "CHANGELOG.md").read_text()
    title, *older = re.findall(r"^## (.+)$", changelog, re.M)
    newest = re.fullmatch(r"(\d+\.\d+\.\d+) \((\d{4}-\d\d-\d\d)\)", older[0]).groups()
    citation = YAML(typ="safe", pure=True).load(ROOT / "CITATION.cff")
    assert title == "Unreleased"
    assert (citation["version"], str(citation["date-released"])) == newest
    recipe = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text()
    assert f'  version: "{newest[0]}"\n' in recipe
    release, _, is_next = tubeplanner.__version__.partition(".dev")
    assert (release != newest[0]) if is_next else (release == newest[0])


def test_every_key_that_is_promised_is_documented():
    names = ("json_output", "certificate", "trajectory_file")
    pages = "".join((ROOT / "docs" / "reference" / f"{name}.md").read_text() for name in names)
    lines = STORED.read_text(encoding="utf-8").splitlines()
    keys = {re.split("[ .]", each)[-1] for each in lines if each.startswith(("report", "trajec"))}
    assert len(keys) > 80
    assert [key for key in keys if f"`{key}`" not in pages and f'"{key}"' not in pages] == []


@pytest.mark.dear("imports every public name, plans and checks")
def test_what_users_may_rely_on_is_still_there():
    """Names, options, fields and keys go as docs/reference/stability.md says, by a decision."""
    stored = STORED.read_text(encoding="utf-8").splitlines()
    assert len(stored) > 2000
    assert sorted(set(stored) - promises()) == []
