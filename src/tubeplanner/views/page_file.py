"""The page as one file: its parts, of the folder `page`, meshcat's viewer, and what it shows."""

import base64
import gzip
import html
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).with_name("page")
# In the order in which they build on each other.
_SCRIPTS = (
    *("elements", "legend", "findings", "camera", "views", "overlay", "depth", "ghosts", "names"),
    *("closest", "hover", "record", "timeline", "curves", "time", "start"),
)


def page_html(title: str, panel: Mapping[str, Any], commands: Iterable[Mapping[str, Any]]) -> str:
    """Return a page that needs no network.

    Args:
        title: Of the window.
        panel: What the page says, as JSON values.
        commands: Those of meshcat that build its scene, in order.
    """
    import meshcat
    import umsgpack

    packed = b"".join(
        len(one).to_bytes(4, "little") + one
        for one in (umsgpack.packb(command, force_float_precision="single") for command in commands)
    )
    engine = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    licence = engine.with_name("main.min.js.LICENSE.txt")
    parts = {
        "title": html.escape(title),
        "style": _part("page.css"),
        "licence": licence.read_text(encoding="utf-8").replace("<", "&lt;"),
        "data": json.dumps(panel, allow_nan=False).replace("<", "\\u003c"),
        "scene": base64.b64encode(gzip.compress(packed, mtime=0)).decode(),
        "engine": engine.read_text(encoding="utf-8").replace("</script", "<\\/script"),
        "program": "\n".join(_part(f"{name}.js") for name in _SCRIPTS),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match.group(1)], _part("page.html"))


def _part(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")
