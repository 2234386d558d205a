"""Do the commands of another checkout print and write the same, byte for byte, but for times?

    python benchmarks/same_surface.py OTHER_CHECKOUT [--only SUBSTRING] [--processes 2]

`surface/commands.txt` has scenarios: commands that run one after the other in a folder that has
the files of `surface`, once with each checkout's package. Exit status, both outputs and every file
that is left must be equal. Times of computing, the folders' paths and the keys of journals, which
change with the package's sources, are blanked. Exit status 1 if a command differs.
"""

import argparse
import csv
import difflib
import io
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from shared import HERE, environment

SURFACE = HERE / "benchmarks/surface"
# In sentences, JSON and CSV.
BLANKED = (
    rb"(?<=in )[\d.]+ m?s\b",
    rb"(?<=for )[\d.]+ m?s\b",
    rb"(?<=certificate )[\d.]+ m?s\b",
    rb"(?<=\"key\": \")\w+",
    rb"(?<=seconds\": )[\d.e+-]+",
    rb"(?<=time\": )[\d.e+-]+",
    rb"(?m)(?<=\xe2\x94\x82)[ \d.]+ s(?= *\xe2\x94\x82)",
)
RUN = "import sys; sys.argv[0] = 'tubeplanner'; from {} import {} as run; sys.exit(run())"
SHOWN = 6  # lines of a difference


class Run(NamedTuple):
    """What a command left: its exit status, and its outputs and new files, blanked."""

    status: int
    content: dict[str, bytes]


def scenarios() -> dict[str, list[str]]:
    """Return the commands of every scenario."""
    found: dict[str, list[str]] = {}
    for line in (SURFACE / "commands.txt").read_text().splitlines():
        if line.startswith("["):
            name = line.strip("[]")
            found[name] = []
        elif line and not line.startswith("#"):
            found[name].append(line.replace("{}", name))
    return found


def runs(commands: list[str], checkout: Path) -> list[Run]:
    """Return what each command of a scenario leaves with a checkout's package."""
    scripts = tomllib.loads((checkout / "pyproject.toml").read_text())["project"]["scripts"]
    program = [sys.executable, "-c", RUN.format(*scripts["tubeplanner"].split(":"))]
    covers = {"COLUMNS": "120", "TUBEPLANNER_CACHE": str(checkout / "output/surface-covers")}
    covers["SOURCE_DATE_EPOCH"] = "0"  # pages have their date
    results: list[Run] = []
    with tempfile.TemporaryDirectory() as path:
        folder = Path(path).resolve() / "surface"  # problems are named after it
        shutil.copytree(SURFACE, folder)
        before = _files(folder)
        for command in commands:
            done = subprocess.run(
                [*program, *shlex.split(command)],
                cwd=folder,
                env=environment(checkout) | covers,
                capture_output=True,
            )
            after = _files(folder)
            content = {file: each for file, each in after.items() if before.get(file) != each}
            content |= {"standard output": done.stdout, "standard error": done.stderr}
            for key, each in content.items():
                content[key] = _blanked(each, folder.parent, checkout)
            results.append(Run(done.returncode, content))
            before = after
    return results


def _files(folder: Path) -> dict[str, bytes]:
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def _blanked(content: bytes, *folders: Path) -> bytes:
    for folder in folders:
        content = content.replace(bytes(folder), b"FOLDER")
    for pattern in BLANKED:
        content = re.sub(pattern, b"BLANK", content)
    head = content.partition(b"\n")[0].split(b",")
    if b"planning_time" in head:  # a table
        rows = list(csv.reader(io.StringIO(content.decode())))
        kept = [k for k, name in enumerate(rows[0]) if not re.fullmatch(r"\w+_time|key", name)]
        lines = ([row[k] for k in kept] for row in rows)
        content = "\n".join(map(repr, lines)).encode()
    return content


def differences(here: Run, there: Run) -> list[str]:
    """Return in what two runs of a command differ, in lines to be printed."""
    lines = []
    if here.status != there.status:
        lines.append(f"exit status {here.status}, there {there.status}")
    for key in sorted(here.content.keys() | there.content.keys()):
        one, other = here.content.get(key), there.content.get(key)
        if one is None or other is None:
            lines.append(f"{key}: only {'there' if one is None else 'here'}")
        elif one != other:
            lines.append(f"{key}: {len(one)} bytes, there {len(other)}")
            texts = [each.decode(errors="replace").splitlines() for each in (other, one)]
            changes = list(difflib.unified_diff(*texts, n=0, lineterm=""))[2:]
            lines += [f"  {line[:150]!r}" for line in changes if line[0] != "@"][:SHOWN]
    return lines


def main() -> int:
    """Run all scenarios with both checkouts and compare; return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("other", type=Path, help="the other checkout")
    parser.add_argument("--only", default="", help="scenarios whose name contains this")
    parser.add_argument("--processes", type=int, default=2, help="how many at a time")
    options = parser.parse_args()
    chosen = {name: each for name, each in scenarios().items() if options.only in name}
    checkouts = (HERE, options.other.resolve())
    count = different = 0
    with ThreadPoolExecutor(options.processes) as pool:
        work = {
            name: [pool.submit(runs, commands, checkout) for checkout in checkouts]
            for name, commands in chosen.items()
        }
        for name, sides in work.items():
            for command, *pair in zip(
                chosen[name], *(each.result() for each in sides), strict=True
            ):
                lines = differences(*pair)
                count, different = count + 1, different + bool(lines)
                if lines:
                    print(f"{name}: tubeplanner {command}", *lines, sep="\n  ", flush=True)
    print(f"{count} commands, {different} differ")
    return int(different > 0)


if __name__ == "__main__":
    raise SystemExit(main())
