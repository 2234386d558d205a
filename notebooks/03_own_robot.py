# ---
# jupyter:
#   jupytext:
#     formats: py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # Your own robot
#
# From a URDF to a first plan, with the mistake of most URDFs: a missing limit. The arm here is
# invented: a rotating column, a shoulder and an elbow. It lifts parts over a fence.
#
# The notebook takes about half a minute.

# %%
# %matplotlib inline
from pathlib import Path
from tempfile import mkdtemp

from tubeplanner import RobotError, parse_problem, plan, plot_trajectory

folder = Path(mkdtemp())

# %% [markdown]
# ## The URDF
#
# tubeplanner reads masses, inertias, joint limits and collision shapes. The tool frame needs no
# mass. In your own file, look at `<limit>`: many exports leave it out or fill it with zeros.

# %%


def link(name, mass, size, middle):
    """Return the URDF of a link: a solid box with a mass [kg], a size and a middle [m]."""
    x, y, z = size
    inertia = [mass / 12 * (b * b + c * c) for b, c in ((y, z), (x, z), (x, y))]
    at = " ".join(map(str, middle))
    return f"""
  <link name="{name}">
    <inertial>
      <origin xyz="{at}"/> <mass value="{mass}"/>
      <inertia ixx="{inertia[0]:.5f}" iyy="{inertia[1]:.5f}" izz="{inertia[2]:.5f}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <collision> <origin xyz="{at}"/> <geometry><box size="{x} {y} {z}"/></geometry> </collision>
  </link>"""


def joint(name, parent, child, origin, axis, limit):
    """Return the URDF of a revolute joint."""
    return f"""
  <joint name="{name}" type="revolute">
    <parent link="{parent}"/> <child link="{child}"/>
    <origin xyz="{origin}"/> <axis xyz="{axis}"/>
    <limit {limit}/>
  </joint>"""


def lifter(elbow_limit):
    """Return the URDF of the arm."""
    parts = [
        '<robot name="lifter">',
        link("base", 20, (0.3, 0.3, 0.1), (0, 0, 0.05)),
        joint(
            "column",
            "base",
            "post",
            "0 0 0.1",
            "0 0 1",
            'lower="-2.9" upper="2.9" effort="80" velocity="3"',
        ),
        link("post", 8, (0.12, 0.12, 0.3), (0, 0, 0.15)),
        joint(
            "shoulder",
            "post",
            "upper",
            "0 0 0.3",
            "0 1 0",
            'lower="-2" upper="2" effort="120" velocity="2.5"',
        ),
        link("upper", 6, (0.08, 0.08, 0.36), (0, 0, 0.2)),
        joint("elbow", "upper", "fore", "0 0 0.4", "0 1 0", elbow_limit),
        link("fore", 3, (0.06, 0.06, 0.32), (0, 0, 0.22)),
        '<link name="gripper"/><joint name="mount" type="fixed">',
        '<parent link="fore"/><child link="gripper"/><origin xyz="0 0 0.4"/></joint>',
        "</robot>",
    ]
    return "\n".join(parts)


# %% [markdown]
# ## The problem
#
# The fields are those of a problem file (YAML). `tubeplanner schema` describes all of them. `seed`
# is the guess from which inverse kinematics finds the start at the first point of the tube.

# %%
fields = {
    "robot": {"urdf": "lifter.urdf", "tool_frame": "gripper"},
    "tube": {
        "points": [[0.5, -0.35, 0.3], [0.5, -0.35, 0.65], [0.5, 0.35, 0.65], [0.5, 0.35, 0.3]],
        "radius": [0.04, 0.10, 0.04],
        "joint_signs": {"elbow": "+"},
    },
    "start": {"seed": [-0.6, 0.5, 1.5]},
}


def problem_with(elbow_limit, **changes):
    """Write the URDF and read the problem."""
    (folder / "lifter.urdf").write_text(lifter(elbow_limit))
    return parse_problem({**fields, **changes}, folder, "lifter")


# %% [markdown]
# ## A missing limit
#
# The elbow has no velocity limit. A guessed limit can break a robot, and so can a zero read as
# "none". The error therefore names the joint and the remedy.

# %%
URDF_LIMIT = 'lower="-2.6" upper="2.6" effort="60"'
try:
    problem_with(URDF_LIMIT)
except RobotError as error:
    print(str(error).replace(f"{folder}/", ""))

# %% [markdown]
# Give the limit in the URDF or in the problem file. In the problem file, the URDF of the
# manufacturer stays unchanged.

# %%
limits = {"velocity": {"elbow": 3.5}}
problem = problem_with(URDF_LIMIT, robot={**fields["robot"], "limits": limits})
print(problem.robot.joint_names, problem.robot.limits.velocity)

# %% [markdown]
# ## The first plan

# %%
result = plan(problem)
print(result.message)
print(*result.notes, sep="\n")

# %% [markdown]
# The shortest motion of this arm switches its motors very fast. By default, `plan` spends 0.5 %
# more time than the shortest motion on smoother efforts; the note compares the two. If your machine
# has a jerk limit, give it.

# %%
limits["jerk"] = {"column": 600, "shoulder": 600, "elbow": 900}
arm = {**fields["robot"], "limits": limits}
result = plan(problem_with(URDF_LIMIT, robot=arm))
print(result.message)

# %% [markdown]
# ## A load in the gripper
#
# The payload has a mass and a centre of mass in the tool frame. If the payload is too heavy, the
# message names the joint that cannot hold it.

# %%
for mass in (2, 6, 16):
    loaded = {**arm, "payload": {"mass": mass, "com": [0, 0, 0.05]}}
    answer = plan(problem_with(URDF_LIMIT, robot=loaded))
    print(f"{mass:2} kg: {answer.status}: {answer.message}")

# %% [markdown]
# ## A fence in the way
#
# Obstacles are boxes, spheres, cylinders, capsules or meshes. The links keep the clearance from
# obstacles and from each other. Here a clearance of 40 mm costs less than 0.1 ms: the motion bends
# a little, and the forearm comes within 40.4 mm of the fence.

# %%
loaded = {**arm, "payload": {"mass": 2, "com": [0, 0, 0.05]}}
fence = [{"name": "fence", "box": [0.6, 0.06, 0.66], "position": [0.75, 0, 0.33]}]
for clearance in (0.0, 0.04):
    fenced = problem_with(URDF_LIMIT, robot=loaded, obstacles=fence, clearance=clearance)
    answer = plan(fenced)
    print(f"clearance {1000 * clearance:.0f} mm: {answer.message}")
    distance = clearance + answer.certificate.conditions["obstacles"].margin
    print(f"    {1000 * distance:.1f} mm from the fence at the nearest")

# %% picture=[0.55,0.2,1.0,0.62]
plot_trajectory(fenced, answer.trajectory)

# %% [markdown]
# A fence that is too high is no error in the file. The message names the link, the obstacle and the
# position of the tool:

# %%
high = [{"name": "fence", "box": [0.9, 0.06, 1.6], "position": [0.65, 0, 0.8]}]
answer = plan(problem_with(URDF_LIMIT, robot=loaded, obstacles=high))
print(f"{answer.status}: {answer.message}")
print("where:", answer.location)
