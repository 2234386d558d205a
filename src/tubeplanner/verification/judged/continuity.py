"""Jumps between the pieces of a trajectory."""

from tubeplanner.outcome import Place
from tubeplanner.verification.judged_condition import FOR_ALL_TIMES, RELATIVE, JudgedCondition
from tubeplanner.verification.judged_motion import JudgedMotion


def judge_continuity(motion: JudgedMotion) -> JudgedCondition:
    """Judge jumps of position, or of velocity and acceleration relative to their largest values.

    All jumps of a joint add up: many small ones would otherwise let it skip any part of its path.
    The worst sum is reported, each measured by its own tolerance, at its largest jump.
    """
    found = [JudgedCondition(0.0, RELATIVE, Place(), FOR_ALL_TIMES)]
    for order in range(3):
        values = motion.piece_ends(order)
        jumps = abs(values[0, 1:] - values[1, :-1])
        if jumps.size == 0:
            continue
        if order > 0:
            jumps = jumps / motion.largest_rates[order]
        total = jumps.sum(axis=0)
        worst = int(total.argmax())
        joint = motion.robot.joint_names[worst]
        time = float(motion.trajectory.breakpoints[jumps[:, worst].argmax() + 1])
        unit = motion.position_unit(joint) if order == 0 else RELATIVE
        place = Place(time=time, joint=joint)
        found.append(JudgedCondition(0.0 - float(total[worst]), unit, place, FOR_ALL_TIMES))
    return min(found, key=lambda condition: _in_tolerances(motion, condition))


def _in_tolerances(motion: JudgedMotion, condition: JudgedCondition) -> float:
    """Return a margin as a multiple of the tolerance that it is judged by."""
    return (condition.margin or 0.0) / max(motion.tolerance.of(condition.unit), 1e-300)
