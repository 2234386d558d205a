"""Motions written as JSON, CSV or ROS messages: the table of formats."""

import csv
import io
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import require_between
from tubeplanner.errors import OptionError, OutputError, shown
from tubeplanner.limits.process_stretches import all_marks
from tubeplanner.output.files.fingerprint import origin
from tubeplanner.task.legs import stop_text
from tubeplanner.task.motion import CycleMotion, Motion, ProblemMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import FORMULA_BEGINS
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.trajectory.parts import Mark
from tubeplanner.writing import require_writable, write_files

if TYPE_CHECKING:
    from tubeplanner.output.files.samples import MotionSamples

# ---- Files of a motion.

_RATE = 500.0  # [Hz]
_ROUNDING = 1e-9  # [s]


def require_rate(rate: float | None) -> None:
    """Raise OptionError unless a rate of samples [Hz], if any, is positive and finite."""
    if rate is not None:
        require_between(SimpleNamespace(rate=rate), 0, inf, "rate", unit="Hz")


@dataclass(frozen=True, eq=False)
class ExportedMotion:
    """A motion for files, which share its samples.

    Raises:
        TrajectoryError: When samples are first needed, if the rate makes too many.
    """

    # a trajectory without a problem has no efforts; its samples may exceed limits when joined
    motion: Motion | JointTrajectory
    method: str | None = None  # method of planning, for the JSON; None: not known
    # rate of samples [Hz]; None: a sample per period of the controller, 500 Hz without a period
    rate: float | None = None

    @property
    def trajectory(self) -> JointTrajectory:
        """The whole motion."""
        motion = self.motion
        return motion if isinstance(motion, JointTrajectory) else motion.trajectory

    @cached_property
    def samples(self) -> "MotionSamples | TrajectorySamples":
        """Samples of the motion or of the trajectory alone."""
        if isinstance(self.motion, JointTrajectory):
            return self.motion.sample(self.rate or _RATE)
        from tubeplanner.output.files.samples import motion_samples

        period = self.motion.task.period
        return motion_samples(self.motion, self.rate or (_RATE if period is None else 1 / period))

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the samples, if samples were needed."""
        samples = vars(self).get("samples")
        return () if samples is None or isinstance(samples, TrajectorySamples) else samples.notes


class Format(NamedTuple):
    """A format of motions."""

    kind: str  # noun for a file of it
    options: tuple[str, ...]  # of `plan`
    example: str  # an option with a value
    help: str  # of the options
    endings: tuple[str, ...]  # by which `JointTrajectory.save` chooses the format
    text: Callable[[ExportedMotion], str]  # function from a motion to the content of a file
    # function that raises if the format cannot hold the names of joints
    require_names: Callable[[Sequence[str]], None] = lambda names: None

    @property
    def parameter(self) -> str:
        """Name of the options' value in a command."""
        return self.options[-1].removeprefix("--")

    def content(self, exported: ExportedMotion, _: Path) -> bytes:
        """Return the content of a file."""
        return self.text(exported).encode()


def write_trajectory(
    path: str | Path,
    trajectory: JointTrajectory,
    problem: PlanningProblem | None = None,
    rate: float | None = None,
) -> tuple[str, ...]:
    """Write a trajectory, as `JointTrajectory.save` documents; return notes on samples."""
    if problem is None:
        return _write(path, trajectory, rate)
    if not isinstance(problem, PlanningProblem):
        raise OptionError(f"problem is {problem!r}; it must be PlanningProblem")
    return _write(path, ProblemMotion(problem, trajectory), rate)


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
    return _write(path, motion, rate)


def _write(
    path: str | Path, motion: Motion | JointTrajectory, rate: float | None
) -> tuple[str, ...]:
    path = Path(path)
    by_ending = {ending: each for each in FORMATS for ending in each.endings}
    if path.suffix.lower() not in by_ending:
        raise OutputError(
            f"output {path}: the suffix chooses the format; there is: {', '.join(by_ending)}"
        )
    require_rate(rate)
    require_writable([path])
    exported = ExportedMotion(motion, rate=rate)
    write_files({path: by_ending[path.suffix.lower()].content(exported, path)})
    return exported.notes


# ---- The formats.


