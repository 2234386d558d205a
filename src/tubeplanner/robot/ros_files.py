"""Files beside a URDF: xacro sources, expanded in a process of their own; SRDF files."""

import json
import resource
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any

from tubeplanner.documents import DocumentError, read_bytes, require_regular
from tubeplanner.errors import RobotError, not_installed, shown, unknown_name
from tubeplanner.resources import PackageDirs, find_package
from tubeplanner.robot.urdf_elements import read_name

# ---- Macro files of robots, `.xacro`.

XACRO_ENDING = ".xacro"
_MAX_BYTES = 50_000_000
_TIME_LIMIT = 10.0  # [s]: robots of hundreds of links take one
_PROGRAM = """import sys
sys.path[:] = {path!r}
from tubeplanner.robot.ros_files import serve
serve()
"""


def expanded(path: Path, arguments: Mapping[str, object], package_dirs: PackageDirs) -> bytes:
    """Return the URDF of a macro file, expanded in a process of its own.

    Args:
        path: The file; includes are relative to the file that names them.
        arguments: Values of its `<xacro:arg>`, by name; truth values are written true and false.
        package_dirs: Further folders that hold the packages of `$(find PACKAGE)`.

    Raises:
        RobotError: xacro is not installed or cannot expand the file, with its reason; it takes too
            long or too much memory; or the file does not use an argument.
    """
    try:
        import xacro  # noqa: F401
    except ImportError:
        raise RobotError(not_installed("xacro", str(path), "xacro")) from None
    try:
        require_regular(path, _MAX_BYTES)
    except DocumentError as error:
        raise RobotError(f"{path} cannot be read: {error}") from None
    folders = [
        [each[0], str(each[1])] if isinstance(each, tuple) else str(each) for each in package_dirs
    ]
    request = {"path": str(path), "arguments": dict(arguments), "package_dirs": folders}
    answer = _answer(path, request)
    if "fault" in answer:
        raise RobotError(answer["fault"])
    xml = answer["xml"].encode()
    if len(xml) > _MAX_BYTES:
        raise RobotError(f"{path}: what it stands for is larger than {_MAX_BYTES / 1e6:g} MB")
    return bytes(xml)


def _answer(path: Path, request: Mapping[str, Any]) -> dict[str, str]:
    remedy = "simplify it, or expand it yourself and name the URDF"
    try:
        process = subprocess.run(
            [sys.executable, "-c", _PROGRAM.format(path=sys.path)],
            input=json.dumps(request).encode(),
            capture_output=True,
            timeout=_TIME_LIMIT,
        )
        answer: dict[str, str] = json.loads(process.stdout)
    except subprocess.TimeoutExpired:
        raise RobotError(
            f"{path}: xacro cannot expand it within {_TIME_LIMIT:g} s; {remedy}"
        ) from None
    except ValueError:
        raise RobotError(f"{path}: xacro ended without an answer; {remedy}") from None
    return answer


# ---- The process in which the package xacro expands a macro file, as `ros2 run xacro` does.
#
# Macro files are programs: in a process of its own, an endless or greedy file can be stopped.

_INDEX = "ament_index_python"
_MAX_MEMORY = 1_000_000_000  # [bytes] of addresses


def serve() -> None:
    """Answer the JSON request on standard input by JSON on standard output.

    The request has path, arguments and package_dirs; the answer has either xml or a fault.
    """
    resource.setrlimit(resource.RLIMIT_AS, (_MAX_MEMORY, _MAX_MEMORY))
    request = json.load(sys.stdin)
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # its warnings are for authors
        try:
            folders = tuple(
                (each[0], Path(each[1])) if isinstance(each, list) else Path(each)
                for each in request["package_dirs"]
            )
            answer = {"xml": _expanded(Path(request["path"]), request["arguments"], folders)}
        except RobotError as error:
            answer = {"fault": str(error)}
    json.dump(answer, sys.stdout)


def _expanded(path: Path, arguments: Mapping[str, object], package_dirs: PackageDirs) -> str:
    """Return the URDF of a macro file, expanded in this process."""
    import xacro

    mappings = _Arguments(
        (name, str(value).lower() if isinstance(value, bool) else str(value))
        for name, value in arguments.items()
    )
    try:
        with _package_index(lambda package: find_package(package, path, package_dirs)):
            document = xacro.process_file(str(path), mappings=mappings)
        # Without xacro's own comments, which hold the path.
        expanded: str = document.documentElement.toxml()
    except Exception as error:  # expressions of the file may raise anything
        files = [file for file in xacro.filestack or () if file]
        included = f" (in {files[-1]})" if files and files[-1] != str(path) else ""
        raise RobotError(f"{path}: xacro cannot expand it: {_reason(error)}{included}") from None
    unused = [name for name in arguments if name not in mappings.requested]
    if unused:
        message = unknown_name("argument", unused[0], sorted(mappings.requested))
        raise RobotError(f"{path}: robot.xacro_args: {message}")
    return expanded


