"""The motion of a cycle written as our JSON, CSV or ROS."""

from pathlib import Path
from typing import Any

from tubeplanner import __version__
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.cycle.step_text import rest_text
from tubeplanner.files.cycle_fingerprint import cycle_hash, cycle_part_hashes
from tubeplanner.files.cycle_samples import CycleSamples, cycle_samples
from tubeplanner.files.export import trajectory_csv, trajectory_json, trajectory_ros
from tubeplanner.files.fingerprint import robot_hash
from tubeplanner.files.output_files import require_writable, write_files
from tubeplanner.files.trajectory_writer import TrajectoryFiles, files_at


def write_cycle_motion(
    path: str | Path, motion: CycleMotion, rate: float | None = None
) -> tuple[str, ...]:
    """Write the motion of a cycle to a file; its ending chooses the format.

    Args:
        path: `.json` (with marks, for `read_cycle_motion`), `.csv`, or `.yaml` (ROS, one message
            for every stretch without a stop); replaced as a whole or not at all.
        motion: As in the result of `plan_cycle`.
        rate: Of samples [Hz]; None: one every period of the cycle's controller, or 500.

    Returns:
        Notes about the samples.

    Raises:
        OutputError: It cannot be written, or the ending is unknown.
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
    """Return what belongs into the files of a cycle's motion, and notes about it.

    The JSON has all of it, with marks. CSV has samples of all, rests included, and efforts with
    what is carried then. ROS has a message for every leg, as YAML documents.

    Args:
        files: Which ones.
        motion: A certified answer.
        method: How it was made, for the JSON; None: not known.

    Raises:
        TrajectoryError: The rate makes too many samples.
    """
    texts: dict[Path, str] = {}
    notes: tuple[str, ...] = ()
    if files.json is not None:
        marks = [mark.as_dict() for mark in motion.marks]
        texts[files.json] = trajectory_json(
            motion.trajectory, marks=marks, **_origin(motion, method)
        )
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
    """Return a message for every leg, each with comments on its moves and the rests beside it."""
    cycle = samples.motion.cycle
    names, last = cycle.robot.joint_names, len(cycle.legs) - 1
    documents = []
    for k, (leg, sampled) in enumerate(zip(cycle.legs, samples.legs, strict=True)):
        comments = [
            f"{k + 1} of {last + 1}: move {leg.name}",
            f"before it: {rest_text(leg.before)}",
        ]
        if k == last:
            comments.append(f"after it: {rest_text(cycle.after)}")
        if sampled.note is not None:
            comments.append(sampled.note)
        documents.append(trajectory_ros(names, sampled.samples, *comments))
    return "---\n".join(documents)
