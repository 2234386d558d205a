"""What states the version is of one release: package, changelog, citation."""

import re
from pathlib import Path

from ruamel.yaml import YAML

import tubeplanner

ROOT = Path(__file__).parents[2]


def test_changelog_and_citation_have_the_version():
    """A version with .dev is on its way to the release after the newest of the changelog."""
    changelog = (ROOT / "CHANGELOG.md").read_text()
    title, *older = re.findall(r"^## (.+)$", changelog, re.M)
    newest = re.fullmatch(r"(\d+\.\d+\.\d+) \((\d{4}-\d\d-\d\d)\)", older[0]).groups()
    citation = YAML(typ="safe", pure=True).load(ROOT / "CITATION.cff")
    assert title == "Unreleased"
    assert (citation["version"], str(citation["date-released"])) == newest
    release, _, is_next = tubeplanner.__version__.partition(".dev")
    assert (release != newest[0]) if is_next else (release == newest[0])
