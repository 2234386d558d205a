"""Libraries that only some commands need: what to say where one is not installed."""

from pathlib import Path

# By the name of the extra that brings it, as pyproject.toml has it.
REQUIREMENTS = {
    "dask": "distributed>=2024.1",
    "route": "ompl>=2.0",
    "simulate": "mujoco>=3.2.7",
    "xacro": "xacro>=2.1",
}


def not_installed(extra: str, what: str, library: str) -> str:
    """Return a sentence on a library that is missing, with the command that installs it.

    In a checkout it is the extra that is installed, editable: without `-e` pip would replace the
    checkout by a copy. Elsewhere it is the library: this package is in no registry.

    Args:
        extra: The extra that brings the library, a key of `REQUIREMENTS`.
        what: What takes the library.
        library: What users call it.
    """
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "pyproject.toml").is_file():
        remedy = f"pip install -e '.[{extra}]' in {checkout}"
    else:
        remedy = f"pip install '{REQUIREMENTS[extra]}'"
    return f"{what} takes {library}, which is not installed: {remedy}"
