"""Contents and gaps of a robot, problem or cycle; `links`: collision shapes of links."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.markup import escape
from rich.table import Table

from tubeplanner.cli import console
from tubeplanner.cli.report import new_table, rendered
from tubeplanner.errors import OptionError, RobotError
from tubeplanner.geometry.collision_checker import LinkCover, link_covers
from tubeplanner.geometry.link_geometry import link_contents
from tubeplanner.geometry.solids import AttachedSolid, Obstacle, open_meshes
from tubeplanner.geometry.tube.points import SEGMENT_NUMBERS
from tubeplanner.output.figures.figure_files import FIGURE_ENDINGS, figure_file
from tubeplanner.resources import EXAMPLE_PREFIX
from tubeplanner.robot.info import (
    INFO_LIMITS,
    JointInfo,
    LinkInfo,
    OtherJoint,
    RobotInfo,
    SourcedValue,
    robot_info,
)
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.cycle_file import is_cycle_file
from tubeplanner.task.endpoints import Endpoint
from tubeplanner.task.holding import Holding
from tubeplanner.task.info import SrdfInfo, TaskInfo, cycle_info, problem_info, with_doubts
from tubeplanner.task.legs import Stop, stop_text
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Attach

_PROBLEM_ENDINGS = (".yaml", ".yml", ".json")
_TABLED = ("position", "velocity", "effort", "acceleration", "jerk")
_MAX_NAMES = 12  # joints or links in a line


def describe(
    robot: str,
    *,
    tool_frame: str | None,
    package_dirs: tuple[str, ...],
    xacro_args: dict[str, str],
    plot: Path | None,
    changes: dict[str, Any],
    as_json: bool,
) -> None:
    """Print the contents of a robot, problem or cycle by the options of `info`."""
    files = console.OutputFiles(
        console.Request("plot", plot, "--plot", FIGURE_ENDINGS), inputs=[robot]
    )
    with console.shown_progress() as enter:
        enter("reading robot")
        if is_problem(robot):
            if package_dirs:
                raise OptionError("--package-dir is for a URDF; a problem has robot.package_dirs")
            if xacro_args:
                raise OptionError("--xacro-arg is for a URDF; a problem has robot.xacro_args")
            frame = {} if tool_frame is None else {"robot.tool_frame": tool_frame}
            read = cycle_info if is_cycle_file(robot) else problem_info
            contents: RobotInfo | TaskInfo = read(robot, changes | frame)
        else:
            if changes:
                raise OptionError(f"--set changes a problem file; {robot} is a robot")
            sources: dict[str, Any] = {"package_dirs": package_dirs, "xacro_args": xacro_args}
            contents = with_doubts(robot_info(robot, tool_frame, **sources))
        enter("meshes")
        meshes, fault = _open_meshes(contents)
        if plot is not None:
            from tubeplanner.output.figures.robot_figure import plot_robot
            from tubeplanner.output.link_visuals import solids_at_tool
            from tubeplanner.studies.tubes.starter_problem import shown_configuration

            enter("picture")
            arm = contents.arm if isinstance(contents, RobotInfo) else contents.robot.arm
            problem = None if isinstance(contents, RobotInfo) else contents.problem

            def drawn(path: Path) -> bytes:
                solids = () if problem is None else (problem.obstacles, solids_at_tool(problem))
                figure = plot_robot(arm, shown_configuration(arm, problem), None, *solids)
                picture = figure_file(figure, path)
                enter("writing")
                return picture

            files.write({"plot": drawn}, is_held=False)
    if as_json:
        fields = _finite(contents.as_dict())
        message = f"{fields['name']}: {len(fields['missing'])} things missing"
        report = console.empty_report("success", message)
        more = {"open_meshes": meshes, "plot": files.path_text("plot")}
        console.print_json({**report, **fields, **more})
        return
    text = task_text(contents) if isinstance(contents, TaskInfo) else robot_text(contents)
    console.say(text)
    for note in [*_open_mesh_notes(meshes), *fault]:
        console.say(f"note: {note}")
    if files.written:
        files.say()


def is_problem(name: str) -> bool:
    """Return True if a name is a problem's, False if a robot's."""
    if name.startswith(EXAMPLE_PREFIX):
        return "/" in name
    return Path(name).suffix.lower() in _PROBLEM_ENDINGS


def _finite(value: Any) -> Any:
    """Return JSON values with None in place of infinite numbers."""
    if isinstance(value, Mapping):
        return {str(key): _finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def robot_text(info: RobotInfo) -> str:
    """Return the contents of a robot as text."""
    frame = info.tool_frame
    choice = "" if info.tool_frame_is_given else ", the end of the longest chain"
    lines = [
        f"{info.name}: {len(info.joints)} joints to {frame}{choice}",
        f"URDF: {info.path}",
        _joint_table(info.joints),
        "units: rad and m, N m and N, s",
        *_source_lines(info.joints),
        *(
            f"motor of {joint.name}: "
            + ", ".join(f"{what} {_limit(v)} ({v.source})" for what, v in joint.motor.items())
            for joint in info.joints
            if joint.motor
        ),
        *_other_joint_lines(info.other_joints),
        *_link_table(info.links),
        f"mass of all links: {info.mass:.4g} kg",
        *_links_without(info.links),
        *_frame_lines(info),
        *_base_lines(info),
        *(f"note: {note}" for note in info.notes),
        "missing:" if info.missing else "nothing is missing: it can be planned",
        *(f"  {each}" for each in info.missing),
    ]
    return "\n".join(lines)


def _joint_table(joints: Sequence[JointInfo]) -> str:
    limited = [f">{quantity}" for quantity in _TABLED]
    table = new_table("joints, in the order of the chain", "joint", "type", "parent", *limited)
    for joint in joints:
        limits = [_limit(joint.limits[quantity]) for quantity in _TABLED]
        table.add_row(escape(joint.name), joint.type, escape(joint.parent), *limits)
    return rendered(table)


def _limit(limit: SourcedValue) -> str:
    if limit.is_missing:
        return "-"
    if limit.value is None:
        return "endless"
    if isinstance(limit.value, tuple):
        return " to ".join(f"{bound:.4g}" for bound in limit.value)
    return f"{limit.value:.4g}"


def _source_lines(joints: Sequence[JointInfo]) -> list[str]:
    """Return the sources of the limits, a line for each quantity."""
    lines = []
    for quantity in INFO_LIMITS:
        by_source: dict[str, list[str]] = defaultdict(list)
        for joint in joints:
            by_source[joint.limits[quantity].source].append(joint.name)
        if quantity in _TABLED or list(by_source) != ["none"]:
            sources = list(by_source)
            if len(sources) > 1:
                sources = [f"{source} ({_listed(own)})" for source, own in by_source.items()]
            lines.append(f"{quantity} from: {'; '.join(sources)}")
    return lines


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MAX_NAMES
    listed = ", ".join(names[:_MAX_NAMES])
    return listed if more <= 0 else f"{listed} and {more} more"


def _other_joint_lines(others: Sequence[OtherJoint]) -> list[str]:
    """Return the joints that are not planned, a line for each follower and each locked value."""
    lines, locked = [], defaultdict(list)
    for joint in others:
        if joint.follows is None:
            locked[joint.position].append(joint.name)
        else:
            rule = f"{joint.multiplier:g} times {joint.follows}"
            offset = f" plus {joint.position:g}" if joint.position else ""
            lines.append(f"{joint.name} follows: {rule}{offset}")
    lines += [f"locked at {position:g}: {_listed(names)}" for position, names in locked.items()]
    return lines


def _link_table(links: Sequence[LinkInfo]) -> list[str]:
    """Return the links with mass or geometry as a table; no line if there is no link."""
    headings = ("link", ">mass [kg]", "collision geometry", "visual geometry")
    table = new_table("links with mass or geometry", *headings)
    for link in links:
        if link.mass is not None or link.collision or link.visual:
            mass = "-" if link.mass is None else f"{link.mass:.4g}"
            kinds = [_kinds(link.collision), _kinds(link.visual)]
            table.add_row(escape(link.name), mass, *kinds)
    return [rendered(table)] * bool(table.rows)


def _kinds(counts: Mapping[str, int]) -> str:
    each = [kind if count == 1 else f"{count} x {kind}" for kind, count in counts.items()]
    return ", ".join(each) or "-"


def _links_without(links: Sequence[LinkInfo]) -> list[str]:
    solid = [link for link in links if link.collision or link.visual]
    weightless = [link.name for link in solid if not link.mass]
    unchecked = [link.name for link in links if link.mass and not link.collision]
    lines = [f"with geometry and no mass: {_listed(weightless)}"] if weightless else []
    if unchecked:
        lines.append(f"with mass and no collision geometry, never checked: {_listed(unchecked)}")
    return lines


def _open_meshes(
    contents: RobotInfo | TaskInfo,
) -> tuple[dict[str, dict[str, int]], list[str]]:
    """Return the open meshes of links and solids, and the fault of a mesh that cannot be read."""
    solids: list[Obstacle | AttachedSolid] = []
    robot = contents if isinstance(contents, RobotInfo) else contents.robot
    if not isinstance(contents, RobotInfo) and (problem := contents.problem) is not None:
        solids += [*problem.obstacles, *problem.attached]
    if isinstance(contents, TaskInfo) and isinstance(contents.task, Cycle):
        attached = [step.solid for step in contents.task.steps if isinstance(step, Attach)]
        solids += [solid for solid in attached if solid is not None]
    try:
        return open_meshes(link_contents(robot.arm), solids), []
    except RobotError as error:
        is_listed = any(str(error) in each for each in robot.missing)
        return open_meshes({}, solids), [] if is_listed else [str(error)]


def _open_mesh_notes(meshes: Mapping[str, Mapping[str, int]]) -> list[str]:
    named = [
        f"{name} ({file}, {count} edges)"
        for name, files in meshes.items()
        for file, count in files.items()
    ]
    note = (
        "meshes with edges that are open or wound both ways; their openings count as solid, and "
        f"what is only inside of them does not touch them; export them closed: {_listed(named)}"
    )
    return [note] * bool(named)


def _frame_lines(info: RobotInfo) -> list[str]:
    leaves = [name for name in info.leaf_links if name != info.tool_frame]
    inner = [link.name for link in info.links if not link.is_leaf and link.name != info.tool_frame]
    choice = "given" if info.tool_frame_is_given else "choose another by --tool-frame"
    return [
        f"tool_frame: {info.tool_frame} ({choice})",
        *([f"other ends of chains: {', '.join(leaves)}"] if leaves else []),
        *([f"inner links: {', '.join(inner)}"] if inner else []),
    ]


def _base_lines(info: RobotInfo) -> list[str]:
    base = info.arm.base
    if base is None:
        return []
    rotation = "not turned"
    if base.rpy is not None:
        rotation = f"rpy {_numbers(base.rpy)} rad"
    elif base.quaternion is not None:
        rotation = f"quaternion {_numbers(base.quaternion)}"
    return [f"base: {info.arm.urdf.root} stands at {_numbers(base.position)} m, {rotation}"]


# ---- The contents of a problem, as text.


def task_text(info: TaskInfo) -> str:
    """Return the contents of a problem or a cycle as text."""
    lines = [robot_text(info.robot)]
    if info.srdf is not None:
        lines += srdf_lines(info.srdf)
    if isinstance(info.task, Cycle):
        lines += _cycle_lines(info.task)
    elif info.task is not None:
        lines += _task_lines(info.task)
    if info.refused is not None:
        lines.append(f"the {info.kind} does not load: {info.refused}")
    return "\n".join(lines)


def srdf_lines(srdf: SrdfInfo) -> list[str]:
    """Return the named configurations of an SRDF, and its number of pairs that may touch."""
    states = [
        f"state {name}: " + ", ".join(f"{joint} {q:.4g}" for joint, q in values.items())
        for name, values in srdf.states.items()
    ]
    return [*states, f"SRDF: {len(srdf.disabled_pairs)} pairs of links may touch"]


def _task_lines(problem: PlanningProblem) -> list[str]:
    """Return start, tube, solids and payload of a problem."""
    payload = problem.robot.payload
    lines = [f"problem {problem.name}:", end_line(problem, "start", problem.endpoints[0])]
    lines.append(
        "goal: open" if problem.goal is None else end_line(problem, "goal", problem.endpoints[1])
    )
    route = problem.tube.route
    if route is None:
        lines.append(_segment_table(problem))
    else:
        lines.append(f"route of {len(route)} configurations; the tool may be anywhere")
    lines += [f"obstacle {bare(solid)}" for solid in problem.obstacles] or ["no obstacles"]
    lines += [f"attached {bare(solid)}" for solid in problem.attached]
    if problem.clearance:
        lines.append(f"clearance: {problem.clearance:g} m")
    for links, clearance in problem.pair_clearances.items():
        lines.append(f"clearance of {' and '.join(links)}: {clearance:g} m")
    for contact in problem.contacts:
        names, ends = " and ".join(contact.links), " and ".join(contact.ends)
        lines.append(f"contact at {ends}: {names}, within {contact.within:g} m")
    if payload is not None:
        lines.append(f"payload: {payload.mass:g} kg at {list(payload.com)} m of the tool frame")
    return lines + [f"holding: {_held_text(each)}" for each in problem.holding]


def _held_text(holding: Holding) -> str:
    """Return kind and numbers of what holds a part, and the part's mass."""
    numbers = {key: np.ravel(value) for key, value in vars(holding.contact).items()}
    text = ", ".join(f"{key} {' '.join(f'{x:g}' for x in row)}" for key, row in numbers.items())
    mass = holding.mass_properties.mass
    return f"{holding.kind} ({text})" + (f": {mass:g} kg" if holding.kind != "liquid" else "")


