"""The policy that steers a robot: a function of its observation and the time."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from enum import Enum
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.utils.validation import InvalidArgumentError, brief


class Policy(Protocol):
    """A function that steers one robot through one swim."""

    def __call__(self, observation: NDArray[np.float64], time: float, /) -> ArrayLike:
        """Return the action (3,) in [-1, 1] for left pectoral, right pectoral and caudal fin.

        Parameters
        ----------
        observation
            (9,) the world's up and north in body axes and the gyroscope in rad/s, as of
            AquaFish-v0.
        time
            Seconds since the swim began; the policy is called every 0.05 s.
        """


@runtime_checkable
class HasPolicy(Protocol):
    """A controller that makes a new policy for each swim, as one with a memory must.

    Its ``morphology``, if it has one, is its native body; see ``gait.scores.transfer``.
    """

    def policy(self) -> Policy:
        """Return a policy without memory of other swims."""


ControllerLike = Policy | HasPolicy


class TimeArgument(Enum):
    """How a function takes the time."""

    SECOND = "as its second positional argument"
    KEYWORD = "as its keyword argument time"
    NONE = "not at all"


def time_argument(function: Callable[..., Any]) -> TimeArgument:
    """Return how a function of observations takes the time, if it can: second, or as ``time``.

    A default does not matter. A time that a ``functools.partial`` gives already is not given again.
    A function without a signature, as some in C, takes the time second. InvalidArgumentError if it
    takes no observation.
    """
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return TimeArgument.SECOND
    if _takes(signature, None, None):
        return TimeArgument.SECOND
    fixed = function.keywords if isinstance(function, functools.partial) else {}
    if "time" not in fixed and _takes(signature, None, time=None):
        return TimeArgument.KEYWORD
    if not _takes(signature, None):
        raise InvalidArgumentError(
            "a controller must be called with observations alone, or with an observation and the "
            f"time; got {brief(function)} of the arguments {signature}"
        )
    return TimeArgument.NONE


def _takes(signature: inspect.Signature, *arguments: None, **named: None) -> bool:
    try:
        signature.bind(*arguments, **named)
    except TypeError:
        return False
    return True


def new_policy(controller: ControllerLike) -> Policy:
    """Return a policy for one swim, or raise InvalidArgumentError."""
    policy: Any = controller.policy() if isinstance(controller, HasPolicy) else controller
    takes = time_argument(policy) if callable(policy) else TimeArgument.NONE
    if takes is TimeArgument.NONE:
        raise InvalidArgumentError(
            "controller must be a function (observation, time) -> action, or have a method "
            f"policy() that returns one; got {brief(controller)}"
        )
    if takes is TimeArgument.KEYWORD:
        return lambda observation, time: policy(observation, time=time)
    second: Policy = policy
    return second
