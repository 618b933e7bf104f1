"""The three phases of an agent's mind: calibrating, watching and explaining.

It begins by measuring how wrong its self-model is, and counts as whole. Then it watches: does what
it observes surprise the model? After an alarm it explains what broke, again and again with more
observations. A phase takes in each moment and each inference, and returns the next phase.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from aquafish.online import thresholds
from aquafish.online.belief import (
    Belief,
    Event,
    ReadingHistory,
    Thought,
    Trusted,
    Water,
    predicts,
    thinking_actions,
)
from aquafish.online.calibration import ErrorCalibration, wanders
from aquafish.online.case import Case, Moment, Moments, open_case
from aquafish.online.choosing import GaitChooser
from aquafish.online.config import AgentConfig
from aquafish.online.early import EarlyWatch, early_drift
from aquafish.online.recognition import Recognised, alike
from aquafish.online.self_model import SelfModel, noise_of, predict
from aquafish_gym.damage import Damage
from aquafish_gym.physics.layout import layout
from aquafish_gym.scenario import GYRO_CHANNELS, TIMESTEP, Scenario
from aquafish_gym.utils.array_types import Floats

SURPRISE = "this is not what the self-model predicts"
UNKNOWN = "none of my hypotheses explains what I observe"


@dataclass
class Episode:
    """What an agent has observed, said and thought about since it began.

    Agents that know more or less have episodes of their own.
    """

    watches: ClassVar[bool] = True  #: Whether what surprises the self-model is an alarm.

    config: AgentConfig
    hold: int
    chooser: GaitChooser
    readings: ReadingHistory
    events: list[Event]
    moments: Moments = field(init=False)
    steps: int = 0  #: Actions so far.
    thoughts: list[Thought[tuple[Case, Recognised]]] = field(default_factory=list)
    #: What its last inference that is in use found, with the alternatives.
    recognised: Recognised | None = None

    def __post_init__(self) -> None:
        self.moments = self.remembered()

    def remembered(self, begun: Sequence[Moment] = ()) -> Moments:
        """Return moments of which as many are kept as an explanation may need.

        It may be that of two alarms, each of which the robot may have been broken or whole before,
        and take the time of two inferences; see :meth:`think`.
        """
        config = self.config
        starts = actions_before_alarm(config.gyro_only) + thresholds.OUTAGE_ACTIONS + 2
        inferences = 2 * 2 * math.ceil(2 * starts / thresholds.CHARGED_STARTS)
        thinking = thinking_actions(inferences * config.inference_seconds, self.dt)
        longest = max(thresholds.CALIBRATION_ACTIONS, *config.inferences)
        return Moments(longest + thresholds.REOPENED_ACTIONS + starts + thinking, begun)

    @property
    def dt(self) -> float:
        """How long an action is held, s."""
        return self.hold * TIMESTEP

    def log(self, what: str, about: str) -> None:
        """Add an event."""
        self.events.append(Event(self.steps * self.dt, what, about))

    def next_due(self) -> Thought[tuple[Case, Recognised]] | None:
        """Take out the first inference that can be used now; None if there is none."""
        due = [thought for thought in self.thoughts if thought.due <= self.steps]
        if not due:
            return None
        self.thoughts.remove(due[0])
        return due[0]

    def explain(self, case: Case, moments: Moments, drift: Floats) -> Recognised | None:
        """Return what explains a case; None in an episode in which nothing is inferred."""
        return case.explain(moments, drift, self.config.gyro_noise, self.hold)

    def think(self, case: Case, found: Recognised, began: float) -> None:
        """Let an inference, which ``began`` at a CPU time, be used after the time for thinking.

        A fit of all sizes and gains takes the time of another inference.
        """
        seconds = case.inferences * self.config.inference_seconds * (1 + found.identified)
        due = self.steps + thinking_actions(seconds, self.dt)
        cpu = time.process_time() - began
        event = Event(self.steps * self.dt, "inferred", found.about, cpu)
        self.thoughts.append(Thought(due, event, (case, found)))

    def change_gait(self, model: SelfModel, water: Water, soon: bool = False) -> None:
        """Swim the best known gait from now on, and refine it meanwhile."""
        self.chooser.change(model, self.steps, water, soon)


class Calibrating:
    """Measures the model's error, and finds where the fins are; the robot counts as whole.

    Where the fin angles (F,) are known, it looks for damage meanwhile (:class:`EarlyWatch`).
    """

    chooses_again = False

    def __init__(self, episode: Episode, whole: Scenario, fin_angles: ArrayLike | None) -> None:
        config = episode.config
        self.episode = episode
        self._calibration = ErrorCalibration(whole, fin_angles, episode.hold)
        self._early: EarlyWatch | None = None
        if fin_angles is not None and episode.watches:
            back = actions_before_alarm(config.gyro_only) if config.gyro_noise else 0
            self._early = EarlyWatch(self._calibration, back, config.inferences)

    @property
    def model(self) -> SelfModel:
        """The likeliest self-model so far."""
        return self._calibration.model

    @property
    def water(self) -> Water:
        """How well it is known so far: what is foreign is not predicted yet."""
        foreign = self._calibration.foreign
        return Water(foreign, not foreign)

    def observe(self, moment: Moment) -> Calibrating | Watching:
        """Take in a moment; return the next phase."""
        episode = self.episode
        calibration = self._calibration
        early = self._early
        explaining = early is not None and early.explaining
        unknown = calibration.unknown
        check = (early is None or early.known is None) and not explaining
        enough = calibration.add(moment.action, moment.observed, check)
        if unknown and not calibration.unknown:
            model = self.model
            angles = layout(model.robot.plan).angles(model.state)
            episode.log("fins", str(angles.round(2).tolist()))
            episode.chooser.begin(self.model)
        if episode.steps == thresholds.WATER_ACTIONS and calibration.other_water and not explaining:
            episode.log("water", calibration.other_water)
            episode.change_gait(self.model, self.water)
        if early is not None:
            self._look_for_damage(early)
            enough &= not early.explaining
        if not enough:
            return self
        return self._ended(None if early is None else early.known)

    def _look_for_damage(self, early: EarlyWatch) -> None:
        """Explain what surprises the whole robot's filters, as far as it fits."""
        episode = self.episode
        if early.add():
            episode.log("alarm", SURPRISE)
        case = early.due(episode.steps)
        if case is None:
            return
        began = time.process_time()
        found = episode.explain(case, episode.remembered(early.moments), early_drift())
        if found is None or found.unchanged or not found.fits:
            return
        if self.water.foreign or found.decided or not case.due:
            episode.think(case, found, began)

    def _ended(self, known: int | None) -> Watching:
        """Return the phase after a calibration in which nothing broke."""
        calibration = self._calibration
        model = calibration.model if known is None else calibration.models[known]
        foreign = calibration.foreign and known is None
        monitor, drift = calibration.finish(known)
        predicted = True
        if foreign:
            moments = self.episode.moments.since(thresholds.SETTLED_ACTIONS)
            moments = moments[: thresholds.CALIBRATION_ACTIONS - thresholds.SETTLED_ACTIONS]
            gyro = np.array([moment.observed[GYRO_CHANNELS] for moment in moments])
            predicted = predicts(drift[GYRO_CHANNELS], gyro)
        water = Water(foreign, predicted, wanders(model))
        belief = Belief(model, Damage(), model.robot, drift, monitor, water)
        self.episode.change_gait(model, water)
        return Watching(self.episode, belief)

    def use(self, thought: Thought[tuple[Case, Recognised]]) -> Calibrating | Watching:
        """Use an inference that is due: what broke was whole until then. Return the next phase."""
        episode = self.episode
        episode.events.append(thought.event)
        case, found = thought.result
        episode.recognised = found
        if not found.explained:
            episode.log("unknown", UNKNOWN)
            return self
        early = self._early
        if early is None:
            raise RuntimeError("early must have found what broke")
        episode.moments = episode.remembered(early.moments)
        intact = case.before[found.before]
        water = Water(wandering=wanders(early.model))
        model = early.model.copy()
        belief = Belief(model, Damage(), intact, early_drift(), early.monitor, water)
        trusted = Trusted(belief.copy(), episode.chooser.gait)
        after = Watching(episode, belief, trusted, first_case=case)
        after.believe(found, thought.event)
        episode.change_gait(belief.model, water, soon=True)
        return after if early.case is None else after.explaining(early.case)


