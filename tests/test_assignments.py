"""One assignment a line: ``a, b, c = x, y, z`` makes a reader pair names and values by counting."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FILES = [
    path
    for package in ("aquafish", "aquafish_gym", "eea", "gait")
    for path in sorted((ROOT / package).rglob("*.py"))
]


def packed(source: str) -> list[int]:
    """Return the lines that assign a written-out tuple of three or more values to as many names."""
    return [
        node.lineno
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Assign)
        and isinstance(node.value, ast.Tuple)
        and len(node.value.elts) > 2
        and any(isinstance(target, ast.Tuple | ast.List) for target in node.targets)
    ]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_line_assigns_three_values_to_three_names(path: Path) -> None:
    assert packed(path.read_text()) == []


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("a, b, c = 1, 2, 3", [1]),
        ("[a, b, c] = x, y, z", [1]),
        ("def f():\n    a, *b = 1, 2, 3", [2]),
        ("a, b = b, a", []),
        ("a, b, c = point", []),
        ("a, b, c = f(1, 2, 3)", []),
        ("a = 1, 2, 3", []),
    ],
)
def test_packed_assignments_are_found(source: str, found: list[int]) -> None:
    assert packed(source) == found
