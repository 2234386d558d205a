"""Panel of a page: curves, time line, titles, layers, notes, verdict.

A motion consists of sections, each judged under a problem of its own: a single one, or the legs of
a cycle. Quantities of sections are null between sections. Fractions are whole percent, distances
tenths of a millimetre: the resolution of a curve.
"""

import os
import time as clock
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner import __version__
from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.certificate.judged_motion import FOR_ALL_TIMES
from tubeplanner.certificate.verification import Certificate, CycleCertificate
from tubeplanner.limits.binding_limits import (
    LINKS,
    POSITION,
    TOOL,
    ClosestPairs,
    binding_rows,
    closest_pairs,
)
from tubeplanner.limits.lower_bound import lower_bound
from tubeplanner.limits.peaks import trajectory_peaks
from tubeplanner.limits.process_stretches import passed_marks
from tubeplanner.limits.rates import ToolSpeed
from tubeplanner.output import drawing
from tubeplanner.output.curves import (
    LimitedSection,
    cycle_timeline,
    held_contacts,
    segments_per_group,
    size_of,
)
from tubeplanner.output.link_visuals import solids_at_tool
from tubeplanner.output.page.motion_scene import POINTER
from tubeplanner.output.page.scene import Layer, Scene, ShownTrajectory, handed_over
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.holding import GRAVITY
from tubeplanner.task.motion import CycleMotion, Motion, Task
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Move
from tubeplanner.text import LimitCost, savings
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- The text of the panel: titles, durations, layers with their colours, notes.

_MAX_SEGMENTS_NAMED = 6
_CURVE_STEPS = 400
_HIDDEN = (Layer.AXES, Layer.SWEPT)  # when the page opens
_USUAL_ENTRIES = {
    Layer.AXES: [{"color": color, "text": ""} for color in drawing.AXIS_COLORS],
    Layer.ROTATION: [{"color": drawing.CONE_COLOR, "text": ""}],
    Layer.HOLDING: [{"color": drawing.HOLDING_COLOR, "text": ""}],
    Layer.CARRIED: [{"color": drawing.CARRIED_COLOR, "text": ""}],
    Layer.OBSTACLES: [{"color": drawing.OBSTACLE_COLOR, "text": ""}],
    Layer.SWEPT: [{"color": drawing.SWEPT_COLOR, "text": ""}],
    Layer.BLOCKED: [{"color": drawing.BLOCKED_COLOR, "text": ""}],
    Layer.EXECUTED: [
        {"color": drawing.EXECUTED_COLOR, "text": "in the tube"},
        {"color": drawing.WARNING_COLOR, "text": "outside"},
    ],
}


def panel_data(scene: Scene) -> dict[str, Any]:
    """Return the panel of a page and the frame of its scene, as JSON values."""
    task, moved = scene.task, handed_over(scene.task)
    standing = [each.name for each in task.obstacles if each.name not in moved]
    at_tool = task.attached if isinstance(task, Cycle) else solids_at_tool(task)
    words = {
        Layer.CARRIED: _listed("Carried", [*(each.name for each in at_tool), *moved]),
        Layer.OBSTACLES: _listed("Obstacles", standing),
    }
    about = f"{task.robot.name}, {task.robot.joint_count} joints"
    if isinstance(task, Cycle):
        moves = [move for leg in task.legs for move in leg.moves]
        balls = any(drawing.goal_ball(move.endpoint) for move in moves)
        kind = "closed cycle" if task.closed else "cycle"
        about += f"; {kind} of {len(moves)} move{'s' * (len(moves) > 1)}"
        words[Layer.TUBE] = "Tubes of the moves (radius): the tool must stay inside"
        words[Layer.REFERENCE] = "Reference paths" + ", goals' balls" * balls
        entries = _move_entries(scene, moves)
    else:
        balls = len(drawing.goal_ball(task.endpoints[1])) > 0
        line = "Goal of the tool" if task.tube.is_anywhere else "Reference path"
        words[Layer.TUBE] = "Tube: the tool must stay inside"
        words[Layer.REFERENCE] = line + ", goal's ball" * balls
        entries = _segment_entries(task)
    layers = [_layer_data(layer, scene, words, {Layer.TUBE: entries}) for layer in scene.layers]
    timelines = [
        motion_timeline(motion, sections, scene.duration)
        for motion, sections in zip(scene.motions, scene.sections, strict=True)
    ]
    return {**_page_data(scene, about, layers), "timelines": timelines}


