"""Trajectories written as our JSON, CSV or ROS: what `save` and the command line share."""

from dataclasses import dataclass
from math import inf
from pathlib import Path

from tubeplanner.constraints.motor_effort import motor_effort
from tubeplanner.errors import OptionError, OutputError
from tubeplanner.files.export import trajectory_csv, trajectory_json, trajectory_ros
from tubeplanner.files.export_samples import samples_for_export
from tubeplanner.files.origin import origin
from tubeplanner.files.output_files import require_writable, write_files
from tubeplanner.options import require_between
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples

_RATE = 500.0  # [Hz]
_FORMATS = {".json": "json", ".csv": "csv", ".yaml": "ros", ".yml": "ros"}


@dataclass(frozen=True)
class TrajectoryFiles:
    """The files that a trajectory is to be written to; None where one is not wanted.

    Attributes:
        json: The trajectory itself.
        csv: Its samples.
        ros: Its samples as trajectory_msgs/JointTrajectory, in YAML.
        rate: Of the samples [Hz]; None: one every period of the problem's controller, 500 Hz if
            that is not given.

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
        """Return what belongs into the files, and notes about it.

        Args:
            trajectory: What to write; if there is a problem, of its joints, in their order.
            problem: For hashes, efforts, and samples that keep the limits when joined; None: none
                of these.
            method: How the trajectory was made, for the JSON.

        Raises:
            TrajectoryError: The rate makes too many samples.
        """
        texts: dict[Path, str] = {}
        notes: tuple[str, ...] = ()
        if self.json is not None:
            more = {} if problem is None else origin(problem, method)
            texts[self.json] = trajectory_json(trajectory, **more)
        if self.csv is not None or self.ros is not None:
            samples, notes = self._samples(trajectory, problem)
        names = trajectory.joint_names
        if self.csv is not None:
            effort = None if problem is None else motor_effort(problem.robot, trajectory, samples)
            texts[self.csv] = trajectory_csv(names, samples, effort)
        if self.ros is not None:
            texts[self.ros] = trajectory_ros(names, samples, *notes)
        return {path: text.encode() for path, text in texts.items()}, notes

    def sample_rate(self, period: float | None) -> float:
        """Return the rate of the samples [Hz], for a controller's period [s] or none."""
        return self.rate or (_RATE if period is None else 1 / period)

    def _samples(
        self, trajectory: JointTrajectory, problem: PlanningProblem | None
    ) -> tuple[TrajectorySamples, tuple[str, ...]]:
        rate = self.sample_rate(None if problem is None else problem.period)
        if problem is None:
            return trajectory.sample(rate), ()
        sampled = samples_for_export(problem, trajectory, rate)
        return sampled.samples, () if sampled.note is None else (sampled.note,)


def files_at(path: str | Path, rate: float | None = None) -> TrajectoryFiles:
    """Return the one file at a path, in the format that its ending chooses.

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
