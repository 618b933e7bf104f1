"""Many swimming robots at once, as a Gymnasium vector environment on the batched engine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.base import ENGINES, MAXIMUM_THREADS, TIMESTEP
from aquafish_gym.engines.packages import AUTO
from aquafish_gym.engines.worlds import RUNAWAY
from aquafish_gym.envs import conditions
from aquafish_gym.envs.tasks import SwimForward
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.physics.layout import FIELDS, angles_of_rows
from aquafish_gym.rendering import check_render_mode, render_pose
from aquafish_gym.utils.validation import InvalidArgumentError, brief, flag, integer, one_of

Floats = NDArray[np.float64]
Observations = NDArray[np.float32]
Mask = NDArray[np.bool_]
Info = dict[str, Any]

MAXIMUM_ROBOTS = 1_000_000  # a slip of the finger should not fill the memory
AUTORESET_MODES = {mode.value: mode for mode in AutoresetMode}

# Rows of a table of states.
QUATERNION, POSITION, GYRO = FIELDS["orientation"], FIELDS["position"], FIELDS["spin"]
SPEEDS = slice(FIELDS["velocity"].start, GYRO.stop)


class AquaFishVectorEnv(VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]):
    """Many of :class:`~aquafish_gym.envs.aquafish.AquaFishEnv` in the lanes of one engine.

    ``gym.make_vec("AquaFish-v0", num_envs=64)`` makes one. Spaces, rewards, start, end and
    ``info`` are the single environment's, with a leading axis; each key of ``info`` has its
    mask ``_key``. Robot i, seeded with s, is the single robot seeded with s + i; in float64 it
    moves as that one does on the engine ``"numba"``, to the last bit.

    Parameters
    ----------
    morphology
        As the single environment's, for all; or (num_envs, 9) sizes, one body each.
    engine
        ``"numba"``, the only batched one, and so what ``"auto"`` is here.
    render_mode
        ``"rgb_array"`` or None; ``render`` returns a frame a robot.
    dtype
        ``"float32"`` or ``"float64"``: what the robots compute in.
    threads
        None takes every core; no result depends on it.
    autoreset_mode
        An ``AutoresetMode`` or its name: ``"NextStep"``, ``"SameStep"`` or ``"Disabled"``.

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
        engine: str = "numba",
        current: ArrayLike = (0.0, 0.0, 0.0),
        fin_angles: object = "zero",
        observe_fins: bool = False,
        frame_skip: int = 5,
        render_mode: str | None = None,
        forward_reward_weight: float = 1.0,
        ctrl_cost_weight: float = 1e-4,
        dtype: str = "float32",
        threads: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        reactive: bool = False,
    ) -> None:
        from aquafish_gym.engines.compiled.lanes import LaneBatch

        self.num_envs = integer("num_envs", num_envs, 1, MAXIMUM_ROBOTS)
        if one_of("engine", engine, (AUTO, *ENGINES)) not in (AUTO, "numba"):
            raise InvalidArgumentError(
                f'the batched environment runs on engine="numba" alone; for engine={engine!r} '
                'use gym.make_vec(..., vectorization_mode="sync")'
            )
        if isinstance(autoreset_mode, AutoresetMode):
            self._autoreset = autoreset_mode
        else:
            name = one_of("autoreset_mode", autoreset_mode, AUTORESET_MODES)
            self._autoreset = AUTORESET_MODES[name]
        if isinstance(render_mode, str) and render_mode == "human":
            raise InvalidArgumentError(
                'render_mode="human" shows one robot: use gym.make; "rgb_array" gives a frame each'
            )
        self.render_mode = check_render_mode(render_mode)
        self._task = SwimForward(forward_reward_weight, ctrl_cost_weight)
        self._observe_fins = flag("observe_fins", observe_fins)
        self.frame_skip = conditions.check_frame_skip(frame_skip)
        self.metadata = {
            "render_modes": ["rgb_array"],
            "render_fps": max(1, round(1 / self.dt)),
            "autoreset_mode": self._autoreset,
        }
        self.single_observation_space = conditions.observation_space(self._observe_fins)
        self.single_action_space = conditions.action_space()
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

        # Robots of one body share one start.
        several = _bodies(morphology, self.num_envs)
        starts = [
            conditions.check_conditions(body, damage, current, fin_angles) for body in several
        ]
        self._starts = starts if len(starts) > 1 else starts * self.num_envs
        # Of the present episodes.
        self._sizes = np.stack([start.sizes for start in self._starts])
        self._damages = np.array([start.broken for start in self._starts], dtype=object)
        self._lanes = LaneBatch(
            self._sizes,
            np.zeros((self.num_envs, 3)),
            starts[0].current,
            getattr(np, one_of("dtype", dtype, ("float32", "float64"))),
            threads=None if threads is None else integer("threads", threads, 1, MAXIMUM_THREADS),
            reactive=flag("reactive", reactive),
        )
        # The states (25, num_envs) that are now, or were before a robot diverged.
        self._now = self._lanes.rows()
        self._steps_left: NDArray[np.int64] = np.zeros(self.num_envs, np.int64)
        self._rngs: list[np.random.Generator] = []
        self._begun = False

    @property
    def dt(self) -> float:
        """Length of one step, s."""
        return TIMESTEP * self.frame_skip

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, Info]:
        """Begin an episode of every robot, or of those under ``options["reset_mask"]``.

        Robot i takes seed + i, or its own of a list; without a seed the generators go on, and so
        do robots that are not reset. ``options`` are the single environment's, the same for all,
        and ``reset_mask`` (num_envs,) of bool.
        """
        seeds = _check_seeds(seed, self.num_envs)
        mask = np.ones(self.num_envs, np.bool_)
        if isinstance(options, Mapping) and "reset_mask" in options:
            mask = _check_mask(options["reset_mask"], self.num_envs)
        if not self._begun and not mask.all():
            raise ResetNeeded("the first reset must be of every robot")
        starts = self._chosen(mask, options)  # may refuse: nothing has changed until here
        if not self._rngs:
            self._rngs = [seeding.np_random(s)[0] for s in seeds]
        else:
            for i in np.flatnonzero(mask).tolist():
                if seeds[i] is not None:
                    self._rngs[i] = seeding.np_random(seeds[i])[0]
        self._begin(mask, starts)
        self._begun = True
        return self._observation(), _masked(self._info(self._now), mask)

    def step(self, actions: NDArray[np.float32]) -> tuple[Observations, Floats, Mask, Mask, Info]:
        """Set every robot's servos, actions (num_envs, 3), for ``frame_skip`` physics steps.

        Raises
        ------
        InvalidArgumentError, ResetNeeded
            If the actions are not finite numbers of that shape, before the first reset, or after
            an episode's end with autoreset disabled.
        """
        checked = conditions.check_action(actions, (self.num_envs, 3))
        over = self._steps_left == 0
        if not self._begun or (over.any() and self._autoreset is not AutoresetMode.NEXT_STEP):
            raise ResetNeeded("an episode is over or has not begun: call reset() before step()")
        commands = np.array(conditions.servo_speeds(_three(checked.T))).T
        lost = self._lanes.advance(commands, self.frame_skip).diverged
        before, now = self._now, self._lanes.rows()
        with np.errstate(over="ignore", invalid="ignore"):
            lost |= ~(np.square(now[SPEEDS]).sum(axis=0) < RUNAWAY)
        # Robots that diverged stay at what was last good; a robot whose episode was over has
        # swum for nothing, and begins anew.
        diverged = lost & ~over
        if lost.any():
            now[:, lost] = before[:, lost]
        self._now = now
        self._steps_left -= 1
        self._steps_left[diverged] = 0
        here, there = _three(before[POSITION]), _three(now[POSITION])
        terms = self._task.reward_terms(here, there, _three(checked.T), self.dt)
        bad = diverged | over
        if bad.any():
            terms = {name: np.where(bad, 0.0, value) for name, value in terms.items()}
        if over.any():
            self._begin(over, self._chosen(over))
            before[:, over] = now[:, over]
        ended = self._steps_left == 0
        everyone = np.ones(self.num_envs, np.bool_)
        info = _masked({**self._info(before), "diverged": diverged}, everyone)
        info |= _masked(terms, ~over)
        if ended.any() and self._autoreset is AutoresetMode.SAME_STEP:
            last = self._observation()
            self._begin(ended, self._chosen(ended))
            info = _put_final(info, _masked(self._info(now), ended), last, ended)
        reward = np.asarray(sum(terms.values()))
        return self._observation(), reward, diverged, ended & ~diverged, info

    def _chosen(
        self, mask: Mask, options: dict[str, Any] | None = None
    ) -> list[conditions.Conditions]:
        """Return how the robots under ``mask`` shall begin."""
        starts = [self._starts[i] for i in np.flatnonzero(mask).tolist()]
        if options is None:
            return starts
        different = {id(start): start for start in starts}
        made = {key: one.with_options(options, ("reset_mask",)) for key, one in different.items()}
        return [made[id(start)] for start in starts]

    def _begin(self, mask: Mask, starts: list[conditions.Conditions]) -> None:
        """Put the robots under ``mask`` back to their starts."""
        chosen = np.flatnonzero(mask).tolist()
        angles = np.empty((len(chosen), 3))
        for row, (i, start) in enumerate(zip(chosen, starts, strict=True)):
            self._sizes[i] = start.sizes
            self._damages[i] = start.broken
            angles[row] = start.draw_fin_angles(self._rngs[i])
        self._lanes.replace(mask, self._sizes[mask], angles)
        self._now[:, mask] = self._lanes.rows()[:, mask]
        self._steps_left[mask] = conditions.EPISODE_STEPS // self.frame_skip

    def _observation(self) -> Observations:
        now = self._now
        fins = angles_of_rows(now) if self._observe_fins else None
        return conditions.observe(now[QUATERNION], now[GYRO], fins)

    def _info(self, before: Floats) -> Info:
        """Return what is to be told, after a step from the states ``before``."""
        here, there = _three(before[POSITION]), _three(self._now[POSITION].copy())
        return conditions.motion_info(here, there, self.dt) | {
            "diverged": np.zeros(self.num_envs, np.bool_),
            "fin_angles": angles_of_rows(self._now).T.copy(),
            "damage": self._damages.copy(),
            "morphology": self._sizes.copy(),
        }

    def render(self) -> tuple[Any, ...] | None:
        """Return a frame (480, 640, 3) uint8 for each robot; None without a mode."""
        if self.render_mode is None:
            return None
        now = self._now
        robots = (self._sizes, now[POSITION].T, now[QUATERNION].T, angles_of_rows(now).T)
        return tuple(
            render_pose(Morphology.from_array(sizes), (position, quaternion), angles)
            for sizes, position, quaternion, angles in zip(*robots, strict=True)
        )