def _page_data(scene: Scene, about: str, layers: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the text of a page's overlay and the frame of its scene, as JSON values."""
    many = len(scene.trajectories) > 1
    trajectories = [
        {**_trajectory_data(trajectory), "color": drawing.LINE_COLORS[i % len(drawing.LINE_COLORS)]}
        for i, trajectory in enumerate(scene.trajectories)
    ]
    for sections, trajectory in zip(scene.sections, trajectories, strict=False):
        steps = np.linspace(0.0, trajectory["duration"], _CURVE_STEPS)
        trajectory |= page_curves(sections, steps)
    frame = scene.frame
    labels = [
        {
            "text": f"{trajectory['name']}: {trajectory['lasts']}",
            "point": (frame.top + i * frame.offset).tolist(),
        }
        for i, trajectory in enumerate(trajectories)
    ]
    where = scene.trajectories[0].name
    moving = "" if scene.duration > 0 else f"The arm {where}; no trajectory is shown. "
    return {
        "title": scene.name,
        "about": about,
        "hint": f"{moving}Grid: {frame.floor_step:g} m. Drag to turn, scroll to zoom, right button "
        "to shift.",
        "duration": scene.duration,
        "trajectories": trajectories,
        "timelines": [],
        "facts": [],
        "labels": labels if many else None,
        "layers": [*layers, *_moving_layers(scene, trajectories)],
        "offset": frame.offset.round(5).tolist(),
        "thickness": round(scene.thickness, 5),
        "notes": list(scene.notes),
        "direction": frame.direction.tolist(),
        "outline": frame.outline.round(5).tolist(),
    }


def _moving_layers(scene: Scene, trajectories: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the layers that the page itself draws of moving arms."""
    ghosts = {
        "name": "ghosts",
        "label": "Arm at start, at end",
        "entries": [
            {"color": drawing.START_COLOR, "text": ""},
            {"color": drawing.END_COLOR, "text": ""},
        ],
        "visible": False,
    }
    closest = {
        "name": "closest",
        "label": "Closest pair and its distance",
        "entries": [{"color": drawing.CLOSEST_COLOR, "text": ""}],
        "visible": True,
    }
    has_pairs = any("clearance" in each for each in trajectories)
    return [ghosts] * (scene.duration > 0) + [closest] * has_pairs


def _trajectory_data(trajectory: ShownTrajectory) -> dict[str, Any]:
    """Return name, duration and speeds of a trajectory, the speeds at equal steps of time."""
    even = np.linspace(0.0, trajectory.duration, len(trajectory.time))
    speed = np.interp(even, trajectory.time, trajectory.speed)
    return {
        "name": trajectory.name,
        "lasts": f"{trajectory.duration:.3f} s",
        "duration": trajectory.duration,
        "speed": [round(float(each), 4) for each in speed],
    }


def _layer_data(
    layer: Layer,
    scene: Scene,
    words: Mapping[Layer, str],
    entries: Mapping[Layer, list[dict[str, str]]],
) -> dict[str, Any]:
    """Return a layer's name, label, colours and its visibility when the page opens.

    Words are labels of layers that differ between scenes; entries, several colours of a layer and
    their meanings.
    """
    pointers = [item.name for item in scene.items if item.name.startswith(POINTER)]
    axes = " or ".join(dict.fromkeys(name.removeprefix(POINTER) for name in pointers))
    executed, runs = scene.executed, ""
    if executed is not None:
        some = f"{executed.shown} of " if executed.shown < executed.total else ""
        runs = f"Executed paths of the tool: {some}{executed.total} runs"
    usual = {
        Layer.ARM: "Arm",
        Layer.TOOL: "Path of the tool, by its speed" if scene.duration > 0 else "Tool",
        Layer.SWEPT: "Space the links sweep (hulls)",
        Layer.AXES: "Axes of the tool: x, y, z",
        Layer.ROTATION: f"Rotation tolerance: the tool's {axes} axis stays in the cone",
        Layer.HOLDING: "Apparent gravity of held parts: the tip stays in the cone",
        Layer.EXECUTED: runs,
        Layer.BLOCKED: "Where it is blocked; what blocks has this colour",
    }
    fields: dict[str, Any] = {
        "name": str(layer),
        "label": words[layer] if layer in words else usual[layer],
        "entries": entries.get(layer, _USUAL_ENTRIES.get(layer, [])),
        "visible": layer not in _HIDDEN,
    }
    if layer is Layer.REFERENCE:
        fields["dashed"] = drawing.REFERENCE_COLOR
    if layer is Layer.TOOL and scene.duration > 0:
        top = scene.peak_speed
        ticks = ["0", f"{top / 2:.2f}", f"{top:.2f} m/s"]
        fields["scale"] = {"colors": list(drawing.SPEED_COLORS), "ticks": ticks}
    return fields


def _listed(kind: str, names: Sequence[str]) -> str:
    """Return the label of a layer: its kind, and the names of its items."""
    return f"{kind}: {', '.join(names)}"


def _segment_entries(problem: PlanningProblem) -> list[dict[str, str]]:
    """Return colours and sizes of the tube's segments, of many the first few."""
    tube = problem.tube
    radii = 1000 * tube.effective_radius
    kinds = ["box" if is_box else "radius" for is_box in tube.is_box]
    numbers = range(min(len(radii), _MAX_SEGMENTS_NAMED))
    entries = [
        {
            "color": drawing.segment_color(k),
            "text": f"segment {tube.segment_number(k)}: {kinds[k]} {size_of(tube, k)}",
        }
        for k in numbers
    ]
    if len(radii) > len(numbers):
        low, high = radii.min(), radii.max()
        text = f"and so on: {len(radii)} segments, {low:.3g} to {high:.3g} mm"
        text += " (of boxes, half the smaller side)" * bool(tube.is_box.any())
        entries.append({"color": "", "text": text})
    return entries


def _move_entries(scene: Scene, moves: Sequence[Move]) -> list[dict[str, str]]:
    """Return colour, name and tube of every move, and its duration if there is a single motion."""
    motion = scene.motions[0] if len(scene.motions) == 1 else None
    times = motion.move_times if isinstance(motion, CycleMotion) else {}
    entries = []
    for k, move in enumerate(moves):
        begin, end = times.get(move.name, (0.0, 0.0))
        lasts = f", {end - begin:.3f} s" if move.name in times else ""
        radii = 1000 * move.tube.effective_radius  # of boxes half the smaller side
        low, high = f"{radii.min():.3g}", f"{radii.max():.3g}"
        size = f"{low} mm" if low == high else f"{low} to {high} mm"
        size = "anywhere" if move.tube.is_anywhere else size
        text = f"{move.name}: {size}{lasts}"
        entries.append({"color": drawing.segment_color(k), "text": text})
    return entries


# ---- The curves of a page over time, as JSON values.

_TOOL_COLOR, _LINKS_COLOR = "#8C510A", "#7A6FAF"
# A joint near an end of its range may be as fast as elsewhere: its use counts at the end alone.
_AT_END = 0.998
_MAX_SHARE = 999.0  # [%]: of what holds under no load, the share is infinite
_WORDS = {"obstacles": "to obstacles", "self_collision": "between links"}


def page_curves(sections: Sequence[LimitedSection], time: FloatArray) -> dict[str, Any]:
    """Return the limits on the tool's speed, the use of limits and the clearance, if any.

    Times (K,) [s] are at equal steps from the begin of the sections' motion to its end.
    """
    limit = np.full(len(time), np.inf)  # on the tool's speed in the segment of each time [m/s]
    least = np.full(len(time), np.inf)  # lower end of its band, likewise
    for section in sections:
        rows = section.inside(time)
        segment = section.uses.segment[section.nearest(time[rows] - section.begin)]
        limit[rows] = ToolSpeed(section.problem).limit[segment]
        if section.problem.tube.least_tool_speed is not None:
            least[rows] = section.problem.tube.least_tool_speed[segment]
    curves = {
        "speedLimit": _rounded(limit, 4) if np.isfinite(limit).any() else [],
        "speedLeast": _rounded(least, 4) if np.isfinite(least).any() else [],
        "limits": _limits(sections, time),
        "clearance": _clearances(sections, time),
        "holding": _holding(sections, time),
    }
    return {name: curve for name, curve in curves.items() if curve}


def row_color(name: str, joint_names: Sequence[str]) -> str:
    """Return the colour of a row of binding limits: of a joint, the tool or the links."""
    if name in joint_names:
        return drawing.LINE_COLORS[joint_names.index(name) % len(drawing.LINE_COLORS)]
    return _TOOL_COLOR if name == TOOL else _LINKS_COLOR


def _limits(sections: Sequence[LimitedSection], time: FloatArray) -> dict[str, Any]:
    """Return the largest use of a limit over time, and its kind, of joints, tool and links."""
    fractions: dict[str, dict[str, FloatArray]] = {}
    for section in sections:
        rows = section.inside(time)
        if len(rows) == 0:
            continue
        joints = section.problem.robot.joint_names
        for use in section.uses.uses:
            owner = TOOL if use.name == TOOL else LINKS if use.joint is None else joints[use.joint]
            whole = fractions.setdefault(owner, {}).setdefault(
                use.kind, np.full(len(time), -np.inf)
            )
            # Of a range only its very ends count.
            is_counted = (use.kind != POSITION) | (use.fraction >= _AT_END)
            fraction = np.where(is_counted, use.fraction, 0.0)
            whole[rows] = np.maximum(whole[rows], _largest_near(section, fraction, time[rows]))
    joints = sections[0].problem.robot.joint_names
    owners = [name for name in (*joints, TOOL, LINKS) if name in fractions]
    kinds = list(dict.fromkeys(kind for name in owners for kind in fractions[name]))
    lines = [_line(name, fractions[name], kinds, joints) for name in owners]
    return {"kinds": [kind.replace("_", " ") for kind in kinds], "lines": lines}


def _line(
    name: str, fractions: dict[str, FloatArray], kinds: list[str], joints: Sequence[str]
) -> dict[str, Any]:
    table = np.array(list(fractions.values()))
    numbers = np.array([kinds.index(kind) for kind in fractions])
    return {
        "name": name,
        "color": row_color(name, joints),
        "dashed": name not in joints,
        "share": _rounded(100 * table.max(axis=0), 0),
        "kind": numbers[table.argmax(axis=0)].tolist(),
    }


def _largest_near(section: LimitedSection, fraction: FloatArray, time: FloatArray) -> FloatArray:
    """Return fractions at times (K,) [s] of the whole motion: the largest of nearby samples."""
    own = section.uses.samples.time + section.begin
    result: FloatArray = np.interp(time, own, fraction)
    step = time[1] - time[0] if len(time) > 1 else np.inf
    rows = np.clip(np.round((own - time[0]) / step), 0, len(time) - 1).astype(int)
    np.maximum.at(result, rows, fraction)
    return result


def _holding(sections: Sequence[LimitedSection], time: FloatArray) -> list[dict[str, Any]]:
    """Return the used share of what each contact carries, at speed with what happens, at rest."""
    return [
        {
            "name": use.holding.kind,
            "color": drawing.LINE_COLORS[k % len(drawing.LINE_COLORS)],
            "share": _rounded(np.minimum(100 * use.share, _MAX_SHARE), 0),
            "atRest": _rounded(np.minimum(100 * use.share_at_rest, _MAX_SHARE), 0),
            "happens": use.cone.tolist(),
            "words": [cone.name for cone in use.holding.cones],
        }
        for k, use in enumerate(held_contacts(sections, time))
    ]


def _clearances(sections: Sequence[LimitedSection], time: FloatArray) -> list[dict[str, Any]]:
    """Return the closest pairs of each kind over time; with points for the first kind alone."""
    pairs: dict[str, _Closest] = {}
    for section in sections:
        rows = section.inside(time)
        if len(rows) == 0:
            continue
        local = np.minimum(time[rows] - section.begin, section.trajectory.duration)
        for closest in closest_pairs(section.problem, section.trajectory, local):
            pairs.setdefault(closest.kind, _Closest(len(time))).keep(rows, closest)
    kinds = [kind for kind in _WORDS if kind in pairs]
    return [pairs[kind].as_dict(_WORDS[kind], kind == kinds[0]) for kind in kinds]


class _Closest:
    """The closest pairs of a kind over a whole motion."""

    def __init__(self, count: int) -> None:
        self._distance, self._margin = np.full(count, np.inf), np.full(count, np.inf)
        self._points = np.zeros((count, 6))
        self._pairs: dict[tuple[str, str], int] = {}
        self._pair = np.zeros(count, dtype=int)

    def keep(self, rows: IntArray, closest: ClosestPairs) -> None:
        """Keep the pairs at some of the times."""
        self._distance[rows], self._margin[rows] = closest.distance, closest.margin
        self._points[rows] = closest.points.reshape(-1, 6)
        self._pair[rows] = [self._pairs.setdefault(k, len(self._pairs)) for k in closest.names]

    def as_dict(self, name: str, with_points: bool) -> dict[str, Any]:
        """Return the pairs as JSON values, distances in mm, points in m."""
        apart = np.isfinite(self._distance)
        required = np.full(len(apart), np.inf)
        required[apart] = self._distance[apart] - self._margin[apart]
        fields = {
            "name": name,
            "distance": _rounded(1000 * self._distance, 1),
            "required": _rounded(1000 * required, 1),
            "pair": self._pair.tolist(),
            "pairs": [list(pair) for pair in self._pairs],
        }
        return {**fields, "points": self._points.round(4).tolist()} if with_points else fields


def _rounded(values: FloatArray, digits: int) -> list[float | None]:
    """Return rounded values, None for values that are not finite."""
    rounded = [round(value, digits or None) for value in np.where(np.isfinite(values), values, 0)]
    return [
        value if is_finite else None
        for value, is_finite in zip(rounded, np.isfinite(values).tolist(), strict=True)
    ]


# ---- The time line of a motion: segments of the tool or moves and rests, binding limits.


def motion_timeline(
    motion: Motion, sections: Sequence[LimitedSection], duration: float
) -> dict[str, Any]:
    """Return the time line of a motion, on a page of a duration [s], as JSON values."""
    if isinstance(motion, CycleMotion):
        line = cycle_timeline(motion).as_dict(duration)
    else:
        line = {"bands": segment_bands(sections[0]), "rests": []}
    marks = [
        {"time": round(mark.time, 5), "text": f"{mark.kind.replace('_', ' ')} {mark.name}"}
        for mark in passed_marks(motion.sections)
    ]
    return {**line, "marks": marks, "binds": binding_marks(sections)}


def segment_bands(section: LimitedSection) -> list[dict[str, Any]]:
    """Return the times of the tool in each segment, or in groups of many segments."""
    tube, count = section.problem.tube, section.problem.tube.segment_count
    step = segments_per_group(count)
    time, group = section.uses.samples.time, section.uses.segment // step
    ends = [0, *(np.flatnonzero(np.diff(group)) + 1).tolist(), len(time) - 1]
    bands = []
    for a, b in pairwise(ends):
        number = int(group[a])
        first, last = number * step, min((number + 1) * step, count) - 1
        own = [tube.segment_number(k) for k in (first, last)]
        name = f"segment {own[0]}" if first == last else f"segments {own[0]} to {own[1]}"
        span = {"begin": float(time[a]), "end": float(time[b])}
        bands.append({"name": name, **span, "color": drawing.segment_color(number)})
    return bands


def binding_marks(sections: Sequence[LimitedSection]) -> list[dict[str, Any]]:
    """Return the spans of binding limits of each joint, the tool and the links.

    Rows without any are left out.
    """
    joints = sections[0].problem.robot.joint_names
    spans: dict[str, list[dict[str, Any]]] = {}
    for section in sections:
        for row in binding_rows(joints, section.uses, section.closest):
            spans.setdefault(row.name, []).extend(
                {
                    "kind": span.kind.replace("_", " "),
                    "begin": round(section.begin + span.begin, 5),
                    "end": round(section.begin + span.end, 5),
                }
                for span in row.spans
            )
    return [
        {"name": name, "color": row_color(name, joints), "spans": own}
        for name, own in spans.items()
        if own
    ]


# ---- The verdict: certificate, peaks, payload, sources of limits, savings, version.

_SOURCED = ("velocity", "effort", "acceleration", "jerk")
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
            "gravities": f"{acceleration / GRAVITY:.2g} g",
        }
        shown.append({**stated, **words})
    for stated, certificate in zip(shown, certificates, strict=False):
        stated["verdict"] = _verdict(certificate)
    facts = []  # what, value, and True if it is shown on demand
    if len(shown) == 1 and isinstance(task, Cycle):
        facts.append(("cycles per hour", f"{_HOUR / shown[0]['duration']:.0f}", False))
    if largest := "; ".join(savings(sensitivities)[:_MAX_SAVINGS]):
        facts.append(("raising a limit by 10 % would save", largest, False))
    bound = lower_bound(task)
    if least := bound.beside(min(motion.duration for motion in motions)):
        facts.append(("bound", f"{least}: {bound.reason}", False))
    masses = {0.0 if arm.payload is None else arm.payload.mass for arm in arms}
    payload = " to ".join(f"{mass:g}" for mass in sorted({min(masses), max(masses)}))
    facts.append(("payload", "none" if payload == "0" else f"{payload} kg", True))
    facts.append(("limits", limit_sources(robot), True))
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")  # of reproducible pages
    date = clock.gmtime(int(epoch) if epoch.isdecimal() else clock.time())
    made = f"{clock.strftime('%Y-%m-%d', date)} by tubeplanner {__version__}"
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
