"""Panels over time with limits, segments, binding limits, clearances; panels of motors."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.limits.binding_limits import OBSTACLES, SELF_COLLISION, Span
from tubeplanner.limits.process_stretches import StretchRun
from tubeplanner.limits.rates import RATES, VelocityByPositionLimit
from tubeplanner.output.curves import (
    MAX_LABELS,
    BindingStrip,
    LimitedSection,
    TrajectoryCurves,
    size_of,
)
from tubeplanner.output.drawing import (
    BINDING_STYLES,
    LINE_COLORS,
    MARK_COLOR,
    OTHER_BINDING,
    PROCESS_COLOR,
    REFERENCE_COLOR,
    segment_color,
)
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.parts import EVENT, Mark

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

# ---- Panels over time: a quantity, its limits, the tube's segments.

# Dashes tell lines apart in grey print.
_DASHES: tuple[Any, ...] = ("-", (0, (6, 1.5)), (0, (2, 1)), (0, (6, 1.5, 1.5, 1.5)), (0, (1, 1)))
LIMIT: dict[str, Any] = {"color": "#444444", "linewidth": 1.0, "linestyle": (0, (4, 3))}
_MAIN: dict[str, Any] = {"color": "#D55E00", "linewidth": 1.6}
_MAX_FACTOR = 3.0  # larger factors are drawn as this
# Fractions of the panel from which on visits have such a label.
_LONG_LABEL, _SHORT_LABEL = 0.2, 0.1
_MARGIN = 0.08
_TOP_OF_USE = 115.0  # larger shares have their name here [%]
_WIDTH_OF_NAME = 0.12  # of the duration

_WITH_PANEL, _JERK = ("velocity", "effort"), "jerk"  # panels of their own; drawn in pieces

DrawPanel: TypeAlias = "Callable[[Axes, TrajectoryCurves], None]"


def time_panels(runs: Sequence[TrajectoryCurves]) -> list[DrawPanel]:
    """Return the functions that draw the panels of motions of an arm.

    Limited quantities of joints, and speeds of points, have a panel of their own.
    """
    joints, limits = runs[0].fractions, runs[0].problem.robot.limits
    own = {kind: partial(draw_fractions, kind) for kind in joints if kind not in _WITH_PANEL}
    rates = [own.pop(kind) for kind in RATES if kind in own]
    points: list[DrawPanel] = [draw_points] if limits.point_speed else []
    panels: list[DrawPanel] = [draw_positions, draw_velocities, *rates, draw_efforts, *own.values()]
    are_free = all(run.problem.tube.is_anywhere and run.rotation_use is None for run in runs)
    tube: list[DrawPanel] = [] if are_free else [draw_tube_use]
    holding: list[DrawPanel] = [draw_holding] if any(run.holding for run in runs) else []
    return [*panels, draw_speed, *points, *tube, *holding]


def line_style(number: int) -> dict[str, Any]:
    """Return colour and dashes of the line of a joint or of a case, by its number."""
    dashes = _DASHES[number % len(_DASHES)]
    return {"color": LINE_COLORS[number % len(LINE_COLORS)], "linewidth": 1.5, "linestyle": dashes}


def draw_positions(axis: "Axes", curves: TrajectoryCurves) -> None:
    """Draw positions and, in each joint's colour, the bounds in sight."""
    problem, samples = curves.problem, curves.samples
    for j, name in enumerate(problem.robot.joint_names):
        axis.plot(samples.time, samples.position[:, j], label=_once(axis, name), **line_style(j))
    low, high = samples.position.min(), samples.position.max()
    padding = _MARGIN * max(high - low, 1e-3)
    axis.set_ylim(low - padding, high + padding)
    for j in range(problem.robot.joint_count):
        for bounds in (problem.joint_lower, problem.joint_upper):
            limit = bounds[curves.segment, j]
            if ((limit > low - padding) & (limit < high + padding)).any():
                color = LINE_COLORS[j % len(LINE_COLORS)]
                axis.plot(samples.time, limit, **{**LIMIT, "color": color})
    axis.set_ylabel(f"position [{_unit(problem, 'rad', 'm')}]")


