"""The gait that an agent swims: it is chosen by imagination, and refined meanwhile."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aquafish.online import thresholds
from aquafish.online.belief import Water
from aquafish.online.config import AgentConfig
from aquafish.online.gaits import gait_to_refine, imagine
from aquafish.online.self_model import SelfModel
from aquafish.online.swimming import Ahead, Gait, Swimmer, act_in, begin_gait, swim_ahead
from aquafish.online.teacher import Teacher
from aquafish.online.teacher_gait import TeacherAgent, TeacherGait, imagine_teacher, refine_teacher
from aquafish.online.thinking import Event, Thought, thinking_actions
from aquafish_gym.world_config import WorldConfig
from gait.controllers.controller import Controller
from gait.search.evolve import EvolveConfig, evolve_gait


class _Effort(NamedTuple):
    """How long a refinement may search, and what thinking time it is charged."""

    generations: int
    teacher_generations: int
    seconds: float


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
        (3,) the last one; 0 without one.
    """

    def __init__(
        self,
        library: Sequence[Controller],
        teachers: Sequence[Teacher],
        config: AgentConfig,
        dt: float,
        events: list[Event],
    ) -> None:
        self.library = library
        self.teachers = teachers
        self.config = config
        self.until = config.seconds
        self.dt = dt
        self.events = events
        self.refined: deque[Gait] = deque(maxlen=thresholds.REFINED_GAITS)
        self.action: NDArray[np.float32] = np.zeros(3, np.float32)
        self._rng = np.random.default_rng(config.seed)
        self._rounds = 0
        self._efforts: list[_Effort] = []  # of the refinements to come of both kinds of gaits
        self._thought: Thought[list[Gait]] | None = None

    @property
    def gait(self) -> Gait:
        """What is swum."""
        return self._swimming.controller

    def begin(self, model: SelfModel) -> None:
        """Begin the library's first gait."""
        self._swimming: Swimmer = begin_gait(self.library[0], model.robot, self.action)

    def swim(self, gait: Gait, model: SelfModel) -> None:
        """Swim a gait from now on."""
        self._swimming = begin_gait(gait, model.robot, self.action)

    def act(self, model: SelfModel) -> NDArray[np.float32]:
        """Return the next action (3,), in [-1, 1], of a robot in its present state."""
        self.action = act_in(self._swimming, model.robot, model.state)
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
                _Effort(
                    config.quick_generations, config.quick_teacher_generations, config.quick_seconds
                )
            )
        if self.teachers:
            self._efforts.append(
                _Effort(config.generations, config.teacher_generations, config.both_seconds)
            )
        self._refine(model, step)

    def choose_again(self, model: SelfModel, step: int) -> None:
        """In foreign water that the model predicts, change the gait every now and then."""
        seconds = min(thresholds.AHEAD_SECONDS, self.until - step * self.dt)
        if (
            step % max(1, round(thresholds.CHOOSE_AGAIN_SECONDS / self.dt))
            or seconds < thresholds.SHORTEST_AHEAD_SECONDS
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
        gaits: list[Gait] = [*self._controllers()]
        far = imagine(self._controllers(), model.robot, model.state, seconds)
        if taught := self._teacher_gaits(water):
            taught_far = imagine_teacher(taught, model.robot, model.state, seconds, self.action)
            gaits += taught
            far = np.concatenate([far, taught_far])
        going_on = swim_ahead(self._swimming, model, 0, round(seconds / self.dt)).way
        about = f"to go on, which should make {going_on:.1f} units"
        needed = least_gain * max(thresholds.SLOW_SPEED * seconds, abs(going_on))
        best = int(far.argmax())
        if far[best] > going_on + needed:
            about = f"{self._name(best)}, which should make {far[best]:.1f} units"
            self.swim(gaits[best], model)
        return Event(step * self.dt, "chose", about, time.process_time() - began)

    def _controllers(self) -> list[Controller]:
        """Return the controllers that can be chosen: the library's, and those refined since."""
        return [*self.library, *(g for g in self.refined if isinstance(g, Controller))]

    def _teacher_gaits(self, water: Water) -> list[TeacherGait]:
        """Return the teacher's gaits that can be chosen: as trained, and those refined since."""
        if not self.teachers or not water.predicted:
            return []
        if water.foreign:
            return TeacherGait.of(self.teachers[-1]).phases()
        refined = [gait for gait in self.refined if isinstance(gait, TeacherGait)]
        gaits = [TeacherGait.of(self.teachers[0]), *refined]
        return [phase for gait in gaits for phase in gait.phases()]

    def _name(self, number: int) -> str:
        """Return what a gait is called, by its number among those that can be chosen."""
        if number < len(self.library):
            return f"gait {number}"
        if number < len(self._controllers()):
            return "a gait refined before"
        return "the teacher"

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
        effort = _Effort(config.generations, config.teacher_generations, config.refinement_seconds)
        both = bool(self._efforts)
        if both:
            effort = self._efforts[0]
        actions = thinking_actions(effort.seconds, self.dt)
        left = self._left(step + actions)
        if not self._rounds or left < thresholds.SHORTEST_REFINEMENT_SECONDS:
            return
        self._rounds -= 1
        self._efforts = self._efforts[1:]
        ahead = swim_ahead(self._swimming, model, actions, actions + round(left / self.dt))
        taught = isinstance(self.gait, TeacherGait)
        found: list[tuple[Gait, float]] = [(self.gait, ahead.way)]
        if both or not taught:
            found += self._refine_controller(model, ahead, left, effort)
        if taught or (both and self.teachers):
            sigma = thresholds.TEACHER_FIRST_SIGMA if both else thresholds.TEACHER_LATER_SIGMA
            found.append(self._refine_teacher(model, ahead, left, effort, actions, sigma))
        found.sort(key=lambda one: -one[1])
        about = f"from {ahead.way:.1f} to {found[0][1]:.1f} units"
        event = Event(step * self.dt, "refined", about, time.process_time() - began)
        # Of both kinds the lesser one stays, too: it may be refined, or chosen after a next change.
        kept = found if both else found[:1]
        self._thought = Thought(step + actions, event, [gait for gait, _ in kept])

    def _refine_controller(
        self, model: SelfModel, ahead: Ahead, seconds: float, effort: _Effort
    ) -> list[tuple[Gait, float]]:
        """Return a small gait, refined, and its way; nothing if there is none."""
        robot = model.robot
        swum = self.gait if isinstance(self.gait, Controller) else None
        first = gait_to_refine(swum, self._controllers(), robot, ahead.state, seconds)
        if first is None:
            return []
        evolved = evolve_gait(
            robot.body[0],
            EvolveConfig(
                generations=effort.generations,
                seconds=seconds,
                seed=int(self._rng.integers(2**32)),
                threads=1,
            ),
            first=first,
            start=ahead.state,
            world=WorldConfig.of(robot),
        )
        return [(evolved.controller, evolved.fitness)]

    def _refine_teacher(
        self,
        model: SelfModel,
        ahead: Ahead,
        seconds: float,
        effort: _Effort,
        actions: int,
        sigma: float,
    ) -> tuple[Gait, float]:
        """Return the teacher's gait that is swum, or else its best one, refined, and its way."""
        swum = self._swimming
        if isinstance(swum, TeacherAgent):
            first = swum.after(actions)
        else:
            gaits = self._teacher_gaits(Water())
            far = imagine_teacher(gaits, model.robot, ahead.state, seconds, ahead.action)
            first = gaits[int(far.argmax())]
        return refine_teacher(
            first,
            model.robot,
            ahead.state,
            seconds,
            ahead.action,
            effort.teacher_generations,
            np.random.default_rng(int(self._rng.integers(2**32))),
            sigma,
        )
