"""The reference of the problem file, written from its JSON schema."""

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
_UNIT = re.compile(r"\[((?:(?:kg|rad|N|m|s)(?:\^\d)?[ ,/]*)+)\]")


def problem_fields(schema: dict[str, Any]) -> str:
    """Return the fields of every section as Markdown: a heading, a sentence and a table each.

    Args:
        schema: The JSON schema of the problem file.
    """
    paths: dict[str, list[str]] = {}
    find_sections(schema, schema, "", paths)
    inner = [
        written_section(schema["$defs"][name], " · ".join(paths[name]), paths) for name in paths
    ]
    return "\n\n".join([written_section(schema, "Top level", paths), *inner])


def find_sections(
    schema: dict[str, Any], section: dict[str, Any], path: str, paths: dict[str, list[str]]
) -> None:
    """Note under which paths each section is written, in reading order."""
    for name, field in section["properties"].items():
        references = re.findall(r'"#/\$defs/(\w+)"', json.dumps(field))
        for reference in dict.fromkeys(references):  # a field may take one, or a list of them
            inner = f"{path}.{name}".removeprefix(".")
            paths.setdefault(reference, []).append(inner)
            find_sections(schema, schema["$defs"][reference], inner, paths)


def written_section(section: dict[str, Any], title: str, paths: dict[str, list[str]]) -> str:
    """Return a heading, a sentence and a table.

    Args:
        section: The schema of the section.
        title: Its heading, of which the first word is its label.
        paths: Under which paths sections are written, by their names in the schema.
    """
    label = f"(field-{title.split(' ')[0].lower()})="
    rows = ["| Field | Type | Unit | Default | Meaning |", "|---|---|---|---|---|"]
    required = section.get("required", []) + section.get("then", {}).get("required", [])
    for name, field in section["properties"].items():
        default = "required" if name in required else _default(field)
        meaning = field["description"]
        units = " or ".join(_UNIT.findall(meaning)).replace(",", " or")
        units = units.replace("^2", "²").replace("^3", "³")
        meaning = _UNIT.sub("", meaning).replace(" ;", ";").removesuffix("or ").strip()
        cells = (f"`{name}`", _type(field, paths), units, default, meaning)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join([label, f"### {title}", "", section["description"], "", *rows])


def _default(field: dict[str, Any]) -> str:
    """Return a default as it is written in a file; a section's is that of its fields."""
    default = field["default"]
    if default and isinstance(default, dict):
        return "its own"
    return f"`{json.dumps(default, ensure_ascii=False)}`"


def _type(field: dict[str, Any], paths: dict[str, list[str]]) -> str:
    """Return what a field takes, in words; null only stands for a default."""
    if not field:
        return "anything"
    if "$ref" in field:
        path = paths[field["$ref"].rpartition("/")[2]][0]
        return f"[section](#field-{path})"
    alternatives = field.get("anyOf", field.get("oneOf"))
    if alternatives is not None:
        kinds = [_type(kind, paths) for kind in alternatives if kind.get("type") != "null"]
        many = (f"list of {kinds[0]}", f"list of ({kinds[0]})")
        return ", or ".join("list of these" if kind in many else kind for kind in kinds)
    if "enum" in field:
        return ", ".join(f"`{json.dumps(value)}`" for value in field["enum"])
    if "prefixItems" in field:
        return f"[{len(field['prefixItems'])} {_type(field['prefixItems'][0], paths)}s]"
    if "items" in field:
        return f"list of {_grouped(field['items'], paths)}"
    if "additionalProperties" in field:
        held = field["additionalProperties"]
        return f"map to {_grouped({} if held is True else held, paths)}"
    return f"`{json.dumps(field['const'])}`" if "const" in field else _KINDS[field["type"]]


def _grouped(field: dict[str, Any], paths: dict[str, list[str]]) -> str:
    """Return what an entry takes, alternatives in brackets."""
    kinds = _type(field, paths)
    return f"({kinds})" if ", or " in kinds else kinds