def draw_velocities(axis: "Axes", curves: TrajectoryCurves) -> None:
    """Draw velocities against their limits; in each joint's colour, lower limits by position."""
    limits, samples = curves.problem.robot.limits, curves.samples
    own = limits.velocity
    _draw_values(axis, curves, samples.velocity, own, "velocity", ("rad/s", "m/s"))
    unit = own / 100 if np.isfinite(own).all() else np.ones_like(own)
    most = np.where(np.isfinite(own), own, 1.2 * abs(samples.velocity).max())
    law = VelocityByPositionLimit(limits)
    towards_ends = law.allowed(samples.position).T
    for joint, sign, allowed in zip(law.joints, law.sign, towards_ends, strict=True):
        less = np.where(allowed < most[joint], sign * allowed / unit[joint], np.nan)
        axis.plot(samples.time, less, **{**LIMIT, "color": LINE_COLORS[joint % len(LINE_COLORS)]})


def draw_efforts(axis: "Axes", curves: TrajectoryCurves) -> None:
    """Draw efforts against limits; in each joint's colour, lower limits by sign or position."""
    limits, samples = curves.problem.robot.limits, curves.samples
    own = limits.effort
    _draw_values(axis, curves, curves.effort, own, "effort", ("N m", "N"))
    unit = own / 100 if np.isfinite(own).all() else np.ones_like(own)
    for each in limits.effort_ranges:
        color = LINE_COLORS[each.joint % len(LINE_COLORS)]
        for sign in (1.0, -1.0):
            allowed = each.allowed(samples.position[:, each.joint], sign)
            less = np.where(allowed < own[each.joint], sign * allowed / unit[each.joint], np.nan)
            axis.plot(samples.time, less, **{**LIMIT, "color": color})


def draw_fractions(kind: str, axis: "Axes", curves: TrajectoryCurves) -> None:
    """Draw a quantity of joints as percent of its limits, and name the joints without a limit.

    Jerks are constant in pieces, which are not joined.
    """
    time, used = curves.samples.time, 100 * curves.fractions[kind]
    free, style = np.isnan(used).all(axis=0), {}
    if kind == _JERK:
        jumps = 1 + np.flatnonzero((np.diff(curves.jerk, axis=0) != 0).any(axis=1))
        time, used = np.insert(time, jumps, np.nan), np.insert(used, jumps, np.nan, axis=0)
        style = {"linestyle": "-", "solid_capstyle": "butt"}
    for j in np.flatnonzero(~free).tolist():
        axis.plot(time, used[:, j], **line_style(j) | style)
    _frame_percent(axis, kind.replace("_", " "))
    if free.any():
        names = np.array(curves.problem.robot.joint_names)[free]
        axis.set_title(f"no limit: {', '.join(names)}", fontsize=8, loc="right")


def draw_factor(axis: "Axes", curves: TrajectoryCurves, label: str, number: int) -> None:
    """Draw the factor by which the arm could move faster, over the fraction of the duration.

    Args:
        axis: Of the panel; several trajectories may share it.
        curves: The trajectory.
        label: In a legend.
        number: Of the line, for colour and dashes.
    """
    time = curves.samples.time
    factor = np.minimum(curves.factor, _MAX_FACTOR)
    axis.plot(time / time[-1], factor, label=label, **line_style(number))
    axis.axhline(1.0, **LIMIT)
    axis.set_xlim(0.0, 1.0)
    axis.set_ylim(0.9, None)
    axis.set_xlabel("fraction of the duration, t / T [-]")
    axis.set_ylabel("b(t), times faster [-]")
    axis.grid(alpha=0.25)


def draw_speed(axis: "Axes", curves: TrajectoryCurves) -> None:
    """Draw the speed of the tool, its limit where there is a limit, and the band of stretches."""
    axis.plot(curves.samples.time, curves.speed, **_MAIN)
    limit, least = curves.speed_limit, curves.problem.tube.least_tool_speed
    if least is not None:
        low = least[curves.segment]
        band: dict[str, Any] = {"color": PROCESS_COLOR, "alpha": 0.4, "linewidth": 0}
        axis.fill_between(curves.samples.time, low, limit, where=np.isfinite(low), **band)
    near = limit[np.isfinite(limit) & (limit < 2 * curves.speed.max())]
    axis.plot(curves.samples.time, np.where(np.isin(limit, near), limit, np.nan), **LIMIT)
    # At rest there is no speed that would set the scale.
    axis.set_ylim(0.0, 1.1 * max(curves.speed.max(), near.max(initial=0.0)) or 1e-3)
    axis.set_ylabel("tool speed [m/s]")


