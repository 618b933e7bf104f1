"""Settings of the agent that swims on."""

from __future__ import annotations

from dataclasses import dataclass

from aquafish_gym.scenario import check_row
from aquafish_gym.utils.validation import (
    InvalidArgumentError,
    brief,
    finite_array,
    flag,
    integer,
)


@dataclass(frozen=True)
class AgentConfig:
    """Settings of :class:`~aquafish.online.agent.SelfModelAgent`."""

    #: Length of an episode, s. One that goes on beyond it is taken to last as long again.
    seconds: float = 60.0
    gyro_noise: float = 0.0  #: Standard deviation of the gyroscope's noise, rad/s.
    gyro_only: bool = False  #: Whether the gyroscope is the only sensor.
    #: Numbers of observations from an alarm on with which the robot is inferred, again each time.
    inferences: tuple[int, ...] = (1, 2, 3, 5, 8, 12, 18)
    refinements: int = 4  #: Of a gait, one after the other; 0 only chooses among known ones.
    generations: int = 125  #: Of a refinement of a small gait.
    teacher_generations: int = 14  #: Of a refinement of the teacher.
    #: The same of the first refinement after a fault, which must be there soon.
    quick_generations: int = 42
    quick_teacher_generations: int = 6
    #: Thinking time, s, after which an inference and a refinement can be used, with the next action
    #: at the earliest; the robot swims on. An inference takes that for each three starts of the
    #: simulation: 0.2 s for a first fault, 0.4 s where what broke may have ended.
    inference_seconds: float = 0.2
    refinement_seconds: float = 1.2
    both_seconds: float = 1.4  #: Of a refinement of a small gait and of the teacher.
    quick_seconds: float = 0.4  #: Of the first refinement after a fault.
    seed: int = 0  #: Of the refinement.

    def __post_init__(self) -> None:
        for name in vars(self):
            if name.endswith("seconds"):
                finite_array(name, getattr(self, name), (), 0.0, unit="s")
            elif name.endswith("generations"):
                integer(name, getattr(self, name), 1)
        check_row("gyro_noise", self.gyro_noise)
        flag("gyro_only", self.gyro_only)
        integer("refinements", self.refinements, 0)
        integer("seed", self.seed, 0)
        given = self.inferences
        numbers = list(given) if isinstance(given, list | tuple) else []
        counts = [integer("inferences", number, 1) for number in numbers]
        if not counts or counts != sorted(set(counts)):
            raise InvalidArgumentError(
                f"inferences must be one number or more, increasing; got {brief(given)}"
            )
