"""The method of 1988 with so small a budget that tests are quick."""

from tubeplanner.suh_bishop.knot_modification import ModificationOptions
from tubeplanner.suh_bishop.suh_bishop import SuhBishopOptions

BRIEF = SuhBishopOptions(ModificationOptions(halvings=1), 0, 1, 1, max_knots=11, node_budget=100)