def draw_points(axis: "Axes", curves: TrajectoryCurves) -> None:
    """Draw the speeds of points of the arm as percent of their limits."""
    limited = curves.problem.robot.limits.point_speed
    for k, (point, fraction) in enumerate(zip(limited, curves.points.T, strict=True)):
        label = _once(axis, f"{k}: {point.link}")
        axis.plot(curves.samples.time, 100 * fraction, label=label, **line_style(k))
    axis.axhline(100.0, **LIMIT)
    axis.set_ylim(0.0, 130.0)
    axis.set_ylabel("speed of points [% of limit]")
    axis.legend(fontsize=8, loc="upper center", ncols=3)


def draw_tube_use(axis: "Axes", curves: TrajectoryCurves) -> None:
    """Draw distance to the segment and rotation error as percent of their tolerances."""
    has_boxes = curves.problem.tube.cross_section is not None
    label = "distance / radius or half side" if has_boxes else "distance / radius"
    axis.plot(curves.samples.time, 100 * curves.tube_use, label=_once(axis, label), **_MAIN)
    if curves.rotation_use is not None:
        used = 100 * curves.rotation_use
        label = _once(axis, "rotation error / tolerance")
        axis.plot(curves.samples.time, used, label=label, **line_style(3))
    axis.axhline(100.0, **LIMIT)
    axis.set_ylim(0.0, 130.0)
    axis.set_ylabel("tolerance used [%]")
    axis.legend(fontsize=8, loc="upper center", ncols=2)


def draw_holding(axis: "Axes", curves: TrajectoryCurves) -> None:
    """Draw the used share of what each contact carries, dashed at rest; name what happens beyond.

    A name stands where the share of that kind is the highest, above others that stand near.
    """
    time, named = curves.samples.time, np.zeros(0)
    for k, use in enumerate(curves.holding):
        kind, color = use.holding.kind, line_style(k)["color"]
        share = 100 * use.share
        axis.plot(time, share, label=_once(axis, f"{kind}, at speed"), **_MAIN | {"color": color})
        at_rest: dict[str, Any] = {"color": color, "linewidth": 1.0, "linestyle": "--"}
        axis.plot(time, 100 * use.share_at_rest, label=_once(axis, f"{kind}, at rest"), **at_rest)
        names = np.array([cone.name for cone in use.holding.cones])[use.cone]
        for name in np.unique(names):
            top = int(np.where(names == name, share, -1.0).argmax())
            place = time[top], min(share[top], _TOP_OF_USE)
            is_late = time[top] > time.mean()
            beside: dict[str, Any] = {"ha": "right" if is_late else "left", "color": color}
            below = int((abs(named - time[top]) < _WIDTH_OF_NAME * time[-1]).sum())
            above: dict[str, Any] = {"xytext": (0, 3 + 9 * below), "textcoords": "offset points"}
            axis.annotate(name, place, fontsize=8, va="bottom", **above, **beside)
            named = np.append(named, time[top])
    axis.axhline(100.0, **LIMIT)
    axis.set_ylim(0.0, 150.0)  # the legend is above the names
    axis.set_ylabel("holding used [%]")
    if curves.holding:  # in some legs of a cycle nothing is held
        axis.legend(fontsize=8, loc="upper center", ncols=2)


def mark_segments(
    axis: "Axes", curves: TrajectoryCurves, *, labels: bool = False, until: float | None = None
) -> None:
    """Shade a panel over time by the segments that the tool is in; name segments on request.

    Args:
        axis: The panel.
        curves: The trajectory.
        labels: True to name segments.
        until: End of the panel [s]; None: that of the trajectory.
    """
    visits, last = curves.visits, until or float(curves.samples.time[-1])
    for group, begin, end in visits:
        axis.axvspan(begin, end, color=segment_color(group), alpha=0.10, linewidth=0, zorder=0)
        if begin > 0:
            axis.axvline(begin, color="#888888", linewidth=0.8, linestyle=":")
        if labels and len(visits) <= MAX_LABELS:
            name = _label(curves, group, (end - begin) / last)
            coordinates = axis.get_xaxis_transform()
            axis.text((begin + end) / 2, 1.01, name, transform=coordinates, ha="center", fontsize=7)
    axis.set_xlim(0.0, last)
    axis.set_xlabel("time [s]")
    axis.grid(alpha=0.25)


