"""The lazy group of commands; one line for any error; robots, schema.

A command's module is imported when the command is called. NumPy is not imported before, here or in
`console`: a report of bad usage or of Ctrl-C does not need NumPy.

Exit status: 0 success; 1 infeasible, or a check that failed; 2 bad input or usage; 130 interrupted.
"""

import ast
import sys
from collections import UserDict
from collections.abc import Sequence
from errno import ENOSPC
from importlib import import_module
from importlib.util import find_spec
from keyword import iskeyword
from pathlib import Path
from typing import Any

import click

from tubeplanner.cli import console
from tubeplanner.cli.interrupts import hold_interrupts, interrupts_remembered
from tubeplanner.errors import OptionError, TubePlannerError
from tubeplanner.outcome import ContradictionError
from tubeplanner.resources import (
    bundled_cycles,
    bundled_presets,
    bundled_problems,
    bundled_robots,
    bundled_studies,
    example_robot_names,
)


def main(arguments: Sequence[str]) -> int:
    """Run the command line on arguments without the program's name; return the exit status."""
    as_json, files = "--json" in arguments, console.AnswerFiles()
    try:
        with interrupts_remembered() as raise_pending:
            raise_pending()
            status = cli.main(list(arguments), "tubeplanner", standalone_mode=False, obj=files)
            hold_interrupts()
            sys.stdout.flush()
        if not files.failures:
            return int(status or console.SUCCESS)
        if not as_json:  # the object has it
            console.fail("bad_input", files.message, as_json, console.BAD_INPUT)
        return console.BAD_INPUT
    except click.ClickException as error:
        if as_json:
            return console.fail("bad_input", error.format_message(), as_json, console.BAD_INPUT)
        error.show()
        return console.BAD_INPUT
    except ContradictionError as error:
        fields = {"where": error.location.as_dict(), "proved": error.proved}
        return console.fail("bad_input", str(error), as_json, console.BAD_INPUT, **fields)
    except TubePlannerError as error:
        return console.fail("bad_input", f"{error}{files.saved}", as_json, console.BAD_INPUT)
    except (KeyboardInterrupt, click.Abort):
        message = "interrupted before there was an answer"
        return console.fail("interrupted", message, as_json, console.INTERRUPTED)
    except Exception as error:  # the last resort: a user gets one line, never a traceback
        if isinstance(error, OSError) and error.errno == ENOSPC:
            # Errors of files name the file: this is standard output, too full for a JSON report.
            message = f"standard output cannot be written: {error.strerror}; make room"
            message += files.saved
            return console.fail("bad_input", message, as_json=False, code=console.BAD_INPUT)
        message = console.internal_error(error) + files.saved
        return console.fail("bad_input", message, as_json, console.BAD_INPUT)


class _LazyCommands(UserDict[str, Any]):
    """Commands by name; the module of each is imported when the command is first looked up.

    A command is the function of its name in its module.
    """

    def __getitem__(self, name: str) -> click.Command:
        command = self.data[name]
        if not isinstance(command, str):
            return command
        return getattr(import_module(command), _function_of(name))

    def help_of(self, name: str) -> str:
        """Return the help text of a command, without an import of its module."""
        command = self.data[name]
        if isinstance(command, click.Command):
            return command.help or ""
        spec = find_spec(command)
        assert spec is not None and spec.origin is not None
        tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
        functions = (node for node in tree.body if isinstance(node, ast.FunctionDef))
        own = _function_of(name)
        return next(ast.get_docstring(each) or "" for each in functions if each.name == own)


def _function_of(command: str) -> str:
    """Return the name of the function of a command: `import` is none in Python."""
    return f"{command}_" if iskeyword(command) else command


class _LazyGroup(click.Group):
    """A group whose help imports no command; else `--help` would take ten times as long."""

    commands: _LazyCommands

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands with their short help."""
        names = self.list_commands(ctx)
        width = formatter.width - 6 - max(map(len, names))
        stubs = [click.Command(name, help=self.commands.help_of(name)) for name in names]
        with formatter.section("Commands"):
            formatter.write_dl([(str(each.name), each.get_short_help_str(width)) for each in stubs])


_OWN = [
    "check",
    "compare",
    "explain",
    "info",
    "init",
    "place",
    "plan",
    "reproduce",
    "simulate",
    "study",
    "sweep",
    "view",
]
_SHARED = {"plot": "view", "measure": "tubes", "route": "tubes", "teach": "tubes"}
_SHARED |= {"import": "imports", "links": "contents"}
_MODULES = {name: name for name in _OWN} | _SHARED


@click.group(
    cls=_LazyGroup,
    commands=_LazyCommands({name: f"{__package__}.{file}" for name, file in _MODULES.items()}),
    context_settings={"help_option_names": ["-h", "--help"]},
)
@console.VERSION
def cli() -> None:
    """Plan a smooth, certified trajectory of a robot arm whose tool stays in a tube.

    PROBLEM is a problem file (YAML or JSON) or example:ROBOT/NAME for a bundled one; plan, check,
    info, view, plot, simulate, study and sweep --vary take cycle files too. STUDY is a file of many
    plans.
    """


@cli.command()
@console.AS_JSON
def robots(as_json: bool) -> None:
    """List the bundled problems, cycles, studies and robots of `example:`, and the presets."""
    problems, cycles = list(bundled_problems()), list(bundled_cycles())
    presets = bundled_presets()
    if as_json:
        fields = {"robots": example_robot_names(), "problems": problems, "cycles": cycles}
        fields |= {"studies": list(bundled_studies()), "presets": list(presets)}
        console.print_json({**console.empty_report("success", "names for example:"), **fields})
        return
    names = {"Problems": problems, "Cycles": cycles, "Studies": list(bundled_studies())}
    for kind, own in names.items():
        console.say(
            f"{kind} (example:ROBOT/NAME):", *(f"  example:{each}" for each in own), sep="\n"
        )
    console.say("Robots (robot.urdf: example:NAME), from this package and from example-robot-data:")
    bundled = bundled_robots()
    for name in example_robot_names():
        console.say(f"  example:{name}{'  (bundled)' if name in bundled else ''}")
    console.say("Presets (robot.preset or robustness.preset: NAME), sources in the file:")
    console.say(*(f"  {name}  {path}" for name, path in presets.items()), sep="\n")


@cli.command()
@click.option("--cycle", is_flag=True, help="Print the schema of the cycle file.")
@click.option("--study", "of_study", is_flag=True, help="Print the schema of the study file.")
@click.option("--json", is_flag=True, help="No effect: the schema is always JSON.")
def schema(cycle: bool, of_study: bool, json: bool) -> None:
    """Print the JSON schema of the problem file, the cycle file or the study file."""
    from tubeplanner.studies.study_file import study_schema
    from tubeplanner.task.cycle_file import cycle_schema
    from tubeplanner.task.problem_format import problem_schema

    if cycle and of_study:
        raise OptionError("schema takes either --cycle or --study")
    make_schema = study_schema if of_study else cycle_schema if cycle else problem_schema
    console.print_json(make_schema(), indent=2)
