"""The entrants of the recovery league: agents that play one episode at a time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from aquafish.online.agent import AgentConfig, SelfModelAgent
from aquafish.online.gaits import load_library
from aquafish_gym.scenario import Scenario
from eea.core.angles import Floats
from gait.controller import Controller


class Entrant(Protocol):
    """An agent in one episode."""

    def begin(self, fin_angles: ArrayLike) -> None: ...
    def act(self, observation: ArrayLike) -> ArrayLike: ...


class FixedGait:
    """One controller throughout, which knows the initial fin angles."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller

    def begin(self, fin_angles: ArrayLike) -> None:
        """Begin an episode."""
        self._policy, self._steps = self._controller.policy(fin_angles), 0

    def act(self, observation: ArrayLike) -> ArrayLike:
        """Return the gait's action."""
        action = self._policy(np.asarray(observation, float), 0.2 * self._steps)
        self._steps += 1
        return action


class Still:
    """No servo moves."""

    def begin(self, fin_angles: ArrayLike) -> None:
        """Begin an episode."""

    def act(self, observation: ArrayLike) -> ArrayLike:  # noqa: ARG002
        """Hold every servo."""
        return (0.0, 0.0, -1.0)


class Oracle(SelfModelAgent):
    """The agent that learns the truth about its body and servos at the onset."""

    truth: Scenario | None = None

    def learn(self, info: dict[str, Any]) -> None:
        """Become the robot that ``info`` describes, from the next action on."""
        fields = {"body": info["morphology"][None], "servo_gain": info["servo_gain"][None]}
        self.truth = Scenario.fill(fields, self.model.robot.reactive)

    def _observe(self, observed: Floats) -> None:
        super()._observe(observed)
        if self.truth is not None:
            self.become(self.truth)
            self.truth = None


def _agent(kind: type[SelfModelAgent], noise: float, **settings: Any) -> SelfModelAgent:
    return kind(config=AgentConfig(gyro_noise=noise, **settings))


def _gait(number: int, _noise: float) -> FixedGait:
    return FixedGait(load_library()[number])


_FREE: dict[str, Any] = {"inference_seconds": 0.0, "refinement_seconds": 0.0}
ENTRANTS: dict[str, Callable[[float], Entrant]] = {
    "still": lambda _: Still(),
    "CMA-ES, fins": partial(_gait, 1),
    "PPO, fins": partial(_gait, 0),
    "self-model": partial(_agent, SelfModelAgent),
    "self-model, library only": lambda noise: _agent(SelfModelAgent, noise, generations=0),
    "self-model, gyroscope alone": lambda noise: _agent(SelfModelAgent, noise, gyro_only=True),
    "self-model, thinking free": lambda noise: _agent(SelfModelAgent, noise, **_FREE),
    "oracle": lambda noise: _agent(Oracle, noise, **_FREE),
}
