"""What a tube's tolerances are called among the limits."""

from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.tube.tube import Tube


def tolerance_keys(tube: Tube) -> list[LimitKey]:
    """Return the keys of all tolerances: of the regions, then of the rotation if it is bounded."""
    of_rotation = [] if tube.rotation is None else rotation_keys(tube)
    return [*(key for own in region_keys(tube) for key in own), *of_rotation]


def region_keys(tube: Tube) -> list[list[LimitKey]]:
    """Return the keys of the tolerances of every segment's region."""
    count = tube.segment_count
    return [[LimitKey(kind, segment=k) for kind in tube.regions.kinds(k)] for k in range(count)]


def rotation_keys(tube: Tube) -> list[LimitKey]:
    """Return the keys of the rotation tolerances, one for each segment."""
    return [LimitKey("rotation", segment=k) for k in range(tube.segment_count)]
