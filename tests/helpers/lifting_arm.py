"""An arm that carries a cube along x and z above a table: every distance has a closed form.

The cube's gap to the table is z - 0.05, its gap to the base's post x + 0.15 [m]. Motions go from
place to place in straight lines, from rest to rest in a second each.
"""

import json
from typing import NamedTuple

import numpy as np
import yaml

from tubeplanner import JointTrajectory, load_problem

HALF = 0.05  # of the cube's side [m]
POST = -0.2  # where the base's post ends [m]
TIP = "hand"
QUINTIC = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
URDF = f"""<robot name="lifting">
<link name="base"><collision><origin xyz="{POST - 0.05} 0 0"/>
<geometry><box size="0.1 0.1 2"/></geometry></collision></link>
<link name="cart">{INERTIAL}</inertial></link>
<link name="hand">{INERTIAL}</inertial>
<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>
<joint name="x" type="prismatic"><parent link="base"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="1000" velocity="10"/></joint>
<joint name="z" type="prismatic"><parent link="cart"/><child link="hand"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="1000" velocity="10"/></joint></robot>"""
CONTACT = {"links": ["hand", "table"], "within": 0.03}


class Case(NamedTuple):
    """A motion and what is asked of it.

    Attributes:
        way: Places x and gap to the table [m], from rest to rest.
        tube: Indices of those that are the tube's points.
        fields: `clearance` and `contacts` of the problem.
        margin: Least distance of cube and table beyond what is asked [m].
        time: When [s]; None: more than once.
        open_goal: Whether the last configuration is not given.
        visit: As the tube has it.
        radius: Likewise [m].
    """

    way: list
    tube: list
    fields: dict
    margin: float
    time: float | None
    open_goal: bool = False
    visit: str = "ordered"
    radius: float = 0.12


def at_height(gap, low, high, begin):
    """Return when a lift that begins at a time passes a gap [s]."""
    fraction = (gap - low) / (high - low)
    roots = np.roots(QUINTIC - [0, 0, 0, 0, 0, fraction])
    return begin + float(next(r.real for r in roots if abs(r.imag) < 1e-9 and 0 <= r.real <= 1))


def contacts(**changes):
    return {"clearance": 0.01, "contacts": [CONTACT | changes]}


RISE = [(0.0, 0.01), (0.2, 0.02), (0.4, 0.03)]
LIFT = [(0.0, 0.0), (0.0, 0.2), (0.4, 0.2)]
SIDEWAYS = [(0.0, 0.0), (0.1, 0.01), (0.1, 0.2), (0.4, 0.2)]
BACK = [(0.0, 0.0), (0.0, 0.05), (0.02, 0.005), (0.0, 0.05), (0.0, 0.2), (0.4, 0.2)]
BESIDE = [(0.0, 0.0), (0.0, 0.05), (0.04, 0.005), (0.0, 0.05), (0.0, 0.2), (0.4, 0.2)]
OVER = [(0.0, 0.0), (0.0, 0.1), (0.4, 0.1), (0.4, 0.0)]
AT_BOUNDARY = 0.03 / np.hypot(0.1, 0.01)  # fraction of the way sideways
PAIR = [{"links": ["table", "hand"], "clearance": 0.006}]

