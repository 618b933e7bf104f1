"""Many swimming robots at once, as a Gymnasium vector environment on the batched engine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import reckon, servo_speeds
from aquafish_gym.engines.worlds import World
from aquafish_gym.envs import batching, episode
from aquafish_gym.envs.attributes import RobotAttributes
from aquafish_gym.envs.autoreset import AutoresetMode, check_mode
from aquafish_gym.envs.episode import EpisodeConfig
from aquafish_gym.envs.robots import Robots
from aquafish_gym.envs.specification import check_limit
from aquafish_gym.envs.tasks import Step, Task, lane_task
from aquafish_gym.physics.arithmetic import TAU, Vector
from aquafish_gym.physics.layout import FIELDS, layout
from aquafish_gym.plans import AQUAFISH, PlanLike
from aquafish_gym.rendering import check_render_mode
from aquafish_gym.scenario import CHANNELS, Scenario
from aquafish_gym.sense import beyond_imu, observe
from aquafish_gym.utils.array_types import Flags, Floats, Info, Observations, Rows
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    finite_array,
    flag,
    integer,
)

Terms = dict[str, Floats]

MAXIMUM_ROBOTS = 1_000_000  # a slip of the finger should not fill the memory


class AquaFishVectorEnv(
    episode.FishEnvBase, RobotAttributes, VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]
):
    """Many of :class:`~aquafish_gym.envs.env.AquaFishEnv` in the lanes of one engine.

    Made by ``gym.make_vec("AquaFish-v0", num_envs=64)``. Spaces, rewards, start, end and ``info``
    are the single environment's, with a leading axis; each key of ``info`` has its mask ``_key``.
    Robot i, seeded with s, is the single robot seeded with s + i; in float64 it moves as that one
    does on the engine ``"numba"``, to the last bit.

    Parameters
    ----------
    morphology
        As the single environment's, for all; or (num_envs, S) sizes, one body each.
    engine
        ``"numba"``, thousands at once, which ``"auto"`` is here; or what the single environment
        takes: ``"pybullet"`` or a ``World``, one robot after another. Robots on PyBullet take
        28 MiB each, at most 1024 of them, and can be neither pickled, copied nor used after
        ``close``.
    render_mode
        ``"rgb_array"`` or None; ``render`` returns a frame a robot.
    dtype
        ``"float32"`` or ``"float64"``: the precision of the simulation. None is single precision,
        and double on other engines than numba, which have no other.
    threads
        Of the engine numba. None takes every core; no result depends on it.
    autoreset_mode
        An ``AutoresetMode`` or its name: ``"NextStep"``, ``"SameStep"`` or ``"Disabled"``.
    max_episode_steps
        Steps after which an episode is truncated; at most as many as the task's.

    The others are as the single environment's, for all.

    Examples
    --------
    >>> envs = AquaFishVectorEnv(num_envs=3, fin_angles="random")
    >>> observations, infos = envs.reset(seed=0)
    >>> observations, rewards, *_ = envs.step(np.zeros((3, 3), np.float32))
    >>> observations.shape, rewards.shape
    ((3, 9), (3,))
    """

    def __init__(
        self,
        num_envs: int = 1,
        morphology: object = None,
        damage: object = None,
        engine: str | type[World] = "numba",
        current: ArrayLike = (0.0, 0.0, 0.0),
        fin_angles: object = "random",
        observe_fins: bool | str = False,
        frame_skip: int = 20,
        render_mode: str | None = None,
        task: object = "forward",
        dtype: str | None = None,
        threads: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        reactive: bool = False,
        max_episode_steps: int | None = None,
        plan: PlanLike = AQUAFISH,
    ) -> None:
        super().__init__(task, frame_skip, observe_fins, plan)
        fins = len(self.plan.fins)
        self.num_envs = integer("num_envs", num_envs, 1, MAXIMUM_ROBOTS)
        self.autoreset_mode = check_mode(autoreset_mode)
        if isinstance(render_mode, str) and render_mode == "human":
            raise InvalidArgumentError(
                'render_mode="human" shows one robot: use gym.make; "rgb_array" gives a frame each'
            )
        self.render_mode = check_render_mode(render_mode)
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": max(1, round(1 / self.dt)),
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_observation_space = episode.observation_space(self._limits)
        self.single_action_space = episode.action_space(self.plan)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

        start = episode.check_episode(
            self.task, current=current, hold=self.frame_skip, plan=self.plan
        )
        if max_episode_steps is not None:
            limit = integer("max_episode_steps", max_episode_steps, 1)
            check_limit(limit, self._last, self.task, self.dt)
            self._last = limit
            start = start.within(limit * self.dt)
        self._everyone = np.arange(self.num_envs)
        self._configs = batching.with_options(
            [start] * self.num_envs,
            {"morphology": morphology, "damage": damage, "fin_angles": fin_angles},
            self._everyone,
        )
        fields = {
            "body": np.array([config.morphology.to_array() for config in self._configs]),
            "current": np.tile(start.current, (self.num_envs, 1)),
        }
        scenario = Scenario.fill(fields, flag("reactive", reactive), self.plan)
        late = any(config.damage.may_be_late for config in self._configs)
        self._robots = Robots(scenario, self.frame_skip, late)
        self._memory: Floats = np.zeros((0, self.num_envs))
        self._swimmers = batching.make_swimmers(scenario, engine, dtype, threads)
        self._known_task: Task | None = None
        self._lane_task: Any = None  # what lanes take of it
        self._steps: NDArray[np.int64] = np.full(self.num_envs, self._last)
        self._rngs: list[np.random.Generator] = []
        self._seen: Observations = np.zeros((self.num_envs, len(self._limits)), np.float32)
        self._reckoned: Floats = np.zeros((fins, self.num_envs))
        self._water: Floats = np.zeros((self.num_envs, 3))  # of the task, which no scenario knows

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, Info]:
        """Begin an episode of every robot, or of those under ``options["reset_mask"]``.

        Robot i takes seed + i, or its own of a list; without a seed its generator continues.
        ``options`` are the single environment's, one for all or one for each robot, and
        ``reset_mask`` (num_envs,) of bool.
        """
        seeds = batching.check_seeds(seed, self.num_envs)
        given = episode.check_options(options)
        mask = np.ones(self.num_envs, np.bool_)
        if "reset_mask" in given:
            mask = batching.check_mask(given.pop("reset_mask"), self.num_envs)
        if not self._rngs and not mask.all():
            raise ResetNeeded("the first reset must be of every robot")
        rows = np.flatnonzero(mask)
        configs = batching.with_options(self._configs, given, rows)  # may refuse
        self._seed(seeds, rows)
        self._begin(rows, configs)
        self._sense(rows, self._truth(rows))
        return self._seen.copy(), batching.masked(self._first_info(), mask)

    def step(self, actions: NDArray[np.float32]) -> tuple[Observations, Floats, Flags, Flags, Info]:
        """Set every robot's servos, actions (num_envs, F), for ``frame_skip`` physics steps.

        Raises
        ------
        InvalidArgumentError, ResetNeeded
            If the actions are not finite numbers of that shape, before the first reset, or after
            an episode's end with autoreset disabled.
        """
        over = self._episodes_over()
        action = self._check_actions(actions)
        before = self._positions()
        lost, seen, terms = self._swim(action)
        lost &= ~over  # these swam for nothing
        terms, succeeded = self._judge(before, action, terms, lost | over)
        terminated = lost | succeeded
        # Also what ends in the last step, as Gymnasium's TimeLimit has it for one robot.
        truncated = (self._steps == self._last) & ~over
        self._steps[terminated] = self._last
        self._change(terminated | over)
        if over.any():
            self._begin_again(over, before, seen)
        self._observe(seen)
        info = batching.masked(
            self._info(before, terms, lost, succeeded), np.ones(self.num_envs, np.bool_)
        )
        reward: Floats = sum(terms.values(), np.zeros(self.num_envs))
        ended = self._steps == self._last
        if ended.any() and self.autoreset_mode is AutoresetMode.SAME_STEP:
            info = self._begin_at_once(ended, info)
        return self._seen.copy(), reward, terminated, truncated, info

    @property
    def states(self) -> Floats:
        """The true states (rows, num_envs), in the order of ``aquafish_gym.physics.layout``.

        ``gait.evolve_gait`` can begin in one.
        """
        return self._swimmers.states.astype(np.float64)

    def _check_actions(self, actions: object) -> Floats:
        """Return actions (num_envs, F) clipped to [-1, 1], as rows (F, num_envs)."""
        raw = episode.float_action(actions, (self.num_envs, len(self.plan.fins)))
        if not np.isfinite(raw).all():
            finite_array("action", raw, raw.shape)  # refuses
        action: Floats = np.clip(raw.T, -1.0, 1.0, dtype=np.float64)
        return action

    def _episodes_over(self) -> Flags:
        """Return whose episode is over (num_envs,), and which begins another one in this step."""
        over: Flags = self._steps == self._last
        if not self._rngs or (over.any() and self.autoreset_mode is not AutoresetMode.NEXT_STEP):
            raise ResetNeeded("an episode is over or has not begun: call reset() before step()")
        return over

    def _swim(self, action: Floats) -> tuple[Flags, Observations, Terms]:
        """Swim one step; return which robots diverged, and what intact sensors observe of the IMU.

        And the terms of the reward, if the engine knows them.
        """
        water = None
        if type(self.task).current is not Task.current:
            water = self.task.current(tuple(self._memory), self._steps * self.dt)
        if water is not None:
            x, y, z = water
            for axis, speed in enumerate((x, y, z)):
                self._water[:, axis] = speed
            self._swimmers.set_current(self._water)
        if self.task is not self._known_task:
            self._known_task = self.task
            self._lane_task = lane_task(self.task)
        commanded = tuple(action)
        lost, seen, values = self._swimmers.act(
            action, self._robots.follow(commanded), self.frame_skip, self._lane_task, self._memory
        )
        if self._reckons:
            speeds = servo_speeds(self.plan, commanded)
            reckoned = reckon(tuple(self._reckoned), speeds, TAU * self.dt)
            self._reckoned = np.where(lost, self._reckoned, reckoned)
        self._steps += 1
        judged: Any = self.task
        terms = {} if values is None else dict(zip(judged.terms, values, strict=False))
        return lost, seen, terms

    def _judge(
        self, before: Floats, action: Floats, terms: Terms, void: Flags
    ) -> tuple[Terms, Flags]:
        """Return the reward's terms, and which robots succeeded; let the task remember.

        Nothing counts of the robots under ``void``. ``terms`` are there if the engine judged.
        """
        task = self.task
        succeeded = np.zeros(self.num_envs, np.bool_)
        if terms:
            for value in terms.values() if void.any() else ():
                value[void] = 0.0
            return terms, succeeded
        step = self._step_from(before, action)
        terms = {
            name: np.where(void, 0.0, np.asarray(value, np.float64))
            for name, value in task.reward_terms(step).items()
        }
        if task.has_success:
            succeeded = np.asarray(task.succeeded(step)).astype(np.bool_) & ~void
        if type(task).remember is not Task.remember:
            pairs = zip(self._memory, task.remember(step), strict=True)
            self._memory = np.array([np.where(void, old, new) for old, new in pairs])
        return terms, succeeded

    def _positions(self) -> Floats:
        """Return copies of the robots' positions, as rows (3, num_envs)."""
        return self._swimmers.states[FIELDS["position"]].astype(np.float64)

    def _step_from(self, before: Floats, action: Floats) -> Step:
        x, y, z, w = self._swimmers.states[FIELDS["orientation"]].astype(np.float64)
        here, there = _vector(before), _vector(self._positions())
        return Step(here, there, (x, y, z, w), tuple(action), tuple(self._memory), self.dt)

    def _change(self, bad: Flags) -> None:
        """Let robots whose next change has come change, except those under ``bad``."""
        due = self._robots.next_change == self._steps * self.frame_skip
        if due.any():
            changed = np.flatnonzero(due & ~bad)
            self._robots.change(changed)
            self._swimmers.update(self._engine_robots(changed), changed)
            if self._water.any():
                self._swimmers.set_current(self._water)

    def _engine_robots(self, rows: Rows) -> Scenario:
        return self._robots.now.take(rows)

    def _begin(self, rows: Rows, configs: Sequence[EpisodeConfig] = ()) -> None:
        """Put robots at the start of new episodes, by default as they are configured."""
        configs = configs or [self._configs[i] for i in rows.tolist()]
        rngs = [self._rngs[i] for i in rows.tolist()]
        start, memories = episode.begin_episodes(configs, rngs, self.frame_skip)
        self._steps[rows] = 0
        self._robots.start(rows, start)
        if memories.shape[1] != len(self._memory):
            self._memory = np.zeros((memories.shape[1], self.num_envs))
        self._memory[:, rows] = memories.T
        self._reckoned[:, rows] = start.fin_angles.T
        self._water[rows] = 0.0
        self._swimmers.start(self._engine_robots(rows), rows)

    def _begin_again(self, over: Flags, before: Floats, seen: Observations) -> None:
        """Begin the next episodes of the robots under ``over``, at the origin and not moving."""
        rows = np.flatnonzero(over)
        self._begin(rows)
        before[:, over] = 0.0
        seen[over] = self._truth(rows)[:, : seen.shape[1]]

    def _begin_at_once(self, ended: Flags, info: Info) -> Info:
        """Begin the next episodes within the step that ended them; return ``info`` of both."""
        last = self._seen.copy()
        rows = np.flatnonzero(ended)
        self._begin(rows)
        self._sense(rows, self._truth(rows))
        return batching.put_final(info, self._first_info(), last, ended)

    def _truth(self, rows: Rows) -> Observations:
        """Return what intact sensors of these robots observe."""
        return observe(layout(self.plan).state(self.states[:, rows]), *self._further(rows))

    def _further(self, rows: Rows | slice) -> tuple[Floats | None, Vector | None]:
        """Return what these robots observe beyond nine channels: fins (F, n) in rad, the goal."""
        fins = goal = None
        if self._observe_fins:
            known = (
                self._reckoned if self._reckons else layout(self.plan).angles(self._swimmers.states)
            )
            fins = known[:, rows]
        if self.task.has_goal:
            goal = self.task.goal(tuple(self._memory[:, rows]))
        return fins, goal

    def _observe(self, seen: Observations) -> None:
        """Let all robots observe; intact sensors observe ``seen`` in nine channels."""
        most = self._limits[len(CHANNELS) :]
        if most.size:
            more = np.transpose(
                beyond_imu(layout(self.plan).state(self.states), *self._further(slice(None)))
            )
            seen = np.concatenate([seen, np.clip(more, -most, most)], axis=1, dtype=np.float32)
        self._sense(self._everyone, seen)

    def _sense(self, rows: Rows, seen: Observations) -> None:
        """Let the sensors of these robots observe what intact ones do."""
        sensors = self._robots.sensors
        if sensors.broken:
            seen = sensors.observe(seen, -self._limits, self._limits, self._rngs, rows)
        if len(rows) == self.num_envs:
            self._seen = seen
        else:
            self._seen[rows] = seen

    def _info(self, before: Floats, terms: Terms, diverged: Flags, succeeded: Flags) -> Info:
        """Return ``info`` of a step that began at these positions (3, num_envs)."""
        here = self._positions()
        velocity = (here - before) / self.dt
        moved = episode.motion_info(_vector(here), _vector(velocity))
        info = moved | {
            "diverged": diverged.copy(),
            **({"is_success": succeeded.copy()} if self.task.has_success else {}),
            "fin_angles": np.ascontiguousarray(layout(self.plan).angles(self._swimmers.states).T),
            **self._robots.truth(),
        }
        episode.refuse_reserved(terms, info)
        return info | terms

    def _first_info(self) -> Info:
        """Return ``info`` where no step was taken: the reward's terms are 0."""
        zeros = np.zeros(self.num_envs)
        here = self._positions()
        step = self._step_from(here, np.zeros((len(self.plan.fins), self.num_envs)))
        nothing = dict.fromkeys(self.task.reward_terms(step), zeros)
        none = np.zeros(self.num_envs, np.bool_)
        return self._info(here, nothing, none, none)

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ARG002
        """Free what the engine holds; see ``close``."""
        if hasattr(self, "_swimmers"):  # Gymnasium closes refused environments, too
            self._swimmers.close()

    def render(self) -> tuple[Any, ...] | None:
        """Return a frame (480, 640, 3) uint8 for each robot; None without a mode."""
        if self.render_mode is None:
            return None
        return batching.frames(self.plan, self._robots.now.body, self.states)


def _vector(rows: Floats) -> Vector:
    x, y, z = rows
    return (x, y, z)
