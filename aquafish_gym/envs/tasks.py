"""What a robot is rewarded for. The physics measures, a task judges."""

from __future__ import annotations

from dataclasses import dataclass

from aquafish_gym.physics.arithmetic import Number, Vector
from aquafish_gym.utils.validation import finite_array

MOST = 1e6  # of a weight: a reward must stay finite


@dataclass(frozen=True)
class SwimForward:
    """Swim along the world's +y, which is where the robot faces at the start, with little effort.

    As in Gymnasium's Swimmer: speed made good over the step, less a small price on the action.

    The weights are of the speed along +y, units/s, and of the sum of the action's squares; they are
    at most a million, and the price is not negative.
    """

    forward_weight: float = 1.0
    ctrl_weight: float = 1e-4

    def __post_init__(self) -> None:
        forward = finite_array("forward_reward_weight", self.forward_weight, (), -MOST, MOST)
        ctrl = finite_array("ctrl_cost_weight", self.ctrl_weight, (), 0.0, MOST)
        object.__setattr__(self, "forward_weight", float(forward))
        object.__setattr__(self, "ctrl_weight", float(ctrl))

    def reward_terms(
        self, before: Vector, after: Vector, action: Vector, dt: float
    ) -> dict[str, Number]:
        """Return ``reward_forward`` and ``reward_ctrl``, whose sum is the reward.

        Positions ``before`` and ``after`` the step, units of 5 cm, and the servos' actions in
        [-1, 1] are three numbers each, or a batch's three rows (B,); ``dt`` is in s.
        """
        left, right, caudal = action
        effort = left * left + right * right + caudal * caudal
        return {
            "reward_forward": self.forward_weight * (after[1] - before[1]) / dt,
            "reward_ctrl": -self.ctrl_weight * effort,
        }
