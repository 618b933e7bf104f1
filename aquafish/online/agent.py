"""A robot that never stops swimming: it notices what breaks, infers it, and changes its gait."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish.online.gaits import imagine, refine
from aquafish.online.recognition import Recognised, Recognition
from aquafish.online.self_model import FLOOR, MODEL_ERROR, Robot, SelfModel, observe, predict
from aquafish_gym.engines.compiled.lanes import LaneBatch
from aquafish_gym.command import scale_action
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import angles_of_rows
from aquafish_gym.scenario import TIMESTEP
from gait.controller import Controller

Floats = NDArray[np.float64]

WINDOWS = (1, 2, 4, 8, 16)  # actions over which surprise is summed
CALIBRATION = 50  # actions in which the model's own error is measured
SETTLED = 10  # of these, after which the filter has forgotten how it began
ERROR_SCALES = (1.0, 10.0, 100.0, 1000.0)  # of ``MODEL_ERROR``, of which the likeliest is taken
ALARM = 1e-7  # probability of a false alarm in each window, if the model is right
MARGIN = 2.0  # by which surprise must exceed the greatest while nothing broke
DRIFT = 10  # actions over which the model's open-loop error is measured
ALIKE = 0.05  # of sizes, in units, and gains: robots that need no other gait
REMEMBERED = 60  # actions
GYRO = slice(6, 9)


@dataclass(frozen=True)
class AgentConfig:
    """Settings of :class:`SelfModelAgent`."""

    seconds: float = 60.0  #: Length of an episode.
    gyro_noise: float = 0.0  #: Standard deviation that the gyroscope is known to have, rad/s.
    channels: tuple[int, ...] = tuple(range(9))  #: Observations that the self-model uses.
    #: Actions after an alarm at which the robot is inferred.
    inferences: tuple[int, ...] = (3, 5, 8, 12, 18, 27, 40)
    generations: int = 150  #: Of the refinement of a gait; 0 only chooses from the library.
    inference_seconds: float = 0.1  #: Charged for an inference.
    refinement_seconds: float = 1.2  #: Charged for a refinement.
    seed: int = 0


class Event(NamedTuple):
    """Something that the agent noticed or decided."""

    seconds: float  #: Of the episode.
    what: str  #: "alarm", "inferred", "dismissed", "gait" or "refined".
    about: str
    cpu: float  #: CPU seconds that it took.


@dataclass
class _Gait:
    """A gait in use: a policy, and the action at which it began."""

    controller: Controller
    policy: Any
    began: int


@dataclass
class _Thought:
    """A result that may be used from an action on."""

    due: int
    event: Event
    gait: Controller | None = None
    found: Recognised | None = None


@dataclass
class _Watch:
    """Sums of surprise, compared with what chance and the model's own error explain."""

    used: int
    squares: list[float] = field(default_factory=list)
    highest: dict[int, float] = field(default_factory=dict)

    def sums(self) -> dict[int, float]:
        """Return the sums of the windows that are full."""
        n = len(self.squares)
        return {w: sum(self.squares[-w:]) for w in WINDOWS if n >= w}

    def calibrate(self) -> None:
        """Take what is seen now for the model's own error."""
        for w, total in self.sums().items():
            self.highest[w] = max(self.highest.get(w, 0.0), total)

    def alarmed(self) -> bool:
        """Whether a window exceeds what was ever seen, and chance."""
        return any(
            total > max(_limit(w * self.used), MARGIN * self.highest.get(w, 0.0))
            for w, total in self.sums().items()
        )


@cache
def _limit(freedom: int) -> float:
    from scipy.stats import chi2

    return float(chi2.isf(ALARM, freedom))


