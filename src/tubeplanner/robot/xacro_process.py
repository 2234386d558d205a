"""The process in which the package xacro expands a macro file, as `ros2 run xacro` does.

Macro files are programs: in a process of its own, one that never ends or takes all memory can be
ended.
"""

import json
import resource
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any

from tubeplanner.errors import RobotError, unknown_name
from tubeplanner.resources import find_package

_INDEX = "ament_index_python"
_MAX_MEMORY = 1_000_000_000  # [bytes] of addresses


def serve() -> None:
    """Answer the one request on standard input, on standard output, both JSON.

    The request has path, arguments and package_dirs; the answer has either xml or a fault.
    """
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY, _MAX_MEMORY))
    asked = json.load(sys.stdin)
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # its warnings are for authors
        try:
            folders = tuple(map(Path, asked["package_dirs"]))
            answer = {"xml": _expanded(Path(asked["path"]), asked["arguments"], folders)}
        except RobotError as error:
            answer = {"fault": str(error)}
    json.dump(answer, sys.stdout)


def _expanded(path: Path, arguments: Mapping[str, object], package_dirs: tuple[Path, ...]) -> str:
    """Return the URDF that a macro file stands for.

    Raises:
        RobotError: xacro cannot expand it, or it does not ask for an argument.
    """
    import xacro

    asked = _Arguments({name: _written(value) for name, value in arguments.items()})
    try:
        with _packages_found_by(lambda package: find_package(package, path, package_dirs)):
            document = xacro.process_file(str(path), mappings=asked)
        # Without xacro's own comments, which hold the path.
        expanded: str = document.documentElement.toxml()
    except Exception as error:  # expressions of the file may raise anything
        reason = _reason(error)
        raise RobotError(f"{path}: xacro cannot expand it: {reason}{_place(xacro, path)}") from None
    unasked = [name for name in arguments if name not in asked.asked]
    if unasked:
        message = unknown_name("argument", unasked[0], sorted(asked.asked))
        raise RobotError(f"{path}: robot.xacro_args: {message}")
    return expanded


class _Arguments(dict[str, str]):
    """Arguments that remember which of them a file asked for."""

    def __init__(self, values: Mapping[str, str]) -> None:
        super().__init__(values)
        self.asked: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.asked.add(name)
        return super().__getitem__(name)


def _written(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


@contextmanager
def _packages_found_by(find: Any) -> Iterator[None]:
    """Answer xacro's questions for the folders of packages, which it asks of ROS's index."""
    index, packages = ModuleType(_INDEX), ModuleType(f"{_INDEX}.packages")
    vars(packages)["get_package_share_directory"] = lambda package: str(find(package))
    vars(index)["packages"] = packages
    ours = {_INDEX: index, f"{_INDEX}.packages": packages}
    before = {name: sys.modules.get(name) for name in ours}
    sys.modules.update(ours)
    try:
        yield
    finally:
        for name, module in before.items():
            del sys.modules[name]
            if module is not None:
                sys.modules[name] = module


def _reason(error: BaseException) -> str:
    """Return why xacro gave up, on one line."""
    inner = getattr(error, "exc", None)
    if isinstance(inner, RobotError):
        return str(inner)
    if isinstance(error, MemoryError) or isinstance(inner, MemoryError):
        return f"it takes more than {_MAX_MEMORY / 1e9:g} GB"
    if isinstance(error, RecursionError):
        return "it includes or calls itself without end"
    return " ".join(str(error).split()) or type(error).__name__


def _place(xacro: Any, path: Path) -> str:
    """Return which included file xacro was in, if it was in one."""
    files = [file for file in xacro.filestack or () if file]
    return f" (in {files[-1]})" if files and files[-1] != str(path) else ""
