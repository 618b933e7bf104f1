"""A method of one's own as an arm of a study: a function from a target to a body each round.

The function takes ``(target, rounds, seed, settings)``. ``target.perform(command)`` is a trial:
speeds of the F servos (rev/s or Hz) in, the gyroscope's log (steps, 3) in rad/s out, from hidden
fin angles. The function yields, or returns, a body for each round: the S sizes in units of 5 cm, as
``aquafish_gym.Morphology.to_array`` orders them. It may perform one command a round. The truth is
not handed over. ``settings.plan`` is the body plan.
"""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.plans import AQUAFISH, BodyPlan
from aquafish_gym.runs.code import code_hash
from eea.core.angles import Floats
from eea.core.checks import ConfigurationError, TargetError, choice, finite, whole_field
from eea.core.checks import check_fields as checked
from eea.core.config import MAXIMUM_ROUNDS, MAXIMUM_TRIAL_STEPS, Config
from eea.core.experiment import Trials
from eea.core.fitness import dimension_errors, objective_fitness
from eea.fish import EngineTarget
from eea.fish.simulator import EngineSimulator, fish_problem


@dataclass(frozen=True)
class MethodConfig:
    """A function of one's own as the settings of an arm; :meth:`of` finds it and its code.

    Examples
    --------
    >>> MethodConfig("my_method:search", "0123456789abcdef", rounds=5).steps
    256
    """

    condition: ClassVar[str] = "method"

    function: str  #: ``module:function``.
    code: str  #: Hash of the code of the function's module, and of what it imports beside it.
    steps: int = whole_field(256, 2, MAXIMUM_TRIAL_STEPS)  #: Length of a trial in samples.
    rounds: int = whole_field(25, 1, MAXIMUM_ROUNDS)  #: Number of rounds, each with one trial.

    def __post_init__(self) -> None:
        checked(self)

    @classmethod
    def of(cls, function: str) -> MethodConfig:
        """Return the settings of the function at a place, ``module:function``.

        Raises
        ------
        ConfigurationError
            If there is no such module or function.
        """
        return cls(function, code_hash(found_function(function)))

    def to_dict(self) -> dict[str, Any]:
        """Return every setting, ready for JSON."""
        return {"condition": self.condition, **asdict(self)}


ArmConfig = Config | MethodConfig


def found_function(place: str) -> Callable[..., Any]:
    """Return the function at a place, ``module:function``; raise ConfigurationError for none."""
    module_name, colon, name = place.partition(":")
    if not (colon and module_name and name):
        raise ConfigurationError(f"method must be MODULE:FUNCTION; got {place!r}")
    try:
        module = import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name and f"{module_name}.".startswith(f"{error.name}."):
            raise ConfigurationError(
                f"method must name a module that can be imported from here; got {place!r}, and "
                f"there is no module {error.name!r}"
            ) from None
        raise
    functions = [
        each
        for each, value in vars(module).items()
        if inspect.isfunction(value) and value.__module__ == module_name
    ]
    if not callable(getattr(module, name, None)):
        choice(f"the function of method {place}", name, functions or ["a function"])
    function: Callable[..., Any] = getattr(module, name)
    try:
        inspect.signature(function).bind("robot", "rounds", "seed", "settings")
    except (TypeError, ValueError) as error:  # ValueError: it has no signature
        raise ConfigurationError(
            f"method {place} must take (robot, rounds, seed, settings); {error}"
        ) from None
    return function


class MethodTarget:
    """The robot of a method of one's own: it performs commands, one a round at most."""

    def __init__(self, target: EngineTarget, allowed: int) -> None:
        self._target = target
        self._allowed = allowed
        self._commands: list[Floats] = []

    def perform(self, command: ArrayLike) -> Floats:
        """Hold a command (F,) from hidden fin angles; return the gyroscope's log (steps, 3), rad/s.

        Raises
        ------
        ConfigurationError, InvalidArgumentError
            If the command is wrong.
        TargetError
            If this is a second command in a round.
        """
        if len(self._commands) == self._allowed:
            raise TargetError(
                f"a method must perform one command a round at most; it performed "
                f"{len(self._commands)} and asked for another before the body of round "
                f"{self._allowed}"
            )
        held = finite("command", command, (len(self._target.plan.fins),))
        log = self._target.perform(held)
        self._commands.append(held)
        return np.array(log.gyro, dtype=np.float64).reshape(-1, 3)


