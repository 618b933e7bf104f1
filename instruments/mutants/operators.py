"""All mutants of a source text: each is one edit of it."""

from __future__ import annotations

import ast
import difflib
import re
from itertools import pairwise
from typing import Any, NamedTuple

_ARITHMETIC: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: (r"\+", "-"),
    ast.Sub: (r"-", "+"),
    ast.Mult: (r"\*", "/"),
    ast.Div: (r"/", "*"),
    ast.FloorDiv: (r"//", "*"),
    ast.Mod: (r"%", "*"),
    ast.Pow: (r"\*\*", "*"),
    ast.BitAnd: (r"&", "|"),
    ast.BitOr: (r"\|", "&"),
}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: (r"<", "<="),
    ast.LtE: (r"<=", "<"),
    ast.Gt: (r">", ">="),
    ast.GtE: (r">=", ">"),
    ast.Eq: (r"==", "!="),
    ast.NotEq: (r"!=", "=="),
    ast.Is: (r"is", "is not"),
    ast.IsNot: (r"is\s+not", "is"),
    ast.In: (r"in", "not in"),
    ast.NotIn: (r"not\s+in", "in"),
}


class Edit(NamedTuple):
    """A mutant: bytes ``start`` to ``end`` of the source become ``text``.

    Examples
    --------
    >>> first, *_ = edits_of("a = b + 1")
    >>> first.what, first.apply("a = b + 1")
    ('+ becomes -', 'a = b - 1')
    """

    start: int
    end: int
    text: str
    line: int
    what: str  #: In words.

    def apply(self, source: str) -> str:
        """Return the mutated source."""
        content = source.encode()
        return (content[: self.start] + self.text.encode() + content[self.end :]).decode()

    def diff(self, source: str, file: str) -> str:
        """Return the mutant as a unified diff."""
        before = source.splitlines(keepends=True)
        after = self.apply(source).splitlines(keepends=True)
        return "".join(difflib.unified_diff(before, after, f"a/{file}", f"b/{file}", n=2))


def edits_of(source: str) -> list[Edit]:
    """Return the edits that make mutants of a module, in the order of their places.

    Operators of arithmetic, comparisons and logic are exchanged, numbers and conditions changed,
    calls and ``raise`` statements left out. Types, decorators, messages and the ``strict`` of
    ``zip`` stay as they are: they change no result, or only stop the import.
    """
    finder = _Finder(source)
    finder.visit(ast.parse(source))
    return sorted(finder.edits)


def is_mutant(source: str, edit: Edit) -> bool:
    """Return whether an edit leaves a module that can be read and is another one."""
    try:
        mutated = ast.parse(edit.apply(source))
    except SyntaxError:
        return False
    return ast.dump(mutated) != ast.dump(ast.parse(source))


class _Finder(ast.NodeVisitor):
    """Collects edits."""

    def __init__(self, source: str) -> None:
        self.edits: list[Edit] = []
        self._content = source.encode()
        lengths = [len(line) for line in self._content.splitlines(keepends=True)]
        self._lines = [sum(lengths[:i]) for i in range(len(lengths) + 1)]

    def _span(self, node: Any) -> tuple[int, int]:
        start = self._lines[node.lineno - 1] + node.col_offset
        return start, self._lines[node.end_lineno - 1] + node.end_col_offset

    def _add(self, start: int, end: int, text: str, what: str) -> None:
        line = self._content[:start].count(b"\n") + 1
        self.edits.append(Edit(start, end, text, line, what))

    def _exchange(self, before: ast.AST, after: ast.AST, pattern: str, text: str) -> None:
        """Exchange the operator that stands between two nodes."""
        begin = self._span(before)[1]
        gap = self._content[begin : self._span(after)[0]].decode()
        if match := re.search(pattern, gap):
            start = begin + len(gap[: match.start()].encode())
            self._add(start, start + len(match[0]), text, f"{match[0]} becomes {text}")

    def _leave_out(self, node: ast.stmt) -> None:
        self._add(*self._span(node), "pass", "a statement is left out")

    def _negate(self, test: ast.expr) -> None:
        start, end = self._span(test)
        text = self._content[start:end].decode()
        if text != "TYPE_CHECKING":
            self._add(start, end, f"(not ({text}))", "a condition is negated")

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if type(node.op) in _ARITHMETIC:
            self._exchange(node.left, node.right, *_ARITHMETIC[type(node.op)])
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        if type(node.op) in _ARITHMETIC:
            self._exchange(node.target, node.value, *_ARITHMETIC[type(node.op)])
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        for (before, after), op in zip(
            pairwise([node.left, *node.comparators]), node.ops, strict=True
        ):
            self._exchange(before, after, *_COMPARISONS[type(op)])
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        words = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for before, after in pairwise(node.values):
            self._exchange(before, after, *words)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        start = self._span(node)[0]
        if isinstance(node.op, ast.Not | ast.USub):
            word = "not" if isinstance(node.op, ast.Not) else "-"
            self._add(start, self._span(node.operand)[0], "", f"{word} is left out")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            new = str(not value)
        elif isinstance(value, int):
            new = str(value + 1)
        elif isinstance(value, float):
            new = repr(2.0 * value or 1.0)
        else:
            return
        self._add(*self._span(node), new, f"{value!r} becomes {new}")

    def visit_If(self, node: ast.If) -> None:
        self._negate(node.test)
        self.generic_visit(node)

    def visit_While(self, node: ast.While) -> None:
        self._negate(node.test)
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._negate(node.test)
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self._leave_out(node)
        self.generic_visit(node)

    def visit_Raise(self, node: ast.Raise) -> None:
        self._leave_out(node)  # its message stays

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg != "strict":
            self.generic_visit(node)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        pass  # a message

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_arguments(self, node: ast.arguments) -> None:
        for default in (*node.defaults, *filter(None, node.kw_defaults)):
            self.visit(default)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self.visit(node.args)
        for statement in node.body:
            self.visit(statement)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for statement in node.body:
            self.visit(statement)
