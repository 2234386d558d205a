"""Looks up a wheel of every dependency for each platform and Python; prints a table in Markdown.

    python packaging/platform_table.py

The hard dependencies are resolved as pip does it on this machine. Each distribution of the result
is then looked up alone for each platform (`pip install --dry-run --no-deps --only-binary :all:
--platform ...`), so that what has no wheel is named. Nothing is installed, and nothing is run: a
row says that pip finds wheels, not that they work. Versions of indirect dependencies are free.
"""

import datetime
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
OLDEST_GLIBC, NEWEST_GLIBC = 5, 28  # minor versions; manylinux_2_28 is that of our own wheels
PLATFORMS = {
    f"Linux {name} (glibc 2.28)": [
        f"manylinux_2_{minor}_{kind}" for minor in range(OLDEST_GLIBC, NEWEST_GLIBC + 1)
    ]
    + [f"manylinux2014_{kind}", f"manylinux2010_{kind}", f"manylinux1_{kind}", f"linux_{kind}"]
    for name, kind in (("x86-64", "x86_64"), ("aarch64", "aarch64"))
}
PLATFORMS |= {
    "macOS 14 arm64": ["macosx_14_0_arm64"],
    "macOS 14 x86-64": ["macosx_14_0_x86_64"],
    "Windows x86-64": ["win_amd64"],
}
Items = list[dict[str, dict[str, str]]]


def resolved(requirements: list[str], *options: str) -> tuple[Items, str]:
    """Return what pip would install, and its errors."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        words = ["install", "--quiet", "--dry-run", "--ignore-installed", "--report", str(report)]
        command = [sys.executable, "-m", "pip", *words, "--target", folder, *options]
        run = subprocess.run([*command, *requirements], capture_output=True, text=True)
        items = json.loads(report.read_text())["install"] if report.exists() else []
    return items, run.stderr


def without_wheel(requirements: dict[str, str], platforms: list[str], python: str) -> list[str]:
    """Return the names of distributions that have no wheel for a platform and a Python."""
    options = ["--no-deps", "--only-binary", ":all:", "--python-version", python]
    options += [word for name in platforms for word in ("--platform", name)]
    left, missing = dict(requirements), []
    while left:
        items, errors = resolved(list(left.values()), *options)
        if items:
            break
        match = re.search(r"No matching distribution found for ([\w.-]+?)(?=[<>=!~;\s]|$)", errors)
        if match is None:
            raise SystemExit(f"pip failed for Python {python}, {platforms[-1]}:\n{errors[-2000:]}")
        missing.append(match[1])
        del left[match[1].lower().replace("_", "-")]
    return missing


def main() -> None:
    """Look everything up, and print the table."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    items, errors = resolved(project["dependencies"])
    if not items:
        raise SystemExit(errors)
    names = {item["metadata"]["name"].lower().replace("_", "-") for item in items}
    requirements = {name: name for name in sorted(names)}
    for text in project["dependencies"]:
        requirements[re.split(r"[<>=!~\[ ]", text)[0].lower()] = text
    count, date = len(requirements), datetime.date.today().isoformat()
    print(f"Looked up on {date}: {count} distributions.\n")
    print("| platform | " + " | ".join(f"Python {python}" for python in PYTHONS) + " |")
    print("|" + "---|" * (1 + len(PYTHONS)), flush=True)
    for platform, tags in PLATFORMS.items():
        found = (without_wheel(requirements, tags, python) for python in PYTHONS)
        cells = [f"no wheel: {', '.join(names)}" if names else "all" for names in found]
        print(f"| {platform} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