CASES = {
    "one for all": Case(RISE, [0, 1, 2], {"clearance": 0.008}, 0.002, 0.0),
    "by segment": Case(RISE, [0, 1, 2], {"clearance": {"segments": [0.008, 0.017]}}, 0.002, 0.0),
    "the default where a segment has none": Case(
        RISE, [0, 1, 2], {"clearance": {"default": 0.008, "segments": [None, 0.017]}}, 0.002, 0.0
    ),
    "swapped": Case(RISE, [0, 1, 2], {"clearance": {"segments": [0.017, 0.008]}}, -0.007, 0.0),
    "a pair before a segment": Case(
        RISE, [0, 1, 2], {"clearance": {"segments": [0.017, 0.03], "pairs": PAIR}}, 0.004, 0.0
    ),
    "a lift": Case(LIFT, [0, 1, 2], contacts(), 0.0, 0.0),
    "a lift without contact": Case(LIFT, [0, 1, 2], {"clearance": 0.01}, -0.01, 0.0),
    "a lift in contact at the goal alone": Case(
        LIFT, [0, 1, 2], contacts(segments=[-1]), -0.01, 0.0
    ),
    "too near when contact ends": Case(
        LIFT, [0, 1, 2], contacts() | {"clearance": 0.04}, -0.01, at_height(0.03, 0, 0.2, 0)
    ),
    "a pair's own clearance when contact ends": Case(
        LIFT,
        [0, 1, 2],
        contacts() | {"clearance": {"pairs": [PAIR[0] | {"clearance": 0.035}]}},
        -0.005,
        at_height(0.03, 0, 0.2, 0),
    ),
    "sideways": Case(
        SIDEWAYS, [0, 2, 3], contacts(), 0.01 * AT_BOUNDARY - 0.01, at_height(AT_BOUNDARY, 0, 1, 0)
    ),
    "deeper first": Case([LIFT[0], (0.0, -0.001), *LIFT[1:]], [0, 2, 3], contacts(), -0.001, 1.0),
    "back into the ball": Case(BACK, [0, 4, 5], contacts(), 0.0, 0.0),
    "beside the ball": Case(BESIDE, [0, 4, 5], contacts(), -0.005, 2.0),
    "back into the ball in a wide first segment": Case(
        BACK, [0, 1, 2, 3, 4, 5], contacts(), 0.0, 0.0
    ),
    "back into the ball in another segment": Case(
        BACK, [0, 1, 2, 3, 4, 5], contacts(), -0.005, 2.0, radius=0.01
    ),
    "set down": Case(LIFT[::-1], [0, 1, 2], contacts(segments=[1]), 0.0, 2.0),
    "set down, deeper first": Case(
        [*LIFT[:0:-1], (0.0, -0.001), LIFT[0]], [0, 1, 3], contacts(), -0.001, 2.0
    ),
    "set down where the goal is open": Case(
        LIFT[::-1], [0, 1, 2], contacts(segments=[-1]), 0.0, 2.0, True
    ),
    "overlap at an open goal": Case(
        [*LIFT[:0:-1], (0.0, -0.0005)], [0, 1, 2], contacts(), -0.0005, 2.0, True
    ),
    "over in one segment": Case(OVER, [0, 3], contacts(), 0.0, None),
    "over, in contact at the start alone": Case(
        [*OVER[:3], (0.4, 0.001)], [0, 3], contacts(), 0.0, None
    ),
    "over in a union": Case(OVER, [0, 1, 2, 3], contacts(), 0.0, None, False, "any"),
    "sideways in a union": Case(
        SIDEWAYS, [0, 1, 2, 3], contacts(), 0.01 * AT_BOUNDARY - 0.01, None, False, "any"
    ),
}


def trajectory_of(way):
    """Return a trajectory through places."""
    locations = np.add(way, [0.0, HALF])
    begin, step = locations[:-1], np.diff(locations, axis=0)
    coefficients = QUINTIC[:, None, None] * step
    coefficients[-1] += begin
    return JointTrajectory(["x", "z"], np.arange(len(locations)), coefficients)


def fields_of(case):
    """Return what a problem file of a case holds."""
    locations = np.add(case.way, [0.0, HALF]).tolist()
    points = [[locations[k][0], 0.0, locations[k][1]] for k in case.tube]
    fields = {
        "robot": {"urdf": "lifting.urdf", "tool_frame": TIP, "gravity": [0, 0, 0]},
        "tube": {"points": points, "radius": case.radius, "visit": case.visit},
        "start": {"joints": locations[0]},
        "goal": {"joints": locations[-1]},
        "obstacles": [{"name": "table", "box": [4, 4, 0.1], "position": [0, 0, -0.05]}],
    }
    if case.open_goal:
        del fields["goal"]
    return fields | case.fields


def written(folder, fields):
    """Return the path of a problem file, beside the arm's URDF."""
    (folder / "lifting.urdf").write_text(URDF)
    path = folder / "lifting.yaml"
    path.write_text(yaml.safe_dump(json.loads(json.dumps(fields))))
    return path


def lifting(folder, case):
    """Return the problem and the trajectory of a case."""
    problem = load_problem(written(folder, fields_of(case)))
    return problem, trajectory_of(case.way)
