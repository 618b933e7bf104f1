"""What no linter of others looks for: words that stop a reader, and two assignments in a line."""

from __future__ import annotations

import ast
import re
import tokenize
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("aquafish", "aquafish_gym", "eea", "gait")
SOURCES = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
# docs/results, docs/gap and docs/recovery are generated.
PAGES = sorted(
    page
    for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "paper" / "paper.md"]
    if {"_build", "results", "gap", "recovery"}.isdisjoint(page.relative_to(ROOT).parts)
    and page.name != "CHANGELOG.md"
)
PLACEHOLDERS = re.compile(
    r"\b(EVIDENCE|RRR|PPP|TODO|FIXME|XXX)\b|^(<<<<<<<|>>>>>>>) ", re.MULTILINE
)
# Constructions that make a reader stop.
BANNED = re.compile(
    r"\banew\b|\bas said\b|\bso many\b|\bsomebody\b|\bnobody\b|\bin whatever way\b|\bbegun\b"
    r"|\b(for|by|to|of|from|with|but|and|as|than) who(ever)?\b|(^|[.;:] )Who(ever)? [a-z]"
    r"|\bhears?\b|\bheard\b|\btold\b|\b(comes?|came|coming) to\b|\b(is|are|was|were) to [a-z]+"
    r"|\bheld against\b|\bbelieved in\b|\bsays `",
    re.MULTILINE,
)
# Of a parameter, and in the name of a hypothesis in result files.
NAMES = ("begun", "told")
GENERATED = re.compile(r"<!-- make pages: .*?<!-- end -->", re.DOTALL)
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


def found(pattern: re.Pattern[str], file: Path, text: str) -> list[str]:
    """Return what a pattern finds in a text, each with the file's name."""
    return [f"{file.relative_to(ROOT)}: {one.group()!r}" for one in pattern.finditer(text)]


def words(file: Path) -> str:
    """Return the comments and the strings of a Python file."""
    with file.open("rb") as source:
        tokens = tokenize.tokenize(source.readline)
        kinds = (tokenize.COMMENT, tokenize.STRING)
        return "\n".join(token.string for token in tokens if token.type in kinds)


def test_nothing_is_left_to_fill_in() -> None:
    assert [
        one for file in [*PAGES, *SOURCES] for one in found(PLACEHOLDERS, file, file.read_text())
    ] == []


def test_pages_and_sources_are_in_plain_english() -> None:
    said = []
    for page in PAGES:
        said += found(BANNED, page, GENERATED.sub("", page.read_text()))
    for file in SOURCES:
        said += [one for one in found(BANNED, file, words(file)) if one.split("'")[-2] not in NAMES]
    assert said == []


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


def test_a_line_assigns_one_value() -> None:
    lines = []
    for file in SOURCES:
        name = file.relative_to(ROOT).as_posix()
        most = 2 if name.startswith(tuple(f"{folder}/" for folder in TWO_ALLOWED)) else 1
        lines += [f"{name}:{line}" for line in packed(file.read_text(), most)]
    assert lines == []


def test_packed_assignments_are_found() -> None:
    for source in ("a, b = 1, 2", "[a, b, c] = x, y, z", "a, *b = 1, 2, 3", "a, b = b, a + b"):
        assert packed(source) == [1], source
    for source in ("a, b = b, a", "x[i], x[j] = x[j], x[i]", "a, b = f(1, 2)", "a = 1, 2, 3"):
        assert packed(source) == [], source
