"""What is asked of a cycle's motion between its legs."""

import math

import numpy as np

from outside.arm import Arm
from outside.cycle import Step
from outside.trajectory import Trajectory
from outside.verdict import RELATIVE, Condition

SAMPLES = 200


def judge_stay(
    arm: Arm, stop: list[np.ndarray], rest: Trajectory | None, start: list[np.ndarray], time: float
) -> Condition:
    """Return how far joints move at a seam, where they must not.

    Args:
        arm: The arm.
        stop: Where the leg before ends, shape (n,); nothing if there is none.
        rest: What the motion does there; None: it does not rest.
        start: Where the leg after begins; nothing if there is none.
        time: When the seam begins [s].
    """
    places = [*stop, *([] if rest is None else rest.at(rest.samples(SAMPLES))), *start]
    if len(places) < 2:
        return Condition(None, "rad")
    moved = abs(np.array(places) - places[0]).max(axis=0)
    return _of_joints(arm, -moved, time)


def judge_dwell(rest: list[Step], times: list[tuple[float, float]]) -> Condition:
    """Return how much longer than asked the arm rests for the events at a seam."""
    spare = [
        (end - begin - step.dwell, begin)
        for step, (begin, end) in zip(rest, times, strict=True)
        if step.dwell > 0
    ]
    margin, begin = min(spare, default=(None, None))
    return Condition(margin, "s", begin)


def judge_hold(arms: list[Arm], q: np.ndarray, time: float) -> Condition:
    """Return what motors have left that hold the arm in a configuration (n,), with every load.

    Of their efforts, and of torque-speed lines where these begin.
    """
    margin, where = math.inf, ""
    for arm in arms:
        still = np.zeros((1, len(q)))
        efforts = arm.efforts(q[None], still, still)[0]
        for j, limit in enumerate(arm.limits.by_place):
            allowed = float(limit.allowed(q[j : j + 1], 1 if efforts[j] > 0 else -1)[0])
            allowed = min(allowed, float(arm.motors.stall[j]))
            own = 1 - abs(efforts[j]) / allowed
            if own < margin and math.isfinite(allowed):
                margin, where = own, f"joint {arm.joint_names[j]}"
    if not where:
        return Condition(None, RELATIVE)
    return Condition(float(margin), RELATIVE, time, where)


def judge_return(arm: Arm, first: np.ndarray, last: np.ndarray, time: float) -> Condition:
    """Return how far from where it began the arm ends."""
    return _of_joints(arm, -abs(last - first), time)


def _of_joints(arm: Arm, margins: np.ndarray, time: float) -> Condition:
    joint = int(margins.argmin())
    unit = "m" if arm.slides[joint] else "rad"
    return Condition(float(margins[joint]), unit, time, f"joint {arm.joint_names[joint]}")
