"""What the native sources export, as they declare it: names, arguments, results."""

import re
from typing import NamedTuple

from tubeplanner.native.build import source_files

_DECLARED = re.compile(r"^TUBEPLANNER_API ([\w ]+?[ *]+)(\w+)\(([^)]*)\)", re.M)


class Argument(NamedTuple):
    type: str
    name: str


class Export(NamedTuple):
    returns: str
    name: str
    arguments: tuple[Argument, ...]

    def declaration(self):
        types = ", ".join(argument.type for argument in self.arguments)
        return f'extern "C" {self.returns} {self.name}({types});'


def exports():
    """Return the functions, by name."""
    found = {}
    for path in source_files():
        for returns, name, given in _DECLARED.findall(path.read_text()):
            words = [word.split() for word in given.split(",") if word.strip()]
            arguments = tuple(Argument(" ".join(word[:-1]), word[-1]) for word in words)
            found[name] = Export(returns.strip(), name, arguments)
    return found