@dataclass(frozen=True)
class MethodSettings:
    """What a method of one's own knows of its world besides the target."""

    steps: int  #: Samples of a trial, 0.01 s each.
    current: tuple[float, float, float]  #: Velocity of the water, units/s.
    plan: BodyPlan = AQUAFISH  #: The robot's body plan.
    reactive: bool = False  #: Whether the water also resists acceleration.
    _simulated: list[int] = field(default_factory=lambda: [0], repr=False)

    def simulate(self, bodies: ArrayLike, commands: ArrayLike, angles: ArrayLike) -> Floats:
        """Return the gyroscope's logs (B, steps, 3), rad/s, of simulated trials.

        ``bodies`` (B, S) are in units of 5 cm, ``commands`` (B, F) in rev/s or Hz, ``angles``
        (B, F) of the fins at the start in rad. The trials are counted in results.csv.
        """
        problem = fish_problem(self.plan)
        rows = finite("bodies", bodies, (None, len(problem.models)))
        self._simulated[0] += len(rows)
        simulator = EngineSimulator(
            self.steps, current=self.current, threads=1, reactive=self.reactive, plan=self.plan
        )
        held = finite("commands", commands, (len(rows), len(problem.actions)))
        begun = finite("angles", angles, (len(rows), len(problem.hidden)))
        return np.asarray(simulator.simulate(Trials(rows, held, begun)).gyro, dtype=np.float64)


def method_rounds(
    config: MethodConfig, target: EngineTarget, seed: int, settings: MethodSettings
) -> list[dict[str, Any]]:
    """Return a record for each round of a method, ready for JSON, as those of the other arms.

    A method has no MOD_FIT, angles or spread: these are None.

    Raises
    ------
    ConfigurationError
        If the code is another than in ``config``, a body is wrong, or one is missing.
    """
    function = found_function(config.function)
    if code_hash(function) != config.code:
        raise ConfigurationError(
            f"method {config.function} has another code here (hash {code_hash(function)}) than "
            f"where the study was begun ({config.code})"
        )
    layout = fish_problem(target.plan).models
    truth = target.morphology.to_array()
    records: list[dict[str, Any]] = []
    for number, body, command, angles in _bodies(function, config, target, seed, settings):
        sizes = finite(f"the body of round {number} of {config.function}", body, (len(layout),))
        outside = (sizes < layout.low) | (sizes > layout.high)
        if outside.any():
            i = int(np.argmax(outside))
            raise ConfigurationError(
                f"the body of round {number} of {config.function} must have {layout.names[i]} of "
                f"{layout.low[i]:g} to {layout.high[i]:g} units; got {sizes[i]:g}"
            )
        records.append({
            "round": number,
            "command": command,
            "action_fitness": None,
            "model_fitness": None,
            "morphology": sizes.tolist(),
            "min_angle": None,
            "max_angle": None,
            "true_angles": angles,
            "angle_error": None,
            "objective_fitness": float(objective_fitness(sizes, truth, layout)),
            "dimension_error": dimension_errors(sizes, truth, layout).tolist(),
            "spread": None,
            "trials": settings._simulated[0],
        })  # fmt: skip
        settings._simulated[0] = 0
    return records


def _bodies(
    function: Callable[..., Any],
    config: MethodConfig,
    target: EngineTarget,
    seed: int,
    settings: MethodSettings,
) -> Iterator[tuple[int, Any, list[float] | None, list[float] | None]]:
    """Yield each round's number, body, and newest command and hidden angles, None without one.

    A function that returns all bodies at once has performed all its commands by then.
    """
    robot = MethodTarget(target, config.rounds)
    given = function(robot, config.rounds, seed, settings)
    at_once = not isinstance(given, Iterator)
    if at_once:
        _check_count(config, given)
    bodies = iter(given)
    for number in range(1, config.rounds + 1):
        if not at_once:
            robot._allowed = number
        try:
            body = next(bodies)
        except StopIteration:
            _check_count(config, [None] * (number - 1))
        done = robot._commands[:number]
        newest = done[-1].tolist() if len(done) == number else None
        angles = target.start_angles.tolist() if newest and not at_once else None
        yield number, body, newest, angles
    if isinstance(given, types.GeneratorType):
        given.close()


def _check_count(config: MethodConfig, bodies: object) -> None:
    count = len(bodies) if isinstance(bodies, Sequence | np.ndarray) else None
    if count != config.rounds:
        got = f"{count} bodies" if count is not None else type(bodies).__name__
        raise ConfigurationError(
            f"{config.function} must give a body in each of {config.rounds} rounds; got {got}"
        )