class _Arguments(dict[str, str]):
    """Arguments that record the names that a file requests."""

    def __init__(self, values: Iterable[tuple[str, str]]) -> None:
        super().__init__(values)
        self.requested: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.requested.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.requested.add(name)
        return super().__getitem__(name)


@contextmanager
def _package_index(find: Callable[[str], Path]) -> Iterator[None]:
    """Put a function that finds packages in place of ROS's index, which xacro imports."""
    index, packages = ModuleType(_INDEX), ModuleType(f"{_INDEX}.packages")
    vars(packages)["get_package_share_directory"] = lambda package: str(find(package))
    vars(index)["packages"] = packages
    replacements = {_INDEX: index, f"{_INDEX}.packages": packages}
    originals = {name: sys.modules.get(name) for name in replacements}
    sys.modules.update(replacements)
    try:
        yield
    finally:
        for name, module in originals.items():
            del sys.modules[name]
            if module is not None:
                sys.modules[name] = module


def _reason(error: BaseException) -> str:
    """Return the reason of xacro's error, on a single line."""
    inner = getattr(error, "exc", None)
    if isinstance(inner, RobotError):
        return str(inner)
    if isinstance(error, MemoryError) or isinstance(inner, MemoryError):
        return f"it takes more than {_MAX_MEMORY / 1e9:g} GB"
    if isinstance(error, RecursionError):
        return "it includes or calls itself without end"
    return " ".join(str(error).split()) or type(error).__name__


# ---- SRDF files: pairs of links that may touch, and named configurations.


def read_allowed_pairs(path: Path) -> list[tuple[str, str]]:
    """Return the pairs of links whose collisions an SRDF disables.

    Args:
        path: The file.

    Raises:
        RobotError: The file cannot be read, is no SRDF, or an entry lacks a link.
    """
    return [
        (read_name(str(path), entry, "link1"), read_name(str(path), entry, "link2"))
        for entry in _root(path).findall("disable_collisions")
    ]


def read_group_state(path: Path, name: str, joint_names: Sequence[str]) -> list[float]:
    """Return a named configuration of an SRDF, n values [rad or m].

    Other joints of the state do not count. If several groups have the name, the first group with
    all n joints counts.

    Args:
        path: The file.
        name: The attribute `name` of a `<group_state>`.
        joint_names: The n joints.

    Raises:
        RobotError: As `read_allowed_pairs`; or no state has the name, the state lacks a joint, or a
            value is no number.
    """
    states = _root(path).findall("group_state")
    named = [state for state in states if state.get("name") == name]
    if not named:
        names = sorted({state.get("name", "") for state in states})
        raise RobotError(f"{path}: {unknown_name('group_state', name, names)}")
    values = [_texts(path, state) for state in named]
    missing = [[joint for joint in joint_names if joint not in texts] for texts in values]
    best = min(range(len(named)), key=lambda k: len(missing[k]))
    if missing[best]:
        group = named[best].get("group", "")
        raise RobotError(
            f"{path}: group_state '{name}' of group '{group}' has no value for joint "
            f"{', '.join(missing[best])}; its joints are {', '.join(values[best]) or 'none'}"
        )
    return [_number(path, name, joint, values[best][joint]) for joint in joint_names]


def read_group_states(path: Path) -> dict[str, dict[str, float]]:
    """Return the positions of joints in every <group_state>, by its name; the last of equal names.

    Joints of several values are left out.

    Args:
        path: The file.

    Raises:
        RobotError: As `read_allowed_pairs`, or a value is no number.
    """
    return {
        name: {
            joint: _number(path, name, joint, text)
            for joint, text in _texts(path, state).items()
            if len(text.split()) == 1
        }
        for state in _root(path).findall("group_state")
        for name in [read_name(str(path), state, "name")]
    }


def _root(path: Path) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(read_bytes(path, _MAX_BYTES))
    except DocumentError as error:
        raise RobotError(f"{path} cannot be read: {error}") from error
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        raise RobotError(f"{path} cannot be read as SRDF: {error}") from error
    if root.tag != "robot":
        raise RobotError(f"{path}: the root element is <{root.tag}>, not <robot>")
    return root


def _texts(path: Path, state: ElementTree.Element) -> dict[str, str]:
    """Return the texts of a state's values, by joint."""
    return {
        read_name(str(path), joint, "name"): joint.get("value", "")
        for joint in state.findall("joint")
    }


def _number(path: Path, state: str, joint: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise RobotError(
            f"{path}: group_state '{state}' has {shown(text)} for joint '{joint}'; it must be a "
            "number"
        ) from None
