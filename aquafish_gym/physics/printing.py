"""Print straight-line functions, in Python, JavaScript and C99, by running them on symbols.

A function is printed with one operation a line, equal operations once, and without those that no
result needs. What is stated for any body plan thereby becomes straight-line code for one.

In JavaScript and C a function takes flat arrays, by ``fetch``, and writes its results into their
entries, by ``put``. It therefore also runs on plain floats. All entries are read before the first
is written. In Python it takes numbers and tuples, and returns such.

The printed C rounds as plain Python does, to the bit, if the compiler fuses no multiply-add by
itself. JavaScript has no fused multiply-add and rounds twice there.
"""

from __future__ import annotations

import hashlib
import linecache
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from inspect import signature
from typing import Any, NamedTuple

from aquafish_gym.physics import arithmetic
from aquafish_gym.physics.symbols import Symbol


class Language(NamedTuple):
    """How a language writes a function, a number and each operation."""

    head: str  # with the function's name and its parameters
    parameter: str  # an array that is read, with its name and length
    result: str  # an array that is written
    number: str  # how a line begins that names a number
    operations: Mapping[str, str]


JAVASCRIPT = Language(
    "function {}({}) {{",
    "{}",
    "{}",
    "const",
    {
        "entry": "{}[{}]",
        "add": "{} + {}",
        "subtract": "{} - {}",
        "multiply": "{} * {}",
        "divide": "{} / {}",
        "negate": "-{}",
        "fma": "{} * {} + {}",
        "abs": "Math.abs({})",
        "square_root": "Math.sqrt({})",
        "floor": "Math.floor({})",
        "where_less": "{} < {} ? {} : {}",
    },
)
C99 = Language(
    "void {}({})\n{{",
    "const double {}[{}]",
    "double {}[{}]",
    "const double",
    {
        **JAVASCRIPT.operations,
        "fma": "fma({}, {}, {})",
        "abs": "fabs({})",
        "square_root": "sqrt({})",
        "floor": "floor({})",
    },
)
# Its operations alone; numbers and tuples have no heads.
PYTHON = {
    **JAVASCRIPT.operations,
    "fma": "fma({}, {}, {})",
    "abs": "abs({})",
    "square_root": "square_root({})",
    "floor": "floor({})",
    "where_less": "where_less({}, {}, {}, {})",
}
Nested = Any  # a number, or a tuple of such


@dataclass(frozen=True)
class Traced:
    """A function as it ran on symbols.

    Attributes
    ----------
    sizes
        The length of each array, by the name of the parameter.
    lines
        What is computed, in order, by the name of the number: an operation, and its operands, which
        are floats and names. Or "entry", an array's name and an index.
    results
        What is written: an array's name, the index, and a float or a name.
    """

    sizes: dict[str, int]
    lines: dict[str, tuple[Any, ...]]
    results: list[tuple[str, int, str | float]]

    @property
    def operations(self) -> Counter[str]:
        """How many of each operation are computed."""
        return Counter(name for name, *_ in self.lines.values() if name != "entry")


def trace(function: Callable[..., None], **sizes: int) -> Traced:
    """Run a function on symbols.

    Parameters
    ----------
    function
        Straight-line code for any scalar backend that takes flat arrays.
    sizes
        The length of the array that each parameter is.
    """
    parameters = list(signature(function).parameters)
    if parameters != list(sizes):
        raise TypeError(f"sizes must be those of {parameters}, in this order; got {list(sizes)}")
    before = {name: [Symbol("entry", name, i) for i in range(size)] for name, size in sizes.items()}
    after = {name: list(entries) for name, entries in before.items()}
    function(**after)
    written: list[tuple[str, int, Any]] = [
        (name, i, entry if isinstance(entry, Symbol) else float(entry))
        for name, entries in after.items()
        for i, entry in enumerate(entries)
        if entry is not before[name][i]
    ]
    lines, known = _lines(entry for _, _, entry in written)
    return Traced(sizes, lines, [(name, i, known.get(x, x)) for name, i, x in written])


def _lines(results: Iterable[Any]) -> tuple[dict[str, tuple[Any, ...]], dict[Any, str]]:
    """Return the lines of :class:`Traced` that compute results, and the name of each symbol."""
    lines: dict[str, tuple[Any, ...]] = {}
    names: dict[str, str] = {}  # of the number that a line computes
    known: dict[Any, Any] = {}
    for symbol in _needed(results):
        line = (symbol.operation, *(known.get(x, x) for x in symbol.operands))
        text = repr(line)  # which tells 0.0 from -0.0
        if text not in names:
            name = "{}_{}".format(*line[1:]) if line[0] == "entry" else f"t{len(lines)}"
            names[text] = name
            lines[name] = line
        known[symbol] = names[text]
    return lines, known


def _needed(results: Iterable[Symbol | float]) -> list[Symbol]:
    """Return the symbols that results need, in the order in which they were computed."""
    found: set[Symbol] = set()
    todo = list(results)
    while todo:
        symbol = todo.pop()
        if isinstance(symbol, Symbol) and symbol not in found:
            found.add(symbol)
            todo += symbol.operands
    return sorted(found, key=lambda symbol: symbol.serial)


