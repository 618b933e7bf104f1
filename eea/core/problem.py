"""What the algorithm is told of a robot: the widths of its body, commands, angles and signal."""

from __future__ import annotations

from dataclasses import dataclass

from eea.core.bits import BitLayout
from eea.core.checks import ConfigurationError, instance, whole

MAXIMUM_AXES = 1000


@dataclass(frozen=True)
class Problem:
    """A robot to be modelled; the algorithm takes every width from here and from nowhere else.

    Examples
    --------
    A pendulum with a motor: its length and friction are sought, and where it hung is not known.

    >>> from eea.core.bits import action_layout, model_layout
    >>> pendulum = Problem(
    ...     models=model_layout([("length", 2.0, 6), ("friction", 1.0, 5)]),
    ...     actions=action_layout([("torque", -1.0, 1.0)]),
    ...     hidden=("angle",),
    ...     axes=1,
    ... )
    >>> len(pendulum.models), len(pendulum.actions), len(pendulum.hidden)
    (2, 1, 1)
    """

    models: BitLayout  #: The genome of a body: what is to be found out.
    actions: BitLayout  #: The genome of a command.
    #: The names of the angles at which a trial begins, and which the robot does not tell. All are
    #: circular, in rad, each over a whole turn; zero is the state taken for granted where nothing
    #: is inferred.
    hidden: tuple[str, ...]
    axes: int  #: How many axes the log's signal has.

    def __post_init__(self) -> None:
        instance("models", self.models, BitLayout)
        instance("actions", self.actions, BitLayout)
        if not isinstance(self.hidden, tuple) or not all(isinstance(n, str) for n in self.hidden):
            raise ConfigurationError("hidden must be a tuple of the hidden angles' names")
        whole("the number of hidden angles", len(self.hidden), 1)
        whole("axes", self.axes, 1, MAXIMUM_AXES)
