"""What users may rely on, line by line: names, parameters, options, fields, keys, exit statuses.

`tests/data/promises.txt` has the lines of the newest release. Later ones have these lines too; to
add those of a new release: python tests/helpers/promises.py. A line goes by hand, as
docs/reference/stability.md says when.
"""

import inspect
import json
import re
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import fields, is_dataclass
from enum import Enum
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import click

import tubeplanner
from tubeplanner.cli import console
from tubeplanner.cli.main import cli, main

STORED = Path(__file__).parents[1] / "data" / "promises.txt"
# A tuple's or a dictionary's own methods, and those of exceptions, are Python's.
_OF_PYTHON = {name for kind in (object, tuple, Exception, Enum, str) for name in dir(kind)}


def promises() -> set[str]:
    """Return the lines that this version keeps."""
    return {*_python(), *_command_line(), *_fields(), *_reports()}


def _python() -> Iterator[str]:
    stub = Path(tubeplanner.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    returned = set(re.findall(r"as (\w+)  # returned$", stub, re.M))  # nobody else makes them
    for name in tubeplanner.__all__:
        item = getattr(tubeplanner, name)
        yield f"python {name}"
        is_of_python = isinstance(item, type) and issubclass(item, Exception | Enum)
        if callable(item) and not is_of_python and name not in returned:
            for parameter in inspect.signature(item).parameters:
                yield f"python {name}({parameter})"
        if isinstance(item, type):
            members = {each for each in dir(item) if not each.startswith("_")} - _OF_PYTHON
            members |= {each.name for each in fields(item)} if is_dataclass(item) else set()
            yield from (f"python {name}.{member}" for member in members if member[0] != "_")
    yield from (f"python {former}" for former in tubeplanner._FORMER_NAMES)


def _command_line() -> Iterator[str]:
    for name in ("SUCCESS", "INFEASIBLE", "BAD_INPUT", "INTERRUPTED"):
        yield f"exit status {getattr(console, name)} {name.lower().replace('_', ' ')}"
    for name in cli.commands:
        yield f"command {name}"
        for option in cli.commands[name].params:
            if isinstance(option, click.Option):
                yield from (f"command {name} {flag}" for flag in option.opts)
            if isinstance(option.type, click.Choice):
                yield from (f"command {name} {option.opts[0]} {x}" for x in option.type.choices)


def _printed(*words: str) -> dict:
    with redirect_stdout(StringIO()) as stream:
        main(words)
    return json.loads(stream.getvalue())


def _fields() -> Iterator[str]:
    for kind in ("problem", "cycle", "study"):
        schema = _printed("schema", *([] if kind == "problem" else [f"--{kind}"]))
        lines = set(_paths(schema, schema, "", ()))
        yield from (f"{kind} file {line}" for line in lines)


def _paths(schema: dict, whole: dict, path: str, above: tuple[str, ...]) -> Iterator[str]:
    """Yield the paths of fields of a schema, and the words that they take."""
    if (name := schema.get("$ref", "").rpartition("/")[2]) and name not in above:
        yield from _paths(whole["$defs"][name], whole, path, (*above, name))
    words = [*schema.get("enum", []), *([schema["const"]] if "const" in schema else [])]
    yield from (f"{path}: {word}" for word in words if isinstance(word, str))
    for name, field in schema.get("properties", {}).items():
        inner = f"{path}.{name}".removeprefix(".")
        yield inner
        yield from _paths(field, whole, inner, above)
    for key in ("anyOf", "oneOf", "allOf", "prefixItems"):
        for each in schema.get(key, []):
            yield from _paths(each, whole, path, above)
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield from _paths(schema[key], whole, path, above)


def _reports() -> Iterator[str]:
    problem, file = "example:two_link/around_a_post", "t.json"
    with TemporaryDirectory() as folder:
        path = Path(folder) / file
        plan = ["plan", problem, "--method", "stop-at-corners", "--slack", "0", "-o", str(path)]
        runs = {
            "plan": plan,
            "check": ["check", problem, str(path)],
            "info": ["info"],
            "info ROBOT": ["info", "example:two_link"],
            "info PROBLEM": ["info", problem],
            "robots": ["robots"],
        }
        reports = {command: _printed(*words, "--json") for command, words in runs.items()}
        yield from (f"trajectory file {key}" for key in json.loads(path.read_text()))
        for command, report in reports.items():
            yield from (f"report of {command}: {key}" for key in report)
    yield from (f"report: where.{key}" for key in reports["plan"]["where"])
    yield from (f"report: certificate.{key}" for key in reports["plan"]["certificate"])
    own = (name for name in reports["info"]["environment"] if name.startswith("TUBEPLANNER"))
    yield from (f"environment {name}" for name in own)


if __name__ == "__main__":
    known = set(STORED.read_text(encoding="utf-8").splitlines()) if STORED.exists() else set()
    STORED.write_text("\n".join(sorted(known | promises())) + "\n", encoding="utf-8")
