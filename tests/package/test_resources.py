"""Where robots, problems and meshes are found."""

import importlib.metadata
import json
from pathlib import Path

import pytest

from tubeplanner import resources
from tubeplanner.errors import ProblemError, RobotError
from tubeplanner.robot.loader import package_folders

BUNDLED = resources.bundled_folder()


@pytest.fixture
def no_ros(monkeypatch):
    """A shell without a ROS setup."""
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


def write(path: Path, text: str = "<robot/>") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", resources.example_robot_names())
def test_every_example_name_leads_to_a_urdf_on_this_machine(name):
    path = resources.find_description(f"example:{name}", Path("nowhere"))
    assert path.is_file()
    assert "<robot" in path.read_text(encoding="utf-8")


def test_bundled_robots_and_problems_are_listed_by_name():
    assert resources.bundled_robots()["two_link"] == BUNDLED / "two_link" / "two_link.urdf"
    assert {"ur5/over_the_wall", "two_link/around_a_post"} <= set(resources.bundled_problems())


def test_bundled_cycles_and_studies_are_no_problems_and_found_by_name(tmp_path, monkeypatch):
    assert "ur5/through_the_door" in resources.bundled_cycles()
    arm = tmp_path / "arm"
    cycle = write(arm / "cycle.yaml", "# moves\nformat: tubeplanner/cycle\nversion: 1\n")
    problem = write(arm / "problem.yaml", "# not format: tubeplanner/cycle\n")
    study = write(arm / "study.yaml", "format: tubeplanner/study\n")
    write(tmp_path / "presets" / "limits.yaml", "format: tubeplanner/preset\n")
    monkeypatch.setattr(resources, "bundled_folder", lambda: tmp_path)
    assert resources.bundled_cycles() == {"arm/cycle": cycle}
    assert resources.bundled_studies() == {"arm/study": study}
    assert resources.bundled_problems() == {"arm/problem": problem}
    for path in (cycle, problem, study):
        assert resources.find_problem(f"example:arm/{path.stem}", Path()) == path


def test_a_bundled_preset_is_found_by_name_and_hides_a_file_of_that_name(tmp_path):
    arms, controllers = ["fer", "fr3", "fr3_friction"], ["franka", "ros2", "ur"]
    bundled = {*arms, "ur10_friction", *(f"{name}_controller" for name in controllers)}
    assert set(resources.bundled_presets()) == bundled
    write(tmp_path / "fer")
    assert resources.find_preset("fer", tmp_path) == BUNDLED / "presets" / "fer.yaml"
    path = write(tmp_path / "fer.yaml")
    assert resources.find_preset("fer.yaml", tmp_path) == path
    assert resources.find_preset(path, Path("elsewhere")) == path


def test_a_bundled_robot_hides_the_one_of_example_robot_data(tmp_path, monkeypatch):
    mine = write(tmp_path / "anything" / "ur5.urdf")
    monkeypatch.setattr(resources, "bundled_folder", lambda: tmp_path)
    assert resources.find_description("example:ur5", Path()) == mine
    assert resources.find_description("example:panda", Path()).name == "panda.urdf"


def test_an_unknown_example_robot_gets_a_suggestion_and_the_list():
    message = r"^unknown example robot 'ur55' \(did you mean 'ur5'\?\); there is: "
    with pytest.raises(RobotError, match=message + ".*panda.*two_link.*xarm7"):
        resources.find_description("example:ur55", Path())


def test_a_relative_urdf_starts_at_the_given_folder_and_is_named_if_it_is_missing(tmp_path):
    path = tmp_path / "arm.urdf"
    with pytest.raises(RobotError, match=f"^robot description {path} does not exist$"):
        resources.find_description("arm.urdf", tmp_path)
    write(path)
    assert resources.find_description("arm.urdf", tmp_path) == path
    assert resources.find_description(path, Path("elsewhere")) == path


def test_a_problem_is_found_by_path_and_by_name(tmp_path):
    path = write(tmp_path / "p.yaml")
    assert resources.find_problem("p.yaml", tmp_path) == path
    assert resources.find_problem(str(path), Path("elsewhere")) == path
    wall = resources.find_problem("example:ur5/over_the_wall", Path("elsewhere"))
    assert wall == BUNDLED / "ur5" / "over_the_wall.yaml"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("p.yaml", "problem file FOLDER/p.yaml does not exist"),
        ("example:ur5/wall", "unknown bundled problem 'ur5/wall'"),
        ("example:ur5/over_the_wal", "(did you mean 'ur5/over_the_wall'?)"),
        ("example:ur5", "two_link/around_a_post"),
    ],
)
def test_a_missing_problem_is_named(tmp_path, name, message):
    with pytest.raises(ProblemError) as caught:
        resources.find_problem(name, tmp_path)
    assert message.replace("FOLDER", str(tmp_path)) in str(caught.value)


