"""How links are covered: pairs left out before and now, how far covers stand off, loading times.

    python benchmarks/covers.py [ROBOT ...]

For every robot of example-robot-data, with the leaf farthest from the root as the tool. "Before":
pairs whose usual covers touch in all of 400 configurations, which was the reason to leave them out.
"""

import argparse
import os
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from itertools import combinations
from pathlib import Path

from tubeplanner import RobotModel, load_robot
from tubeplanner.collision.collision_checker import ALWAYS_TOUCHING, CollisionChecker
from tubeplanner.collision.cover_cache import VARIABLE
from tubeplanner.collision.cover_error import cover_error
from tubeplanner.collision.link_geometry import link_parts, link_shapes
from tubeplanner.collision.link_pairs import LinkJudge
from tubeplanner.errors import TubePlannerError
from tubeplanner.resources import example_robot_names, find_description


def deepest_link(name: str) -> str:
    """Return the link that most movable joints carry."""
    root = ElementTree.parse(find_description(f"example:{name}", Path("."))).getroot()
    parent = {}
    for joint in root.findall("joint"):
        moves = joint.get("type") in ("revolute", "continuous", "prismatic")
        parent[joint.find("child").get("link")] = (joint.find("parent").get("link"), moves)

    def joints(link: str) -> int:
        above, moves = parent.get(link, (None, False))
        return 0 if above is None else joints(above) + moves

    return max((link.get("name") for link in root.findall("link")), key=joints)


def timed_checker(robot: RobotModel) -> tuple[CollisionChecker, float]:
    """Return a robot's geometry and how long it took to build [s]."""
    begin = time.perf_counter()
    return CollisionChecker(robot), time.perf_counter() - begin


def row(name: str) -> str:
    """Return a robot's row of the table."""
    robot = load_robot(f"example:{name}", deepest_link(name))
    with tempfile.TemporaryDirectory() as folder:
        os.environ[VARIABLE] = folder
        (_, cold), (checker, warm) = timed_checker(robot), timed_checker(robot)
    os.environ[VARIABLE] = "off"
    now = [pair.links for pair in checker.left_out if pair.reason == ALWAYS_TOUCHING]
    parts_of, covers = link_parts(robot), link_shapes(robot)
    judge = LinkJudge(robot, parts_of, covers)
    checked = {frozenset(checker.owners(pair)[0]) for pair in checker.link_pairs}
    candidates = [pair for pair in combinations(covers, 2) if frozenset(pair) in checked]
    before = [*now, *(pair for pair in candidates if judge.overlapping(pair))]
    worst = 0.0
    for parts in parts_of.values():
        for part in parts:
            if part.mesh is not None:
                worst = max(worst, cover_error(part.mesh.solid, part.mesh.cover()))
    return (
        f"| {name} | {len(before)} | {len(now)} | {', '.join('-'.join(pair) for pair in now)} "
        f"| {1000 * worst:.1f} | {cold:.2f} | {warm:.2f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="*", metavar="ROBOT")
    names = parser.parse_args().robots or example_robot_names()
    print(
        "| robot | left out before | now | always touching | outer error [mm] | cold [s] | warm |"
    )
    print("|---|---|---|---|---|---|---|")
    for name in names:
        try:
            print(row(name), flush=True)
        except TubePlannerError as error:
            print(f"| {name} | {error} |", flush=True)


if __name__ == "__main__":
    main()
