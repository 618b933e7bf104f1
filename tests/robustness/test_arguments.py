"""Each argument of the public functions refuses values of a wrong kind by its name.

The tables ``arguments_*.py`` hold the functions, with arguments with which they work.
"""

from __future__ import annotations

import inspect
from importlib import import_module
from pathlib import Path

import pytest
from strange_values import Call, cases, complaints, has_every_parameter

import aquafish.online
import aquafish_gym
import eea
import gait

TABLES = sorted(path.stem for path in Path(__file__).parent.glob("arguments_*.py"))
ROWS: list[Call] = [row for table in TABLES for row in import_module(table).ROWS]
#: What functions return, protocols, errors, and what takes no argument.
WITHOUT = {
    "Agent", "ConfigurationError", "Dimension", "Evaluation", "Evolved", "ImuLog", "LogCheck",
    "MorphologyEstimate", "Performed", "RecordedLog", "Result",
    "RevealingTarget", "Simulator", "Swim", "Target", "TargetError", "Trials", "fish_problem",
}  # fmt: skip


@pytest.mark.parametrize(("call", "argument"), cases(ROWS))
def test_strange_values_are_refused_by_the_arguments_name(
    call: Call, argument: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert not complaints(call, argument)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("call", ROWS, ids=lambda call: call.name)
def test_row_has_every_parameter(call: Call) -> None:
    assert has_every_parameter(call)


@pytest.mark.parametrize("package", [aquafish_gym, aquafish.online, eea, gait])
def test_every_public_function_has_a_row(package: object) -> None:
    rows = {row.name.partition(".")[0] for row in ROWS}
    names = getattr(package, "__all__")  # noqa: B009
    public = {name for name in names if callable(getattr(package, name))}
    functions = {name for name in public if not inspect.ismodule(getattr(package, name))}
    assert functions - rows - WITHOUT == set()
    assert not rows & WITHOUT - {"MorphologyEstimate", "Result"}
