"""What the panel of a page says: titles, durations, layers with their colours, notes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.views.executed_paths import ExecutedPaths
from tubeplanner.views.goal_ball import goal_ball
from tubeplanner.views.orientation_items import POINTER
from tubeplanner.views.page_curves import page_curves
from tubeplanner.views.palette import (
    AXIS_COLORS,
    BLOCKED_COLOR,
    CARRIED_COLOR,
    CLOSEST_COLOR,
    CONE_COLOR,
    END_COLOR,
    EXECUTED_COLOR,
    LINE_COLORS,
    OBSTACLE_COLOR,
    REFERENCE_COLOR,
    SPEED_COLORS,
    START_COLOR,
    SWEPT_COLOR,
    WARNING_COLOR,
    segment_color,
)
from tubeplanner.views.problem_scene import ProblemScene
from tubeplanner.views.problem_timeline import problem_timeline
from tubeplanner.views.scene import Layer, Scene, ShownTrajectory
from tubeplanner.views.stretch import size_of

_MAX_SEGMENTS_NAMED = 6
_CURVE_STEPS = 400
_HIDDEN = (Layer.AXES, Layer.SWEPT)  # at first
_USUAL_ENTRIES = {
    Layer.AXES: [{"color": color, "text": ""} for color in AXIS_COLORS],
    Layer.ROTATION: [{"color": CONE_COLOR, "text": ""}],
    Layer.CARRIED: [{"color": CARRIED_COLOR, "text": ""}],
    Layer.OBSTACLES: [{"color": OBSTACLE_COLOR, "text": ""}],
    Layer.SWEPT: [{"color": SWEPT_COLOR, "text": ""}],
    Layer.BLOCKED: [{"color": BLOCKED_COLOR, "text": ""}],
    Layer.EXECUTED: [
        {"color": EXECUTED_COLOR, "text": "in the tube"},
        {"color": WARNING_COLOR, "text": "outside"},
    ],
}


def panel_data(scene: ProblemScene) -> dict[str, Any]:
    """Return the text of a problem's page and how it frames the scene, as JSON values."""
    layers = [_layer_data(layer, scene) for layer in scene.layers]
    data = page_data(scene, arm_words(scene.problem.robot), layers)
    return {**data, "timelines": [problem_timeline(*each) for each in scene.stretches]}


def arm_words(robot: RobotModel) -> str:
    """Return what a page says of an arm."""
    return f"{robot.name}, {robot.joint_count} joints"


