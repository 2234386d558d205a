"""The mutants of `mutants.py`: what is changed where, and which of them may live."""

from typing import NamedTuple


class Mutant(NamedTuple):
    """One wrong line.

    Attributes:
        where: Qualified name of a function, a method or a module's constant.
        old: A fragment that occurs once in it.
        new: What stands there instead.
        reason: Why no test need notice; empty if one must.
    """

    where: str
    old: str
    new: str
    reason: str = ""

    def __str__(self) -> str:
        """Say what is changed where."""
        return f"{self.where}: `{self.old}` -> `{self.new}`"


# Tests of a module beside its own, tests/<folder>/test_<module>.py and test_<module>_*.py.
TESTS = {
    **{
        f"cycle_planning/{name}": ("cycle_planning/test_cycle_planner.py",)
        for name in (
            *("cycle_result", "greedy_plan", "leg_motion", "leg_plan", "other_ends"),
            *("shared_plan",),
        )
    },
    **{
        f"studies/{name}": ("studies/test_placement.py",)
        for name in ("placement_row", "placement_result", "placement_trials")
    },
    "commands/place_report": ("commands/test_place_command.py",),
    "commands/interrupts": ("commands/test_start.py",),
    "staged_file": ("test_staged_file.py", "files/test_output_files_stopped.py"),
    "held_signals": ("test_held_signals.py", "files/test_output_files_stopped.py"),
    "measurement/tool_moves": ("native/test_tool_moves.py",),
    "measurement/clearance_bounds": (
        "native/test_clearance_bounds.py",
        "measurement/test_configuration_set.py",
    ),
    "collision/collision_checker": (
        "verification/test_closest_approach.py",
        "planning/test_planner_base.py",
    ),
    "collision/body_shapes": (
        "collision/test_collision_checker.py",
        "collision/test_near_distances.py",
        "native/test_convex_pairs.py",
        "verification/test_closest_approach.py",
    ),
    "collision/link_pairs": (
        "collision/test_collision_checker.py",
        "collision/test_collision_checker_attached.py",
    ),
    "collision/gilbert": ("native/test_convex_pairs.py", "collision/test_collision_checker.py"),
    "collision/link_geometry": ("collision/test_collision_checker.py",),
    "collision/mesh_cover": ("collision/test_link_geometry.py", "collision/test_obstacle.py"),
    "collision/obstacle": ("collision/test_collision_checker.py",),
    "collision/separation": ("native/test_convex_pairs.py", "collision/test_collision_checker.py"),
    "constraints/joint_effort": (
        "constraints/test_time_scaling.py",
        "refinement/test_spline_constraints.py",
        "test_derivatives.py",
    ),
    "constraints/joint_rate": (
        "constraints/test_time_scaling.py",
        "refinement/test_spline_constraints.py",
    ),
    "constraints/coulomb_friction": (
        "constraints/test_sided_effort.py",
        "refinement/test_spline_constraints.py",
    ),
    "constraints/sided_effort": (
        "constraints/test_effort_limit.py",
        "refinement/test_spline_constraints.py",
    ),
    "constraints/effort_limit": ("refinement/test_spline_constraints.py",),
    "constraints/motor_curve": ("refinement/test_spline_constraints.py",),
    "constraints/effort_refusal": (
        "constraints/test_effort_limit.py",
        "constraints/test_held_configuration.py",
    ),
    "constraints/effort_rate": (
        "constraints/test_time_scaling.py",
        "refinement/test_spline_constraints.py",
        "refinement/test_sensitivities.py",
    ),
    "verification/directed_efforts": (
        "verification/judged/test_effort_motors.py",
        "verification/judged/test_motor_curve.py",
    ),
    "verification/directed_peak": (
        "verification/judged/test_effort_motors.py",
        "verification/judged/test_motor_curve.py",
    ),
    "verification/enclosed_peak": (
        "verification/judged/test_effort.py",
        "verification/judged/test_effort_rate.py",
    ),
    "constraints/path_samples": (
        "refinement/test_spline_constraints.py",
        "constraints/test_time_scaling.py",
    ),
    "baselines/fastest_parameterization": (
        "baselines/test_path_rows.py",
        "baselines/test_tool_path.py",
    ),
    "commands/comparison_report": ("commands/test_report.py",),
    "views/cycle_marks": ("views/test_cycle_plot.py", "views/test_cycle_execution_plot.py"),
    "views/panels": (
        "views/test_motor_panels.py",
        "views/test_plotting.py",
        "views/test_cycle_plot.py",
    ),
    "views/cycle_curves": ("views/test_cycle_plot.py",),
    "views/cycle_panel": ("views/test_cycle_view.py",),
    "views/cycle_scene": ("views/test_cycle_view.py",),
    "views/cycle_timeline": ("views/test_cycle_view.py",),
    "views/shown_poses": ("views/test_cycle_view.py",),
    "views/stretch": ("views/test_page_curves.py",),
    "views/page_panel": ("views/test_viewer.py", "views/test_cycle_view.py"),
    "cycle/cycle": (
        "cycle/test_usual_contacts.py",
        "cycle/test_cell.py",
    ),
    "cycle/motion_of_file": ("commands/test_view_command_cycles.py",),
    "files/cycle_motion_notes": ("commands/test_view_command_cycles.py",),
    "constraints/speed_limits": (
        "constraints/test_time_scaling.py",
        "constraints/test_unused_speed.py",
        "constraints/test_effort_limit.py",
        "constraints/test_time_scaling_motors.py",
    ),
    "constraints/time_scaling": ("constraints/test_unused_speed.py",),
    "constraints/required_of_pairs": (
        "constraints/test_closest_pairs.py",
        "simulation/test_executed_clearance.py",
    ),
    "refinement/speed_limit_rows": ("refinement/test_spline_constraints.py",),
    "constraints/tool_speed": ("refinement/test_spline_constraints.py",),
    "constraints/point_speed": ("refinement/test_spline_constraints.py",),
    "constraints/velocity_by_position": (
        "constraints/test_approachable_range.py",
        "refinement/test_spline_constraints.py",
        "refinement/test_sensitivities.py",
    ),
    "native/library": ("native/test_library.py",),
    "robot/frame_jacobian": ("robot/test_body_chain.py", "native/test_kinematics.py"),
    "robot/tool_chain": ("native/test_kinematics.py",),
    "robot/body_chain": ("native/test_kinematics.py",),
    "branches/inverse_kinematics": ("native/test_inverse_kinematics.py",),
    "problem/checked_fields": ("cycle/test_cycle_format.py", "cycle/test_cycle_reader.py"),
    "problem/solid_fields": (
        "cycle/test_cycle_reader.py",
        "problem/test_problem.py",
    ),
    "problem/problem_faults": (
        "problem/test_problem_format.py",
        "cycle/test_cycle_format.py",
        "problem/test_problem_layers.py",
    ),
    "robot/frame_velocities": ("robot/test_robot_model.py",),
    "refinement/linear_rows": (
        "native/test_spline_rows.py",
        "refinement/test_spline_constraints.py",
        "planning/test_planner_best_known.py",
    ),
    "refinement/refinement": (
        "planning/test_planner_best_known.py",
        "refinement/test_link_constraints.py",
    ),
    "refinement/smoothness_measures": (
        "test_derivatives.py",
        "refinement/test_measured_objective.py",
        "refinement/test_second_stage.py",
    ),
    "refinement/effort_measures": ("test_derivatives.py",),
    "refinement/interval_motion": (
        "test_derivatives.py",
        "refinement/test_measured_objective.py",
    ),
    "refinement/interval_blocks": ("refinement/test_measured_objective.py",),
    "refinement/measured_objective": ("test_derivatives.py",),
    "refinement/objective_measures": ("planning/test_second_stage_plan_energy.py",),
    "refinement/second_stage": (
        "planning/test_second_stage_plan.py",
        "planning/test_planner_motors.py",
        "refinement/test_spline_constraints_motors.py",
    ),
    "planning/blocked_spot": ("planning/test_right_reasons.py",),
    "planning/path_spots": ("planning/test_right_reasons.py",),
    "branches/outside_bounds": ("planning/test_right_reasons.py",),
    "branches/pose_within_tolerance": ("planning/test_right_reasons.py",),
    "planning/gain_note": ("planning/test_second_stage_plan_energy.py",),
    "planning/followed_plan": (
        "planning/test_second_stage_plan_energy.py",
        "planning/test_periodic_plan.py",
        "planning/test_second_stage_plan.py",
    ),
    "planning/certified_motion": ("planning/test_second_stage_plan.py",),
    "files/trajectory_writer": ("planning/test_periodic_plan.py",),
    "refinement/trust_region": (
        "refinement/test_trust_region.py",
        "planning/test_planner_tiny_motions.py",
    ),
    "refinement/step_cost": ("refinement/test_step_cost.py",),
    "refinement/phased_spline": (
        "native/test_spline_basis.py",
        "refinement/test_phased_spline.py",
    ),
    "refinement/sampled_spline": (
        "native/test_spline_basis.py",
        "native/test_spline_rows.py",
        "refinement/test_phased_spline.py",
    ),
    "refinement/region_constraints": (
        "native/test_regions.py",
        "refinement/test_region_constraints.py",
        "refinement/test_spline_constraints.py",
        "refinement/test_sequential_program.py",
    ),
    "tube/segment_regions": ("native/test_regions.py", "tube/test_segment_regions.py"),
    "constraints/speed_polynomial": (
        "native/test_speed_roots.py",
        "constraints/test_speed_polynomial.py",
    ),
    "refinement/rotation_constraints": ("refinement/test_spline_constraints.py",),
    "refinement/goal_constraints": (
        "refinement/test_region_constraints.py",
        "refinement/test_spline_constraints.py",
    ),
    "refinement/tube_constraints": ("refinement/test_spline_constraints.py",),
    "refinement/link_constraints": (
        "refinement/test_spline_constraints.py",
        "refinement/test_link_constraints.py",
    ),
    "refinement/spline_constraints": (
        "refinement/test_spline_constraints.py",
        "refinement/test_sequential_program.py",
        "planning/test_planner_best_known.py",
    ),
    "refinement/linearization": ("refinement/test_sensitivities.py",),
    "refinement/limit_costs": ("refinement/test_sensitivities.py",),
    "refinement/ordered_segments": ("refinement/test_ordered_segments.py",),
    "refinement/step_search": (
        "refinement/test_sequential_program.py",
        "refinement/test_descent.py",
    ),
    "refinement/joint_blocks": ("refinement/test_step_program.py",),
    "refinement/banded_program": (
        "refinement/test_step_program.py",
        "refinement/test_banded_program.py",
        "refinement/test_tied_legs.py",
    ),
    "refinement/symmetric_entries": (
        "refinement/test_step_cost.py",
        "refinement/test_measured_objective.py",
        "refinement/test_step_program.py",
    ),
    "refinement/descent": ("refinement/test_sequential_program.py",),
    "refinement/sequential_program": (
        "refinement/test_sensitivities.py",
        "planning/test_planner_best_known.py",
    ),
    "problem/limit_values": ("problem/test_problem.py",),
    "problem/problem_reader": ("problem/test_problem.py", "problem/test_presets.py"),
    "files/own_fields": ("files/test_problem_file.py",),
    "robot/srdf": ("problem/test_named_endpoint.py",),
    "problem/schema_place": ("problem/test_field_paths.py",),
    "robot/friction_share": ("robot/test_robot_notes.py", "robot/test_unused_note.py"),
    "resources": ("robot/test_xacro_file.py",),
    "robot/xacro_process": ("robot/test_xacro_file.py",),
    "files/part_hashes": ("files/test_motion_notes.py",),
    "robot/per_joint_values": ("robot/test_joint_limits.py", "robot/test_motor_overrides.py"),
    "robot/urdf_friction": ("robot/test_joint_motors.py",),
    "robot/limit_layers": (
        "robot/test_joint_limits.py",
        "robot/test_followers.py",
        "robot/test_joint_motors.py",
    ),
    "robot/joint_info": ("robot/test_robot_info.py",),
    "robot/tool_frames": ("robot/test_robot_info.py",),
    "robot/link_info": ("commands/test_info_command.py",),
    "robot/typical_configurations": ("robot/test_robot_info.py", "robot/test_base_pose.py"),
    "robot/pinocchio_model": ("robot/test_base_pose.py",),
    "problem/problem_info": ("commands/test_info_command.py",),
    "commands/cycle_report": ("commands/test_cycle_check.py",),
    "commands/plan_outputs": ("commands/test_planned.py",),
    "files/starter_file": ("commands/test_init_command.py",),
    "tube_sources/placeholder_limits": ("commands/test_init_command.py",),
    "tube_sources/starter_problem": ("commands/test_init_command.py",),
    "robot/limit_overrides": ("robot/test_joint_limits.py", "robot/test_effort_range.py"),
    "robot/joint_limits": ("robot/test_effort_range.py",),
    "robot/velocity_by_position": ("robot/test_joint_limits.py",),
    "robot/robot_model": (
        "collision/test_collision_checker.py",
        "robot/test_followers.py",
        "robot/test_pinocchio_model_payload.py",
        "robot/test_base_pose.py",
    ),
    "robot/urdf": ("robot/test_base_pose.py",),
    "robot/base_pose": ("planning/test_planner_base.py",),
    "simulation/execution": ("simulation/test_cycle_execution.py",),
    "commands/cycle_execution_report": ("commands/test_simulate_command_cycle.py",),
    "simulation/judged_runs": ("simulation/test_run_summary.py",),
    "simulation/run_verdict": ("simulation/test_run_summary.py",),
    "trajectory/bernstein": ("verification/test_enclosure.py",),
    "verification/certificate": (
        "verification/test_verification.py",
        "verification/test_braking.py",
        "verification/test_slower_runs.py",
    ),
    "verification/closest_approach": ("verification/test_verification_between_samples.py",),
    "verification/enclosed_efforts": (
        "verification/test_enclosure.py",
        "verification/test_enclosed_efforts.py",
        "verification/judged/test_effort_motors.py",
    ),
    "verification/enclosed_pose": ("verification/test_enclosure.py",),
    "verification/joint_extremes": ("verification/test_verification.py",),
    "verification/judged/clearance": (
        "verification/test_asked_distances.py",
        "verification/test_verification.py",
    ),
    "problem/required_distances": (
        "problem/test_contact.py",
        "verification/test_asked_distances.py",
    ),
    "verification/judged/joint_rates": (
        "verification/test_verification.py",
        "verification/judged/test_velocity_by_position.py",
    ),
    "verification/judged/joint_signs": ("verification/test_verification.py",),
    "verification/judged/points": ("verification/test_verification.py",),
    "verification/judged/position": ("verification/test_verification.py",),
    "verification/judged/rotation": (
        "verification/judged/test_rotation.py",
        "verification/test_rotation_visits.py",
    ),
    "verification/judged/tube": ("verification/test_verification.py",),
    "many/plan_either": ("many/test_plan_many.py",),
    "many/worker": ("many/test_worker_processes.py",),
    "verification/judged_condition": ("verification/test_verification.py",),
    "verification/judged_motion": (
        "verification/test_verification.py",
        "verification/judged/test_continuity.py",
        "verification/judged/test_rest.py",
    ),
    "verification/limit_sides": (
        "verification/test_braking.py",
        "verification/test_slower_runs.py",
    ),
    "verification/majorants": (
        "verification/test_enclosure.py",
        "verification/judged/test_point_speed.py",
    ),
    "verification/tube_visits": (
        "verification/judged/test_tool_speed.py",
        "verification/test_verification_between_samples.py",
        "verification/test_rotation_visits.py",
    ),
}

