"""The references of the cycle file and the study file, written from their JSON schemas."""

import re
from typing import Any

from problem_fields import find_sections, written_section


def further_fields(title: str, schema: dict[str, Any], problem: dict[str, Any]) -> str:
    """Return the fields of the sections that a problem file has not, as `problem_fields` does.

    Args:
        title: What the kind of file is called.
        schema: Its JSON schema.
        problem: That of the problem file, to whose sections the tables link.
    """
    shared: dict[str, list[str]] = {}
    find_sections(problem, problem, "", shared)
    met: dict[str, list[str]] = {}
    find_sections(schema, schema, "", met)
    own = {name: _word(name) for name in met if name not in shared}
    paths = shared | {name: [word] for name, word in own.items()}
    inner = [written_section(schema["$defs"][name], word, paths) for name, word in own.items()]
    return "\n\n".join([written_section(schema, title, paths), *inner])


def _word(name: str) -> str:
    """Return what a section is called that stands under the key of another, or in a list."""
    words = re.findall("[A-Z][a-z]+", name.removesuffix("Fields"))
    return ".".join(words).lower()
