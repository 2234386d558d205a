"""What `mutants.py` changes in a source: one operator, number, argument or statement."""

import ast
from collections.abc import Iterator
from functools import cached_property
from itertools import accumulate, pairwise
from typing import NamedTuple

_BOUNDS = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_COMPARISONS = {
    **{ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE, ast.Eq: ast.NotEq},
    **{ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn},
    ast.NotIn: ast.In,
}
_ARITHMETIC = {
    **{ast.Add: ("sign", ast.Sub), ast.Sub: ("sign", ast.Add)},
    **{ast.Mult: ("factor", ast.Div), ast.Div: ("factor", ast.Mult)},
    **{ast.Pow: ("factor", ast.Mult), ast.BitAnd: ("and/or", ast.BitOr)},
    ast.BitOr: ("and/or", ast.BitAnd),
}
_NO_NUMBERS = (ast.JoinedStr, ast.List, ast.ListComp, ast.Tuple, ast.Dict, ast.DictComp)
# Calls whose answer is the same with swapped arguments, or that break at once.
_NOT_SWAPPED = {
    *("min", "max", "minimum", "maximum", "hypot", "isclose", "allclose", "array_equal"),
    *("logical_and", "logical_or", "isinstance", "issubclass", "getattr", "hasattr", "cast"),
}
_NOT_WALKED = ("annotation", "returns", "exc", "cause", "msg")  # type hints and messages
_KEYWORDS = ("axis", "strict")  # one has its own change; the other is no test's matter
_LEAST = 1e-100  # what is less keeps a divisor from 0: another does as well
_DROPPED = (ast.AugAssign, ast.Raise, ast.Continue, ast.Break)
_DEFINITIONS = (ast.FunctionDef, ast.ClassDef, ast.Import, ast.ImportFrom)
Change = tuple[str, ast.AST, ast.AST]  # the operator's name, a node, and what stands there instead


class Fragment(NamedTuple):
    """Whole lines of a function, of which one mutant is made.

    Attributes:
        where: Qualified name of the function.
        operator: What is done to them.
        begin: Their first character in the module's text.
        before: The lines, without the indent of the first.
        after: What stands there instead.
        lines: First and last line of the statement, or of the statement's head.
    """

    where: str
    operator: str
    begin: int
    before: str
    after: str
    lines: tuple[int, int]


class Source:
    """The text of a module, its functions, and what may be changed in them."""

    def __init__(self, text: str) -> None:
        self.text = text

    @cached_property
    def _tree(self) -> ast.Module:
        return ast.parse(self.text)

    @cached_property
    def _lines(self) -> list[str]:
        return self.text.splitlines(keepends=True)

    @cached_property
    def _starts(self) -> list[int]:
        return list(accumulate(map(len, self._lines), initial=0))

    def spans(self, where: str) -> list[tuple[int, int]]:
        """Return begin and end of the functions of a qualified name; a property may have two."""
        *classes, function = where.split(".")
        heads = [*(f"class {name}" for name in classes), f"def {function}("]
        if not all(head in self.text for head in heads):
            return []  # without parsing: few modules have it
        nodes = [node for name, node in _functions(self._tree.body, "") if name == where]
        return [(self._starts[n.lineno - 1], self._starts[n.end_lineno or 0]) for n in nodes]

    def line(self, at: int) -> int:
        """Return the number of the line of a character."""
        return self.text.count("\n", 0, at) + 1

    def statement(self, at: int) -> tuple[int, int]:
        """Return first and last line of the innermost statement around a character."""
        line = self.line(at)
        heads = [_head(node) for node in ast.walk(self._tree) if isinstance(node, ast.stmt)]
        around = [head for head in heads if head[0] <= line <= head[1]]
        return max(around, default=(line, line))

    def fragments(self) -> Iterator[Fragment]:
        """Yield the fragment of every change in a function."""
        for where, function in _functions(self._tree.body, ""):
            bound = _first_lines(function)
            for statement in _statements(function.body):
                for operator, old, new in _changes(statement, bound):
                    yield self._fragment(where, operator, old, new, _head(statement))

    def _fragment(
        self, where: str, operator: str, old: ast.AST, new: ast.AST, lines: tuple[int, int]
    ) -> Fragment:
        first = self._at(old.lineno, old.col_offset)
        last = self._at(old.end_lineno, old.end_col_offset)
        line = self._lines[old.lineno - 1]
        begin = self._starts[old.lineno - 1] + len(line) - len(line.lstrip())
        end = self._starts[old.end_lineno] - 1
        after = ast.unparse(new)
        after = f"({after})" if isinstance(new, ast.BinOp | ast.BoolOp | ast.Compare) else after
        after = self.text[begin:first] + after + self.text[last:end]
        return Fragment(where, operator, begin, self.text[begin:end], after, lines)

    def _at(self, line: int, column: int) -> int:
        """Return the character of a column, which Python's parser counts in bytes."""
        return self._starts[line - 1] + len(self._lines[line - 1].encode()[:column].decode())


def _changes(statement: ast.stmt, bound: dict[str, int]) -> Iterator[Change]:
    if _may_be_dropped(statement, bound):
        yield "dropped statement", statement, ast.Pass()
    if not isinstance(statement, _DEFINITIONS):
        for node in _walked(statement):
            yield from _replacements(node)