def _three(rows: Floats) -> Vector:
    x, y, z = rows
    return (x, y, z)


def _bodies(morphology: object, count: int) -> list[Any]:
    """Return one body for all robots, or one for each from (count, 9) sizes."""
    several = isinstance(morphology, np.ndarray) and morphology.ndim == 2
    if isinstance(morphology, list | tuple) and morphology:
        several = not isinstance(morphology[0], int | float | np.number)
    if not several:
        return [morphology]
    each: list[Any] = list(morphology)  # type: ignore[call-overload]
    if len(each) != count:
        raise InvalidArgumentError(
            f"morphology must be one body or num_envs = {count} of them; got {len(each)}"
        )
    return each


def _check_seeds(seed: object, count: int) -> list[int | None]:
    """Return a seed for each robot, from one number, one each, or None."""
    if seed is None:
        return [None] * count
    # Bytes are a sequence of whole numbers, and no seeds.
    if not isinstance(seed, list | tuple | range) and not (
        isinstance(seed, np.ndarray) and seed.ndim
    ):
        first = integer("seed", seed, 0)
        return [first + i for i in range(count)]
    if len(seed) != count:
        raise InvalidArgumentError(f"seed must be one number or {count} of them; got {len(seed)}")
    return [None if s is None else integer(f"seed[{i}]", s, 0) for i, s in enumerate(seed)]


