"""The printed results of Suh & Bishop (1988), and the errors in them.

J. Robotic Systems 5(6), 497-525; Tables II to IV. Durations are in seconds, tolerances in metres;
`NO_TUBE` stands for a tool that may go anywhere.
"""

import math
from dataclasses import dataclass
from types import MappingProxyType

NO_TUBE = math.inf


@dataclass(frozen=True)
class PrintedExample:
    """One of the five paths of Table II.

    Attributes:
        conventional: Straight lines with stops [s].
        phases: By tolerance [m]: the durations after phase 1 and after phase 2 [s].
        remark: A remark on the printed numbers; empty: none.
    """

    conventional: float
    phases: MappingProxyType[float, tuple[float, float]]
    remark: str = ""


@dataclass(frozen=True)
class PrintedLine:
    """A path of Table III or IV, which are about one line each.

    Attributes:
        example: The example of Table II whose line stands for it.
        bang_bang: The least time on the line itself, if motors switch instantly [s].
        smoothed: The same with the paper's cost of smoothness, 26 % [s].
        durations: By tolerance [m] [s].
        shown: The tolerances that its figures show [m].
        remark: A remark on the printed numbers.
    """

    example: int
    bang_bang: float
    smoothed: float
    durations: MappingProxyType[float, float]
    shown: tuple[float, ...]
    remark: str


def _phases(*durations: tuple[float, float]) -> MappingProxyType[float, tuple[float, float]]:
    return MappingProxyType(dict(zip((0.01, 0.03, 0.05), durations, strict=True)))


_OTHER_SUM = "1.93 s is printed where the formula gives 1.82 s for the printed points"

TABLE_TWO = MappingProxyType(
    {
        1: PrintedExample(1.96, _phases((1.08, 0.90), (1.04, 0.75), (1.04, 0.73))),
        2: PrintedExample(
            1.00,
            _phases((0.44, 0.40), (0.44, 0.39), (0.44, 0.39)),
            "the goal is printed as (0.6, 0.3), out of reach at 0.67 m; the conventional time "
            "belongs to 0.3 m, so the goal is taken as (0.6, 0)",
        ),
        3: PrintedExample(1.93, _phases((1.04, 0.92), (0.95, 0.83), (0.95, 0.80)), _OTHER_SUM),
        4: PrintedExample(1.93, _phases((0.91, 0.80), (0.91, 0.77), (0.88, 0.72)), _OTHER_SUM),
        5: PrintedExample(3.74, _phases((1.91, 1.52), (1.44, 1.26), (1.44, 1.03))),
    }
)

TABLE_THREE = PrintedLine(
    example=1,
    bang_bang=0.72,
    smoothed=0.91,
    durations=MappingProxyType(
        {0.005: 1.18, 0.010: 1.00, 0.020: 0.86, 0.030: 0.84, 0.040: 0.83, 0.050: 0.83}
    ),
    shown=(0.005, 0.010, 0.050),
    remark=(
        "The end points are lost with figure 8(a). Two lines fit the bang-bang time of 0.72 s: "
        "that of example 1 and the chord from (0, 0.6) to (0.6, 0) m. Example 1's is taken, though "
        "Table II prints 0.90, 0.75 and 0.73 s for it where this table has 1.00, 0.84 and 0.83 s."
    ),
)

TABLE_FOUR = PrintedLine(
    example=3,
    bang_bang=0.70,
    smoothed=0.88,
    durations=MappingProxyType(
        {
            **{0.005: 0.98, 0.010: 0.95, 0.020: 0.89, 0.030: 0.85, 0.040: 0.82, 0.050: 0.77},
            **{0.060: 0.68, 0.070: 0.62, NO_TUBE: 0.42},
        }
    ),
    shown=(0.005, 0.030, 0.070),
    remark=(
        "The end points are lost with figure 9(a). Example 3's line fits the bang-bang time of "
        "0.70 s, but the arm of Table I needs 0.617 s even without a tube and with its elbow on "
        "the better side: the printed 0.62 s at 70 mm and 0.42 s without a tube belong to another "
        "line or arm."
    ),
)

# The tolerances of figure 7, which is captioned example 2 and shows example 1.
FIGURE_SEVEN = MappingProxyType({0.01: 0.90, 0.02: 0.85, 0.03: 0.75})
