"""What the panel of a page says: titles, durations, layers with their colours, notes."""

from collections.abc import Sequence
from typing import Any

from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.views.executed_paths import ExecutedPaths
from tubeplanner.views.goal_ball import goal_ball
from tubeplanner.views.palette import (
    EXECUTED_COLOR,
    OBSTACLE_COLOR,
    REFERENCE_COLOR,
    SPEED_COLORS,
    WARNING_COLOR,
    segment_color,
)
from tubeplanner.views.panels import size_of
from tubeplanner.views.scene import CARRIED_COLOR, SWEPT_COLOR, Layer, Scene

_MAX_SEGMENTS_NAMED = 6


def panel_data(scene: Scene) -> dict[str, Any]:
    """Return the text of the page's overlay and how it frames the scene, as JSON values."""
    problem, many = scene.problem, len(scene.trajectories) > 1
    trajectories = [
        {
            "name": trajectory.name,
            "lasts": f"{1000 * trajectory.duration:.0f} ms",
            "top": f"{trajectory.speed.max():.2f} m/s",
            "duration": trajectory.duration,
            "speed": [round(float(speed), 4) for speed in trajectory.speed],
        }
        for trajectory in scene.trajectories
    ]
    labels = [
        {
            "text": f"{trajectory['name']}: {trajectory['lasts']}",
            "point": (scene.top + i * scene.offset).tolist(),
        }
        for i, trajectory in enumerate(trajectories)
    ]
    moving = "" if scene.duration > 0 else "The arm at its start; no trajectory is shown. "
    return {
        "title": problem.name,
        "robot": f"{problem.robot.name}, {problem.robot.joint_count} joints",
        "hint": f"{moving}Grid: {scene.floor_step:g} m. Drag to turn, scroll to zoom, right button "
        "to shift.",
        "duration": scene.duration,
        "trajectories": trajectories,
        "labels": labels if many else None,
        "layers": [_layer_data(layer, scene) for layer in scene.layers],
        "notes": list(scene.notes),
        "direction": scene.direction.tolist(),
        "outline": scene.outline.round(5).tolist(),
    }


def _layer_data(layer: Layer, scene: Scene) -> dict[str, Any]:
    """Return a layer's name, label, colours and whether it is shown at first."""
    problem = scene.problem
    words = {
        Layer.ARM: "Arm",
        Layer.CARRIED: _listed("Carried", [solid.name for solid in problem.attached]),
        Layer.TUBE: "Tube: the tool must stay inside",
        Layer.REFERENCE: "Reference path" + ", goal's ball" * len(goal_ball(problem)),
        Layer.TOOL: "Path of the tool, by its speed" if scene.duration > 0 else "Tool",
        Layer.EXECUTED: _executed_label(scene.executed),
        Layer.OBSTACLES: _listed("Obstacles", [obstacle.name for obstacle in problem.obstacles]),
        Layer.SWEPT: "Space the links sweep (hulls)",
    }
    plain = {
        Layer.CARRIED: CARRIED_COLOR,
        Layer.OBSTACLES: OBSTACLE_COLOR,
        Layer.SWEPT: SWEPT_COLOR,
    }
    entries = {
        Layer.TUBE: _segment_entries(problem),
        Layer.EXECUTED: [
            {"color": EXECUTED_COLOR, "text": "in the tube"},
            {"color": WARNING_COLOR, "text": "outside"},
        ],
    }
    if layer in plain:
        entries[layer] = [{"color": plain[layer], "text": ""}]
    fields: dict[str, Any] = {
        "name": str(layer),
        "label": words[layer],
        "entries": entries.get(layer, []),
        "visible": layer is not Layer.SWEPT,
    }
    if layer is Layer.REFERENCE:
        fields["dashed"] = REFERENCE_COLOR
    if layer is Layer.TOOL and scene.duration > 0:
        top = scene.peak_speed
        ticks = ["0", f"{top / 2:.2f}", f"{top:.2f} m/s"]
        fields["scale"] = {"colors": list(SPEED_COLORS), "ticks": ticks}
    return fields


def _executed_label(executed: ExecutedPaths | None) -> str:
    if executed is None:
        return ""
    some = f"{executed.shown} of " if executed.shown < executed.total else ""
    return f"Executed paths of the tool: {some}{executed.total} runs"


def _listed(kind: str, names: Sequence[str]) -> str:
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