@pytest.mark.parametrize(
    ("variable", "below"),
    [(None, ""), ("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")],
    ids=["package_dirs", "ROS 1", "ROS 2"],
)
def test_packages_are_found_where_the_user_or_ros_says(tmp_path, monkeypatch, variable, below):
    path = write(tmp_path / below / "my_arm" / "urdf" / "arm.urdf")
    folders = () if variable else (tmp_path,)
    if variable:
        monkeypatch.setenv(variable, f"/nowhere:{tmp_path}")
    assert resources.find_description("package://my_arm/urdf/arm.urdf", Path(), folders) == path


def test_a_package_folder_may_be_the_package_and_hides_that_of_ros(tmp_path, monkeypatch):
    mine = write(tmp_path / "mine" / "my_arm" / "arm.urdf")
    write(tmp_path / "ros" / "my_arm" / "arm.urdf")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    for folder in (tmp_path / "mine", tmp_path / "mine" / "my_arm"):
        assert resources.find_description("package://my_arm/arm.urdf", Path(), (folder,)) == mine


def test_a_missing_package_lists_the_folders_tried_and_what_to_do(tmp_path, no_ros):
    message = (
        f"^package://my_arm/arm.urdf was not found; folders tried: .*{tmp_path / 'extra'}"
        ".*Add the folder that holds 'my_arm' to package_dirs$"
    )
    with pytest.raises(RobotError, match=message):
        resources.find_description("package://my_arm/arm.urdf", Path(), (tmp_path / "extra",))


@pytest.mark.parametrize(
    "filename",
    ["meshes/a.stl", "file://FOLDER/my_arm/meshes/a.stl", "package://my_arm/meshes/a.stl"],
)
def test_a_mesh_is_found_beside_its_urdf_by_every_kind_of_name(tmp_path, no_ros, filename):
    urdf = write(tmp_path / "my_arm" / "arm.urdf")
    mesh = write(tmp_path / "my_arm" / "meshes" / "a.stl")
    assert resources.find_mesh(filename.replace("FOLDER", str(tmp_path)), urdf) == mesh
    missing = f"^mesh {urdf.with_name('a.stl')}, named in {urdf}, does not exist$"
    with pytest.raises(RobotError, match=missing):
        resources.find_mesh("a.stl", urdf)


def test_without_example_robot_data_the_message_says_what_to_install(monkeypatch):
    uncached = resources._example_robot_data_share.__wrapped__
    monkeypatch.setattr(resources, "_example_robot_data_share", uncached)
    monkeypatch.setattr(resources.sys, "path", [])
    with pytest.raises(RobotError, match="pip install example-robot-data"):
        resources.find_description("example:ur5", Path())
    assert resources.find_description("example:two_link", Path()).is_file()


# The URDFs in each release of example-robot-data, as listed from its wheel.
RELEASES = json.loads((Path(__file__).parents[1] / "data/example_robot_data.json").read_text())


def test_the_listing_of_the_installed_release_is_true():
    version = importlib.metadata.version("example-robot-data")
    if version not in RELEASES:
        pytest.skip(f"no listing of example-robot-data {version} is kept")
    robots = resources._example_robot_data_share() / "example-robot-data" / "robots"
    files = sorted(path.relative_to(robots).as_posix() for path in robots.rglob("*.urdf"))
    assert files == RELEASES[version]


def test_every_name_of_the_table_is_in_a_release_and_arms_are_in_all():
    for name, path in resources._example_robots().items():
        count = sum(path in files for files in RELEASES.values())
        assert count >= (1 if "bravo7" in name else len(RELEASES)), name


def test_a_robot_of_another_release_says_so(monkeypatch):
    monkeypatch.setitem(resources._example_robots(), "gone", "gone_description/gone.urdf")
    with pytest.raises(RobotError, match=r"'gone' is not in the installed example-robot-data \(/"):
        resources.find_description("example:gone", Path())


@pytest.fixture
def unzipped(tmp_path, no_ros):
    """A package in a folder of another name, as an archive of its repository has it."""
    declared = "<!-- <name>old</name> --><package>\n<name> my_arm </name></package>"
    write(tmp_path / "my_arm-main" / "package.xml", declared)
    write(tmp_path / "my_arm-main" / "meshes" / "a b.stl")
    for outside in ("secret.stl", "urdf/model:/my_arm/secret.stl"):
        write(tmp_path / outside)
    (tmp_path / "my_arm-main" / "out").symlink_to(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "filename",
    [
        "package://my_arm/meshes/a b.stl",
        "package://my_arm//meshes/a%20b.stl",
        "package://my_arm/urdf/../meshes/./a%20b.stl",
        "package://my_arm/../my_arm/meshes/a%20b.stl",
        "package://my_arm/out/../meshes/a b.stl",
        "file://FOLDER/my_arm-main/meshes/a%20b.stl",
        "file://localhostFOLDER/my_arm-main/meshes/a b.stl",
        "file:FOLDER/my_arm-main/meshes/a%20b.stl",
        "file://../meshes/a b.stl",
    ],
)
def test_a_mesh_is_found_by_the_rules_of_uris(unzipped, filename):
    mesh = unzipped / "my_arm-main" / "meshes" / "a b.stl"
    urdf = unzipped / "my_arm-main" / "urdf" / "arm.urdf"
    name = filename.replace("FOLDER", str(unzipped))
    assert resources.find_mesh(name, write(urdf)).resolve() == mesh
    if filename.startswith("package:"):
        assert resources.find_mesh(name, Path("/nowhere/arm.urdf"), (unzipped,)) == mesh
    # A file that has the very name precedes what its signs stand for.
    literal = write(mesh.with_name("a%20b.stl"))
    found = resources.find_mesh("../meshes/a%20b.stl", urdf)
    assert found.resolve() == literal