def page_data(scene: Scene, about: str, layers: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the text of a page's overlay and how it frames the scene, as JSON values.

    Args:
        scene: What is shown.
        about: What is said below its name.
        layers: As `layer_data` returns them.
    """
    many = len(scene.trajectories) > 1
    trajectories = [
        {**_trajectory_data(trajectory), "color": LINE_COLORS[i % len(LINE_COLORS)]}
        for i, trajectory in enumerate(scene.trajectories)
    ]
    for stretches, trajectory in zip(scene.stretches, trajectories, strict=False):
        steps = np.linspace(0.0, trajectory["duration"], _CURVE_STEPS)
        trajectory |= page_curves(stretches, steps)
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
        "labels": labels if many else None,
        "layers": [*layers, *_moving_layers(scene, trajectories)],
        "offset": frame.offset.round(5).tolist(),
        "thickness": round(scene.thickness, 5),
        "notes": list(scene.notes),
        "direction": frame.direction.tolist(),
        "outline": frame.outline.round(5).tolist(),
    }


def _moving_layers(scene: Scene, trajectories: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the layers that the page draws by itself of arms that move."""
    ghosts = {
        "name": "ghosts",
        "label": "Arm at start, at end",
        "entries": [{"color": START_COLOR, "text": ""}, {"color": END_COLOR, "text": ""}],
        "visible": False,
    }
    closest = {
        "name": "closest",
        "label": "Closest pair and its distance",
        "entries": [{"color": CLOSEST_COLOR, "text": ""}],
        "visible": True,
    }
    has_pairs = any("clearance" in each for each in trajectories)
    return [ghosts] * (scene.duration > 0) + [closest] * has_pairs


def _trajectory_data(trajectory: ShownTrajectory) -> dict[str, Any]:
    """Return name, duration and speeds of a trajectory, these at equal steps of time."""
    even = np.linspace(0.0, trajectory.duration, len(trajectory.time))
    speed = np.interp(even, trajectory.time, trajectory.speed)
    return {
        "name": trajectory.name,
        "lasts": f"{1000 * trajectory.duration:.0f} ms",
        "top": f"{trajectory.speed.max():.2f} m/s",
        "duration": trajectory.duration,
        "speed": [round(float(each), 4) for each in speed],
    }


def _layer_data(layer: Layer, scene: ProblemScene) -> dict[str, Any]:
    problem = scene.problem
    words = {
        Layer.CARRIED: listed("Carried", [solid.name for solid in problem.attached]),
        Layer.TUBE: "Tube: the tool must stay inside",
        Layer.REFERENCE: "Reference path" + ", goal's ball" * len(goal_ball(problem.goal)),
        Layer.OBSTACLES: listed("Obstacles", [obstacle.name for obstacle in problem.obstacles]),
    }
    return layer_data(layer, scene, words, {Layer.TUBE: _segment_entries(problem)})


def layer_data(
    layer: Layer,
    scene: Scene,
    words: Mapping[Layer, str],
    entries: Mapping[Layer, list[dict[str, str]]],
) -> dict[str, Any]:
    """Return a layer's name, label, colours and whether it is shown at first.

    Args:
        layer: Which one.
        scene: What is shown.
        words: Labels of layers that do not always have the same.
        entries: Colours of layers that have several, and what each means.
    """
    usual = {
        Layer.ARM: "Arm",
        Layer.TOOL: "Path of the tool, by its speed" if scene.duration > 0 else "Tool",
        Layer.SWEPT: "Space the links sweep (hulls)",
        Layer.AXES: "Axes of the tool: x, y, z",
        Layer.ROTATION: _rotation_label(scene),
        Layer.EXECUTED: _executed_label(scene.executed),
        Layer.BLOCKED: "Where it is blocked; what blocks has this colour",
    }
    fields: dict[str, Any] = {
        "name": str(layer),
        "label": words[layer] if layer in words else usual[layer],
        "entries": entries.get(layer, _USUAL_ENTRIES.get(layer, [])),
        "visible": layer not in _HIDDEN,
    }
    if layer is Layer.REFERENCE:
        fields["dashed"] = REFERENCE_COLOR
    if layer is Layer.TOOL and scene.duration > 0:
        top = scene.peak_speed
        ticks = ["0", f"{top / 2:.2f}", f"{top:.2f} m/s"]
        fields["scale"] = {"colors": list(SPEED_COLORS), "ticks": ticks}
    return fields


def _rotation_label(scene: Scene) -> str:
    pointers = [item.name for item in scene.items if item.name.startswith(POINTER)]
    axes = " or ".join(dict.fromkeys(name.removeprefix(POINTER) for name in pointers))
    return f"Rotation tolerance: the tool's {axes} axis stays in the cone"


def _executed_label(executed: ExecutedPaths | None) -> str:
    if executed is None:
        return ""
    some = f"{executed.shown} of " if executed.shown < executed.total else ""
    return f"Executed paths of the tool: {some}{executed.total} runs"


def listed(kind: str, names: Sequence[str]) -> str:
    """Return what a layer of a kind is called: with the names of what is in it."""
    return f"{kind}: {', '.join(names)}"


def _segment_entries(problem: PlanningProblem) -> list[dict[str, str]]:
    """Return colours and sizes of the tube's segments, the first few of many."""
    tube = problem.tube
    radii = 1000 * tube.effective_radius
    kinds = ["box" if is_box else "radius" for is_box in tube.is_box]
    named = range(min(len(radii), _MAX_SEGMENTS_NAMED))
    entries = [
        {"color": segment_color(k), "text": f"segment {k}: {kinds[k]} {size_of(tube, k)}"}
        for k in named
    ]
    if len(radii) > len(named):
        low, high = radii.min(), radii.max()
        text = f"and so on: {len(radii)} segments, {low:.3g} to {high:.3g} mm"
        text += " (of boxes, half the smaller side)" * bool(tube.is_box.any())
        entries.append({"color": "", "text": text})
    return entries
