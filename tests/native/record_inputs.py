"""Records inputs of the native functions from plans, and edge cases, for `driver.cpp`.

    PYTHONPATH=src:tests/helpers python tests/native/record_inputs.py

Needed when a native function takes other arguments, or a new one is written.
"""

import ctypes
import lzma
import struct
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from native_exports import exports

from tubeplanner.native import library

INPUTS = Path(__file__).parent / "inputs.xz"
PLANS = ("example:two_link/around_a_post", "example:ur5/over_the_wall")
MAX_CALLS = 3  # of a function and number of joints or the like
MAX_BYTES = {"program": 150_000, "call": 50_000}
# Arrays that a function reads before it writes to them, or may leave as they are.
ALSO_READ = {"direction", "bound", "changes", "order", "q"}
ALSO_READ |= {"tree_q", "reach", "parent", "state"}
LEFT = {"near_rows": ("control", "switching"), "compressed_rows": ("column", "value")}
ALWAYS_LEFT = ("centers",)
SHAPES = (("body", 1), ("begin", 1), ("size", 1), ("points", 0), ("radius", 1), ("center", 3))
SHAPES += (("reach", 1), ("axes", 9), ("middle", 3), ("half", 3))


class Recorder:
    def __init__(self):
        self.exports = exports()
        self.kept = []  # calls, or the calls of a program
        self.counts = {}
        self.programs = {}  # by handle: calls without its slot
        self.takes_all = False

    def wrapped(self, name, *types, returns=None):
        function = ORIGINAL(name, *types, returns=returns)
        assert function is not None, library.LIBRARY.build
        is_program = name.startswith("step_program_")

        def call(*given):
            key = name, tuple(one for one in given if isinstance(one, int) and one < 10)
            packed = self.packed(name, given) if is_program or self.wants(key) else None
            result = function(*given)
            if is_program:
                self.add_to_program(name, given, result, packed)
            elif packed is not None and len(packed) <= MAX_BYTES["call"]:
                self.keep(key, [(packed,)])
            return result

        return call

    def wants(self, key):
        return self.takes_all or self.counts.get(key, 0) < MAX_CALLS

    def keep(self, key, calls):
        if self.wants(key):
            self.counts[key] = self.counts.get(key, 0) + 1
            self.kept.append(calls)

    def add_to_program(self, name, given, result, packed):
        if name == "step_program_new":
            self.programs[result] = [(packed,)]
            return
        head, tail = packed
        calls = self.programs[given[0]]
        calls.append((head, tail))
        if name == "step_program_delete":
            del self.programs[given[0]]
            if sum(len(part) for call in calls for part in call) <= MAX_BYTES["program"]:
                self.keep(("program", len(calls) > 12), calls)

    def packed(self, name, given):
        """Return a call as bytes; of a program, what comes before and after its number."""
        export = self.exports[name]
        head = struct.pack("q", len(name)) + name.encode()
        parts = []
        for argument, value in zip(export.arguments, given, strict=True):
            if argument.type == "void*":
                continue
            if argument.type == "const Shapes*":
                parts.append(packed_shapes(value))
            elif "*" in argument.type:
                is_read = argument.type.startswith("const") or argument.name in ALSO_READ
                is_left = argument.name in (*ALWAYS_LEFT, *LEFT.get(name, ()))
                parts.append(packed_array(value, is_read or is_left, is_read))
            else:
                parts.append(struct.pack("d" if argument.type == "double" else "q", value))
        if any(argument.type == "void*" for argument in export.arguments):
            return head, b"".join(parts)
        return head + b"".join(parts)

    def contents(self):
        """Return all that was kept, programs numbered."""
        found, slot = [], 0
        for calls in self.kept:
            for call in calls:
                found.append(struct.pack("q", slot).join(call))
            slot += len(calls) > 1
        return b"".join(found)


def packed_array(array, is_stored, is_read):
    if array is None:
        return struct.pack("q", -1)
    if not is_stored:
        return struct.pack("qq", array.size, 0)
    data = array if is_read else np.zeros_like(array)
    return struct.pack("qq", array.size, 1) + np.ascontiguousarray(data).tobytes()


def packed_shapes(address):
    from tubeplanner.geometry.body_shapes import NativeShapes

    shapes = NativeShapes.from_address(address)
    sizes = np.ctypeslib.as_array(ctypes.cast(shapes.size, LONGS), (shapes.count,))
    parts = [struct.pack("q", shapes.count)]
    for name, width in SHAPES:
        kind = LONGS if name in ("body", "begin", "size") else REALS
        count = width * shapes.count if width else 3 * int(sizes.sum())
        array = np.ctypeslib.as_array(ctypes.cast(getattr(shapes, name), kind), (count,))
        parts.append(packed_array(array, True, True))
    return b"".join(parts)


def plan_problems_and_measure_a_tube():
    from tubeplanner import PlanOptions, load_problem, measure_tube, plan
    from tubeplanner.first_guess.joint_routes import RouteSearch, _Trees

    for name in PLANS:
        assert plan(load_problem(name), PlanOptions(quality="fast")).succeeded
    assert measure_tube(load_problem(PLANS[0])).succeeded
    problem = load_problem("example:two_link/through_the_gap", reads_tube=False)
    search = RouteSearch(problem, problem.start, problem.goal[None])
    assert next(search.routes(1, 1000), None) is not None
    trees = _Trees((problem.start[None], problem.goal[None]), 1)
    trees.reserve(60)
    search._grow(trees, 40)