def test_a_package_of_a_map_is_the_folder_under_its_name(tmp_path, no_ros):
    """A wheel keeps packages without package.xml in folders of other names."""
    mesh = write(tmp_path / "robots" / "kr5" / "meshes" / "a.stl")
    hidden = write(tmp_path / "cell" / "kr5_description" / "meshes" / "a.stl")
    urdf = write(tmp_path / "cell" / "arm.urdf")
    folders = package_folders({"kr5_description": "robots/kr5"}, tmp_path)
    name = "package://kr5_description/meshes/a.stl"
    assert resources.find_mesh(name, urdf) == hidden
    assert resources.find_mesh(name, urdf, folders) == mesh
    assert resources.find_package("kr5_description", urdf, folders) == mesh.parents[1]
    with pytest.raises(
        RobotError, match=f"tried: {tmp_path / 'robots/kr5'}, .*holds 'kr5' to pack"
    ):
        resources.find_mesh("package://kr5/meshes/a.stl", urdf, folders)


NAMES = {
    "package://my_arm/../secret.stl": "leads out of the package 'my_arm'",
    "package://my_arm/%2e%2e/secret.stl": "leads out of the package 'my_arm'",
    "package://my_arm//../secret.stl": "leads out of the package 'my_arm'",
    "package://../secret.stl": "leads out of the package '..'",
    "package://my_arm/urdf/../secret.stl": "the package has no file FOLDER/my_arm-main/secret.stl",
    "package://my_arm/out/../secret.stl": "the package has no file FOLDER/my_arm-main/secret.stl",
    "package://my_arm/FOLDER/secret.stl": "the package has no file FOLDER/my_arm-mainFOLDER/secret",
    "package://my_arm/Meshes/a b.stl": "there is FOLDER/my_arm-main/meshes/a b.stl (upper and",
    "package://My_Arm/meshes/a b.stl": "was not found; there is 'my_arm' (upper and lower case",
    "package://old/meshes/a b.stl": "Add the folder that holds 'old' to package_dirs",
    "package:///meshes/none.stl": "names no package; write package://PACKAGE/PATH",
    "Package://my_arm/meshes/a b.stl": "begins with Package:; write package://",
    "package:/my_arm/meshes/a b.stl": "begins with package:; write package://",
    "package://my_arm\\meshes\\a b.stl": "has backslashes; write / instead",
    "model://my_arm/secret.stl": "has the unknown scheme model:; known are package:// and file://",
    "urn:arm:1": "has the unknown scheme urn:; known are",
    "$(find my_arm)/a.stl": "holds $(find my_arm), which xacro or a shell replaces",
    "file://${dir}/a.stl": "holds ${dir}, which xacro",
    "C:\\arm\\a.stl": "is on the Windows drive C:",
    "file:///D:/arm/a.stl": "is on the Windows drive D:",
    "~/a.stl": "begins with ~, which only a shell replaces",
    " ../meshes/a b.stl": "begins or ends with blanks; remove them",
    "../meshes/A B.STL": "does not exist; there is FOLDER/my_arm-main/meshes/a b.stl (upper and",
    "file://host/a.stl": "does not exist (file:// without a third slash is relative)",
}


@pytest.mark.parametrize("filename", NAMES)
def test_the_name_of_a_mesh_is_refused_for_what_it_is(unzipped, filename):
    urdf = unzipped / "my_arm-main" / "urdf" / "arm.urdf"
    name = filename.replace("FOLDER", str(unzipped))
    with pytest.raises(RobotError) as caught:
        resources.find_mesh(name, urdf)
    assert NAMES[filename].replace("FOLDER", str(unzipped)) in str(caught.value)
    assert "model:/my" not in str(caught.value)


def test_a_package_is_the_folder_that_says_it_is_one(tmp_path, no_ros):
    """A folder with package.xml precedes a nearer folder of the same name without the file."""
    file, find_package = write(tmp_path / "cell" / "arm.xacro"), resources.find_package
    nearby = write(tmp_path / "cell" / "arm_description" / "arm.stl").parent
    assert find_package("arm_description", file) == nearby
    declared = write(tmp_path / "arm_description" / "package.xml").parent
    assert find_package("arm_description", file) == declared
    assert find_package("arm_description", Path("/nowhere/arm.xacro"), (declared,)) == declared