@dataclass
class Watching:
    """Watches whether what it observes surprises its self-model.

    What it believed and swam before an alarm stays ``trusted`` until an inference fits that uses
    eight observations or more, or the last inference fits not: then it returns to that.
    """

    episode: Episode
    belief: Belief
    trusted: Trusted | None = None  #: Since an alarm whose cause is not certain yet.
    first_case: Case | None = None  #: The case of the first of the alarms in a row.
    quiet: int = 0  #: The number of actions until which nothing alarms it.

    @property
    def model(self) -> SelfModel:
        """The self-model."""
        return self.belief.model

    @property
    def water(self) -> Water:
        """How well it is known."""
        return self.belief.water

    @property
    def chooses_again(self) -> bool:
        """Whether the gait may be chosen again, in foreign water that the self-model predicts."""
        return self.water.foreign and self.water.predicted and not self.episode.thoughts

    def explaining(self, case: Case) -> Explaining:
        """Return the phase in which a case is explained."""
        return Explaining(**self._kept, case=case)

    @property
    def _kept(self) -> dict[str, Any]:
        """What both phases keep, by name."""
        return {one.name: getattr(self, one.name) for one in fields(Watching)}

    def observe(self, moment: Moment) -> Watching:
        """Take in a moment; return the next phase."""
        return self._alarmed().explain() if self._is_surprised(moment) else self

    def _is_surprised(self, moment: Moment) -> bool:
        """Carry the self-model along with a moment; return whether that is an alarm."""
        observed = moment.observed
        belief = self.belief
        if self.trusted is not None:
            self.trusted.belief.model.follow(moment.action, observed)
        square = belief.model.follow(moment.action, observed)
        if not self.episode.watches:
            return False
        lost = np.isinf(belief.model.noise) & np.isfinite(noise_of(belief.intact))
        calm = self.episode.steps < self.quiet
        alarming = belief.monitor.add(square, int(belief.model.used(observed).sum()), calm)
        silence_ends = lost & self.episode.readings.changed(observed)  # a sensor works again
        return alarming or bool(silence_ends.any())

    def _alarmed(self) -> Explaining:
        """Return the phase after an alarm."""
        episode = self.episode
        belief = self.belief
        config = episode.config
        used = np.isfinite(noise_of(belief.intact))
        exact = not config.gyro_noise and belief.drift[used].max() < thresholds.CHANNEL_TOLERANCE
        if self.water.foreign:  # how surprising another gait is must be learned after each alarm
            self.quiet = episode.steps + thresholds.CALIBRATION_ACTIONS
        elif self.trusted is None:
            self.trusted = Trusted(belief.copy(), episode.chooser.gait)
        if any(event.what == "alarm" for event in episode.events):
            most = thresholds.ERROR_SCALES[-1] * thresholds.MODEL_ERROR
            belief.model.model_error = np.minimum(
                thresholds.ERROR_GROWTH * belief.model.model_error, most
            )
        due = list(config.inferences)
        if self.water.foreign:
            fewest = thresholds.FEWEST_OBSERVATIONS
            due = [k for k in due if fewest <= k <= thresholds.MOST_FOREIGN_OBSERVATIONS]
        if self.water.wandering:
            due = [k for k in due if k <= thresholds.MOST_WANDERING_OBSERVATIONS]
        beliefs = [(belief.model.robot, belief.damage)]
        if belief.model.robot is not belief.intact:  # what broke may have ended
            beliefs.append((belief.intact, Damage()))
        back = 0 if exact else actions_before_alarm(config.gyro_only)
        identifies = not (self.water.foreign or self.water.wandering)
        case = open_case(beliefs, episode.moments, back, due or [1], self.first_case, identifies)
        if case.earlier is None:
            self.first_case = case
        episode.log("alarm", SURPRISE)
        return self.explaining(case)

    def use(self, thought: Thought[tuple[Case, Recognised]]) -> Watching:
        """Use an inference that is due: become another robot. Return the phase."""
        episode = self.episode
        episode.events.append(thought.event)
        case, found = thought.result
        if not self.water.foreign and not found.fits:
            self._doubt(last=not case.due)
            return self
        episode.recognised = found
        last = thresholds.CONFIRMING_OBSERVATIONS - 1
        if thought.event.seconds >= (case.step + last) * episode.dt:
            self.trusted = None
        if not found.explained:
            episode.log("unknown", UNKNOWN)
            return self
        if self.believe(found, thought.event):
            episode.change_gait(self.model, self.water, soon=True)
        return self

    def believe(self, found: Recognised, event: Event) -> bool:
        """Believe what an inference found at an event; return whether the robot is another one."""
        belief = self.belief
        robot = belief.intact if found.whole else found.robot
        changed = not alike(robot, belief.model.robot)
        belief.monitor.clear()
        belief.damage = found.damage
        belief.model.model_error = np.maximum(belief.model.model_error, thresholds.RECOGNISED_ERROR)
        moments = self.episode.moments
        if self.water.wandering:  # without corrections it is wrong after two seconds
            belief.model.become(robot, found.start)
            for moment in moments.since(found.onset):
                belief.model.follow(moment.action, moment.observed)
            return changed
        state = found.state
        if since := moments.since(round(event.seconds / self.episode.dt)):
            actions = np.array([moment.action for moment in since])
            state = predict(found.robot, state, actions, self.episode.hold)[1][:, 0]
        belief.model.become(robot, state)
        return changed

    def _doubt(self, last: bool) -> None:
        """Undo what was believed since an alarm; at ``last``, say that its cause is unknown."""
        trusted = self.trusted
        if trusted is None:  # what fitted for long is kept; the next alarm says what broke since
            return
        if last:
            self.episode.log("unknown", UNKNOWN)
            self.trusted = None
            self.first_case = None
        self.belief = trusted.belief if last else trusted.belief.copy()
        self.belief.monitor.clear()
        self.episode.chooser.return_to(trusted.gait, self.belief.model)


