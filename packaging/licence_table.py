"""Writes docs/development/licences.md: the licences of all dependencies, as installed here.

    python packaging/licence_table.py    # where the package and its extras are installed

It reads the metadata of what pyproject.toml names and of all that its hard dependencies need, and
ends with status 1, naming what has no known licence or is not installed.
"""

import tomllib
from collections import defaultdict
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "development" / "licences.md"
# Where metadata name none, or hold its text alone: by the files of the distribution.
_BY_HAND = {"cmeel-qhull": "Qhull", "piqp": "BSD-2-Clause", "xacro": "BSD-3-Clause"}
_LONGEST = 60  # [characters]: what is longer is a licence's text
_HEAD = """# Licences

What `pip install tubeplanner` installs, and what its extras name. Licences are those of each
distribution's metadata, versions those that `python packaging/licence_table.py` saw on Linux when
it wrote this page. tubeplanner contains none of them: pip installs each beside it.

| distribution | version | licence | needed by |
|---|---|---|---|
"""


def licence(found: Distribution) -> str:
    """Return the licence that a distribution's metadata state, or an empty text."""
    expression, stated = (found.metadata.get(f"License{end}") or "" for end in ("-Expression", ""))
    if "\n" in stated or len(stated) > _LONGEST or stated.upper() in ("UNKNOWN", "VARIOUS"):
        stated = ""
    classified = [
        each.split(" :: ")[-1]
        for each in found.metadata.get_all("Classifier") or []
        if each.startswith("License :: ") and not each.endswith("OSI Approved")
    ]
    by_hand = _BY_HAND.get(canonicalize_name(found.name), "")
    return expression or stated.strip() or ", ".join(classified) or by_hand


def needed(project: dict[str, Any]) -> dict[str, set[str]]:
    """Return who needs a distribution, by its name: distributions, or extras of the package."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    waiting = [("tubeplanner", Requirement(text)) for text in project["dependencies"]]
    while waiting:
        parent, requirement = waiting.pop()
        marker = requirement.marker
        if marker is not None and not marker.evaluate({"extra": ""}):
            continue
        name = canonicalize_name(requirement.name)
        if name not in found and is_installed(name):
            inner = distribution(name).requires or []
            waiting += [(name, Requirement(text)) for text in inner]
        found[name].add(parent)
    for extra, texts in project["optional-dependencies"].items():
        for name in (canonicalize_name(Requirement(text).name) for text in texts):
            if name != "tubeplanner":
                found[name].add(f"extra `{extra}`")
    return found


def is_installed(name: str) -> bool:
    """Return whether a distribution is installed here."""
    try:
        return bool(distribution(name))
    except PackageNotFoundError:
        return False


def main() -> int:
    """Write the page; return the exit status."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines, unknown = [], []
    for name, parents in sorted(needed(project).items()):
        if not is_installed(name):
            unknown.append(f"{name} is not installed")
            continue
        found = distribution(name)
        if not (words := licence(found)):
            unknown.append(f"{name} {found.version} states no licence: look, and add it by hand")
        lines.append(f"| {name} | {found.version} | {words} | {', '.join(sorted(parents))} |\n")
    if not unknown:
        PAGE.write_text(_HEAD + "".join(lines), encoding="utf-8")
    print(*unknown, sep="\n")
    return 1 if unknown else 0


if __name__ == "__main__":
    raise SystemExit(main())
