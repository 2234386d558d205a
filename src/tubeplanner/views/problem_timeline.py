"""The time line of a motion of a problem: in which segment the tool is, and which limit binds."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner.constraints.binding_limits import binding_rows
from tubeplanner.views.page_curves import row_color
from tubeplanner.views.palette import segment_color
from tubeplanner.views.stretch import Stretch, segments_per_group


def problem_timeline(stretch: Stretch) -> dict[str, Any]:
    """Return the time line of a motion of a problem as JSON values."""
    return {"bands": segment_bands(stretch), "rests": [], "binds": binding_marks([stretch])}


def segment_bands(stretch: Stretch) -> list[dict[str, Any]]:
    """Return when the tool is in which segment, or group of segments where there are many."""
    count = stretch.problem.tube.segment_count
    step = segments_per_group(count)
    time, group = stretch.uses.samples.time, stretch.uses.segment // step
    ends = [0, *(np.flatnonzero(np.diff(group)) + 1).tolist(), len(time) - 1]
    return [
        {
            "name": _name(int(group[a]) * step, min((int(group[a]) + 1) * step, count) - 1),
            "begin": float(time[a]),
            "end": float(time[b]),
            "color": segment_color(int(group[a])),
        }
        for a, b in pairwise(ends)
    ]


def binding_marks(stretches: Sequence[Stretch]) -> list[dict[str, Any]]:
    """Return of each joint, the tool and the links when which of its limits binds.

    Those that no limit binds at any time are left out.
    """
    joints = stretches[0].problem.robot.joint_names
    spans: dict[str, list[dict[str, Any]]] = {}
    for stretch in stretches:
        for row in binding_rows(joints, stretch.uses, stretch.closest):
            spans.setdefault(row.name, []).extend(
                {
                    "kind": span.kind.replace("_", " "),
                    "begin": round(stretch.begin + span.begin, 5),
                    "end": round(stretch.begin + span.end, 5),
                }
                for span in row.spans
            )
    return [
        {"name": name, "color": row_color(name, joints), "spans": own}
        for name, own in spans.items()
        if own
    ]


def _name(first: int, last: int) -> str:
    return f"segment {first}" if first == last else f"segments {first} to {last}"
