"""Page of an explanation: blocked arm, blocking solids, remedies or slack."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import OptionError
from tubeplanner.first_guess.branches import end_configuration
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.first_guess.pose_configurations import spread_seeds
from tubeplanner.outcome import Infeasible, Location
from tubeplanner.output.drawing import BLOCKED_COLOR, directions, hull_surface, pipe, rgb
from tubeplanner.output.page.motion_scene import build_scene
from tubeplanner.output.page.panel import panel_data, with_verdict
from tubeplanner.output.page.scene import Item, Layer, ShownTrajectory, poses_standing
from tubeplanner.output.page.viewer import View
from tubeplanner.studies.explanation import Explanation, ineffective_text, setting_text, tried_text
from tubeplanner.studies.remedies import Headroom, Remedy
from tubeplanner.task.motion import ProblemMotion
from tubeplanner.task.problem import PlanningProblem

# ---- The page: blockage and remedies, or slack.


def view_explanation(explanation: Explanation) -> View:
    """Return the view of an explanation.

    Without an answer the arm is where it is blocked, the blocking solids have a colour of their
    own, and the place is marked; with an answer, the arm follows the motion.

    Raises:
        OptionError: The tube contradicts itself and cannot be drawn.
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    problem, result = explanation.drawn, explanation.result
    if problem is None:
        raise OptionError(
            f"{explanation.name} cannot be drawn, as its tube contradicts itself; apply a change "
            "that helps and explain it again"
        )
    motion = None if result is None else result.trajectory
    motions = {} if motion is None else {"shortest motion": ProblemMotion(problem, motion)}
    scene = build_scene(problem, motions, at_rest=blocked_arm(problem, explanation))
    contact = contact_point(problem, explanation.location, explanation.configuration)
    items = with_blocked(scene.items, problem, explanation.location, contact, scene.thickness)
    scene = replace(scene, items=items)
    panel = {**panel_data(scene), "findings": _findings(explanation)}
    if motion is None or result is None or result.certificate is None:
        return View(scene, panel)
    judged = [result.certificate], result.sensitivities
    return View(scene, with_verdict(panel, problem, [motion], *judged))


def _findings(explanation: Explanation) -> dict[str, Any]:
    """Return the findings of the panel, as JSON values."""
    if explanation.is_possible:
        title = "How much worse one of these may become"
        lines = list(map(_headroom, explanation.headrooms))
    elif explanation.remedies:
        title = "Any one of these makes it possible"
        lines = list(map(_remedy, explanation.remedies))
    else:
        title, lines = "No single change was found that makes it possible", []
    more = []
    if explanation.ineffective:
        more.append(f"By itself none of these helps: {ineffective_text(explanation.ineffective)}")
    if explanation.stopped_by is not None:
        more.append("The search was ended early: there may be more")
    return {
        "reason": f"{explanation.status}: {explanation.message}",
        "title": title,
        "lines": lines,
        "more": more,
    }


def _remedy(remedy: Remedy) -> dict[str, Any]:
    details = [
        f"certified motion of {remedy.duration:.3f} s",
        *([f"{remedy.cost:.2g} times its scale: 0.1 m, 0.1 rad or the value"] * bool(remedy.unit)),
        *_not_enough("not enough", tried_text(remedy.too_little_text, remedy.is_smallest)),
    ]
    return {"text": remedy.text, "details": details, "setting": setting_text(remedy.changes)}


def _headroom(headroom: Headroom) -> dict[str, Any]:
    duration = (
        [] if headroom.duration is None else [f"certified motion of {headroom.duration:.3f} s"]
    )
    beyond = tried_text(headroom.too_much_text, headroom.is_exact)
    details = [*duration, headroom.field, *_not_enough("nothing found with", beyond)]
    return {"text": headroom.text, "details": details, "setting": ""}


def _not_enough(word: str, value: str) -> list[str]:
    return [f"{word}: {value}"] if value else []


# ---- The arm where it is blocked: in the configuration that planning met, or as near as possible.

_THERE = 1e-3  # [m]: a tool this near is at the blocked position
_MAX_SEEDS = 20


