"""The gait that an agent swims: it is chosen by imagination, and refined meanwhile."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from aquafish.online.config import AgentConfig
from aquafish.online.gaits import act_in, begin_gait, gait_to_refine, imagine, swim_ahead
from aquafish.online.self_model import SelfModel
from aquafish.online.thinking import Event, Thought, thinking_actions
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.world_config import WorldConfig
from gait.controllers.controller import Controller
from gait.search.evolve import EvolveConfig, evolve_gait

SHORTEST_REFINEMENT_SECONDS = 2.0
LONGEST_COMPARISON_SECONDS = 60.0  # a longer one does not end within the time for thinking
REFINED_GAITS = 6  # of its own, the latest, among which it chooses beside the library's


class GaitChooser:
    """The gait that is swum in an episode; it begins with the first of a library.

    Parameters
    ----------
    library
        Gaits.
    config
        Settings.
    dt
        For how long, s, an action is held.
    events
        The agent's, to which it adds what it decides.
    """

    def __init__(
        self, library: Sequence[Controller], config: AgentConfig, dt: float, events: list[Event]
    ) -> None:
        self.library = library
        self.config = config
        self.dt = dt
        self.events = events
        self.refined: deque[Controller] = deque(maxlen=REFINED_GAITS)
        self._rng = np.random.default_rng(config.seed)
        self._rounds = 0
        self._thought: Thought[Controller] | None = None
        self.begin()

    @property
    def gait(self) -> Controller:
        """The controller that is swum."""
        return self._swimming.controller

    @property
    def gaits(self) -> list[Controller]:
        """The gaits that can be chosen: the library's, and those refined in this episode."""
        return [*self.library, *self.refined]

    def begin(self) -> None:
        """Begin the library's first gait."""
        self._swimming = begin_gait(self.library[0])

    def act(self, state: Floats) -> NDArray[np.float32]:
        """Return the next action (3,), in [-1, 1], in a state (25,)."""
        return act_in(self._swimming, state)

    def use_refined(self, model: SelfModel, step: int) -> None:
        """Use a refinement that is due at a step, and begin the next one."""
        thought = self._thought
        if thought is None or thought.due > step:
            return
        self._thought = None
        self.events.append(thought.event)
        if thought.result is not self.gait:
            self._swimming = begin_gait(thought.result)
            self.refined.append(thought.result)
        self._refine(model, step)

    def change(self, model: SelfModel, step: int, foreign: bool) -> None:
        """Swim the best known gait from a step on, and refine it meanwhile.

        In ``foreign`` water no gait is refined: a gait refined on a wrong model does not carry over
        to the robot.
        """
        began = time.process_time()
        left = self._left(step)
        if left < self.dt:
            return
        gaits = self.gaits
        far = imagine(gaits, model.robot, model.state, left)
        _, going_on = swim_ahead(self._swimming, model, 0, round(left / self.dt))
        about = f"to go on, which should make {going_on:.1f} units"
        if far.max() > going_on:
            best = int(far.argmax())
            self._swimming = begin_gait(gaits[best])
            name = f"gait {best}" if best < len(self.library) else "a gait refined before"
            about = f"{name}, which should make {far.max():.1f} units"
        self.events.append(Event(step * self.dt, "chose", about, time.process_time() - began))
        self._rounds = 0 if foreign else self.config.refinements
        self._refine(model, step)

    def _left(self, step: int) -> float:
        """Return for how long, s, gaits are compared that begin at a step."""
        return min(self.config.seconds - step * self.dt, LONGEST_COMPARISON_SECONDS)

    def _refine(self, model: SelfModel, step: int) -> None:
        """Begin to refine the gait, from the state that the robot will be in when that is done."""
        began = time.process_time()
        config = self.config
        robot = model.robot
        self._thought = None
        actions = thinking_actions(config.refinement_seconds, self.dt)
        left = self._left(step + actions)
        if not self._rounds or left < SHORTEST_REFINEMENT_SECONDS:
            return
        self._rounds -= 1
        until = actions + round(left / self.dt)
        state, expected = swim_ahead(self._swimming, model, actions, until)
        first = gait_to_refine(self.gait, self.gaits, robot, state, left)
        if first is None:
            return
        found = evolve_gait(
            robot.body[0],
            EvolveConfig(
                generations=config.generations,
                seconds=left,
                seed=int(self._rng.integers(2**32)),
                threads=1,
            ),
            first=first,
            start=state,
            world=WorldConfig.of(robot),
        )
        about = f"from {expected:.1f} to {found.fitness:.1f} units"
        better = found.controller if found.fitness > expected else self.gait
        event = Event(step * self.dt, "refined", about, time.process_time() - began)
        self._thought = Thought(step + actions, event, better)
