"""The scene of a problem and its trajectories."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.errors import TrajectoryError
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.simulation.execution import Execution
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.views.arm_hulls import arm_hulls, carried_surfaces
from tubeplanner.views.executed_paths import (
    BESIDE_EXECUTED,
    EXECUTED_STEPS,
    ExecutedPaths,
    executed_paths,
)
from tubeplanner.views.execution_curves import tool_runs
from tubeplanner.views.goal_ball import goal_ball
from tubeplanner.views.link_visuals import MAX_FACES, link_parts
from tubeplanner.views.orientation_items import turned_tool
from tubeplanner.views.palette import REFERENCE_COLOR, rgb, segment_color
from tubeplanner.views.scene import Item, Layer, Scene, ShownTrajectory
from tubeplanner.views.scene_frame import scene_frame
from tubeplanner.views.scene_items import (
    arm_items,
    carried_items,
    line_thickness,
    obstacle_items,
    reference_item,
    swept_item,
    swept_surface,
    tool_items,
)
from tubeplanner.views.shown_poses import direction_of, poses_along, poses_at_rest
from tubeplanner.views.stretch import Stretch
from tubeplanner.views.surface import Surface, tube_surfaces

_FRAMES_PER_SECOND, _MIN_FRAMES, _MAX_FRAMES = 200, 80, 240


@dataclass(frozen=True, eq=False, kw_only=True)
class ProblemScene(Scene):
    """The scene of a problem.

    Attributes:
        problem: What is shown.
    """

    problem: PlanningProblem


def build_scene(
    problem: PlanningProblem,
    named: Mapping[str, JointTrajectory],
    execution: Execution | None = None,
    *,
    at_rest: ShownTrajectory | None = None,
    notes: Sequence[str] = (),
    empty_handed: Collection[str] = (),
) -> ProblemScene:
    """Return the scene of a problem and some trajectories, by name.

    Without a trajectory the arm stands as is given, else at the start. The execution is that of the
    one trajectory. Trajectories that are empty-handed are drawn without the problem's carried
    solids. Notes of the scene begin with those that are given.

    Raises:
        TrajectoryError: A trajectory moves other joints than the problem's; it is named.
        RobotError: The robot's geometry is of a kind no URDF has.
    """
    said, robot = list(notes), problem.robot
    motions = {name: _motion(problem, name, given) for name, given in named.items()}
    stretches = tuple((Stretch(problem, motion),) for motion in motions.values())
    shown = [_shown(robot, *pair) for pair in motions.items()]
    shown = shown or [at_rest or poses_at_rest(problem, said)]
    parts, notes_of_parts = link_parts(robot, MAX_FACES // len(shown))
    carried = carried_surfaces(robot, problem.attached)
    hulls, tube = arm_hulls(parts, carried), tube_surfaces(problem.tube)
    swept = [swept_surface(each, hulls) for each in shown]
    standing = [points for body, points in hulls if body == 0]
    points = [*(surface.vertices for surface in [*swept, *tube]), *standing]
    direction = direction_of(shown[0], [problem.tube.points], problem.obstacles, hulls)
    thickness = line_thickness([problem.tube], float(np.ptp(np.vstack(points), axis=0).max()))
    fastest = max(float(each.speed.max()) for each in shown)
    width = thickness if execution is None else BESIDE_EXECUTED * thickness
    items: list[Item] = []
    for i, each in enumerate(shown):
        shown[i], turned = turned_tool(
            i, robot, [problem.tube], sum(stretches[i : i + 1], ()), each, thickness
        )
        items += arm_items(i, parts)
        items += carried_items(i, () if each.name in empty_handed else carried)
        items += _surroundings(i, problem, tube, thickness)
        items += tool_items(i, each, robot, width, fastest)
        items += [*turned, *swept_item(i, each, swept[i])]
    return ProblemScene(
        name=problem.name,
        trajectories=tuple(shown),
        items=tuple(items),
        frame=scene_frame(points, direction, len(shown)),
        thickness=thickness,
        notes=(*said, *notes_of_parts),
        stretches=stretches,
        executed=_executed(problem, named, execution),
        problem=problem,
    )


def _motion(problem: PlanningProblem, name: str, trajectory: JointTrajectory) -> JointTrajectory:
    try:
        return trajectory.reordered(problem.robot.joint_names)
    except TrajectoryError as error:
        raise TrajectoryError(f"{name}: {error}") from error


def _shown(robot: RobotModel, name: str, trajectory: JointTrajectory) -> ShownTrajectory:
    wanted = int(np.ceil(_FRAMES_PER_SECOND * trajectory.duration))
    frames = min(max(wanted, _MIN_FRAMES), _MAX_FRAMES)
    time = np.linspace(0.0, trajectory.duration, frames)
    return poses_along(robot, name, trajectory, time)


def _surroundings(
    trajectory: int, problem: PlanningProblem, tube: list[Surface], thickness: float
) -> list[Item]:
    """Return tube, reference path, its lines of a thickness [m], and obstacles."""
    items = [
        Item(
            Layer.TUBE,
            trajectory,
            f"segment_{k}",
            surface,
            rgb(segment_color(k)),
            0.3,
            is_smooth=not problem.tube.is_box[k],
        )
        for k, surface in enumerate(tube)
    ]
    items.append(reference_item(trajectory, "path", problem.tube.points, thickness))
    for ball in goal_ball(problem.goal):
        items.append(Item(Layer.REFERENCE, trajectory, "goal", ball, rgb(REFERENCE_COLOR), 0.35))
    return items + obstacle_items(trajectory, problem.obstacles)


def _executed(
    problem: PlanningProblem, named: Mapping[str, JointTrajectory], execution: Execution | None
) -> ExecutedPaths | None:
    if execution is None:
        return None
    (trajectory,) = named.values()
    return executed_paths(tool_runs(problem, trajectory, execution), EXECUTED_STEPS)
