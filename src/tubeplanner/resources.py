"""Where robots, problems and meshes are found on this machine.

`example:` names come first from the robots bundled with this package, then from the installed
distribution example-robot-data.
"""

import importlib.metadata
import os
from functools import cache
from pathlib import Path

from tubeplanner.errors import ProblemError, RobotError, unknown_name

EXAMPLE_PREFIX = "example:"
_PACKAGE_PREFIX = "package://"

# The robots of example-robot-data, below its folder `robots`. The distribution has data only, so
# the table is kept here.
_EXAMPLE_ROBOT_DATA = {
    "asr_twodof": "asr_twodof_description/urdf/TwoDofs.urdf",
    "baxter": "baxter_description/urdf/baxter.urdf",
    "double_pendulum": "double_pendulum_description/urdf/double_pendulum.urdf",
    "double_pendulum_continuous": (
        "double_pendulum_description/urdf/double_pendulum_continuous.urdf"
    ),
    "double_pendulum_simple": "double_pendulum_description/urdf/double_pendulum_simple.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "panda": "panda_description/urdf/panda.urdf",
    "panda_collision": "panda_description/urdf/panda_collision.urdf",
    "so100": "so_arm_description/urdf/so100.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
    "talos_arm": "talos_data/robots/talos_left_arm.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "ur10_limited": "ur_description/urdf/ur10_joint_limited_robot.urdf",
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur3_limited": "ur_description/urdf/ur3_joint_limited_robot.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur5_limited": "ur_description/urdf/ur5_joint_limited_robot.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
}


def bundled_folder() -> Path:
    """Return the folder `robots`: inside the installed package, or at the root of a checkout."""
    installed = Path(__file__).parent / "robots"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "robots"


def bundled_robots() -> dict[str, Path]:
    """Return the URDF of every robot that has one in the bundled folder, by name."""
    return {path.stem: path for path in sorted(bundled_folder().glob("*/*.urdf"))}


def bundled_problems() -> dict[str, Path]:
    """Return every bundled problem file by its name `ROBOT/NAME`."""
    paths = sorted(bundled_folder().glob("*/*.yaml"))
    return {f"{path.parent.name}/{path.stem}": path for path in paths}


def example_robot_names() -> list[str]:
    """Return every name that `example:NAME` accepts for a URDF."""
    return sorted({*bundled_robots(), *_EXAMPLE_ROBOT_DATA})


def find_problem(name: str | Path, directory: Path) -> Path:
    """Return the path of a problem file.

    Args:
        name: A path, relative to `directory` or absolute, or `example:ROBOT/NAME`.
        directory: Where relative paths start.

    Raises:
        ProblemError: The file or the bundled problem does not exist.
    """
    text = str(name)
    if text.startswith(EXAMPLE_PREFIX):
        problems = bundled_problems()
        key = text.removeprefix(EXAMPLE_PREFIX)
        if key not in problems:
            raise ProblemError(unknown_name("bundled problem", key, problems))
        return problems[key]
    path = directory / text
    if not _exists(path):
        raise ProblemError(f"problem file {path} does not exist")
    if path.is_dir():
        raise ProblemError(f"{path} is a folder; name a problem file")
    return path


def find_urdf(name: str | Path, directory: Path, package_dirs: tuple[Path, ...] = ()) -> Path:
    """Return the path of a robot's URDF.

    Args:
        name: A path, relative to `directory` or absolute, `package://PACKAGE/...`, or
            `example:NAME`.
        directory: Where relative paths start.
        package_dirs: Further folders that hold packages.

    Raises:
        RobotError: There is no such file or no such name.
    """
    text = str(name)
    if text.startswith(EXAMPLE_PREFIX):
        return _find_example_urdf(text.removeprefix(EXAMPLE_PREFIX))
    if text.startswith(_PACKAGE_PREFIX):
        return _find_in_packages(text, (*package_dirs, *_environment_roots()))
    path = directory / text
    if not _exists(path) or path.is_dir():
        raise RobotError(f"robot description {path} does not exist")
    return path.resolve()


def find_mesh(filename: str, urdf: Path, package_dirs: tuple[Path, ...] = ()) -> Path:
    """Return the path of a mesh named in a URDF, the same for every reader of the URDF.

    Args:
        filename: The attribute `filename` of the URDF: `package://`, `file://`, absolute, or
            relative to the URDF.
        urdf: The URDF that names the mesh.
        package_dirs: Further folders that hold packages.

    Raises:
        RobotError: The mesh does not exist; every folder that was tried is listed.
    """
    if filename.startswith(_PACKAGE_PREFIX):
        roots = (*package_dirs, *urdf.parents, *_environment_roots())
        return _find_in_packages(filename, roots)
    path = urdf.parent / filename.removeprefix("file://")
    if not path.is_file():
        raise RobotError(f"mesh {path}, named in {urdf}, does not exist")
    return path


def _exists(path: Path) -> bool:
    """Return whether a path exists; one that the system refuses as too long does not."""
    try:
        return path.exists()
    except OSError:
        return False


@cache
def _example_robot_data_share() -> Path:
    """Return the folder that holds the package example-robot-data."""
    try:
        distribution = importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        raise RobotError(
            "example-robot-data is not installed: pip install example-robot-data"
        ) from None
    for file in distribution.files or []:
        if str(file).endswith("example-robot-data/package.xml"):
            return Path(str(distribution.locate_file(file))).resolve().parent.parent
    raise RobotError("the installed example-robot-data holds no package.xml: reinstall it")


def _find_example_urdf(name: str) -> Path:
    bundled = bundled_robots()
    if name in bundled:
        return bundled[name]
    if name not in _EXAMPLE_ROBOT_DATA:
        raise RobotError(unknown_name("example robot", name, example_robot_names()))
    robots = _example_robot_data_share() / "example-robot-data" / "robots"
    path = robots / _EXAMPLE_ROBOT_DATA[name]
    if not path.is_file():
        raise RobotError(f"the installed example-robot-data has no robot '{name}' ({path})")
    return path


def _environment_roots() -> list[Path]:
    """Return the folders that hold packages: example-robot-data's, then those of a ROS setup."""
    roots = [Path(entry) for entry in _environment_paths("ROS_PACKAGE_PATH")]
    roots += [Path(entry) / "share" for entry in _environment_paths("AMENT_PREFIX_PATH")]
    try:
        return [_example_robot_data_share(), *roots]
    except RobotError:
        return roots


def _environment_paths(variable: str) -> list[str]:
    return [entry for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _find_in_packages(uri: str, roots: tuple[Path, ...]) -> Path:
    """Return the file of a `package://` URI: a root holds the package, or is the package."""
    package, _, tail = uri.removeprefix(_PACKAGE_PREFIX).partition("/")
    for root in roots:
        candidates = [root / package / tail]
        if root.name == package:
            candidates.append(root / tail)
        for candidate in candidates:
            if candidate.is_file():
                return candidate
    tried = ", ".join(str(root) for root in dict.fromkeys(roots))
    raise RobotError(
        f"{uri} was not found; folders tried: {tried}. "
        f"Add the folder that holds '{package}' to package_dirs"
    )
