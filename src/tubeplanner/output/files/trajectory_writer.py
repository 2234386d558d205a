"""Trajectories and cycles written as JSON, CSV or ROS messages."""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner import __version__
from tubeplanner.arrays import FloatArray
from tubeplanner.checks import require_between
from tubeplanner.errors import OptionError, OutputError, shown
from tubeplanner.limits.motor_costs import motor_effort
from tubeplanner.output.files.fingerprint import cycle_hash, cycle_part_hashes, origin, robot_hash
from tubeplanner.output.files.samples import CycleSamples, cycle_samples, samples_for_export
from tubeplanner.task.legs import stop_text
from tubeplanner.task.motion import CycleMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import FORMULA_BEGINS
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.trajectory.reader import TRAJECTORY_FORMAT, TRAJECTORY_VERSION
from tubeplanner.writing import require_writable, write_files

# ---- Files of a trajectory.

_RATE = 500.0  # [Hz]
_FORMATS = {".json": "json", ".csv": "csv", ".yaml": "ros", ".yml": "ros"}


@dataclass(frozen=True)
class TrajectoryFiles:
    """Output files of a trajectory; None for a format without a file.

    Attributes:
        json: The trajectory itself.
        csv: Its samples.
        ros: Its samples as trajectory_msgs/JointTrajectory, in YAML.
        rate: Of the samples [Hz]; None: a sample per period of the problem's controller, 500 Hz
            without a period.

    Raises:
        OptionError: On construction, if the rate is not positive and finite.
    """

    json: Path | None = None
    csv: Path | None = None
    ros: Path | None = None
    rate: float | None = None

    def __post_init__(self) -> None:
        if self.rate is not None:
            require_between(self, 0, inf, "rate", unit="Hz")

    def contents(
        self,
        trajectory: JointTrajectory,
        problem: PlanningProblem | None = None,
        method: str | None = None,
    ) -> tuple[dict[Path, bytes], tuple[str, ...]]:
        """Return the contents of the files, and notes about samples.

        Args:
            trajectory: The trajectory; with a problem, of its joints, in their order.
            problem: For hashes, efforts, and samples that keep the limits when joined; None: none
                of these.
            method: Method of planning, for the JSON.

        Raises:
            TrajectoryError: The rate makes too many samples.
        """
        texts: dict[Path, str] = {}
        notes: tuple[str, ...] = ()
        if self.json is not None:
            more = {} if problem is None else origin(problem, method)
            texts[self.json] = trajectory_json(trajectory, **more)
        if self.csv is not None or self.ros is not None:
            rate = self.sample_rate(None if problem is None else problem.period)
            if problem is None:
                samples = trajectory.sample(rate)
            else:
                exported = samples_for_export(problem, trajectory, rate)
                samples = exported.samples
                notes = () if exported.note is None else (exported.note,)
        names = trajectory.joint_names
        if self.csv is not None:
            effort = None if problem is None else motor_effort(problem.robot, trajectory, samples)
            texts[self.csv] = trajectory_csv(names, samples, effort)
        if self.ros is not None:
            texts[self.ros] = trajectory_ros(names, samples, *notes)
        return {path: text.encode() for path, text in texts.items()}, notes

    def sample_rate(self, period: float | None) -> float:
        """Return the rate of the samples [Hz], for a controller's period [s] or None."""
        return self.rate or (_RATE if period is None else 1 / period)


def files_at(path: str | Path, rate: float | None = None) -> TrajectoryFiles:
    """Return the file at a path, in the format of its ending.

    Raises:
        OutputError: There is no such format.
        OptionError: As `TrajectoryFiles`.
    """
    path = Path(path)
    if path.suffix.lower() not in _FORMATS:
        raise OutputError(
            f"output {path}: the suffix chooses the format; there is: {', '.join(_FORMATS)}"
        )
    return TrajectoryFiles(**{_FORMATS[path.suffix.lower()]: path}, rate=rate)


def write_trajectory(
    path: str | Path,
    trajectory: JointTrajectory,
    problem: PlanningProblem | None = None,
    rate: float | None = None,
) -> tuple[str, ...]:
    """Write a trajectory to a file, as `JointTrajectory.save` documents.

    Returns:
        Notes about the samples.
    """
    path, files = Path(path), files_at(path, rate)
    require_writable([path])
    if problem is not None:
        if not isinstance(problem, PlanningProblem):
            raise OptionError(f"problem is {problem!r}; it must be PlanningProblem")
        trajectory = trajectory.reordered(problem.robot.joint_names)
    contents, notes = files.contents(trajectory, problem)
    write_files(contents)
    return notes


# ---- Files of the motion of a cycle.


def write_cycle_motion(
    path: str | Path, motion: CycleMotion, rate: float | None = None
) -> tuple[str, ...]:
    """Write the motion of a cycle to a file; its ending chooses the format.

    Args:
        path: `.json` (with marks, for `read_cycle_motion`), `.csv`, or `.yaml` (ROS, a message for
            every leg); replaced as a whole or not at all.
        motion: As in the result of `plan_cycle`.
        rate: Of samples [Hz]; None: a sample per period of the cycle's controller, or 500 Hz.

    Returns:
        Notes about the samples.

    Raises:
        OutputError: The file cannot be written, or its ending is unknown.
        OptionError: The rate is not positive and finite.
        TrajectoryError: The rate makes too many samples.
    """
    files = files_at(path, rate)
    require_writable([Path(path)])
    contents, notes = cycle_contents(files, motion, None)
    write_files(contents)
    return notes