def _json_text(exported: ExportedMotion) -> str:
    """Return the motion itself, with marks and origin."""
    motion, fields = exported.motion, dict[str, Any]()
    if not isinstance(motion, JointTrajectory):
        if marks := all_marks(motion.marks, motion.sections):
            fields["marks"] = [mark.as_dict() for mark in marks]
        fields |= origin(motion.task, exported.method)
    return trajectory_json(exported.trajectory, **fields)


def _csv_text(exported: ExportedMotion) -> str:
    """Return samples of sections and rests, with efforts of the arm as it is loaded then.

    Marks on the way are in a last column, each at the first sample that is not before it.
    """
    samples, names = exported.samples, exported.trajectory.joint_names
    if isinstance(samples, TrajectorySamples):
        return trajectory_csv(names, samples)
    return trajectory_csv(names, *samples.whole(), marks=samples.passed_marks)


def _ros_text(exported: ExportedMotion) -> str:
    """Return a message for every section, with comments on its moves, its marks and its rests."""
    samples, names = exported.samples, exported.trajectory.joint_names
    if isinstance(samples, TrajectorySamples):
        return trajectory_ros(names, samples)
    motion, documents = samples.motion, []
    marks, begins = samples.passed_marks, samples.begins
    last = len(samples.sections) - 1
    for k, (section, sampled) in enumerate(
        zip(motion.ended_sections, samples.sections, strict=True)
    ):
        comments = []
        if motion.marks:
            comments.append(f"{k + 1} of {last + 1}: move {', '.join(section.names)}")
            comments.append(f"before it: {stop_text(motion.stops[k])}")
            comments += [f"after it: {stop_text(motion.stops[-1])}"] * (k == last)
        if sampled.note is not None:
            comments.append(sampled.note)
        end = begins[k] + float(sampled.samples.time[-1])
        comments += [
            str(replace(mark, time=mark.time - begins[k]))
            for mark in marks
            if begins[k] <= mark.time <= end
        ]
        documents.append(trajectory_ros(names, sampled.samples, *comments))
    return "---\n".join(documents)


def trajectory_json(trajectory: JointTrajectory, **more: Any) -> str:
    """Return a trajectory file with further keys, such as `method`."""
    from tubeplanner.trajectory.reader import TRAJECTORY_FORMAT, TRAJECTORY_VERSION

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
    joint_names: Sequence[str],
    samples: TrajectorySamples,
    effort: FloatArray | None = None,
    *,
    marks: Sequence[Mark] = (),
) -> str:
    """Return samples as CSV: time, positions, velocities, accelerations and, if known, efforts.

    Marks, if any, are texts in a last column.

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
    writer = csv.writer(stream, lineterminator="\n")
    if not marks:
        writer.writerow(header)
        stream.writelines(",".join(map(repr, row)) + "\n" for row in table.tolist())
        return stream.getvalue()
    from tubeplanner.trajectory.reader import MARK_COLUMN

    texts = [""] * len(table)
    for mark in marks:
        row = min(int(np.searchsorted(samples.time, mark.time - _ROUNDING)), len(table) - 1)
        texts[row] += f"{'; ' * bool(texts[row])}{mark}"
    writer.writerow([*header, MARK_COLUMN])
    writer.writerows([*row, text] for row, text in zip(table.tolist(), texts, strict=True))
    return stream.getvalue()


def require_no_formula(joint_names: Sequence[str]) -> None:
    """Raise OutputError if a joint's name begins as a formula, which spreadsheets would run."""
    for name in joint_names:
        if name.lstrip().startswith(FORMULA_BEGINS):
            raise OutputError(
                f"CSV: the column of joint {shown(name)} would begin with '{name.lstrip()[0]}', "
                "a formula to spreadsheets; rename the joint, or write JSON or ROS"
            )


def trajectory_ros(joint_names: Sequence[str], samples: TrajectorySamples, *comments: str) -> str:
    """Return samples as a trajectory_msgs/JointTrajectory in YAML, without efforts."""
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


FORMATS = (
    Format(
        "trajectory",
        ("-o", "--output"),
        "-o T.json",
        "Trajectory file (JSON).",
        (".json",),
        _json_text,
    ),
    Format(
        "CSV",
        ("--csv",),
        "--csv",
        "Write samples (CSV).",
        (".csv",),
        _csv_text,
        require_no_formula,
    ),
    Format(
        "ROS",
        ("--ros",),
        "--ros",
        "Write samples (trajectory_msgs/JointTrajectory).",
        (".yaml", ".yml"),
        _ros_text,
    ),
)