def blocked_arm(problem: PlanningProblem, explanation: Explanation) -> ShownTrajectory | None:
    """Return the arm where a problem without an answer is blocked; None if that is not known."""
    robot, q = problem.robot, explanation.configuration
    if q is not None:
        return poses_standing(robot, "where it is blocked", q)
    if explanation.location.position is None:
        return None
    target = np.array(explanation.location.position)
    q = _nearest(problem, target)
    away = float(np.linalg.norm(robot.tool_position(q[None])[0] - target))
    near = (
        "where it is blocked" if away <= _THERE else f"{1000 * away:.3g} mm from where it must be"
    )
    return poses_standing(robot, near, q)


def _nearest(problem: PlanningProblem, target: FloatArray) -> FloatArray:
    """Return the configuration (n,) within limits that brings the tool nearest to a point (3,)."""
    limits = problem.robot.limits
    try:
        seed = end_configuration(problem, problem.endpoints[0], 0)
    except Infeasible:
        seed = limits.clip(np.zeros(problem.robot.joint_count))
    bounds = limits.lower_position, limits.upper_position
    seeds = [seed, *spread_seeds(*bounds)[:_MAX_SEEDS]]
    solutions = (solve_position(problem.robot, target, each, *bounds) for each in seeds)
    return min(solutions, key=lambda each: max(each.error, _THERE)).q


def contact_point(
    problem: PlanningProblem, location: Location, q: FloatArray | None
) -> FloatArray | None:
    """Return the midpoint between the two solids of a place, (3,) [m]; None without two solids.

    The configuration there, (n,), is None if it is not known.
    """
    names = [*(location.links or ()), *([location.obstacle] if location.obstacle else [])]
    if q is None or len(names) != 2:
        return None
    checker = problem.collision
    pairs = checker.pairs[checker.between(*names)]
    if len(pairs) == 0:
        return None
    poses = problem.robot.body_poses(np.repeat(q[None], len(pairs), axis=0))
    closest = checker.closest_points(*poses, pairs)
    worst = int(closest.distance.argmin())
    middle: FloatArray = (closest.first[worst] + closest.second[worst]) / 2
    return middle


# ---- The blockage: links, solids and obstacles in another colour, and marks at the place.

_BALL_POINTS = 150
# In radii of drawn lines.
_CORE, _HALO, _LINE = 3.0, 9.0, 1.6
_HALO_OPACITY = 0.35


def with_blocked(
    items: Sequence[Item],
    problem: PlanningProblem,
    location: Location,
    contact: FloatArray | None,
    thickness: float,
) -> tuple[Item, ...]:
    """Return the items of a problem's scene, with blocking solids coloured and the place marked.

    The midpoint (3,) [m] between the solids is None if it is not known; the thickness is the
    radius of drawn lines [m].
    """
    names = {*(location.links or ()), location.obstacle}
    joints = problem.robot.joint_names
    bodies = {joints.index(location.joint) + 1} if location.joint in joints else set()
    color = rgb(BLOCKED_COLOR)
    colored = [
        replace(item, color=color) if _is_blocking(item, names, bodies) else item for item in items
    ]
    center = contact
    if center is None and location.position is not None:
        center = np.array(location.position)
    elif center is None and location.point is not None:
        center = problem.tube.points[location.point]
    return (*colored, *_marks(problem, location, center, thickness))


def _is_blocking(item: Item, names: set[str | None], bodies: set[int]) -> bool:
    if item.layer is Layer.ARM:
        return item.body in bodies or item.name.rpartition("/")[0] in names
    return item.layer in (Layer.CARRIED, Layer.OBSTACLES) and item.name in names


def _marks(
    problem: PlanningProblem, location: Location, center: FloatArray | None, thickness: float
) -> list[Item]:
    """Return a ball about a point (3,), and a line along the segment of a place."""
    color, marks = rgb(BLOCKED_COLOR), []
    if center is not None:
        for name, size, opacity in (("core", _CORE, 1.0), ("halo", _HALO, _HALO_OPACITY)):
            ball = hull_surface(center + size * thickness * directions(_BALL_POINTS))
            marks.append(Item(Layer.BLOCKED, 0, name, ball, color, opacity))
    if location.segment is not None:
        ends = problem.tube.points[location.segment : location.segment + 2]
        line, _ = pipe(ends, _LINE * thickness)
        marks.append(Item(Layer.BLOCKED, 0, "segment", line, color))
    return marks