def printed(name: str, traced: Traced, language: Language) -> str:
    """Return a function's source in a language."""
    written = {array for array, _, _ in traced.results}
    parameters = [
        (language.result if array in written else language.parameter).format(array, size)
        for array, size in traced.sizes.items()
    ]
    source = [language.head.format(name, ", ".join(parameters))]
    for number, (operation, *operands) in traced.lines.items():
        value = language.operations[operation].format(*map(_operand, operands))
        source.append(f"    {language.number} {number} = {value};")
    source += [f"    {array}[{i}] = {_operand(x)};" for array, i, x in traced.results]
    return "\n".join([*source, "}"]) + "\n"


def _operand(x: str | float) -> str:
    """Return a name, or the shortest decimal that is read as the same number."""
    text = x if isinstance(x, str) else repr(x)
    return f"({text})" if text.startswith("-") else text


def straight_line(
    name: str, function: Callable[..., Nested], *templates: Nested
) -> Callable[..., Nested]:
    """Return a function of numbers and tuples as straight-line Python.

    Parameters
    ----------
    name
        What the function is called.
    function
        Code for any scalar backend.
    templates
        What each parameter is: any number, or a tuple, named or not, of such.
    """
    parameters = [f"x{i}" for i in range(len(templates))]
    given = [
        _filled(template, (Symbol("entry", parameter, i) for i in range(_count(template))))
        for parameter, template in zip(parameters, templates, strict=True)
    ]
    result = function(*given)
    lines, known = _lines(_flat(result))
    kinds: dict[str, Any] = {}
    source = [f"def {name}({', '.join(parameters)}):"]
    for parameter, template in zip(parameters, templates, strict=True):
        names = (f"{parameter}_{i}" for i in range(_count(template)))
        source.append(f"    {_pattern(template, names)} = {parameter}")
    source += [
        f"    {number} = {PYTHON[operation].format(*map(_operand, operands))}"
        for number, (operation, *operands) in lines.items()
        if operation != "entry"
    ]
    source.append(f"    return {_spelled(result, known, kinds)}")
    return _run(name, source, kinds)


def _flat(value: Nested) -> Iterator[Any]:
    if isinstance(value, tuple):
        for part in value:
            yield from _flat(part)
    else:
        yield value


def _count(value: Nested) -> int:
    return sum(1 for _ in _flat(value))


def _filled(template: Nested, numbers: Iterator[Any]) -> Nested:
    """Return a tuple of a template's shape of other numbers."""
    if not isinstance(template, tuple):
        return next(numbers)
    parts = [_filled(part, numbers) for part in template]
    return type(template)(*parts) if hasattr(template, "_fields") else tuple(parts)


def _pattern(template: Nested, names: Iterator[str]) -> str:
    """Return the target of an assignment that unpacks a tuple."""
    if not isinstance(template, tuple):
        return next(names)
    return "(" + "".join(f"{_pattern(part, names)}, " for part in template) + ")"


def _spelled(value: Nested, known: Mapping[Any, str], kinds: dict[str, Any]) -> str:
    """Return the expression of a result; the classes of its named tuples are noted in ``kinds``."""
    if not isinstance(value, tuple):
        return known.get(value) or repr(float(value))
    inside = "(" + "".join(f"{_spelled(part, known, kinds)}, " for part in value) + ")"
    if not hasattr(value, "_fields"):
        return inside
    kind = type(value)
    kinds[kind.__name__] = kind
    return f"{kind.__name__}{inside}"


def rows_reader(template: Nested) -> Callable[..., Nested]:
    """Return ``(rows, first, group, groups, like)``, which reads numbers of a template's shape.

    They stand in rows from ``first`` on; see ``layout.py``.
    """
    numbers = [Symbol("entry", "row", i) for i in range(_count(template))]
    known = {
        row: f"fetch(rows, (first + {i}) * groups + group, like)" for i, row in enumerate(numbers)
    }
    kinds: dict[str, Any] = {}
    result = _spelled(_filled(template, iter(numbers)), known, kinds)
    source = ["def fetch_rows(rows, first, group, groups, like):", f"    return {result}"]
    return _run("fetch_rows", source, kinds)


def rows_writer(template: Nested) -> Callable[..., None]:
    """Return ``(rows, first, group, groups, values)``, which writes what a reader reads."""
    names = [f"x{i}" for i in range(_count(template))]
    source = [
        "def put_rows(rows, first, group, groups, values):",
        f"    {_pattern(template, iter(names))} = values",
        *(f"    put(rows, (first + {i}) * groups + group, {x})" for i, x in enumerate(names)),
    ]
    return _run("put_rows", source, {})


def _run(name: str, source: list[str], names: Mapping[str, Any]) -> Callable[..., Any]:
    """Return the function of a printed source, which tracebacks can show."""
    text = "\n".join(source) + "\n"
    file = f"<straight-line {name} {hashlib.sha256(text.encode()).hexdigest()[:8]}>"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    namespace = {**vars(arithmetic), **names}
    exec(compile(text, file, "exec"), namespace)  # it was printed above
    found: Callable[..., Any] = namespace[name]
    return found