class SelfModelAgent:
    """An agent (see ``gait.evaluate``) of one robot that models itself as it swims.

    Parameters
    ----------
    library
        Gaits, of which the first is swum first.
    config
        Settings.
    morphology
        The whole body.
    hold
        The environment's ``frame_skip``.
    """

    def __init__(
        self,
        library: Sequence[Controller],
        config: AgentConfig | None = None,
        morphology: Any = None,
        hold: int = 20,
    ) -> None:
        self.library, self.config, self.hold = list(library), config or AgentConfig(), hold
        self.dt = hold * TIMESTEP
        self.whole = Robot(Morphology.coerce(morphology).to_array(), np.ones(3))

    def begin(self, observation: ArrayLike, fin_angles: ArrayLike) -> None:
        """Begin an episode at rest, with the fins at known angles (3,), rad."""
        config = self.config
        sd = np.full(9, np.inf)
        sd[list(config.channels)] = 0.0
        sd[GYRO] = np.where(np.isfinite(sd[GYRO]), config.gyro_noise, np.inf)
        self.noise, self.bias = sd, np.zeros(9)
        self._models = [
            SelfModel(robot, fin_angles, sd, MODEL_ERROR * scale, self.hold)
            for robot in (self.whole, self.whole._replace(reactive=True))
            for scale in ERROR_SCALES
        ]
        self.model = self._models[0]
        self.drift = np.full(9, FLOOR)
        self._watch = _Watch(len(config.channels))
        self._history: list[tuple[Floats, Floats, Floats]] = []  # state before, action, observation
        self._thoughts: list[_Thought] = []
        self.events: list[Event] = []
        self._steps, self._action = 0, None
        self._alarm: int | None = None
        self._plan: list[int] = []
        self._rng = np.random.default_rng(config.seed)
        self._gait = self._start(self.library[0])
        self._recognition: Recognition | None = None
        self._rest = np.asarray(observation, float)

    def reset(self, info: dict[str, Any]) -> None:
        """Begin the episode of a vector environment of one robot; see ``gait.evaluate``."""
        self.begin(np.zeros(9), np.asarray(info["fin_angles"])[0])

    def act(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Return the action (3,) for an observation (9,) or more; or rows of one robot."""
        given = np.asarray(observation, float)
        seen = given.reshape(-1)[:9]
        if self._action is not None:
            self._notice(seen)
        self._take_up()
        felt = observe(self.model.state[:, None])[0]
        action = self._gait.policy(felt, (self._steps - self._gait.began) * self.dt)
        self._action = np.clip(np.float32(action), -1.0, 1.0)
        self._steps += 1
        return self._action.reshape(given.shape[:-1] + (3,))

    # What happened.

    def _notice(self, seen: Floats) -> None:
        assert self._action is not None
        action = self._action.astype(float)
        before = self.model.state
        observed = seen - self.bias
        if self._steps <= CALIBRATION:
            self._calibrate(action, observed)
        else:
            self.model.step(action)
            surprise = self.model.correct(observed)
            self._watch.squares.append(surprise.square)
        self._history.append((before, action, observed))
        del self._history[:-REMEMBERED]
        if self._steps <= CALIBRATION:
            return
        if self._alarm is None:
            if self._watch.alarmed():
                self._alarm, self._plan = self._steps, list(self.config.inferences)
                self._suspect()
                self._log("alarm", "the gyroscope is not as predicted")
        else:
            self._rows.append((before, action, observed))
            since = self._steps - self._alarm + 1
            if self._plan and since >= self._plan[0]:
                self._plan.pop(0)
                self._infer()
            if not self._plan:
                self._alarm = None

    def _calibrate(self, action: Floats, observed: Floats) -> None:
        """Step filters with several model errors, of which the likeliest will be used."""
        squares = []
        for model in self._models:
            model.step(action)
            squares.append(model.correct(observed).square)
            if self._steps == SETTLED:
                model.log_likelihood = 0.0
        best = int(np.argmax([model.log_likelihood for model in self._models]))
        self.model, self.intact = self._models[best], self._models[best].robot
        self._squares = [*getattr(self, "_squares", []), squares] if self._steps > 1 else [squares]
        if self._steps == CALIBRATION:
            for row in self._squares[SETTLED:]:
                self._watch.squares.append(row[best])
                self._watch.calibrate()
            self._measure_drift()

    def _measure_drift(self) -> None:
        """Measure the error of open-loop predictions, while nothing is broken."""
        squares = []
        for first in range(SETTLED, len(self._history) - DRIFT, 5):
            rows = self._history[first : first + DRIFT]
            predicted, _ = predict(
                [self.model.robot], rows[0][0], np.array([r[1] for r in rows]), self.hold
            )
            squares.append((predicted[0] - np.array([r[2] for r in rows])) ** 2)
        rms = np.sqrt(np.mean(squares, axis=(0, 1)))
        self.drift = np.sqrt(np.maximum(rms**2 - np.where(np.isfinite(self.noise), self.noise, 0.0) ** 2, FLOOR**2))

    def _suspect(self) -> None:
        """Remember the robot and its state a little before the alarm."""
        back = 2 if len(self.config.channels) > 3 else 5
        if not self.config.gyro_noise and self.drift.max() < 0.01:
            back = 0
        self._back = min(back, len(self._history) - 1)
        self._rows = self._history[-self._back - 1 :]
        self._bases = [self.model.robot]
        if not _same(self.model.robot, self.intact):
            self._bases.append(self.intact)

    def _infer(self) -> None:
        """Infer what broke from all since a little before the alarm."""
        began = time.process_time()
        back, rows = self._back, self._rows
        # The filter has followed the broken robot since: what it was before is simulated on.
        states = [rows[0][0]]
        for _, action, _ in rows[: back + 1]:
            _, ended = predict(self._bases[:1], states[-1], action[None], self.hold)
            states.append(ended[:, 0])
        actions, observed = np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
        tail = observed[back:]
        silent = (tail == tail[0]).all(axis=0) if len(tail) > 2 else (tail == 0.0).all(axis=0)
        sd = np.where(np.isfinite(self.noise), np.hypot(self.noise, self.drift), np.inf)
        tolerance = np.maximum(3.0 * self.drift, 0.02)
        tolerance[GYRO] = np.maximum(tolerance[GYRO], 5.0 * self.config.gyro_noise)
        search = Recognition(self._bases, sd, self.hold)
        found = search.find(states, observed, actions, silent, tolerance)
        cpu = time.process_time() - began
        event = Event(self._steps * self.dt, "inferred", str(found.hypothesis), cpu)
        self._think(_Thought(self._after(self.config.inference_seconds), event, found=found))

    # What to do about it.

    def _after(self, seconds: float) -> int:
        return self._steps + math.ceil(seconds / self.dt - 1e-9)

    def _think(self, thought: _Thought) -> None:
        self._thoughts.append(thought)

    def _take_up(self) -> None:
        """Use the results that are due."""
        due = [thought for thought in self._thoughts if thought.due <= self._steps]
        self._thoughts = [thought for thought in self._thoughts if thought.due > self._steps]
        for thought in due:
            self.events.append(thought.event)
            if thought.found is not None:
                self._adopt(thought.found, thought.event)
            elif thought.gait is not None:
                self._gait = self._start(thought.gait)

    def _adopt(self, found: Recognised, event: Event) -> None:
        """Become what was inferred, and choose a gait for it."""
        if not found.explained:
            self._log("unknown", "none of my hypotheses explains what I observe")
            return
        changed = not _same(found.robot, self.model.robot, ALIKE)
        self.bias = self.bias + found.bias
        self.noise = np.where(found.lost, np.inf, self.noise)
        self.model.noise = self.noise
        self._watch.used = int(np.isfinite(self.noise).sum())
        state = found.state
        late = self._steps - round(event.seconds / self.dt)
        for _, action, _ in self._history[len(self._history) - late :] if late else ():
            _, ended = predict([found.robot], state, action[None], self.hold)
            state = ended[:, 0]
        self.model.become(found.robot, state)
        self._watch.squares.clear()
        if not changed:
            return
        began = time.process_time()
        seconds = self._left()
        if seconds < 1.0:
            return
        far = imagine(self.library, found.robot, state, seconds)
        best = int(far.argmax())
        self._gait = self._start(self.library[best])
        self._log("gait", f"{best} of the library, {far[best]:.1f} units", time.process_time() - began)
        self._refine()

    def _left(self) -> float:
        return self.config.seconds - self._steps * self.dt

    def _refine(self) -> None:
        """Refine the gait for the state in which the robot will be when it is ready."""
        config = self.config
        self._thoughts = [thought for thought in self._thoughts if thought.gait is None]
        if not config.generations:
            return
        due = self._after(config.refinement_seconds)
        state, robot = self._foresee(due), self.model.robot
        left = config.seconds - due * self.dt
        if left < 2.0:
            return
        began = time.process_time()
        far = imagine(self.library, robot, state, left)
        start = int(np.argmax([f if len(c.bias) < 30 else -np.inf for f, c in zip(far, self.library, strict=True)]))
        gait, expected = refine(self.library[start], robot, state, left, config.generations, self._rng)
        cpu = time.process_time() - began
        event = Event(self._steps * self.dt, "refined", f"{far[start]:.1f} -> {expected:.1f} units", cpu)
        if expected > far.max():
            self._think(_Thought(due, event, gait=gait))

    def _foresee(self, due: int) -> Floats:
        """Return the state (25,) when action ``due`` is chosen, if the gait goes on until then."""
        policy = self._gait.controller.policy(
            angles_of_rows(self.model.state), self.model.robot.servo_gain
        )
        assert self._gait.began == self._steps
        state = self.model.state
        for k in range(due - self._steps):
            action = policy(observe(state[:, None])[0], k * self.dt)
            _, ended = predict([self.model.robot], state, np.clip(np.float32(action), -1, 1)[None].astype(float), self.hold)
            state = ended[:, 0]
        return state

    def _start(self, controller: Controller) -> _Gait:
        model = self.model
        policy = controller.policy(angles_of_rows(model.state), model.robot.servo_gain)
        return _Gait(controller, policy, self._steps)

    def _log(self, what: str, about: str, cpu: float = 0.0) -> None:
        self.events.append(Event(self._steps * self.dt, what, about, cpu))


def _same(one: Robot, other: Robot, tolerance: float = 1e-3) -> bool:
    return bool(
        np.allclose(one.body, other.body, rtol=0.0, atol=tolerance)
        and np.allclose(one.servo_gain, other.servo_gain, rtol=0.0, atol=tolerance)
    )
