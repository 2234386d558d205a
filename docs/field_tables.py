"""Tables of the fields of problem, cycle and study files, from their JSON schemas."""

import json
import re
from typing import Any

_KINDS = {
    "string": "text",
    "number": "number",
    "integer": "integer",
    "boolean": "true or false",
    "null": "null",
}
_UNIT = re.compile(r"\[((?:(?:kg|rad|Pa|N|m|s)(?:\^\d)?[ ,/]*)+)\]")
_PROBLEM_PAGE = "problem_file.md"


def problem_fields(schema: dict[str, Any]) -> str:
    """Return a heading, a sentence and a table of each section of a problem file.

    Args:
        schema: The JSON schema of the problem file.
    """
    titles = _problem_titles(schema)
    links = {name: f"#{heading_anchor(title)}" for name, title in titles.items()}
    return _sections(schema, titles, links)


def further_fields(schema: dict[str, Any], problem: dict[str, Any]) -> str:
    """Return the same for another file, of the sections that a problem file does not have.

    Args:
        schema: The JSON schema of the file.
        problem: The JSON schema of the problem file; its sections are links to its page.
    """
    shared = _problem_titles(problem)
    found = _section_paths(schema)
    titles = {name: _title(name, found) for name in found if name not in shared}
    links = {name: f"{_PROBLEM_PAGE}#{heading_anchor(path)}" for name, path in shared.items()}
    links |= {name: f"#{heading_anchor(own)}" for name, own in titles.items()}
    return _sections(schema, titles, links)


def heading_anchor(title: str) -> str:
    """Return the anchor of a heading, on a code host and in the built pages alike."""
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", title)
    return re.sub(r"[^\w\- ]", "", text.strip().lower()).replace(" ", "-")


def _section_paths(schema: dict[str, Any]) -> dict[str, list[str]]:
    """Return the field paths of each section, by the section's name in the schema, in order."""
    paths: dict[str, list[str]] = {}

    def add(section: dict[str, Any], path: str) -> None:
        for name, field in section["properties"].items():
            references = re.findall(r'"#/\$defs/(\w+)"', json.dumps(field))
            for reference in dict.fromkeys(references):  # a field may take one, or a list of them
                inner = f"{path}.{name}".removeprefix(".")
                paths.setdefault(reference, []).append(inner)
                add(schema["$defs"][reference], inner)

    add(schema, "")
    return paths


def _problem_titles(schema: dict[str, Any]) -> dict[str, str]:
    """Return the heading of each section: its paths, or its own word where they are taken."""
    titles: dict[str, str] = {}
    for name, paths in _section_paths(schema).items():
        title = ", ".join(paths)
        titles[name] = name.removesuffix("Fields").lower() if title in titles.values() else title
    return titles


def _title(name: str, paths: dict[str, list[str]]) -> str:
    """Return the heading of a section: its path, or its own word where it shares the path."""
    path = paths[name][0]
    if [path] not in [other for key, other in paths.items() if key != name]:
        return path
    return name.removesuffix("Fields").lower()


def _sections(schema: dict[str, Any], titles: dict[str, str], links: dict[str, str]) -> str:
    """Return the top level and the sections with titles."""
    inner = [_section(schema["$defs"][name], titles[name], links) for name in titles]
    return "\n\n".join([_section(schema, "Top level", links), *inner])


def _section(section: dict[str, Any], title: str, links: dict[str, str]) -> str:
    """Return a heading, a sentence and a table.

    Args:
        section: The schema of the section.
        title: The heading.
        links: Link targets of sections, by their names in the schema.
    """
    rows = ["| Field | Type | Unit | Default | Meaning |", "|---|---|---|---|---|"]
    required = section.get("required", []) + section.get("then", {}).get("required", [])
    for name, field in section["properties"].items():
        default = "required" if name in required else _default(field)
        meaning = field["description"]
        units = " or ".join(_UNIT.findall(meaning)).replace(",", " or")
        units = units.replace("^2", "²").replace("^3", "³")
        meaning = _UNIT.sub("", meaning).replace(" ;", ";").removesuffix("or ").strip()
        cells = (f"`{name}`", _type(field, links), units, default, meaning)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join([f"### {title}", "", section["description"], "", *rows])


def _default(field: dict[str, Any]) -> str:
    """Return a default as a file has it; a section's is that of its fields."""
    default = field["default"]
    if default and isinstance(default, dict):
        return "its own"
    return f"`{json.dumps(default, ensure_ascii=False)}`"


def _type(field: dict[str, Any], links: dict[str, str]) -> str:
    """Return the type of a field in words, without null, which stands for a default."""
    if not field:
        return "anything"
    if "$ref" in field:
        return f"[section]({links[field['$ref'].rpartition('/')[2]]})"
    alternatives = field.get("anyOf", field.get("oneOf"))
    if alternatives is not None:
        kinds = [_type(kind, links) for kind in alternatives if kind.get("type") != "null"]
        many = (f"list of {kinds[0]}", f"list of ({kinds[0]})")
        return ", or ".join("list of these" if kind in many else kind for kind in kinds)
    if "enum" in field:
        return ", ".join(f"`{json.dumps(value)}`" for value in field["enum"])
    if "prefixItems" in field:
        return f"[{len(field['prefixItems'])} {_type(field['prefixItems'][0], links)}s]"
    if "items" in field:
        return f"list of {_grouped(field['items'], links)}"
    if "additionalProperties" in field:
        held = field["additionalProperties"]
        return f"map to {_grouped({} if held is True else held, links)}"
    return f"`{json.dumps(field['const'])}`" if "const" in field else _KINDS[field["type"]]


def _grouped(field: dict[str, Any], links: dict[str, str]) -> str:
    """Return the type of an entry, alternatives in brackets."""
    kinds = _type(field, links)
    return f"({kinds})" if ", or " in kinds else kinds
