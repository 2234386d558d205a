"""Problems without an answer, each beside the bundled one that it was made from."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

# How much of a plan's processor time a refusal may take: seen before anything is planned, or not.
MOST_EARLY, MOST_LATE = 0.3, 5.0


@dataclass(frozen=True)
class RefusalCase:
    """A bundled problem and what is changed so that it has no answer.

    Attributes:
        name: What makes it impossible.
        bundled: Name of the bundled problem.
        status: How planning must end.
        changes: Sections of the problem file whose keys are replaced; lists grow instead.
        is_early: Whether it can be known before anything is planned.
    """

    name: str
    bundled: str
    status: str
    changes: Mapping[str, Any]
    is_early: bool = False

    @property
    def most(self) -> float:
        """The largest share of a plan's processor time."""
        return MOST_EARLY if self.is_early else MOST_LATE


def changed(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a problem file's content with a case's changes."""
    merged = dict(data)
    for key, value in changes.items():
        before = merged.get(key)
        if isinstance(before, Mapping) and isinstance(value, Mapping) and key != "start":
            merged[key] = {**before, **value}
        elif key == "obstacles":
            merged[key] = [*(before or []), *value]
        else:
            merged[key] = value
    return merged


def _box(size: list[float], position: list[float]) -> dict[str, Any]:
    return {"obstacles": [{"name": "block", "box": size, "position": position}]}


def _ball(radius: float, position: list[float]) -> dict[str, Any]:
    return {"obstacles": [{"name": "block", "sphere": radius, "position": position}]}


_WALL, _POST, _PAPER = "ur5/over_the_wall", "two_link/around_a_post", "two_link/paper_1_30mm"
_SHELF, _CRATE, _PALLET = (
    "panda/between_shelves",
    "xarm7/from_crate_to_crate",
    "ur10/onto_a_conveyor",
)
_TRAY = "ur5/level_tray"
_BLOCKED, _FAR, _HEAVY = "tube_blocked", "unreachable", "gravity_exceeds_effort"


def refusal_cases() -> tuple[RefusalCase, ...]:
    """Return all of them."""
    return (*_early_cases(), *_blocked_cases(), *_other_cases())


def _early_cases() -> tuple[RefusalCase, ...]:
    bar = {"name": "bar", "box": [0.05, 0.05, 0.2], "position": [0, 0, -0.15]}
    far = [[0.45, -0.3, 0.2], [0.45, -0.3, 0.5], [1.5, 0.3, 0.5], [0.45, 0.3, 0.2]]
    far_goal = [[0.45, -0.3, 0.2], [0.45, -0.3, 0.5], [0.45, 0.3, 0.5], [1.2, 0.3, 0.2]]
    far_post = [[0.45, -0.3, 0], [0.45, 0.1, 0], [0.2, 0.1, 0], [0.2, 0.95, 0]]
    return (
        RefusalCase("start in an obstacle", _WALL, _BLOCKED, _ball(0.1, [0.45, -0.3, 0.2]), True),
        RefusalCase("start in an obstacle", _POST, _BLOCKED, _ball(0.1, [0.45, -0.3, 0]), True),
        RefusalCase(
            "start in an obstacle", _CRATE, _BLOCKED, _ball(0.1, [0.38, -0.24, 0.12]), True
        ),
        RefusalCase("goal in an obstacle", _SHELF, _BLOCKED, _ball(0.1, [0.6, 0, 0.72]), True),
        RefusalCase("goal in an obstacle", _CRATE, _BLOCKED, _ball(0.1, [0.38, 0.24, 0.12]), True),
        RefusalCase("goal in an obstacle", _PALLET, _BLOCKED, _ball(0.1, [0.7, 0.45, 0.43]), True),
        RefusalCase("start in itself", _WALL, _BLOCKED, {"robot": {"attached": [bar]}}, True),
        RefusalCase("start too near", _SHELF, _BLOCKED, {"clearance": 0.2}, True),
        RefusalCase("heavy at start", _WALL, _HEAVY, {"robot": {"payload": {"mass": 60.0}}}, True),
        RefusalCase("heavy at start", _SHELF, _HEAVY, {"robot": {"payload": {"mass": 60.0}}}, True),
        RefusalCase("middle out of reach", _WALL, _FAR, {"tube": {"points": far}}, True),
        RefusalCase("goal out of reach", _WALL, _FAR, {"tube": {"points": far_goal}}, True),
        RefusalCase("goal out of reach", _POST, _FAR, {"tube": {"points": far_post}}, True),
    )


def _blocked_cases() -> tuple[RefusalCase, ...]:
    return (
        RefusalCase("plate", _WALL, _BLOCKED, _box([0.3, 0.02, 0.3], [0.45, 0, 0.5])),
        RefusalCase("plate", _POST, _BLOCKED, _box([0.02, 0.12, 0.4], [0.33, 0.1, 0])),
        RefusalCase("plate", _PAPER, _BLOCKED, _box([0.02, 0.02, 0.4], [0.3, 0, 0])),
        RefusalCase("plate", _SHELF, _BLOCKED, _box([0.08, 0.14, 0.02], [0.38, 0, 0.6])),
        RefusalCase("plate", _CRATE, _BLOCKED, _box([0.14, 0.02, 0.14], [0.38, 0, 0.38])),
        RefusalCase("plate", _PALLET, _BLOCKED, _box([0.2, 0.02, 0.2], [0.7, 0, 0.65])),
        RefusalCase("plate", _TRAY, _BLOCKED, _box([0.3, 0.02, 0.3], [0.45, 0, 0.525])),
        RefusalCase("corner", _WALL, _BLOCKED, _ball(0.12, [0.45, -0.3, 0.5])),
        RefusalCase("corner", _POST, _BLOCKED, _ball(0.06, [0.2, 0.1, 0])),
        RefusalCase("open goal", _WALL, _BLOCKED, _ball(0.08, [0.45, 0.3, 0.2])),
        RefusalCase("open goal", _POST, _BLOCKED, _ball(0.05, [0.2, 0.45, 0])),
        RefusalCase("clearance", _POST, _BLOCKED, {"clearance": 0.15}),
    )


def _other_cases() -> tuple[RefusalCase, ...]:
    kept = {"elbow_joint": "+", "shoulder_pan_joint": [-1.2, -0.2]}
    weak = {"limits": {"effort": {"shoulder_lift_joint": 25.0}}}
    to_one_side, wrist = {"shoulder_pan_joint": [-1.2, 0.0]}, {"wrist_1_joint": [-2.3, -1.5]}
    far = [[0.45, -0.3, 0.2], [0.45, -0.3, 0.525], [0.78, 0.5, 0.525], [0.45, 0.3, 0.2]]
    return (
        RefusalCase("joint signs", _WALL, _FAR, {"tube": {"joint_signs": kept}}),
        RefusalCase("heavy on the way", _WALL, _HEAVY, {"robot": weak}),
        RefusalCase("joint limit", _TRAY, _FAR, {"robot": {"limits": {"position": to_one_side}}}),
        RefusalCase("limit of the wrist", _TRAY, _FAR, {"robot": {"limits": {"position": wrist}}}),
        RefusalCase("middle out of reach", _TRAY, _FAR, {"tube": {"points": far}}),
    )
