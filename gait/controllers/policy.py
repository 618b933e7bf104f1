"""The policy that steers a robot: a function of its observation and the time."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

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


def new_policy(controller: ControllerLike) -> Policy:
    """Return a policy for one swim, or raise InvalidArgumentError."""
    policy = controller.policy() if isinstance(controller, HasPolicy) else controller
    if not callable(policy):
        raise InvalidArgumentError(
            "controller must be a function (observation, time) -> action, or have a method "
            f"policy() that returns one; got {brief(controller)}"
        )
    return policy
