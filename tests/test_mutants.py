"""Mutants: where the source can be changed, which changes are drawn, and what judges them."""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path

import pytest

from instruments.__main__ import main
from instruments.mutants import targets
from instruments.mutants.operators import edits_of, is_mutant
from instruments.mutants.targets import GROUPS, Group, draw_mutants
from tests.in_process import jobs_in_process

ROOT = Path(__file__).parents[1]
LIBRARY = """\
def clip(x: float, limit: float = 2.0) -> float:
    \"\"\"Return x within limits, by 1 + 1.\"\"\"
    if x > limit:
        return limit
    return x + 0
"""
TESTS = """\
from library.clipping import clip

def test_clip():
    assert clip(1.0, 2.0) == 1.0
    assert clip(4.0, 2.0) == 2.0
"""


def mutated(source: str) -> list[str]:
    """Return the sources of all mutants."""
    return [edit.apply(source) for edit in edits_of(source) if is_mutant(source, edit)]


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("a = b + c", ["a = b - c"]),
        ("a = (b) // (c)", ["a = (b) * (c)"]),
        ("a = b ** c", ["a = b * c"]),
        ("a -= b", ["a += b"]),
        ("a = b < c", ["a = b <= c"]),
        ("a = b is not c", ["a = b is c"]),
        ("a = b not in c", ["a = b in c"]),
        ("a = b <= c == d", ["a = b < c == d", "a = b <= c != d"]),
        ("a = b and c or d", ["a = b or c or d", "a = b and c and d"]),
        ("a = not b", ["a = b"]),
        ("a = -b", ["a = b"]),
        ("a = 3", ["a = 4"]),
        ("a = 0.0", ["a = 1.0"]),
        ("a = 0.3", ["a = 0.6"]),
        ("a = True", ["a = False"]),
        ("a = b if c else d", ["a = b if (not (c)) else d"]),
        ("if a:\n    b(c)", ["if (not (a)):\n    b(c)", "if a:\n    pass"]),
        ("if a:\n    raise E(f'{1 + 1}', 2)", ["if (not (a)):\n    raise E(f'{1 + 1}', 2)",
                                               "if a:\n    pass"]),
        ("é = 'ü' + b", ["é = 'ü' - b"]),
        # Types, decorators, docstrings and messages stay.
        ('"""A docstring of 1 + 1."""', []),
        ("a: Literal[1]", []),
        ("@cache(1)\ndef f(a: int) -> int:\n    return a", []),
        ("class A(B[1]):\n    pass", []),
        ("a = f'{b + 1}'", []),
        ("a = zip(b, c, strict=True)", []),
    ],
)  # fmt: skip
def test_every_place_has_its_mutants(source: str, expected: list[str]) -> None:
    assert [text.replace("a =  b", "a = b") for text in mutated(source)] == expected


def test_every_mutant_of_the_project_can_be_read() -> None:
    mutants = draw_mutants(ROOT, list(GROUPS), 20, 0)
    assert [mutant.group for mutant in mutants[:4]] == [*GROUPS, "physics"]
    assert len(set(mutants)) == 20
    for mutant in mutants:
        source = (ROOT / mutant.path).read_text(encoding="utf-8")
        assert mutant.edit is not None
        ast.parse(mutant.edit.apply(source))
        lines = mutant.edit.diff(source, mutant.path).splitlines()
        assert any(line.startswith("+") for line in lines[2:])


def test_a_larger_count_has_the_mutants_of_a_smaller_one() -> None:
    few = draw_mutants(ROOT, ["damage"], 5, 3)
    assert draw_mutants(ROOT, ["damage"], 9, 3)[:5] == few
    assert draw_mutants(ROOT, ["damage"], 5, 4) != few


def test_the_tests_of_the_groups_are_there() -> None:
    for group in GROUPS.values():
        for test in group.tests:
            assert (ROOT / test.partition("::")[0]).exists(), test
        for name in group.left_out:
            assert (ROOT / group.folder / name).is_file(), name


@pytest.fixture
def clone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a clone of a small project, whose files are the only group."""
    root = tmp_path / "clone"
    files = {
        "library/__init__.py": "",
        "library/clipping.py": LIBRARY,
        "tests/test_clipping.py": TESTS,
        "pytest.ini": "[pytest]\nmarkers =\n    slow: slow\n",
    }
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=root, check=True)
    subprocess.run(["git", "add", "."], cwd=root, check=True)
    group = Group("library", (), ("tests/test_clipping.py",))
    monkeypatch.setattr(targets, "GROUPS", {"library": group})
    monkeypatch.setattr("instruments.mutants.command.GROUPS", {"library": group})
    return root


def run(clone: Path, *words: str) -> int:
    out = clone.parent / "out"
    return main(["mutants", "--repository", str(clone), "--out", str(out), *words])


@pytest.mark.slow
@jobs_in_process()
def test_survivors_are_reported_and_judged_again(
    clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(clone, "--count", "2", "--seed", "1") == 0
    assert run(clone, "--count", "9", "--seed", "1") == 0
    said = capsys.readouterr().out
    report = (clone.parent / "out" / "report.md").read_text()
    # The default is not tested, nor what happens at the limit; + and - of 0 are the same.
    survived = ["2.0 becomes 4.0", "> becomes >=", "+ becomes -"]
    for what in survived:
        assert what in said
        assert what in report
    assert "-    return x + 0\n+    return x - 0\n" in report
    assert "| library | 5 | 2 | 0 | 3 | 40% |" in report
    tests = clone / "tests" / "test_clipping.py"
    tests.write_text(TESTS + "    assert clip(3.0) == 2.0\n")
    assert run(clone, "--count", "9", "--seed", "1", "--survivors") == 0
    report = (clone.parent / "out" / "report.md").read_text()
    assert "| library | 5 | 3 | 0 | 2 | 60% |" in report


@jobs_in_process()
def test_a_project_whose_tests_fail_is_refused(
    clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (clone / "tests" / "test_clipping.py").write_text("def test_no():\n    assert False\n")
    assert run(clone, "--count", "1") == 1
    assert "the tests fail without a mutant" in capsys.readouterr().err
