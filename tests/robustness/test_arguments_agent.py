"""Each argument of the agent that models itself refuses values of a wrong kind by its name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from strange_values import Call, cases, complaints, has_every_parameter, options

from aquafish.online import AgentConfig, SelfModelAgent
from aquafish.online.gaits import load_library
from aquafish_gym import Damage, Morphology
from aquafish_gym.scenario import Scenario
from gait.film import filmed
from gait.rollout import swim

ROBOT = Scenario.create()
LIBRARY = load_library()[:1]
AGENT = SelfModelAgent(LIBRARY)
AGENT.begin(np.zeros(3))
BODY = Morphology.nominal()
ROWS = [
    Call(
        SelfModelAgent,
        {"library": LIBRARY, "config": AgentConfig(), "robot": ROBOT, "hold": 20},
        options(library="none", config="none", robot="none"),
    ),
    Call(AGENT.begin, {"fin_angles": np.zeros(3)}, options(fin_angles="none")),
    Call(AGENT.reset, {"info": {"fin_angles": np.zeros(3)}}),
    Call(
        AgentConfig,
        {
            "seconds": 60.0, "gyro_noise": 0.0, "gyro_only": False, "inferences": (3,),
            "refinements": 1, "generations": 1, "inference_seconds": 0.4,
            "refinement_seconds": 1.2, "seed": 0,
        },
        options(
            seconds="fraction, big", gyro_noise="fraction, big", gyro_only="true",
            inferences="empty list", refinements="big, huge", generations="big, huge",
            inference_seconds="fraction, big", refinement_seconds="fraction, big",
            seed="big, huge",
        ),
    ),
    Call(
        filmed,
        {
            "label": "rest", "swim": swim(LIBRARY[0], BODY, engine="numba", seconds=0.2),
            "body": BODY, "damage": Damage(),
        },
        options(label="text, empty text"),
        {"body": "body"},
    ),
]  # fmt: skip


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
