"""Links against obstacles and against each other."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.outcome import Place
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.asked_distances import AskedDistances, asked_of_motion
from tubeplanner.verification.closest_approach import closest_approach
from tubeplanner.verification.judged_condition import JudgedCondition, bracketed, not_required
from tubeplanner.verification.judged_motion import JudgedMotion


def judge_obstacles(motion: JudgedMotion) -> JudgedCondition:
    """Judge links against obstacles, for all t."""
    checker = motion.problem.collision
    columns = np.arange(len(checker.obstacle_pairs))
    return _judge_clearance(motion, columns, "no link can meet an obstacle")


def judge_self_collision(motion: JudgedMotion) -> JudgedCondition:
    """Judge links against links, for all t."""
    checker = motion.problem.collision
    columns = np.arange(len(checker.obstacle_pairs), len(checker.pairs))
    return _judge_clearance(motion, columns, "no pair of links is checked")


def _judge_clearance(motion: JudgedMotion, columns: IntArray, not_asked: str) -> JudgedCondition:
    """Judge the least distance of pairs of solids beyond what is asked.

    Args:
        motion: What is judged.
        columns: Which of the checker's pairs, shape (P,).
        not_asked: What is said if there is no pair.
    """
    checker = motion.problem.collision
    asked = AskedDistances(motion).over
    nearest = closest_approach(checker, motion.trajectory, columns, asked)
    if nearest is None:
        if not checker.has_link_geometry:
            not_asked = "the robot has no collision geometry: nothing could be checked"
        return not_required("m", not_asked)
    links, obstacle = checker.owners(nearest.pair)
    place = Place(time=nearest.time, links=links, obstacle=obstacle)
    return bracketed(nearest.lower_bound, nearest.margin, "m", place)


class ClearanceMargin:
    """A `SegmentMargin`: how far links are apart beyond what each segment asks [m]."""

    def __init__(self, problem: PlanningProblem, trajectory: JointTrajectory) -> None:
        self._problem, self._trajectory = problem, trajectory
        self._asked = asked_of_motion(problem, trajectory)
        self._most = self._asked.by_segment.max(axis=0)

    @property
    def is_constant(self) -> bool:
        """Whether all segments ask the same."""
        return self._asked.is_constant

    def at(self, time: FloatArray) -> FloatArray:
        """Return what is left in all segments."""
        tool, distance = self._at(time)
        rows = [(distance - row).min(axis=1, initial=np.inf) for row in self._asked.by_segment]
        left = np.column_stack(rows)[:, self._asked.row_of]
        for k in {near.segment for near in self._asked.near_ends}:
            left[:, k] = self._left(np.full(len(time), k), tool, distance)
        return left

    def within(self, segment: IntArray, time: FloatArray) -> FloatArray:
        """Return what is left in one segment each."""
        return self._left(segment, *self._at(time))

    def _left(self, segment: IntArray, tool: FloatArray, distance: FloatArray) -> FloatArray:
        left: FloatArray = (distance - self._asked.at(segment, tool)).min(axis=1, initial=np.inf)
        return left

    def _at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return where the tool is, (N, 3), and lower bounds on distances, (N, P) [m].

        These are exact where they are less than some segment asks: more does not matter.
        """
        checker, q = self._problem.collision, self._trajectory.position(time)
        rotation, position = checker.robot.body_poses(q)
        distance = checker.sphere_distances(rotation, position, checker.pairs)
        row, column = np.nonzero(distance < self._most)
        boxes = checker.box_distances(rotation, position, row, checker.pairs[column])
        near = boxes < self._most[column]
        distance[row, column] = np.maximum(distance[row, column], boxes)
        row, column = row[near], column[near]
        closest = checker.closest_points(rotation, position, checker.pairs[column], row)
        distance[row, column] = closest.distance
        return checker.robot.tool_position(q), distance


def clearance_margin(
    problem: PlanningProblem, trajectory: JointTrajectory
) -> ClearanceMargin | None:
    """Return the margin of links' clearance; None where all segments ask the same."""
    margin = ClearanceMargin(problem, trajectory)
    return None if margin.is_constant else margin
