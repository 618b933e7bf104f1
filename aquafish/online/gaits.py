"""Gaits on the self-model: which swims farthest from its very state, and the one being swum."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish.online.self_model import SelfModel, imu_readings, predict
from aquafish_gym.physics.arithmetic import TAU
from aquafish_gym.physics.layout import FIELDS, angles_of_rows
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.storage import read_document, read_packaged
from aquafish_gym.world_config import WorldConfig
from gait.controllers.controller import Controller, program_of
from gait.scores.fitness import swim_scores

LIBRARY_SCHEMA = "aquafish.library/1"
MAXIMUM_REFINED_NODES = 30  # nodes of a network that CMA-ES refines in a second


def read_library(path: Path | None = None) -> dict[str, Any]:
    """Return the content of a library: its ``gaits``, and what they took, ``offline``.

    It is the packaged one for None. ``experiments.gaits.library`` made that.
    """
    if path is not None:
        return read_document(path, LIBRARY_SCHEMA, "library")
    return read_packaged("aquafish.online", "library.json", LIBRARY_SCHEMA)


def load_library(path: Path | None = None) -> list[Controller]:
    """Return the gaits of a library: two for the whole robot, then those for broken ones."""
    return [Controller.from_dict(one) for one in read_library(path)["gaits"]]


def imagine(
    controllers: Sequence[Controller], robot: Scenario, state: Floats, seconds: float
) -> Floats:
    """Return how far (P,) controllers would swim along +y from a state (25,), in units.

    ``robot`` is a scenario of one. The controllers know its fin angles and servo gains.
    """
    world = WorldConfig.of(robot)
    far = swim_scores(
        controllers, robot.body[0], seconds=seconds, world=world, threads=1, start=state
    )
    return far[:, 0]


class Swimming:
    """A gait that a robot swims, beginning now, with the fin angles that its self-model has."""

    def __init__(self, gait: Controller, hold: int) -> None:
        program = program_of([gait])
        self.gait = gait
        self._function = program.function
        self._dt = hold * TIMESTEP
        self._network = program.weights[:, 0].tolist(), program.layout.tolist()
        self._memory, self._actions = [0.0] * program.scratch, 0

    def act(self, state: Floats) -> NDArray[np.float32]:
        """Return the next action (3,), in [-1, 1], in a state (25,)."""
        self._actions += 1
        return self._act(state, self._memory, self._actions - 1)

    def ahead(self, model: SelfModel, actions: int, until: int) -> tuple[Floats, float]:
        """Return the state (25,) after some actions, and the way from there until another, units.

        Both are counted from now.
        """
        memory = list(self._memory)
        y = FIELDS["position"].start + 1
        state = then = model.state
        for k in range(until):
            if k <= actions:
                then = state
            action = self._act(state, memory, self._actions + k).astype(float)
            state = predict(model.robot, state, action[None], model.hold)[1][:, 0]
        return then, float(state[y] - then[y])

    def _act(self, state: Floats, memory: list[float], number: int) -> NDArray[np.float32]:
        seen, seconds = imu_readings(state[:, None])[0].tolist(), number * self._dt
        fins = (angles_of_rows(state) / TAU).tolist()
        action = self._function(
            *self._network, memory, 0, 1, seconds, seen[:3], seen[3:6], seen[6:], fins, [0.0] * 3
        )
        return np.clip(np.asarray(action, np.float32), -1.0, 1.0)
