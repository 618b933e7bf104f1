"""The gait that an agent swims: it is chosen by imagination, and refined meanwhile."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from aquafish.online import thresholds
from aquafish.online.belief import Event, Thought, Water, thinking_actions
from aquafish.online.config import AgentConfig
from aquafish.online.gaits import (
    Ahead,
    ControllerGait,
    Effort,
    Gait,
    Swimmer,
    imagine_gaits,
    refine_gait,
    swim_ahead,
)
from aquafish.online.self_model import SelfModel
from aquafish.online.teacher import Teacher
from aquafish.online.teacher_gait import TeacherGait
from aquafish_gym.scenario import Scenario
from gait.controllers.controller import Controller

Kind = TypeVar("Kind", bound=Gait)


class GaitChooser:
    """The gait that is swum in an episode; it begins with the first of a library.

    Parameters
    ----------
    library
        Gaits.
    teachers
        For the model's water and for any water; or none.
    config
        Settings.
    dt
        For how long, s, an action is held.
    events
        The agent's, to which it adds what it decides.

    Attributes
    ----------
    until
        When the episode ends, s since it began; at first ``config.seconds``.
    action
        (F,) the last one; 0 without one.
    """

    def __init__(
        self,
        library: Sequence[Controller],
        teachers: Sequence[Teacher],
        config: AgentConfig,
        dt: float,
        events: list[Event],
    ) -> None:
        self.library = [ControllerGait(one, f"gait {i}") for i, one in enumerate(library)]
        self.teachers = teachers
        self.config = config
        self.until = config.seconds
        self.dt = dt
        self.events = events
        self.refined: deque[Gait] = deque(maxlen=thresholds.REFINED_GAITS)
        self.action: NDArray[np.float32] = np.zeros(len(library[0].plan.fins), np.float32)
        self._rng = np.random.default_rng(config.seed)
        self._rounds = 0
        self._efforts: list[Effort] = []  # of the refinements to come of both kinds of gaits
        self._thought: Thought[list[Gait]] | None = None

    @property
    def gait(self) -> Gait:
        """What is swum."""
        return self._swimming.gait

    def begin(self, model: SelfModel) -> None:
        """Begin the library's first gait."""
        self.swim(self.library[0], model)

    def swim(self, gait: Gait, model: SelfModel) -> None:
        """Swim a gait from now on."""
        self._swimming: Swimmer = gait.begin(model.robot, self.action)

    def act(self, model: SelfModel) -> NDArray[np.float32]:
        """Return the next action (F,), in [-1, 1], of a robot in its present state."""
        self.action = self._swimming.act(model.robot, model.state)
        return self.action

    def use_refined(self, model: SelfModel, step: int) -> None:
        """Use a refinement that is due at a step, and begin the next one."""
        thought = self._thought
        if thought is None or thought.due > step:
            return
        self._thought = None
        self.events.append(thought.event)
        best = thought.result[0]
        self.refined.extend(gait for gait in thought.result[::-1] if gait is not self.gait)
        if best is not self.gait:
            self.swim(best, model)
        self._refine(model, step)

    def return_to(self, gait: Gait, model: SelfModel) -> None:
        """Swim a gait that was swum before, and refine nothing."""
        self._thought = None
        self._rounds = 0
        self._efforts = []
        if gait is not self.gait:
            self.swim(gait, model)

    def change(self, model: SelfModel, step: int, water: Water, soon: bool) -> None:
        """Swim the best known gait from a step on, and refine it meanwhile.

        Something broke, and a better gait is needed ``soon``. In foreign water no gait is refined:
        a gait refined on a wrong model does not carry over to the robot.
        """
        seconds = self._left(step)
        if seconds < self.dt:
            return
        self.events.append(self._choose(model, step, seconds, water, least_gain=0.0))
        config = self.config
        self._rounds = 0 if water.foreign else config.refinements
        self._efforts = []
        if soon:
            self._efforts.append(
                Effort(
                    config.quick_generations, config.quick_teacher_generations, config.quick_seconds
                )
            )
        if self.teachers:
            self._efforts.append(
                Effort(config.generations, config.teacher_generations, config.both_seconds)
            )
        self._refine(model, step)

    def choose_again(self, model: SelfModel, step: int) -> None:
        """In foreign water that the model predicts, change the gait every now and then."""
        seconds = min(thresholds.AHEAD_SECONDS, self.until - step * self.dt)
        if (
            step % max(1, round(thresholds.CHOOSE_AGAIN_SECONDS / self.dt))
            or seconds < thresholds.SHORTEST_SWIM_SECONDS
        ):
            return
        swum = self._swimming
        event = self._choose(model, step, seconds, Water(foreign=True), thresholds.LEAST_GAIN)
        if self._swimming is not swum:
            self.events.append(event)

    def _choose(
        self, model: SelfModel, step: int, seconds: float, water: Water, least_gain: float
    ) -> Event:
        """Swim what is imagined to swim farthest; a change must gain a share of the way."""
        began = time.process_time()
        gaits = [gait for kind in self._known(water) for gait in kind]
        far = imagine_gaits(gaits, model.robot, model.state, seconds, self.action)
        going_on = swim_ahead(self._swimming, model, 0, seconds).way
        about = f"to go on, which should make {going_on:.1f} units"
        needed = least_gain * abs(going_on)
        best = int(far.argmax())
        if far[best] > going_on + needed:
            about = f"{gaits[best].name}, which should make {far[best]:.1f} units"
            self.swim(gaits[best], model)
        return Event(step * self.dt, "chose", about, time.process_time() - began)

    def _known(self, water: Water) -> list[Sequence[Gait]]:
        """Return the gaits that can be chosen, those of each kind in a list.

        They are as made, and as refined since. In foreign water a teacher has its own.
        """
        controllers = [*self.library, *self._refined_of(ControllerGait)]
        if not self.teachers or not water.predicted:
            return [controllers]
        if water.foreign:
            taught = [TeacherGait.of(self.teachers[-1])]
        else:
            taught = [TeacherGait.of(self.teachers[0]), *self._refined_of(TeacherGait)]
        return [controllers, [phase for gait in taught for phase in gait.phases()]]

    def _refined_of(self, kind: type[Kind]) -> list[Kind]:
        """Return the refined gaits of a kind."""
        return [gait for gait in self.refined if isinstance(gait, kind)]

    def _left(self, step: int) -> float:
        """Return for how long, s, gaits are compared that begin at a step."""
        return min(self.until - step * self.dt, thresholds.LONGEST_COMPARISON_SECONDS)

    def _refine(self, model: SelfModel, step: int) -> None:
        """Begin to refine the gait, from the state that the robot will be in when that is done.

        At first after a change both a small gait and the teacher are refined, then what is swum.
        """
        began = time.process_time()
        self._thought = None
        config = self.config
        effort = Effort(
            config.generations, config.teacher_generations, config.refinement_seconds, every=False
        )
        if self._efforts:
            effort = self._efforts[0]
        actions = thinking_actions(effort.seconds, self.dt)
        left = self._left(step + actions)
        if not self._rounds or left < thresholds.SHORTEST_SWIM_SECONDS:
            return
        self._rounds -= 1
        self._efforts = self._efforts[1:]
        ahead = swim_ahead(self._swimming, model, actions, left)
        found: list[tuple[Gait, float]] = [(self.gait, ahead.way)]
        swum = self._swimming.after(actions)
        for first in self._to_refine(swum, model.robot, ahead, effort.every):
            found.append(refine_gait(first, model.robot, ahead, effort, self._rng))
        found.sort(key=lambda one: -one[1])
        about = f"from {ahead.way:.1f} to {found[0][1]:.1f} units"
        event = Event(step * self.dt, "refined", about, time.process_time() - began)
        # Of both kinds the lesser one stays, too: it may be refined, or chosen after a next change.
        kept = found if effort.every else found[:1]
        self._thought = Thought(step + actions, event, [gait for gait, _ in kept])

    def _to_refine(self, swum: Gait, robot: Scenario, begin: Ahead, every: bool) -> list[Gait]:
        """Return a gait of the kind that is swum, or one of ``every`` kind.

        It is what is swum; if that is of another kind, or too large, the best that is not.
        """
        found = []
        for known in self._known(Water()):
            is_swum = type(swum) is type(known[0])
            if not (every or is_swum):
                continue
            small = [gait for gait in known if gait.refinable]
            if is_swum and swum.refinable:
                found.append(swum)
            elif small:
                far = imagine_gaits(small, robot, begin.state, begin.seconds, begin.action)
                found.append(small[int(far.argmax())])
        return found
