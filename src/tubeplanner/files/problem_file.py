"""A problem file with another tube: comments and all else kept, relative paths valid from there."""

import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from tubeplanner.resources import EXAMPLE_PREFIX
from tubeplanner.tube.tube import JointRange, Tube, sign_of

_PACKAGE_PREFIX = "package://"
_LONGEST_LINE = 1000  # [characters]: lines are left as they were


def with_other_tube(source: Path, target: Path, tube: Tube) -> bytes:
    """Return a problem file's contents with other radii and joint signs, for another place.

    Args:
        source: A valid problem file.
        target: Where the contents will be; its ending says whether they are JSON or YAML.
        tube: Its radii and joint ranges are written.
    """
    text = source.read_text(encoding="utf-8-sig")
    yaml = YAML()
    yaml.preserve_quotes = True
    yaml.width = _LONGEST_LINE
    fields = json.loads(text) if source.suffix == ".json" else yaml.load(text)
    fields["tube"]["radius"] = _in_a_row(tube.radius.tolist())
    maps = [_signs(ranges) for ranges in tube.joint_ranges]
    fields["tube"]["joint_signs"] = maps[0] if all(row == maps[0] for row in maps) else maps
    _move_paths(fields, source.parent, target.parent)
    if target.suffix == ".json":
        return (json.dumps(fields, indent=2) + "\n").encode()  # limits may be Infinity
    stream = io.BytesIO()
    yaml.dump(fields, stream)
    return stream.getvalue()


def _signs(ranges: Mapping[str, JointRange]) -> CommentedMap:
    """Return joint ranges as a file has them, signs where they say the same."""
    row = CommentedMap(
        (name, sign_of(bounds) or _in_a_row(list(bounds))) for name, bounds in ranges.items()
    )
    row.fa.set_flow_style()
    return row


def _in_a_row(values: Sequence[float]) -> CommentedSeq:
    """Return a sequence that YAML has on one line."""
    row = CommentedSeq(values)
    row.fa.set_flow_style()
    return row


def _move_paths(fields: Any, before: Path, after: Path) -> None:
    """Make the relative paths of a problem, valid in one folder, valid in another."""
    robot = fields["robot"]
    solids = [*(fields.get("obstacles") or ()), *(robot.get("attached") or ())]
    holders = [(robot, "urdf"), (robot, "srdf"), *((solid, "mesh") for solid in solids)]
    for holder, key in holders:
        if holder.get(key) is not None:
            holder[key] = _moved(holder[key], before, after)
    folders = robot.get("package_dirs") or []
    for k, folder in enumerate(folders):
        folders[k] = _moved(folder, before, after)


def _moved(path: str, before: Path, after: Path) -> str:
    if path.startswith((EXAMPLE_PREFIX, _PACKAGE_PREFIX)) or Path(path).is_absolute():
        return path
    return os.path.relpath((before / path).resolve(), after.resolve())
