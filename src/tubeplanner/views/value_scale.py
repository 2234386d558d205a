"""Where the values of a field stand on an axis: numbers and factors to scale, others in a row."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.options import is_number
from tubeplanner.problem.field_paths import factor_of
from tubeplanner.resources import EXAMPLE_PREFIX
from tubeplanner.studies.json_values import value_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MAX_LABEL = 24  # [characters] of a value below the axis
_MOST_UPRIGHT = 36  # [characters] of all labels of an axis together that are not turned
_WIDE = 10.0  # the ratio of largest to smallest from which ratios may count more than differences


@dataclass(frozen=True, eq=False)
class ValueScale:
    """The values of a field, and their places.

    Attributes:
        path: Of the field.
        values: As they are given.
        places: Of these values on the axis.
        is_scaled: Whether the places are numbers or factors; else they count the values.
    """

    path: str
    values: Sequence[Any]
    places: FloatArray
    is_scaled: bool

    @classmethod
    def of(cls, path: str, values: Sequence[Any]) -> "ValueScale":
        """Return the places of values; the same values that are not to scale share theirs."""
        factors = [factor_of(value) for value in values]
        for numbers in (values, factors):
            if values and all(is_number(number) for number in numbers):
                places = np.array(numbers, dtype=float)
                if np.isfinite(places).all():
                    return cls(path, values, places, True)
        texts = [value_text(value) for value in values]
        order = {text: place for place, text in enumerate(dict.fromkeys(texts))}
        return cls(path, values, np.array([float(order[text]) for text in texts]), False)

    @property
    def label(self) -> str:
        """What the axis is called."""
        is_factor = self.is_scaled and factor_of(self.values[0]) is not None
        return f"factor on {self.path} [-]" if is_factor else self.path

    @property
    def is_logarithmic(self) -> bool:
        """Whether the values lie more evenly by their ratios than by their differences."""
        if not self.is_scaled or len(self.places) < 3 or min(self.places) <= 0:
            return False
        least, middle, most = min(self.places), np.median(self.places), max(self.places)
        ratio = abs(middle - np.sqrt(least * most)) < abs(middle - (least + most) / 2)
        return bool(ratio and most >= _WIDE * least)

    def draw(self, axis: "Axes", side: Literal["x", "y"] = "x") -> None:
        """Give an axis its name, its scale and, where values stand in a row, their labels."""
        from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

        line = axis.xaxis if side == "x" else axis.yaxis
        axis.set(**{f"{side}label": self.label})
        if self.is_logarithmic:
            axis.set(**{f"{side}scale": "log"})
            line.set_major_locator(LogLocator(subs=(1, 2, 5)))
            line.set_major_formatter(FormatStrFormatter("%g"))
            line.set_minor_formatter(NullFormatter())
        if not self.is_scaled:
            named = dict(zip(self.places.tolist(), map(value_label, self.values), strict=True))
            line.set_ticks(list(named), labels=list(named.values()))
            axis.set(**{f"{side}lim": (min(named) - 0.5, max(named) + 0.5)})
            if side == "x" and sum(map(len, named.values())) > _MOST_UPRIGHT:
                axis.tick_params("x", rotation=20)


def value_label(value: Any) -> str:
    """Return a value as it stands below an axis: of long ones the end, where names differ."""
    if is_number(value):
        return f"{value:.4g}"
    text = value_text(value).removeprefix(EXAMPLE_PREFIX)
    return text if len(text) <= _MAX_LABEL else f"...{text[3 - _MAX_LABEL :]}"
