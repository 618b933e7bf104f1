"""Every public function has a row in the tables of arguments."""

from __future__ import annotations

import inspect

import pytest
import test_arguments
import test_arguments_agent
import test_arguments_eea
import test_arguments_fish
import test_arguments_gym

import aquafish.online
import aquafish_gym
import eea
import gait

TABLES = (
    test_arguments, test_arguments_agent, test_arguments_eea, test_arguments_fish,
    test_arguments_gym,
)  # fmt: skip
#: What functions return, protocols, errors, and what takes no argument.
WITHOUT = {
    "ConfigurationError", "ControllerLike", "Dimension", "Evaluation", "Evolved", "HasPolicy",
    "ImuLog", "LogCheck", "MorphologyEstimate", "Performed", "Policy", "RecordedLog", "Result",
    "RevealingTarget", "Simulator", "Swim", "Target", "TargetError", "Trials", "fish_problem",
}  # fmt: skip


@pytest.mark.parametrize("package", [aquafish_gym, aquafish.online, eea, gait])
def test_every_public_function_has_a_row(package: object) -> None:
    rows = {row.name.partition(".")[0] for table in TABLES for row in table.ROWS}
    names = getattr(package, "__all__")  # noqa: B009
    public = {name for name in names if callable(getattr(package, name))}
    functions = {name for name in public if not inspect.ismodule(getattr(package, name))}
    assert functions - rows - WITHOUT == set()
    assert not rows & WITHOUT - {"MorphologyEstimate", "Result"}
