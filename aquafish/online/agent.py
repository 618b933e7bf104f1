"""A robot that never stops swimming: it notices what breaks, infers it, and changes its gait."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish.online.gaits import LARGEST, imagine, load_library, refine
from aquafish.online.watch import Calibration, Moment
from aquafish_gym.physics.layout import angles_of_rows
from aquafish_gym.scenario import TIMESTEP, Scenario
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, integer
from eea.fish.recognition import Recognised, recognise
from eea.fish.self_model import SelfModel, observe, predict
from gait.controller import Controller

Floats = NDArray[np.float64]

CHANNELS = 9  # up, north, gyro
GYRO = slice(6, 9)
BACK = {True: 5, False: 2}  # actions before an alarm at which it may have broken: gyroscope alone?
ALIKE = 0.05  # of sizes, in units, and of gains: robots that need no other gait
TOLERANCE, DRIFTS, NOISES = 0.02, 3.0, 5.0  # of a channel that is not lost: see ``_infer``
SHORTEST = 2.0  # s: for less no gait is refined


@dataclass(frozen=True)
class AgentConfig:
    """Settings of :class:`SelfModelAgent`."""

    seconds: float = 60.0  #: Length of an episode.
    gyro_noise: float = 0.0  #: Standard deviation of the gyroscope's noise, rad/s.
    gyro_only: bool = False  #: Whether the gyroscope is the only sensor.
    waters: tuple[bool, ...] = (False, True)  #: Whether the water may have added mass.
    #: Numbers of actions after an alarm at which the robot is inferred, again with each.
    inferences: tuple[int, ...] = (3, 5, 8, 12, 18, 27, 40)
    generations: int = 150  #: Of a gait's refinement; with 0 gaits of the library are only chosen.
    #: Thinking time, s, after which an inference and a refinement can be used; the robot swims on.
    inference_seconds: float = 0.2
    refinement_seconds: float = 1.2
    seed: int = 0  #: Of the refinement.

    def __post_init__(self) -> None:
        for name in ("seconds", "gyro_noise", "inference_seconds", "refinement_seconds"):
            finite_array(name, getattr(self, name), (), 0.0)
        integer("generations", self.generations, 0)
        integer("seed", self.seed, 0)
        if not self.inferences or not self.waters:
            raise InvalidArgumentError("inferences and waters must have one value or more")


class Event(NamedTuple):
    """Something that the agent noticed or decided."""

    seconds: float  #: When, in the episode.
    what: str  #: "alarm", "inferred", "unknown", "chose" or "refined".
    about: str  #: In words.
    cpu: float = 0.0  #: CPU seconds that it took.


class _Thought(NamedTuple):
    """A result that can be used from an action on."""

    due: int
    event: Event
    result: Recognised | Controller


class _Case(NamedTuple):
    """An alarm: what the robot was, and all since shortly before."""

    step: int
    before: list[Scenario]
    moments: list[Moment]
    states: int  #: At how many of the first moments something may have broken.
    due: list[int]  #: Actions after the alarm at which to infer.


class SelfModelAgent:
    """An agent of one robot that models itself as it swims.

    It compares each observation with what its self-model predicts, recognises what broke, takes the
    gait of a library that swims farthest on the self-model from the present state for the time that
    is left, and refines it while it swims on. It observes only what the environment returns.

    Parameters
    ----------
    library
        Gaits, of which it swims the first until something breaks; None is the packaged library.
    config
        Settings.
    robot
        A scenario of one: the whole robot.
    hold
        The environment's ``frame_skip``.

    Attributes
    ----------
    model
        Its :class:`~eea.fish.self_model.SelfModel`.
    events
        What it noticed and decided in this episode.

    Examples
    --------
    >>> import gymnasium as gym
    >>> env = gym.make("AquaFishRecovery-v0", damage="caudal:missing@20", engine="numba")
    >>> observation, info = env.reset(seed=0)
    >>> agent = SelfModelAgent()
    >>> agent.begin(info["fin_angles"])
    >>> for _ in range(110):
    ...     observation, *_ = env.step(agent.act(observation))
    >>> [event.about for event in agent.events if event.what == "inferred"][0]
    'caudal:missing'
    """

    def __init__(
        self,
        library: Sequence[Controller] | None = None,
        config: AgentConfig | None = None,
        robot: Scenario | None = None,
        hold: int = 20,
    ) -> None:
        self.library = load_library() if library is None else list(library)
        self.config, self.hold = config or AgentConfig(), hold
        self.dt = hold * TIMESTEP
        self._whole = Scenario.create() if robot is None else robot
        if not self.library or len(self._whole) != 1:
            raise InvalidArgumentError("library must have a gait, and robot must be one robot")

    def begin(self, fin_angles: ArrayLike) -> None:
        """Begin an episode at rest, with the fins at known angles (3,), rad."""
        config, angles = self.config, finite_array("fin_angles", fin_angles, (3,), unit="rad")
        self.noise = np.full(CHANNELS, np.inf if config.gyro_only else 0.0)
        self.noise[GYRO] = config.gyro_noise
        self.bias = np.zeros(CHANNELS)
        self._calibration: Calibration | None = Calibration(
            self._whole, angles, self.noise, self.hold, config.waters
        )
        self.model: SelfModel = self._calibration.best
        self.events: list[Event] = []
        self._steps, self._action = 0, np.zeros(3, np.float32)
        self._recent: list[Moment] = []
        self._case: _Case | None = None
        self._thoughts: list[_Thought] = []
        self._rng = np.random.default_rng(config.seed)
        self._swim(self.library[0])

    def reset(self, info: dict[str, Any]) -> None:
        """Begin the episode of a vector environment of one robot; see ``gait.evaluate``."""
        self.begin(np.reshape(info["fin_angles"], -1))

    def act(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Return the action (3,), in [-1, 1], for an observation (9,) or longer.

        Rows (1, k) of a vector environment give (1, 3).
        """
        given = np.asarray(observation, float)
        if not hasattr(self, "model"):
            raise InvalidArgumentError("begin(fin_angles) must be called before act(observation)")
        if given.size < CHANNELS or given.shape[:-1] not in ((), (1,)):
            raise InvalidArgumentError(
                f"observation must have shape ({CHANNELS},) or be longer, or (1, k); "
                f"got {given.shape}"
            )
        if self._steps:
            self._observe(given.reshape(-1)[:CHANNELS] - self.bias)
        due = [thought for thought in self._thoughts if thought.due <= self._steps]
        self._thoughts = [thought for thought in self._thoughts if thought.due > self._steps]
        for thought in due:
            self._use(thought)
        self._action = self._choose(self.model.state)
        self._steps += 1
        return self._action.reshape((*given.shape[:-1], 3))

    def become(self, robot: Scenario) -> None:
        """Take another robot, a scenario of one, for what it is, and change the gait for it."""
        self.model.become(robot, self.model.state)
        self._intact, self._case = robot, None
        self._change_gait()

    def _observe(self, observed: Floats) -> None:
        """Carry the self-model along, and notice and infer what broke."""
        action = self._action.astype(float)
        if self._calibration is not None:
            if self._calibration.add(action, observed):
                self._watch, self._drift = self._calibration.finish()
                self.model = self._calibration.best
                self._intact = self.model.robot
                self._calibration = None
            else:
                self.model = self._calibration.best
            return
        moment = Moment(self.model.state, action, observed)
        self.model.step(action)
        alarming = self._watch.add(self.model.correct(observed).square)
        self._recent = [*self._recent[-max(BACK.values()) :], moment]
        if self._case is not None:
            self._case.moments.append(moment)
        elif alarming:
            self._case = self._open()
            self._log("alarm", "this is not what the self-model predicts")
        if self._case is not None:
            if self._steps - self._case.step + 1 >= self._case.due[0]:
                self._case.due.pop(0)
                self._infer(self._case)
            if not self._case.due:
                self._case = None

    def _open(self) -> _Case:
        """Return the case of an alarm."""
        exact = not self.config.gyro_noise and self._drift.max() < TOLERANCE
        back = 0 if exact else BACK[self.config.gyro_only]
        before = [self.model.robot]
        if not _alike(self.model.robot, self._intact, 0.0):
            before.append(self._intact)  # what broke before may have ended
        moments = self._recent[-back - 1 :]
        return _Case(self._steps, before, moments, len(moments) + 1, list(self.config.inferences))

    def _infer(self, case: _Case) -> None:
        """Recognise what broke; the result can be used after the time for thinking."""
        began = time.process_time()
        actions = np.array([moment.action for moment in case.moments])
        observed = np.array([moment.observed for moment in case.moments])
        # The filter has since followed the broken robot: what it was is simulated from there.
        states = [case.moments[0].state]
        for action in actions[: case.states - 1]:
            states.append(predict(case.before[0], states[-1], action[None], self.hold)[1][:, 0])
        tolerance = np.maximum(DRIFTS * self._drift, TOLERANCE)
        tolerance[GYRO] = np.maximum(tolerance[GYRO], NOISES * self.config.gyro_noise)
        noise = np.hypot(self.noise, self._drift)
        found = recognise(case.before, states, observed, actions, noise, tolerance, self.hold)
        about = f"{found.hypothesis}"
        broken = np.flatnonzero(found.lost & np.isfinite(self.noise))
        about += f", without channels {broken.tolist()}" if len(broken) else ""
        self._think(self.config.inference_seconds, "inferred", about, began, found)

    def _use(self, thought: _Thought) -> None:
        """Use a result that is due: another self, or another gait."""
        self.events.append(thought.event)
        if isinstance(thought.result, Controller):
            self._swim(thought.result)
            return
        found = thought.result
        if not found.explained:
            self._log("unknown", "none of my hypotheses explains what I observe")
            return
        self.bias = self.bias + found.bias
        self.noise = np.where(found.lost, np.inf, self.noise)
        self.model.noise = self.noise
        self._watch.used = int(np.isfinite(self.noise).sum())
        self._watch.squares.clear()
        state, since = found.state, self._steps - round(thought.event.seconds / self.dt)
        if since:
            actions = np.array([moment.action for moment in self._recent[-since:]])
            state = predict(found.robot, state, actions, self.hold)[1][:, 0]
        changed = not _alike(found.robot, self.model.robot, ALIKE)
        self.model.become(found.robot, state)
        if changed:
            self._change_gait()

    def _change_gait(self) -> None:
        """Swim the best gait of the library from now on, and refine it meanwhile."""
        began = time.process_time()
        left = self.config.seconds - self._steps * self.dt
        self._thoughts = [t for t in self._thoughts if not isinstance(t.result, Controller)]
        if left < self.dt:
            return
        robot, config = self.model.robot, self.config
        far = imagine(self.library, robot, self.model.state, left)
        best = int(far.argmax())
        self._swim(self.library[best])
        about = f"gait {best}, which should make {far[best]:.1f} units"
        self._log("chose", about, time.process_time() - began)
        if not config.generations or left - config.refinement_seconds < SHORTEST:
            return
        began = time.process_time()
        state = self.model.state  # where this gait will have brought it when the other is ready
        actions = math.ceil(config.refinement_seconds / self.dt - 1e-9)
        for k in range(actions):
            action = self._choose(state, k)
            state = predict(robot, state, action[None].astype(float), self.hold)[1][:, 0]
        self._swim(self.library[best])  # its memory is as it was
        left -= actions * self.dt
        far = imagine(self.library, robot, state, left)
        small = [len(gait.bias) <= LARGEST for gait in self.library]
        start = int(np.where(small, far, -np.inf).argmax())
        gait, farthest = refine(
            self.library[start], robot, state, left, config.generations, self._rng
        )
        if farthest > far[best]:
            about = f"gait {start}, from {far[start]:.1f} to {farthest:.1f} units"
            self._think(config.refinement_seconds, "refined", about, began, gait)

    def _swim(self, gait: Controller) -> None:
        """Swim another gait from now on."""
        angles = angles_of_rows(self.model.state)
        self._policy = gait.policy(angles, self.model.robot.servo_gain[0])
        self._began = self._steps

    def _choose(self, state: Floats, ahead: int = 0) -> NDArray[np.float32]:
        """Return the gait's action (3,) in a state (25,), some actions from now."""
        seconds = (self._steps + ahead - self._began) * self.dt
        action = self._policy(observe(state[:, None])[0], seconds)
        return np.clip(np.asarray(action, np.float32), -1.0, 1.0)

    def _think(
        self, seconds: float, what: str, about: str, began: float, result: Recognised | Controller
    ) -> None:
        due = self._steps + math.ceil(seconds / self.dt - 1e-9)
        event = Event(self._steps * self.dt, what, about, time.process_time() - began)
        self._thoughts.append(_Thought(due, event, result))

    def _log(self, what: str, about: str, cpu: float = 0.0) -> None:
        self.events.append(Event(self._steps * self.dt, what, about, cpu))


def _alike(one: Scenario, other: Scenario, tolerance: float) -> bool:
    """Whether two robots differ by no more in any size or gain."""
    sizes = np.abs(one.body - other.body).max()
    return bool(max(sizes, np.abs(one.servo_gain - other.servo_gain).max()) <= tolerance)
