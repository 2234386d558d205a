"""The build hook: compiles the native library if there is a compiler, or else leaves it out."""

import importlib.util
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class NativeBuildHook(BuildHookInterface):
    """Puts the library beside the module that loads it, in a checkout or in a wheel."""

    def dependencies(self) -> list[str]:
        """Return what the build needs from the package index."""
        is_by_zig = os.environ.get("TUBEPLANNER_BUILD") == "zig"
        return ["ziglang"] if is_by_zig or os.environ.get("TUBEPLANNER_TARGET") else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile; a build without a compiler is one of Python alone, and says so."""
        module = _build_module(Path(self.root))
        # A wheel may be for another platform: it leaves the checkout's own library alone.
        self._folder = tempfile.TemporaryDirectory()
        folder = module.FOLDER if version == "editable" else Path(self._folder.name)
        try:
            built = module.build(folder)
        except RuntimeError as error:
            if any(os.environ.get(f"TUBEPLANNER_{name}") for name in ("BUILD", "TARGET")):
                raise
            self.app.display_warning(f"The native library is left out:\n{error}")
            built = []
        if not built:
            reason = "Windows" if sys.platform == "win32" else "no C++ compiler"
            message = f"tubeplanner is built without its native library ({reason}): Python alone"
            self.app.display_warning(message)
            return
        for path in built if version != "editable" else ():
            build_data["force_include"][str(path)] = f"tubeplanner/native/{path.name}"
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{module.platform_tag()}"


def _build_module(root: Path) -> Any:
    """Return the package's module that compiles, without importing the package."""
    path = root / "src" / "tubeplanner" / "native" / "build.py"
    specification = importlib.util.spec_from_file_location("tubeplanner_native_build", path)
    assert specification is not None and specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    return module