def cycle_contents(
    files: TrajectoryFiles, motion: CycleMotion, method: str | None
) -> tuple[dict[Path, bytes], tuple[str, ...]]:
    """Return the contents of the files of a cycle's motion, and notes about samples.

    The JSON has the whole motion, with marks. CSV has samples of legs and rests, and efforts with
    the parts carried at the time. ROS has a message for every leg, as YAML documents.

    Args:
        files: The files.
        motion: A certified answer.
        method: Method of planning, for the JSON; None: not known.

    Raises:
        TrajectoryError: The rate makes too many samples.
    """
    texts: dict[Path, str] = {}
    notes: tuple[str, ...] = ()
    if files.json is not None:
        marks = [mark.as_dict() for mark in motion.marks]
        fields = {"marks": marks, **_origin(motion, method)}
        texts[files.json] = trajectory_json(motion.trajectory, **fields)
    if files.csv is not None or files.ros is not None:
        samples = cycle_samples(motion, files.sample_rate(motion.cycle.period))
        notes = samples.notes
    if files.csv is not None:
        texts[files.csv] = trajectory_csv(motion.trajectory.joint_names, *samples.whole())
    if files.ros is not None:
        texts[files.ros] = _ros_documents(samples)
    return {path: text.encode() for path, text in texts.items()}, notes


def _origin(motion: CycleMotion, method: str | None) -> dict[str, Any]:
    cycle = motion.cycle
    return {
        **({} if method is None else {"method": method}),
        "tubeplanner_version": __version__,
        "problem": cycle.name,
        "problem_hash": cycle_hash(cycle),
        "robot_hash": robot_hash(cycle.robot),
        "part_hashes": cycle_part_hashes(cycle),
    }


def _ros_documents(samples: CycleSamples) -> str:
    """Return a message for every leg, with comments on its move and the rests beside the leg."""
    cycle = samples.motion.cycle
    names, last = cycle.robot.joint_names, len(cycle.legs) - 1
    documents = []
    for k, (leg, sampled) in enumerate(zip(cycle.legs, samples.legs, strict=True)):
        comments = [
            f"{k + 1} of {last + 1}: move {leg.name}",
            f"before it: {stop_text(leg.before)}",
        ]
        if k == last:
            comments.append(f"after it: {stop_text(cycle.after)}")
        if sampled.note is not None:
            comments.append(sampled.note)
        documents.append(trajectory_ros(names, sampled.samples, *comments))
    return "---\n".join(documents)


# ---- The formats.


def trajectory_json(trajectory: JointTrajectory, **more: Any) -> str:
    """Return a trajectory file.

    Args:
        trajectory: The trajectory.
        more: Further keys, such as `method`.
    """
    fields = {
        "format": TRAJECTORY_FORMAT,
        "version": TRAJECTORY_VERSION,
        "joint_names": list(trajectory.joint_names),
        "duration": trajectory.duration,
        "breakpoints": trajectory.breakpoints.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
        **more,
    }
    return json.dumps(fields, allow_nan=False) + "\n"


def trajectory_csv(
    joint_names: Sequence[str], samples: TrajectorySamples, effort: FloatArray | None = None
) -> str:
    """Return samples as CSV: time, positions, velocities, accelerations and, if known, efforts.

    Args:
        joint_names: In the order of the samples.
        samples: The samples.
        effort: At the samples, shape (N, n) [N m or N]; None: without effort columns.

    Raises:
        OutputError: A joint's name would be a formula to spreadsheets.
    """
    require_no_formula(joint_names)
    columns = {
        "position": samples.position,
        "velocity": samples.velocity,
        "acceleration": samples.acceleration,
    }
    if effort is not None:
        columns["effort"] = effort
    header = ["time"] + [f"{name}.{what}" for what in columns for name in joint_names]
    table = np.column_stack([samples.time, *columns.values()])
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerow(header)
    stream.writelines(",".join(map(repr, row)) + "\n" for row in table.tolist())
    return stream.getvalue()


def require_no_formula(joint_names: Sequence[str]) -> None:
    """Raise an error if spreadsheets take a joint's column for a formula.

    Raises:
        OutputError: A name begins as a formula does, which spreadsheets would run.
    """
    for name in joint_names:
        if name.lstrip().startswith(FORMULA_BEGINS):
            raise OutputError(
                f"CSV: the column of joint {shown(name)} would begin with '{name.lstrip()[0]}', "
                "a formula to spreadsheets; rename the joint, or write JSON or ROS"
            )


def trajectory_ros(joint_names: Sequence[str], samples: TrajectorySamples, *comments: str) -> str:
    """Return samples as a trajectory_msgs/JointTrajectory in YAML, without efforts.

    Args:
        joint_names: In the order of the samples.
        samples: The samples.
        comments: Sentences, written first as YAML comments.
    """
    lines = [f"# {comment}" for comment in comments]
    lines += ["joint_names:", *(f"- {json.dumps(name)}" for name in joint_names)]
    lines.append("points:")
    columns = (samples.time, samples.position, samples.velocity, samples.acceleration)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for time, position, velocity, acceleration in rows:
        lines.append(f"- positions: {_ros_list(position)}")
        lines.append(f"  velocities: {_ros_list(velocity)}")
        lines.append(f"  accelerations: {_ros_list(acceleration)}")
        seconds, rest = divmod(round(time * 1e9), 10**9)
        lines.append(f"  time_from_start: {{sec: {seconds}, nanosec: {rest}}}")
    return "\n".join(lines) + "\n"


def _ros_list(values: list[float]) -> str:
    # YAML 1.1 readers take 1e-05 for a string: a number needs its point.
    words = [repr(value) for value in values]
    words = [word if "." in word else word.replace("e", ".0e") for word in words]
    return "[" + ", ".join(words) + "]"
