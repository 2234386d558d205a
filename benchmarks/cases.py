"""Bundled problems that several benchmarks plan."""

ARMS = (
    "two_link/around_a_post",
    "ur5/over_the_wall",
    "ur10/onto_a_conveyor",
    "panda/between_shelves",
    "xarm7/from_crate_to_crate",
)
EXAMPLES = (1, 2, 3, 4, 5)  # of the paper
RADII = (10, 30, 50)  # [mm]


def paper_example(example: int, radius: int) -> str:
    """Return the name of the problem of one of the paper's examples with a radius [mm]."""
    return f"two_link/paper_{example}_{radius}mm"
