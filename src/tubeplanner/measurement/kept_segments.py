"""Segments that were measured, kept while the segments beside them are parted."""

from dataclasses import replace

from tubeplanner.arrays import FloatArray
from tubeplanner.measurement.configuration_set import ConfigurationSet
from tubeplanner.measurement.segment_measurement import CollisionBoxes, SegmentSearch
from tubeplanner.problem.problem import PlanningProblem


class KeptSegments:
    """What was found for segments, by what that depends on.

    A set serves another branch, too, as long as that one lies inside.
    """

    def __init__(self) -> None:
        """Begin with none."""
        self._found: dict[bytes, list[tuple[CollisionBoxes, SegmentSearch]]] = {}

    def keep(self, key: bytes, boxes: CollisionBoxes, found: SegmentSearch) -> None:
        """Keep what was found for a segment."""
        self._found.setdefault(key, []).append((boxes, found))

    def around(
        self, key: bytes, problem: PlanningProblem, segment: int, branch: FloatArray
    ) -> tuple[CollisionBoxes, SegmentSearch] | None:
        """Return boxes and set of a segment, in its problem, if one holds a branch (P, n).

        Args:
            key: What they depend on.
            problem: The problem whose segment it is now.
            segment: Its index there.
            branch: Along it.
        """
        for boxes, found in self._found.get(key, ()):
            old = found.allowed
            allowed = ConfigurationSet(problem, segment, old.lower, old.upper, old.radius)
            if boxes.collision() is None and allowed.contains(branch).all():
                return boxes.moved_to(problem, segment), replace(found, allowed=allowed)
        return None
