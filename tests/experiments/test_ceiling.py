"""The ceiling of the league: it searches a gait for what broke, and swims as it predicts."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from aquafish.online.gaits import imagine, load_library
from aquafish_gym.damage import Damage
from aquafish_gym.physics.layout import layout
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import Scenario
from experiments.league import ceiling
from experiments.league.entrants import ENTRANTS

pytestmark = pytest.mark.usefixtures("small_search")


@pytest.fixture
def small_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a search take a second."""
    for name, value in (
        ("RANDOM_NETWORKS", 64), ("RANDOM_STARTS", 2), ("LIBRARY_STARTS", 2),
        ("STAGES", ((10, 2), (3, 10))),
    ):  # fmt: skip
        monkeypatch.setattr(ceiling, name, value)


def test_a_search_finds_more_than_the_library_and_repeats() -> None:
    robot = Damage.parse("right_pectoral:missing").edit(Scenario.create())
    state = layout(AQUAFISH).start(np.array([[0.3, -0.5, 1.0]]))[:, 0]
    library = load_library()
    gait, far = ceiling.search_gait(library, robot, state, 20.0, seed=3)
    recurrent = [one for one in library if one.memory]
    assert far > imagine(recurrent, robot, state, 20.0).max() + 0.1
    assert imagine([gait], robot, state, 20.0)[0] == far
    again, as_far = ceiling.search_gait(library, robot, state, 20.0, seed=3)
    assert as_far == far
    assert (again.weights == gait.weights).all()
    other, _ = ceiling.search_gait(library, robot, state, 20.0, seed=4)
    assert (other.weights != gait.weights).any()


def test_the_ceiling_swims_as_the_oracle_until_something_breaks_and_then_as_it_predicts() -> None:
    env = gym.make(
        "AquaFishRecovery-v0", damage="gyro:noise=0.01; caudal:missing@15", engine="numba"
    )
    swum: dict[str, list[Any]] = {}
    ways: dict[str, float] = {}
    for name in ("oracle", "ceiling"):
        observation, info = env.reset(seed=1)
        agent: Any = ENTRANTS[name].make(generations=5, refinements=0, gyro_noise=0.01, seed=2)
        agent.begin(info["fin_angles"])
        missing = info["morphology"]
        onset = 0.0
        swum[name] = []
        for _ in range(300):
            swum[name].append(agent.act(observation))
            observation, *_, info = env.step(swum[name][-1])
            if (info["morphology"] != missing).any():
                missing = info["morphology"]
                onset = info["y_position"]
                agent.learn(info)
        ways[name] = info["y_position"] - onset
    np.testing.assert_array_equal(swum["oracle"][:75], swum["ceiling"][:75])
    events = {event.what: event for event in agent.events}
    assert events["searched"].seconds == events["chose"].seconds == pytest.approx(15.0)
    predicted = float(events["chose"].about.split()[-2])
    assert ways["ceiling"] == pytest.approx(predicted, rel=0.02)
    assert ways["ceiling"] > ways["oracle"]
