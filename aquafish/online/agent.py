"""A robot that never stops swimming: it notices what breaks, infers it, and changes its gait."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish.online.belief import Event, ReadingHistory
from aquafish.online.case import Moment
from aquafish.online.choosing import GaitChooser
from aquafish.online.config import AgentConfig
from aquafish.online.gaits import Gait, check_library, load_library
from aquafish.online.phases import Calibrating, Episode, Phase
from aquafish.online.recognition import Recognised
from aquafish.online.self_model import SelfModel, noise_of, observed_directions
from aquafish.online.teacher import Teacher, check_teachers
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.scenario import CHANNELS, GYRO_CHANNELS, TIMESTEP, Scenario
from aquafish_gym.sense import limits, valid_readings
from aquafish_gym.utils.array_types import Floats
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    integer,
    real_array,
)
from gait.controllers.controller import Controller

__all__ = ["AgentConfig", "Event", "SelfModelAgent"]


class SelfModelAgent:
    """An agent of one robot that models itself as it swims.

    It compares each observation with what its self-model predicts, recognises what broke, takes the
    gait of a library that swims farthest on the self-model from the present state for the time that
    is left, and refines it while it swims on. It observes only what the environment returns.

    Parameters
    ----------
    library
        Gaits; the agent swims the first until something breaks. None is the packaged library of
        the robot's plan.
    config
        Settings.
    robot
        A scenario of one: the whole robot. None is the nominal one of the library's plan.
    hold
        The environment's ``frame_skip``.
    teachers
        Two policies that are given what broke, for the water that the self-model knows and for any
        other; or none. They stand beside the library. None are the packaged ones beside the
        packaged library of the paper's fish, and none beside another.

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
    'the tail is missing'
    """

    _episode: ClassVar[type[Episode]] = Episode

    def __init__(
        self,
        library: Sequence[Controller] | None = None,
        config: AgentConfig | None = None,
        robot: Scenario | None = None,
        hold: int = 20,
        teachers: Sequence[Teacher] | None = None,
    ) -> None:
        self.hold = integer("hold", hold, 1, 1000)
        self.dt = hold * TIMESTEP
        self._config = AgentConfig() if config is None else instance("config", config, AgentConfig)
        if robot is None:
            robot = Scenario.create(plan=library[0].plan if library else AQUAFISH)
        self._whole = instance("robot", robot, Scenario)
        if len(self._whole) != 1 or self._whole.servo_lag.any():
            raise InvalidArgumentError(
                f"robot must be one robot, without a servo lag; got {self._whole!r}"
            )
        self._phase: Phase | None = None  # before ``begin``
        gaits = load_library(robot.plan) if library is None else library
        self.library = check_library(gaits, robot.plan, hold)
        self.teachers = check_teachers(teachers, library is None, robot.plan, hold)

    @property
    def config(self) -> AgentConfig:
        """Its settings; see :meth:`swim_until` for an episode whose end changes."""
        return self._config

    def begin(self, fin_angles: ArrayLike | None = None) -> None:
        """Begin an episode at rest, with the fins at angles (F,), rad; None infers them."""
        config = self.config
        if fin_angles is not None:
            fins = len(self._whole.plan.fins)
            fin_angles = finite_array("fin_angles", fin_angles, (fins,), unit="rad")
        deaf = np.array([[config.gyro_only] * GYRO_CHANNELS.start + [False] * 3])
        noise = np.array([config.gyro_noise])
        whole = replace(self._whole, gyro_noise=noise, sensor_dropped=deaf)
        events: list[Event] = []
        chooser = GaitChooser(self.library, self.teachers, config, self.dt, events)
        readings = ReadingHistory(np.isfinite(noise_of(whole)))
        episode = self._episode(config, self.hold, chooser, readings, events)
        self._phase = Calibrating(episode, whole, fin_angles)
        chooser.begin(self._phase.model)

    def _begun(self, use: str) -> Phase:
        """Return the phase of the episode."""
        if self._phase is None:
            raise InvalidArgumentError(f"begin(fin_angles) must be called before {use}")
        return self._phase

    @property
    def model(self) -> SelfModel:
        """Its self-model now."""
        return self._begun("model").model

    @property
    def events(self) -> list[Event]:
        """What it noticed and decided in this episode."""
        return self._begun("events").episode.events

    @property
    def recognised(self) -> Recognised | None:
        """What its last inference that is in use found, with the alternatives; None before."""
        return self._begun("recognised").episode.recognised

    @property
    def gait(self) -> Gait:
        """What it swims: a controller's gait, or a teacher's."""
        return self._begun("gait").episode.chooser.gait

    def swim_until(self, seconds: float) -> None:
        """Set when this episode ends, in s since it began, instead of ``config.seconds``.

        Gaits are compared and refined for the time that is left.
        """
        chooser = self._begun("swim_until").episode.chooser
        chooser.until = float(finite_array("seconds", seconds, (), 0.0, unit="s"))

    def reset(self, info: dict[str, Any]) -> None:
        """Begin the episode of a vector environment of one robot; see ``gait.evaluate``."""
        shape = (1, len(self._whole.plan.fins))
        if "fin_angles" not in instance("info", info, dict):
            raise InvalidArgumentError(f"info must have 'fin_angles' {shape}; got {brief(info)}")
        self.begin(finite_array("fin_angles", info["fin_angles"], shape, unit="rad", flat=True)[0])

    def act(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Return the action (F,), in [-1, 1], for an observation (9,) or longer.

        Rows (1, k) of a vector environment give (1, F). A reading that is not finite, or outside of
        the observation space, is not observed: the self-model predicts it. Nor is a direction of
        length 0.
        """
        phase = self._begun("act(observation)")
        episode = phase.episode
        chooser = episode.chooser
        observed, rows = _readings(observation)
        if episode.steps:
            phase = self._observe(phase, observed)
        seconds = episode.steps * episode.dt
        if seconds >= chooser.until:
            chooser.until = seconds + self.config.seconds
        # Inferences first: another robot makes a refinement obsolete.
        while thought := episode.next_due():
            phase = phase.use(thought)
        chooser.use_refined(phase.model, episode.steps)
        if phase.chooses_again:
            chooser.choose_again(phase.model, episode.steps)
        self._phase = phase
        episode.steps += 1
        return chooser.act(phase.model).reshape((*rows, -1))

    def _observe(self, phase: Phase, observed: Floats) -> Phase:
        """Take in the readings (9,) after the last action; return the next phase."""
        episode = phase.episode
        moment = Moment(phase.model.state, episode.chooser.action.astype(float), observed)
        episode.moments.append(moment)
        after = phase.observe(moment)
        for silent in episode.readings.add(observed):
            episode.log("sensor", silent)
        return after


def _readings(observation: ArrayLike) -> tuple[Floats, tuple[int, ...]]:
    """Return the readings (9,) of an observation, NaN where there is none, and its rows."""
    wanted = f"({len(CHANNELS)},) or longer, or (1, k)"
    given = real_array("observation", observation, wanted)
    if given.size < len(CHANNELS) or given.shape[:-1] not in ((), (1,)):
        raise InvalidArgumentError(f"observation must have shape {wanted}; got {given.shape}")
    readings = valid_readings(given.reshape(-1)[: len(CHANNELS)], limits())
    return observed_directions(readings), given.shape[:-1]
