"""Print straight-line functions in JavaScript and C99 by running them on symbols.

A function takes flat arrays, by ``fetch``, and writes its results into their entries, by ``put``.
It therefore also runs on plain floats. It is printed with one operation a line, equal operations
once, and without those that no result needs. All entries are read before the first is written.

The printed C rounds as plain Python does, to the bit, if the compiler fuses no multiply-add by
itself. JavaScript has no fused multiply-add and rounds twice there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from inspect import signature
from typing import Any, NamedTuple

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
    written = [
        (name, i, entry if isinstance(entry, Symbol) else float(entry))
        for name, entries in after.items()
        for i, entry in enumerate(entries)
        if entry is not before[name][i]
    ]
    lines: dict[str, tuple[Any, ...]] = {}
    names: dict[str, str] = {}  # of the number that a line computes
    known: dict[Any, Any] = {}
    for symbol in _needed(entry for _, _, entry in written):
        line = (symbol.operation, *(known.get(x, x) for x in symbol.operands))
        text = repr(line)  # which tells 0.0 from -0.0
        if text not in names:
            name = "{}_{}".format(*line[1:]) if line[0] == "entry" else f"t{len(lines)}"
            names[text] = name
            lines[name] = line
        known[symbol] = names[text]
    return Traced(sizes, lines, [(name, i, known.get(x, x)) for name, i, x in written])


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
