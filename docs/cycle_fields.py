"""The reference of the cycle file, written from its JSON schema."""

import re
from typing import Any

from problem_fields import find_sections, written_section


def cycle_fields(schema: dict[str, Any], problem: dict[str, Any]) -> str:
    """Return the fields of the sections that a problem file has not, as `problem_fields` does.

    Args:
        schema: The JSON schema of the cycle file.
        problem: That of the problem file, to whose sections the tables link.
    """
    shared: dict[str, list[str]] = {}
    find_sections(problem, problem, "", shared)
    met: dict[str, list[str]] = {}
    find_sections(schema, schema, "", met)
    own = {name: _word(name) for name in met if name not in shared}
    paths = shared | {name: [word] for name, word in own.items()}
    inner = [written_section(schema["$defs"][name], word, paths) for name, word in own.items()]
    return "\n\n".join([written_section(schema, "Cycle", paths), *inner])


def _word(name: str) -> str:
    """Return what a section is called that stands under the key of another, or in a list."""
    words = re.findall("[A-Z][a-z]+", name.removesuffix("Fields"))
    return ".".join(words).lower()
