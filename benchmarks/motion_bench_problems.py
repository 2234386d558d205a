"""Problems of the public MotionBenchMaker, and what becomes of each; worker processes import it."""

import json
import time
from dataclasses import dataclass, replace
from pathlib import Path

from journals import Fields
from tubeplanner.errors import TubePlannerError
from tubeplanner.limits.lower_bound import lower_bound
from tubeplanner.native.library import LIBRARY
from tubeplanner.orientation import quaternion_of_matrix
from tubeplanner.outcome import Progress
from tubeplanner.output.files.new_problem_files import (
    imported_problem,
    read_cell,
    scene_and_request,
    tool_frame_of,
)
from tubeplanner.studies.tubes.planned_tube import TubeAnswer
from tubeplanner.studies.tubes.route import RouteOptions, find_route
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_reader import parse_problem

ROBOTS = ("panda", "ur5")
_UR5 = {"velocity": [3.15] * 3 + [3.2] * 3, "acceleration": 12.0, "jerk": 500.0}
_PANDA = {"acceleration": 15.0, "jerk": 500.0}
LIMITS: dict[str, dict[str, Fields]] = {
    "curobo": {"panda": _PANDA, "ur5": _UR5},
    "moveit": {"panda": {**_PANDA, "velocity": [2.175] * 4 + [2.61] * 3}, "ur5": _UR5},
}
ANYWHERE = 1e4  # radius of a tube that allows all [m]


@dataclass(frozen=True)
class Options:
    """What is asked of every problem.

    Attributes:
        folders: Of ROBOT.urdf, and of the sets of problems, by robot.
        limits: A key of `LIMITS`.
        poses: Whether goals are poses.
        carry: Payload at the tool [kg].
        shrink: How much narrower position limits are, at either end [rad].
        seed: Of the search.
        keep: Where problem and trajectory files are written.
    """

    folders: dict[str, tuple[Path, Path]]
    limits: str = "curobo"
    poses: bool = False
    carry: float = 0.0
    shrink: float = 0.0
    seed: int = 1
    keep: Path | None = None

    @property
    def variant(self) -> str:
        """What differs from joint goals with cuRobo's limits, in words."""
        words = ["goals as poses" if self.poses else "goals as joints"]
        words += [f"limits of {self.limits}"] * (self.limits != "curobo")
        words += [f"{self.carry:g} kg at the tool"] * bool(self.carry)
        words += [f"position limits {self.shrink:g} rad narrower"] * bool(self.shrink)
        return ", ".join(words)


def problem_of(name: str, options: Options) -> tuple[Fields, PlanningProblem]:
    """Return the fields of the problem file of ROBOT/SET/NUMBER, and the problem."""
    robot, kind, number = name.split("/")
    source, folder = options.folders[robot]
    folder = folder / f"{kind}_{robot}"
    files = [folder / f"scene{number}.yaml", folder / f"request{number}.yaml"]
    scene, request = scene_and_request(files)
    urdf, srdf = (str(source / f"{robot}.{ending}") for ending in ("urdf", "srdf"))
    cell = read_cell(urdf, tool_frame_of(request, srdf), None, None, None, srdf)
    more: Fields = {"limits": dict(LIMITS[options.limits][robot])}
    if options.carry:
        more["payload"] = {"mass": options.carry}
    for fields in (cell.fields, cell.merged):
        fields["robot"] |= more
        fields["objective"] = {"slack": 0.0}
    problem, _ = imported_problem(cell, scene, request, name)
    fields = json.loads(json.dumps(cell.fields))  # plain maps and lists
    if options.shrink:
        fields["robot"]["limits"]["position_margin"] = options.shrink
    if options.poses:
        fields["goal"] = {"pose": _pose_of_goal(problem)}
    if options.shrink or options.poses:
        problem = parse_problem(fields, cell.folder, name, reads_tube=False)
    return fields, problem


def examine(task: str, options: Options) -> Fields:
    """Return the line of a problem: what became of it, durations [s], processor times [s]."""
    name = task.partition(" ")[0]
    robot, kind, number = name.split("/")
    line: Fields = {"problem": task, "robot": robot, "set": kind, "number": int(number)}
    line |= {"variant": options.variant, "build": LIBRARY.build}
    begun = time.process_time()
    try:
        fields, problem = problem_of(name, options)
    except TubePlannerError as error:
        return {**line, "status": "bad_input", "message": str(error)}
    line["loading"] = time.process_time() - begun
    answers: list[tuple[float, float]] = []  # processor time and duration, as they come

    def note(progress: Progress) -> None:
        best = progress.best_duration
        if best is not None and (not answers or best < answers[-1][1]):
            answers.append((time.process_time() - begun, best))

    begun = time.process_time()
    try:
        answer = find_route(problem, RouteOptions(seed=options.seed), note)
    except TubePlannerError as error:
        return {**line, "status": "bad_input", "message": str(error)}
    total = time.process_time() - begun
    line |= {"status": str(answer.status), "message": answer.message, "total": total}
    if answer.answer is None:
        return line
    report = answer.as_dict()
    first = answers[0] if answers else (total, answer.answer.duration)
    bound = lower_bound(problem)  # without a tube: that of the answer's may be larger
    trajectory = answer.answer.result.trajectory
    assert trajectory is not None
    if options.poses:
        line["bound_of_pose"] = bound.duration
        bound = lower_bound(replace(problem, goal=trajectory.position(trajectory.duration)))
    line |= {"duration": answer.answer.duration, "bound": bound.duration or None}
    line["decides"] = bound.reason
    line |= {"first": first[0], "first_duration": first[1]}
    line["certified"] = report["certificate"]["passed"]
    if options.keep is not None:
        folder = options.variant.replace(",", "").replace(" ", "_")
        keep(fields, problem, answer, options.keep / folder / name)
    return line


def keep(fields: Fields, problem: PlanningProblem, answer: TubeAnswer, stem: Path) -> None:
    """Write the files STEM.json, the problem in the widest tube, and STEM.trajectory.json."""
    assert answer.answer is not None
    stem.parent.mkdir(parents=True, exist_ok=True)
    tube = {"points": problem.tube.points.tolist(), "radius": ANYWHERE}
    judged = {key: value for key, value in fields.items() if key != "objective"}
    stem.with_suffix(".json").write_text(json.dumps({**judged, "tube": tube}, indent=1))
    trajectory = answer.answer.result.trajectory
    assert trajectory is not None
    trajectory.save(stem.with_suffix(".trajectory.json"))


def _pose_of_goal(problem: PlanningProblem) -> Fields:
    """Return the pose of the tool at a problem's goal, as fields."""
    q = problem.endpoints[1].joints
    assert q is not None
    rotation, position = problem.robot.tool_pose(q[None])
    quaternion = quaternion_of_matrix(rotation[0])
    return {"position": position[0].tolist(), "quaternion": quaternion.tolist()}
