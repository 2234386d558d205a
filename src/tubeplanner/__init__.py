"""Smooth, certified joint trajectories of a robot arm whose tool stays in a tolerance tube.

Letters used everywhere: N samples, K control points, n joints, m tube segments (m+1 reference
points). Units are SI and radians; positions are in the base frame, that of the URDF's root link
unless a base says where that stands.

    problem = load_problem("example:ur5/over_the_wall")
    result = plan(problem)

Names are loaded on first use, so that `import tubeplanner` stays quick; `__init__.pyi` lists them.
Data flows one way, through folders whose order `[tool.importlinter]` in `pyproject.toml` has.
"""

from typing import Any

import lazy_loader

from tubeplanner.errors import warn_of_former_name

# The one place: the build, the pages, all files and the release workflow read this line.
__version__ = "0.2.0"

_present, _, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ = sorted([*__all__, "__version__"])

_FORMER_NAMES = {
    "Blame": "ErrorContribution",
    "GivenStand": "GivenPlacement",
    "Place": "Location",
    "PosedProblem": "ProblemSpec",
    "Room": "Headroom",
    "Stand": "BasePlacement",
}


def __getattr__(name: str) -> Any:
    """Return a public object, loaded on first use; a former name warns."""
    if name in _FORMER_NAMES:
        warn_of_former_name(f"tubeplanner.{name}", _FORMER_NAMES[name])
    return _present(_FORMER_NAMES.get(name, name))


def __dir__() -> list[str]:
    return __all__
