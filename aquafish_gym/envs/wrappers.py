"""Damage for any Gymnasium environment: wrappers that break its actuators and sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.damage import Damage
from aquafish_gym.damage.sensors import ONLY_ROBOT
from aquafish_gym.damage.words import LONGEST_SECONDS, SHORTEST_SECONDS
from aquafish_gym.envs.autoreset import AutoresetMode
from aquafish_gym.envs.batching import check_seeds, masked, of_each
from aquafish_gym.envs.channels import Channels
from aquafish_gym.envs.episode import FishEnvBase, check_options
from aquafish_gym.envs.fault_episodes import HostFaults, device_player
from aquafish_gym.envs.fault_player import FaultPlayer
from aquafish_gym.utils.array_types import Info
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    instance,
    integer,
)

Array = NDArray[Any]
if TYPE_CHECKING:
    _VectorWrapper = VectorWrapper[Array, Array, Array, Array, Array]
else:
    _VectorWrapper = VectorWrapper  # generic from Gymnasium 1.4 on
WRAPPED_TWICE_MESSAGE = (
    "env must have no FaultWrapper yet; got one that has: join the faults by ';' in one wrapper"
)


class FaultWrapper(gym.Wrapper[Array, Array, Array, Array], RecordConstructorArgs):
    """Break the actuators and sensors of any environment with ``Box`` spaces, also in mid-episode.

    Faults are written as the fish's: ``action_0:seized@4+2; observation_3-5:noise=0.01``; the page
    on damage has the words. Actions and observations stay in their spaces: they saturate. The
    reward is the environment's, for what was done. The policy does not observe the faults; ``info``
    has ``faults`` (how many are active, the environment's own included), ``action_gain`` and
    ``action_seized`` in an action's shape, ``observation_noise``, ``observation_bias`` and
    ``observation_lost`` (stuck or dropped) in an observation's; with late, slow or scaled channels
    also ``action_scale``, ``action_delay``, ``action_hold`` (s) and the same of ``observation``.
    Random faults and noise are drawn from streams of their own, which the seed of ``reset`` begins.

    Parameters
    ----------
    env
        The environment.
    damage
        A text, a ``Damage``, or None.
    dt
        The length of a step in s, by which faults are timed; 1 times them in steps. None is the
        environment's ``dt``, or else 1 / ``metadata["render_fps"]``.
    neutral
        The action, one number or one for each entry, at which an actuator does nothing. None is
        the action closest to 0.

    Raises
    ------
    InvalidArgumentError
        If a space is no ``Box``, or the damage does not fit: there is no such channel, an action
        lies outside of its space, an onset after the end, or the length of a step is unknown. If
        the environment has a FaultWrapper already.

    Examples
    --------
    >>> env = FaultWrapper(gym.make("Pendulum-v1"), "action_0:dead@1; observation_2:bias=0.5")
    >>> _, info = env.reset(seed=0)
    >>> info["faults"], info["observation_bias"].tolist()
    (1, [0.0, 0.0, 0.5])
    """

    def __init__(
        self,
        env: gym.Env[Array, Array],
        damage: object = None,
        dt: float | None = None,
        neutral: ArrayLike | None = None,
    ) -> None:
        gym.Wrapper.__init__(self, instance("env", env, gym.Env))
        _refuse_twice(env)
        spaces = env.action_space, env.observation_space
        self._channels = Channels(*spaces, _time_step(env, dt), _last_step(env), neutral)
        self._damage = self._channels.check(damage)
        self._faults = HostFaults(self._channels, 1)
        # As gym.make reads it back from a specification in JSON.
        step, plain = (None if one is None else np.asarray(one).tolist() for one in (dt, neutral))
        RecordConstructorArgs.__init__(self, damage=str(self._damage), dt=step, neutral=plain)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, Info]:
        """Begin an episode; the option ``damage`` is for this one only."""
        seed = None if seed is None else integer("seed", seed, 0)
        given = check_options(options)
        damage = self._channels.check(given.pop("damage", self._damage))
        observation, info = self.env.reset(seed=seed, options=given or None)
        self._faults.streams.seed([seed])
        self._faults.load(ONLY_ROBOT, [damage])
        self._faults.player.begin(self._faults.player.everyone)
        return self._observe(observation), self._with_truth(info)

    def step(self, action: Array) -> tuple[Array, Any, bool, bool, Info]:
        """Take a step with broken actuators, and observe it with broken sensors."""
        commanded = finite_array("action", action, self._channels.action.shape)
        batch = commanded[None]
        acted = self._faults.player.act(batch)
        observation, reward, terminated, truncated, info = self.env.step(
            action if acted is batch else acted.reshape(commanded.shape)
        )
        self._faults.player.advance()
        return self._observe(observation), reward, terminated, truncated, self._with_truth(info)

    def _observe(self, observation: Array) -> Array:
        batch = np.asarray(observation)[None]
        seen: Array = self._faults.player.observe(batch)
        return observation if seen is batch else seen.reshape(self._channels.observation.shape)

    def _with_truth(self, info: Info) -> Info:
        truth = {name: rows[0] for name, rows in self._faults.player.truth().items()}
        return info | truth | {"faults": int(truth["faults"]) + info.get("faults", 0)}


class VectorFaultWrapper(_VectorWrapper):
    """:class:`FaultWrapper` for vector environments, in any autoreset mode.

    ``damage`` is one for all environments or a list of one for each, also in ``options``. Keys of
    ``info`` have masks, and ``final_obs`` is what sensors observed. Seeded with a number s, robot i
    has the random faults and the noise of a single environment that is seeded with s + i.

    Environments may step arrays (B, ...) of PyTorch, JAX or CuPy, on any device. Nothing is then
    copied from the device or waited for, and ``info`` has arrays there, which must not be written
    to. Actions that are not finite are not refused. Episodes of random damage are drawn by the
    thousand when all environments are reset, and noise is drawn for all at once: they are not those
    of single environments. ``final_obs``, if there is one, is an array (B, ...).

    Parameters
    ----------
    env, damage, dt, neutral
        As of :class:`FaultWrapper`.

    Raises
    ------
    InvalidArgumentError
        As :class:`FaultWrapper`, and if ``metadata`` has no ``autoreset_mode``, or arrays are of
        an unknown library.

    Examples
    --------
    >>> envs = gym.make_vec("Pendulum-v1", num_envs=2, vectorization_mode="sync")
    >>> envs = VectorFaultWrapper(envs, ["none", "action_0:weak=0.5"])
    >>> _, info = envs.reset(seed=0)
    >>> info["faults"].tolist(), info["action_gain"].tolist()
    ([0, 1], [[1.0], [0.5]])
    """

    def __init__(
        self,
        env: VectorEnv[Array, Array, Array],
        damage: object = None,
        dt: float | None = None,
        neutral: ArrayLike | None = None,
    ) -> None:
        VectorWrapper.__init__(self, instance("env", env, VectorEnv))
        _refuse_twice(env)
        if "autoreset_mode" not in env.metadata:
            raise InvalidArgumentError('env must state its metadata["autoreset_mode"]; got none')
        self._mode = AutoresetMode(env.metadata["autoreset_mode"])
        count, spaces = self.num_envs, (env.single_action_space, env.single_observation_space)
        self._channels = Channels(*spaces, _time_step(env, dt), _last_step(env), neutral)
        self._last_steps = _last_steps(env)
        self._damages = self._check(damage)
        self._host: HostFaults | None = HostFaults(self._channels, count)  # None on a device
        self._player: FaultPlayer = self._host.player
        self._rng = np.random.default_rng()  # of the episodes on a device
        self._ended: Any = None  # a mask (B,) of those whose episode ended in the last step
        space = self._channels.observation
        self._seen: Any = np.zeros((count, *space.shape), space.dtype)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, Info]:
        """Begin episodes, under ``options["reset_mask"]`` if there is one.

        The option ``damage`` is for these episodes only.
        """
        seeds = check_seeds(seed, self.num_envs)
        given = check_options(options)
        damages = self._check(given.pop("damage")) if "damage" in given else self._damages
        mask = given.get("reset_mask")  # which the environment takes out
        observations: Any
        observations, info = self.env.reset(seed=seed, options=given or None)  # type: ignore[arg-type]
        if "action_gain" in info:  # of environments that are wrapped inside of the vector
            raise InvalidArgumentError(WRAPPED_TWICE_MESSAGE)
        if seed is not None:
            # Not the streams of the environments, which the seeds themselves begin.
            own = [one for one in (seeds[:1] if np.ndim(seed) == 0 else seeds) if one is not None]  # type: ignore[arg-type]
            self._rng = np.random.default_rng(np.random.SeedSequence(own or None).spawn(1)[0])
        if not isinstance(observations, np.ndarray):
            return self._reset_device(observations, info, damages, mask)
        if self._host is None:
            self._host = HostFaults(self._channels, self.num_envs)
            self._player = self._host.player
        began = np.ones(self.num_envs, np.bool_) if mask is None else np.array(mask)
        self._host.streams.seed(
            [one if own else None for one, own in zip(seeds, began, strict=True)]
        )
        self._host.load(np.flatnonzero(began), damages)
        self._player.begin(began)
        return self._first(observations, info, began, mask is None)

    def _reset_device(
        self, observations: Any, info: Info, damages: list[Damage], mask: Any
    ) -> tuple[Any, Info]:
        """Begin episodes of an environment that steps arrays of another library than NumPy."""
        if mask is None or self._host is not None:
            self._host = None
            self._player = device_player(
                self._channels, self._damages, damages, observations, self._rng
            )
            return self._first(observations, info, self._player.everyone, True)
        if damages is not self._damages:
            raise InvalidArgumentError(
                'options["damage"] must be given without a "reset_mask" where environments step '
                "arrays on a device; reset all of them"
            )
        began = self._player.mask(mask)
        self._player.begin(began)
        return self._first(observations, info, began, False)

    def _first(self, observations: Any, info: Info, began: Any, all_of: bool) -> tuple[Any, Info]:
        """Observe the first step of those that began an episode."""
        if all_of:
            seen, self._ended = self._player.observe(observations), None
        else:
            seen = self._player.observe(observations, began)
            seen = self._player.choose(began, seen, self._seen)
            self._ended = None if self._ended is None else self._ended & ~began
        self._seen = self._player.copy(seen)
        return seen, self._with_truth(info, began)

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, Info]:
        """Take a step with broken actuators, and observe it with broken sensors."""
        player = self._player
        observations: Any
        observations, rewards, terminations, truncations, info = self.env.step(self._act(actions))
        ended: Any = terminations | truncations
        if self._mode is AutoresetMode.SAME_STEP and "final_obs" in info:
            player.advance()
            last = player.observe(self._last(info["final_obs"], observations, ended))
            of_last = self._with_truth(info.get("final_info", {}), ended)
            info = info | {"final_obs": self._final(info, last, ended), "final_info": of_last}
            player.begin(self._beginning(ended))
            seen = player.choose(ended, player.observe(observations, ended), last)
        else:
            begins = {AutoresetMode.SAME_STEP: ended, AutoresetMode.NEXT_STEP: self._ended}
            player.advance(self._beginning(begins.get(self._mode)))
            seen = player.observe(observations)
        if self._host is not None or self._mode is AutoresetMode.DISABLED:
            self._seen = player.copy(seen)
        self._ended = ended
        info = self._with_truth(info, player.everyone)
        return seen, rewards, terminations, truncations, info

    def _act(self, actions: Any) -> Any:
        """Return what actuators make of actions, which are refused if they do not fit."""
        shape = (self.num_envs, *self._channels.action.shape)
        if self._host is not None:
            commanded = finite_array("actions", actions, shape)
            acted = self._player.act(commanded)
            return actions if acted is commanded else acted
        if tuple(getattr(actions, "shape", ())) != shape:
            raise InvalidArgumentError(
                f"actions must be an array of shape {shape}; got {brief(actions)}"
            )
        return self._player.act(actions)

    def _beginning(self, begins: Any) -> Any:
        """Return the mask of those that begin an episode; None where none does, on NumPy."""
        if self._host is None or begins is None:
            return begins
        rows = np.flatnonzero(begins)
        if not len(rows):
            return None
        self._host.load(rows, self._damages)
        return begins

    def _last(self, final: Any, observations: Any, ended: Any) -> Any:
        """Return the last observations (B, ...) of ended episodes, and others where none ended."""
        if self._host is None:
            return self._player.choose(ended, final, observations)
        last = observations.copy()
        for i in np.flatnonzero(ended).tolist():
            last[i] = final[i]
        return last

    def _final(self, info: Info, last: Any, ended: Any) -> Any:
        """Return ``final_obs`` as sensors observed it: on NumPy an array of objects, or None."""
        if self._host is None:
            return last
        final = info["final_obs"].copy()
        for i in np.flatnonzero(ended).tolist():
            final[i] = last[i].copy()
        return final

    def _with_truth(self, info: Info, mask: Any) -> Info:
        truth = self._player.truth()
        if "faults" in info:
            truth["faults"] = truth["faults"] + info["faults"]
        if self._host is not None:
            return info | masked(truth, mask)
        return info | truth | {f"_{name}": mask for name in truth}

    def _check(self, damage: object) -> list[Damage]:
        each = of_each("damage", damage, self.num_envs)
        pairs = list(zip(each, self._last_steps, strict=True))
        made = {(id(one), last): self._channels.check(one, last) for one, last in pairs}
        return [made[id(one), last] for one, last in pairs]

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Return what a method or attribute of each environment gives, without the faults."""
        found: tuple[Any, ...] = self.env.call(name, *args, **kwargs)  # type: ignore[attr-defined]
        return found

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each environment."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of each environment: a list or tuple of them, or one for all."""
        self.env.set_attr(name, values)  # type: ignore[attr-defined]

    @property
    def np_random_seed(self) -> Any:
        """The seeds of the environments, as they say."""
        return self.env.np_random_seed

    @property
    def render_mode(self) -> str | None:  # type: ignore[override]
        """What the environments render."""
        return self.env.render_mode


def _refuse_twice(env: object) -> None:
    while isinstance(env, gym.Wrapper | VectorWrapper):
        if isinstance(env, FaultWrapper | VectorFaultWrapper):
            raise InvalidArgumentError(WRAPPED_TWICE_MESSAGE)
        env = env.env


def _last_step(env: object) -> int | None:
    """Return the fewest steps after which a specification of the environment says it ends."""
    limits: list[int] = []
    while True:
        spec = getattr(env, "spec", None)
        limits += [spec.max_episode_steps] if spec and spec.max_episode_steps else []
        if not isinstance(env, gym.Wrapper | VectorWrapper):
            limits += [env.episode_steps] if isinstance(env, FishEnvBase) else []
            return min(limits, default=None)
        env = env.env


def _last_steps(env: VectorEnv[Any, Any, Any]) -> list[int | None]:
    """Return the same of each environment, which may have a limit of its own."""
    base: Any = env.unwrapped
    specs = base.get_attr("spec") if hasattr(base, "get_attr") else [None] * env.num_envs
    return [None if spec is None else spec.max_episode_steps for spec in specs]


def _time_step(env: gym.Env[Any, Any] | VectorEnv[Any, Any, Any], dt: object) -> float | None:
    """Return the length of a step in s: as given, or as the environment tells; or None."""
    if dt is not None:
        return float(finite_array("dt", dt, (), SHORTEST_SECONDS, LONGEST_SECONDS, "s"))  # type: ignore[arg-type]
    one: Any = env.unwrapped
    step = None
    if hasattr(one, "get_attr"):  # of Gymnasium's vector environments, also of worker processes
        step = one.get_attr("dt")[0] if all(one.call("has_wrapper_attr", "dt")) else None
    else:
        step = getattr(one, "dt", None)
    rate = env.metadata.get("render_fps")
    for number, power in ((step, 1), (rate, -1)):
        if isinstance(number, int | float | np.number) and 0 < number < math.inf:
            return float(number) ** power
    return None
