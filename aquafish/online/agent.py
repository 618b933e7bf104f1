"""A robot that never stops swimming: it notices what breaks, infers it, and changes its gait."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish.online.case import CHANNEL_TOLERANCE, Case, Moment, open_case
from aquafish.online.choosing import GaitChooser, Water, predicts
from aquafish.online.config import AgentConfig
from aquafish.online.early import EARLY_DRIFT, EarlyWatch
from aquafish.online.gaits import check_library, load_library
from aquafish.online.monitor import (
    CALIBRATION_ACTIONS,
    ERROR_SCALES,
    SETTLED_ACTIONS,
    WATER_ACTIONS,
    ErrorCalibration,
    ReadingHistory,
    wanders,
)
from aquafish.online.recognition import Recognised, alike
from aquafish.online.self_model import (
    MODEL_ERROR,
    RECOGNISED_ERROR,
    SelfModel,
    noise_of,
    observed_directions,
    predict,
)
from aquafish.online.swimming import Gait
from aquafish.online.teacher import Teacher, check_teachers
from aquafish.online.thinking import Event, Thought, thinking_actions
from aquafish.online.trusted import Trusted
from aquafish_gym.damage import Damage
from aquafish_gym.physics.layout import angles_of_rows
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

# The number of actions before an alarm in which the robot may have broken, by ``gyro_only``.
ACTIONS_BEFORE_ALARM = {True: 5, False: 2}
CONFIRMING_ACTIONS = 7  # after an alarm; what still fits then is trusted
# In foreign water predictions are good for a few seconds. So inferences after an alarm use 3 to 12
# observations, and for 50 actions there is no other alarm.
FOREIGN_OBSERVATIONS = range(3, 13)
QUIET_ACTIONS = 50
WANDERING_OBSERVATIONS = 8  # at most, where a current wanders: predictions are good for 10 actions
ERROR_GROWTH = 3.0  # factor on the model's error at each alarm after the first


class SelfModelAgent:
    """An agent of one robot that models itself as it swims.

    It compares each observation with what its self-model predicts, recognises what broke, takes the
    gait of a library that swims farthest on the self-model from the present state for the time that
    is left, and refines it while it swims on. It observes only what the environment returns.

    Parameters
    ----------
    library
        Gaits; the agent swims the first until something breaks. None is the packaged library.
    config
        Settings.
    robot
        A scenario of one: the whole robot.
    hold
        The environment's ``frame_skip``.
    teachers
        Two policies that are given what broke, for the water that the self-model knows and for any
        other; or none. They stand beside the library. None are the packaged ones beside the
        packaged library, and none beside another.

    Attributes
    ----------
    model
        Its :class:`~aquafish.online.self_model.SelfModel`.
    events
        What it noticed and decided in this episode.
    recognised
        What its last inference that is in use found, with the alternatives; None before.

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
        self._whole = Scenario.create() if robot is None else instance("robot", robot, Scenario)
        if len(self._whole) != 1 or self._whole.servo_lag.any():
            raise InvalidArgumentError(
                f"robot must be one robot, without a servo lag; got {self._whole!r}"
            )
        self.library = check_library(load_library() if library is None else library, hold)
        self.teachers = check_teachers(teachers, library is None, hold)

    @property
    def config(self) -> AgentConfig:
        """Its settings; see :meth:`swim_until` for an episode whose end changes."""
        return self._config

    def begin(self, fin_angles: ArrayLike | None = None) -> None:
        """Begin an episode at rest, with the fins at angles (3,), rad; None infers them."""
        config = self.config
        if fin_angles is not None:
            fin_angles = finite_array("fin_angles", fin_angles, (3,), unit="rad")
        deaf = np.array([[config.gyro_only] * GYRO_CHANNELS.start + [False] * 3])
        noise = np.array([config.gyro_noise])
        whole = replace(self._whole, gyro_noise=noise, sensor_dropped=deaf)
        self._calibration: ErrorCalibration | None = ErrorCalibration(whole, fin_angles, self.hold)
        self.model: SelfModel = self._calibration.model
        self.events: list[Event] = []
        self.recognised: Recognised | None = None
        self._moments: list[Moment] = []
        self._steps = 0
        self._action = np.zeros(3, np.float32)
        self._broken = Damage()
        self._early: EarlyWatch | None = None
        if fin_angles is not None:
            back = ACTIONS_BEFORE_ALARM[config.gyro_only] if config.gyro_noise else 0
            self._early = EarlyWatch(self._calibration, back, config.inferences)
        self._case: Case | None = None
        self._first_case: Case | None = None  # of the alarms in a row
        self._trusted: Trusted | None = None
        self._quiet = 0
        self._foreign = False
        self._wandering = False
        self._readings = ReadingHistory(np.isfinite(noise_of(whole)))
        self._thoughts: list[Thought[tuple[Case, Recognised]]] = []
        self._chooser = GaitChooser(self.library, self.teachers, config, self.dt, self.events)
        self._chooser.begin(self.model)

    @property
    def gait(self) -> Gait:
        """The controller, or the gait of a teacher, that it swims."""
        return self._chooser.gait

    def swim_until(self, seconds: float) -> None:
        """Set when this episode ends, in s since it began, instead of ``config.seconds``.

        Gaits are compared and refined for the time that is left.
        """
        if not hasattr(self, "model"):
            raise InvalidArgumentError("begin(fin_angles) must be called before swim_until")
        self._chooser.until = float(finite_array("seconds", seconds, (), 0.0, unit="s"))

    def reset(self, info: dict[str, Any]) -> None:
        """Begin the episode of a vector environment of one robot; see ``gait.evaluate``."""
        if "fin_angles" not in instance("info", info, dict):
            raise InvalidArgumentError(f"info must have 'fin_angles' (1, 3); got {brief(info)}")
        self.begin(finite_array("fin_angles", info["fin_angles"], (1, 3), unit="rad", flat=True)[0])

    def act(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Return the action (3,), in [-1, 1], for an observation (9,) or longer.

        Rows (1, k) of a vector environment give (1, 3). A reading that is not finite, or outside of
        the observation space, is not observed: the self-model predicts it. Nor is a direction of
        length 0.
        """
        if not hasattr(self, "model"):
            raise InvalidArgumentError("begin(fin_angles) must be called before act(observation)")
        wanted = f"({len(CHANNELS)},) or longer, or (1, k)"
        given = real_array("observation", observation, wanted)
        if given.size < len(CHANNELS) or given.shape[:-1] not in ((), (1,)):
            raise InvalidArgumentError(f"observation must have shape {wanted}; got {given.shape}")
        if self._steps:
            readings = valid_readings(given.reshape(-1)[: len(CHANNELS)], limits(False, False))
            self._observe(observed_directions(readings))
        seconds = self._steps * self.dt
        if seconds >= self._chooser.until:
            self.swim_until(seconds + self.config.seconds)
        # Inferences first: another robot makes a refinement obsolete.
        while due := [thought for thought in self._thoughts if thought.due <= self._steps]:
            self._thoughts.remove(due[0])
            self._use(due[0])
        self._chooser.use_refined(self.model, self._steps)
        if self._chooses_again():
            self._chooser.choose_again(self.model, self._steps)
        self._action = self._chooser.act(self.model)
        self._steps += 1
        return self._action.reshape((*given.shape[:-1], 3))

    def _observe(self, observed: Floats) -> None:
        """Carry the self-model along with an observation."""
        moment = Moment(self.model.state, self._action.astype(float), observed)
        self._moments.append(moment)
        if self._calibration is not None:
            self._calibrate(self._calibration, moment)
        else:
            if self._trusted is not None:
                self._trusted.model.follow(moment.action, observed)
            self._notice(observed, self.model.follow(moment.action, observed))
        for about in self._readings.add(observed):
            self._log("sensor", about)

    def _notice(self, observed: Floats, square: float) -> None:
        """Notice and infer what broke, by an observation and its squared innovation."""
        lost = np.isinf(self.model.noise) & np.isfinite(noise_of(self._intact))
        calm = self._steps < self._quiet
        alarming = self._monitor.add(square, int(self.model.used(observed).sum()), calm)
        silence_ends = lost & self._readings.changed(observed)  # of a sensor that works again
        alarming |= bool(silence_ends.any())
        settled = self._case is None or self._case.settled(self._steps)
        if alarming and settled and (self._case is None or self._believes_anew):
            self._case = self._open()
            self._log("alarm", "this is not what the self-model predicts")
        if self._case is not None:
            if self._case.is_due(self._steps):
                self._infer(self._case, self._moments, self._drift)
            if not self._case.due and self._case.settled(self._steps):
                self._case = None

    def _calibrate(self, calibration: ErrorCalibration, moment: Moment) -> None:
        """Measure the model's error, and find where the fins are."""
        unknown = calibration.unknown
        early = self._early
        known = None if early is None else early.known
        explaining = early is not None and early.explaining
        check = known is None and not explaining
        enough = calibration.add(moment.action, moment.observed, check)
        self.model = calibration.model
        if unknown and not calibration.unknown:
            self._log("fins", str(angles_of_rows(self.model.state).round(2).tolist()))
            self._chooser.begin(self.model)
        self._foreign = calibration.foreign
        if self._steps == WATER_ACTIONS and calibration.other_water and not explaining:
            self._log("water", calibration.other_water)
            self._change_gait()
        if early is not None:
            if early.add():
                self._log("alarm", "this is not what the self-model predicts")
            case = early.due(self._steps)
            if case is not None:
                self._infer(case, early.moments, EARLY_DRIFT)
            enough &= not early.explaining
            known = early.known
        if enough:
            if known is not None:
                self.model = calibration.models[known]
                self._foreign = False
            self._wandering = wanders(self.model)
            self._monitor, self._drift = calibration.finish(known)
            self._intact = self.model.robot
            self._calibration = None
            self._change_gait()

    def _end_calibration(self, early: EarlyWatch, found: Recognised, case: Case) -> None:
        """End the calibration because something broke: the robot was whole until then."""
        self.model = early.model.copy()
        self._moments = early.moments
        self._monitor = early.monitor
        self._drift = EARLY_DRIFT
        self._intact = case.before[found.before]
        self._foreign = False
        self._calibration = None
        self._case = early.case
        self._first_case = case
        self._wandering = wanders(self.model)
        self._trusted = Trusted(early.model.copy(), Damage(), self.gait)

    @property
    def _believes_anew(self) -> bool:
        """Whether it believes something else than before an alarm."""
        return self._trusted is None or self.model.robot is not self._trusted.model.robot

    def _open(self) -> Case:
        """Return the case of an alarm."""
        used = np.isfinite(noise_of(self._intact))
        exact = not self.config.gyro_noise and self._drift[used].max() < CHANNEL_TOLERANCE
        back = 0 if exact else ACTIONS_BEFORE_ALARM[self.config.gyro_only]
        if self._foreign:  # how surprising another gait is must be learned after each alarm
            self._quiet = self._steps + QUIET_ACTIONS
        elif self._trusted is None:
            self._trusted = Trusted(self.model.copy(), self._broken, self.gait)
        if any(event.what == "alarm" for event in self.events):
            most = ERROR_SCALES[-1] * MODEL_ERROR
            self.model.model_error = np.minimum(ERROR_GROWTH * self.model.model_error, most)
        due = [k for k in self.config.inferences if not self._foreign or k in FOREIGN_OBSERVATIONS]
        if self._wandering:
            due = [k for k in due if k <= WANDERING_OBSERVATIONS]
        beliefs = [(self.model.robot, self._broken)]
        if self.model.robot is not self._intact:  # what broke may have ended
            beliefs.append((self._intact, Damage()))
        seen = [bool(self.model.used(moment.observed).any()) for moment in self._moments]
        case = open_case(beliefs, seen, back, due or [1], self._first_case)
        if case.earlier is None:
            self._first_case = case
        return case

    def _infer(self, case: Case, moments: Sequence[Moment], drift: Floats) -> None:
        """Recognise what broke; the result can be used after the time for thinking."""
        began = time.process_time()
        found = case.explain(moments, drift, self.config.gyro_noise, self.hold)
        if self._calibration is not None and (found.unchanged or not found.fits):
            return
        doubted = not self._foreign and not found.fits
        if doubted:
            case.look_back()
            if not case.due and self._trusted is not None:  # what surprises it now is usual
                self._quiet = self._steps + QUIET_ACTIONS
        usable = self._foreign or found.decided
        if case.due and not (self._believes_anew if doubted else usable):
            return
        seconds = case.inferences * self.config.inference_seconds
        due = self._steps + thinking_actions(seconds, self.dt)
        cpu = time.process_time() - began
        event = Event(self._steps * self.dt, "inferred", found.about, cpu)
        self._thoughts.append(Thought(due, event, (case, found)))

    def _use(self, thought: Thought[tuple[Case, Recognised]]) -> None:
        """Use an inference that is due: become another robot."""
        self.events.append(thought.event)
        case, found = thought.result
        if not self._foreign and not found.fits:
            self._doubt(last=not case.due)
            return
        self.recognised = found
        if thought.event.seconds >= (case.step + CONFIRMING_ACTIONS) * self.dt:
            self._trusted = None
        if not found.explained:
            self._log("unknown", "none of my hypotheses explains what I observe")
            return
        changed = self._calibration is not None
        if self._early is not None and changed:
            self._end_calibration(self._early, found, case)
        robot = self._intact if found.whole else found.robot
        changed |= not alike(robot, self.model.robot)
        self._monitor.clear()
        self._broken = found.damage
        self.model.model_error = np.maximum(self.model.model_error, RECOGNISED_ERROR)
        self._become(robot, found, round(thought.event.seconds / self.dt))
        if changed:
            self._change_gait(soon=True)

    def _become(self, robot: Scenario, found: Recognised, inferred: int) -> None:
        """Let the self-model be a robot, which was recognised after ``inferred`` actions."""
        if self._wandering:  # without corrections it is wrong after two seconds
            self.model.become(robot, found.start)
            for moment in self._moments[found.onset :]:
                self.model.follow(moment.action, moment.observed)
            return
        state = found.state
        if since := self._moments[inferred:]:
            actions = np.array([moment.action for moment in since])
            state = predict(found.robot, state, actions, self.hold)[1][:, 0]
        self.model.become(robot, state)

    def _doubt(self, last: bool) -> None:
        """Undo what was believed since an alarm; at ``last``, say that its cause is unknown."""
        trusted = self._trusted
        if trusted is None:  # what fitted for long is kept; the next alarm says what broke since
            return
        if last:
            self._log("unknown", "none of my hypotheses explains what I observe")
            self._trusted = None
            self._first_case = None
        self.model = trusted.model if last else trusted.model.copy()
        self._broken = trusted.broken
        self._monitor.clear()
        self._chooser.return_to(trusted.gait, self.model)

    def _change_gait(self, soon: bool = False) -> None:
        """Swim the best known gait from now on, and refine it meanwhile."""
        self._chooser.change(self.model, self._steps, self._water(), soon)

    def _water(self) -> Water:
        """Return how well the self-model knows the water."""
        if not self._foreign or self._calibration is not None:
            return Water(self._foreign, not self._foreign)
        moments = self._moments[SETTLED_ACTIONS:CALIBRATION_ACTIONS]
        gyro = np.array([moment.observed[GYRO_CHANNELS] for moment in moments])
        return Water(self._foreign, predicts(self._drift[GYRO_CHANNELS], gyro))

    def _chooses_again(self) -> bool:
        """Whether the gait may be chosen again, in foreign water that the self-model predicts."""
        if not self._foreign or self._calibration is not None or self._thoughts:
            return False
        settled = self._case is None or self._case.settled(self._steps)
        return settled and self._water().predicted

    def _log(self, what: str, about: str) -> None:
        self.events.append(Event(self._steps * self.dt, what, about))
