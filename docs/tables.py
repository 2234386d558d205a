"""Parts of these pages that are written from the sources: make docs-tables.

A part stands between two comments: `<!-- begin NAME [ARGUMENT]: ... -->` and `<!-- end -->`.
"""

import re
from collections.abc import Callable
from pathlib import Path

from command_tables import command_list, command_options
from field_tables import further_fields, problem_fields
from gallery import gallery
from public_names import public_table
from reading_order import reading_order
from tubeplanner.studies.study_file import study_schema
from tubeplanner.task.cycle_file import cycle_schema
from tubeplanner.task.problem_format import problem_schema

DOCS = Path(__file__).parent
PART = re.compile(r"(<!-- begin (\w+)(?: ([\w-]+))?:[^>]*-->\n).*?(<!-- end -->)", re.S)
PARTS: dict[str, Callable[..., str]] = {
    "problem_fields": lambda: problem_fields(problem_schema()),
    "cycle_fields": lambda: further_fields(cycle_schema(), problem_schema()),
    "study_fields": lambda: further_fields(study_schema(), problem_schema()),
    "commands": command_list,
    "options": command_options,
    "gallery": gallery,
    "public_names": public_table,
    "modules": reading_order,
}


def written(text: str) -> str:
    """Return a page with its parts written anew."""

    def part(match: re.Match[str]) -> str:
        begin, name, argument, end = match.groups()
        return f"{begin}\n{PARTS[name](*filter(None, [argument]))}\n\n{end}"

    return PART.sub(part, text)


if __name__ == "__main__":
    for page in sorted(DOCS.rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        if (new := written(text)) != text:
            page.write_text(new, encoding="utf-8")
