"""Robots out of the ordinary: every method, baseline and command has an answer or a reason."""

import json

import numpy as np
import pytest

from cases import slow_but
from tubeplanner import PlanOptions, compare, load_problem, load_robot
from tubeplanner.baselines.baselines import BASELINES
from tubeplanner.planning.plan_options import METHODS
from tubeplanner.suh_bishop.suh_bishop import SuhBishopOptions

POST = {"name": "post", "cylinder": [0.03, 0.5], "position": [-0.7, -0.7, 0]}


def link(name, size, at=0.15):
    """Return a link of 2 kg; without a size [m] it has no collision geometry."""
    inertia = '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>'
    origin, shape = f'<origin xyz="{at} 0 0"/>', ""
    if size is not None:
        shape = f'<collision>{origin}<geometry><box size="{size}"/></geometry></collision>'
    inertial = f'<inertial>{origin}<mass value="2"/>{inertia}</inertial>'
    return f'<link name="{name}">{inertial}{shape}</link>'


def joint(name, kind, parent, child, x, axis):
    limit = '<limit lower="-3" upper="3" effort="60" velocity="3"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} 0 0"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def turning(size, count):
    names = ["base", *(f"l{k}" for k in range(count))]
    joints = [
        joint(f"j{k}", "revolute", names[k], names[k + 1], 0.3 * (k > 0), "0 0 1")
        for k in range(count)
    ]
    hand = joint("fix", "fixed", names[-1], "hand", 0.3, "1 0 0")
    links = [link(name, size) for name in names[1:]]
    return "".join(['<link name="base"/>', *links, *joints, '<link name="hand"/>', hand])


def sliding(size):
    rails = joint("x", "prismatic", "base", "a", 0, "1 0 0")
    rails += joint("y", "prismatic", "a", "hand", 0, "0 1 0")
    return f'<link name="base"/>{link("a", size, 0)}{link("hand", size, 0)}{rails}'


ELBOW = [[0.2, 0.9], [0.6, 0.9], [1.0, 0.7]]
ROBOTS = {
    "no collision geometry": (turning(None, 2), ELBOW, [], True),
    "no collision geometry, an obstacle": (turning(None, 2), ELBOW, [POST], True),
    "a single joint": (turning("0.2 0.04 0.04", 1), [[0.0], [0.2], [0.4]], [POST], True),
    "sliding joints": (sliding("0.1 0.1 0.05"), [[0, 0], [0.4, 0], [0.4, 0.4]], [POST], True),
    "no self-collision": (turning("0.2 0.04 0.04", 2), ELBOW, [POST], False),
}


# Each robot meets the methods or the commands quickly; the other half is slow.
WITH_COMMANDS = ("no self-collision",)
WITH_METHODS = [name for name in ROBOTS if name not in WITH_COMMANDS]


@pytest.fixture
def path(request, tmp_path):
    """Return the file of a problem along the tool's way through three configurations."""
    parts, q, obstacles, self_collision = ROBOTS[request.param]
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{parts}</robot>')
    robot = load_robot("arm.urdf", "hand", directory=tmp_path)
    points = robot.tool_position(np.array(q, dtype=float)).round(6)
    fields = {
        "robot": {"urdf": "arm.urdf", "tool_frame": "hand"},
        "tube": {"points": points.tolist(), "radius": 0.05},
        "start": {"joints": q[0]},
        "goal": {"joints": q[-1]},
        "obstacles": obstacles,
        "collision": {"self": self_collision},
    }
    path = tmp_path / "p.json"
    path.write_text(json.dumps(fields))
    return path


@pytest.mark.parametrize("path", slow_but(WITH_METHODS, ROBOTS), indirect=True)
def test_every_method_and_baseline_has_an_answer(path):
    brief = SuhBishopOptions(node_budget=50)
    options = PlanOptions(quality="fast", node_budget=100, suh_bishop=brief, time_limit=20)
    compared = compare(load_problem(path), options=options)
    assert [row.method for row in compared.rows] == [*METHODS, *BASELINES]
    assert [row.message for row in compared.rows if "internal error" in row.message] == []
    assert all(row.trajectory is not None or row.message for row in compared.rows)
    assert compared.rows[0].certified


@pytest.mark.parametrize("path", slow_but(WITH_COMMANDS, ROBOTS), indirect=True)
def test_every_command_has_an_answer(path, run):
    folder = path.parent
    files = {f"--{name}": folder / f"t.{name}" for name in ("csv", "html")}
    files |= {"-o": folder / "t.json", "--ros": folder / "t.yaml", "--plot": folder / "t.png"}
    outputs = [word for pair in files.items() for word in pair]
    for arguments in (
        ("plan", path, "--quality", "fast", "--time-left", *outputs),
        ("check", path, folder / "t.csv"),
        ("check", path, folder / "t.yaml"),
        ("plot", path, folder / "t.json", "-o", folder / "p.png"),
        ("view", path, folder / "t.json", "--html", folder / "v.html"),
        ("sweep", path, "--radius", "0.04", "--quality", "fast"),
        ("measure", path, "--configurations"),
    ):
        status, out, err = run(*arguments)
        assert status == 0, err
        assert "internal error" not in out + err
