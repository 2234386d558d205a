"""Where the outside judge finds robots and meshes."""

import importlib.metadata
import os
from functools import cache
from pathlib import Path

EXAMPLE, PACKAGE = "example:", "package://"
OTHER_STEMS = {"iris": "iris_simple"}  # where a name means another file than that of its name
BUNDLED = Path(__file__).parents[2] / "robots"


class BadInput(Exception):
    """A file cannot be judged: it is wrong, or asks for something that this judge does not know."""


def find_urdf(name: str, folder: Path, package_dirs: list[Path]) -> Path:
    """Return the path of a robot's URDF.

    Args:
        name: A path, `package://PACKAGE/...`, or `example:NAME`.
        folder: Where relative paths start.
        package_dirs: Further folders that hold packages.

    Raises:
        BadInput: There is no such file.
    """
    if name.startswith(EXAMPLE):
        return _find_example(name.removeprefix(EXAMPLE))
    return find_file(name, folder, package_dirs)


def find_file(name: str, folder: Path, package_dirs: list[Path]) -> Path:
    """Return the path of a file named by a path or by `package://PACKAGE/...`.

    Raises:
        BadInput: There is no such file.
    """
    if not name.startswith(PACKAGE):
        path = folder / name.removeprefix("file://")
        if path.is_file():
            return path.resolve()
        raise BadInput(f"{path} does not exist")
    package, _, tail = name.removeprefix(PACKAGE).partition("/")
    roots = [*package_dirs, folder, *folder.parents, *_environment_roots()]
    for root in roots:
        is_package = root.name == package
        for path in (root / package / tail, *([root / tail] if is_package else [])):
            if path.is_file():
                return path.resolve()
    raise BadInput(f"{name} was not found in any of {', '.join(map(str, roots))}")


@cache  # a distribution's list of files takes a tenth of a second to read
def data_share() -> Path:
    """Return the folder that holds the package example-robot-data.

    Raises:
        BadInput: It is not installed.
    """
    try:
        distribution = importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        raise BadInput("example-robot-data is not installed") from None
    for file in distribution.files or []:
        if str(file).endswith("example-robot-data/package.xml"):
            return Path(str(distribution.locate_file(file))).resolve().parents[1]
    raise BadInput("the installed example-robot-data holds no package.xml")


def data_urdfs() -> list[Path]:
    """Return all URDFs of example-robot-data, in the order of their names."""
    return sorted((data_share() / "example-robot-data" / "robots").rglob("*.urdf"))


def _find_example(name: str) -> Path:
    """Return a bundled robot, or the one URDF of example-robot-data that a name can mean.

    It is the file of that name, or of that name and `_robot`, or the only one in the folder
    `NAME_description`. Nothing is guessed beyond that: another robot's verdict would be worthless.
    """
    bundled = sorted(BUNDLED.glob(f"*/{name}.urdf"))
    found, stem = data_urdfs(), OTHER_STEMS.get(name, name)
    places = (
        bundled,
        [path for path in found if path.stem == f"{stem}_robot"],
        [path for path in found if path.stem == stem],
        [path for path in found if f"{name}_description" in path.parts],
    )
    for paths in places:
        if len(paths) == 1:
            return paths[0].resolve()
    raise BadInput(f"example:{name} is not clear; write package://example-robot-data/robots/...")


def _environment_roots() -> list[Path]:
    def entries(variable: str) -> list[str]:
        return [entry for entry in os.environ.get(variable, "").split(os.pathsep) if entry]

    roots = [Path(entry) for entry in entries("ROS_PACKAGE_PATH")]
    roots += [Path(entry) / "share" for entry in entries("AMENT_PREFIX_PATH")]
    try:
        return [data_share(), *roots]
    except BadInput:
        return roots
