"""The loop of an episode: an agent acts in an environment of one robot, or of a batch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.utils.validation import InvalidArgumentError


class Transition(NamedTuple):
    """One step of an environment; of a batch of E robots, its arrays have E rows."""

    action: ArrayLike  #: (F,) or (E, F) what the agent returned.
    observation: NDArray[np.float32]  #: What it observes next.
    reward: Any
    terminated: Any  #: Whether a robot left the finite numbers.
    truncated: Any  #: Whether the time is over.
    info: dict[str, Any]
    was_over: Any  #: Whether a robot's episode was over before this step.


def transitions(
    env: Any, act: Callable[[Any], ArrayLike], observation: Any
) -> Iterator[Transition]:
    """Yield the steps of an episode that is under way, until those of all robots are over.

    What the caller does with a step comes before the agent's next action.

    Parameters
    ----------
    env
        An environment of Gymnasium, of one robot or a batch, that was reset.
    act
        Returns actions, (F,) or (E, F), for observations, (k,) or (E, k).
    observation
        What the environment returned last.

    Raises
    ------
    InvalidArgumentError
        If a batch does not wait with a robot's next episode until the step after its last: the
        state and ``info`` at its end would be missing.

    Examples
    --------
    >>> import gymnasium as gym
    >>> env = gym.make("AquaFish-v0", engine="numba")
    >>> observation, _ = env.reset(seed=0)
    >>> steps = list(transitions(env, lambda seen: (0.0, 0.0, -1.0), observation))
    >>> len(steps), steps[-1].truncated
    (100, True)
    """
    if isinstance(env, VectorEnv):
        mode = env.metadata.get("autoreset_mode", AutoresetMode.NEXT_STEP)
        name = getattr(mode, "value", mode)
        if name != AutoresetMode.NEXT_STEP.value:
            raise InvalidArgumentError(f'autoreset_mode of env must be "NextStep"; got {name!r}')
    over: Any = np.False_
    while not np.all(over):
        action = act(observation)
        taken = np.asarray(action, np.float32)
        observation, reward, terminated, truncated, info = env.step(taken)
        yield Transition(action, observation, reward, terminated, truncated, info, over)
        over = over | terminated | truncated