def _replacements(node: ast.AST) -> Iterator[Change]:
    match node:
        case ast.Compare(left, ops, comparators):
            for k, op in enumerate(ops):
                for name, table in (("comparison", _COMPARISONS), ("off by one", _BOUNDS)):
                    if type(op) in table:
                        others = [*ops[:k], table[type(op)](), *ops[k + 1 :]]
                        yield name, node, ast.Compare(left, others, comparators)
        case ast.BinOp(left, op, right) if type(op) in _ARITHMETIC:
            name, other = _ARITHMETIC[type(op)]
            if not (_is_no_number(left) or _is_no_number(right)):
                yield name, node, ast.BinOp(left, other(), right)
        case ast.AugAssign(target, op, value) if type(op) in _ARITHMETIC:
            name, other = _ARITHMETIC[type(op)]
            if not _is_no_number(value):
                yield name, node, ast.AugAssign(target, other(), value)
        case ast.BoolOp(op, values):
            other = ast.Or() if isinstance(op, ast.And) else ast.And()
            yield "and/or", node, ast.BoolOp(other, values)
        case ast.UnaryOp(ast.USub(), operand):
            yield "sign", node, operand
        case ast.UnaryOp(ast.Not(), operand):
            yield "comparison", node, operand
        case ast.If(test) | ast.IfExp(test) | ast.While(test):
            if isinstance(test, ast.Name | ast.Attribute | ast.Call):
                yield "comparison", test, ast.UnaryOp(ast.Not(), test)
        case ast.keyword("axis", ast.Constant(0 | 1 as value) as axis):
            yield "off by one", axis, ast.Constant(1 - value)
        case ast.Constant(bool(value)):
            yield "constant", node, ast.Constant(not value)
        case ast.Constant(int(value)):
            yield "off by one", node, ast.Constant(value + 1)
        case ast.Constant(float(value)) if value == 0 or value > _LEAST:
            yield "constant", node, ast.Constant(2 * value or 1.0)
        case ast.Call(function, arguments, keywords):
            if getattr(function, "attr", getattr(function, "id", "")) not in _NOT_SWAPPED:
                for k, (first, second) in enumerate(pairwise(arguments)):
                    # Of two types, mostly, are two kinds of expressions: any test would notice.
                    if type(first) is type(second) and ast.dump(first) != ast.dump(second):
                        others = [*arguments[:k], second, first, *arguments[k + 2 :]]
                        yield "swapped argument", node, ast.Call(function, others, keywords)


def _functions(body: list[ast.stmt], prefix: str) -> Iterator[tuple[str, ast.FunctionDef]]:
    for node in body:
        if isinstance(node, ast.FunctionDef):
            yield prefix + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from _functions(node.body, f"{prefix}{node.name}.")


def _statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Yield the statements of a body and of the bodies in it."""
    for statement in body:
        yield statement
        for field in ("body", "orelse", "finalbody"):
            yield from _statements(getattr(statement, field, []))
        for part in [*getattr(statement, "handlers", []), *getattr(statement, "cases", [])]:
            yield from _statements(part.body)


def _walked(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the parts of a statement that are neither statements, hints nor messages."""
    yield node
    is_check = isinstance(node, ast.Call) and getattr(node.func, "id", "") == "isinstance"
    if is_check or isinstance(node, ast.JoinedStr) or getattr(node, "arg", "") in _KEYWORDS:
        return
    for name, value in ast.iter_fields(node):
        for part in value if isinstance(value, list) else [value]:
            is_part = isinstance(part, ast.expr | ast.keyword | ast.comprehension | ast.withitem)
            if is_part and name not in _NOT_WALKED:
                yield from _walked(part)


def _head(statement: ast.stmt) -> tuple[int, int]:
    """Return first and last line of a statement without the statements in it."""
    body = getattr(statement, "body", None) or getattr(statement, "cases", None)
    if not body:
        return statement.lineno, statement.end_lineno or statement.lineno
    first = getattr(body[0], "lineno", statement.lineno + 1)
    return statement.lineno, max(first - 1, statement.lineno)


def _first_lines(function: ast.FunctionDef) -> dict[str, int]:
    """Return the line where each name of a function is first bound; 0 of a parameter."""
    lines = {node.arg: 0 for node in ast.walk(function.args) if isinstance(node, ast.arg)}
    for node in ast.walk(function):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            lines[node.id] = min(lines.get(node.id, node.lineno), node.lineno)
    return lines


def _may_be_dropped(statement: ast.stmt, bound: dict[str, int]) -> bool:
    """Return whether a function without a statement still knows all of its names."""
    match statement:
        case ast.Expr(value):
            return not isinstance(value, ast.Constant)
        case ast.Assign([ast.Name(name)]):
            return bound[name] < statement.lineno
        case ast.Assign([ast.Attribute() | ast.Subscript()]) | ast.Return(None):
            return True
    return isinstance(statement, _DROPPED)


def _is_no_number(node: ast.expr) -> bool:
    is_text = isinstance(node, ast.Constant) and not isinstance(node.value, int | float)
    return is_text or isinstance(node, _NO_NUMBERS)