_CHANGES: dict[str, list[tuple[str, ...]]] = {
    # --- goals in a ball ----------------------------------------------------------------------
    "GoalRegion.margin": [("self.tolerance - ", "")],
    "GoalRegion.nearest": [
        ("share * self.tolerance", "self.tolerance"),
        ("(allowed / distance)", "allowed"),
    ],
    "GoalRegion.bounds_rotation": [(".any()", ".all()")],
    "GoalRegion.__post_init__": [("0 <= self.tolerance", "0 < self.tolerance")],
    "_position": [("not are_numbers(given, 3)", "False")],
    # Files that are whole whatever ends the process
    "StagedFile.write": [("while rest:", "if rest:")],
    "StagedFile.__exit__": [("if self._descriptor is not None", "if kind is None")],
    "temporary_path": [("len(os.fsencode(name)) > _LONGEST_NAME", "False")],
    "_new_file": [("_locked(descriptor) and ", "")],
    "_remove_left": [("if _locked(descriptor):", "if True:")],
    "signals_held": [
        ("(signal.SIGINT, signal.SIGTERM)", "(signal.SIGINT,)"),
        ("for which in came:", "for which in []:"),
        ("signal.SIG_DFL if handler is None else handler", "signal.SIG_IGN"),
    ],
    "write_files": [
        ("undo.pop_all()", "undo.close()"),
        ("_make_folder(folder, undo)", "folder.mkdir()"),
    ],
    "_make_folder": [("undo.callback(remove)", "pass")],
    "write_answer": [("hold_interrupts()", "pass")],
    "SIGNALS": [("(signal.SIGINT, signal.SIGTERM)", "(signal.SIGINT,)")],
    "_silence_callbacks": [("if not issubclass", "if issubclass")],
    "_kept_page": [("folder.rmdir()", "pass")],
    "goal_keys": [("goal.tolerance > 0", "goal.tolerance >= 0")],
    "evaluated_ball": [
        ("_Balls(centre", "Capsules(centre"),
        ("path.tool_jacobian[:, :3]", "path.tool_jacobian[:, 3:]"),
        ("goal.tolerance == 0", "goal.tolerance > 0"),
        ("is_crossed=True", "is_crossed=False"),
    ],
    "evaluated_turn": [("np.array([beyond])", "np.array([beyond - 1])")],
    "judge_rotation": [
        ("min(along", "max(along"),
        ("along if at_goal.margin is None else at_goal", "along"),
    ],
    "_judge_at_goal": [
        ("tool, motion.tube.segment_count)", "tool, motion.tube.segment_count - 1)"),
        ("motion.trajectory.position(duration)", "motion.trajectory.position(0.0)"),
    ],
    # --- verification/majorants ---------------------------------------------------------------
    "tool_majorant": [
        ("robot.tool_reach * body.unit", "0 * body.unit"),
        ("body.origin + robot", "robot"),
    ],
    "rigid_body_majorant": [
        ("inertia.mass * gravity", "0.0"),
        ("_turning(2 * body.spin)", "_turning(body.spin)"),
        ("moments[i] if robot.body_turns[i] else forces[i]", "moments[i]"),
        (" + _product(bodies[child].link, forces[child])", ""),
        ("force + forces[child]", "force"),
        ("moment + moments[child] +", "moment +"),
        (" + _product(arm, force)", ""),
        ("derivative(momentum) / width**2 + ", ""),
        ("derivative(body.origin + arm, 2)", "derivative(body.origin, 2)"),
        ("inertia.moment * ", "0.1 * inertia.moment * "),
        ("share[i] * _product(axis, load)", "share[i] * load"),
        ("share[i] * _product(axis, load)", "_product(axis, load)"),
        ("efforts[:, :, joint] +=", "efforts[:, :, joint] ="),
    ],
    "_motions": [
        ("_product(parent.unit, derivative(value))", "derivative(value)"),
        ("_product(parent.unit, value)", "value"),
        ("abs(multiplier[i]) * joints", "joints"),
        ("value[0] += abs(offset[i])", "pass"),
        ("robot.body_offsets[i] * parent.unit", "0 * parent.unit"),
        ("parent.origin + link", "link"),
        ("_turning(spin), link", "parent.unit, link"),
    ],
    "_product": [("range(order)", "range(order - 1)")],
    "derivative": [("(np.arange(1, len(a)) * a[1:].T).T", "a[1:]")],
    "_turning": [("/ (k + 1)", "/ (k + 2)")],
    # --- trajectory/bernstein -----------------------------------------------------------------
    "halves": [
        ("start[1::2] += width[1::2]", "start[1::2] += 0"),
        ("width / 2, 2", "width, 2"),
    ],
    "_taylor_coefficients": [
        ("start ** np.arange", "start ** -np.arange"),
        ("scaled[power] *= (width**power)", "scaled[power] *= (width**degree)"),
    ],
    "maxima": [
        ("open_ = bounds.max(axis=0)", "open_ = bounds[0]"),
        ("((bounds[0], start), (bounds[-1], start + width))", "((bounds[0], start),)"),
        ("best_time[column[better]] = times[better]", "pass"),
    ],
    "peak_magnitudes": [("[coefficients, -coefficients]", "[coefficients, coefficients]")],
    # --- verification/enclosure ---------------------------------------------------------------
    "_NODE_PRODUCT": [("2.0 /", "0.2 /"), ("2.0 /", "1.0 /")],
    "Enclosure.at": [("[interval]) /", "[0]) /")],
    "enclosed_pose": [
        ("[tool.position] * 3", "[tool.axis] * 3"),
        ("[tool.axis] * 9", "[0 * tool.axis] * 9"),
        ("rates.position[1]", "0.5 * rates.position[1]"),
        ("2 * rates.position[2]", "rates.position[2]"),
        ("rates.spin[0]", "0.5 * rates.spin[0]"),
        ("rates.spin[1]", "0.5 * rates.spin[1]"),
    ],
    "total": [
        ("max(term.derivatives", "min(term.derivatives"),
        ("term.majorant(joints, width)[", "0 * term.majorant(joints, width)["),
    ],
    "_interpolated": [
        ("[_POINTS]", "[_POINTS - 1]"),
        ("missed > tolerance", "missed > 2 * tolerance"),
        ("(width > _MIN_WIDTH)", "(width > 0.1)"),
        ("width[order], missed[order]", "width[order], missed"),
        ("missed_of(quantity", "0 * missed_of(quantity"),
    ],
    "joint_bounds": [
        ("comb(degree, k) * ", ""),
        (".max(axis=0)", ".min(axis=0)"),
        ("range(min(degree + 1, len(bounds)))", "range(min(degree, len(bounds)))"),
    ],
    # --- verification/closest_approach --------------------------------------------------------
    "closest_approach": [
        ("min(search.lower_bound, search.margin)", "search.margin"),
    ],
    "_Rows.halves": [
        ("node[1::2] += 1", "node[1::2] += 0"),
    ],
    "_Search.halve_until_settled": [
        ("lower < self._settled_above()", "lower < self._settled_above() - 0.01"),
        ("lower[~undecided | final]", "lower[~undecided]"),
        ("width < _MIN_INTERVAL", "width < 0.02"),
        (
            "min(self.lower_bound, float(settled.min(initial=np.inf)))",
            "float(settled.min(initial=np.inf))",
        ),
    ],
    "_Search._settled_above": [
        ("max(_RESOLUTION, _RELATIVE_RESOLUTION * abs(self.margin))", "_RESOLUTION"),
        ("_RELATIVE_RESOLUTION * abs(self.margin)", "0.2 * abs(self.margin)"),
    ],
    "_Search._lower_bounds": [
        ("spheres[interval, rows.pair] - less", "spheres[interval, rows.pair]"),
        ("bound - less[near]", "bound"),
        ("distance - less[batch]", "distance"),
        ("travel[interval])", "travel[interval]) / 2"),
        ("time[at], rows.pair[batch]", "time[at], 0 * rows.pair[batch]"),
    ],
    "_Search._middles": [
        ("abs(hull - middle).max(axis=0)", "abs(hull - middle).min(axis=0)"),
        (
            "start + width / 2",
            "start + width / 4",
            "only slower: the bounds hold about any instant",
        ),
    ],
    "_Search._remember": [
        ("margin.argmin()", "margin.argmax()"),
        ("float(time[least])", "0.0"),
    ],
    # --- verification/tube_visits -------------------------------------------------------------
    "tube_visits": [
        (
            "np.maximum.accumulate([0.0, *times, trajectory.duration])",
            "np.array([0.0, *times, trajectory.duration])",
            "equivalent but where rounding decides between equal margins",
        ),
        ("values.argmax(axis=1)", "values.argmin(axis=1)"),
        (
            'np.searchsorted(time, time[samples], "left") - 1',
            'np.searchsorted(time, time[samples], "left")',
        ),
        ('np.searchsorted(time, time[samples], "right")', "samples"),
    ],
    "least_concave_margin": [
        ("lower = margin.min(axis=0) - error", "lower = margin.min(axis=0)"),
        ("slope[segment] * vector", "0 * vector"),
        ("margin[[0, -1]]", "margin[[0, 0]]"),
        ("margin.min(axis=0) -", "ends.min(axis=0) -"),
        ("(width > _MIN_WIDTH)", "(width > 1.0)"),
        ("_RELATIVE_RESOLUTION * abs(attained)", "0.5 * abs(attained)"),
        ("width[row] if end else 0.0", "0.0"),
        (
            "min(lower_bound, float(lower[~split].min(initial=np.inf)))",
            "float(lower[~split].min(initial=np.inf))",
        ),
    ],
    "visited_parts": [
        ("high - low", "(high - low) / 2"),
        ("tool.start <= visit.end", "tool.start + tool.width / 2 <= visit.end"),
        ("ends >= visit.begin", "tool.start >= visit.begin"),
    ],
    "segment_margins": [
        ("[ToolMargin(problem, tool)]", "[]"),
        ("found.append(JointRangeMargin(problem, trajectory))", "pass"),
        ("found.append(RotationMargin(problem, tool, rotation))", "pass"),
    ],
    "JointRangeMargin.at": [("np.minimum(q[:, None]", "np.maximum(q[:, None]")],
    "JointRangeMargin.within": [("np.minimum(q -", "np.maximum(q -")],
    "_Fit.at": [("np.minimum.reduce", "np.maximum.reduce")],
    "_Fit._in": [("np.minimum.reduce", "np.maximum.reduce")],
    "_Fit.best_times": [
        ("np.array([low, high, _highest(worse, low, high)])", "np.array([low, high])"),
        ("np.minimum(before, after)", "np.maximum(before, after)"),
    ],
    # --- verification/rotation_visits ---------------------------------------------------------
    "least_rotation_margin": [
        ("resolution - error)", "10 * resolution - error)"),
        ("(parts.width > _MIN_WIDTH)", "(parts.width > 0.2)"),
        ("parts.width[row] if end else 0.0", "0.0"),
        (
            "min(lower_bound, float(lower[~split].min(initial=np.inf)))",
            "float(lower[~split].min(initial=np.inf))",
        ),
        (".any()]", ".all()]"),
    ],
    "_halves": [
        ("pairs[1, 0::2] = pairs[0, 1::2] = between", "pairs[0, 1::2] = between"),
        ("start[1::2])", "start[0::2])"),
    ],
    "_bounded": [
        ("- off - error", "- error"),
        ("- off - error", "- off"),
        ("nearest_branch(last, first, _ALL)", "last"),
        ("bounds.min(axis=1) - np.pi", "bounds.min(axis=1)"),
        ("np.maximum(_measures(first), ", "np.maximum(0 * _measures(first), "),
    ],
    "_vector_at": [("np.clip(u, 0.0, 1.0)", "u")],
    "_measures": [("abs(v)", "v")],
    "_chord_distance": [
        ("smooth * width**2 / 8", "smooth * width**2 / 16"),
        ("broken * width**2 / 8", "broken * width**2 / 16"),
        ("/ 8 + jump", "/ 8"),
        ("bend * width**2 / 8 + 2 * off", "2 * off"),
        ("bend * width**2 / 8 + 2 * off", "bend * width**2 / 8"),
        (
            "turn * (bend + relative * rate)",
            "turn * bend",
            "hidden by the slack of the other terms",
        ),
        ("turn * (bend + relative * rate)", "turn * relative * rate"),
        (" + gain_rate * relative**2", ""),
        (" + gain_rate * relative * spin", ""),
        ("spin + turn * rate", "spin"),
        ("MATRIX_ERROR_GAIN * pose.rotation.error[parts.interval, 0] + ", ""),
        (" + turn * off)", ")"),
        (
            "np.where(move <= _MAX_MOVE, distance, np.inf)",
            "distance",
            "hidden by the slack of the other terms",
        ),
        ("angle + move / 2", "angle", "hidden by the slack of the other terms"),
        ("(low - slack < 0) | ", ""),
        (" | (high + slack > 1)", ""),
        ("high - low + bend * width**2 + 4 * off", "high - low"),
        ("distance = gain * ", "distance = "),
        ("(high + slack <= 0)", "(low + slack <= 0)"),
    ],
    # --- verification/switching_samples -------------------------------------------------------
    "_switch_before": [
        ("np.minimum(best_before[: last + 1], rest)", "best_before[: last + 1]"),
        (
            "np.minimum(margin_before[candidates], margin_after[candidates])",
            "margin_before[candidates]",
        ),
        ("margin_after[last::-1]", "margin_after[::-1]"),
    ],
    "_best_after_switch": [
        ("np.minimum(before, margin), margin", "before, margin"),
        ("shift *= 2", "shift *= 3"),
    ],
    "_best_margins": [
        ("np.where(np.arange(len(margin)) == 0, np.inf, -np.inf)", "margin[:, 0]"),
        ("np.minimum(best[source], gate) for", "best[source] for"),
        ("if k in passing", "if False"),
    ],
    "_sources": [
        ("and last_passed is (k + 1 not in passing)", ""),
        ("(_State(k, False, last_passed), passing[k])", "(_State(k, False, last_passed), free)"),
        ("True, first_passed), free", "True, True), free"),
    ],
    "best_switching_samples": [
        ("np.minimum(margin[:, source.segment], gate)", "gate"),
        ("max(found, key=lambda entry: entry[0])", "found[0]"),
        ("if source.segment < state.segment:", "if True:"),
    ],
    # --- compulsory points ----------------------------------------------------------------------
    "compulsory_points": [
        ("> _TURNS_BACK", "> 2 * _TURNS_BACK"),
        ("steps[k] > close[k]", "True"),
        ("if k - 1 not in back or", "if k - 1 not in back and"),
        ("turn_at(points, k, close[k])", "turn_at(points, k, 0.0)"),
    ],
    "_TURNS_BACK": [("150", "155"), ("150", "148")],
    "passing_radius": [("np.minimum", "np.maximum")],
    "_direction": [("> close", "> 0")],
    "ordered_switching_samples": [
        ("_worst_passing(samples, passing) >= 0", "True"),
        ("_worst_visit(others, values) >= needed", "True"),
    ],
    "_worst_passing": [
        ("ends[k - 1] : last[k]", "ends[k] : last[k]"),
        ("[0, *samples", "[1, *samples"),
    ],
    "passages": [
        ("low, high = visits[k - 1].begin, visits[k].end", "pass"),
        ("visits[k - 1].begin, visits[k].end", "visits[k - 1].end, visits[k].end"),
        ("visits[k - 1].begin, visits[k].end", "visits[k - 1].begin, visits[k].begin"),
        ("[[low], time", "[time"),
    ],
    "_Fit.passing_margin": [
        ("effective_radius[k - 1 : k + 1].min()", "effective_radius[k - 1 : k + 1].max()"),
        ("self._tube.effective_radius", "self._tube.radius"),
        ("self._tube.points[k]", "self._tube.points[k + 1]"),
    ],
    "_Fit.best_passage": [
        ('self._tube.visit == "ordered"', "True"),
        ("candidates.append(float(_highest(margin, around[:1], around[2:])[0]))", "pass"),
        ("self.at(t)[:, [k - 1, k]].max(axis=1)", "self.at(t)[:, [k - 1, k]].min(axis=1)"),
        ("float(margins.max()) - error", "float(margins.max())"),
    ],
    "judge_points": [
        ("min(found", "max(found"),
        ("motion.tube.numbers[worst.point]", "worst.point"),
    ],
    "JudgedMotion.segment_number": [("position(time)", "position(0.0)")],
    # --- one line, one segment ------------------------------------------------------------------
    "joined_segments": [('tube.pass_through_points == "all"', "False")],
    "_are_one": [
        ("tube.radius[last] != tube.radius[first]", "False"),
        ("tube.conditions[last] != tube.conditions[first]", "False"),
        ("tube.rotation is None or _turns_evenly(tube.rotation, first, last, shares)", "True"),
    ],
    "_shares_on_line": [
        ("and (np.diff(shares) > 0).all()", ""),
        ("off.max() <= _ON_LINE and", ""),
    ],
    "_turns_evenly": [
        (".sum() >= _HALF_TURN", ".sum() >= 9"),
        (".max() <= _ON_LINE", ".max() <= 9"),
    ],
    "distinct_points": [("points[kept[-1]]) >= MIN_LENGTH", "points[kept[-1]]) > 0")],
    "_require_nothing_lost": [
        ("all(asked[lost] != asked[k] for k in beside)", "False"),
        ("turn[lost] > _SAME_ORIENTATION", "False"),
    ],
    # --- verification/certificate -------------------------------------------------------------
    "Tolerance.of": [("unit == RELATIVE", "unit != RELATIVE")],
    "JudgedCondition.holds": [("-tolerance.of(self.unit)", "-1e3 * tolerance.of(self.unit)")],
    "Certificate.passed": [("not self.failures()", "len(self.failures()) < 2")],
    "Certificate.slower_failure": [
        ("for name in _KEPT_SLOWER", "for name in ()"),
        (">= -self.tolerance.relative", ">= 0.0"),
    ],
    "Certificate.braking": [("not _BRAKED_FROM.isdisjoint(self.failures())", "False")],
    # --- verification: slower runs and braking --------------------------------------------------
    "path_steps": [
        ("stretches.piece + stretches.start", "regular"),
        ("share.mean(axis=0)", "share[1]"),
    ],
    "effort_sides": [
        ("gravity + coulomb", "gravity"),
        ("motors.friction_uncertainty * abs(coulomb)", "0.0"),
        ("motors.friction_uncertainty * abs(viscous)", "0.0"),
        ("- gravity - viscous", "- gravity"),
        ("linear + way * v", "linear - way * v"),
        ("motors.has_curve", "motors.has_curve & False"),
    ],
    "acceleration_sides": [("way * a, way * v", "way * a, way * a")],
    "_allowed": [("limit.joint], way)", "limit.joint], 1.0)")],
    "highest_up_to_one": [
        ("3 * one * three", "one * three"),
        ("one / sum_", "two / sum_"),
    ],
    "_rate_polynomials": [
        ("gravity, friction, inertia", "gravity, 0 * friction, inertia"),
        ("- gravity - friction", "- gravity"),
    ],
    "_tightest": [("robot.joint_names[joint[row]]", "robot.joint_names[0]")],
    "worst_braking": [
        ("time[1:] += np.add", "np.add"),
        ("distance[1:] += np.add", "np.add"),
        ("1 + tolerance - sides.static", "1 - sides.static"),
    ],
    "_tool_lengths": [("[:, :3]", "[:, 3:]")],
    "_rests": [
        ("np.cumsum(part[::-1])[::-1]", "np.cumsum(part)"),
        ("2 * share * h / (np.sqrt(square) + np.sqrt(after))", "h"),
    ],
    "_steady": [("np.minimum(harder, to_rest)", "to_rest")],
    "_left": [("left - linear * p", "left - 0 * linear * p")],
    # --- verification/verification ------------------------------------------------------------
    "verify": [("trajectory.reordered(problem.robot.joint_names)", "trajectory")],
    # --- verification/judged ------------------------------------------------------------------
    "judge_position": [
        (
            "limits.lower_position, limits.upper_position",
            "-limits.upper_position, limits.upper_position",
        )
    ],
    "judge_velocity": [
        ("for each in (constant, by_position)", "for each in (constant,)"),
        ("return min(", "return max("),
        ("(motion, 1,", "(motion, 2,"),
    ],
    "judge_acceleration": [("(motion, 2,", "(motion, 1,")],
    "judge_jerk": [("(motion, 3,", "(motion, 2,")],
    "_judge_derivative": [("1 - peak", "2 - peak"), ("bounded[peak.column]", "peak.column")],
    "JudgedMotion.smooth_efforts": [
        ("EFFORT_ENCLOSURE * most", "1e4 * EFFORT_ENCLOSURE * most"),
        ("np.minimum(", "np.maximum("),
    ],
    "judge_effort": [
        ("np.where(directed, np.inf, limit)", "limit"),
        ("if directed.any()", "if False"),
        ("min(asked", "max(asked"),
        ("& np.isfinite(limit)", ""),
    ],
    "_depends_on_direction": [
        ("(motors.backwards_friction > 0) | ", ""),
        ("found |= motors.viscous_friction > 0", "pass"),
        ("= True", "= False"),
    ],
    "_judge_directed": [
        ("for way in (1.0, -1.0)", "for way in (1.0, 1.0)"),
        (
            "_effort_allowed(motion.robot, efforts, way)",
            "_effort_allowed(motion.robot, efforts, 1.0)",
        ),
    ],
    "_effort_allowed": [
        ("halves @ efforts.position", "efforts.position[-1]"),
        ("table.slope(q, way) * efforts.position[:, rows]", "0.0"),
        ("- table.slope(q, way) * q", ""),
    ],
    "judge_motor_curve": [
        ("+ way * lost", "+ lost"),
        ("+ way * lost", ""),
        ("for way in (1.0, -1.0)", "for way in (1.0,)"),
        ("/ motors.no_load_velocity[efforts.joint]", ""),
        ("excess[:, -1] -= saturation", "excess[:, -1] -= 1.1 * saturation"),
        ("has_curve.any()", "has_curve.all()"),
    ],
    "judged_both_ways": [
        ("% len(unit)", "% (2 * len(unit)) // 2"),
        ("error > EFFORT_ENCLOSURE", "False"),
        ("margin + error", "margin"),
        ("* efforts.width[worst]", ""),
        ("efforts.joint[worst]", "0"),
    ],
    "DirectedEfforts.most": [
        ("+ self.unsure", ""),
        ("+ self.unsure", "+ way * self.unsure"),
        ("most[-1] += self.error", "pass"),
        ("way * self.effort", "self.effort"),
    ],
    "directed_efforts": [
        ("effort[-1] += dry", "pass"),
        ("(local + width / 2)", "local"),
        ("parts.start, parts.end - parts.start),", "parts.start, 1.0 - parts.start),"),
        (
            "width = smooth.width[interval] * (parts.end - parts.start)",
            "width = smooth.width[interval]",
        ),
    ],
    "_friction": [
        ("friction[-1] += dry", "pass"),
        ("motors.viscous_friction[joint] * velocity", "0.0 * velocity"),
        ("* direction[row, joint]", ""),
    ],
    "_instants": [
        ("beyond[-1] -= table.position", "beyond[-1] -= table.position[0]"),
        ("found.append(", "found[:0].append("),
        ("np.full(len(passed.piece), table.joint)", "np.full(len(passed.piece), 0)"),
        ("inside = stretches.start > 0", "inside = stretches.start > 2"),
    ],
    "_parts": [
        ("- begin[pieces]) / widths[pieces]", "- begin[pieces]) / widths[0]"),
        ("np.roll(start, -1)", "1.0"),
        ("/ smooth.width[cut]", ""),
    ],
    "friction_jumps": [
        ("+ motors.forwards_friction", ""),
        ("* (1 + motors.friction_uncertainty)", ""),
        ("stretches.joint[before] == stretches.joint[after]", "True"),
        ("np.flatnonzero(stretches.direction)", "np.arange(len(stretches.direction))"),
        ("stretches.start[worst] * trajectory.widths[piece]", "0.0"),
        ("jump[stretches.joint[at]].argmax()", "0"),
    ],
    "motor_majorant": [
        ("/ width**2", "/ width"),
        ("motors.armature * derivative(joints, 2)", "0.0 * derivative(joints, 2)"),
        ("motors.viscous_friction * derivative(joints)", "0.0 * derivative(joints)"),
    ],
    "directed_stretches": [
        ("abs(value).argmax(axis=1)", "1"),
        ("abs(fastest) > still", "True"),
        (
            "np.append(np.zeros(n * pieces), turned.share)",
            "np.append(np.zeros(n * pieces), 0 * turned.share)",
        ),
        ("looks *= trajectory.widths[piece][:, None]", "pass"),
        ("STILL_SHARE * ", "0.1 * STILL_SHARE * "),
        ("STILL_SHARE * ", "10 * STILL_SHARE * "),
    ],
    "DirectedStretches.at": [('side="right"', 'side="left"'), ("0.0, _JUST_BELOW_ONE", "0.0, 1.0")],
    "sign_changes": [
        ("hull.min(axis=0) < 0", "hull.min(axis=0) < -0.1"),
        ("* widths[piece] ** powers", ""),
    ],
    "_roots_inside": [
        ("(real > _END)", "(real > 0.25)"),
        ("(real > _END)", "(real > 0)"),
        ("1 - _END)", "1)"),
        ("roots.imag == 0", "roots.imag >= 0"),
    ],
    "restricted": [("[::-1]", "")],
    "effort_terms": [("return moved + motor_majorant(robot, joints, width)", "return moved")],
    "judge_effort_rate": [
        ('f"{judged.coverage}; {jumps}"', 'f"{jumps}"'),
        ("friction_jumps(motion, np.isfinite(limit))", "friction_jumps(motion, limit > 0)"),
        ("_RATE_ENCLOSURE * limit)", "1e4 * _RATE_ENCLOSURE * limit)"),
        ("limits.effort_rate", "limits.effort"),
        ("isfinite(limit).any()", "isfinite(limit).all()"),
    ],
    "judged_peak": [
        ("peaks.value + error", "peaks.value"),
        ("error[worst] > closeness", "False"),
        ("1 - float(above[worst])", "1 - float(peaks.value[worst])"),
        ("* quantity.width[interval]", ""),
        ("bounded[worst]", "worst"),
    ],
    "enclosed_rate": [
        ("/ width[:, None]", "/ 1.0"),
        ("_SLOPE_OF_PRODUCT", "_NODE_PRODUCT"),
        ("* powers[:, None, None]", ""),
        ("/ whole.width[:, None]", ""),
        ("coefficients[:-1]", "coefficients[1:]"),
    ],
    "judge_tube": [
        ("(least.lower_bound", "(least.attained"),
        ("least.attained", "least.lower_bound"),
    ],
    "_judge_along": [("(least.lower_bound", "(least.attained")],
    "judge_joint_signs": [
        ("begin + least.time", "least.time"),
        ("lower[segment], upper[segment]", "lower[0], upper[0]"),
        ("min(found", "max(found"),
    ],
    "judge_goal": [
        ("motion.problem.goal", "motion.problem.start"),
        ("-1", "0"),
        ("goal.margin(tool)", "-goal.distance(tool)"),
    ],
    "_judge_end": [
        ("0.0 - error", "0.0"),
        ("0.0 - float(off.max())", "0.0"),
        ("off = abs(q - given)", "off = q - given"),
        ("0.0 - float(off.max())", "0.0 - float(off.min())"),
    ],
    "judge_rest": [
        ("for order in (1, 2)", "for order in (1,)"),
        ("for order in (1, 2)", "for order in (2,)"),
        ("values[1, -1]", "values[0, 0]"),
        ("values[0, 0], ", "values[1, -1], "),
        (" / motion.largest_rates[order]", ""),
    ],
    "judge_continuity": [
        ("range(3)", "range(2)"),
        ("range(3)", "range(1, 3)"),
        ("min(found", "max(found"),
        ("jumps / motion.largest_rates[order]", "jumps / motion.largest_rates[1]"),
        ("total = jumps.sum(axis=0)", "total = jumps.max(axis=0)"),
        ("jumps[:, worst].argmax() + 1", "jumps[:, worst].argmax()"),
    ],
    "judge_obstacles": [("np.arange(len(checker.obstacle_pairs))", "np.arange(1)")],
    "judge_self_collision": [("len(checker.obstacle_pairs), len", "0, len")],
    "_judge_clearance": [
        (
            "bracketed(nearest.lower_bound, nearest.margin",
            "bracketed(nearest.margin, nearest.margin",
        ),
        ("AskedDistances(motion).over", "lambda b, e, pair: np.zeros(len(pair))"),
    ],
    "of_corners": [
        ("distance[row] += more", "pass"),
        ("corners[chosen] - apart * towards", "corners[chosen]"),
        ("if more > _NEAR:", "if False:"),
    ],
    "_risen_share": [
        ("share**2 + _LEAVING", "share + _LEAVING"),
        ("* (1 - 2 * share)", "* (1 - share)"),
    ],
    "DistancesAlong.of_pairs": [("here &= risen < required", "pass")],
    "penetration": [
        (
            "sign * placed.shape.normals",
            "placed.shape.normals",
            "Coal's direction is as good there",
        ),
    ],
    "limit_costs": [
        ("if risen is not None:", "if False:"),
        ("costs > plausible", "costs > 2.0"),
    ],
    "_across": [("corner - apart * normal", "corner + apart * normal")],
    "ClearanceMargin.at": [("left[:, k] = self._left(", "_ = self._left(")],
    "ClearanceMargin._at": [("distance[row, column] = closest.distance", "_ = closest.distance")],
    "clearance_margin": [("None if margin.is_constant else margin", "None")],
    # --- verification/asked_distances, problem/contact, required_distances, clearance_fields ------
    "AskedDistances.over": [
        ("(self._end, begin)", '(self._end, begin, side="right")'),
        ("np.maximum(most, asked)", "np.minimum(most, asked)"),
        ("np.minimum(asked, near.distance)", "near.distance"),
        (" & near.pair[pair]", ""),
        ("(segment == near.segment)", "True", "times near an end are in its segment"),
    ],
    "_within": [("end <= times.end", "begin <= times.end")],
    "_parts_near": [(".max(axis=0) + error <= near.within", ".min(axis=0) + error <= near.within")],
    "_merged": [
        (
            "gap = parts[1:, 0] - parts[:-1, 1] >",
            "gap = parts[1:, 0] - parts[:-1, 1] >=",
            "a gap of exactly that",
        )
    ],
    "NearEnd.holds": [
        ("away <= self.within", "away < self.within"),
        ("(segment == self.segment) & ", ""),
    ],
    "RequiredDistances.at": [("np.minimum(required[rows], near.distance)", "near.distance")],
    "_near_ends": [
        ("problem.given_goal is not None", "True"),
        ("tool = problem.robot.tool_position(q[None])[0]", "pass"),
    ],
    "required_everywhere": [(".max(axis=0)", ".min(axis=0)")],
    "Contact.__post_init__": [("(self.ends,) if isinstance(self.ends, str) else ", "")],
    "require_checked": [("if not checker.between(*names).any()", "if False")],
    "clearances_of": [('"pair_clearances": pairs', '"pair_clearances": {}')],
    "segment_clearances": [("fields.segments if", "None if")],
    "_ends": [("[-1, segments - 1]", "[-1]"), ("segment != 0 and", "")],
    # --- verification, what conditions share --------------------------------------------------
    "range_margin": [
        ("((1.0, upper), (-1.0, -lower))", "((1.0, upper),)"),
        ("((1.0, upper), (-1.0, -lower))", "((-1.0, -lower),)"),
        ("JointMargin(-worst.value", "JointMargin(-worst.value + 1e-5"),
    ],
    "JudgedMotion.largest_rates": [("_STILL_SHARE * overall", "0 * overall")],
    "bracketed": [
        ("margin >= attained - allowed", "True"),
        ("max(_UNDECIDED_LENGTH, ", "max(0.1, "),
    ],
    # --- collision/collision_checker ----------------------------------------------------------
    "BodyShapes.motion_weights": [
        ("reach(np.zeros(3))", "bounding_radius"),
        ("(reach[first], reach[second])", "(reach[second], reach[first])"),
    ],
    "RobotModel.approach_rates": [
        (", 1.0)", ", 0.0)"),
        (" + away[:, None]", ""),
        ("self.lever_arm[body] + ", ""),
        ("np.where(first, rates[0], rates[1])", "rates[0]"),
        ("first != second", "first | second"),
        ("first != second", "first & ~second"),
    ],
    "BodyShapes._in_second": [('"pij,pi->pj", frames', '"pij,pj->pi", frames')],
    "BodyShapes.separations_at": [("found.distance[unproven] = measured.distance", "pass")],
    "BodyShapes.closest_points": [("if len(unproven):", "if False:")],
    "BodyShapes.near_distances": [("if len(row):", "if False:")],
    "BodyShapes.separations_along": [
        (" + first.shape.radius", ""),
        (" - second.shape.radius", ""),
        (").max(axis=1)", ").min(axis=1)"),
        ('"pij,pj->pi", rotation[at, second.body]', '"pij,pi->pj", rotation[at, second.body]'),
    ],
    "BodyShapes.gaps_of_spheres": [
        (" - radii[first]", ""),
        (" - radii[second]", ""),
    ],
    "BodyShapes.distance_gradient": [
        ("(-1, 0, closest.first)", "(1, 0, closest.first)"),
        ("((-1, 0, closest.first), (1, 1, closest.second))", "((-1, 0, closest.first),)"),
        ("((-1, 0, closest.first), (1, 1, closest.second))", "((1, 1, closest.second),)"),
    ],
    "CollisionChecker.owners": [("obstacles[0] if obstacles else None", "None")],
    "CollisionChecker._must_stay_apart": [
        ("1 if neighbours_may_touch else 0", "1"),
        ("1 if neighbours_may_touch else 0", "0"),
        ("self._obstacle_names | self._attached_names", "self._obstacle_names"),
        ("self._obstacle_names | self._attached_names", "self._attached_names"),
    ],
    "LinkJudge._always_touch": [
        (
            "(spheres > 0).all()",
            "False",
            "only slower: where links touch, the spheres about their covers overlap",
        ),
        ("all(self._touch(pair, k) for k in range(_TOUCH_SAMPLES))", "True"),
    ],
    "LinkJudge._overlap": [("int((spheres <= 0).sum())", "0")],
    "_random_configurations": [
        ("lower, np.minimum(-np.pi, upper - 2 * np.pi)", "lower, -np.pi"),
        ("upper, low + 2 * np.pi", "upper, low"),
    ],
    "CollisionChecker._judge_links": [(" if not {*pair} & self._attached_names", "")],
    "BodyShapes.box_distances": [
        ("((0, 1), (1, 0))", "((0, 0), (1, 1))"),
        (" - radii[pairs[:, ball]]", ""),
    ],
    "_carried_shapes": [("shape.transformed(placement)", "shape")],
    # --- collision/near_distances -------------------------------------------------------------
    "near_distances": [
        ("if found is not None:", "if found is None:"),
        ("samples % before != 0", "samples % before == 0"),
    ],
    "_Distances.measure": [
        ("self.found[row, pair] < self._matters[row, pair]", "self.found[row, pair] < 0"),
        ("np.maximum(self.found[at], bound)", "bound + 0.01"),
    ],
    # --- native/convex_pairs ------------------------------------------------------------------
    "NativeShapes.near_distances": [("np.array(known, order", "np.array(matters, order")],
    "NativeShapes.least_room": [("~unproven)", "unproven)")],
    "NativeShapes.closest_points": [("vectors[0], vectors[1],", "vectors[1], vectors[0],")],
    "_filled_up": [("vertices[:1]", "0 * vertices[:1]")],
    # --- collision/separation -----------------------------------------------------------------
    "PlacedShapes._core_poses": [
        ("core[:, :, :3, 3]) + position", "core[:, :, :3, 3])"),
        ("rotation @ core[:, :, :3, :3]", "rotation"),
    ],
    "PlacedShapes._nearest_points": [
        ("result) <= 0", "result) <= -1", "only slower: any direction gives a bound"),
    ],
    "PlacedShapes._gaps": [
        (
            "[::-1]",
            "",
            "equivalent: both directions are tried",
        ),
        ("(centers + position[row])", "centers", "only stricter: any direction gives a bound"),
    ],
    "PlacedShapes.separations": [
        ("_, gap[row], near[row], far[row] = found", "pass"),
        (" - self._radii[pairs].sum(axis=1)", ""),
    ],
    "PlacedShapes._apart": [
        ("direction, -direction", "direction, direction"),
        ("np.maximum(ahead, behind)", "ahead"),
        ("low[:, 1] - high[:, 0]", "low[:, 1] - low[:, 0]"),
        ('"pkij,pi->pkj"', '"pkji,pi->pkj"'),
    ],
    "PlacedShapes._improved": [
        ("rotation[1] @ direction[0]", "direction[0]"),
        ("(back @ rotation[0])[None]", "rotation[0][None]"),
        ("position[0] - position[1]", "position[1] - position[0]"),
    ],
    # --- collision/gilbert --------------------------------------------------------------------
    "separating_directions": [
        ("(local @ first.T).argmax(axis=1)", "(local @ first.T).argmin(axis=1)"),
        ("(direction @ second.T).argmin(axis=1)", "(direction @ second.T).argmax(axis=1)"),
        ("behind - moved[live] -", "behind -"),
        ("better = apart > bound[live]", "better = apart > -np.inf"),
        ("known = length", "known = length / 2"),
        ("np.minimum(enough, known - loose)", "known - loose"),
        ("gap = _nearest_to_origin(gap, end)", "gap = end"),
    ],
    "_nearest_to_origin": [
        (
            "np.clip(-np.sum(start * edge, axis=1) / squared, 0.0, 1.0)",
            "-np.sum(start * edge, axis=1) / squared",
        ),
        ("-np.sum(start * edge, axis=1)", "np.sum(start * edge, axis=1)"),
    ],
    "_fcl_geometry": [
        ("_CORE_THICKNESS, length)", "_CORE_THICKNESS, length / 2)"),
        ("frame_along(edge / length)", "np.eye(3)"),
    ],
    # --- collision/convex_shape ---------------------------------------------------------------
    "ConvexShape.reach": [(" + self.radius", ""), (".max())", ".min())")],
    "ConvexShape.center": [("/ 2", "/ 4")],
    "ConvexShape.faces": [("np.where(inward", "np.where(~inward")],
    "_prism_faces": [("fan[:, ::-1]", "fan")],
    "ConvexShape.transformed": [
        ("placement[:3, :3].T", "placement[:3, :3]"),
        ("read_only(moved), self.radius", "read_only(moved)"),
    ],
    "box": [("np.array(list(size)) / 2", "np.array(list(size)) / 4")],
    "capsule": [("[0, 0, length / 2]", "[0, 0, length / 4]")],
    "cylinder": [
        ("radius / np.cos(np.pi / _PRISM_SIDES)", "radius"),
    ],
    "_prism": [("-length / 2, length / 2", "-length / 2, 0.0")],
    "convex_hull": [
        ("- _FLAT_HALF_THICKNESS", "+ _FLAT_HALF_THICKNESS"),
        (" + (low + high) / 2", ""),
    ],
    # --- collision/mesh_cover, link_geometry, obstacle ----------------------------------------
    "_slab_hulls": [("if len(points)", "if len(points) > 20")],
    "_cover_and_slabs": [("_WORTHWHILE_VOLUME_RATIO * ", "0 * ")],
    "length_unit": [('float(element.get("meter", "1"))', "1.0")],
    "load_mesh": [("loaded.apply_scale(scale)", "pass")],
    "_part": [
        ("robot.link_placement[link] @ element.placement", "robot.link_placement[link]"),
        ("robot.link_placement[link] @ element.placement", "element.placement"),
    ],
    "matrix_of_rpy": [("z @ y @ x", "x @ y @ z")],
    # --- constraints/speed_polynomial ---------------------------------------------------------
    "SpeedPolynomial.at": [("speed**k", "speed")],
    "SpeedPolynomial.weighted": [("c * weights[k]", "c")],
    "SpeedPolynomial.largest_speed": [("np.minimum.reduce", "np.maximum.reduce")],
    "SpeedPolynomial._one_sided": [
        ("1 - held", "1 + held"),
        ("held = sign * ", "held = "),
        ("c[k] = sign * term", "c[k] = term"),
        ("c[0] -= 1", "pass"),
        ("len(powers) == 1", "False", "only slower: the cubic has the same root"),
    ],
    "_root": [
        ("(available < 0) | ", ""),
        (" | ((available == 0) & (use > 0))", ""),
        ("1 / power", "1"),
    ],
    "largest_speed": [("found[c[0] > 0] = 0.0", "pass"), ("root * scale", "root")],
    "_bracket": [
        ("np.where(above_last, first, before_end)", "before_end"),
        ("np.where(above_last, last, far)", "far"),
        (" | above_last | ", " | "),
        ("np.maximum(2.5, before_end)", "np.maximum(0.5, before_end)"),
        (" & (e < np.inf)", ""),
    ],
    "_polished": [("(step > begin) & (step < end)", "True")],
    # --- constraints: joint_effort, joint_rate, path_samples, speed_limits ----------------------
    "JointEffort.used": [
        ("(at.effort - at.gravity)", "at.effort"),
        ("0: at.gravity", "0: 0 * at.gravity"),
        ("terms[2] - terms[1]", "terms[2]"),
        ("if motors.has_viscous_friction", "if False"),
        ("if self._with_coulomb_friction", "if True"),
        ("if self._with_coulomb_friction", "if False"),
    ],
    "JointEffort.by_path": [("speed**k / ", "1 / ")],
    "JointEffort.refusal": [
        ("(held - self.limit)", "held"),
        (".argmax()", ".argmin()"),
    ],
    "JointRate.__init__": [("np.isfinite(limit)", "limit > 0")],
    "JointRate.used": [(" / self.limit", "")],
    "JointRate.by_path": [("speed**self.order / self.limit", "speed / self.limit")],
    "PathSamples.rate": [("speed**order", "speed")],
    "largest_speeds": [
        ("limit.order >= len(at.by_path)", "True"),
        ("np.minimum(found, limit.used", "(limit.used"),
        (".min(axis=1)", ".max(axis=1)"),
    ],
    "speed_limits": [
        ("_effort_limit(problem.robot),", ""),
        ("MotorCurve(problem.robot.motors),", ""),
        ("EffortRate(limits.effort_rate),", ""),
    ],
    "_effort_limit": [
        ("motors.has_coulomb_friction or ", ""),
        ("limits.effort_ranges or ", ""),
        (" or is_unsure", ""),
        ("motors.has_friction and ", ""),
    ],
    # --- constraints: coulomb_friction, sided_effort, effort_limit, motor_curve -----------------
    "CoulombFriction.side": [("way > 0", "way < 0")],
    "directed_friction": [
        ("* abs(effort)", "* effort"),
        ("effort + unsure", "effort"),
        ("effort - unsure", "effort"),
    ],
    "blended_friction": [
        ("abs(rate).max(axis=0)", "rate.max(axis=0)"),
        ("STILL_SHARE * largest.max()", "0.0"),
        ("share * largest", "largest"),
        ("-motors.backwards_friction", "-motors.forwards_friction"),
        ("1 + motors.friction_uncertainty", "1.0"),
        ("1 - motors.friction_uncertainty", "1.0"),
        ("(1 - _EARLY)", "1"),
        ("backwards * less + rise", "backwards * more + rise"),
        ("forwards * less - fall", "forwards * more - fall"),
        ("(ahead < 1) & (ahead > 0)", "ahead < 1"),
        ("(behind < 1) & (behind > 0)", "behind > 0"),
        ("np.where(moves, np.nan_to_num(end_direction), 0.0)", "np.nan_to_num(end_direction)"),
        (" | ~moves", ""),
    ],
    "_EARLY": [("0.1", "0.0")],
    "SidedEffort.__init__": [("[1.0, -1.0]", "[1.0, 1.0]")],
    "SidedEffort.terms": [
        ("at.gravity + at.viscous_effort", "at.gravity"),
        ("abs(at.viscous_effort)", "at.viscous_effort"),
        ("at.gravity[:, self.joints] + dry", "at.gravity[:, self.joints]"),
        ("at.gravity[:, self.joints] + dry", "dry"),
        (" + unsure[:, self.joints]", ""),
        ("(moving - still)", "moving"),
    ],
    "SidedEffort.by_path": [
        ("motors.viscous_friction * speed", "motors.viscous_friction"),
        ("speed**k * self.way[:, None]", "speed**k"),
        ("np.sign(at.by_path[1])", "1"),
        (" + self.way * self._dry(at, 1)", ""),
        ("self.way * self._dry(at, 1)", "self._dry(at, 1)"),
        ("change[1][:, every, self.joints]", "change[1][:, every, every]"),
    ],
    "SidedEffort._dry": [("for way in (1.0, -1.0)", "for way in (-1.0, 1.0)")],
    "EffortLimit.__init__": [
        ("len(joints) * (way < 0)", "len(joints) * (way > 0)"),
        ("place[each.joint]", "each.joint"),
        ("each.side(way).max()", "each.side(way).min()"),
        ("each.side(way).max()", "each.most"),
        ("np.isfinite(limits.effort)", "limits.effort > 0"),
    ],
    "EffortLimit.used": [
        ("terms[0] += 1 - allowed", "pass"),
        (", way) / self.limit[column]", ", way)"),
        ("term / self.limit", "term"),
        ("(terms, allowed)", "(terms)"),
    ],
    "EffortLimit.by_path": [
        ("by / self.limit[:, None]", "by"),
        ("-= slope", "+= slope"),
        ("slope / self.limit[column]", "slope"),
        ("change[0][:, column, each.joint]", "change[0][:, column, column]"),
    ],
    "EffortLimit.key_of": [
        ("np.tile(np.arange(len(self.keys)), 2)", "np.arange(2 * len(self.keys))")
    ],
    "EffortLimit.refusal": [
        (".argmax()", ".argmin()"),
        (" - 1 + allowed", ""),
        ("allowed * self.limit[column]", "self.limit[column]"),
        ("self.joints[column]", "column"),
    ],
    "MotorCurve.__init__": [
        ("np.flatnonzero(motors.has_curve)", "np.arange(len(motors.armature))")
    ],
    "MotorCurve.used": [
        ("term / self._stall", "term"),
        ("self._way * at", "at"),
        (" / self._no_load", ""),
    ],
    "MotorCurve.by_path": [
        ("by / self._stall[:, None]", "by"),
        ("self._way * speed / self._no_load", "speed / self._no_load"),
        ("self._way * speed / self._no_load", "self._way / self._no_load"),
        ("change[1][:, every, self.joints]", "change[1][:, every, every]"),
    ],
    "MotorCurve.key_of": [
        ("np.tile(np.arange(len(self.keys)), 2)", "np.arange(2 * len(self.keys))")
    ],
    "MotorCurve.refusal": [
        (".argmax()", ".argmin()"),
        ("]) * stall", "])"),
        ("self.joints[column]", "column"),
    ],
    # --- constraints: held_configuration, motor_effort, effort_refusal, effort_costs ------------
    "_both_directions": [
        ("(1.0, -1.0)", "(1.0, 1.0)"),
        ("(1.0, -1.0)", "(-1.0, -1.0)"),
    ],
    "_beyond": [(".max(axis=0) for", ".min(axis=0) for")],
    "_held_mass": [("held * payload.mass", "held")],
    "require_held": [
        ("beyond.min(axis=0).argmax()", "beyond.max(axis=0).argmax()"),
        (".any()", ".all()"),
        ("beyond[:, joint].argmin()", "beyond[:, joint].argmax()"),
        ("(needed - allowed)[:, joint].argmax()", "(needed - allowed)[:, joint].argmin()"),
    ],
    "_needed_and_allowed": [
        ("gravity + friction.most", "gravity"),
        ("-gravity - friction.least", "-gravity"),
        ("np.full_like(gravity, direction)", "np.ones_like(gravity)"),
        ("for way in (1.0, -1.0)", "for way in (1.0, 1.0)"),
        ("np.minimum(np.concatenate(sides), stall)", "np.concatenate(sides)"),
        ("np.minimum(np.concatenate(sides), stall)", "stall * np.ones_like(needed)"),
        ("effort_at(q[None], way)", "effort_at(0 * q[None], way)"),
    ],
    "motor_effort": [(" + coulomb_effort(robot, trajectory, samples)", "")],
    "coulomb_effort": [
        ("if not robot.motors.has_coulomb_friction", "if True"),
        ('side="right"', 'side="left"'),
        (" / widths[piece]", ""),
        ("(samples.time - starts[piece])", "samples.time"),
        ("STILL_SHARE * abs(velocity).max()", "-1.0"),
        ("np.where(moves, velocity, beside)", "velocity"),
        ("np.where(moves, velocity, beside)", "beside", "the same, but where rounding puts a root"),
    ],
    "effort_refusal": [
        (" or robot.motors.forwards_friction[joint]", ""),
        ("robot.motors.backwards_friction[joint] or ", ""),
    ],
    "EffortCosts._effort": [
        ("viscous / slower", "viscous"),
        ("moved / slower**2", "moved / slower"),
    ],
    "EffortCosts._efforts": [
        ("gravity + coulomb_effort(robot, self._trajectory, at)", "gravity"),
        ("smooth - viscous - gravity", "smooth - gravity"),
    ],
    # --- friction in the optimisation -----------------------------------------------------------
    "PhasedSpline.end_directions": [
        ("last - samples.interval", "last - 1 - samples.interval"),
        ("np.sign(velocity[::way][0])", "way"),
        ("_known_direction(velocity[::way], slow)", "_known_direction(velocity, slow)"),
    ],
    "PhasedSpline._velocity_points": [
        ("/ spans[:, None]", ""),
        ("[DEGREE - 1 : 1 - DEGREE]", "[DEGREE:-DEGREE]"),
    ],
    "_known_direction": [
        ("np.logical_and.accumulate(", "np.array("),
        ("onward[1:] &= ~already[:-1]", "pass"),
        ("(onward & fast).any(axis=0) | (first == 0)", "True"),
        ("| (first == 0)", ""),
    ],
    "_Known._friction": [
        ("share * abs(rate)", "0 * abs(rate)"),
        ("if self._is_last else 0.0", ""),
    ],
    "SplineConstraints.blend": [
        ("self._has_reversals and ", ""),
        ("self._blended = intervals", "pass"),
        ("return has_changed", "return True"),
    ],
    "_Known.__init__": [
        (", 1.0)", ", 9.0)"),
        ("blended / spline.grid.interval_count", "1.0"),
    ],
    # --- constraints/time_scaling -------------------------------------------------------------
    "scaling_factor": [("(q, v, a) if jerk is None else (q, v, a, jerk)", "(q, v, a)")],
    "minimum_duration": [
        ("* (1 + _SAFETY)", ""),
        ("_least(problem, smooth, trajectory, segments)", "np.inf"),
        ("others if problem.robot.motors.has_coulomb_friction else", ""),
        ("_exact_peaks", "_hull_peaks"),
        ("with_jerk or ", ""),
        ("with_jerk or limit.order < _JERK", "True"),
        ("jumping, trajectory, segments", "(), trajectory, segments"),
    ],
    "estimated_durations": [("np.minimum(polynomial, sampled)", "sampled")],
    "scaled_to_limits": [("duration / trajectory.duration", "trajectory.duration / duration")],
    "_rate_factor": [
        ("** (1 / limit.order)", "** 1"),
        ("factor = min(factor, (", "factor = max(0.0, ("),
        (
            "peaks(coefficients, trajectory.widths) / limit.limit",
            "peaks(coefficients, trajectory.widths)",
        ),
        ("if used > 0", "if True"),
    ],
    "_hull_peaks": [("abs(hull).max", "hull.max")],
    "_least": [
        ("return -highest", "return least"),
        ("_VALLEY_SHARE * least", "0.0", "the certificate judges what lies between samples"),
        # of simulation/executed_clearance
        ("np.nonzero(bound < nearest", "np.nonzero(bound < 0.5 * nearest"),
        ("closer[lowest] = np.inf", "closer[:] = np.inf"),
        ("np.maximum(closer, along - asked[rows, columns])", "closer"),
        ("float(time[nearest.row])", "float(time[nearest.column])"),
        ("pairs[nearest.column]", "pairs[nearest.row]"),
    ],
    "_least_of_stretches": [
        (
            "-refined_maximum_of_pieces(negative, value.reshape(count, -1), band=band)",
            "-value.max()",
        ),
        ("range(_JERK + 1)", "range(_JERK)"),
        ("common_stretches(trajectory) if motors.has_coulomb_friction else ", ""),
        ("begin + share * (stretches.end[stretch] - begin)", "share"),
        (
            "directed_friction, motors, stretches.direction[stretch]",
            "directed_friction, motors, known[1]",
        ),
    ],
    "_known_per_piece": [("known if orders <= _JERK", "known if True")],
    "_held_factor": [("(factor == 0).any()", "False")],
    # --- constraints: limit_use, required_of_pairs, closest_pairs, binding_limits ---------------
    "_path_samples": [
        ("directed_friction(motors, direction)", "directed_friction(motors, 0 * direction)"),
        ("share / (count - 1)", "share / count"),
        ("np.stack([samples.position", "np.stack([0 * samples.position"),
    ],
    "_position_uses": [
        ("2 * q.min(axis=0) - upper", "q.min(axis=0)"),
        ("2 * q.max(axis=0) - lower", "q.max(axis=0)"),
        ("abs(2 * q[wide] - low[wide] - high[wide])", "abs(2 * q[wide] - low[wide])"),
        ("np.isfinite(lower) | np.isfinite(upper)", "np.isfinite(lower) & np.isfinite(upper)"),
        ("np.where(high > low, 0.0, 1.0)", "np.zeros_like(q)"),
    ],
    "_tool_uses": [
        ("np.hstack([abs(error), angle])", "np.hstack([0 * error, angle])"),
        ("bounds).max(axis=1)", "bounds).min(axis=1)"),
    ],
    "_uses_of": [
        ("np.where(owner == k, shares, 0.0)", "shares"),
        (".max(axis=1),", ".min(axis=1),"),
    ],
    "_shares": [
        ("sign * value for sign in signs", "sign * value for sign in signs[:1]"),
        ("np.where(used.terms[0] == 0, 0.0, 1 - used.allowed)", "1 - used.allowed"),
        ("np.maximum(most - lack, 0.0)", "np.maximum(most, 0.0)"),
        ("np.divide(asked, used.allowed,", "np.divide(asked, 1.0,"),
    ],
    "required_of_pairs": [
        ("if required.is_constant", "if True"),
        ("np.minimum(time, trajectory.duration)", "0 * time"),
        ("= -np.inf", "= 0.0"),
    ],
    "closest_pairs": [("required[:, own]", "0 * required[:, own]")],
    "_closest": [
        ("+ radii[:, 0] * found", "- radii[:, 0] * found"),
        ("- radii[:, 1] * found", "+ radii[:, 1] * found"),
        ("found.distance - least", "found.distance"),
        ("np.where(least == -np.inf, np.inf, found.distance)", "found.distance"),
    ],
    "_closest_columns": [
        ("bound = checker.sphere_distances(*poses, pairs) - required", "bound = 0 * required"),
        ("np.nonzero(bound < least[:, None])", "np.nonzero(bound < least.min())"),
        ("pairs[column]) - required[row, column]\n    while", "pairs[column])\n    while"),
        ("found.distance - required[row, column]", "found.distance"),
        ("closer < least[row]", "closer < 0.5 * least[row]"),
        ("np.lexsort([closer, row])", "np.lexsort([-closer, row])", "only slower"),
        ("column[first[nearer]]", "column[first][0]"),
        ("closer[first] = np.inf", "closer[:] = np.inf"),
    ],
    "BindingRow.spans": [
        (") / 2", ") / 3"),
        ("k != NONE and ", ""),
        ("and end > begin", "", "a span without length is seen nowhere"),
    ],
    "binding_rows": [("if own]", "]"), ("LINKS if use.joint is None", "TOOL if use.joint is None")],
    "clearance_use": [
        ("1 - closest.margin / _FAR", "1 - closest.distance / _FAR"),
        ("np.maximum(1 - closest.margin / _FAR, 0.0)", "1 - closest.margin / _FAR"),
    ],
    "bound_share": [
        ("not in _OF_THE_SHAPE", "not in ()"),
        ("binds |= ", "binds = "),
        ("np.append(halves, 0.0) + np.append(0.0, halves)", "np.ones(len(binds))"),
    ],
    "_excess": [("_BINDS_IN_RANGE if", "_BINDS if"), ("_BINDS_IN_RANGE if", "1.0 if")],
    "_row": [
        ("np.where(binding, share, -np.inf)", "share"),
        ("argmax(axis=0)", "argmin(axis=0)"),
        ("which, NONE", "which, 0"),
    ],
    "_BINDS": [("0.98", "0.99"), ("0.98", "0.95")],
    # --- constraints/peaks ----------------------------------------------------------------------
    "refined_maximum_of_pieces": [
        ("function(piece[peak], share)", "function(piece[0 * peak], share)"),
        ("np.minimum(sample + 1, last) / last", "sample / last"),
        ("np.maximum(sample - 1, 0) / last", "sample / last"),
        ("value.shape[1] - 1", "value.shape[1]"),
    ],
    "_zoomed": [
        ("peak = peak[rows]", "pass"),
        ("if ends_are_smooth else np.inf", "if False else np.inf"),
    ],
    "_rise_at_end": [("2 * falling[:, 1]", "falling[:, 1]")],
    # --- refinement/ordered_segments, spline_constraints ----------------------------------------
    "_Passage._left_out": [
        (" | leaves_asked", ""),
        ("distance > max(_FAR, _FARTHER * beside[step])", "False"),
        ("away[~self.is_asked[segments]] = 0.0", "pass"),
        ("max(away[worst], _LEAST_SHARE)", "away[worst]", "on the line it is no matter"),
    ],
    "_Passage.missed": [("> self.radius**2", "> 0.9 * self.radius**2")],
    "SplineConstraints._ask_for_missed": [("self._is_asked | missed", "missed")],
    "SplineConstraints.add_samples": [(".and_also(around)", "")],
    "_JERK_SAMPLES": [("np.arange(3) / 2", "np.arange(2) / 2")],
    "_depends_on_jerk": [
        (">=", ">"),
        ('limit.order >= RATES["jerk"]', "True", "only slower: more samples of efforts"),
    ],
    # --- constraints/effort_rate, robot/effort_rate ---------------------------------------------
    "EffortRate.used": [
        ("(rate - gravity)", "rate"),
        ("{1: gravity / self", "{0: gravity / self"),
        ("{1: gravity, 2", "{0: gravity, 2"),
        ("rate - gravity - viscous", "rate - gravity"),
        ("motors.viscous_friction * at.by_path[2]", "motors.viscous_friction * at.by_path[1]"),
        ("at.effort_rate[:, self.joints]", "at.effort_rate[:, -len(self.limit) - 1 : -1]"),
    ],
    "EffortRate.by_path": [
        ("at.rate(3, speed)", "at.by_path[3]"),
        ("speed**k / self", "speed**3 / self"),
        ("by[:, self.joints]", "by[:, self.joints - 1]"),
    ],
    "EffortRate.key_of": [("np.arange(len(self.joints))", "0 * self.joints")],
    "EffortRate.__init__": [("np.isfinite(limit)", "0 * limit == 0")],
    "effort_rate": [("[v, a, jerk]", "[v, v, jerk]"), ("[v, a, jerk]", "[v, a, a]")],
    "gravity_effort_rate": [("(q, still, still)", "(q, v, still)")],
    "effort_rate_derivatives": [
        ("change[1] + mean[0]", "change[1]"),
        ("change[2] + mean[1]", "change[2]"),
        ("2 * step", "step"),
    ],
    "_steps": [("_STEP, fastest, out", "100 * _STEP, fastest, out"), ("where=fastest > 0", "")],
    # --- constraints/tool_speed -----------------------------------------------------------------
    "ToolSpeed.__init__": [
        ("np.minimum(free, tube.tool_speed)", "tube.tool_speed"),
        ("np.minimum(free, tube.tool_speed)", "free"),
        ("LimitKey(self.kind, segment=k)", "LimitKey(self.kind, segment=0)"),
    ],
    "ToolSpeed.used": [
        ("self.limit[at.segment]", "self.limit[0]"),
        ("{1: (speed", "{2: (speed"),
        ("axis=1)", "axis=1) ** 2"),
    ],
    "ToolSpeed.by_path": [
        ("self.limit[at.segment]", "self.limit[0]"),
        ("speed / self", "1.0 / self"),
        ("at.tool_rate", "[0 * each for each in at.tool_rate]"),
    ],
    "ToolSpeed.key_of": [
        ("np.searchsorted(self._limited, at.segment)", "at.segment"),
        ("np.minimum(places, len(self._limited) - 1)", "0 * places"),
    ],
    # --- constraints/speed_of_points -------------------------------------------------------------
    "speed_by_path": [
        ("(by_position, by_rate)", "(0 * by_position, by_rate)"),
        ("(by_position, by_rate)", "(by_rate, by_position)"),
        (" / np.maximum(size, np.finfo(float).tiny)", ""),
        ("direction * scale[:, None]", "direction * scale[0]"),
    ],
    # --- constraints/point_speed -----------------------------------------------------------------
    "PointSpeedLimit.__init__": [("point=k", "point=0")],
    "PointSpeedLimit.used": [
        ("axis=2)", "axis=2) ** 2"),
        ("{1: speed", "{2: speed"),
        ("speed.T / self.limit", "speed.T / self.limit[0]"),
    ],
    "PointSpeedLimit.by_path": [
        ("speed / self", "1.0 / self"),
        ("self.limit[:, None]", "self.limit[0]"),
        ("speed_by_path(*each)", "[0 * by for by in speed_by_path(*each)]"),
    ],
    "PointSpeedLimit.key_of": [("np.arange(len(self.limit))", "0 * np.arange(len(self.limit))")],
    # --- constraints/velocity_by_position --------------------------------------------------------
    "VelocityByPositionLimit.__init__": [
        ("np.append(upper, -lower)", "np.append(upper, lower)"),
        ("np.where(np.isfinite(own), own, most)", "most"),
        ("np.sqrt(2 * self._deceleration", "np.sqrt(self._deceleration"),
    ],
    "VelocityByPositionLimit.allowed": [
        ("- self._offset", "- 0.9 * self._offset"),
        ("np.maximum(self._root(q) - self._offset, 0.0)", "self._root(q) - self._offset"),
    ],
    "VelocityByPositionLimit.edge": [
        ("share * self.largest", "share"),
        ("root**2 / (2", "root**2 / (1"),
    ],
    "VelocityByPositionLimit.used": [
        ("(allowed == 0) & (rate < _STILL)", "allowed < 0"),
        ("(rate > 0) | (allowed == 0)", "rate > 0"),
        ("(rate > 0) | (allowed == 0)", "rate > -np.inf"),
        ("1 - allowed, 0.0", "0.5 - allowed, 0.0"),
        ("SpeedPolynomial(terms, allowed)", "SpeedPolynomial(terms)"),
    ],
    "VelocityByPositionLimit.by_path": [
        ("self._deceleration / np.maximum(root, _LEAST_ROOT * self.largest)", "1.0 / root"),
        ("np.maximum(root, _LEAST_ROOT * self.largest)", "root"),
        ("(root > self._offset) & (rate > 0)", "rate > 0"),
        ("(root > self._offset) & (rate > 0)", "root > self._offset"),
        ("self.way * speed", "self.way"),
    ],
    "VelocityByPositionLimit.key_of": [
        ("np.arange(len(self.keys))", "0 * np.arange(len(self.keys))")
    ],
    "VelocityByPositionLimit.out_of_reach": [
        ("beyond > allowed", "beyond > 1.0"),
        ("& (to_go > _STILL)", ""),
        ("self._offset > 0, -_STILL", "self._offset > 0, _STILL"),
        ("self._offset > 0, -_STILL", "self._offset >= 0, -_STILL"),
    ],
    # --- constraints/approachable_range ----------------------------------------------------------
    "approachable_range": [
        ("lower < upper, [lower", "lower < np.inf, [lower"),
        ("limit.edge(_WORTH_USING)", "limit.edge(0.0)"),
        ("np.maximum(bounds[1], end)", "bounds[1]"),
        ("np.minimum(bounds[0], end)", "bounds[0]"),
    ],
    # --- robot/frame_velocities ------------------------------------------------------------------
    "frame_velocities": [
        ("change += turned.swapaxes(2, 3)", ""),
        ("rotation @ by_q[..., :3, :]", "rotation @ by_q[..., 3:, :]"),
        ("by_q[f, i], by_v[f, i]", "by_q[0, i], by_v[0, i]"),
        ("joints.collected(change)", "change"),
    ],
    # --- verification/judged/point_speed ---------------------------------------------------------
    "judge_point_speed": [
        ("enumerate(points)", "enumerate(points[:1])"),
        ("return min(", "return max("),
    ],
    "_judged": [
        ("np.linalg.norm(vector, axis=2)", "vector[..., 0]"),
        ("least.lower_bound, least.attained", "least.attained, least.attained"),
        ("np.array([1 / limit])", "np.array([0.0])"),
        ("_ENCLOSURE * limit", "0.1 * limit"),
        ("motion.trajectory.duration)", "motion.trajectory.duration / 4)"),
        ("point_speed=k", "point_speed=0"),
        # of simulation/judged_runs
        ("plant.tool_pose(problem.robot, q)", "problem.robot.tool_pose(q)"),
        ("q, plant.base, more)", "q, 0 * plant.base, more)"),
        ("limits.lower_position - q", "q - limits.lower_position"),
        ("away.argmax()", "away.argmin()"),
        ("q - limits.upper_position", "q - limits.lower_position"),
        ("beyond.max(axis=0)", "beyond.min(axis=0)"),
        ("abs(q - planned)", "q - planned"),
        ("abs(execution.velocity[run])", "execution.velocity[run]"),
        ("fast / limits.velocity", "fast"),
        (".any(axis=1).mean()", ".all(axis=1).mean()"),
        (".any(axis=1).mean()", ".mean()"),
        ("execution.is_saturated[run]", "execution.is_saturated[0]"),
        ("clearance=problem.clearance", "clearance=0.0"),
        ("beyond.max(axis=1)", "beyond.min(axis=1)"),
        ("execution.plants[run]", "execution.plants[0]"),
        ("rotation=excursions.rotation", "rotation=None"),
        ("points=excursions.points", "points=None"),
    ],
    "_point_velocity": [
        ("@ np.append(point.position, 1.0)", "@ np.array([0.0, 0.0, 0.0, 1.0])"),
        ("place = rotation[:, body] @ in_body[:3] + ", "place = "),
        (" / width\n", " * width\n"),
        ("np.linalg.norm(in_body[:3])", "0.0"),
    ],
    "point_majorant": [
        ("carrier.origin + reach", "reach"),
        ("+ reach * carrier.unit", "+ 0.5 * reach * carrier.unit"),
    ],
    # --- verification/judged/velocity_by_position ------------------------------------------------
    "_Approaches.left": [
        ("root - velocity", "root"),
        ("2 * self.deceleration[which]", "self.deceleration[which]"),
        ("- self.offset[which]", ""),
        ("distance >= 0", "distance >= -1.0"),
        ("near / self.largest[which]", "near"),
    ],
    "_approaches": [
        ("np.where(np.isfinite(limit), limit,", "np.where(limit < 0, limit,"),
        ("[velocity, -velocity]", "[velocity, velocity]"),
        ("to_lower[-1] -=", "to_lower[-1] +="),
    ],
    "_least_left": [
        ("np.maximum(near, away)[[0, -1]]", "near[[0, -1]]"),
        ("np.maximum(near.min(axis=0), away.min(axis=0))", "near.min(axis=0)"),
        ("near.min(axis=0), away.min(axis=0)", "near.max(axis=0), away.min(axis=0)"),
        ("lower[~split].min(initial=np.inf)", "attained"),
        ("attained - _RESOLUTION", "attained - 1.0"),
    ],
    # --- verification/judged/tool_speed -------------------------------------------------------
    "judge_tool_speed": [
        ("np.linalg.norm(vector, axis=2)", "vector[..., 0]"),
        ("/ limit[segment]", "/ limit[0]"),
        ("isfinite(limit).any()", "isfinite(limit).all()"),
        ("least.lower_bound, least.attained", "least.attained, least.attained"),
        ("margin, 1 / limit)", "margin, 0 / limit)"),
        ("_ENCLOSURE * limit.min()", "0.1 * limit.min()"),
    ],
    "ToolSpeedMargin.at": [("/ self._limit", "/ self._limit[0]")],
    "ToolSpeedMargin.within": [("self._limit[segment]", "self._limit[0]")],
    "ToolSpeedMargin._speed": [("np.linalg.norm(velocity, axis=1)", "abs(velocity[:, 1])")],
    "tool_speed_margin": [("np.isfinite(limit).any()", "False")],
    "_limits": [
        ("np.minimum(own, asked)", "asked"),
        ("np.minimum(own, asked)", "own"),
        ("own if asked is None", "np.full(len(own), np.inf) if asked is None"),
    ],
    "_velocity": [
        ("[:, :3], v)", "[:, 3:], v)"),
        (" / width\n", " * width\n"),
        (
            "derivative(tool_majorant(robot, joints).position)",
            "joints[:-1, :, 0]",
        ),
    ],
    # --- refinement: what the planner is constrained by ---------------------------------------
    "EvaluatedRegions._excess_of": [
        (" - (1 - self.margin)", " - 1"),
    ],
    "Capsules._away": [
        ("0.0, 1.0)", "0.0, 2.0)"),
        ("share[..., None] * axis", "0 * axis"),
    ],
    "Capsules.share": [(" / self.radius[segment]", "")],
    "Capsules.margin": [("self.radius[segment] - ", "1.0 - ")],
    "Capsules.outward": [("out=np.zeros_like(away)", "out=away.copy()")],
    "Capsules.extent": [("self.radius[segment]", "1 + 0 * self.radius[segment]")],
    "EvaluatedRegions.slack": [("self.vector + bend", "self.vector - bend")],
    "EvaluatedRegions._slack": [
        ("1 - self.margin[at] - beyond", "1 - beyond"),
        ("1 - self.margin[at] - beyond", "0.95 - self.margin[at] - beyond"),
        ("vector - self._end", "vector - self._begin"),
        ("np.minimum(", "np.maximum("),
        ("beyond / extent", "beyond"),
    ],
    "EvaluatedRegions.rows": [
        ("by_joint /= self._extent(planes)[:, None]", "pass"),
        ("self.numbers[segment, ", "self.numbers[0 * segment, "),
    ],
    "EvaluatedRegions.planes": [
        ("normal[1:, self.in_chain]", "normal[1:, ~self.in_chain]"),
        ("normal[1:, self.in_chain]", "normal[:, self.in_chain]"),
    ],
    "EvaluatedRegions.planes_where_outside": [("> elastic + _OUTSIDE", "> elastic + 1.0")],
    "Planes.and_also": [("return self", "return other")],
    "EvaluatedRegions.after": [
        ("self.vector + np.einsum", "self.vector - np.einsum"),
        ("at.change(control, switching)", "at.change(control, 0 * switching)"),
    ],
    "widened_radius": [
        ("np.minimum(_INTERVAL_SHARE * interval_of, widest)", "widest * 0 + 1.0"),
        ("np.maximum(tube.effective_radius, wanted)", "wanted"),
        ("np.minimum(widest[:-1], widest[1:])", "widest[:-1]"),
    ],
    "_corner_radius": [("np.minimum(length[:-1], length[1:])", "length[:-1]")],
    "EvaluatedRotation.excess": [
        ("abs(self._error)", "self._error"),
        (" - (1 - self.margin)", " - 1"),
    ],
    "EvaluatedRotation.angle": [("self.tube.bounds[:, 3]", "self.tube.bounds[::-1, 3]")],
    "EvaluatedRotation.rows": [
        (" / bounds[:, :, None]", ""),
        (
            "np.where(np.isfinite(bounds), self._slack.reshape(bounds.shape), np.inf)",
            "self._slack.reshape(bounds.shape)",
        ),
    ],
    "EvaluatedRotation._slack": [("1 - self.margin", "1")],
    "unused_speed": [
        ("trajectory.jerk(time)", "None"),
        ("1 - 1 / np", "1 / np"),
    ],
    "EvaluatedSpeedLimit.squared_durations": [
        ("** -2.0", "** -1.0"),
        (".min(axis=1)", ".max(axis=1)"),
    ],
    "EvaluatedSpeedLimit.row_count": [("len(self.limit.signs)", "2")],
    "EvaluatedSpeedLimit._by_path": [
        ("self.limit.by_path(self.path, 1 / duration)", "self.limit.by_path(self.path, 1.0)"),
        ("if duration not in self._changes", "if not self._changes"),
    ],
    "EvaluatedSpeedLimit.rows": [
        ("self._used.at(1 / duration)", "self._used.at(duration)"),
        ("self._used.degree / 2", "self._used.degree / 3"),
        ("self.numbers[self.limit.key_of(self.path)]", "self.limit.key_of(self.path)"),
    ],
    "EvaluatedSpeedLimit.slack": [
        ("longer ** (degree - k)", "longer**degree"),
        ("longer**degree - sign", "1 - sign"),
        ("squared_duration**0.5", "squared_duration"),
        ("duration**-k * ", ""),
    ],
    "EvaluatedSpeedLimit._by_duration": [
        ("(degree - k) / 2", "(degree - k)"),
        ("duration**-k * ", ""),
    ],
    "sided_rows": [
        ("[side] * with_side.ravel()[entry] - on_every", "[side] * with_side.ravel()[entry]"),
        ("np.array(signs)[side] * with_side", "with_side"),
        ("np.multiply.outer(signs, used)", "np.multiply.outer(np.ones(len(signs)), used)"),
        ("entry // used.shape[1]", "entry // 2"),
    ],
    "plane_rows": [
        ("index // slack.shape[1]", "index"),
        ("-np.inf, size", "_CLOSE, size"),
    ],
    "used_by_step": [("rows.duration * duration", "0.0")],
    "_breakable": [
        ("sign[:, None] * switching", "switching"),
        ("sign[:, None, None] * control", "control"),
        ("np.maximum(little, _reach(control, switching, size))", "little"),
        ("np.maximum(little, _farthest(at, by_path, size))", "little"),
    ],
    "_farthest": [
        ("abs(at.basis[orders])", "at.basis[orders]"),
        ("abs(by_path[order])", "by_path[order]"),
        ("size.switching", "0 * size.switching"),
    ],
    "_reach": [
        ("abs(switching) @ size.switching", "0.0"),
        ("abs(control).sum", "control.sum"),
    ],
    "EvaluatedLinks._slack": [("self.closest.distance - self.aim", "self.closest.distance")],
    "EvaluatedLinks._by_joint": [
        ("self.aim.change - gradient", "self.aim.change + gradient"),
        (" / _UNIT", ""),
    ],
    "INNER_MARGIN": [("0.005", "0.055")],
    "Refinement._on_coarse_knots": [("_GAIN, max_steps", "_GAIN, 4")],
    "SequentialProgram._hardly_move": [
        ("reach < MERIT_TOLERANCE", "reach < 0.0"),
        ("reach < MERIT_TOLERANCE", "reach < 10.0"),
    ],
    "SequentialProgram._reach": [("rows.control * is_free[:, :, None]", "0 * rows.control")],
    # --- refinement: descent, shared_columns, tied_legs, control_variables ----------------------
    "Descent.improved": [
        ("trust.after(outcome)", "TrustRegion(trust.radius, trust.after(outcome).damping)"),
    ],
    "Descent._tried": [("gain < _GOOD_RATIO * predicted", "False")],
    "_Linearized.__init__": [
        ("durations / durations.sum()", "0 * durations + 1 / len(durations)"),
    ],
    "_Linearized.moved": [
        ("starts[(k + 1) % len(each)] = goal", "starts[(k + 1) % len(each)] = None"),
        ("(k + 1) % len(each)", "k"),
    ],
    "shared_columns": [
        ("others + len(legs) + k", "others + len(legs)"),
        ('side="right"', 'side="left"'),
        ("+= np.arange(len(sequence))", "+= 0"),
    ],
    "_numbers": [
        ("k > 0 and is_tied[k - 1]", "is_tied[k]"),
        ("if is_tied[-1]", "if False"),
    ],
    "_before": [("leg.behind[leg.is_among]]", "leg.behind[leg.is_among] * 0]")],
    "LegShape.is_among": [("self.intervals <= longest", "self.intervals < longest")],
    "ControlVariables.before": [("self.column + 1", "self.column")],
    "PlanningClock.check": [(">= self._provision[0]", "< self._provision[0]")],
    "PlanningClock.provided": [("self._provision = None", "pass")],
    "_closed": [("closed[0][0] = closed[-1][-1]", "closed[-1][-1]")],
    "JointBlocks.linear": [("np.add.at(total, own, block.linear)", "total[own] = block.linear")],
    "JointBlocks.bounds": [
        ("np.maximum.at(lower, own, block.lower)", "lower[own] = block.lower"),
        ("np.minimum.at(upper, own, block.upper)", "upper[own] = block.upper"),
    ],
    "BandedProgram.join": [
        ("block.slack[len(self._places[leg]) :]", "block.slack"),
        ("block.rows[self._known[leg] :]", "block.rows"),
    ],
    "BandedProgram.correct": [("self._slack[places] = block.slack", "pass")],
    "BandedProgram.solve": [("multipliers[own] for own in", "multipliers[: len(own)] for own in")],
    "_turned_away": [
        ("own -= own @ directions.T @ directions", "pass"),
        ("~is_meant], own[row, column]", "~is_meant], -own[row, column]"),
    ],
    "SymmetricEntries.among": [
        ("variables[self.row], variables[self.column]", "self.row, self.column")
    ],
    "SymmetricEntries.product": [("x[self.column]", "x[self.row]")],
    "Block.held": [("np.arange(size - n, size)", "np.arange(n)")],
    "StepSearch.solve": [("for _ in range(_MAX_ROUNDS)", "for _ in range(1)")],
    "ControlVariables.moved": [
        ("points += (1 - self._share_of_goal)", "points += 0 * self._share_of_goal"),
        ("points += self._share_of_goal", "points += 0 * self._share_of_goal"),
        ("points[:REST_POINTS] = start", "pass"),
    ],
    "ControlVariables.tie": [
        ("np.maximum(self.lower[-1], following.lower[0])", "self.lower[-1]"),
        ("np.minimum(self.upper[-1], following.upper[0])", "following.upper[0]"),
    ],
    "ControlVariables._columns": [("0 if self._start_moves else FIXED", "FIXED")],
    "TiedLegs._programs": [
        ("start_moves=is_tied[k - 1]", "start_moves=is_tied[k]"),
        ("wanted and ControlVariables", "ControlVariables"),
    ],
    "_joined": [
        ("intervals // _FEWEST", "most"),
        ("begin + np.append", "np.append"),
        ("np.append(band.plan, np.nan)", "np.append(band.plan, 0)"),
    ],
    # --- refinement/refinement ----------------------------------------------------------------
    "_dodged": [("again.links.excess.max(initial=0.0) > _DODGED", "False")],
    # --- refinement/trust_region --------------------------------------------------------------
    "TrustRegion._next_radius": [
        ("return min(2 * self.radius, _MAX_RADIUS)", "return self.radius"),
        ("0.4 * min(self.radius, max(size, MIN_RADIUS))", "0.4 * self.radius"),
    ],
    "TrustRegion.may_relax": [
        ("self.damping * self.unit**2", "self.damping"),
        (" and self.times_relaxed < _MOST_RELAXED", ""),
    ],
    "TrustRegion.relaxed": [("self.damping / _RELAXED", "self.damping")],
    "TrustRegion.largest_change": [("self.radius * self.unit", "self.radius")],
    "motion_unit": [
        ("farthest / _LARGE_MOTION", "1.0"),
        ("max(float(np.ptp", "min(float(np.ptp"),
        (", 1.0) or 1.0", ", 1.0)"),
    ],
    "TrustRegion._next_damping": [
        ("outcome.ratio > _DECENT", "outcome.ratio > _GOOD"),
        ("outcome.predicted - outcome.linear", "outcome.predicted - outcome.gain"),
        ("max(_MORE * self.damping, enough)", "_MORE * self.damping"),
    ],
    # --- planning: blocked_spot, path_spots -----------------------------------------------------
    "blocked_spot": [("[*_POSITION_CHECKS, _not_free]", "[]")],
    "_first_reason": [("if reason is not None:", "if False:")],
    "_turned_out_of_bounds": [("turned=True) is not None", "turned=False) is not None")],
    "_Configurations.is_there": [("self.spot.allowed + _REACHED", "10.0")],
    "_Configurations.is_free": [("depth <= self", "depth >= self")],
    "_path_spots": [("if k < last", "if k <= last")],
    "_inside": [("/ 2]", "]")],
    "_corner": [(".min())", ".max())")],
    # --- branches: outside_bounds, pose_within_tolerance ----------------------------------------
    "outside_bounds": [(".argmin()", ".argmax()")],
    "bounded_by": [("is_limit else", "not is_limit else")],
    "_Lacks.of": [("_ANGLE_WEIGHT * beyond,", "0 * beyond,")],
    # --- planning/narrowed_plan ----------------------------------------------------------------
    "narrowed_plan": [
        ("problem.tube.scaled(share)", "problem.tube"),
        ("(ProblemError, Infeasible)", "(Infeasible,)"),
        ("certified_result(problem, found", "certified_result(narrower, found"),
        ("if widened is not None and widened.succeeded:", "if False:"),
    ],
    # --- what a second stage gains: smoothness, energy and work --------------------------------
    "MeasuredObjective._longer": [("- 1, 0.0)", ", 0.0)")],
    "MeasuredObjective.after": [("max(self._worth / 2", "max(self._worth")],
    "MeasuredObjective.gain": [(" - longer", "")],
    "MeasuredObjective.predicted_gain": [
        ("self._longer(current) - max(step.duration, 0.0)", "self._longer(current)"),
        ("- padded @ own.hessian.product(padded) / 2", ""),
    ],
    "MeasuredObjective._measure": [(" + _NOTHING", "")],
    "EffortRate._raised": [("** -0.75", "** -0.5")],
    "EffortRate.model": [
        ("-0.75 * rate / elapsed", "0.75 * rate / elapsed"),
        ("12 * share * rate**2", "-12 * share * rate**2"),
    ],
    "EffortVariation.total": [(" - _ROUNDED)", ")")],
    "Jerk._raised": [("** 0.25", "** 1.0")],
    "Jerk.model": [
        ("jerk / (4 * width)", "jerk / width"),
        ("12 * share * jerk**2", "6 * share * jerk**2"),
    ],
    "IntervalMotion.chained": [
        ("placed[:-1, 2, :, 1:] = control[:-1, 2]", "placed[:-1, 2, :, :-1] = control[:-1, 2]"),
        ("placed[-1, 2, :, :-1] = control[-1, 2]", "pass"),
        ("placed, self.at_samples(switching)", "placed, 0 * self.at_samples(switching)"),
    ],
    "_nominal_efforts": [("np.isfinite(limit), limit", "np.isfinite(limit), most")],
    "Energy.__init__": [("1 / np.sqrt(weights)", "1 / weights")],
    "Energy.model": [
        ("(2 * motion.width[:, None])", "motion.width[:, None]"),
        ("np.full(residual.shape, 2 * share)", "np.full(residual.shape, share)"),
    ],
    "Work.total": [("(added + np.hypot", "(abs(added) + np.hypot")],
    "Work.model": [
        ("share * (1 + added / size) / 2", "share * added / size"),
        ("[power, both]", "[power]"),
    ],
    "Work._power_by_path": [("by_path[1] + effort", "by_path[1] - effort")],
    "objective_measures": [("((_WEIGHT, own), *", "((0.0, own), *")],
    "EffortCosts.energy": [(" * slower", "")],
    "EffortCosts.work": [("np.maximum(power, 0.0)", "abs(power)")],
    "cheapest_duration": [
        ("return float(min(reversed(tried), key=costs.work))", "return longest"),
        ("key=lambda duration: costs", "key=lambda duration: -costs"),
    ],
    "_in_duration": [
        ("if no_longer(duration, found.duration):", "if True:"),
        ("trajectory=None", "trajectory=found.trajectory"),
    ],
    "Objective.energy_weights": [("1 / robot.limits.effort**2", "1 / robot.limits.effort")],
    "is_multiple": [("<= _ROUNDING", "<= 0.5")],
    "_saved": [("(after, before)", "(before, after)")],
    "IntervalBlocks.matrix": [("corner / len(blocks)", "corner")],
    "IntervalBlocks.vector": [("total[self._switching] += by_switching", "pass")],
    "IntervalBlocks.__init__": [("place[which == FIXED] = FIXED", "pass")],
    # --- refinement/second_stage ---------------------------------------------------------------
    "SecondStage.__init__": [
        ("- _LESS_ROOM", "- 0.2"),
        ("(1 - _LESS_CLEARANCE) *", "0 *"),
        ("max(clearance, 0.0), _MOST_CLEARANCE", "max(clearance, 0.0), 1.0"),
    ],
    "SecondStage._has_time_with_friction": [
        ("<= longest", "<= 2 * longest"),
        ("watch(spline, begin[stretches.start > 0])", "watch(spline, begin[:0])"),
    ],
    "SecondStage._looked_at": [
        ("dense.excess > MERIT_TOLERANCE", "False"),
        ("dense.squared_duration <= longest**2", "True"),
        (
            "if not self._problem.robot.motors.has_coulomb_friction",
            "if True",
            "only worse: what takes longer is refused afterwards, and there is no second stage",
        ),
    ],
    "SecondStage.answer": [
        ("time / duration", "time"),
        ("self._best = None\n", "pass\n"),
    ],
    "SecondStage._is_better": [("<", ">")],
    "_room": [
        ("1 - share", "share"),
        ("tube.compulsory_points - 1, tube.compulsory_points", "tube.compulsory_points"),
        ("after=None if good is None else good.proposal.after", "after=change.before"),
    ],
    # --- a controller's periods ----------------------------------------------------------------
    "on_periodic_knots": [
        ("np.union1d(breakpoints, ends)", "np.unique(breakpoints)"),
        ("spline.grid.chains, is_fixed=True", "is_fixed=True"),
        ("is_fixed=True", "is_fixed=False"),
    ],
    "_filled": [
        ("if widths[widest] == 1:", "if widths[widest] <= 2:"),
        ("len(places) - 1 < intervals", "len(places) < intervals"),
        ("np.full(count, np.inf) if value is None", "np.zeros(count) if value is None"),
    ],
    "_apart": [
        ("max(places[k], places[k - 1] + 1)", "places[k]"),
        ("last - np.arange(count)[::-1]", "last"),
    ],
    "periodic_plan": [
        (", phases, _FEWEST_PERIODS)", ")"),
        ("duration=count * period, period=period", "duration=count * period"),
        ("if no_longer(found.duration, count * period):", "if True:"),
        ("notes=shortest.notes", "notes=()"),
    ],
    "fewest_periods": [("duration / period - _ROUNDING", "duration / period")],
    "most_periods": [("duration / period + _ROUNDING", "duration / period")],
    "lengthened": [("np.round(slower.breakpoints / period) * period", "slower.breakpoints")],
    "_followed": [
        ("most_periods(longest, period)", "most_periods(1.0, period)"),
        ("shortest.stopped_by is not None", "False"),
    ],
    "_in_whole_periods": [("if longer.succeeded:", "if True:")],
    "TrajectoryFiles.sample_rate": [("1 / period", "0.5 / period")],
    "second_stage_plan": [
        ("or not no_longer(after.duration, longest)", ""),
        ("shortest=shortest.trajectory", "shortest=None"),
        ("motion=shortest.motion", "motion=None"),
    ],
    "effort_variation": [
        ("if beside is None else _efforts(robot, beside)", ""),
        ("/ nominal", ""),
        ("np.isfinite(limit), limit", "np.isfinite(limit), most"),
    ],
    "largest_jerk": [
        ("np.minimum(robot.limits.jerk, robot.limits.effort_rate)", "robot.limits.jerk")
    ],
    "Samples.times_by_switching": [("* (1 - self.share[:, None])", "* self.share[:, None]")],
    "KnotGrid.switch_count": [("0 if self.is_fixed else", "")],
    "segments_of_pieces": [("chain.start", "chain.stop - 1")],
    # --- refinement/step_cost -----------------------------------------------------------------
    "StepCost.quadratic": [
        ("damping * self._damped", "0 * self._damped"),
        ("weight * bends", "abs(weight) * bends"),
    ],
    "StepCost._squared_rates": [("self._intervals * float", "float")],
    "StepCost.squared_rates": [("changes**2 /", "changes /")],
    "StepCost._of_widths": [
        ("-inverse[1:-1], -inverse[1:-1]", "inverse[1:-1], inverse[1:-1]"),
        ("damping * self._squared_rates(spline.control_points)", "damping"),
    ],
    "SequentialProgram.radius_of": [
        ("max(farthest, float", "max(0.0, float"),
        ("/ _WIDTH_SHARE", "* 0"),
    ],
    # --- refinement/link_constraints ----------------------------------------------------------
    "LinkConstraints._still_apart": [
        ("distance - abs(q - seen) @ self._approach.T", "distance"),
    ],
    # --- refinement/phased_spline -------------------------------------------------------------
    "Samples._by_recursion": [
        ("(second + behind * third / 3)", "(second + behind * third / 2)"),
    ],
    "Samples.basis": [
        ("np.iscomplexobj(switching_times)", "False", "the native function refuses complex times"),
    ],
    "KnotGrid.places": [("[1.0]", "[0.0]")],
    "basis_by_switching": [(" / _IMAGINARY_STEP", "")],
    # --- refinement/sampled_spline ------------------------------------------------------------
    "SampledSpline.changes": [("isinstance(points, Samples)", "False", "only slower")],
    "SampledSpline.chained": [("np.repeat(which, quantities)", "np.tile(which, quantities)")],
    "SampledSpline._chained": [("basis[:, samples]", "basis[:, : len(by_state[0])]")],
    # --- tube/box_regions ---------------------------------------------------------------------
    "box_sections": [("entry is None or (", "not entry or (")],
    "radii_of_boxes": [("(halves > 0).all()", "(halves > 0).any()")],
    "_radius": [("min(width, height) / 2", "width / 2"), ("<= _SAME", "<= 1.0")],
    "_section": [
        ("sides >= _SMALLEST", "sides >= 0"),
        ("- (upward @ along) * along", "- 0 * along"),
        ("distance >= MIN_LENGTH", "distance > 0"),
        ("abs(length - 1) > _SAME", "True"),
    ],
    "BoxRegions.frame": [
        (
            '- np.einsum("mi,mi->m", self.sections[:, 2:], along)[:, None] * along',
            "- 0 * along",
        ),
    ],
    "BoxRegions.half": [
        ("/ 2 - self.tool_radius", "/ 2"),
        ("sides.min(axis=1)", "sides.max(axis=1)"),
        ("* (self.radius / own)[:, None]", "* 1.0"),
    ],
    "BoxRegions.margin": [(".min(axis=-1)", ".max(axis=-1)")],
    "BoxRegions.share": [(".max(axis=-1)", ".min(axis=-1)")],
    "BoxRegions.outward": [
        ("share.argmax", "share.argmin"),
        ("side[:, None] * normal", "normal"),
    ],
    "BoxRegions.faces": [("-across, up, -up", "-across, up, up")],
    "BoxRegions.kind": [
        ("parts[:, 1] > parts[:, 0]", "parts[:, 0] > parts[:, 1]"),
        ("argmin", "argmax"),
    ],
    "BoxRegions._parts": [("abs(", "(")],
    # --- controllers, peaks, unused values ----------------------------------------------------
    "_Commands.__init__": [
        ("-_STILL, count", "0, count"),
        ("count + _STILL + 1", "count + 1"),
    ],
    "_Commands.instants": [("self.time[order:]", "self.time[: len(self.time) - order]")],
    "_differences": [("/ PERIOD**order", "/ PERIOD")],
    "_aborts": [("position[:-1]", "position[1:]")],
    "_unrest": [("_AT_REST * limit[joint]", "limit[joint]")],
    "_exceeded": [
        ("lower - value", "value - lower"),
        ("lower if below else upper", "upper"),
        (".any(axis=1)", ".all(axis=1)"),
    ],
    "FrankaLimits.velocity_bounds": [
        ("2 * deceleration", "1 * deceleration"),
        ("0.0, most)", "-most, most)"),
    ],
    "_altered": [
        ("given.first_time > 0", "given.first_time < 0"),
        ("coefficients[-1, 0]", "coefficients[-1, -1]"),
    ],
    "_refused": [("abs(velocity[joint]) > _MOVES", "velocity[joint] > _MOVES")],
    "ControllerVerdict.gravest": [
        ("(Effect.REFUSED, Effect.ALTERED)", "(Effect.REFUSED,)"),
        ("Effect.REFUSED, Effect.ALTERED", "Effect.ALTERED, Effect.REFUSED"),
    ],
    "_tool_rates": [
        ('"nij,nj->ni", by_q, samples.velocity', '"nij,nj->ni", 0 * by_q, samples.velocity'),
    ],
    "expanded": [("if len(xml) > _MAX_BYTES:", "if False:")],
    "_expanded": [
        ("name not in asked.asked", "False"),
        ("mappings=asked", "mappings={}"),
        ("package, path, package_dirs", "package, path"),
        ("document.documentElement.toxml()", "document.toxml()"),
    ],
    "serve": [
        ("os.dup2(_STANDARD_ERROR, _STANDARD_OUTPUT)", "pass"),
        ("redirect_stderr(StringIO())", "redirect_stderr(sys.stderr)"),
    ],
    "_packages_found_by": [
        ("if module is not None", "if False"),
        ("del sys.modules[name]", "pass"),
    ],
    "_place": [("files[-1] != str(path)", "files[-1] == str(path)")],
    "find_package": [
        ("(*declared, *found)", "(*found, *declared)"),
        ("root if root.name == package else", ""),
    ],
    "not_installed": [("-e '.[", "'.["), ("parents[2]", "parents[1]")],
    "differing_parts": [("stated.get(name, value) != value", "stated.get(name) != value")],
    "motion_notes": [("if file.interpolation is None", "if True")],
    "_notes_on_origin": [("not is_other_robot and", "")],
    "part_hashes": [
        ("motion_parts(robot)", "[]"),
        ("limit_parts(robot)", "[]"),
        ("endpoint_parts(problem)", "[]"),
        ('solids_parts("obstacles", problem.obstacles)', "[]"),
        ("problem.clearance,", ""),
    ],
    "PlanningClock.announce": [("*self._parts, ", "")],
    "PlanningClock.within": [("self._parts.pop()", "pass")],
    "joint_columns": [
        ("count > 1", "count > 2"),
        ("time is None or", ""),
        ('_names(joint, "effort")', "[]"),
    ],
    "_found": [("if key in found", "if False")],
    "_meaning": [
        ("and tail != meant[tail][0]", ""),
        ("range(1, len(parts))", "range(2, len(parts))"),
    ],
    "_time": [("name not in taken and", ""), (".lower()", ""), ("_TIME in times or", "")],
    "declare_prefixes": [
        ("or not xml.startswith(tag, begin)", ""),
        ("end = begin + len(tag)", "end = len(tag)"),
    ],
    "_Prefixes.enter": [("| own if own", "if own"), ("not in self._declared[-1]", "not in own")],
    "_Prefixes.leave": [("self._declared.pop()", "pass")],
    "_named_under": [("more > 0", "more >= 0")],
    "unused_values": [("tag == _SOFT and", "False and")],
    "_hard_limit": [('removeprefix("soft_")', 'removeprefix("hard_")')],
    "_is_given": [
        ("return bool(quantity) and", "return not quantity or"),
        ("law.joint == column", "True"),
        ("motors.viscous_friction[column]", "0"),
        ("motors.backwards_friction[column] or", ""),
        ("or motors.forwards_friction[column]", ""),
    ],
    "_unused_friction": [
        ("np.where(given, 0.0, values)", "values"),
        ("if what in unused", "if True", "what is not unused is given or not stated"),
    ],
    "FrictionShare.is_implausible": [("> _IMPLAUSIBLE", "< _IMPLAUSIBLE")],
    "friction_share": [
        ("viscous * velocity + coulomb", "viscous * velocity"),
        ("viscous * velocity + coulomb", "coulomb"),
        ("np.isfinite(limits.velocity) &", ""),
        ("& np.isfinite(limits.effort)", "", "a share of an infinite limit is none"),
        ("() if is_worst.all() else", ""),
        ("if not shares.any()", "if False"),
    ],
    "_friction_note": [
        (
            "np.maximum(motors.backwards_friction, motors.forwards_friction)",
            "motors.forwards_friction",
        ),
        ("or not most.is_implausible", ""),
    ],
    "urdf_friction": [
        ("abs(rule.multiplier)", "rule.multiplier"),
        ("ratio**2 * _stated", "ratio * _stated"),
        ("+= ratio * _stated", "+= _stated"),
    ],
    "_stated": [("0 <= value < np.inf", "value < np.inf"), ("0 <= value < np.inf", "0 <= value")],
    # --- robot/joint_motors, motor_overrides, effort_range ---------------------------------------
    "resolve_motors": [
        ("if merged.friction_from_urdf", "if True"),
        ("below[0], names", "below[1], names"),
        ("[below[1], below[1]]", "[below[0], below[1]]"),
        ('merged_scale(layers).get("effort", 1.0)', "1.0"),
        ("        merged.friction_uncertainty,\n", ""),
        ("        backwards,\n        forwards,", "        forwards,\n        backwards,"),
    ],
    "_require_whole_lines": [("and not known.all()", "and False")],
    "merged_motors": [
        ("for layer in layers][::-1]", "for layer in layers]"),
        ("any(taken[:1])", "any(taken)"),
        ("            _require_motors(where, values, followers)\n", ""),
        ("if one.friction_uncertainty is not None", ""),
    ],
    "chain_order": [("key=lambda name: _depth(description, name)", "key=str")],
    "MotorOverrides.__post_init__": [
        ("0 <= share < 1", "0 <= share <= 1"),
        ("0 <= share < 1", "share < 1"),
        ("isinstance(self.friction_from_urdf, bool | None)", "True"),
    ],
    "_is_amount": [("0 <= value", "0 < value"), ("<= _MAX", "< np.inf")],
    "_require_friction": [("and len(value) == 2", ""), ("not _is_amount(value) and", "")],
    "_require_end_of_curve": [("or value == np.inf", ""), ("_MIN <= value", "0 <= value")],
    "effort_range": [
        (
            "np.array([backwards]), np.array([forwards])",
            "np.array([forwards]), np.array([backwards])",
        ),
    ],
    "require_effort_range": [
        ("or len(given) != 2", ""),
        ("0 < len(position) == len(effort)", "len(position) == len(effort)"),
        ("0 < len(position) == len(effort)", "0 < len(position)"),
        ("np.diff(position) <= 0", "np.diff(position) < 0"),
        ("and np.isfinite(q)", ""),
        ('_require_magnitudes(f"{where} effort", effort)', "None"),
    ],
    "_require_magnitudes": [("_LEAST <= value", "0 <= value"), ("<= _MOST", "<= np.inf")],
    "EffortRange.most": [
        ("max(self.backwards.max(), self.forwards.max())", "self.forwards.max()"),
        ("max(self.backwards.max(), self.forwards.max())", "self.backwards.max()"),
    ],
    "EffortRange.is_constant": [
        ("(self.backwards == self.most).all() and", ""),
        ("and (self.forwards == self.most).all()", ""),
    ],
    "EffortRange.scaled": [("factor * self.backwards", "self.backwards")],
    "EffortRange.slope": [('side="right"', 'side="left"')],
    "EffortRange.side": [("if way > 0", "if way < 0")],
    "_effort_ranges": [("name in given and", "")],
    "resolve_limits": [
        ('one.scaled(merged.scale.get("effort", 1.0))', "one"),
        ("if not one.is_constant", ""),
    ],
    "fitting_presets": [
        ("layer.joint_count != len(joints)", "False"),
        ("or np.nan)", "or given[what][joint.name])"),
    ],
    "BoxRegions._beyond": [
        ("abs(local[..., :2])", "local[..., :2]"),
        ("- length)", "- 0.9 * length)"),
    ],
    # --- robot/limit_layers, limit_overrides, velocity_by_position ------------------------------
    "layers_of": [('LimitLayer("robot.", one)', 'LimitLayer("", one)')],
    "merged_limits": [
        ("chain_order(description, joint_names)", "list(joint_names)"),
        ("if quantity in _FOLLOWED", "if True"),
        ("if not layer.skips_others", "if True"),
        ("_require_known(where, values, known)", "pass"),
        ("for layer in layers][::-1]", "for layer in layers]"),
        ("if limits.tool_speed is not None", "if True"),
        ("for limits in above if limits.point_speed", "for limits in above"),
        ("tuple(note for layer in layers for note in layer.notes)", "()"),
    ],
    "_require_fitting": [("not in (None, len(chain))", "in ()")],
    "_require_some": [("if layer.skips_others else []", "")],
    "values_by_name": [
        ("dict.fromkeys(chain, given)", "{chain[0]: given}"),
        ("len(given) != len(chain)", "len(given) < len(chain)"),
    ],
    "velocity_by_position": [
        ("if value is not None}", "}"),
        ('("offset", 0.0)', '("offset", _LEAST)'),
        ('("offset", 0.0)', '("offset", -_MOST)'),
        ("or lower >= upper", "or lower > upper"),
        ("np.isfinite(end)", "True"),
    ],
    "_laws": [("if given.get(name) is not None", "if name in given")],
    # --- problem/presets, moveit_limits, problem_reader ---------------------------------------
    "read_preset": [
        ("limits, fields.joints, motors", "limits, motors"),
        (", motors=motors", ""),
        ("_require_sources(called, fields)", "pass"),
    ],
    "_require_sources": [
        ("if fields.limits.scale:", "if False:"),
        ('.get(name, "").strip()', '.get(name, "")'),
        ("if name not in given", "if False"),
    ],
    "_given_limits": [
        ("[*given, limits_of(fields.limits)]", "[limits_of(fields.limits), *given]"),
        ("for name in presets]", "for name in presets][::-1]"),
    ],
    "_limits_of_joints": [
        ("abs(deceleration)", "deceleration"),
        ("min(abs(deceleration)", "max(abs(deceleration)"),
        ("(lower, upper)", "(upper, lower)"),
    ],
    "_value": [
        ("None if has is False else value", "value"),
        ("if has and", "if"),
    ],
    "value_text": [
        ('".inf" if value > 0', '".inf" if value < 0'),
        ("return json.dumps(value)", "return str(value)"),
    ],
    "setting_text": [("{quote(", "{str(")],
    "read_limits_file": [("skips_others=True, ", "")],
    # --- problem/field_paths, schema_place; studies/field_sweep -------------------------------
    "changed_fields": [("deepcopy(data)", "data")],
    "_Walk.change": [
        ("else deepcopy(old)", "else old"),
        ("{} if old is None and place.may_be_map", "{} if old is None"),
    ],
    "_Walk._step": [("if below is None and key not in holder", "if False")],
    "_Walk._item": [("if key in names:", "if key in names and key not in numbers:")],
    "_Walk._next": [
        ("max(fitting, key=len)", "min(fitting, key=len)"),
        ("if len(rest) > len(key) else None", "or None"),
    ],
    "_Walk._new": [("if not _has_numbers(old):", "if old is None:")],
    "_scaled": [("if is_number(value) else value", "if value is not None else value")],
    "factor_of": [("_FACTOR.fullmatch(value)", "_FACTOR.match(value)")],
    "SchemaPlace.below": [("field.alias or name: field", "name: field")],
    "sweep_field": [
        (
            "_options(path, given_options(options, PlanOptions))",
            "given_options(options, PlanOptions)",
        )
    ],
    "_options": [("if not is_of_objective(path):", "if True:")],
    "_study": [("posed.changed(changes)", "posed")],
    # --- studies ------------------------------------------------------------------------------
    "swept_rows": [
        ("if executor is None else work", ""),
        ("if not rows:", "if rows:"),
    ],
    "_in_order": [("sorted(rows)", "rows")],
    "Interval.at": [
        ("(1 - share) * self.first + share * self.last", "self.first + share * self.last"),
        ("(self.last / self.first) ** share", "(self.last / self.first) * share"),
        ("int(value) if value.is_integer() else value", "value"),
    ],
    "EvenValues.__getitem__": [("places / (self.length - 1)", "places / self.length")],
    "interval": [
        ("min(begin, end) <= 0", "max(begin, end) <= 0"),
        ("not is_factor and ", ""),
    ],
    "StudyPoints._values": [
        ("self._levels[::-1]:", "self._levels:"),
        ("values[::-1]", "values"),
    ],
    "_latin_shares": [("rng=latin.seed", "rng=0")],
    "Study._require_paths": [("{**first, axis.path: value}", "{axis.path: value}")],
    "_made": [("if name not in defaults:", "if False:")],
    "Journal.add": [
        ("self._file.raw.close()", "pass"),
        ("self._file.flush()", "pass"),
        ("self._file.seek(0, os.SEEK_END)", "self._file.tell()"),
    ],
    "Journal._read": [
        ('not line.endswith(b"\\n") and', ""),
        (" and len(line) < _MAX_LINE", ""),
        ("and _BEGIN.startswith(line[: len(_BEGIN)])", ""),
        ("place += len(line)", "place += len(line) - 1"),
    ],
    "Journal.made": [("(KeyError, ", "("), ("ValueError, ", "")],
    "Journal._key": [("not isinstance(row, dict) or ", "")],
    "require_fields": [
        ("if unknown:", "if False:"),
        ("allow_nan=False", "allow_nan=True"),
        ("strict=True", "strict=False"),
    ],
    "_Run._is_kept": [
        ("self._journal.made(key, _answer_of_study)", "self._journal[key]"),
    ],
    "Journal._lock": [("fcntl.LOCK_EX", "fcntl.LOCK_SH")],
    "planned_answer": [('if result.stopped_by == "interrupt":', "if False:")],
    "_hash_of": [("trajectory.coefficients", "trajectory.breakpoints")],
    "_Run.asked": [
        ("if key in self._waiting:", "if False:"),
        ("elif key in self._answers or self._is_kept(key):", "elif self._is_kept(key):"),
    ],
    "_Run.answered": [("self._note(len(points))", "self._note(1)")],
    "StudyProgress.time_left": [("self.count - self.done", "self.count")],
    "StudyResult.shortest": [("min(durations)", "max(durations)")],
    # --- views/study_figure, study_map, value_scale -------------------------------------------
    "ValueScale.is_logarithmic": [
        ("min(self.places) <= 0", "max(self.places) <= 0"),
        ("ratio and most >= _WIDE * least", "ratio"),
    ],
    "_Ticks.__init__": [('np.argsort(self.scale.places, kind="stable")', "range(len(by_text))")],
    "_draw_line": [("with_shortest=is_of_objective(path)", "with_shortest=True")],
    # --- studies/placement*, movable_problem, leading_seeds, pattern_search; their base and map ---
    "require_base_free": [("required - MARGIN_TOLERANCE", "0.0")],
    "_base_pairs": [
        ("if shapes[j].owner not in stands_on", "if True"),
        ("not in ignored", "is not None"),
        ("if shapes[k].body == _BASE", ""),
    ],
    "_required": [(".max())", ".min())"), ("np.isfinite(own), own", "False, own")],
    "rpy_of_matrix": [
        ("if flat < _UPRIGHT:", "if False:"),
        ("np.arctan2(-matrix[2, 0], flat)", "0"),
    ],
    "Region.nearest": [
        ("max(round(value, _DIGITS), low)", "round(value, _DIGITS)"),
        ("remainder(stand.yaw, 2 * pi)", "stand.yaw"),
    ],
    "Region.grid": [("(k + 0.5)", "k")],
    "Region._counts": [
        ("columns * width / depth", "columns * depth / width"),
        ("(columns if width else 1)", "columns"),
        ("min(_YAWS, count)", "_YAWS"),
    ],
    "MovableProblem.changes": [
        ("[*self.tilt, stand.yaw]", "[0.0, 0.0, stand.yaw]"),
        ("{**self.seeds, **(seeds or {})}", "self.seeds"),
    ],
    "_stand_of": [("base.rpy or rpy_of_matrix(base.placement[:3, :3])", "base.rpy or (0, 0, 0)")],
    "leading_seeds": [
        ("is not None:", "is None:"),
        ("np.argmin(away)", "np.argmax(away)"),
    ],
    "_free": [("if is_free(problem, end, q):", "if True:")],
    "_point": [('end == "start"', "True")],
    "pattern_search": [
        ("0.5**walk.halved", "1.0"),
        ("walk.halved <= halvings", "walk.halved < halvings"),
    ],
    "_step": [("min(tried", "max(tried"), ("(1 - _LEAST_GAIN)", "1")],
    "tried": [
        ("require_base_free(problem, stands_on)", "pass"),
        ("leading_seeds(problem, tuple(movable.seeds))", "{}"),
    ],
    "PlacementRow.of_dict": [
        ("tuple(value) if isinstance(value, list) else value", "value"),
        ('require_fields(cls, {**plain, "stand": [x, y, z, fields["yaw"]]})', "pass"),
    ],
    "grouped": [("-len(pair[1])", "len(pair[1])")],
    "PlacementTrials.rows": [("self._order[row.stand]", "-row.stand.yaw")],
    "PlacementTrials.of": [("if stand not in self._found", "")],
    "PlacementTrials._key": [("', '.join(self._stands_on) or 'nothing'", "''")],
    "Placement.gain": [("1 - after / before", "1 - before / after")],
    "_searched": [("[region.nearest(given)] * region.holds(given)", "region.nearest(given)")],
    "_neighbours": [("share * side / 2, -share", "share * side / 2, share")],
    "_feasible": [("if row.is_feasible", "")],
    "_given": [("require_base_free(problem, stands_on)", "pass")],
    "with_placement": [
        ("_alone(_in_a_row(rows), hidden, BaseFields)", "_in_a_row(rows)"),
        (
            "_alone(_in_a_row(rows), below.get(path), EndpointFields)\n        else",
            "_in_a_row(rows)\n        else",
        ),
        ("_insert(fields, path, _alone(_in_a_row(rows), below.get(path), EndpointFields))", "pass"),
    ],
    "_merit": [("-(row.duration or 0.0)", "row.duration or 0.0"), ("KINDS.index(row.status)", "0")],
    "_outline": [("[:, :2]", "[:, 1:]")],
    "_draw_search": [("if row.stand not in grid", "")],
    "_given_words": [("found.given.message if duration is None else", "")],
    "_best_line": [("'less' if gain >= 0 else 'more'", "'more'")],
    # --- files/problem_file, files/fingerprint ------------------------------------------------
    "_alone": [
        ("if key not in value:", "if False:"),
        ('and below.get("joint_signs")', "and False"),
    ],
    "_has_joints": [('end.get("joints") is not None', "True")],
    "change_own": [("if value == old:", "if False:")],
    "_change_items": [("own.append({", "own.insert(0, {")],
    "_own_part": [("deepcopy(held)", "held")],
    # --- problem/named_endpoint, tool_pose, robot/srdf; branches/pose_configurations ... -------
    "named_endpoint": [
        ('if key != "seed" or "pose" not in given', ""),
        ("if not set(_ALONE) & set(given):", "if not given:"),
    ],
    "_last_configuration": [
        ("trajectory.position(trajectory.duration)", "trajectory.position(0.0)"),
        ("[columns[name] for name in robot.joint_names]", "list(range(robot.joint_count))"),
    ],
    "read_group_state": [("key=lambda k: len(missing[k])", "key=lambda k: k")],
    "ToolPose.errors": [
        ("self.rotation.T @ rotation", "rotation"),
        ("np.trace(turn) - 1", "1.0"),
    ],
    "pose_configurations": [
        ("not is_free(problem, end, q), ", ""),
        ("not _is_held(problem, q), ", ""),
        ("(q - middle)", "(q - q)"),
    ],
    "reaching": [("errors.max(axis=1)", "errors[:, 0]")],
    "middle_of": [("np.clip(0.0, lower, upper)", "0.0")],
    "half_ranges": [("np.isfinite(half)", "np.isnan(half)")],
    "_continuing": [("if is_continued(replace(problem, goal=q)):", "if True:")],
    "_choice": [("if len(found) < 2:", "if len(found) < 1:")],
    # --- problem/path_fields, merged_fields, problem_layers -----------------------------------
    "_is_preset_file": [("and Path(name).suffix in PRESET_ENDINGS", "")],
    "move_paths": [("holder, key, holder[key]", "holder, key, key")],
    "merged_fields": [
        ("**shared", ""),
        ("if is_named(below) and is_named(above):", "if is_named(above):"),
    ],
    "_merged_items": [('and item["name"] not in first', "")],
    "ProblemLayers.source_of": [
        ("self.documents[::-1]", "self.documents"),
        ("_is_same(found, wanted)", "True"),
    ],
    "ProblemLayers.of": [("if len(layers) == _MAX_FILES:", "if False:")],
    "_layers": [("(*chain, resolved)", "(resolved,)")],
    "_value_at": [("and is_named(document)", "and False")],
    "_motor_parts": [
        ("if motors.has_coulomb_friction", "if False"),
        ("motors.backwards_friction, ", ""),
        (", motors.forwards_friction", ""),
        (", motors.no_load_velocity", ""),
        ("motors.saturation_effort, ", ""),
        ("motors.has_friction and", ""),
        ("and motors.friction_uncertainty", "and False"),
    ],
    "_optional_limits": [
        ("one.joint, ", ""),
        ("one.position, ", ""),
        ("one.backwards, ", ""),
        (", one.forwards", ""),
        ("np.isfinite(limits.effort_rate).any()", "False"),
        ("dataclasses.astuple(law)", "law.joint"),
        ("point.position, ", ""),
        ("point.link, ", ""),
    ],
    # --- baselines/path_rows --------------------------------------------------------------------
    "PathRows.tangent": [
        ("self.speed / (2 * root)", "self.speed / root"),
        ("self.allowed - less", "self.allowed"),
        ("square=self.square + square_too, ", ""),
    ],
    "with_reversals": [
        ("away > apart", "away >= 0"),
        ("+ stretches.start * path.widths[stretches.piece]", ""),
    ],
    "path_rows": [
        ("problem.robot.motors, direction", "problem.robot.motors, -direction"),
        ("np.searchsorted(inner, ends)", 'np.searchsorted(inner, ends, "right")'),
        ('np.searchsorted(inner, begins, "right")', "np.searchsorted(inner, begins)"),
    ],
    "_rows": [
        ("np.where(np.isfinite(own), own, asked)", "own"),
        ("rows[:, is_obstacle] += room", "rows += room"),
        ("1 - sign * still", "1.0 + 0 * still"),
        ("sign * speed", "0 * speed"),
        ("sign * acceleration", "acceleration"),
        ("bend + slope", "2 * bend + slope"),
        ("if (used.largest_speed(limit.signs) == 0).any()", "if False"),
    ],
    "_settled": [
        ("abs(after - before) < _SETTLED * after", "True"),
        ("for start in starts if start is not None", "for start in starts"),
        # of planning/kept_back
        ("if rung.survives:", "if False:"),
        ("for _ in range(_ROUNDS):\n        tried", "for _ in range(1):\n        tried"),
        ("now.result.motion, WORKING", "now.result.motion, FEWER"),
        ("best = _better(best, now)", "best = now"),
        ("had_one or (now", "(now"),
        ("now.survives and not _gains(now, now)", "now.survives"),
        ("now.survives and not _gains(now, now)", "False"),
        ("tried is None", "False"),
        ("now.survives and not _gains(now, now)", "now.survives and _gains(now, now)"),
    ],
    "_Limits.__init__": [
        ("each.acceleration + ahead * each.square", "each.acceleration"),
        ("(most / unit) ** 2", "most / unit"),
    ],
    # --- views/motor_panels ---------------------------------------------------------------------
    "motor_joints": [
        ("motors.viscous_friction + ", ""),
        (" | motors.has_curve", ""),
    ],
    "_left_by_the_line": [("for way in (1.0, -1.0)", "for way in (-1.0, 1.0)")],
    "_draw_effort_ranges": [("way * allowed", "allowed")],
    # --- constraints/path_samples: what stands still has no friction ----------------------------
    "PathSamples.direction": [("np.where(moves, rate, 0.0)", "rate")],
    # --- tube/rotational_tube -------------------------------------------------------------------
    "_entries": [
        ("is_triple and segment_count != 3", "is_triple"),
        ("return entries * segment_count", "return entries"),
    ],
    # --- robot/body_inertia ---------------------------------------------------------------------
    "BodyInertia.com_distance": [("np.linalg.norm(self.com)", "abs(self.com).max()")],
    "BodyInertia.moment": [(".max()", ".min()"), ("eigvalsh(self.inertia)", "diag(self.inertia)")],
    "BodyInertia.scaled": [
        ("factor * self.inertia", "self.inertia"),
        ("factor * self.mass", "self.mass"),
    ],
    "BodyInertia.shifted": [("self.com + by", "self.com - by")],
    "BodyInertia.placed": [
        ("rotation @ self.inertia @ rotation.T", "rotation.T @ self.inertia @ rotation"),
        ("origin + rotation @ self.com", "rotation @ (origin + self.com)"),
        ("origin + rotation @ self.com", "origin + self.com"),
    ],
    "BodyInertia.plus": [
        ("part.com - com", "part.com"),
        ("away @ away * np.eye(3) - ", "away @ away * np.eye(3) + "),
        ("for part in (self, other)", "for part in (self,)"),
        ("if mass == 0.0:", "if False:"),
    ],
    # --- problem/robustness ---------------------------------------------------------------------
    "Robustness.__post_init__": [
        ("name, 0.0, most, unit", "name, -most, most, unit"),
        ("_LEAST_PERIOD, _MAX_PERIOD", "0.0, _MAX_PERIOD"),
        ("self.controller not in CONTROLLERS", "False"),
    ],
    "Robustness.enlarged": [
        ("factor * getattr(self, name)", "getattr(self, name)"),
        ("min(factor * getattr(self, name), _MOST[name][0])", "factor * getattr(self, name)"),
        ("in _SPREAD", "in ERRORS"),
        ("in _SPREAD", "in _SPREAD[:-1]"),
        ("replace(self, **larger)", "Robustness(**larger)"),
    ],
    "Robustness._require_between": [
        ("not is_number(value) or ", ""),
        ("not least <= value <= most", "value < least or value > most"),
        ("least <= value <= most", "least <= value"),
        ("least <= value <= most", "least < value < most"),
    ],
    "Robustness.exact": [
        ("(dict.fromkeys(_MOST, 0.0) | fields)", "fields"),
        ("dict.fromkeys(_MOST, 0.0) | fields", "fields | dict.fromkeys(_MOST, 0.0)"),
    ],
    "_MOST": [
        ('"mass": (0.9, "")', '"mass": (1.0, "")'),
        ('"noise": (0.1, "rad or m"),', ""),
        ('"tool": (1.0, "m"),', ""),
    ],
    # --- tube/narrowed_tube ---------------------------------------------------------------------
    "narrowed_tube": [
        ("taken[:, :2]", "taken[:, :1]"),
        ("2 * by[:, None]", "by[:, None]"),
        ("np.where(tube.is_box[:, None], sections - taken, sections)", "sections - taken"),
        ("sections[:, :2].min(axis=1)", "sections[:, :2].max(axis=1)"),
        ("sides / 2", "sides"),
        ("sides / 2, tube.radius - by", "sides / 2, tube.radius"),
        ("radius=tube.radius - by, rotation", "radius=tube.radius, rotation"),
        ("radius=radius, rotation_tolerance=tolerance", "radius=radius"),
        ("turned.tolist()", "by.tolist()"),
    ],
    "_narrowed_bound": [
        ("return bound - by", "return bound"),
        ("x - by, y - by, z - by", "x - by, y - by, z"),
    ],
    # --- problem/tightening ---------------------------------------------------------------------
    "Tightening.only": [
        ("if name in PARTS[:2] else 0.0", "if name in PARTS[:1] else 0.0"),
        ("if name not in parts", "if name in parts"),
    ],
    "Tightening.has": [("bool(value != 1.0)", "bool(value)"), ("np.any(value)", "np.all(value)")],
    "Tightening.of_parts": [
        ('side="right") - 1', 'side="left")'),
        ("tube.parts.numbers[:-1]", "tube.parts.numbers[1:]"),
        ("rotation=self.rotation[joined]", "rotation=self.rotation"),
    ],
    "allowed_tightening": [
        ("_MOST * tube.effective_radius", "tube.effective_radius"),
        ("_MOST * tube.effective_radius", "_MOST * tube.radius"),
        ("_MOST * angle", "angle"),
        ("np.where(np.isfinite(tightest), tightest, 0.0)", "np.minimum(tightest, 1e3)"),
        ("bounds.min(axis=1)", "bounds.max(axis=1)"),
        ("enumerate((0, -1)[: len(ends)])", "enumerate((0, -1)[:1])"),
        ("enumerate((0, -1)[: len(ends)])", "enumerate((0, 0)[: len(ends)])"),
        ("inside[end, segment] - _ROUNDING", "inside[0, segment] - _ROUNDING"),
        ("min(rotation[segment], straight[end, segment] - _ROUNDING)", "rotation[segment]"),
        (
            "limits.upper_position - ends]).min(axis=1)",
            "limits.upper_position - ends]).max(axis=1)",
        ),
        ("radius=radius.clip(min=0)", "radius=radius"),
        ("rotation=rotation.clip(min=0)", "rotation=rotation"),
        ("room - _ROUNDING).clip(min=0)", "room - _ROUNDING)"),
        ("max(min(asked.clearance, spare), 0.0)", "min(asked.clearance, spare)"),
        ("min(asked.clearance, spare)", "asked.clearance"),
    ],
    "tightened_problem": [
        ("farther_apart(kept_back.clearance)", "farther_apart(0.0)"),
        ("kept_back.radius, kept_back.rotation", "kept_back.rotation, kept_back.radius"),
    ],
    "_limited": [
        ("effort=share * limits.effort", "effort=limits.effort"),
        ("each.scaled(share) for", "each for"),
        ("kept_back.velocity * limits.velocity", "share * limits.velocity"),
        ("limits.lower_position + kept_back", "limits.lower_position - kept_back"),
        ("limits.upper_position - kept_back.position[1]", "limits.upper_position"),
        (
            "limits.upper_position - kept_back.position[1]",
            "limits.upper_position - kept_back.position[0]",
        ),
        ("share * motors.saturation_effort", "motors.saturation_effort"),
    ],
    "_spare_distance": [
        (" - asked[:, :count]", ""),
        ("[:, counts]", ""),
        (".min(initial=np.inf)", ".max(initial=-np.inf)"),
    ],
    # --- robot/robot_model, with other limits -----------------------------------------------------
    "RobotModel.with_limits": [
        ("limits=limits, motors=motors", "limits=limits"),
        ("limits=limits, motors=motors", "motors=motors"),
        ("limited = RobotModel.__new__(RobotModel)", "limited = self"),
    ],
    "RobotModel.with_payload": [
        ('{"payload": payload}', "{}"),
        ('{"payload": payload}', '{"payload": payload, "motors": None}'),
        ('{"payload": payload}', '{"payload": payload, "base": None}'),
    ],
    "RobotModel._given": [
        (', "motors", "base")', ', "motors")'),
        (', "motors", "base")', ', "base")'),
    ],
    "RobotModel.in_root_frame": [
        ("self.gravity @ self.base", "self.base"),
        ("[:3, :3]", "[:3, :3].T"),
        ('"base": None, ', ""),
        ("self.base is None", "False"),
    ],
    # --- robot/base_pose, and what stands by it ---------------------------------------------------
    "BasePose.__post_init__": [
        ("not is_point or ", ""),
        ("not (np.abs(self.position) <= _FARTHEST).all()", "False"),
        ("not (np.abs(self.position) <= _FARTHEST).all()", "(np.abs(self.position) > 1e4).any()"),
        ("self.rpy is not None and self.quaternion is not None", "False"),
        ("not are_numbers(self.rpy, 3)", "False"),
        ("not _has_direction(self.quaternion)", "False"),
    ],
    "BasePose.placement": [
        ("placement[:3, 3] = self.position", "pass"),
        ("placement[:3, :3] = matrix_of_rpy", "placement[:3, :3].T[:] = matrix_of_rpy"),
        ("self.quaternion is not None", "False"),
    ],
    "are_numbers": [("len(row) == count and ", ""), ("is_finite(one)", "True")],
    "_has_direction": [("_SHORTEST < length", "_SHORTEST <= 1.0"), (" < _LONGEST", "")],
    "_stand_at": [
        ("if model.parents[joint] == 0:", "if True:"),
        ("if frame.parentJoint == 0:", "if True:"),
        ("if frame.parentJoint == 0:", "if False:"),
        ("pose * model.jointPlacements[joint]", "model.jointPlacements[joint] * pose"),
        ("pose * frame.placement", "frame.placement * pose"),
    ],
    "_standing": [
        ("robot.base is None or robot.link_body[link] != _BASE", "True"),
        ("robot.base is None or robot.link_body[link] != _BASE", "robot.base is None"),
    ],
    "UrdfDescription.root": [("link not in children", "link in children")],
    "RobotModel.moves_as": [
        ("self._model is other._model", "True"),
        ("self._model is other._model", "self is other"),
        ("self._model is other._model", "self.urdf == other.urdf"),
    ],
    # --- collision/collision_scene ----------------------------------------------------------------
    "CollisionScene.is_as": [
        ("same and self.robot.moves_as(other.robot)", "same"),
        ("same and self", "self"),
        ('!= "robot"', '== "obstacles"'),
        ('if f.name != "robot"', ""),
        ("all(getattr", "any(getattr"),
    ],
    # --- cycle ------------------------------------------------------------------------------------
    "Move.ends_openly": [
        ("self.goal is None or ", ""),
        (" or isinstance(self.goal, GoalRegion)", ""),
    ],
    "Event.__post_init__": [
        ("0 <= self.dwell", "0 < self.dwell"),
        ("<= _LONGEST_DWELL", "<= np.inf"),
        ("not is_number(self.dwell) or ", ""),
    ],
    "Attach.__post_init__": [("self.solid.name != self.name", "False")],
    "Leg.first_segments": [("np.cumsum([0, *counts[:-1]])", "np.cumsum(counts)")],
    "Leg.move_of": [
        ('side="right"', 'side="left"'),
        ("segment - self.first_segments[k]", "segment"),
    ],
    "legs_of": [("rests[:-1], strict=True", "rests[1:], strict=True")],
    "_runs": [
        ("k == 0 or ", ""),
        ("not isinstance(steps[k - 1], Move)", "False"),
        ("runs[-1].append(step)", "runs.append([step])"),
    ],
    "_Loads.rest": [
        ("arms = [self._carried_by(move)]", "arms = [move.robot]"),
        ("            self._change(step)\n", ""),
    ],
    "_Loads._change": [("self._payloads.pop(step.name, None)", "self._payloads.clear()")],
    "_Loads._carried_by": [
        ("loads[0] if move.robot.payload is None else", "loads[0] if True else"),
        ("total = total.plus(load)", "total = load"),
        ("if key not in self._arms", "if True"),
    ],
    "_require_joinable": [
        ("not first.ends_openly or ", ""),
        ('getattr(first.goal, "tolerance", 0.0) > 0', "False"),
        ("first.robot is second.robot", "True"),
        ("first.objective == second.objective", "True"),
        ("set(first.ignore_collisions) == set(second.ignore_collisions)", "True"),
        ("first.pair_clearances == second.pair_clearances", "True"),
        ("gap > _SAME_PLACE", "gap > 1e-3"),
        ("gap > _SAME_PLACE", "gap > 0"),
    ],
    "joined_moves": [("goal=move.goal,", ""), ("contacts=_contacts(joined, move),", "")],
    "_contacts": [('(first, "start"), (second, "goal")', '(first, "goal"), (second, "start")')],
    "_joined_tube": [
        ("second.tube.points[1:]])", "second.tube.points])"),
        ("first.tube.numbers[-1] + ", ""),
    ],
    "_clearances": [
        ("has_none and moves[0].clearance == moves[1].clearance", "has_none"),
        ("if np.isfinite(value) else move.clearance", "if True else move.clearance"),
        ("if value is not None:", "if value:"),
        ("given.default, frozenset()", "0.0, frozenset()"),
    ],
    "_rotations": [
        ("for s in (1, -1)", "for s in (1,)"),
        ("apart > _SAME_TURN", "False"),
        ("np.tile(second[:1], (counts[0] + 1, 1))", "np.tile(second[-1:], (counts[0] + 1, 1))"),
        ("np.tile(first[-1:], (counts[1] + 1, 1))", "np.tile(first[:1], (counts[1] + 1, 1))"),
        ("[np.inf] * 3", "[0.1] * 3"),
        ("second[1:]])", "second[:-1]])"),
    ],
    "Cell._with": [
        ("if each is not obstacle", ""),
        ("        solid = replace(solid, touch_links=_touching(solid, robot, q))\n", ""),
        ("handed_over = (*self.handed_over, step.name)", "handed_over = self.handed_over"),
    ],
    "Cell._without": [
        ("not gone or not step.leaves_obstacle", "not gone"),
        ("(*self.obstacles, stands)", "(stands,)"),
        ("(*self.handed_over, step.name)", "self.handed_over"),
    ],
    "_hand_pose": [(" @ robot.link_placement[robot.tool_frame]", "")],
    "_touching": [("< _TOUCHING", "< 10 * _TOUCHING"), ("< _TOUCHING", "< 0")],
    "Cycle.cells": [
        ("            cell = replace(cell, handed_over=())\n", ""),
        ("cell.after(step, leg.robot, q)", "cell.after(step, leg.robot, seams[0])"),
        ("replace(cell, handed_over=())", "cell"),
        ("leg.before.steps", "leg.before.steps[-1:]"),
        ("leg.robot, q)", "leg.robot, seams[0])"),
    ],
    "Cycle._from_anywhere": [("self.start, *[Seed", "Seed(somewhere), *[Seed")],
    "Cycle.called": [("before + 1", "before"), ("before + len(leg.moves)", "len(leg.moves)")],
    "Cycle.rest_at": [("seam == len(self.legs)", "seam == len(self.legs) - 1")],
    "Cycle._problem": [
        ("move.goal if goal is None else goal", "move.goal"),
        ("self._present(move.pair_clearances, cell)", "move.pair_clearances"),
        ("for c in move.contacts if self._is_present(c.links, cell)", "for c in move.contacts"),
        ("if self._is_present(pair, cell)]", "if True]"),
        ("            _ = problem.collision  # built here: its faults are the move's\n", ""),
        ("(*problem.contacts, *contacts)", "problem.contacts"),
        ("self.rest_at(k + 1).handed_over", "self.rest_at(k).handed_over"),
        ("self.rest_at(k + 1).handed_over", "()"),
        ("problem, cell.handed_over,", "problem, (),"),
    ],
    "Cycle._is_present": [("if name in comes_and_goes", "")],
    "require_consistent": [
        ("names.count(name) > 1", "False"),
        ("closed and held.taken", "held.taken"),
        ("closed and held.taken", "False"),
    ],
    "_require_one_arm": [('"joint_names", "tool_frame"', '"joint_names",')],
    "_require_meeting": [
        ("goal.position, goal.tolerance", "goal.position, 0.0"),
        ("away > slack + MARGIN_TOLERANCE", "away > slack + 0.01"),
        ("away > slack + MARGIN_TOLERANCE", "False"),
        ("tool = before.robot.tool_position(goal[None])[0]", "tool = move.tube.points[0]"),
    ],
    "_Held._attach": [
        ("if name in self._carried:", "if False:"),
        ("if name in self._has_shape:", "if False:"),
        ("name in self._standing and step.solid is not None", "False"),
        (" and step.payload is None", ""),
        ("self._standing.discard(name)", "pass"),
    ],
    "_Held._detach": [
        ("if step.name in self._carried:", "if False:"),
        ("self._has_shape.pop(step.name) and step.leaves_obstacle", "step.leaves_obstacle"),
        (" and step.leaves_obstacle", ""),
    ],
    "CycleMotion.__post_init__": [
        ("found != wanted", "len(found) != len(wanted)"),
        ("0 <= begin <= end", "begin <= end"),
        ("0 <= begin <= end", "0 <= begin"),
        (" or (mark.kind == MOVE and begin == end)", ""),
    ],
    "CycleMotion.leg_times": [("k + len(leg.moves)", "k + 1")],
    "CycleMotion.leg_at": [("begin <= time", "begin < time - 0.5")],
    "_Builder.rest": [
        ("and step.dwell >= MIN_DURATION", ""),
    ],
    "_Builder.run": [("self._time + begin", "begin")],
    "_setting": [("step.setting if isinstance(step, Event) else None", "None")],
    "_step_kind": [
        ('"MoveFields" if keys.keys() & MoveFields.model_fields.keys() else None', '"MoveFields"'),
    ],
    "_plain": [("str | bool | int | float | None", "object")],
    "_MoveReader.move": [
        ("*self._ignored(self._data), ", ""),
        ("*self._ignored(own), ", ""),
        (
            'self._robots.setdefault(json.dumps(merged["robot"], default=str), problem.robot)',
            "problem.robot",
        ),
        ("passes_through=fields.pass_through", "passes_through=False"),
    ],
    "_MoveReader._merged": [
        (
            'merged_fields(robot.get("limits") or {}, own.get("limits") or {})',
            'robot.get("limits") or {}',
        ),
        ('merged |= _above(self._data, own, "objective")', ""),
        ("if self.first is not None", "if False"),
    ],
    "_rest_step": [
        ("moves[{k}]: {error}", "{error}"),
        ("Detach(step.detach, step.leave_as_obstacle)", "Detach(step.detach)"),
        ("Event(step.event, step.set, step.dwell)", "Event(step.event, step.set)"),
    ],
    "usual_contacts": [
        ("if frozenset(pair) not in known", ""),
        ("if side in each.ends}", "}"),
        ("problem.start if side == START else goal", "problem.start"),
    ],
    "_near": [
        ("own &= _of_tool(problem)", "pass"),
        ("distances < required)", "distances < 0)"),
        ("(distances < required) &", "True &"),
        ("distances > -_DEEPEST", "True"),
    ],
    # --- trajectory/marks, parts; collision/handed_over -------------------------------------------
    "Mark.as_dict": [("{} if self.setting is None", "{} if not self.setting")],
    "marks_of": [
        ("after.time < mark.time", "after.time <= mark.time"),
        ("after.time < mark.time", "False"),
    ],
    "_mark": [
        ("len(given) != 1 or", "not given or"),
        ("not isinstance(fields[given[0]], str)", "False"),
        ("not time >= 0", "time < 0"),
    ],
    "part_of": [
        ("0 <= begin < end <= trajectory.duration", "begin < end"),
        ("0 <= begin < end <= trajectory.duration", "0 <= begin <= end"),
        ('begin, side="right"', 'begin, side="left"'),
        ('end, side="left"', 'end, side="right"'),
        ("begin - times[first]", "times[first] - begin"),
    ],
    "joined": [("padded[degree - len(part.coefficients) :]", "padded[: len(part.coefficients)]")],
    "_from_later": [("comb(power, lower) * ", "")],
    "taken": [("np.linalg.inv(tool_frame)", "tool_frame")],
    "left": [("_moved(solid, tool_frame)", "_moved(solid, np.linalg.inv(tool_frame))")],
    "_moved": [("placement @ contents.placement", "contents.placement @ placement")],
    # --- robot: payloads, Jacobians of frames; problem: fields as files have them -----------------
    "Payload.plus": [("self._body.plus(other._body)", "other._body")],
    "Payload.__post_init__": [(" * max(1.0, float(np.abs(self.inertia).max()))", "")],
    "frame_jacobian": [("pin.LOCAL_WORLD_ALIGNED", "pin.LOCAL")],
    "ToolChain.joint_table": [
        ("np.flatnonzero(self.carries[tool.parentJoint])", "np.arange(len(joints.planned))"),
        ("joints.multiplier, joints.offset)", "joints.offset, joints.multiplier)"),
    ],
    "ToolChain._jacobians_of_many": [(" * carried[:, None]", "")],
    "BodyChain.line": [("self.axes[bodies - 1]", "self.axes[bodies - 2]")],
    "BodyChain.joint_table": [
        ("[self.position[1:], self.axes, along]", "[self.position[1:], along, self.axes]")
    ],
    "BodyChain._in_parents": [("sine * across", "angle[..., None, None] * across")],
    "native_point_jacobians": [("(*poses, point)", "(poses[0], point, point)")],
    "native_last_poses": [("rotation, position, None", "rotation, rotation, None")],
    "native_solve_positions": [
        ("(position, *joints)", "(position, joints[0], *joints[2:0:-1], joints[3])")
    ],
    "solve_positions": [("found.error, found.rotation_error", "found.rotation_error, found.error")],
    "WantedRotation.repeated": [
        ("np.broadcast_to(components, (count, 3))", "np.ones((count, 3), dtype=bool)")
    ],
    "check_fields": [("source if source_of is None else", "source if True else")],
    "attached_of": [
        ("(fields, directory, folders, field)", "(fields, directory, folders)"),
        ("field = field or", "field ="),
        ("folders, field)", "folders)"),
        ("tuple(fields.touch_links)", "()"),
        (", solid.contents", ""),
    ],
    "_model_at": [("named[0] if named else model", "model")],
    # --- verification/cycle_verification, cycle_certificate ---------------------------------------
    "_judged_leg": [
        ("motion.seams[: k + 2]", "motion.seams[:1] * (k + 1)"),
        ("in_cycle(each.where, begin)", "in_cycle(each.where, 0)"),
        ("if k == 0", "if k == 99"),
        ("replace(problem, start=cycle.start)", "problem"),
        ("in_cycle(each.where, begin)", "in_cycle(each.where, 0.0)"),
        ("begin, end), tolerance)", "begin, end))"),
    ],
    "Leg.in_cycle": [("move = found.name", "pass"), ("begin + where.time", "where.time")],
    "_judged_seams": [
        ('["start", *(leg', '["end", *(leg'),
        ("if cycle.closed", "if True"),
        ("if cycle.closed", "if False"),
        ("times[2 * k + 1]", "times[2 * k]"),
        ("cycle.rest_at(k)", "cycle.rest_at(0)"),
    ],
    "_judged_stay": [
        ("legs[:seam][-1:]", "legs[:0]"),
        ("legs[seam : seam + 1]", "legs[:0]"),
        ("travel[:-1].sum(axis=0)", "0 * travel[-1]"),
        ("if begin < end", "if False"),
        ("if len(travelled) < 2", "if begin == end"),
        ("abs(places - places[0])", "abs(places - places)"),
        ("[:seam][-1:]", "[:seam][:1]"),
        ("travel[:-1].sum(axis=0)", "0 * travel[:-1].sum(axis=0)"),
        ("abs(part.coefficients)", "part.coefficients"),
    ],
    "_judged_dwell": [
        ("end - begin - step.dwell", "end - begin"),
        ("min(spare)", "max(spare)"),
        ("for leg in cycle.legs[:seam])", "for leg in cycle.legs[:0])"),
        ("+ len(leg.moves)", "+ 1"),
    ],
    "_judged_hold": [
        ("rest.arms", "rest.arms[:1]"),
        ("rest.arms", "rest.arms[-1:]"),
        ("margins.argmin()", "margins.argmax()"),
        ("dict.fromkeys(rest.arms)", "dict.fromkeys(rest.arms[:1])"),
        ("dict.fromkeys(rest.arms)", "dict.fromkeys(rest.arms[-1:])"),
        ("np.isinf(margins).all()", "np.isinf(margins).any()"),
    ],
    "_hold_margin": [
        ("np.where(effort > 0,", "np.where(effort < 0,"),
        ("effort_at(q, -1)", "effort_at(q, 1)"),
        ("abs(effort) / allowed", "effort / allowed"),
    ],
    "_judged_gap": [
        ("gap.argmax()", "gap.argmin()"),
        ('"rad" if robot.revolute[joint] else "m"', '"rad"'),
    ],
    "_judged_return": [
        ("motion.seams[-1] - motion.seams[0]", "motion.seams[0] - motion.seams[0]"),
        ("motion.seams[-1] - motion.seams[0]", "0 * motion.seams[0]"),
    ],
    "CycleCertificate.failures": [
        ('f"{move}: start" for move in self.refused', 'f"{move}: start" for move in ()'),
        ("each.holds(self.tolerance)", "each.holds(type(self.tolerance)())"),
        ('[f"{move}: start" for move in self.refused]', "[]"),
        ("not each.holds(self.tolerance)", "each.margin is not None and each.margin < 0"),
    ],
    "_refusal": [('"passed": False', '"passed": True')],
    # --- simulation/shortfall ---------------------------------------------------------------------
    "shown_shortfall": [
        ("run.clearance - run.obstacles.value", "run.obstacles.value - run.clearance"),
        ("run.clearance - run.obstacles.value", "-run.obstacles.value"),
        ("else -run.self_collision", "else run.self_collision"),
        ("float(max(folded))", "float(min(folded))"),
        ("_with_points(problem, _expected_most(tube), runs)", "_expected_most(tube)"),
        ("rotation=_expected_most(rotation)", "rotation=_expected_most(tube)"),
    ],
    "_expected_most": [
        ("np.maximum(given.max(axis=0), expected)", "expected"),
        ("np.maximum(given.max(axis=0), expected)", "given.max(axis=0)"),
        ("given.std(axis=0)", "given.std()"),
        ("given.mean(axis=0) + ", ""),
    ],
    "_with_points": [
        ("k - 1 : k + 1] = np", "k : k + 1] = np"),
        ("np.maximum(lacking[k - 1 : k + 1], most)", "most"),
        ("np.searchsorted(problem.tube.numbers, worst.place.point)", "worst.place.point"),
        ("worst = max(", "worst = min("),
        ("_expected_most([extreme.value for extreme in found])", "found[0].value"),
    ],
    "Shortfall.most": [("np.max(", "np.min(")],
    # --- simulation/simulated_runs ----------------------------------------------------------------
    "simulated_runs": [
        ("errors, draw)", "errors)"),
        ("errors, draw)", "Robustness.exact(), draw)"),
        (
            "(errors.controller, errors.control_period)",
            "(Robustness().controller, errors.control_period)",
        ),
        ("errors.control_period)", "0.002)"),
        ("*controlled, checkpoint)", "*controlled)"),
    ],
    # --- simulation/blamed_errors -----------------------------------------------------------------
    "blamed_errors": [
        ("max(_KINDS", "min(_KINDS"),
        ("_relative(problem, with_all, kind)", "with_all.most(kind)"),
        ("if getattr(errors, name) > 0", ""),
        (
            "getattr(errors, name), shortfall(_without(errors, name))",
            "0.0, shortfall(_without(errors, name))",
        ),
        ("shortfall(_without(errors, name)).most", "shortfall(_without(errors, *present)).most"),
        ("shortfall(_without(errors, *present)).most", "with_all.most"),
        ("with_all.most(kind),\n        without_any", "without_any,\n        without_any"),
        ("key=lambda error: error.short", "key=lambda error: -error.short"),
        ('_UNITS.get(kind, "m")', '"m"'),
    ],
    "_without": [
        ("replace(errors, **none)", "Robustness.exact(**none)"),
        ("dict.fromkeys(names, 0.0)", "dict.fromkeys(names[:1], 0.0)"),
    ],
    "_relative": [
        ("float(rotation.bounds.min())", "float(rotation.bounds.max())"),
        ("/ _MUCH_TRAVEL", ""),
        ("effective_radius.min()", "effective_radius.max()"),
    ],
    "Blame.__str__": [
        ("self.without_any > 0", "self.without_any < 0"),
        ("self.errors[0]", "self.errors[-1]"),
        ("self._shown(most.short)", "self._shown(self.short)"),
    ],
    # --- simulation/survival ----------------------------------------------------------------------
    "Survival.notes": [
        ("return self._blamed", "return ()"),
        ("(costs, *self._blamed)", "(costs,)"),
        ("100 * self.added / self.duration_without", "100 * self.added"),
        ("{1000 * cost:.1f}", "{cost:.1f}"),
        ("if self.verdict_without is not None", "if self.verdict_without is None"),
    ],
    "Survival.seen": [("self.verdict is None", "self.verdict_without is None")],
    "Survival.added": [("sum(self", "max(self")],
    "Survival._blamed": [("if self.reached", "if not self.reached")],
    "Survival.as_dict": [
        ("else self.verdict.as_dict()", "else self.verdict_without.as_dict()"),
        ("dict(self.costs)", "{}"),
    ],
    "_kept": [
        ("100 * value", "100 * (1 - value)"),
        ("np.max(value)", "np.min(value)"),
        ("_UNITS.get(part, 'm')", "'m'"),
        ('part == "clearance"', 'part == "radius"'),
    ],
    # --- planning/tightened_plans -----------------------------------------------------------------
    "TightenedPlans.__init__": [(".enlarged(_ENLARGED)", "")],
    "TightenedPlans.planned": [
        ("if key not in self._known", "if True"),
        ("str(kept_back.as_dict())", '""'),
    ],
    "TightenedPlans._planned": [
        ("(ProblemError, Infeasible)", "ProblemError"),
        ("(ProblemError, Infeasible)", "Infeasible"),
        ("if found.succeeded else None", ""),
        ("replace(found, notes=())", "found"),
        ("self.problem(kept_back)", "self._problem"),
    ],
    "require_not_stopped": [
        ("raise TimeLimitReached", "raise KeyboardInterrupt"),
        ("result.stopped_by is not None", "False"),
    ],
    "TightenedPlans.simulated": [
        ("self.allowed(asked)", "asked"),
        ("_prices(self.problem(kept_back).tube", "_prices(problem.tube"),
        ("getattr(wanted, part) - getattr(kept_back, part)", "getattr(wanted, part)"),
        (" + max(found.self_collision, 0.0)", ""),
        ("max(found.self_collision, 0.0)", "found.self_collision"),
        ("(result.duration or 0.0) + more", "(result.duration or 0.0)"),
        ("(-one.verdict.runs,", "(one.verdict.runs,"),
        ("if tried.survives", "if not tried.survives"),
    ],
    "_with": [
        (
            "getattr(kept_back, part) + getattr(shortfall, part), 0.0",
            "getattr(shortfall, part), 0.0",
        ),
        ("getattr(shortfall, part), 0.0)", "getattr(shortfall, part), -1e3)"),
    ],
    "_lacking": [
        ("getattr(asked, part) - getattr(allowed, part)", "getattr(asked, part)"),
        (" / whole[part]", ""),
        ("return max(", "return min("),
        ("1.0 if rotation is None else rotation.bounds.min(axis=1)", "1.0"),
    ],
    "_prices": [
        ("tube.segment_index(sensitivity.segment)", "sensitivity.segment"),
        ('"rotation" if sensitivity.limit == "rotation" else "radius"', '"radius"'),
        ("-sensitivity.elasticity * (result.duration or 0.0)", "-sensitivity.elasticity"),
        ("-sensitivity.elasticity", "sensitivity.elasticity"),
        ("prices[part][k] += relative", "prices[part][k] = relative"),
        ("relative / sizes[sensitivity.limit][k]", "relative"),
    ],
    "tube_sizes": [
        ("tube.cross_section[:, 0] / 2", "tube.cross_section[:, 0]"),
        ("tube.cross_section[:, 1] / 2", "tube.cross_section[:, 0] / 2"),
        ("bounds.min(axis=1)", "bounds.max(axis=1)"),
    ],
    "TriedPlan.survives": [("self.verdict.failed == 0", "self.verdict.failed < 2")],
    # --- planning/kept_back -----------------------------------------------------------------------
    "surviving_plan": [
        ('plans, rung, "velocity", _VELOCITIES', 'plans, shortest, "velocity", _VELOCITIES'),
        ("_is_bound_by_velocity(rung.result)", "False"),
        ("_is_bound_by_velocity(rung.result)", "True"),
        ("not best.survives or _gains(rung, best)", "not best.survives"),
        ("not best.survives or _gains(rung, best)", "_gains(rung, best)"),
        ("return _written(plans, best, follow)", "return best"),
    ],
    "_with_less_effort": [
        ("if share < rung.kept_back.effort", "if share <= rung.kept_back.effort"),
        ("if share < rung.kept_back.effort", ""),
        ("result is None or (best", "(best"),
        ("best.survives and _is_surely", "_is_surely"),
        ("_is_surely_longer(result, best)", "False", "only slower: what is longer is not taken"),
        (
            "lower.lacking <= 0 and _gains",
            "_gains",
            "only slower: what lacks something does not survive, and so is not taken",
        ),
        ("not best.survives or (lower", "(lower"),
        ("_better(best, _settled(plans, lower))", "_settled(plans, lower)"),
        ("_settled(plans, lower))", "lower)"),
    ],
    "_gains": [("tried.expected > ", "tried.duration > ")],
    "_is_bound_by_velocity": [
        ('one.limit == "velocity" and ', ""),
        ("-one.elasticity > ", "one.elasticity > "),
    ],
    "_best_share": [
        ("range(2, len(shares), 2)", "range(2, 4, 2)"),
        ("range(2, len(shares), 2)", "range(4, len(shares), 4)"),
        ("_rank(found[k]) < _rank(found[best])", "_rank(found[k]) > _rank(found[best])"),
        ("_rank(found[k]) < _rank(found[best])", "found[k].duration < found[best].duration"),
        ("(best - 1, best + 1)", "(best - 1,)"),
        ("(best - 1, best + 1)", "(best + 1,)"),
        ("elif found[best].lacking <= 0", "else"),
        ("elif found[best].lacking <= 0", "elif False", "only slower: what is longer is not taken"),
        ("return found[k]", "return found[best]"),
        ("result is None or", "False or"),
    ],
    "_rank": [("tried.lacking, tried.expected", "tried.expected, tried.lacking")],
    "_is_surely_longer": [
        ("not known.survives and known.lacking > 0", "False"),
        ("(result.duration or np.inf) >= known.expected", "True"),
    ],
    "_written": [
        ("kept_back, result, MANY", "kept_back, result, FEWER"),
        ("best = written if best is settled else", "best ="),
        ("written if best is settled else _better(best, written)", "written"),
        ("if had_one or", "if True or"),
        ("written.survives and not _gains", "False and not _gains"),
        ("or not settled.survives", ""),
        ("kept_back = _next(plans, written)", "pass"),
        ("shortest = again", "pass"),
        ("if again is None:", "if False:"),
        (
            "result = follow(plans.problem(kept_back)",
            "result = follow(plans.problem(settled.kept_back)",
        ),
    ],
    "_next": [
        ("np.where(change > 0, _TAKEN, _GIVEN_BACK)", "_TAKEN"),
        ("np.where(change > 0, _TAKEN, _GIVEN_BACK)", "_GIVEN_BACK"),
        ("return before + more", "return more"),
        ("return plans.allowed(following)", "return following"),
        ("between(now.rotation, wanted.rotation)", "between(now.radius, wanted.radius)"),
        ("between(now.position, wanted.position)", "now.position"),
        ("between(np.array(now.clearance), np.array(wanted.clearance))", "now.clearance"),
    ],
    "_better": [
        ("known.survives and tried.survives", "known.survives or tried.survives"),
        ("return min(known, tried, key=lambda plan: plan.duration)", "return tried"),
        ("return known if known.survives else tried", "return tried"),
        ("plan.verdict.failed / plan.verdict.runs", "plan.verdict.failed"),
        ("plan.verdict.failed / plan.verdict.runs", "-plan.verdict.failed"),
    ],
    # --- planning/robust_plan ---------------------------------------------------------------------
    "robust_plan": [("replace(search.answer(), stopped_by=stopped_by)", "search.answer()")],
    "_of_whole_limits": [
        ("sizes[one.limit][k] / left[one.limit][k]", "left[one.limit][k] / sizes[one.limit][k]"),
        ("larger * one.elasticity", "one.elasticity"),
        ("larger * one.saved", "one.saved"),
        ("-one.saved", "one.saved"),
    ],
    # --- simulation/plant -----------------------------------------------------------------------
    "drawn_plants": [
        ("[draw.seed, run]", "draw.seed"),
        ("[draw.seed, run]", "draw.seed + run"),
        ("[draw.seed, run]", "run"),
    ],
    "_drawn": [
        ("_in_ball(errors.base, random)", "_in_ball(errors.tool, random)"),
        ("int(random.integers(2**63))", "0"),
        ("lag=errors.lag", "lag=errors.delay"),
        ("noise=errors.noise", "noise=2 * errors.noise"),
    ],
    "_drawn_bodies": [
        ("if body == carrier", "if False"),
        (".shifted(by)", ""),
        ("1 + random.uniform(-errors.mass, errors.mass)", "1 + random.uniform(0, errors.mass)"),
        ("1 + random.uniform(-errors.mass", "1 + errors.mass * random.normal() + random.uniform(0"),
        (".plus(payload.scaled(share))", ".plus(payload)"),
        ("payload.scaled(-1.0)", "payload"),
    ],
    "_payload": [("str(error).removeprefix('robot.')", "str(error)")],
    "payload_body": [
        (".placed(robot.link_placement[robot.tool_frame])", ""),
        ("payload.inertia_matrix()", "0 * payload.inertia_matrix()"),
    ],
    "_drawn_motors": [
        ("limits.effort, limits.velocity, out", "limits.velocity, limits.effort, out"),
        ("factor * getattr", "getattr"),
        ("(3, robot.joint_count)", "(3, 1)"),
        ("(3, robot.joint_count)", "(1, robot.joint_count)) * np.ones((3, 1)"),
        ("random.uniform(0.5, 1.0, robot.joint_count)", "random.uniform(0.5, 1.0)"),
        ("random.uniform(0.5, 1.0, robot", "random.uniform(0.0, 1.0, robot"),
        ('drawn["viscous_friction"] + share * slope', "share * slope"),
        (", where=is_limited", ""),
    ],
    "Plant.tool_pose": [
        ("rotation @ self.tool", "self.tool"),
        ("rotation @ self.tool", "rotation.transpose(0, 2, 1) @ self.tool"),
        (" + self.base", ""),
        (" + self.base", " + 2 * self.base"),
        (" + self.base", " + rotation @ self.base"),
        (" + self.base", " - self.base"),
    ],
    "_in_ball": [
        ("random.uniform() ** (1 / 3)", "random.uniform()"),
        ("random.normal(size=3)", "random.uniform(size=3)"),
        (" / np.linalg.norm(direction)", ""),
    ],
    # --- simulation/drives ----------------------------------------------------------------------
    "Drives.__init__": [
        ("round(plant.delay / step)", "int(plant.delay / step)"),
        ("round(plant.delay / step)", "int(np.ceil(plant.delay / step))"),
        ("round(plant.delay / step) for", "round(plants[0].delay / step) for"),
        ("[plant.lag]", "[plants[0].lag]"),
        ("np.exp(-share)", "1 - share"),
        ("(1 - self._left) / share", "self._left"),
        ("np.tile(held,", "np.tile(0 * held,"),
        ("int(self._delay.max()) + 1", "int(self._delay.max())"),
    ],
    "Drives.bounded": [
        ("v / self._motors", "abs(v) / self._motors"),
        ("[1 - slowing, 1 + slowing]", "[1 + slowing, 1 - slowing]"),
        ("effort_at(q, 1.0)", "effort_at(q, -1.0)"),
        ("effort_at(q, -1.0)", "effort_at(0 * q, -1.0)"),
        ("np.where(line, with_line, np.inf)", "with_line"),
        ("abs(asked - given) > ", "asked - given > "),
        ("_ROUNDING * self._limits.effort", "0.0"),
        ("np.clip(asked, least, most)", "np.minimum(asked, most)"),
    ],
    "Drives.become": [("robot.limits, robot.motors", "self._limits, robot.motors")],
    "Drives.stepped": [
        ("len(self._sent) - 1 - self._delay", "self._delay"),
        ("np.arange(len(asked))]", "0]"),
        ("target + behind * self._left", "target"),
        ("target + behind * self._mean_left", "target + behind"),
    ],
    # --- simulation/planned_motion --------------------------------------------------------------
    "planned_motion": [
        ("_held(trajectory, time + period / 2)", "_held(trajectory, time)"),
        ("_held(trajectory, time + period / 2)", "_held(trajectory, time + period)"),
        ("moving = middle.time <= trajectory.duration", "moving = middle.time >= 0"),
        ("middle.time <= trajectory.duration", "middle.time + period < trajectory.duration"),
        ("coulomb_effort(robot, trajectory, middle)", "-coulomb_effort(robot, trajectory, middle)"),
        ("middle.velocity, mean)", "middle.velocity, start.acceleration)"),
        ("time[-1] + period)", "time[-1] + 2 * period)"),
        ("smooth + friction,", "smooth,"),
        ("_inertia(robot, middle)", "_inertia(robot, start)"),
    ],
    "_held": [
        ("np.where(moving, samples.velocity, 0.0)", "samples.velocity"),
        ("np.where(moving, samples.acceleration, 0.0)", "samples.acceleration"),
        ("time < trajectory.duration", "time <= trajectory.duration"),
    ],
    "_inertia": [
        (" - weight[:, :, None]", ""),
        ("np.linalg.inv(mass_matrix)", "1 / mass_matrix"),
        ("1 / np.einsum", "np.einsum"),
        ("np.eye(q.shape[1])", "2 * np.eye(q.shape[1])"),
    ],
    # --- simulation/tracking_controllers --------------------------------------------------------
    "ComputedTorque.effort": [
        ("q + (middle.position[k] - start.position[k])", "q"),
        ("q + (middle.position[k] - start", "q - (middle.position[k] - start"),
        ("v + (middle.velocity[k] - start.velocity[k])", "v"),
        ("v + (middle.velocity[k] - start.velocity[k])", "middle.velocity[k] + 0 * v"),
        ("self._plan.acceleration[k] + ", ""),
        (" + self._plan.friction[k]", ""),
        ("self._plan.acceleration[k]", "self._plan.middle.acceleration[0]"),
    ],
    "FeedforwardPd.effort": [
        ("self._plan.effort[k] + ", ""),
        ("self._plan.effort[k]", "self._plan.effort[k - 1]"),
        ("self._plan.inertia[k] * ", ""),
        ("self._plan.inertia[k]", "self._plan.inertia[0]"),
    ],
    "Pd.effort": [
        ("self._weight + ", ""),
        ("self._plan.inertia[k]", "self._plan.inertia[0]"),
    ],
    "Pd.__init__": [("plan.start.position[:1]", "plan.start.position[-1:]")],
    "_feedback": [
        ("plan.start.position[k] - q", "q - plan.start.position[k]"),
        ("plan.start.position[k]", "plan.middle.position[k]"),
        ("plan.start.velocity[k] - v", "-v"),
        ("plan.start.velocity[k]", "plan.middle.velocity[k]"),
        ("2 * BANDWIDTH * slower", "BANDWIDTH * slower"),
        ("BANDWIDTH**2 * behind", "BANDWIDTH * behind"),
    ],
    # --- simulation/mujoco_model ----------------------------------------------------------------
    "MujocoArm.__init__": [
        ("plant.motors.armature", "0.0"),
        ("= plant.motors.viscous_friction", "= 2 * plant.motors.viscous_friction"),
        ("(forwards + backwards) / 2", "forwards + backwards"),
        ("(forwards - backwards) / 2", "(backwards - forwards) / 2"),
        ("self.model = mujoco, copy.copy(model)", "self.model = mujoco, model"),
        ("mujoco.mj_setConst(self.model, self._data)", "pass"),
        ("[model.joint(name).dofadr[0] for name in joints]", "range(model.nv)"),
    ],
    "MujocoArm.place": [
        ("= q, v", "= q, 0 * v"),
    ],
    "MujocoArm.step": [
        ("effort - self.bias", "effort"),
        ("effort - self.bias", "effort + self.bias"),
    ],
    "ArmsTogether.move": [
        ("effort - self._bias", "effort"),
        ("given[:, :, self._degrees]", "given[:, :, :]"),
        ("self._models[run] for run in runs.tolist()", "self._models[0] for run in runs"),
        ("self._state[runs],", "self._state[: len(runs)],"),
        ("moved[:, -1]", "moved[:, 0]"),
    ],
    "ArmsTogether.position": [("1 + self._degrees", "1 + np.sort(self._degrees)")],
    "ArmsTogether.velocity": [("+ self._degrees]", "+ np.sort(self._degrees)]")],
    "MujocoArm._set_bodies": [
        ("inertia.mass", "1.0"),
        ("= inertia.com", "= 0.0"),
        ("axes[:, 0] *= np.linalg.det(axes)", "pass"),
        ("axes.ravel()", "axes.T.ravel()"),
        ("= moments", "= moments[::-1]"),
    ],
    "require_no_followers": [("robot.body_joints[1:]", "robot.body_joints[:1]")],
    "_kinematic_model": [
        ("bodies[chain.parents[body]]", "bodies[-1]"),
        ("_quaternion(chain.rotation[body])", "_quaternion(chain.rotation[body].T)"),
        ("chain.axes[body - 1]", "chain.axes[0]"),
        ("_FRICTION_STEPS * step", "_FRICTION_STEPS * 100 * step"),
        ("added.ipos, added.iquat = _OBLIQUE", "pass"),
        ("joint.solimp_friction[:2] = _FRICTION_IMPEDANCE", "pass"),
    ],
    "_set_options": [
        ("= step, gravity", "= step, -gravity"),
        ("= step, gravity", "= step / 2, gravity"),
        ("mjtIntegrator.mjINT_RK4", "mjtIntegrator.mjINT_EULER"),
    ],
    # --- simulation/stage -----------------------------------------------------------------------
    "first_instant": [("begin - _SAME_INSTANT", "begin + _SAME_INSTANT")],
    "last_instant": [
        ("end + _SAME_INSTANT", "end - _SAME_INSTANT"),
        (', side="right")) - 1', "))"),
    ],
    # --- simulation/cycle_stages ----------------------------------------------------------------
    "cycle_stages": [
        ("stages[-1].robot is not stage.robot", "True"),
        ("if load not in loaded", "if not loaded"),
        ("share[run] for", "share[0] for"),
    ],
    "_arms": [
        ("if mark.kind != MOVE", ""),
        ("rest.arms[0], payloads", "rest.arms[-1], payloads"),
    ],
    "_after": [
        ("if name != step.name", "if False"),
        ("isinstance(step, Detach)", "step.name in payloads"),
    ],
    "_plain_arm": [("np.max(", "np.min("), ('("effort", "velocity")', '("velocity",)')],
    "_payload_shares": [
        (", number]", "]"),
        (", start=1", ", start=0"),
        ("uniform(-1, 1)", "uniform(0, 1)"),
        ("errors.payload", "errors.mass"),
    ],
    "_carrying": [(".scaled(shares[name])", "")],
    # --- simulation/cycle_execution -------------------------------------------------------------
    "executed_cycle": [
        ("draw or Draw()", "Draw()"),
        ("(errors.controller, errors.control_period)", "(Robustness().controller, 0.001)"),
    ],
    # --- simulation/executed_legs ---------------------------------------------------------------
    "executed_legs": [
        ("last_instant(time, end) + 1", "first_instant(time, end) + 2"),
        ("first_instant(time, begin)", "last_instant(time, begin)"),
        ("motion.cycle.problems(motion.seams)", "3 * [motion.cycle.problem(0, motion.seams)]"),
    ],
    "_spans": [
        ("(ATTACH, DETACH)", "(ATTACH,)"),
        ("min(at, default", "max(at, default"),
        ("max(at, default", "min(at, default"),
    ],
    "_between": [("execution.time[while_it] - begin", "execution.time[while_it]")],
    # --- simulation/handover_errors -------------------------------------------------------------
    "handover_errors": [
        ("last_instant(execution", "1 + last_instant(execution"),
        ("turned[0].T @", ""),
        ("plant.tool_pose(robot, one[None])", "robot.tool_pose(one[None])"),
    ],
    "_angle": [("np.sqrt(8)", "np.sqrt(2)"), ("rotation - rotation.T", "rotation")],
    "HandoverErrors.as_dict": [
        ("values.max()", "values.min()"),
        ("values.argmax()", "values.argmin()"),
        ("np.median(", "np.mean("),
    ],
    # --- simulation/judged_cycle ----------------------------------------------------------------
    "judged_cycle": [
        ("saturated=float(share)", "saturated=_whole(run).saturated"),
        ("list(handover_errors(motion, execution))", "[]"),
    ],
    "_whole": [
        ("min(near, key=_spare", "max(near, key=_spare"),
        ("clearance=nearest.clearance", "clearance=legs[0].clearance"),
    ],
    "_most": [("return max(", "return min(")],
    "_spare": [("- leg.clearance", "")],
    # --- commands/cycle_execution_report --------------------------------------------------------
    "cycle_execution_report": [("for name in names}", "for name in names[:0]}")],
    "cycle_execution_lines": [
        (
            "for names, runs in judged.legs.items()]",
            "for names, runs in [*judged.legs.items()][:2]]",
        ),
        ("for each in judged.handovers]", "for each in judged.handovers[:1]]"),
    ],
    # --- views/figure_files, comparison_plot, cycle_marks; commands/comparison_report -------------
    "figure_file": [("with rc_context(_VECTOR_STYLE)", "with rc_context({})")],
    "require_figure": [("not in FIGURE_ENDINGS", "in FIGURE_ENDINGS")],
    "plot_comparison": [
        ("row.duration or float(", "-(row.duration or 0) or float("),
        ("if row.certified)", "if row.duration)"),
    ],
    "_draw_durations": [("_CERTIFIED if row.certified else _FAILED", "_CERTIFIED")],
    "name_steps": [("max(time, before + _LINE * duration)", "time")],
    "_broken": [("if len(line) <= width", "if True")],
    # --- views/cycle_execution_plot, cycle_executed_paths -----------------------------------------
    "_beyond_clearance": [("band.plan - asked", "band.plan + 10 * asked - 1")],
    "cycle_executed_paths": [
        ("each.runs for each", "abs(each.runs) for each"),
    ],
    "obstacle_band": [("base, more)", "base)")],
    # --- simulation/execution -------------------------------------------------------------------
    "executed_stages": [
        ("np.ceil(", "np.floor("),
        ("trajectory.duration + AFTERWARDS", "trajectory.duration"),
        ("trajectory.reordered(stages[0].robot.joint_names)", "trajectory"),
        ("trajectory.position(time[:1])", "trajectory.position(time[-1:])"),
        ("time[first:stop], control_period)", "time[first:stop], step)"),
        ("time[first:stop]", "time[: stop - first]"),
        ("run.become(stage)", "pass"),
        ("time[:1]), step)", "time[:1]), control_period)"),
        ("<= _MAX_PERIOD", "< np.inf"),
        ("len(stage.plants) == 0", "False"),
    ],
    "_lasting": [("if first < stop", "")],
    "ArmsTogether.become": [
        ("[arm.model for arm in arms], np", "self._models, np"),
        ("np.array([arm.bias for arm in arms])", "self._bias"),
    ],
    "obstacle_distances": [
        ("pairs) - asked", "pairs)"),
        ("others.distance - asked[row, column]", "others.distance"),
        ("boxes - asked[row, column]", "boxes"),
    ],
    "_begun": [("stage.robot.gravity_effort(start)[0]", "0 * start[0]")],
    "_Run.become": [
        ("self._arms.become(mujoco_arms(stage.robot, stage.plants, self._step))", "pass"),
        ("self._drives.become(stage.robot)", "pass"),
    ],
    "_Run.through": [
        ("noise[:, k + 1] - noise[:, k]", "0 * noise[:, k]"),
        ("noise[:, k + 1] - noise[:, k]", "noise[:, k]"),
        ("q + noise[:, k + 1]", "q + noise[:, k]"),
        ("q + noise[:, k + 1]", "q"),
        ("/ (time[1] - time[0])", "/ (time[1] - time[0]) / _STEPS"),
        ("drives.stepped(made.effort[:, k])", "drives.stepped(asked)"),
        ("drives.bounded(asked, q, v)", "drives.bounded(asked, q, 0 * v)"),
        ("< _LOST).all(axis=1)", "< _LOST).any(axis=1)"),
        ("range(_STEPS)", "range(_STEPS - 1)"),
        ("made.position[:, k] = q =", "made.position[:, k - 1] = q ="),
    ],
    "_noise": [
        ("plant.noise_seed", "plants[0].noise_seed"),
        ("plant.noise_seed", "0"),
        ("plant.noise *", "plants[0].noise *"),
        ("size=(instants, joints)", "size=(instants, 1)) * np.ones(joints"),
        ("random.normal(size", "random.uniform(-1, 1, size"),
    ],
    # --- simulation/executed_tube ---------------------------------------------------------------
    "tube_excursions": [
        ("-asked.tube.min(axis=0)", "-asked.tube.max(axis=0)"),
        ("-turned.min(axis=0)", "-asked.tube.min(axis=0)"),
        ("np.full(asked.tube.shape[1], -_FREE)", "np.full(asked.tube.shape[1], _FREE)"),
    ],
    "tube_margins": [
        (
            "np.searchsorted(time, asked.time)",
            'np.searchsorted(time, asked.time, side="right") - 1',
        ),
        ("margin.min(axis=1)", "margin.max(axis=1)"),
        ("np.where(found < _FREE, found, np.inf)", "found"),
        ("least(asked.rotation)", "least(asked.tube)"),
    ],
    "_asked": [
        ("np.minimum(tube.rotation_margin(rotation, tool), _FREE)", "0 * margins[0] + _FREE"),
        (
            "_segments(joined, np.minimum.reduce(own), passing)",
            "_segments(joined, own[0], passing)",
        ),
        ("current[0], turned", "own[0], turned"),
        ("turned = current[2]", "turned = own[2]"),
        ("turned = current[2]", "turned = current[1]"),
    ],
    "_range_margin": [
        ("q[:, None] - lower, upper - q[:, None]", "q[:, None] - upper, lower - q[:, None]"),
        ("inside.min(axis=2)", "inside.max(axis=2)"),
    ],
    "_passing": [("radius[k - 1]", "tube.effective_radius[k]"), ("radius[k - 1]", "radius[0]")],
    "_with_crossings": [
        ("begin / (begin - end)", "begin / (begin + end)"),
        ("begin / (begin - end)", "0.5 + 0 * begin"),
        ("nearer[1:] < 0", "nearer[1:] > 0"),
        ('merged[np.argsort(merged[:, 0], kind="stable")]', "merged"),
    ],
    "_segments": [
        ("np.where(samples.share == 1, 1, 0)", "0"),
        ("margin.argmax(axis=1)", "margin.argmin(axis=1)"),
        ('samples, side="left"', 'samples, side="right"'),
        ('samples, side="right"', 'samples, side="left"'),
        ('problem.tube.visit != "ordered"', "True"),
    ],
    "_while_current": [
        ("segment >= first", "segment > first"),
        ("segment <= last", "segment < last"),
        ("margin, _FREE", "margin, 0.0"),
    ],
    "_worst": [
        ("margin.argmin()", "margin.argmax()"),
        ("problem.tube.segment_number(int(column))", "int(column)"),
        ("-float(margin[sample, column])", "float(margin[sample, column])"),
    ],
    "_worst_passage": [
        ("last >= k - 1", "last >= k"),
        ("last >= k - 1", "last >= 0"),
        ("first <= k)", "first <= k - 1)"),
        ("first <= k)", "first >= 0)"),
        ("np.ones_like(counts)", "counts"),
        ("-np.inf).argmax()", "np.inf).argmin()"),
        ("max(found, key", "min(found, key"),
        ("int(tube.numbers[k])", "k"),
    ],
    # --- simulation/executed_clearance ----------------------------------------------------------
    "least_clearances": [
        ("(rotation, shifted), checker", "(rotation, position), checker"),
        ("(rotation, position), checker", "(rotation, shifted), checker"),
    ],
    "additional_distances": [
        (" -= problem.clearance", " -= 0.0"),
    ],
    "_shifted": [
        ("shifted[:, 1:] += base", "shifted += base"),
        ("shifted[:, 1:] += base", "shifted[:, 1:] -= base"),
    ],
    "_Nearest.measure": [
        ('"pij,pi->pj", frames', '"pij,pj->pi", frames'),
        ("int(row[best]), int(column[best])", "int(row[0]), int(column[0])"),
        ("margin.argmin()", "margin.argmax()"),
    ],
    "_Nearest.undecided": [("self.distance - _ROUNDING", "0.5 * self.distance")],
    "_lowest": [("[bound, columns]", "[-bound, columns]")],
    # --- simulation/judged_runs -----------------------------------------------------------------
    "JudgedRun.broken": [
        ("nearest[name] - extreme.value", "-extreme.value"),
        ("nearest[name] - extreme.value", "extreme.value - nearest[name]"),
        ('"self_collision": 0.0', '"self_collision": self.clearance'),
        ("excess > 0", "excess >= 0"),
        ("for name in KEPT}", "for name in KEPT[:1]}"),
    ],
    "JudgedRun.survives": [("not self.broken", "len(self.broken) < 2")],
    "judged_runs": [
        (
            "np.minimum(execution.time, trajectory.duration)",
            "execution.time / execution.time[-1] * trajectory.duration",
        ),
        ("trajectory.reordered(problem.robot.joint_names)", "trajectory"),
    ],
    "_largest": [("values.argmax()", "values.argmin()"), ("joint_names[joint]", "joint_names[0]")],
    # --- simulation/run_verdict -----------------------------------------------------------------
    "RunVerdict.share": [
        ("(1 - CONFIDENCE) / 2", "1 - CONFIDENCE"),
        ("n - k + 1, tail", "n - k, tail"),
        ("k + 1, n - k, 1 - tail", "k, n - k + 1, 1 - tail"),
        ("if k > 0 else 0.0", "if k > 1 else 0.0"),
        ("k < n else 1.0", "k < n - 1 else 1.0"),
    ],
    "RunVerdict.__str__": [
        ("if self.failed else", "if self.failed > 1 else"),
        ("100 * most:.1f", "most:.1f"),
    ],
    "run_verdict": [
        ("sum(not run.survives for run in runs)", "sum(counts.values())"),
        ("for name in run.broken)", "for name in run.broken[:1])"),
        ("counts[name] for name in KEPT", "counts[name] for name in counts"),
    ],
    # --- simulation/run_summary -----------------------------------------------------------------
    "_QUANTITIES": [
        ('"obstacles": True', '"obstacles": False'),
        ('"self_collision": True', '"self_collision": False'),
        ('"tube": False', '"tube": True'),
        ('"velocity": False', '"velocity": True'),
        ('"rotation": False', '"rotation": True'),
    ],
    "_summary": [
        ("values.argmin() if least else values.argmax()", "values.argmin()"),
        ("float(np.median(values))", "float(np.mean(values))"),
        ("np.median(values)", "np.median(abs(values))"),
        ("asked[run], run,", "asked[0], run,"),
    ],
    # --- robot/configurations, short_repr ---------------------------------------------------------
    "_are_many": [
        ("shape[1] == joint_count", "True"),
        ("and values.shape == shape for", "for"),
    ],
    "_require_shapes": [
        ("if values.shape != shape", "if False"),
        ("shape != (joint_count,) and", ""),
    ],
    "_first": [("values.squeeze(axis)", "values.squeeze(0)")],
    "_brief": [
        ("value.size > _MOST_NUMBERS", "False"),
        ("{len(value)} by name", "1 by name"),
    ],
    "_is_shown": [('and not field.name.startswith("_")', "")],
    # --- robot/joint_info, robot_info, tool_frames, typical_configurations ------------------------
    "_sourced": [
        ('if factor == 1.0 else f"{source} x {factor:g}"', ""),
        ("elif _is_tighter(value, own, factor)", "elif False"),
        ("if source == NOWHERE or", "if"),
    ],
    "_is_tighter": [("value[0] > own[0] or", "")],
    "_has_range": [('joint.type == "prismatic" and endless', "False")],
    "_motor_value": [("backwards if backwards == forwards else", "")],
    "_other_joints": [("if name in followers", "if False")],
    "_missing_masses": [
        ("effort.value is None and not effort.is_missing for", "False for"),
        ("if not arm.inertias[body].mass > 0", "if False"),
    ],
    "_missing_limits": [("if joint.limits[quantity].is_missing", "")],
    "_above_fingers": [
        ("0 < below < total - below", "0 < below"),
        ("len(branches) > 1 and", ""),
    ],
    "_goodness": [("_least_gain(jacobian[:, :3])", "1.0")],
    "typical_configurations": [
        ("arm.in_root_frame()", "arm"),
        ("np.argsort(-_goodness(arm, q)", "np.argsort(_goodness(arm, q)"),
    ],
    # --- problem/solid_fields, problem_faults -----------------------------------------------------
    "obstacle_of": [
        ("field = field or", "field ="),
        ("len(given) != 1", "not given"),
        ("fields.scale != 1.0", "False"),
        ("placement, fields.scale", "placement"),
        ("fields.position, fields.rpy", "fields.position, None"),
        ("fields.rpy, fields.quaternion", "fields.rpy, None"),
        ('directory / "the problem file"', 'Path("the problem file")'),
        ("except RobotError", "except KeyError"),
    ],
    "first_fault": [
        ('_model_at(root, fault["loc"][:-1])', "root"),
        ("1 + max(", "max("),
        ('or fault["loc"][-1:] == ("[key]",)', ""),
    ],
    "_deepest": [("max(error", "min(error")],
    "_wanted": [("if keys else", "if False else"), ('.replace("input should be"', '.replace(""')],
    "_word": [("key.isprintable() and ", ""), (" and len(key) <= MAX_SHOWN", "")],
    "_keys": [("field.alias or name", "name")],
    # --- cycle/open_ends, cycle -------------------------------------------------------------------
    "ending_for": [
        ("not move.ends_openly or", ""),
        ("or after.tube.rotation is None", ""),
        ("if not isinstance(goal, GoalRegion)", "if True"),
        ("move.tube, move.goal", "move.tube, None"),
        ("turned[:1]", "turned[-1:]"),
        ("for s in (1, -1)", "for s in (1,)"),
        ("orientations[-1] - s", "orientations[0] - s"),
        ("if goal.rotation_tolerance is None", "if True"),
        ("=bounds[0]", "=bounds[-1]"),
    ],
    # --- verification/cycle_verification, cycle_certificate ---------------------------------------
    "verify_cycle": [('given_options(tolerance, Tolerance, "the tolerance is")', "Tolerance()")],
    "CycleCertificate.describe": [
        ("if where in self.refused", "if False"),
        ("if condition.unit == RELATIVE", "if False"),
    ],
    "CycleCertificate.as_dict": [
        (", **{name: _refusal(why) for name, why in self.refused.items()}", "")
    ],
    # --- cycles in files and on the command line -----------------------------------------------
    "_is_of": [("key in document or ", "")],
    "require_problem": [("is_cycle(document)", "False"), ("is_study(document)", "False")],
    "require_study": [("not is_study(document)", "False")],
    "load_problem_or_cycle": [("if is_cycle_file(name, directory) else load_problem", "")],
    "step_text": [("if step.dwell else", "if False else"), ("shown(step.setting)", "step.setting")],
    "_require_dwells": [
        ("not is_multiple(step.dwell, period)", "False"),
        ("(floor, ceil)", "(floor, floor)"),
    ],
    "_marks": [("marks[-1].time > duration + _DURATION_TOLERANCE", "False")],
    "cycle_hash": [("*_step_parts(cycle), ", "")],
    "cycle_part_hashes": [("_STEPS: hash_of(_step_parts(cycle), _PART_DIGITS)", "")],
    "differing_cycle_parts": [("if len(names) == len(cycle.legs) else names", "")],
    "_step_parts": [
        ("step.dwell", "0"),
        ('"closed" if cycle.closed else', ""),
    ],
    "notes_on_cycle_file": [
        ("not is_other_robot and ", ""),
        ("(None, cycle_hash(cycle))", "(cycle_hash(cycle),)"),
    ],
    "CycleSamples.notes": [("if not np.allclose", "if np.allclose")],
    "CycleSamples.begins": [("time += cycle.rest_at(k).duration", "pass")],
    "CycleSamples.whole": [("each[:-1] for each", "each for each"), ("begin + samples", "samples")],
    "CycleSamples._parts": [
        ("cycle.legs[k].robot", "cycle.robot"),
        ("yield from self._dwells(cycle.after, seams[-1])", "pass"),
        (".before, seams[k]", ".before, seams[0]"),
    ],
    "CycleSamples._dwells": [("rest.arms[1:]", "rest.arms[-1:] * len(rest.steps)")],
    "_ros_documents": [
        ("if k == last", "if False"),
        ('"---\\n".join', '"".join'),
        ("leg.before)", "cycle.after)"),
    ],
    "cycle_contents": [("marks=marks, ", "")],
    "CycleCertificate.place": [("if where in self.refused", "if False")],
    "CheckedCycle.message": [
        ('told.setdefault(reason.partition(": ")[2], reason)', "told[reason] = reason")
    ],
    "_dearest": [("key=lambda each: each.saved", "key=lambda each: -each.saved")],
    "_gain_lines": [("alone - shortest > _LEAST_GAIN", "True"), ("if each.saved > 0", "")],
    "_told": [("return failing or [min(", "return [min("), ("[min(", "[max(")],
    "_timetable": [
        ("begin, end = motion.move_times[move.name]", "begin, _ = motion.move_times[move.name]")
    ],
    "_goal": [("if closes else", "if False else")],
    # --- tube_sources/starter_route, starter_problem, placeholder_limits, files/starter_file ------
    "starter_routes": [
        ("rise + 2 * along, 2 * along", "rise + 2 * along, rise + 4 * along"),
        ("for along in (over, -over)", "for along in (over, over)"),
        ("if free.shape[1] == 3 else _DIGITS_ON_A_SURFACE", ""),
    ],
    "_nearest": [("if size > _STRAIGHT else basis[:, 0]", "if size > 1 else basis[:, 0]")],
    "_in_steps": [("moved[2:, strongest[-1]]", "moved[2:, strongest[0]]")],
    "placeholder_limits": [
        ("if weightless", "if False"),
        ("inertia.mass > 0 for inertia in arm.inertias[1:]", "inertia.mass > 0 for inertia in ()"),
    ],
    "_starts": [("if is_held and", "if"), ("first[row.stand[:3]] is not row", "0")],
    "_path_from": [("folder.resolve()", "Path().resolve()")],
    "contact_notes": [
        ("if depth > _DEEP", "if depth > 1.0"),
        ("times[end == START]", "0.0"),
        ("depth > _DEEP", "depth > -_DEEP"),
        ("(end, frozenset(contact.links))", "frozenset(contact.links)"),
    ],
    # --- cycle_planning ---------------------------------------------------------------------------
    "shared_plan": [
        ("not cycle.closed or isinstance(cycle.start, Seed)", "True"),
        ("_total(plans) < _total(greedy)", "_total(plans) > _total(greedy)"),
        ("motion if opens else replace(motion, problem=problem.joined)", "motion"),
    ],
    "_goals": [
        ("leg.joined.goal if opens else plan.end", "leg.joined.goal"),
        ("cycle.closed and is_open[-1]", "False"),
    ],
    "_presses": [("is_open and not is_free", "is_open and is_free")],
    "_tied": [("is_closed=closed and all(is_open)", "is_closed=False")],
    "_chains": [
        ("k + 1 for k in range(count)", "k for k in range(count)"),
        ("if not is_open[k]:\n            chains", "if is_open[k]:\n            chains"),
    ],
    "greedy_plan": [
        ("seams[-1] = plans[-2].end", "pass"),
        ("not cycle.legs[k - 1].joined.ends_openly", "cycle.legs[k - 1].joined.ends_openly"),
    ],
    "leg_problem": [("cycle.closed and k ==", "cycle.closed and k !=")],
    "planned_leg": [
        ("PlanningClock(limit, clock.announce)", "PlanningClock(None, clock.announce)"),
        (" and left > 1", " and left > 9"),
    ],
    "first_configuration": [("leg, given, point = last, goal, -1", "pass")],
    "cycle_sensitivities": [
        ("saved.get(key, 0.0) + each.saved", "each.saved"),
        ("-each.saved", "each.saved"),
    ],
    "CycleResult.shortest_duration": [("self.duration - sum(spared)", "self.duration")],
    "plan_cycle": [
        ("shares_configurations and stopped_by is None", "stopped_by is None"),
    ],
    "leg_motion": [("leg.first_segments[1:]", "leg.first_segments[:-1]")],
    # --- resources: problems and cycles -----------------------------------------------------------
    "_bundled_of": [(" if _kind(path) == kind", "")],
    "_kind": [('"problem" if found is None else found[1]', '"problem"')],
    "_as_yaml": [("value.lower() in _WORDS or", "")],
    # --- views/moved_parts, cycle_timeline, cycle_scene, cycle_panel, cycle_curves, cycle_plot ----
    "MovedPart.carry": [("tool[first:] @ grip", "tool[first:]")],
    "MovedPart.put_down": [
        ("= self.poses[first]", "= np.eye(4)"),
        ("= stays", "= True"),
    ],
    "MovedPart.seen_at": [("None if self.present[step] else 0", "None")],
    "moved_parts": [
        ("if obstacle.name in handed_over", ""),
        ("if not step.leaves_obstacle:", "if True:"),
    ],
    "_new_part": [
        ("part.poses[:] = tool[first]", "pass"),
        ("part.present[:first] = False", "pass"),
    ],
    "_stops": [
        (
            "ends = [run[0][1].time for run in runs[1:]]",
            "ends = [run[-1][1].time for run in runs[1:]]",
        ),
    ],
    "_rooms": [
        ("sum(pair) / 2", "pair[1]"),
        ("min(middle", "max(middle"),
        ("k == 0 and ", ""),
        ("k == len(middles) - 1 and ", ""),
        ("pairwise(middles)), duration]", "pairwise(middles)), middles[-1]]"),
    ],
    "_shown": [
        ("*(mark.time for mark in motion.marks), ", ""),
        ("min(max(_FRAMES_PER_SECOND, fewest), most)", "_FRAMES_PER_SECOND"),
    ],
    "with_bodies": [
        ("body.poses[:, None, :3, 3] for body", "0 * body.poses[:, None, :3, 3] for body"),
        ("**present}", "}"),
    ],
    # --- views/stretch, page_curves, problem_timeline, orientation_items --------------------------
    "Stretch.inside": [("time >= self.begin", "time >= 0")],
    "_counted": [("use.kind != POSITION", "True")],
    "_largest_near": [("np.maximum.at(found, rows, share)", "pass")],
    "_speed_limit": [("segment = stretch.uses.segment[", "segment = 0 * stretch.uses.segment[")],
    "_Closest.as_dict": [
        ("self._distance[apart] - self._margin[apart]", "self._margin[apart]"),
        ("if with_points else fields", "if True else fields"),
    ],
    "segment_bands": [("stretch.uses.segment // step", "stretch.uses.segment // 1")],
    "binding_marks": [
        ("round(stretch.begin + span.begin, 5)", "round(span.begin, 5)"),
        ("        if own\n", ""),
    ],
    "turned_tool": [("if not stretches:", "if stretches:")],
    "rotation_cones": [
        ("= reference[holds]", "= np.eye(3)"),
        ("= tool[holds]", "= 0.0"),
        ("cone.present[rows[holds]] = True", "pass"),
    ],
    "cone_axis": [
        ("if len(largest) == 1 else 2", ""),
        ("np.delete(bounds[:3], axis).max()", "np.delete(bounds[:3], axis).min()"),
    ],
    "cone_rim": [
        ("bounds[:3][[axis - 2, axis - 1]]", "bounds[[axis - 2, axis - 1]]"),
        ("np.linspace(-1, 1, _TRIED_TURNS)", "np.zeros(_TRIED_TURNS)"),
    ],
    "_Drawing.__init__": [("if each.name not in handed_over", "")],
    "_move_entries": [("if len(scene.motions) == 1 else {}", "")],
    "_sizes": [('if low == high else f"{low} to {high} mm"', "")],
    "_trajectory_data": [
        ("np.interp(even, trajectory.time, trajectory.speed)", "trajectory.speed")
    ],
    "_later": [("curves.samples.time + begin", "curves.samples.time")],
    "_rest_curves": [
        ("rest.arms[1:]", "rest.arms[:1] * len(rest.steps)"),
        ("len(leg.before.steps) + len(leg.moves)", "len(leg.before.steps) + 1"),
        ("if seam == len(cycle.legs)", "if False"),
        ("if end > begin:", "if True:"),
    ],
    "_held_curves": [
        ("[[sample, sample]]", "[[0, 0]]"),
        ("arm.gravity_effort(given.position[rows])", "beside.effort[rows]"),
    ],
    "_draw_runs": [("max(high for _, high in seen)", "min(high for _, high in seen)")],
    "_once": [('"_" if label in', '"_" if "" in')],
    "motion_of_file": [("if not file.marks:", "if False:"), ("{path}: {error}", "{error}")],
    "cycle_motion_notes": [("if failures else", "if False else")],
    "content_hash": [("asdict(options), ", "")],
    "document_hash": [('robot.pop("package_dirs", [])', 'robot.get("package_dirs", [])')],
    "package_hash": [("{**sources, **bundled_presets()}", "sources")],
    "_Files.content": [('if kind == "urdf":', "if False:")],
    "_Files._link_mesh": [("_file_hash(find_mesh(name, urdf, self._package_dirs))", "name")],
    "_stamp": [("status.st_mtime_ns, ", "0, ")],
    "Parcel.unpacked": [
        ("_known.pop(self.scene_hash, None) or ", ""),
        ("[:-_KEPT]", "[:]"),
    ],
    "Packer.pack": [("if known is None:", "if True:")],
    "_Pickler.persistent_id": [("_ROBOT if thing is self._scene.robot else None", "None")],
    "PosedProblem.changed": [
        ("CycleFields if is_cycle(self.document) else ProblemFields", "ProblemFields")
    ],
    "PosedProblem.load": [("like=like", "like=None")],
    "PosedProblem._cell_hash": [("for key in _CELL if", "for key in _CELL[:1] if")],
    "plan_either": [("isinstance(problem, Cycle)", "False")],
    "_packed": [("str(Path(problem).absolute())", "str(problem)")],
    "_loaded": [
        ("isinstance(packed, Parcel)", "False"),
        ('("", "0")', '("",)'),
        ("if not is_current:", "if False:"),
        (' and not os.environ.get("TUBEPLANNER_BASELINE")', ""),
        ("library.tubeplanner_runs_v3() and", "False and"),
    ],
    "PlannedItem.status": [("PlanStatus.CRASHED if self.crashed else ", "")],
    "run_many": [
        ("finished.empty() and ", ""),
        ("len(waiting) < _SUBMITTED", "True"),
        ("future.cancel()", "pass"),
    ],
    "_submitted": [("except BrokenExecutor", "except ZeroDivisionError")],
    "_of_future": [("(BrokenExecutor, CancelledError)", "BrokenExecutor")],
    "_travelling": [("error.add_note", "str")],
    "_same_kind": [("type(copy) is not type(error)", "False")],
    "WorkerProcesses.submit": [("len(self._threads) < self.count", "not self._threads")],
    "WorkerProcesses._answered": [
        ("self._floor.with_others, self._floor.alone", "self._floor.with_others,"),
        ("self._floor.with_others, self._floor.alone", "self._floor.with_others, " * 2),
    ],
    "_Worker.__init__": [(', **dict.fromkeys(_THREADS, "1")', "")],
    "dask_executor": [('client.status != "running"', "False")],
    "_executor_of": [("pure=False", "pure=True")],
    "_wrong": [
        ("sources != package_hash()", "False"),
        ('linear_algebra != "1"', "False"),
        ("threads > 1", "False"),
    ],
    "ClearanceBounds.at": [("self._required, settings", "0 * self._required, settings")],
    "ClearanceBounds._bounds": [
        ("boxes - required[pair]", "boxes"),
        ("near + required[k])", "near)"),
        ("apart - required[k]", "apart"),
        ("bound[bound >= near] = np.inf", "pass"),
    ],
    "_separations": [
        ("return apart - grown", "return apart"),
        ("enough=enough + grown", "enough=0"),
    ],
    "moved_tools": [
        ("(off[0] > close[0]) | (off[1] > close[1])", "off[0] > close[0]"),
        ("unsettled = (off[0]", "unsettled = (2 * off[0]"),
        ("live = live[~still]", "pass"),
    ],
    "_stepped": [("np.where(outward[:, None], 0.0, jacobian)", "jacobian")],
    # --- explanation; commands/explain_command, explanation_report -----------------------------
    "Question.of": [("if fields.tube is None:", "if False:")],
    "Question.points": [('self.given_tube["points"]', "self.fields.tube.points")],
    "Question.per_segment": [(" * self.segment_count", "")],
    "rounded": [("{FIGURES}g", "{FIGURES - 1}g")],
    "from_to": [("max(map(abs, both))", "max(both)"), ("_SHOWN", "FIGURES")],
    "radius_changes": [("0.99 * radius", "radius"), ("_MOST_TIMES * radius if", "radius if")],
    "_radius_path": [("> 1", "> 9")],
    "_radii_given": [
        ("len(set(radii)) == 1", "True"),
        ('{f"tube.{key}": value for key, value in points.items()} | changes', "changes"),
    ],
    "_all_radii_by": [("1 + share", "share")],
    "_box": [("if k != segment", "if k == segment"), ("/ min(before)", "/ max(before)")],
    "_rotation_tolerances": [("and count != 3 and", "and")],
    "_rotation": [("np.maximum(", "np.minimum(")],
    "_tool_radius": [("max(exact(before - size), 0.0)", "exact(before - size)")],
    "_points": [("base - point", "point - base")],
    "_sign_change": [("if joint in signs else dict(signs)", "")],
    "_pass_through": [(" and question.segment_count > 1", "")],
    "effort_changes": [("exact(limit / factor)", "limit"), ("0.99 * before", "before")],
    "_scaled_effort": [("[exact(factor * value) for value in given]", "list(given)")],
    "_limit_of": [("if name == joint else others[name]", "")],
    "_limits_by_name": [("exact(value / factor)", "value")],
    "_range": [("way * size", "size")],
    "payload_changes": [("0.999 * before", "1.1 * before")],
    "_clearance": [("max(exact(before + way * size), 0.0)", "exact(before + way * size)")],
    "_turned": [("after[k] + way * size", "after[k] + size")],
    "_goal_tolerance": [("before or _TENTH", "_TENTH")],
    "_duration": [("exact(before + size)", "exact(size)")],
    "in_order": [
        ("or not change.about", ""),
        ("or change.kind in _EVERYWHERE", ""),
        ("key=lambda change: rank", "key=lambda change: -rank"),
    ],
    "_named": [('f"segment {place.point - 1}", ', ""), ("place.links or ()", "()")],
    "Trials.__init__": [
        ("options if is_timed else options.shortest", "options.shortest"),
        ("options if is_timed else options.shortest", "options"),
        ("max(_LEAST_TIME, _LARGEST_SHARE * clock.remaining)", "_LEAST_TIME"),
        ("max(_LEAST_TIME, ", "min(_LEAST_TIME, "),
    ],
    "Trials.of": [
        ("if answer.is_cut_short:", "if False:"),
        ("proposals[done.index]", "proposals[0]"),
    ],
    "planned": [
        ("if left <= 0:", "if False:"),
        (" and not result.succeeded", ""),
        ('result.stopped_by == "interrupt"', "False"),
    ],
    "SizeBracket.possible": [("if self.helps", "if not self.helps")],
    "SizeBracket.is_close": [
        ("CLOSE * smaller", "2 * smaller"),
        ("self.smaller is None or self.larger is None", "self.larger is None"),
    ],
    "SizeBracket.is_done": [
        ("self.larger.size <= least", "False"),
        ("rounded(self.change.most)", "self.change.most"),
        (" and (self.smaller or self.larger)", ""),
    ],
    "SizeBracket.keep": [("trial.succeeded == self.helps", "trial.succeeded")],
    "_middle": [("** 0.5", "** 0.5 * 2")],
    "SizeBracket.next_size": [
        ("self.larger.size / _STEP", "self.larger.size / 2"),
    ],
    "try_sizes": [("asked[place][0]", "asked[0][0]")],
    "Remedy.as_dict": [("json_value({**first, **fields})", "{**first, **fields}")],
    "Room.as_dict": [("json_value({**first, **fields})", "{**first, **fields}")],
    "RemedySearch.run": [("if not self._helpful:", "if True:")],
    "RemedySearch.remedies": [
        ("sorted(self._helpful, key=lambda bracket: bracket.cost)", "self._helpful")
    ],
    "RemedySearch.in_vain": [
        ("and one.is_done", ""),
        ("if field not in helpful", ""),
    ],
    "RemedySearch._search": [('(1.0, float("inf"))', "(1.0,)")],
    "_is_new": [("if bracket.larger is not None:", "if False:")],
    "_remedy": [("is_smallest=bracket.is_done", "is_smallest=True")],
    "worsening_changes": [("payload_changes(question, 1)", "payload_changes(question, -1)")],
    "RoomSearch.rooms": [("sorted(known, key=lambda bracket: bracket.cost)", "known")],
    "Explanation.succeeded": [("self.is_possible or bool(self.remedies)", "self.is_possible")],
    "Explanation.status": [("PlanStatus.BAD_INPUT", "PlanStatus.UNREACHABLE")],
    "Explanation.as_dict": [('"where": self.place.as_dict()', '"where": None')],
    "explain": [
        (".changed(changes)", ""),
        ("PlanOptions), time_limit=time_limit)", "PlanOptions), time_limit=None)"),
        ("BAD_INPUT if found.problem is None else INFEASIBLE", "INFEASIBLE"),
    ],
    "_with_remedies": [("in_vain=search.in_vain,", ""), ("stopped_by=stopped_by,", "")],
    "tried_text": [("if is_close", "if True")],
    "Unposed.of": [('removeprefix(f"{question.posed.name}: ")', "strip()")],
    "_room_lines": [("if each.saved > 0", "")],
    # --- native/build, library; commands/version_option -------------------------------------------
    "compiler": [
        ('if wanted == "none":', "if False:"),
        ('environment.get("CXX")', "None"),
    ],
    "source_key": [('(".cpp", ".h")', '(".cpp",)'), (" + path.read_bytes()", "")],
    "_processor": [("level.replace('-', '_')", "level"), ('_kind(command) == "zig"', "False")],
    "_say_version": [("{LIBRARY.build}", "native")],
    # --- bounds of what is read -------------------------------------------------------------------
    "_is_formula": [
        (".lstrip()", ""),
        ("return True", "return False"),
    ],
    "files_beside": [("if found.exists():", "if False:")],
    "mesh_bytes": [("_MAX_BYTES", "10 * _MAX_BYTES")],
    "_first_of_equal": [
        ("faces.argmin(axis=1)[:, None]", "0 * rows"),
        ("turned, axis=0", "rows, axis=0"),
    ],
    "_require_few_links": [("count > _MAX_LINKS", "False")],
    "_with_comments": [("YAMLError, ", "")],
}

MUTANTS = tuple(Mutant(where, *change) for where, changes in _CHANGES.items() for change in changes)