def mark_process(
    axis: "Axes", runs: Sequence[StretchRun], marks: Sequence[Mark], *, names: bool = False
) -> None:
    """Shade a panel over time along stretches of constant speed, and draw marks on the way.

    Args:
        axis: The panel.
        runs: The stretches.
        marks: Of stretches and events on the way, in the order of time.
        names: True to name the marks, each beside its line.
    """
    for run in runs:
        axis.axvspan(run.on, run.off, color=PROCESS_COLOR, alpha=0.10, linewidth=0, zorder=0)
    for mark in marks:
        axis.axvline(mark.time, color=MARK_COLOR, linewidth=0.6)
        if names:
            axis.annotate(
                mark.name if mark.kind == EVENT else mark.kind.replace("_", " "),
                (mark.time, 0.97),
                (2, 0),
                xycoords=axis.get_xaxis_transform(),
                textcoords="offset points",
                rotation=90,
                fontsize=7,
                va="top",
            )


def _label(curves: TrajectoryCurves, group: int, fraction: float) -> str:
    """Return the label of a visit to a group of segments that takes a fraction of the panel."""
    tube, step = curves.problem.tube, curves.segments_per_group
    first, last = group * step, min((group + 1) * step, tube.segment_count) - 1
    begin, end = (tube.segment_number(k) for k in (first, last))
    number = str(begin) if first == last else f"{begin}-{end}"
    sizes = [size_of(tube, k) for k in range(first, last + 1)]
    is_group = first < last
    if fraction <= (_LONG_LABEL if is_group else _SHORT_LABEL) or len(set(sizes)) > 1:
        return number
    name = f"segment{'s' * is_group} {number}" if fraction > _LONG_LABEL else number
    return f"{name}: {sizes[0]}"


def _draw_values(
    axis: "Axes",
    curves: TrajectoryCurves,
    values: FloatArray,
    limit: FloatArray,
    quantity: str,
    units: tuple[str, str],
) -> None:
    """Draw values as percent of their limits, or in their unit if any joint has no limit.

    Units are those of revolute and of prismatic joints.
    """
    limited = bool(np.isfinite(limit).all())
    scaled = 100 * values / limit if limited else values
    for j in range(values.shape[1]):
        axis.plot(curves.samples.time, scaled[:, j], **line_style(j))
    if limited:
        _frame_percent(axis, quantity)
        return
    axis.set_ylabel(f"{quantity} [{_unit(curves.problem, *units)}]")
    axis.set_title(f"not every joint has a {quantity} limit", fontsize=8, loc="right")


def _frame_percent(axis: "Axes", quantity: str) -> None:
    for bound in (-100, 100):
        axis.axhline(bound, **LIMIT)
    axis.set_ylim(-112, 112)
    axis.set_ylabel(f"{quantity} [% of limit]")


def _once(axis: "Axes", label: str) -> str:
    """Return a label, hidden from legends if a line of the panel has the same label."""
    return "_" if label in (line.get_label() for line in axis.lines) else label


def _unit(problem: PlanningProblem, revolute: str, prismatic: str) -> str:
    return revolute if problem.robot.revolute.all() else f"{revolute}, {prismatic}"


# ---- Panels of motors: the efforts of a joint over its velocities, inside its motor's limits.

_MOTION: dict[str, Any] = {"color": LINE_COLORS[1], "linewidth": 1.4}
_SHADE: dict[str, Any] = {"color": LINE_COLORS[0], "alpha": 0.08, "linewidth": 0}
_LOOKS = 201  # velocities at which a motor's limits are drawn
_MOTOR_MARGIN = 1.12  # of limits, or of motions where there are none: end of the panel


def motor_joints(robot: RobotModel) -> IntArray:
    """Return the joints whose motors have friction or a torque-speed line."""
    motors = robot.motors
    friction = motors.viscous_friction + motors.backwards_friction + motors.forwards_friction
    return np.flatnonzero((friction > 0) | motors.has_curve)