@dataclass
class Explaining(Watching):
    """Infers what broke, after more and more observations since an alarm."""

    case: Case = field(kw_only=True)

    @property
    def chooses_again(self) -> bool:
        """Whether the gait may be chosen again; see :class:`Watching`."""
        return super().chooses_again and self.case.settled(self.episode.steps)

    @property
    def _believes_anew(self) -> bool:
        """Whether it believes something else than before the alarm."""
        return self.trusted is None or self.model.robot is not self.trusted.belief.model.robot

    def observe(self, moment: Moment) -> Watching:
        """Take in a moment; return the next phase."""
        surprised = self._is_surprised(moment)
        if surprised and self.case.settled(self.episode.steps) and self._believes_anew:
            return self._alarmed().explain()
        return self.explain()

    def explain(self) -> Watching:
        """Infer what broke, if it is time for that; return the next phase."""
        steps = self.episode.steps
        if self.case.is_due(steps):
            self._infer()
        if self.case.due or not self.case.settled(steps):
            return self
        return Watching(**self._kept)

    def _infer(self) -> None:
        """Recognise what broke; the result can be used after the time for thinking."""
        began = time.process_time()
        found = self.episode.explain(self.case, self.episode.moments, self.belief.drift)
        if found is None:
            return
        doubted = not self.water.foreign and not found.fits
        if doubted:
            self.case.look_back()
            if not self.case.due and self.trusted is not None:  # what surprises it now is usual
                self.quiet = self.episode.steps + thresholds.CALIBRATION_ACTIONS
        usable = self.water.foreign or found.decided
        if not self.case.due or (self._believes_anew if doubted else usable):
            self.episode.think(self.case, found, began)


def actions_before_alarm(gyro_only: bool) -> int:
    """Return the number of actions before an alarm in which the robot may have broken."""
    return thresholds.ACTIONS_BEFORE_GYRO_ALARM if gyro_only else thresholds.ACTIONS_BEFORE_ALARM


Phase = Calibrating | Watching
