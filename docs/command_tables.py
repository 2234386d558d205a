"""Tables of the commands and their options, from the help texts of the command line."""

from inspect import cleandoc

import click

from tubeplanner.cli.main import cli


def command_list() -> str:
    """Return a table of all commands, each with the first sentence of its help text."""
    rows = [f"| [`{name}`](#{name}) | {_paragraphs(name)[0]} |" for name in sorted(cli.commands)]
    return "\n".join(["| command | what it does |", "|---|---|", *rows])


def command_options(name: str) -> str:
    """Return the help text of a command, its arguments and a table of its options."""
    parameters = cli.commands[name].params
    arguments = [
        each.human_readable_name for each in parameters if isinstance(each, click.Argument)
    ]
    options = [_option(each) for each in parameters if isinstance(each, click.Option)]
    usage = [f"Arguments: {' '.join(f'`{each}`' for each in arguments)}"] if arguments else []
    table = "\n".join(["| option | meaning |", "|---|---|", *options])
    return "\n\n".join([*_paragraphs(name), *usage, table])


def _paragraphs(name: str) -> list[str]:
    """Return the paragraphs of a help text, one line each."""
    text = cleandoc(cli.commands[name].help or "")
    return [" ".join(paragraph.split()) for paragraph in text.split("\n\n")]


def _option(option: click.Option) -> str:
    """Return a row: names, value, help text, default and least value."""
    value = "" if option.is_flag else f" {option.metavar or option.type.name.upper()}"
    meaning = [" ".join((option.help or "").split()).replace("|", "\\|").replace("<", "\\<")]
    if option.show_default:
        meaning.append(f"Default: {option.default}.")
    if option.required:
        meaning.append("Required.")
    if isinstance(option.type, click.IntRange):
        meaning.append(f"At least {option.type.min}.")
    return f"| `{', '.join(option.opts)}{value}` | {' '.join(meaning)} |"