def draw_motors(
    figure: "FigureBase", curves: TrajectoryCurves, joints: IntArray, columns: int | None = None
) -> None:
    """Draw the motors of some joints in a number of columns; None: in a single row."""
    columns = columns or len(joints)
    grid = figure.add_gridspec(-(-len(joints) // columns), columns)
    axes = [figure.add_subplot(grid[divmod(number, columns)]) for number in range(len(joints))]
    for number, (axis, joint) in enumerate(zip(axes, joints.tolist(), strict=True)):
        draw_motor(axis, curves, joint)
        if number % columns:
            axis.set_ylabel("")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=8, frameon=False)


def draw_motor(axis: "Axes", curves: TrajectoryCurves, joint: int) -> None:
    """Draw a joint's efforts over its velocities, the friction, and the motor's limits.

    Limits that depend on the position are drawn at their greatest and at their least.
    """
    robot = curves.problem.robot
    velocity, effort = curves.samples.velocity[:, joint], curves.effort[:, joint]
    fastest = robot.limits.velocity[joint]
    # To beyond the joint's limits, or without limits beyond its motion.
    reach = float(fastest if np.isfinite(fastest) else max(abs(velocity).max(), 1e-3))
    end = _MOTOR_MARGIN * reach
    # Friction jumps at zero: one sample on either side.
    positive = np.linspace(0, end, _LOOKS // 2 + 1)
    positive[0] = 1e-9 * end
    grid = np.concatenate([-positive[::-1], positive])
    for forwards, backwards in _motor_limits(robot, joint, grid):
        axis.fill_between(grid, -backwards, forwards, where=abs(grid) <= fastest, **_SHADE)
        for bound in (forwards, -backwards):
            axis.plot(grid, bound, **LIMIT)
    for bound in (-fastest, fastest):
        axis.axvline(bound, **LIMIT)
    coulomb = robot.motors.coulomb_effort(np.tile(grid[:, None], robot.joint_count))[:, joint]
    friction = robot.motors.viscous_friction[joint] * grid + coulomb
    axis.plot(grid, friction, color=REFERENCE_COLOR, linewidth=1.0, label="friction alone")
    axis.plot(velocity, effort, **_MOTION, label="motion")
    most = robot.limits.effort[joint]
    top = _MOTOR_MARGIN * float(most if np.isfinite(most) else abs(effort).max())
    axis.set(xlim=(grid[0], grid[-1]), ylim=(-top, top))
    units = ("rad/s", "N m") if robot.revolute[joint] else ("m/s", "N")
    axis.set_title(robot.joint_names[joint], fontsize=8)
    axis.set_xlabel(f"velocity [{units[0]}]", fontsize=8)
    axis.set_ylabel(f"effort [{units[1]}]", fontsize=8)
    axis.tick_params(labelsize=7)
    axis.grid(alpha=0.25)


def _motor_limits(robot: RobotModel, joint: int, velocity: FloatArray) -> list[FloatArray]:
    """Return a motor's efforts forwards and backwards at velocities (N,), (2, N) each.

    The greatest over all positions, then the least if that differs.
    """
    own = robot.limits.effort[joint]
    sides = [
        (each.side(1.0), each.side(-1.0))
        for each in robot.limits.effort_ranges
        if each.joint == joint
    ]
    pairs = [(own, own)]
    if sides:
        ((forwards, backwards),) = sides
        pairs = [(forwards.max(), backwards.max()), (forwards.min(), backwards.min())]
    line = np.full((2, len(velocity)), np.inf)
    if robot.motors.has_curve[joint]:
        stall, no_load = robot.motors.saturation_effort[joint], robot.motors.no_load_velocity[joint]
        line = np.array([stall * (1 - sign * velocity / no_load) for sign in (1.0, -1.0)])
    limits = [np.minimum(np.array(pair)[:, None], line) for pair in dict.fromkeys(pairs)]
    return [limit for limit in limits if np.isfinite(limit).all()]


# ---- The strip of binding limits: a row per joint, of the tool and of the links.

_NEARLY_ALL = 99.0  # [%]: from here on decimals are shown
_HEIGHT = 0.78  # of a row
_LETTER = 0.0062  # width of a letter of a name in a bar, of the panel
_LINE_FROM, _LINE_TO = -0.036, -0.005  # ends of a joint's line beside its row, of the panel


def draw_strip(axis: "Axes", strip: BindingStrip) -> None:
    """Draw a strip of binding limits; beside each joint's name, its line style of other panels."""
    for row, spans in enumerate(strip.rows.values()):
        axis.axhspan(row - _HEIGHT / 2, row + _HEIGHT / 2, color="#F4F4F4", linewidth=0, zorder=0)
        for span in spans:
            _draw_span(axis, span, row, strip.duration)
    transform = axis.get_yaxis_transform()
    for row in range(strip.joint_count):
        coordinates: dict[str, Any] = {"transform": transform, "clip_on": False}
        axis.plot((_LINE_FROM, _LINE_TO), (row, row), **line_style(row), **coordinates)
    axis.set_yticks(range(len(strip.rows)), list(strip.rows), fontsize=8)
    axis.tick_params(axis="y", length=0, pad=44)
    axis.set_ylim(len(strip.rows) - 0.45, -0.55)
    _draw_legend(axis, strip)


def _draw_span(axis: "Axes", span: Span, row: int, duration: float) -> None:
    style, width = BINDING_STYLES.get(span.kind, OTHER_BINDING), span.end - span.begin
    options: dict[str, Any] = {"color": style.color, "hatch": style.hatch, "edgecolor": "white"}
    axis.barh(row, width, _HEIGHT, span.begin, linewidth=0.4, zorder=2, **options)
    name = span.kind.replace("_", " ")
    if width / duration > _LETTER * (len(name) + 1):
        box = {"facecolor": style.color, "edgecolor": "none", "pad": 0.6}
        middle = span.begin + width / 2
        text: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 6.5, "zorder": 3}
        axis.text(middle, row, name, color=style.text, bbox=box, **text)


def _draw_legend(axis: "Axes", strip: BindingStrip) -> None:
    """Name the kinds that bind, with their percentage of the time, above the panel."""
    from matplotlib.patches import Patch

    handles = []
    for kind, fraction in sorted(strip.fractions.items(), key=lambda pair: -pair[1]):
        style = BINDING_STYLES.get(kind, OTHER_BINDING)
        options: dict[str, Any] = {"facecolor": style.color, "edgecolor": "white", "linewidth": 0.4}
        label = f"{kind.replace('_', ' ')} {percent(fraction)}"
        handles.append(Patch(hatch=style.hatch, label=label, **options))
    above = 2.0 if len(handles) else 1.0
    axis.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(-0.01, 1.0),
        borderaxespad=above,
        ncols=len(handles) or 1,
        fontsize=8,
        frameon=False,
        handlelength=1.6,
        columnspacing=1.2,
    )
    title = (
        "What binds when (98 % of a limit or more): "
        f"some limit on the speed {percent(strip.speed_fraction)} of the time"
    )
    coordinates: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
    axis.annotate(title, (0.0, 1.0), (0, 34), fontsize=9.5, **coordinates)


