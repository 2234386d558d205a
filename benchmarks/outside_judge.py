"""Is a trajectory right by Pinocchio and coal alone, at samples, apart from the certificate?

    python benchmarks/outside_judge.py PROBLEM.yaml TRAJECTORY.json [--json] [--tolerance 1e-5]

PROBLEM.yaml may be a cycle, of which every leg and every seam is judged. Nothing of tubeplanner is
imported: the problem file, the trajectory, the URDF and the meshes are read anew (OBJ files by
trimesh), the links' true triangles take the place of convex covers. 5,000 uniform samples and both
sides of every breakpoint are looked at, with steps near a limit divided by 20. Exit status: 0 it
passes, 1 it fails, 2 the files cannot be judged; a field that is not known here is refused by name.
"""

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from outside.conditions import Condition
from outside.cycle_judge import judge_cycle
from outside.files import BadInput, read_document
from outside.judge import Judge
from outside.trajectory import read_trajectory

# [m], [rad] and relative. A trajectory is certified to 1e-6; distances by coal are good to about as
# much, and a fault that matters is larger than a hundredth of a millimetre.
TOLERANCE = 1e-5


def judge(problem: str | Path, trajectory: str | Path) -> dict[str, Condition]:
    """Return what the outside judge says of a trajectory file, for a problem or a cycle.

    Raises:
        BadInput: A file cannot be judged.
    """
    fields = read_document(Path(problem))
    if isinstance(fields, dict) and fields.get("format") == "tubeplanner/cycle":
        return judge_cycle(Path(problem), Path(trajectory))
    return Judge(problem).judge(read_trajectory(Path(trajectory)))


def passes(conditions: dict[str, Condition], tolerance: float = TOLERANCE) -> bool:
    """Return whether all conditions hold."""
    return all(condition.holds(tolerance) for condition in conditions.values())


def table(conditions: dict[str, Condition], tolerance: float = TOLERANCE) -> str:
    """Return the conditions as lines of text."""
    width = max(15, *(len(name) + 1 for name in conditions))
    lines = [f"{'condition':<{width}}{'margin':>12} {'unit':<9}{'time [s]':>9}  where"]
    for name, each in conditions.items():
        if each.margin is None:
            lines.append(f"{name:<{width}}{'not asked':>12}")
            continue
        mark = "" if each.holds(tolerance) else "  BROKEN"
        time = "" if each.time is None else f"{each.time:.4f}"
        lines.append(
            f"{name:<{width}}{each.margin:>12.3g} {each.unit:<9}{time:>9}  {each.where}{mark}"
        )
    return "\n".join(lines)


def as_dict(conditions: dict[str, Condition], tolerance: float = TOLERANCE) -> dict[str, Any]:
    """Return the verdict as JSON has it."""
    each = {name: asdict(one) | {"holds": one.holds(tolerance)} for name, one in conditions.items()}
    return {"passes": passes(conditions, tolerance), "tolerance": tolerance, "conditions": each}


def main(arguments: list[str] | None = None) -> int:
    """Print a verdict and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problem", type=Path)
    parser.add_argument("trajectory", type=Path)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--tolerance", type=float, default=TOLERANCE, help="m, rad and relative")
    options = parser.parse_args(arguments)
    try:
        found = judge(options.problem, options.trajectory)
    except BadInput as error:
        print(error, file=sys.stderr)
        return 2
    if options.json:
        print(json.dumps(as_dict(found, options.tolerance), allow_nan=False))
    else:
        print(table(found, options.tolerance))
        print("passes" if passes(found, options.tolerance) else "fails")
    return 0 if passes(found, options.tolerance) else 1


if __name__ == "__main__":
    sys.exit(main())
