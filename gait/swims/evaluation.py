"""Score an agent on an environment: the return of each episode, and their mean with an interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, instance, integer
from gait.controllers.agents import make_agent
from gait.controllers.controller import MAXIMUM_SEED
from gait.swims.episode import transitions

Floats = NDArray[np.float64]
Interval = tuple[float, float, float]  # a mean, and the lower and upper end of its interval

FIRST_SEED = 10**9  # of the reference scores' episodes
EPISODES = 100
RESAMPLES = 1000  # of the bootstrap


@dataclass(frozen=True)
class Evaluation:
    """The results of E episodes of at most T steps.

    Attributes
    ----------
    returns
        (E,) sums of the rewards.
    y_position
        (T + 1, E) each robot's position along +y, in units of 5 cm, at first and after each step.
        When its episode is over, the last one is repeated. NaN if ``info`` lacks it.
    broken
        (T, E) whether any fault was active after each step.
    succeeded
        (E,) whether each episode ended with success; None in a task without it.

    Examples
    --------
    >>> Evaluation(np.array([1.0, 3.0]), np.zeros((2, 2)), np.zeros((1, 2), bool)).mean
    2.0
    """

    returns: Floats
    y_position: Floats
    broken: NDArray[np.bool_]
    succeeded: NDArray[np.bool_] | None = None

    @property
    def mean(self) -> float:
        """The mean return."""
        return float(self.returns.mean())

    @property
    def iqm(self) -> Interval:
        """The interquartile mean of the returns with its 95% bootstrap interval."""
        return interquartile_mean([self.returns])

    @property
    def onset(self) -> NDArray[np.intp]:
        """The step (E,) in which something first broke; 0 if nothing did."""
        return np.asarray(self.broken.argmax(axis=0))

    def way_since(self, steps: NDArray[np.intp]) -> Floats:
        """Return the distance (E,) along +y from before step ``steps[i]`` to the end, in units."""
        way: Floats = self.y_position[-1] - self.y_position[steps, np.arange(len(steps))]
        return way

    def __str__(self) -> str:
        middle, low, high = self.iqm
        number = len(self.returns)
        text = f"{middle:.1f} [{low:.1f}, {high:.1f}] in {number} episodes"
        if self.succeeded is None:
            return text
        share, low, high = success_rate(int(self.succeeded.sum()), number)
        return f"{text}; success in {share:.0%} [{low:.0%}, {high:.0%}]"


def evaluate(
    agent: object,
    env: str | VectorEnv[Any, Any, Any] = "AquaFish-v0",
    *,
    episodes: int | None = None,
    seed: int = FIRST_SEED,
    **options: Any,
) -> Evaluation:
    """Return the returns of an agent in E episodes, with statistics.

    With the default seed and number, these are the starts of the reference scores; their damages
    are ``damage=aquafish_gym.held_out("severe", range(100))``.

    Parameters
    ----------
    agent
        A function of observations (E, k) that returns actions (E, F); a ``Controller``, which is
        given the true initial fin angles; a model of stable-baselines3 or another object with
        ``predict``; a :class:`gait.Agent`, which may lack ``reset``; or a policy of one robot, as
        of :func:`gait.swim`, called once a step. A function that can take the time, as its second
        argument or as its keyword argument ``time``, is such a policy. An object with
        ``begin(fin_angles)`` and ``act(observation)`` is of one robot: each has a copy.
    env, episodes, options
        An environment id, the number E of its robots, which is 100 by default, and its options
        such as ``damage="random:severe"``, or a list of E damages, one for each episode; or a
        vector environment of E robots alone.
    seed
        Episode i has the seed ``seed + i``.

    Raises
    ------
    InvalidArgumentError
        If the agent is not one of these, or an argument is wrong.

    Examples
    --------
    >>> found = evaluate(lambda observations: np.zeros((len(observations), 3)), episodes=4)
    >>> found.returns.shape, found.y_position.shape
    ((4,), (101, 4))
    """
    if isinstance(env, str):
        number = integer("episodes", EPISODES if episodes is None else episodes, 1, 1_000_000)
        try:
            made = gym.make_vec(env, number, vectorization_mode="vector_entry_point", **options)
        except gym.error.Error as error:
            raise InvalidArgumentError(f"env must be an environment's id: {error}") from None
        try:
            return _play(agent, made, seed)
        finally:
            made.close()
    instance("env", env, VectorEnv)
    if episodes not in (None, env.num_envs):
        raise InvalidArgumentError(
            f"episodes must be the {env.num_envs} robots of env, or left out; got {episodes}"
        )
    if options:
        raise InvalidArgumentError(
            f"options must come with an id, as the environment is made already; got {set(options)}"
        )
    return _play(agent, env, seed)


def _play(agent: object, envs: VectorEnv[Any, Any, Any], seed: int) -> Evaluation:
    """Play one episode of each robot to its end."""
    observations, info = envs.reset(seed=integer("seed", seed, 0, MAXIMUM_SEED))
    number = envs.num_envs
    interval, dt, plan = (_stated(envs, name) for name in ("frame_skip", "dt", "plan"))
    steers = make_agent(agent, interval, dt, plan=plan)
    steers.reset(info)
    returns = np.zeros(number)
    y_position = [np.asarray(info.get("y_position", np.full(number, np.nan)))]
    broken = []
    succeeded = np.zeros(number, np.bool_) if "is_success" in info else None
    for step in transitions(envs, steers.act, observations):
        returns += np.where(step.was_over, 0.0, step.reward)
        last = y_position[-1]
        y_position.append(np.where(step.was_over, last, step.info.get("y_position", last)))
        broken.append(step.info.get("faults", np.zeros(number, int)) > 0)
        if succeeded is not None:
            succeeded |= step.info.get("is_success", np.False_) & ~step.was_over
    return Evaluation(returns, np.array(y_position), np.array(broken), succeeded)


def _stated(envs: VectorEnv[Any, Any, Any], name: str) -> Any:
    """Return an attribute of a batch, or of each robot of one of Gymnasium's; None if it has none.

    Gymnasium's may be in worker processes.
    """
    base: Any = envs.unwrapped
    if hasattr(base, name):
        return getattr(base, name)
    if hasattr(base, "get_attr") and all(base.call("has_wrapper_attr", name)):
        first, *others = base.get_attr(name)
        return first if all(one == first for one in others) else None
    return None


def success_rate(successes: int, episodes: int) -> Interval:
    """Return the share of successes, and Wilson's 95% interval.

    Wilson, "Probable inference, the law of succession, and statistical inference", 1927.

    Examples
    --------
    >>> [round(share, 3) for share in success_rate(9, 10)]
    [0.9, 0.596, 0.982]
    """
    from scipy.stats import binomtest

    low, high = binomtest(successes, episodes).proportion_ci(0.95, "wilson")
    return successes / episodes, float(low), float(high)


def interquartile_mean(runs: ArrayLike, seed: int = 0) -> Interval:
    """Return the interquartile mean of all episodes of runs (R, E) and its 95% interval.

    The bootstrap draws runs, and episodes of each (Agarwal et al., "Deep reinforcement learning at
    the edge of the statistical precipice", 2021). ``scipy.stats.bootstrap`` has one level only.

    Examples
    --------
    >>> interquartile_mean([[1.0, 2.0, 3.0, 1000.0]])[0]
    2.5
    """
    from scipy.stats import trim_mean

    table = finite_array("runs", runs, (None, None))
    if not table.size:
        raise InvalidArgumentError(f"runs must be one or more; got {table.shape}")
    number, episodes = table.shape
    rng = np.random.default_rng(integer("seed", seed, 0, MAXIMUM_SEED))
    drawn = rng.integers(number, size=(RESAMPLES, number, 1))
    resampled = table[drawn, rng.integers(episodes, size=(RESAMPLES, number, episodes))]
    means = trim_mean(resampled.reshape(RESAMPLES, -1), 0.25, axis=1)
    low, high = np.quantile(means, (0.025, 0.975)).tolist()
    return float(trim_mean(table, 0.25, axis=None)), low, high