def bare(solid: object) -> str:
    """Return the repr of a solid without its type."""
    return repr(solid).strip("<>").split(" ", 1)[1]


def end_line(problem: PlanningProblem, name: str, end: Endpoint) -> str:
    """Return the start or the goal of a problem, behind its name."""
    if (pose := end.pose) is not None:
        return f"{name}: by inverse kinematics, tool centre point at {_numbers(pose.position)} m"
    if (ball := end.region) is not None:
        return f"{name}: the tool within {ball.tolerance:g} m of {_numbers(ball.position)} m"
    if end.joints is None:
        return f"{name}: by inverse kinematics from {_numbers(end.seed)}"
    tool = problem.robot.tool_position(end.joints)
    return f"{name}: joints {_numbers(end.joints)}, tool centre point at {_numbers(tool)} m"


def _numbers(values: Any) -> str:
    return "[" + ", ".join(f"{value + 0.0:.4g}" for value in values) + "]"


def _segment_table(problem: PlanningProblem) -> str:
    tube = problem.tube
    headings = (">segment", ">from", ">to", ">length", ">radius", "what else")
    table = new_table("segments of the tube, in m and rad", *headings)
    for k in range(tube.segment_count):
        ends = tube.points[k : k + 2]
        length = float(np.linalg.norm(ends[1] - ends[0]))
        radius = "box" if tube.is_box[k] else f"{tube.radius[k]:g}"
        row = [str(tube.segment_number(k)), *map(_numbers, ends), f"{length:.4g}", radius]
        table.add_row(*row, escape(_conditions(problem, k)))
    return rendered(table)


