"""Runs the first commands of the README with the tubeplanner that this Python has installed.

    python packaging/try_wheel.py [--only native|pure] [--json]

The commands run in an empty folder, word for word, and then a bundled problem is planned and its
trajectory checked. Prints the build and the planned durations; ends with an error where a command
fails or the build is not the expected one. Needs nothing but Python: cibuildwheel runs it too.
"""

import argparse
import json
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"
BUNDLED = (
    "tubeplanner plan example:ur5/over_the_wall -o trajectory.json",
    "tubeplanner check example:ur5/over_the_wall trajectory.json",
    "tubeplanner view --help",
)


def readme_commands() -> list[str]:
    """Return the tubeplanner commands of the README's console blocks."""
    blocks = re.findall(r"```console\n(.*?)```", README.read_text(encoding="utf-8"), re.S)
    return [line[2:] for block in blocks for line in block.splitlines() if "$ tubeplanner" in line]


def answer(command: str, folder: str) -> str:
    """Return what a command prints; SystemExit if it fails."""
    program = shutil.which("tubeplanner", path=sysconfig.get_path("scripts"))
    if program is None:
        raise SystemExit(f"{sys.executable} has no command tubeplanner; install the wheel first")
    words = [program, *shlex.split(command)[1:]]
    run = subprocess.run(words, cwd=folder, capture_output=True, text=True, encoding="utf-8")
    if run.returncode:
        raise SystemExit(f"$ {command}\n{run.stdout}{run.stderr}exit status {run.returncode}")
    return run.stdout + run.stderr


def tried() -> dict[str, object]:
    """Return build, version, planned durations [s] and the time of all commands [s]."""
    durations, begun = [], time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        version = answer("tubeplanner --version", folder).strip()
        for command in (*readme_commands(), *BUNDLED):
            text = answer(command, folder)
            durations += map(
                float, re.findall(r"success: certified trajectory of ([\d.]+) s", text)
            )
    return {
        "version": version,
        "build": "native" if "native (" in version else "pure",
        "durations": durations,
        "seconds": round(time.perf_counter() - begun, 1),
    }


def main() -> None:
    """Try, and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", choices=("native", "pure"), help="the build that must run")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    result = tried()
    print(json.dumps(result) if arguments.json else result)
    if arguments.only not in (None, result["build"]):
        raise SystemExit(f"the build is {result['build']}, not {arguments.only}")


if __name__ == "__main__":
    main()
