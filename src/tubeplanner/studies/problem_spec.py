"""ProblemSpec: a document ready to travel; content hashes of problem, files, options, package.

A file's name, its folder and its date do not count. An unreadable file counts by its error: the
plan reports it.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import tubeplanner
from tubeplanner.checks import checked_path
from tubeplanner.errors import TubePlannerError
from tubeplanner.fields import check_fields
from tubeplanner.planning.options import PlanOptions
from tubeplanner.resources import (
    PackageDirs,
    bundled_presets,
    find_description,
    find_limits_file,
    find_mesh,
    find_preset,
    find_problem,
)
from tubeplanner.robot.loader import package_folders
from tubeplanner.robot.ros_files import XACRO_ENDING, read_srdf
from tubeplanner.robot.urdf import read_urdf
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.cycle_file import CycleFields, parse_cycle
from tubeplanner.task.field_changes import changed_problem
from tubeplanner.task.includes import ProblemLayers, paths_in
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import ProblemFields, is_cycle
from tubeplanner.task.problem_reader import build_problem

# ---- Hashes of all inputs of an answer: problem, files by contents, options, package.

_DIGITS = 32
_MAX_FILES = 10_000  # with cached hashes


def content_hash(document: Any, folder: Path, options: PlanOptions) -> str:
    """Return a hash of all inputs of the plan of a problem or cycle.

    Args:
        document: Contents of its file, includes merged.
        folder: Folder of its relative paths.
        options: Planning options.
    """
    return _hash_of(document_hash(document, folder), asdict(options), package_hash())


def document_hash(document: Any, folder: Path) -> str:
    """Return a hash of a problem file or a part of a file, files by their contents.

    Args:
        document: The contents, as dictionaries and lists.
        folder: Folder of its relative paths.
    """
    hashed = deepcopy(document)
    robot = hashed.get("robot") if isinstance(hashed, dict) else None
    robot = robot if isinstance(robot, dict) else {}
    dirs = robot.pop("package_dirs", [])
    folders: PackageDirs = ()
    if isinstance(dirs, dict):
        folders = package_folders({name: str(dirs[name]) for name in dirs}, folder)
    elif isinstance(dirs, list):
        folders = package_folders([str(each) for each in dirs], folder)
    files = _Files(folder, folders, robot.get("xacro_args") or {})
    for holder, key, kind in list(paths_in(hashed)):
        if isinstance(holder[key], str):
            holder[key] = files.content(kind, holder[key])
    return _hash_of(hashed)


@cache
def package_hash() -> str:
    """Return a hash of this package's sources and its presets of limits and motors."""
    folder = Path(str(tubeplanner.__file__)).parent
    sources = {str(each.relative_to(folder)): each for each in folder.rglob("*.py")}
    files = {**sources, **bundled_presets()}
    return _hash_of({name: _file_hash(path) for name, path in files.items()})


class _Files:
    """The contents of the files that a problem names."""

    def __init__(
        self, folder: Path, package_dirs: PackageDirs, xacro_args: Mapping[str, object]
    ) -> None:
        self._folder, self._package_dirs = folder, package_dirs
        self._xacro_args = json.dumps(xacro_args, default=str, sort_keys=True)

    def content(self, kind: str, name: str) -> str:
        """Return a hash of a file of a kind, named by a field, or the reason for its absence."""
        search: dict[str, Callable[[], Path]] = {
            "srdf": lambda: find_description(name, self._folder, self._package_dirs),
            "limits_file": lambda: find_limits_file(name, self._folder, self._package_dirs),
            "preset": lambda: find_preset(name, self._folder),
            "mesh": lambda: find_mesh(name, self._folder / "the problem file", self._package_dirs),
        }
        try:
            if kind == "urdf":
                path = find_description(name, self._folder, self._package_dirs)
                parts = _robot_parts(path, self._package_dirs, self._xacro_args, _stamp(path))
                return _hash_of(parts[0], [self._link_mesh(mesh, path) for mesh in parts[1]])
            if kind == "srdf" and name.endswith(XACRO_ENDING):
                path = search[kind]()
                root = read_srdf(path, json.loads(self._xacro_args), self._package_dirs).root
                return _hash_of(ElementTree.tostring(root, encoding="unicode"))
            return _file_hash(search.get(kind, lambda: self._folder / name)())
        except (TubePlannerError, OSError) as error:
            return f"{kind} cannot be read: {error}"

    def _link_mesh(self, name: str, urdf: Path) -> str:
        try:
            return _file_hash(find_mesh(name, urdf, self._package_dirs))
        except (TubePlannerError, OSError) as error:
            return f"mesh cannot be read: {error}"