def _conditions(problem: PlanningProblem, k: int) -> str:
    """Return the conditions of a segment beside its radius."""
    tube, parts = problem.tube, []
    if tube.rotation is not None and np.isfinite(tube.rotation.bounds[k]).any():
        *axes, angle = (f"{bound:.4g}" for bound in tube.rotation.bounds[k])
        within = f"[{', '.join(axes).replace('inf', 'free')}]" if angle == "inf" else angle
        parts.append(f"rotation within {within}")
    for name in SEGMENT_NUMBERS:
        values = getattr(tube, name)
        if values is not None and np.isfinite(values[k]):
            parts.append(f"{name.replace('_', ' ')} {values[k]:g}")
    parts += [f"{name} {_range(*bounds)}" for name, bounds in tube.joint_ranges[k].items()]
    return "; ".join(parts)


def _range(lower: float, upper: float) -> str:
    if np.isinf(upper):
        return f">= {lower:.4g}"
    return f"<= {upper:.4g}" if np.isinf(lower) else f"in [{lower:.4g}, {upper:.4g}]"


def _cycle_lines(cycle: Cycle) -> list[str]:
    """Return start, moves, rests and solids of a cycle."""
    ends = "ends where it begins" if cycle.closed else "ends where its last move does"
    moves = sum(len(leg.moves) for leg in cycle.legs)
    first = cycle.problem_from_anywhere(0)
    legs = f"{len(cycle.legs)} legs (each without a stop)"
    return [
        f"cycle {cycle.name}: {moves} moves in {legs}; {ends}",
        end_line(first, "start", cycle.endpoint),
        _step_table(cycle),
        *([f"obstacle {bare(solid)}" for solid in cycle.obstacles] or ["no obstacles"]),
        *(f"attached {bare(solid)}" for solid in cycle.attached),
        *([] if cycle.period is None else [f"period: {cycle.period:g} s"]),
    ]


