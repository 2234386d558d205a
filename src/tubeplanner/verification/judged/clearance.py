"""Links against obstacles and against each other."""

from tubeplanner.arrays import IntArray
from tubeplanner.outcome import Place
from tubeplanner.verification.closest_approach import closest_approach
from tubeplanner.verification.judged_condition import JudgedCondition, bracketed, not_required
from tubeplanner.verification.judged_motion import JudgedMotion


def judge_obstacles(motion: JudgedMotion) -> JudgedCondition:
    """Judge links against obstacles, for all t."""
    pairs, clearance = motion.problem.collision.obstacle_pairs, motion.problem.clearance
    return _judge_clearance(motion, pairs, clearance, "no link can meet an obstacle")


def judge_self_collision(motion: JudgedMotion) -> JudgedCondition:
    """Judge links against links, for all t."""
    pairs = motion.problem.collision.link_pairs
    return _judge_clearance(motion, pairs, 0.0, "no pair of links is checked")


def _judge_clearance(
    motion: JudgedMotion, pairs: IntArray, required: float, not_asked: str
) -> JudgedCondition:
    """Judge the least distance of pairs of solids.

    Args:
        motion: What is judged.
        pairs: Shape (P, 2).
        required: The least distance allowed [m].
        not_asked: What is said if there is no pair.
    """
    checker = motion.problem.collision
    nearest = closest_approach(checker, motion.trajectory, pairs, required)
    if nearest is None:
        if not checker.has_link_geometry:
            not_asked = "the robot has no collision geometry: nothing could be checked"
        return not_required("m", not_asked)
    links, obstacle = checker.owners(nearest.pair)
    place = Place(time=nearest.time, links=links, obstacle=obstacle)
    return bracketed(nearest.lower_bound - required, nearest.distance - required, "m", place)
