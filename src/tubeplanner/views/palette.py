"""Colours that colour-blind readers tell apart, the same in figures and in the viewer."""

from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray


class BindingStyle(NamedTuple):
    """How a stretch of time is drawn in which a kind of limit binds.

    Attributes:
        color: Of the bar.
        hatch: Its pattern, so that it is told from others in grey print.
        text: Colour of text on it.
    """

    color: str
    hatch: str
    text: str


# Okabe & Ito's palette, told apart by colour-blind readers and in print; more lines repeat.
LINE_COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
SEGMENT_COLORS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7")
OBSTACLE_COLOR = "#777777"
CARRIED_COLOR = "#B58863"
ARM_COLOR, GRIPPER_COLOR = "#AEB8C2", "#6D7C8C"
SWEPT_COLOR = "#7A6FAF"
REFERENCE_COLOR = "#444444"
EXECUTED_COLOR, WARNING_COLOR = "#0072B2", "#D55E00"
# Of motors dark, of speeds lighter, of the way that is taken in greys; told apart by hatches too.
BINDING_STYLES = {
    "effort": BindingStyle("#D55E00", "", "white"),
    "motor_curve": BindingStyle("#8C3A00", "....", "white"),
    "effort_rate": BindingStyle("#E69F00", "----", "black"),
    "velocity": BindingStyle("#0072B2", "////", "white"),
    "velocity_by_position": BindingStyle("#56B4E9", "////", "black"),
    "acceleration": BindingStyle("#009E73", "\\\\\\\\", "white"),
    "jerk": BindingStyle("#CC79A7", "xxxx", "black"),
    "tool_speed": BindingStyle("#003F66", "oooo", "white"),
    "point_speed": BindingStyle("#8FC7EE", "oooo", "black"),
    "position": BindingStyle("#F0E442", "||||", "black"),
    "tube": BindingStyle("#555555", "", "white"),
    "rotation": BindingStyle("#999999", "....", "black"),
    "obstacles": BindingStyle("#222222", "", "white"),
    "self_collision": BindingStyle("#777777", "xxxx", "white"),
}
OTHER_BINDING = BindingStyle("#BBBBBB", "++++", "black")
CLOSEST_COLOR = "#C1121F"
BLOCKED_COLOR = "#C1121F"
AXIS_COLORS = ("#D1242F", "#2DA44E", "#0969DA")  # x red, y green, z blue, as everywhere
CONE_COLOR = "#E69F00"
START_COLOR, END_COLOR = "#009E73", "#D55E00"  # of the arm there
# From slow to fast: dark to light, so that it also reads without any colour (viridis).
SPEED_COLORS = (
    *("#440154", "#472D7B", "#3B528B", "#2C728E", "#21918C"),
    *("#28AE80", "#5EC962", "#ADDC30", "#FDE725"),
)


def segment_color(segment: int) -> str:
    """Return the colour of a tube segment."""
    return SEGMENT_COLORS[segment % len(SEGMENT_COLORS)]


def rgb(color: str) -> FloatArray:
    """Return "#RRGGBB" as red, green and blue from 0 to 1, shape (3,)."""
    return np.array([int(color[i : i + 2], 16) for i in (1, 3, 5)]) / 255


def speed_colors(share: FloatArray) -> FloatArray:
    """Return colours of shares (N,) of the highest speed, from 0 to 1: shape (N, 3)."""
    table = np.array([rgb(color) for color in SPEED_COLORS])
    stops = np.linspace(0.0, 1.0, len(table))
    return np.column_stack([np.interp(share, stops, table[:, i]) for i in range(3)])