def _step_table(cycle: Cycle) -> str:
    headings = ("what", ">segments", ">length", "ends", "carries")
    table = new_table("moves and what happens between them", *headings)
    for k, leg in enumerate(cycle.legs):
        _add_stop(table, leg.before)
        for move in leg.moves:
            length = np.linalg.norm(np.diff(move.tube.points, axis=0), axis=1).sum()
            cells = (escape(move.name), str(move.tube.numbers[-1]), f"{length:.4g} m")
            if move.tube.is_anywhere:
                cells = (cells[0], "no tube", "")
            ends = "in a given configuration"
            if move.ends_openly:
                closes = cycle.closed and move is cycle.legs[-1].moves[-1]
                ends = "as the cycle begins" if closes else "in any configuration"
            payload, solids = leg.robot.payload, cycle.problem_from_anywhere(k).attached
            carried = [] if payload is None else [f"{payload.mass:g} kg"]
            carried += [solid.name for solid in solids]
            carried += [f"by {holding.kind}" for holding in leg.holding]
            table.add_row(*cells, ends, escape(", ".join(carried) or "nothing"))
    _add_stop(table, cycle.after)
    return rendered(table)


def _add_stop(table: Table, stop: Stop) -> None:
    if stop.steps:
        table.add_row(escape(f"at rest: {stop_text(stop)}"), "", "", "", "")


