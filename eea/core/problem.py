"""A robot as the algorithm sees it: its dimensions, commands, hidden angles and axes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from eea.core.checks import ConfigurationError, instance, real, whole
from eea.core.genome import BitLayout

MAXIMUM_AXES = 1000


@dataclass(frozen=True)
class Problem:
    """A robot to be modelled.

    Examples
    --------
    A pendulum with a motor, of unknown length, friction and initial angle:

    >>> from eea.core.genome import action_layout, model_layout
    >>> models = model_layout([("length", 2.0, 6), ("friction", 1.0, 5)])
    >>> actions = action_layout([("torque", -1.0, 1.0)])
    >>> len(Problem(models, actions, hidden=("angle",), axes=1).models)
    2
    """

    models: BitLayout  #: Genome of a body: the unknown dimensions.
    actions: BitLayout  #: The genome of a command.
    #: Names of the unknown initial angles of a trial. Each is circular, in rad, over a whole
    #: turn; without inference zero is assumed.
    hidden: tuple[str, ...]
    axes: int  #: Number of the gyroscope's axes.
    #: Highest possible rate, rad/s. A target that logs higher rates uses another unit.
    fastest: float = math.inf

    def __post_init__(self) -> None:
        instance("models", self.models, BitLayout)
        instance("actions", self.actions, BitLayout)
        if not isinstance(self.hidden, tuple) or not all(isinstance(n, str) for n in self.hidden):
            raise ConfigurationError("hidden must be a tuple of the hidden angles' names")
        whole("the number of hidden angles", len(self.hidden), 1)
        whole("axes", self.axes, 1, MAXIMUM_AXES)
        if not (isinstance(self.fastest, float) and self.fastest == math.inf):
            real("fastest", self.fastest, 0.0)
