"""What a robot is rewarded for. The physics measures, a task judges.

A task sees one robot's numbers or, with a leading axis, a whole batch's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.validation import finite_array

Floats = NDArray[np.float64]


class Task(Protocol):
    """Turns what happened within one control step into named terms of reward."""

    def reward_terms(
        self, before: Floats, after: Floats, action: Floats, dt: float
    ) -> dict[str, Floats]:
        """Return the terms, shape (...) each; their sum is the reward.

        Parameters
        ----------
        before, after
            (..., 3) the capsule's centre in the world at the step's two ends, units of 5 cm.
        action
            (..., 3) in [-1, 1].
        dt
            The step's length, s.
        """


@dataclass(frozen=True)
class SwimForward:
    """Swim along the world's +y, which is where the robot faces at the start, with little effort.

    As in Gymnasium's Swimmer: speed made good over the step, less a small price on the action.

    Attributes
    ----------
    forward_weight
        Of the speed along +y, units/s.
    ctrl_weight
        Of the sum of the action's squares; 0 or more.

    Raises
    ------
    InvalidArgumentError
        If a weight is not finite or the price is negative.
    """

    forward_weight: float = 1.0
    ctrl_weight: float = 1e-4

    def __post_init__(self) -> None:
        forward = finite_array("forward_reward_weight", self.forward_weight, ())
        ctrl = finite_array("ctrl_cost_weight", self.ctrl_weight, (), 0.0)
        object.__setattr__(self, "forward_weight", float(forward))
        object.__setattr__(self, "ctrl_weight", float(ctrl))

    def reward_terms(
        self, before: Floats, after: Floats, action: Floats, dt: float
    ) -> dict[str, Floats]:
        """Return ``reward_forward`` and ``reward_ctrl``; see :class:`Task`."""
        return {
            "reward_forward": self.forward_weight * (after[..., 1] - before[..., 1]) / dt,
            "reward_ctrl": -self.ctrl_weight * (action * action).sum(axis=-1),
        }