# ---- The collision shapes of links.


@click.command()
@click.argument("problem")
@console.SET
@console.AS_JSON
def links(problem: str, changes: dict[str, Any], as_json: bool) -> None:
    """List each link's collision shapes and their distance from its geometry [mm].

    Then list the pairs of links and obstacles that are not checked, with the reasons.
    """
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_timed(problem, enter, changes)
        enter("covers of links")
        covers = link_covers(loaded.collision)
    left_out = loaded.collision.left_out
    if as_json:
        message = f"{len(covers)} links, {len(left_out)} pairs left out"
        fields = console.empty_report("success", message) | {"loading_time": loading_time}
        listed = {"links": [asdict(each) for each in covers]}
        console.print_json({**fields, **listed, "left_out": [asdict(pair) for pair in left_out]})
        return
    console.say(links_text(loaded, covers))


def links_text(problem: PlanningProblem, covers: Sequence[LinkCover]) -> str:
    """Return the cover errors of links as a table, and the pairs that are not checked."""
    headings = ("link", ">shapes", ">stand off by", ">where others come near", ">by")
    table = new_table(f"{problem.name}: links and their convex covers", *headings)
    for each in covers:
        closer = ("", "")
        if each.closer_error is not None:
            closer = (str(each.closer_shapes), f"{1000 * each.closer_error:.2f} mm")
        error = f"{1000 * each.outer_error:.2f} mm"
        table.add_row(escape(each.link), str(each.shapes), error, *closer)
    pairs = [
        f"not checked: {' and '.join(pair.links)} ({pair.reason})"
        for pair in problem.collision.left_out
    ]
    return "\n".join([rendered(table), *pairs])
