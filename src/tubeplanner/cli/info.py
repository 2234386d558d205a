"""`info`: this installation; or what `contents` says of a robot, problem or cycle.

The installation is described without an import of its dependencies but NumPy.
"""

import os
import platform
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from tubeplanner import __version__
from tubeplanner.cli import console
from tubeplanner.errors import REQUIREMENTS, OptionError
from tubeplanner.resources import CACHE_VARIABLE, cache_folder

_PACKAGE = Path(__file__).resolve().parents[1]
_PROJECT = _PACKAGE.parents[1] / "pyproject.toml"  # of a checkout
_VARIABLES = ("TUBEPLANNER_PURE", "TUBEPLANNER_BASELINE", CACHE_VARIABLE)


@click.command()
@click.argument("robot", metavar="[ROBOT|PROBLEM]", required=False)
@console.TOOL_FRAME
@console.PACKAGE_DIR
@console.XACRO_ARG
@click.option("--plot", type=console.PATH, help="Draw arm, cell and frames (PNG, PDF or SVG).")
@console.SET
@console.AS_JSON
@click.pass_context
def info(context: click.Context, robot: str | None, as_json: bool, **options: Any) -> None:
    """Describe ROBOT (a URDF or example:NAME) or PROBLEM, and list missing values.

    Robot: joints, limits and the source of each, motors, links, masses, geometry, open meshes,
    frames. Problem: also start, tube, obstacles, payload. Cycle: also moves, stops, carried parts.
    Missing limits are no error here.

    Without an argument: describe this installation, for a report of a fault.
    """
    if robot is not None:
        from tubeplanner.cli.contents import describe

        describe(robot, as_json=as_json, **options)
        return
    for option in context.command.params:
        is_used = context.get_parameter_source(str(option.name)) is ParameterSource.COMMANDLINE
        if is_used and option.name != "as_json":
            raise OptionError(f"{option.opts[0]} is for a robot or a problem; name one")
    fields = installation()
    if as_json:
        report = console.empty_report("success", f"tubeplanner {__version__}")
        console.print_json({**report, **fields})
    else:
        console.say(installation_text(fields))


def installation() -> dict[str, Any]:
    """Return versions, platform and settings that decide how this package runs, as JSON values.

    The home folder in paths is written ~.
    """
    from tubeplanner.native.library import LIBRARY
    from tubeplanner.studies.worker_processes import THREADS, processors

    cache, variables = cache_folder(), (*_VARIABLES, *THREADS)
    values = {name: os.environ.get(name) for name in variables}
    return {
        "version": __version__,
        "build": LIBRARY.build,
        "python": platform.python_version(),
        "implementation": platform.python_implementation(),
        "platform": platform.platform(),
        "processors": processors(),
        "environment": {name: value and _shortened(value) for name, value in values.items()},
        "package": _shortened(str(_PACKAGE)),
        "cache": None if cache is None else _shortened(str(cache)),
        "required": _versions(_required()),
        "optional": _versions(REQUIREMENTS.values()),
    }


def _shortened(path: str) -> str:
    home = os.path.expanduser("~")
    return "~" + path.removeprefix(home) if path.startswith(home + os.sep) else path


def _required() -> list[str]:
    """Return the requirements of this package: of a checkout, else of the installation."""
    from importlib.metadata import requires

    if _PROJECT.is_file():
        with _PROJECT.open("rb") as file:
            return list(tomllib.load(file)["project"]["dependencies"])
    return [line for line in requires("tubeplanner") or [] if "extra ==" not in line]


def _versions(requirements: Iterable[str]) -> dict[str, str | None]:
    """Return the installed version of each requirement; None: no distribution of that name."""
    from importlib.metadata import PackageNotFoundError, version

    versions: dict[str, str | None] = {}
    # Metadata of installed packages have normalised names: ruamel-yaml.
    names = {re.sub(r"[._]", "-", re.split(r"[^\w.-]", line)[0]).lower() for line in requirements}
    for name in sorted(names):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            versions[name] = None
    return versions


def installation_text(fields: dict[str, Any]) -> str:
    """Return the description of the installation as text."""
    settings = [f"{name}={value}" for name, value in fields["environment"].items() if value]
    lines = [
        f"tubeplanner {fields['version']}, {fields['build']}",
        f"{fields['implementation']} {fields['python']} on {fields['platform']}, "
        f"{fields['processors']} processors",
        f"environment: {', '.join(settings) or 'nothing set'}",
        f"package: {fields['package']}",
        f"cache: {fields['cache'] or 'none'}",
    ]
    for kind in ("required", "optional"):
        versions = [f"{name} {value or 'not found'}" for name, value in fields[kind].items()]
        lines.append(f"{kind}: {', '.join(versions)}")
    return "\n".join(lines)
