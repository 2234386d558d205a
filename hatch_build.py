"""The build hook: compiles the native library if there is a compiler, or else leaves it out."""

import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class NativeBuildHook(BuildHookInterface):
    """Puts the library beside the module that loads it, in a checkout or in a wheel."""

    def dependencies(self) -> list[str]:
        """Return what the build needs from the package index."""
        return ["ziglang"] if os.environ.get("TUBEPLANNER_BUILD") == "zig" else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile; a build without a compiler is one of Python alone, and says so."""
        module = _build_module(Path(self.root))
        try:
            built = module.build()
        except RuntimeError as error:
            if os.environ.get("TUBEPLANNER_BUILD"):
                raise
            self.app.display_warning(f"The native library is left out:\n{error}")
            built = []
        if not built:
            self.app.display_warning("tubeplanner is installed without its native library")
            return
        build_data["artifacts"] += [f"/{path.relative_to(self.root)}" for path in built]
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{_platform_tag()}"


def _build_module(root: Path) -> Any:
    """Return the package's module that compiles, without importing the package."""
    path = root / "src" / "tubeplanner" / "native" / "build.py"
    specification = importlib.util.spec_from_file_location("tubeplanner_native_build", path)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    return module


def _platform_tag() -> str:
    """Return the tag of the platform that compiled code runs on."""
    from packaging.tags import sys_tags

    return next(tag.platform for tag in sys_tags() if not tag.platform.startswith("manylinux"))