@lru_cache(_MAX_FILES)
def _robot_parts(
    path: Path, package_dirs: PackageDirs, xacro_args: str, stamp: tuple[int, int]
) -> tuple[str, tuple[str, ...]]:
    """Return the text of a URDF, and the names of its collision meshes.

    A changed file is read again; files that only a macro includes, by the next process.
    """
    arguments = json.loads(xacro_args) if path.suffix == XACRO_ENDING else {}
    xml = read_urdf(path, arguments, package_dirs).xml
    meshes = ElementTree.fromstring(xml).iterfind(".//collision//mesh")
    return xml.decode("utf-8", "replace"), tuple(mesh.get("filename", "") for mesh in meshes)


def _file_hash(path: Path) -> str:
    return _content_of(path, _stamp(path))


@lru_cache(_MAX_FILES)
def _content_of(path: Path, stamp: tuple[int, int]) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _stamp(path: Path) -> tuple[int, int]:
    """Return time of the last change [ns] and size of a file, which show a change."""
    status = path.stat()
    return status.st_mtime_ns, status.st_size


def _hash_of(*parts: Any) -> str:
    text = json.dumps(parts, default=str, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


# The fields of robot and solids; problems that agree in them share both.
_CELL = ("robot", "obstacles", "collision")
_MAX_CELLS = 16
_cells: dict[str, PlanningProblem] = {}  # by the hash of their cells, the latest last


@dataclass(frozen=True)
class ProblemSpec:
    """The contents of a problem file or a cycle file, includes merged.

    Attributes:
        document: The contents, as dictionaries and lists.
        folder: Folder of its relative paths.
        name: Name in messages.
    """

    document: Any
    folder: Path
    name: str

    def __repr__(self) -> str:
        kind = "cycle" if is_cycle(self.document) else "problem"
        return f"<ProblemSpec {self.name}: a {kind} in {self.folder}>"

    @classmethod
    def read(cls, problem: str | Path, directory: str | Path = ".") -> "ProblemSpec":
        """Read a problem file or a cycle file, and its includes.

        Args:
            problem: A path, or `example:ROBOT/NAME` for a bundled one.
            directory: Folder of a relative path.

        Raises:
            ProblemError: A file cannot be read, or files include each other in a circle.
        """
        path = find_problem(problem, checked_path("directory", directory)).resolve()
        return cls(ProblemLayers.read(path).merged, path.parent, f"{path.parent.name}/{path.stem}")

    def changed(self, changes: Mapping[str, Any] | None) -> "ProblemSpec":
        """Return the document with other values by field path; None: the same values.

        Raises:
            ProblemError: A path leads nowhere.
        """
        model = CycleFields if is_cycle(self.document) else ProblemFields
        document = changed_problem(self.document, changes, model)
        return ProblemSpec(document, self.folder, self.name)

    def content_hash(self, options: PlanOptions) -> str:
        """Return a hash of all inputs of its plan with some options."""
        return content_hash(self.document, self.folder, options)

    def load(self) -> PlanningProblem | Cycle:
        """Return the problem or cycle; robot and solids that this process has are not built again.

        Raises:
            ProblemError: It contradicts its format, itself or its robot.
            RobotError: The robot cannot be planned with.
        """
        if is_cycle(self.document):
            return parse_cycle(self.document, self.folder, self.name)
        fields = check_fields(ProblemFields, self.document, self.name)
        cell = {key: self.document[key] for key in _CELL if key in self.document}
        key = document_hash(cell, self.folder)
        like = _cells.get(key)
        problem = build_problem(fields, self.folder, self.name, self.name, like=like)
        # Last in the cache, which drops its first: the cell not used for longest.
        _cells.pop(key, None)
        _cells[key] = problem
        for oldest in list(_cells)[:-_MAX_CELLS]:
            _cells.pop(oldest, None)
        return problem
