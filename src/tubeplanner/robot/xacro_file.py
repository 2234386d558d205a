"""Macro files of robots, `.xacro`, expanded in a process of their own."""

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tubeplanner.documents import DocumentError, require_regular
from tubeplanner.errors import RobotError
from tubeplanner.extras import not_installed

XACRO_ENDING = ".xacro"
_MAX_BYTES = 50_000_000
_TIME_LIMIT = 10.0  # [s]: robots of hundreds of links take one
_PROGRAM = """import sys
sys.path[:] = {path!r}
from tubeplanner.robot.xacro_process import serve
serve()
"""


def expanded(path: Path, arguments: Mapping[str, object], package_dirs: tuple[Path, ...]) -> bytes:
    """Return the URDF that a macro file stands for.

    Args:
        path: The file; includes are relative to the file that names them.
        arguments: Values of its `<xacro:arg>`, by name; truth values are written true and false.
        package_dirs: Further folders that hold the packages of `$(find PACKAGE)`.

    Raises:
        RobotError: xacro is not installed or cannot expand the file, with its reason; it takes too
            long or too much memory; or the file does not ask for an argument.
    """
    try:
        import xacro  # noqa: F401
    except ImportError:
        raise RobotError(not_installed("xacro", str(path), "xacro")) from None
    try:
        require_regular(path, _MAX_BYTES)
    except DocumentError as error:
        raise RobotError(f"{path} cannot be read: {error}") from None
    folders = [str(folder) for folder in package_dirs]
    asked = {"path": str(path), "arguments": dict(arguments), "package_dirs": folders}
    answer = _answer(path, asked)
    if "fault" in answer:
        raise RobotError(answer["fault"])
    xml = answer["xml"].encode()
    if len(xml) > _MAX_BYTES:
        raise RobotError(f"{path}: what it stands for is larger than {_MAX_BYTES / 1e6:g} MB")
    return bytes(xml)


def _answer(path: Path, asked: Mapping[str, Any]) -> dict[str, str]:
    """Return what the process answers."""
    remedy = "simplify it, or expand it yourself and name the URDF"
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROGRAM.format(path=sys.path)],
            input=json.dumps(asked).encode(),
            capture_output=True,
            timeout=_TIME_LIMIT,
        )
        answer: dict[str, str] = json.loads(done.stdout)
    except subprocess.TimeoutExpired:
        raise RobotError(
            f"{path}: xacro cannot expand it within {_TIME_LIMIT:g} s; {remedy}"
        ) from None
    except ValueError:
        raise RobotError(f"{path}: xacro ended without an answer; {remedy}") from None
    return answer
