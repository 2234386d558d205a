"""An arm and what stands around it as a Drake plant, for `drake_rival.py`."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from pydrake.common import MemoryFile
from pydrake.geometry import (
    CollisionFilterDeclaration,
    Convex,
    GeometryId,
    GeometrySet,
    InMemoryMesh,
    ProximityProperties,
    SceneGraph,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    PrismaticJoint,
    RevoluteJoint,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.framework import Context, DiagramBuilder

from transcription_program import joint_axes
from tubeplanner import PlanningProblem
from tubeplanner.collision.collision_checker import BodyShape
from tubeplanner.collision.convex_shape import ConvexShape

AGREEMENT = 1e-8  # with RobotModel, relative to the largest value
AMPLE = 1e6  # an effort limit that is not given


@dataclass(frozen=True, eq=False)
class DrakeArm:
    """A finished plant with its context.

    Attributes:
        plant: The arm; positions are in group order.
        context: Of the plant, in a diagram with the geometry.
        diagram_context: What the context is part of; it must live as long.
        tool: The body that carries the tool centre point.
        tool_point: In the body's frame, shape (3,) [m].
        lines: Frames at the beginning of the tube's segments, z along them.
    """

    plant: MultibodyPlant
    context: Context
    diagram_context: Context
    tool: Frame
    tool_point: np.ndarray
    lines: list[Frame]


def drake_arm(problem: PlanningProblem) -> DrakeArm:
    """Return the arm of a problem; only the pairs that we check can collide."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    bodies = _add_bodies(plant, problem)
    shapes = [
        _add_shape(plant, bodies[shape.body], shape, index)
        for index, shape in enumerate(problem.collision.shapes)
    ]
    points = problem.tube.points
    lines = [
        plant.AddFrame(
            FixedOffsetFrame(f"line {k}", plant.world_frame(), _placement(_turn(along), begin))
        )
        for k, (begin, along) in enumerate(zip(points[:-1], np.diff(points, axis=0), strict=True))
    ]
    plant.mutable_gravity_field().set_gravity_vector(problem.robot.gravity)
    plant.Finalize()
    _allow_pairs_only(scene_graph, problem, shapes)
    diagram = builder.Build()
    diagram_context = diagram.CreateDefaultContext()
    model = problem.robot._model
    frame = model.frames[problem.robot._tool_id]
    arm = DrakeArm(
        plant,
        plant.GetMyMutableContextFromRoot(diagram_context),
        diagram_context,
        bodies[frame.parentJoint].body_frame(),
        frame.placement.translation,
        lines,
    )
    _require_agreement(arm, problem)
    return arm


def _add_bodies(plant: MultibodyPlant, problem: PlanningProblem) -> list[RigidBody]:
    """Return all bodies of the plant, in Pinocchio's order; body 0 is the world."""
    robot, model = problem.robot, problem.robot._model
    assert [robot.body_joints[body] for body in range(1, model.njoints)] == list(
        range(robot.joint_count)
    ), "the group is not in chain order"
    axes = joint_axes(model)
    bodies = [plant.world_body()]
    for index in range(1, model.njoints):
        name, placement = f"body {index}", model.jointPlacements[index]
        body = plant.AddRigidBody(name, _inertia(model.inertias[index]))
        base = FixedOffsetFrame(
            f"base of {name}",
            bodies[model.parents[index]].body_frame(),
            _placement(placement.rotation, placement.translation),
        )
        group = robot.body_joints[index]
        kind = RevoluteJoint if robot.revolute[group] else PrismaticJoint
        joint = plant.AddJoint(
            kind(f"joint {group}", plant.AddFrame(base), body.body_frame(), axes[index])
        )
        limit = robot.limits.effort[group]
        plant.AddJointActuator(f"motor {group}", joint, limit if np.isfinite(limit) else AMPLE)
        bodies.append(body)
    return bodies


def _inertia(inertia: pin.Inertia) -> SpatialInertia:
    moment = inertia.inertia
    about_com = RotationalInertia(*np.diag(moment), moment[0, 1], moment[0, 2], moment[1, 2])
    return SpatialInertia.MakeFromCentralInertia(inertia.mass, inertia.lever, about_com)


def _add_shape(plant: MultibodyPlant, body: RigidBody, shape: BodyShape, index: int) -> GeometryId:
    assert shape.shape.radius == 0, "rounded shapes are not carried over"
    convex = Convex(InMemoryMesh(mesh_file=MemoryFile(_obj(shape.shape), ".obj", shape.owner)))
    return plant.RegisterCollisionGeometry(
        body, RigidTransform(), convex, f"shape {index}", ProximityProperties()
    )


def _obj(shape: ConvexShape) -> str:
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in shape.vertices.tolist()]
    return "\n".join(rows + [f"f {a} {b} {c}" for a, b, c in (shape.faces + 1).tolist()])


def _allow_pairs_only(
    scene_graph: SceneGraph, problem: PlanningProblem, shapes: list[GeometryId]
) -> None:
    rules = CollisionFilterDeclaration().ExcludeWithin(GeometrySet(shapes))
    checker = problem.collision
    for i, j in np.vstack([checker.obstacle_pairs, checker.link_pairs]):
        rules.AllowBetween(GeometrySet(shapes[i]), GeometrySet(shapes[j]))
    scene_graph.collision_filter_manager().Apply(rules)


def _placement(rotation: np.ndarray, translation: np.ndarray) -> RigidTransform:
    return RigidTransform(RotationMatrix.ProjectToRotationMatrix(rotation), translation)


def _turn(along: np.ndarray) -> np.ndarray:
    return RotationMatrix.MakeFromOneVector(along, 2).matrix()


def _require_agreement(arm: DrakeArm, problem: PlanningProblem) -> None:
    """Compare tool and efforts with ours at random states."""
    robot, plant = problem.robot, arm.plant
    for state in np.random.default_rng(0).uniform(-1, 1, (10, 3, robot.joint_count)):
        q, v, a = state
        plant.SetPositions(arm.context, q)
        plant.SetVelocities(arm.context, v)
        effort = plant.CalcMassMatrix(arm.context) @ a + plant.CalcBiasTerm(arm.context)
        effort -= plant.CalcGravityGeneralizedForces(arm.context)
        tool = plant.CalcPointsPositions(arm.context, arm.tool, arm.tool_point, plant.world_frame())
        for found, wanted in (
            (effort, robot.inverse_dynamics(q[None], v[None], a[None])[0]),
            (tool[:, 0], robot.tool_position(q[None])[0]),
        ):
            assert abs(found - wanted).max() <= AGREEMENT * max(1.0, abs(wanted).max())
