"""Robots and problems that many tests share; loaded once."""

import fcntl
import os
import pickle
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cases import SLIDE
from small_cycle import planned_cycle
from stored_trajectories import STOP, stored_trajectory

from tubeplanner import (
    LimitOverrides,
    PlanningProblem,
    PlanOptions,
    Tube,
    load_problem,
    load_robot,
    plan,
)
from tubeplanner.cli.main import main

# Tests neither use nor change the user's covers; theirs stay warm from run to run. Those of other
# versions of trimesh and FCL are others.
COVERS = Path(__file__).parents[1] / "output" / os.environ.get("TEST_COVERS", "test-covers")
os.environ["TUBEPLANNER_CACHE"] = str(COVERS)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Put cheap tests first, so that a run with `-x` fails early."""
    items.sort(key=lambda item: [bool(item.get_closest_marker(mark)) for mark in ("slow", "dear")])


@pytest.fixture(scope="session")
def shared(tmp_path_factory):
    """Return a function from a key and a maker to what is made, once for all workers.

    The first worker that asks makes it and pickles it, the others wait and read it. Whoever gets it
    only looks at it.
    """
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    read = {}

    def of(key, make):
        if key not in read:
            path = folder / f"shared.{key.replace('/', '.')}.pickle"
            with open(path, "a+b") as file:
                fcntl.flock(file, fcntl.LOCK_EX)
                if not path.stat().st_size:
                    file.write(pickle.dumps(make()))
                    file.flush()
                file.seek(0)
                read[key] = pickle.load(file)
        return read[key]

    return of


@pytest.fixture(scope="session")
def two_link():
    unlimited = {"joint1": np.inf, "joint2": np.inf}
    return load_robot(
        "example:two_link", "hand", gravity=(0, 0, 0), limits=LimitOverrides(velocity=unlimited)
    )


@pytest.fixture(scope="session")
def ur5():
    return load_robot("example:ur5", "tool0")


@pytest.fixture(scope="session")
def panda():
    return load_robot("example:panda", "panda_hand_tcp")


@pytest.fixture(scope="session", params=["two_link", "ur5", "panda"])
def robot(request):
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def slide(tmp_path_factory):
    """An arm that turns, extends and lifts."""
    path = tmp_path_factory.mktemp("slide") / "slide.urdf"
    path.write_text(SLIDE)
    return load_robot(path, "tip")


@pytest.fixture(scope="session")
def slider(tmp_path_factory):
    """A mass of 2 kg on a rail, pushed by at most 10 N over 0.6 m from rest to rest."""
    folder = tmp_path_factory.mktemp("slider")
    (folder / "slider.urdf").write_text(
        """<robot name="slider"><link name="rail"/>
        <link name="cart"><inertial><mass value="2"/>
          <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/>
          <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="10" velocity="100"/></joint>
        </robot>"""
    )
    robot = load_robot("slider.urdf", "cart", directory=folder)
    return PlanningProblem(robot, Tube([[0, 0, 0], [0.6, 0, 0]], 0.1), np.zeros(1), name="slider")


@pytest.fixture(scope="session")
def bundled():
    """Return a function from a bundled problem's name to the problem, loaded once."""
    return cache(lambda name: load_problem(f"example:{name}"))


@pytest.fixture(scope="session")
def stored(bundled):
    """Return a function from a bundled problem's name to the problem and a stored trajectory.

    For tests that only look at trajectories. Unless asked otherwise, it stops at corners: its shape
    is known.
    """

    def of(name, method=STOP):
        return bundled(name), stored_trajectory(name, method).trajectory

    return of


@pytest.fixture(scope="session")
def planned(bundled, shared):
    """Return a function from a bundled problem's name to the problem and its shortest plan.

    One plan a session for all tests of all workers; they only look at it.
    """

    def of(name, method=STOP):
        problem = bundled(name)
        key = f"{name}.{method}"
        return problem, shared(key, lambda: plan(problem, PlanOptions(method, slack=0.0)))

    return of


@pytest.fixture(scope="session")
def small_plan(shared):
    """The plan of the small cycle, once a session for all tests of all workers."""
    return shared("small_cycle", planned_cycle)


@pytest.fixture
def run(capsys):
    """Return a function from arguments to exit status, standard output and standard error."""

    def call(*arguments):
        status = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return call
