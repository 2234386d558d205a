"""The option `--version`: which version runs, and which build of it."""

from typing import Any

import click

from tubeplanner import __version__
from tubeplanner.commands.console import say


def _say_version(context: click.Context, option: click.Parameter, asked: bool) -> Any:
    if not asked or context.resilient_parsing:
        return
    from tubeplanner.native.library import LIBRARY

    say(f"tubeplanner {__version__}, {LIBRARY.build}")
    context.exit()


VERSION = click.option(
    "--version",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_say_version,
    help="Print the version, whether it runs natively, and why not.",
)
