"""One assignment a line: only a swap, ``a, b = b, a``, pairs written-out values with names."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: Folders whose lines may still assign two values to two names: leave out what is clean.
TWO_ALLOWED = (
    "aquafish/online",
    "aquafish/recovery",
    "aquafish/viewer",
    "aquafish_gym/damage",
    "aquafish_gym/engines",
    "aquafish_gym/envs",
    "aquafish_gym/physics",
    "aquafish_gym/rollout",
    "gait",
)
FILES = [
    str(path.relative_to(ROOT))
    for package in ("aquafish", "aquafish_gym", "eea", "gait")
    for path in sorted((ROOT / package).rglob("*.py"))
]


def packed(source: str, most: int = 1) -> list[int]:
    """Return the lines that assign more than ``most`` written-out values, swaps excepted."""
    return [
        node.lineno
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Assign)
        and isinstance(node.value, ast.Tuple)
        and len(node.value.elts) > most
        and any(isinstance(target, ast.Tuple | ast.List) for target in node.targets)
        and not is_swap(node)
    ]


def is_swap(node: ast.Assign) -> bool:
    """Return whether the values are the targets in another order."""
    (target, *more) = node.targets
    if more or not isinstance(target, ast.Tuple) or not isinstance(node.value, ast.Tuple):
        return False
    places = sorted(map(ast.unparse, target.elts))
    return places == sorted(map(ast.unparse, node.value.elts))


def in_folder(path: str, folder: str) -> bool:
    return path.startswith(f"{folder}/")


@pytest.mark.parametrize("path", FILES)
def test_a_line_assigns_one_value(path: str) -> None:
    most = 2 if any(in_folder(path, folder) for folder in TWO_ALLOWED) else 1
    assert packed((ROOT / path).read_text(), most) == []


@pytest.mark.parametrize("folder", TWO_ALLOWED)
def test_a_folder_is_listed_only_while_it_has_pairs(folder: str) -> None:
    assert any(packed((ROOT / path).read_text()) for path in FILES if in_folder(path, folder))


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("a, b = 1, 2", [1]),
        ("[a, b, c] = x, y, z", [1]),
        ("def f():\n    a, *b = 1, 2, 3", [2]),
        ("a, b = b, a + b", [1]),
        ("a, b = b, a", []),
        ("x[i], x[j] = x[j], x[i]", []),
        ("a, b, c = point", []),
        ("a, b, c = f(1, 2, 3)", []),
        ("a = 1, 2, 3", []),
    ],
)
def test_packed_assignments_are_found(source: str, found: list[int]) -> None:
    assert packed(source) == found
