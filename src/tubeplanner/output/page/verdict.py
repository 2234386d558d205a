"""Verdict of a page: certificate, duration, peaks, payload, sources of limits, savings, version."""

import os
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from tubeplanner import __version__
from tubeplanner.certificate.judged_motion import FOR_ALL_TIMES
from tubeplanner.certificate.verification import Certificate, CycleCertificate
from tubeplanner.limits.peaks import trajectory_peaks
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import Task
from tubeplanner.text import LimitCost, savings
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_SOURCED = ("velocity", "effort", "acceleration", "jerk")
_GRAVITY = 9.81  # [m/s^2]
_MAX_SAVINGS = 3
_HOUR = 3600.0  # [s]


def with_verdict(
    panel: dict[str, Any],
    task: Task,
    motions: Sequence[JointTrajectory],
    certificates: Sequence[Certificate | CycleCertificate] = (),
    sensitivities: Sequence[LimitCost] = (),
) -> dict[str, Any]:
    """Return a panel with the verdicts of its motions, their peaks, and facts on robot and plan.

    Without certificates there is no verdict; of costs of limits the largest comes first.
    """
    if not motions:  # the arm at rest
        return panel
    robot, arms = task.robot, [task.robot]
    if isinstance(task, Cycle):
        arms = [leg.robot for leg in task.legs]
    shown = []
    for stated, motion in zip(panel["trajectories"], motions, strict=False):
        peaks = trajectory_peaks(robot, motion)
        acceleration = peaks.tool_acceleration.value
        words = {
            "top": f"{peaks.tool_speed.value:.2f} m/s",
            "acceleration": f"{acceleration:.3g} m/s\u00b2",
            "gravities": f"{acceleration / _GRAVITY:.2g} g",
        }
        shown.append({**stated, **words})
    for stated, certificate in zip(shown, certificates, strict=False):
        stated["verdict"] = _verdict(certificate)
    facts = []  # what, value, and True if it is shown on demand
    if len(shown) == 1 and isinstance(task, Cycle):
        facts.append(("cycles per hour", f"{_HOUR / shown[0]['duration']:.0f}", False))
    if largest := "; ".join(savings(sensitivities)[:_MAX_SAVINGS]):
        facts.append(("raising a limit by 10 % would save", largest, False))
    masses = {0.0 if arm.payload is None else arm.payload.mass for arm in arms}
    payload = " to ".join(f"{mass:g}" for mass in sorted({min(masses), max(masses)}))
    facts.append(("payload", "none" if payload == "0" else f"{payload} kg", True))
    facts.append(("limits", limit_sources(robot), True))
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")  # of reproducible pages
    date = time.gmtime(int(epoch) if epoch.isdecimal() else time.time())
    made = f"{time.strftime('%Y-%m-%d', date)} by tubeplanner {__version__}"
    facts.append(("made", made, True))
    return {**panel, "trajectories": shown, "facts": facts}


def _verdict(certificate: Certificate | CycleCertificate) -> dict[str, Any]:
    """Return the verdict of a certificate, and how many conditions hold or which fail."""
    if failures := certificate.failures():
        return {"passed": False, "text": "; ".join(map(certificate.describe, failures))}
    legs = [certificate] if isinstance(certificate, Certificate) else certificate.moves.values()
    coverage: dict[str, set[str]] = {}
    for name, condition in (each for leg in legs for each in leg.conditions.items()):
        if condition.margin is not None:
            coverage.setdefault(name, set()).add(condition.coverage)
    partial = [name for name, each in coverage.items() if each != {FOR_ALL_TIMES}]
    text = f"{len(coverage) - len(partial)} conditions hold for all t"
    text += f", {len(partial)} where it applies ({', '.join(partial)})" * bool(partial)
    return {"passed": True, "text": text}


def limit_sources(robot: RobotModel) -> str:
    """Return the sources of the joints' limits: quantities of the same source together."""
    named: dict[str, list[str]] = {}
    for quantity in _SOURCED:
        values = np.isfinite(getattr(robot.limits, quantity)).tolist()
        own = robot.limits.sources.get(quantity, {})
        joints = zip(robot.joint_names, values, strict=True)
        sources = dict.fromkeys(own.get(name, "URDF") if has else "none" for name, has in joints)
        named.setdefault(" and ".join(sources), []).append(quantity)
    return "; ".join(f"{', '.join(quantities)}: {source}" for source, quantities in named.items())