def no_samples():
    """Call every function with no rows."""
    from tubeplanner.first_guess import inverse_kinematics
    from tubeplanner.geometry.tube import regions
    from tubeplanner.limits import speed_polynomial as speed_roots
    from tubeplanner.optimizer.region_constraints import EvaluatedRegions, Planes
    from tubeplanner.robot import kinematics, model

    none = np.zeros(0)
    table, q = np.zeros((2, 41)), np.zeros((0, 2))
    rotation, position = np.zeros((0, 3, 3, 3)), np.zeros((0, 3, 3))
    kinematics._body_poses(table, 2, q, 2, 0, rotation, position)
    last = (rotation[:, 0], position[:, 0])
    kinematics._last_poses(table, 2, q, 2, 0, *last, np.zeros((0, 6, 2)))
    one = (np.zeros((1, 2)), 2, 1, np.zeros((1, 3, 3)), np.zeros((1, 3)))
    kinematics._last_poses(table[:0], 0, *one, None)
    points = (none.astype(int), np.zeros((0, 3)))
    model._point_jacobians(table, 2, rotation, position, *points, 2, 0, np.zeros((0, 3, 2)))
    joints = (q, q, q, q)
    settings = np.ones(20)
    inverse_kinematics.native_solve_positions(table, settings, np.zeros((0, 3)), joints, None)
    axes = (np.zeros((1, 3)), np.ones((1, 3)))
    regions.away_from_axes(np.zeros((0, 3)), axes, np.zeros(0, int), 1e-9)
    planes = Planes(np.zeros(0, int), np.zeros((0, 3)), *np.zeros((2, 0), int))
    capsules = regions.Capsules(*axes, np.ones(1))
    EvaluatedRegions(None, np.zeros((0, 3)), None, capsules, np.zeros(0, int), none, None).slack(
        planes
    )
    speed_roots.largest_speeds({0: none, 1: none}, (1.0,))
    no_rows_of_splines()
    for count in (0, 1):
        measure_pairs(count)


def no_rows_of_splines():
    from tubeplanner.optimizer.phased_spline import KnotGrid, PhasedSpline, Samples, sampled
    from tubeplanner.optimizer.rows import StepSize, plane_rows

    grid, times = KnotGrid((np.array([0.0, 1.0]),)), np.array([0.0, 1.0])
    none = Samples(np.zeros(0, int), np.zeros(0), np.zeros(0, int))
    at = sampled(PhasedSpline(grid, times, np.zeros((4, 1))), none)
    at.chained({0: np.zeros((0, 1, 1))})
    size = StepSize(0.1, np.zeros(0))
    rows = plane_rows(at, np.zeros((0, 1, 1)), np.zeros((0, 1)), np.zeros(0, int), size)
    rows.reach(size)
    rows.used_by_step(np.zeros((4, 1)), np.zeros(0), 0.0)


def measure_pairs(count):
    """Call the functions of pairs with no pairs, and with one of two points."""
    from tubeplanner.geometry.body_shapes import BodyShape, BodyShapes
    from tubeplanner.geometry.convex_shapes import ConvexShape

    points = [np.zeros((1, 3)), np.ones((1, 3))]
    shapes = BodyShapes(
        None, [BodyShape("", k, ConvexShape(each)) for k, each in enumerate(points)]
    )
    poses = np.tile(np.eye(3), (count, 2, 1, 1)), np.zeros((count, 2, 3))
    shapes.robot = SimpleNamespace(body_poses=lambda q: poses)
    pairs, row = np.array([[0, 1]])[:count], np.zeros(count, int)
    shapes.sphere_distances(*poses, pairs)
    shapes.box_distances(*poses, row, pairs)
    shapes.separations_along(*poses, pairs, np.tile([1.0, 0.0, 0.0], (count, 1)), row)
    shapes.closest_points(*poses, pairs, row)
    shapes.near_distances(row, pairs, np.ones((count, count)), np.zeros((count, count)))


def small_programs():
    """Solve programs of one variable, without rows, with one that has no entry, again and anew."""
    from tubeplanner.optimizer import step_program as native

    for band in (0, 1):
        one, none = np.ones(1), np.zeros(0, int)
        program = native._new(1, band, 0 * one, one, -one, one)
        native._solve(program, 1e-8, 100)
        native._add_quadratic(program, 1, np.zeros(1, int), np.zeros(1, int), one)
        native._add_rows(program, 1, np.ones(1, int), np.zeros(1, int), -one, 0.5 * one)
        native._solve(program, 1e-8, 100)
        native._set_slack(program, 0.25 * one)
        native._add_rows(program, 1, np.zeros(1, int), none, np.zeros(0), one)
        native._add_rows(program, 0, none, none, np.zeros(0), np.zeros(0))
        native._solve(program, 1e-8, 100)
        native._read(program, np.empty(1), np.empty(2))
        native._delete(program)


LONGS, REALS = ctypes.POINTER(ctypes.c_int64), ctypes.POINTER(ctypes.c_double)
ORIGINAL = library.native_function

if __name__ == "__main__":
    recorder = Recorder()
    library.native_function = recorder.wrapped
    plan_problems_and_measure_a_tube()
    recorder.takes_all = True
    no_samples()
    small_programs()
    for argumentless in ("sources", "level", "compiler", "runs_v3"):
        recorder.kept.append([(recorder.packed(f"tubeplanner_{argumentless}", ()),)])
    contents = recorder.contents()
    INPUTS.write_bytes(lzma.compress(contents))
    print(f"{len(contents)} bytes, {INPUTS.stat().st_size} compressed")
