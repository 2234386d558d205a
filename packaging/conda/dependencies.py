"""The dependencies of pyproject.toml by their names in conda-forge: compares or writes them.

    python packaging/conda/dependencies.py            # ends with status 1 if a file differs
    python packaging/conda/dependencies.py --write    # writes them
    python packaging/conda/dependencies.py --render   # the recipe by rattler-build, per platform

They stand in `recipe.yaml`, between its two marks, and in `environment-windows.yaml`, with what the
tests need.
"""

import re
import sys
import tomllib
from pathlib import Path

FOLDER = Path(__file__).parent
RECIPE, ENVIRONMENT = FOLDER / "recipe.yaml", FOLDER / "environment-windows.yaml"
# Where the names differ. Bounds are those of PyPI's packages, whose versions conda-forge keeps.
_NAMES = {
    "coal": "coal-python",  # `coal` is all of it, with headers
    "lazy-loader": "lazy_loader",
    "matplotlib": "matplotlib-base",  # without Qt
    "meshcat": "meshcat-python",
    "pin": "pinocchio-python",  # `pinocchio` is all of it, with headers
}
# Of the tests' dependencies: what nothing needs there, and what pip installs: PyPI has wheels for
# Windows, and the names in conda-forge were not looked up.
_NOT_OF_USE = {"import-linter", "mypy", "pytest-cov", "pytest-randomly", "ruff"}
_BY_PIP = {"ezdxf", "grimp", "mujoco", "rosbags", "xacro", "yourdfpy"}
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^]]*\])?\s*([^;]*)")
_BEGIN, _END = "    # From pyproject.toml:\n", "    # End of what dependencies.py writes.\n"


def conda_names(requirements: list[str]) -> list[str]:
    """Return requirements of PyPI as conda-forge's, sorted, without markers and extras."""
    found = {}
    for requirement in requirements:
        match = _REQUIREMENT.match(requirement)
        assert match is not None, requirement
        name = match[1].lower()
        conda = _NAMES.get(name, name)
        found[conda] = f"{conda} {match[2].strip()}".strip()
    return [found[name] for name in sorted(found)]


def contents() -> dict[Path, str]:
    """Return what the two files ought to hold."""
    project = tomllib.loads((FOLDER.parents[1] / "pyproject.toml").read_text("utf-8"))["project"]
    run = conda_names(project["dependencies"])
    tests = [
        each
        for each in conda_names(project["optional-dependencies"]["test"])
        if each.split()[0] not in _NOT_OF_USE
    ]
    by_pip = [each for each in tests if each.split()[0] in _BY_PIP]
    recipe = RECIPE.read_text("utf-8")
    before, rest = recipe.split(_BEGIN)
    after = rest.split(_END)[1]
    lines = "".join(f"    - {each}\n" for each in run)
    every = sorted({*run, *tests} - {*by_pip})
    return {
        RECIPE: before + _BEGIN + lines + _END + after,
        ENVIRONMENT: (
            "# Written by dependencies.py: what the tests need on Windows, untested.\n"
            "name: tubeplanner\nchannels:\n  - conda-forge\n"
            "dependencies:\n  - python 3.12.*\n  - pip\n  - hatchling >=1.24\n"
            + "".join(f"  - {each}\n" for each in every)
            + "  - pip:\n"
            + "".join(f"      - {each}\n" for each in by_pip)
        ),
    }


def render() -> None:
    """Print what the recipe asks for on each platform; needs the package py-rattler-build."""
    import rattler_build

    recipe = rattler_build.Stage0Recipe.from_yaml(RECIPE.read_text("utf-8"))
    for platform in ("linux-64", "linux-aarch64", "osx-64", "osx-arm64", "win-64"):
        machine = rattler_build.PlatformConfig(
            target_platform=platform, build_platform=platform, host_platform=platform
        )
        # Of conda-forge's pinning: what `stdlib("c")` stands for.
        library = "sysroot" if platform.startswith("linux") else "macosx_deployment_target"
        variants = rattler_build.VariantConfig({"c_stdlib": [library]})
        (variant,) = recipe.render(variants, rattler_build.RenderConfig(platform=machine))
        wanted = variant.recipe.to_dict()["requirements"]
        print(platform, *(f"{kind}: {len(names)}" for kind, names in wanted.items()))


def main(arguments: list[str]) -> int:
    """Compare or write the files; return the exit status."""
    different = [
        path
        for path, text in contents().items()
        if not path.exists() or path.read_text("utf-8") != text
    ]
    if "--write" in arguments:
        for path in different:
            path.write_text(contents()[path], encoding="utf-8")
        return 0
    if "--render" in arguments:
        render()
    for path in different:
        print(f"{path.name} is not what pyproject.toml asks for; run {__file__} --write")
    return 1 if different else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
