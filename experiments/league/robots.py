"""The robots that the learned rivals train on, as a vector environment of stable-baselines3."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from aquafish.online.gaits import load_library
from aquafish.online.self_model import imu_readings
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.envs.vector import AquaFishVectorEnv
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.plans import AQUAFISH
from aquafish_gym.utils.array_types import Flags, Floats, Rows
from experiments.league.policy import DT, INTERVAL, begin_inputs, drive
from gait.learning.sb3_env import SB3VecEnv

Numbers = NDArray[np.float32]

NOMINAL = Morphology.nominal().to_array()
SIZES = 23, 9, 3  # of what is sensed, of what breaks and of the velocity
#: Tiers of the robots in turn: most is to be learned from severe damage.
TIERS = ("severe", "severe", "moderate", "severe", "mild", "severe", "none", "moderate")
LARGEST_ACTION = 3.0  # that a learner may ask for; the servos obey at most 1
OVERSHOOT = 1.5  # from which on it costs, so that the mean stays where actions differ
OVERSHOOT_COST = 0.02
REWARD_SCALE = 0.1
GROUP_ACTIONS = 25  # from the begin of one group's episodes to that of the next
# Of water that is not known: factors on the drag of fins and body and on the fins' mass.
LEAST_FACTORS = (0.35, 0.4, 0.7)
MOST_FACTORS = (1.5, 2.0, 1.5)
HOME_SHARE = 0.15  # of the episodes, in known water
PUSHED_SHARE = 0.7  # of the episodes, which begin turned and moving
TURN_DEVIATIONS = (0.25, 0.25, 0.6)  # rad about the body's axes
VELOCITY_DEVIATION = 0.3  # units/s
SPIN_DEVIATION = 0.5  # rad/s


@dataclass(frozen=True)
class Conditions:
    """What robots swim in while a policy learns."""

    onset: str = "0-8"  #: When something breaks, s, in the damage grammar.
    seconds: float = 30.0  #: Length of an episode.
    noise: float = 0.0  #: Standard deviation of the gyroscope's noise, rad/s.
    any_water: bool = False  #: Whether each episode has a water of its own.
    unknown_share: float = 0.0  #: Of the episodes, in which the initial fin angles are not known.


class OtherWater(AquaFishVectorEnv):
    """Robots each of whose episodes has another water, and begins in mid-motion."""

    rng: np.random.Generator

    def _begin(self, rows: Rows, configs: Sequence[Any] = ()) -> None:
        count = len(rows)
        factors = np.exp(self.rng.uniform(np.log(LEAST_FACTORS), np.log(MOST_FACTORS), (count, 3)))
        factors[self.rng.random(count) < HOME_SHARE] = 1.0
        if not hasattr(self, "_factors"):
            self._factors = np.ones((self.num_envs, 3))
        self._factors[rows] = factors
        super()._begin(rows, configs)
        pushed = self.rng.random(count)[:, None] < PUSHED_SHARE
        turn = pushed * self.rng.normal(0.0, TURN_DEVIATIONS, (count, 3))
        velocity = pushed * self.rng.normal(0.0, VELOCITY_DEVIATION, (count, 3))
        spin = pushed * self.rng.normal(0.0, SPIN_DEVIATION, (count, 3))
        states = self._swimmers.states
        states[FIELDS["orientation"], rows] = Rotation.from_rotvec(turn).as_quat().T
        states[FIELDS["velocity"], rows] = velocity.T
        states[FIELDS["spin"], rows] = spin.T

    def _engine_robots(self, rows: Rows) -> Any:
        robots = super()._engine_robots(rows)
        return replace(robots, drag=self._factors[rows, :2], fin_density=self._factors[rows, 2])


class TrainingRobots(SB3VecEnv):
    """Robots that observe everything that a teacher is told, and its critic.

    An observation (38,) is that of :class:`~aquafish.online.teacher.Teacher` (35,) and the
    velocity (3,). Groups of them begin one after another: otherwise all robots would show the same
    part of an episode at a time.

    Parameters
    ----------
    count
        Number of robots.
    conditions
        What they swim in.
    seed
        Of the episodes.

    Attributes
    ----------
    begun
        (B,) whose episode begins with the last observation.
    """

    def __init__(self, count: int, conditions: Conditions, seed: int) -> None:
        self.conditions = conditions
        self._gait = load_library()[0]
        self._episode = round(conditions.seconds / DT)
        self._rng = np.random.default_rng([seed, 1])
        noise = f"gyro:noise={conditions.noise}; " if conditions.noise else ""
        damage = [
            noise + f"random:{tier}@{conditions.onset}" if tier != "none" else noise[:-2]
            for tier in np.resize(TIERS, count).tolist()
        ]
        kind = OtherWater if conditions.any_water else AquaFishVectorEnv
        envs = kind(
            count,
            damage=damage,
            fin_angles="random",
            frame_skip=INTERVAL,
            task=SwimForward(seconds=conditions.seconds),
            threads=1,
            autoreset_mode=AutoresetMode.DISABLED,
        )
        if isinstance(envs, OtherWater):
            envs.rng = np.random.default_rng([seed, 2])
        self._true = begin_inputs(np.zeros((count, 3)))
        self._reckoned = begin_inputs(np.zeros((count, 3)))
        self._previous: Numbers = np.zeros((count, 3), np.float32)
        self.begun: Flags = np.zeros(count, np.bool_)
        self._robots = envs
        super().__init__(envs, Box(-np.inf, np.inf, (sum(SIZES) + 3,), np.float32))
        self.action_space = Box(-LARGEST_ACTION, LARGEST_ACTION, (3,), np.float32)
        self.seed(seed)

    def reset(self) -> Numbers:
        """Begin an episode of every robot, one group after another; return what all observe."""
        observations = self.start()
        robots = np.arange(self.num_envs)
        groups = self._episode // GROUP_ACTIONS
        for k in range(groups):
            observations = self._begin(robots * groups // self.num_envs == k)
            for _ in range(GROUP_ACTIONS):
                observations, *_ = self.step(np.zeros((self.num_envs, 3), np.float32))
        self.earned[:] = np.nan
        return observations

    def start(self) -> Numbers:
        """Begin an episode of every robot at once; return what all observe."""
        return np.asarray(super().reset())

    def pace(self, act: Callable[[Numbers], Numbers], onset: float) -> float:
        """Return the mean pace along +y, units/s, from ``onset``, s, to the end of an episode.

        ``act`` takes what all robots observe.
        """
        observed = self.start()
        first = round(onset / DT)
        last = self._episode - 1  # in the next step another episode begins
        for k in range(last):
            if k == first:
                begun = self._northings()
            observed, *_ = self.step(act(observed))
        return float((self._northings() - begun).mean() / (DT * (last - first)))

    def _northings(self) -> Floats:
        return np.asarray(self._robots.states[FIELDS["position"]][1])

    def step_async(self, actions: Numbers) -> None:
        """Take actions (B, 3), which the servos obey within [-1, 1]."""
        self._asked = actions
        self._previous = np.clip(actions, -1.0, 1.0, dtype=np.float32)
        super().step_async(self._previous)

    def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
        """Return observations, rewards, whether episodes ended, and information."""
        self.begun = np.zeros(self.num_envs, np.bool_)
        self._true.follow(self._previous)
        self._reckoned.follow(self._previous)
        observations, rewards, done, infos = super().step_wait()
        over = np.maximum(np.abs(self._asked) - OVERSHOOT, 0.0)
        cost = OVERSHOOT_COST * np.square(over).sum(axis=1)
        return observations, (REWARD_SCALE * rewards - cost).astype(np.float32), done, infos

    def sensed(self) -> Numbers:
        """Return what robots sense (B, 23): a gait's inputs, the last action and the gait's own.

        The fin angles are reckoned from the initial ones, or from 0 where these are not known.
        """
        return self._with_gait(self._reckoned.observe(self._readings))

    def truth(self) -> tuple[Numbers, Numbers]:
        """Return the same (B, 23) of whole sensors and true fin angles, and what broke (B, 12).

        What broke are the sizes relative to the nominal ones, and the servo gains, less 1.
        """
        states = self._robots.states
        self._true.fin_angles = layout(AQUAFISH).angles(states).T
        now = self._robots._robots.now
        broken = np.hstack([now.body / NOMINAL - 1.0, now.servo_gain - 1.0])
        seen = self._true.observe(imu_readings(states))
        return self._with_gait(seen), broken.astype(np.float32)

    def _with_gait(self, seen: Floats) -> Numbers:
        inputs = np.ascontiguousarray(seen, np.float32)
        gait = drive(self._gait, inputs).clip(-1.0, 1.0)
        return np.hstack([inputs, self._previous, gait])

    def _begun(self, mask: Flags, info: dict[str, Any]) -> None:
        drawn = self._rng.random((self.num_envs, 1))
        angles = info["fin_angles"] * (drawn >= self.conditions.unknown_share)
        self._true.begin(mask, info["fin_angles"][mask])
        self._reckoned.begin(mask, angles[mask])
        self._previous[mask] = 0.0
        self.begun |= mask

    def _observe(self, observations: Numbers) -> Numbers:
        self._readings = observations.astype(np.float64)
        velocity = self._robots.states[FIELDS["velocity"]].T
        return np.hstack([*self.truth(), velocity]).astype(np.float32)

    def _infos(self, table: Any, done: Flags) -> list[dict[str, Any]]:
        """Return how episodes ended, for the robots whose did: learning reads nothing else."""
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for i in np.flatnonzero(done).tolist():
            infos[i] = {
                name: table.entry(name, i)
                for name in ("TimeLimit.truncated", "terminal_observation")
            }
        return infos