def percent(fraction: float) -> str:
    """Return a fraction in percent, rounded to 0 or 100 % only if exactly that."""
    if fraction in (0.0, 1.0):
        return f"{100 * fraction:.0f} %"
    bounded = min(max(100 * fraction, 0.1), 99.9)
    return f"{bounded:.2g} %" if bounded < _NEARLY_ALL else f"{bounded:.3g} %"


# ---- The panel of clearances: distances of links to obstacles and to each other over time.

_MILLI = 1000.0
_TOP = 1.5  # of the largest distance: leaves room for names above the curves
_STYLES: dict[str, tuple[str, Any]] = {
    OBSTACLES: (LINE_COLORS[1], "-"),
    SELF_COLLISION: (LINE_COLORS[0], (0, (5, 2))),
}
_WORDS = {OBSTACLES: "nearest obstacle", SELF_COLLISION: "nearest links"}


def draw_clearance(axis: "Axes", sections: Sequence[LimitedSection]) -> None:
    """Draw the least distances in the sections of a motion, and the required distances, dashed.

    A point marks the pair with the least margin to its required distance; the legend names it.
    """
    for kind, (color, dashes) in _STYLES.items():
        own = [(each.begin, pairs) for each in sections for pairs in each.closest]
        own = [(begin, pairs) for begin, pairs in own if pairs.kind == kind]
        for begin, pairs in own:
            is_finite = np.isfinite(pairs.distance)
            distances = np.where(is_finite, _MILLI * pairs.distance, np.nan)
            required = _MILLI * np.where(is_finite, pairs.distance - pairs.margin, np.nan)
            options: dict[str, Any] = {"color": color, "linestyle": dashes, "linewidth": 1.6}
            axis.plot(begin + pairs.time, distances, **options)
            axis.plot(begin + pairs.time, required, **{**LIMIT, "color": color})
        margins = [float(pairs.margin.min()) for _, pairs in own]
        if margins and np.isfinite(min(margins)):
            begin, pairs = own[int(np.argmin(margins))]
            k = int(pairs.margin.argmin())
            distance = _MILLI * float(pairs.distance[k])
            label = f"{_WORDS[kind]}: {' - '.join(pairs.names[k])}, {distance:.3g} mm"
            options = {"color": color, "linestyle": dashes, "markersize": 5, "label": label}
            axis.plot(begin + pairs.time[k], distance, marker="o", **options)
    low, high = axis.get_ylim()
    axis.set_ylim(min(low, 0.0), _TOP * high)
    axis.set_ylabel("clearance [mm]")
    axis.legend(fontsize=7, loc="upper center", handlelength=3.0)