def _check_mask(mask: object, count: int) -> Mask:
    """Return which robots (count,) shall be reset: at least one."""
    try:
        found = np.asarray(mask)
    except (ValueError, RecursionError):  # ragged, or too deep
        found = np.zeros(0)
    if found.dtype.kind != "b" or found.shape != (count,) or not found.any():
        raise InvalidArgumentError(
            f'options["reset_mask"] must be ({count},) of bool with at least one True; '
            f"got {brief(mask)}"
        )
    return found


def _masked(info: Info, mask: Mask) -> Info:
    """Add the mask that Gymnasium wants beside each key."""
    return info | {f"_{name}": mask.copy() for name in info}


def _put_final(info: Info, fresh: Info, last: NDArray[np.float32], ended: Mask) -> Info:
    """Move the ended robots' information to ``final_info`` and put the new episodes' instead."""
    masks = [name for name in info if name.startswith("_")]
    final = {name: info[name] & ended if name in masks else info[name].copy() for name in info}
    info |= {name: value for name, value in fresh.items() if name not in masks}
    info |= {name: info[name] & ~ended for name in masks if name not in fresh}
    observations = np.full(len(ended), None, dtype=object)
    for i in np.flatnonzero(ended):
        observations[i] = last[i]
    finals = _masked({"final_obs": observations}, ended)
    return info | finals | {"final_info": final, "_final_info": ended.copy()}
