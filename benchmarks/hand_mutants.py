"""Mutants of physics and geometry that `mutant_operators.py` cannot make.

A wrong frame, a wrong order of indices, a term left out, an extremum of the other kind. A function
is named by its qualified name, so that it may move; a fragment occurs once in it.
"""

HAND_MUTANTS: dict[str, list[tuple[str, str]]] = {
    # Rotations and rigid bodies
    "matrix_of_rpy": [("z @ y @ x", "x @ y @ z")],
    "BodyInertia.placed": [
        ("rotation @ self.inertia @ rotation.T", "rotation.T @ self.inertia @ rotation"),
        ("origin + rotation @ self.com", "origin + self.com"),
    ],
    "BodyInertia.plus": [("part.com - com", "part.com")],
    "BodyInertia.moment": [("eigvalsh(self.inertia)", "diag(self.inertia)")],
    "payload_body": [(".placed(robot.link_placement[robot.tool_frame])", "")],
    "RobotModel.in_root_frame": [("[:3, :3]", "[:3, :3].T")],
    # Kinematics
    "build_model": [("pose * frame.placement", "frame.placement * pose")],
    "frame_velocities": [("rotation @ by_q[..., :3, :]", "rotation @ by_q[..., 3:, :]")],
    "BodyChain.poses": [("sine * across", "angle[..., None, None] * across")],
    "ToolChain.jacobians": [
        (" * carried[:, None]", ""),
        ("pin.LOCAL_WORLD_ALIGNED", "pin.LOCAL"),
    ],
    "effort_rate_derivatives": [("change[1] + mean[0]", "change[1]")],
    # Shapes and distances
    "ConvexShape.transformed": [("placement[:3, :3].T", "placement[:3, :3]")],
    "ConvexShape.reach": [(" + self.radius", "")],
    "cylinder": [("radius / np.cos(np.pi / _PRISM_SIDES)", "radius")],
    "link_parts": [("robot.link_placement[link] @ element.placement", "element.placement")],
    "BodyShapes._measured": [('"pij,pi->pj", frames', '"pij,pj->pi", frames')],
    "BodyShapes.gaps_of_spheres": [(" - radii[second]", "")],
    "PlacedShapes._core_poses": [("rotation @ core[:, :, :3, :3]", "rotation")],
    "PlacedShapes._apart": [("np.maximum(ahead, behind)", "ahead")],
    "separating_directions": [("(local @ first.T).argmax", "(local @ first.T).argmin")],
    # Tubes
    "passing_radius": [("np.minimum", "np.maximum")],
    "Capsules._away": [("fraction[..., None] * axis", "0 * axis")],
    "BoxRegions.half": [(" - self.tool_radius", "")],
    "BoxRegions.margin": [(".min(axis=-1)", ".max(axis=-1)")],
    "BoxRegions.outward": [("side[:, None] * normal", "normal")],
    # Friction, motors and speeds along a path
    "directed_friction": [("* abs(effort)", "* effort")],
    "blended_friction": [("-motors.backwards_friction", "-motors.forwards_friction")],
    "JointEffort.terms": [("at.effort - at.gravity", "at.effort")],
    "SidedEffort.used": [(" + unsure[:, self.joints]", "")],
    "MotorCurve.used": [(" / self._no_load", "")],
    "coulomb_effort": [("np.where(moves, velocity, beside)", "velocity")],
    "EffortRate.terms": [("rate - gravity - viscous", "rate - gravity")],
    "EffortCosts.work": [("np.maximum(power, 0.0)", "abs(power)")],
    "_slow_efforts": [("-gravity - friction.least", "-gravity")],
    "SpeedPolynomial.largest_speed": [("np.minimum.reduce", "np.maximum.reduce")],
    "_ToolLimit.__init__": [("np.minimum(free, of_tube)", "free")],
    "PointRates.by_path": [(" / np.maximum(size, np.finfo(float).tiny)", "")],
    # Bounds between samples
    "rigid_body_majorant": [
        ("inertia.mass * gravity", "0.0"),
        (" + product(arm, force)", ""),
        ("moments[i] if robot.body_is_revolute[i] else forces[i]", "moments[i]"),
    ],
    "_motions": [("parent.origin + link", "link")],
    "joint_bounds": [("comb(degree, k) * ", "")],
    "_taylor_coefficients": [("(width**power)", "(width**degree)")],
    "least_concave_margin": [("margin.min(axis=0) - error", "margin.min(axis=0)")],
    "least_rotation_margin": [("nearest_branch(last, first, _ALL)", "last")],
    "_chord_distance": [("spin + reference_angle * rate", "spin"), ("/ 8 + jump", "/ 8")],
    "_Search._lower_bounds": [("distance - less[batch]", "distance")],
    "_point_velocity": [("location = rotation[:, body] @ in_body[:3] + ", "location = ")],
    "ToolRateMargin._norm": [("self._quantity.derivatives + 1", "self._quantity.derivatives")],
    "_acceleration": [("2 * carried + turning", "carried + turning")],
    # Speed bands
    "judge_tool_speed": [("min(lower, upper", "max(lower, upper")],
    "_floors": [(" and problem.tube.process.steady == REQUIRED", "")],
    "_from_speed": [("1 + lower.margin", "1 - lower.margin")],
    "gates": [
        ("sign * along", "along"),
        ("(stretch.last + 1, stretch.last, 1.0)", "(stretch.last, stretch.last, 1.0)"),
    ],
    "judge_tube": [("beyond = float(", "beyond = -float(")],
    # Held parts
    "Tray.cones": [
        ("(1 - 1 / self.safety) * weight", "0.0"),
        ("/ 2 / self.safety", "/ 2"),
        ("(-_TY, _TX)", "(_TY, -_TX)"),
    ],
    "_twists": [("x * mu, y * mu, z", "x, y, z")],
    "Holding.axes": [("np.cross(z, x), z", "np.cross(x, z), z")],
    "wrench_map": [
        ("traces)", "0 * traces)"),
        ("np.zeros((3, 3)), inertia, gyroscopic", "np.zeros((3, 3)), inertia, 0 * gyroscopic"),
        ("com - middle", "com"),
    ],
    "HoldingLimit._gravity_by_path": [("-_gravity(at)", "_gravity(at)")],
    "HeldPart.__init__": [(" / 2 * np.eye(3) - inertia", " / 2 * np.eye(3)")],
    "HeldPart.wrench": [
        ("np.cumsum(moving, axis=1) - moving", "np.cumsum(moving, axis=1)"),
        ("change[..., 3] -= robot.gravity @ axes", "change[..., 3] -= robot.gravity"),
        ("factor * v[:, joint]", "v[:, joint]"),
    ],
    "HeldPart.quantity": [
        ("self._mass * gravity * unit", "0 * unit"),
        (" + pulled", ""),
        (" + turned[: len(pulled)]", ""),
    ],
    "HeldPart.judged": [("0 if is_at_rest else 2", "2")],
    "judge_holding": [("(False, True)", "(False,)")],
    "_inside": [(" | (still[..., 3] < 0)", ""), (" | (middle < 0)", "")],
    # Simulation
    "Plant.displaced": [("rotation @ self.tool", "self.tool"), (" + self.base", "")],
    "ComputedTorque.effort": [(" + self._plan.friction[k]", "")],
    "Feedback.acceleration": [("plan.start.velocity[k] - v", "-v"), (" * self._period", "")],
    "_drawn_bodies": [(".shifted(by)", "")],
    "_Error.vector": [(" ** (1 / 3)", "")],
}
