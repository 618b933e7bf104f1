"""The methods bound to the fish: from commands and IMU logs to a body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from eea.core.algorithm import EEA
from eea.core.angles import Floats
from eea.core.checks import callback, finite, instance
from eea.core.config import Config, JointConfig, checked_config
from eea.core.experiment import Target
from eea.core.floating import own_errors
from eea.core.result import Result, RoundRecord
from eea.core.session import Session, streams
from eea.fish.simulator import EngineSimulator, SimulatorOptions, fish_problem
from eea.fish.statement import statement
from eea.fish.target import EngineTarget


@dataclass(repr=False)
class MorphologyEstimate(Result):
    """The body that was inferred in a run or from logs; ``print`` shows it in words.

    Examples
    --------
    >>> from eea.core.config import PaperConfig
    >>> MorphologyEstimate(PaperConfig(), 0, fish_problem().models)
    MorphologyEstimate(out-of-band, 0 rounds of 256 steps, seed 0)
    """

    #: Changes tried on a log that no body explains: an ``eea.fish.log_checks.LogCheck``.
    check: Any = None

    @classmethod
    def of(
        cls,
        answer: Any,
        truth: Morphology | ArrayLike | None = None,
        check: Any = None,
        seed: int = 0,
    ) -> MorphologyEstimate:
        """Return the body of a posterior of the fish, such as one inferred from logs.

        Parameters
        ----------
        answer
            The posterior, an ``eea.infer.answer.Answer``.
        truth
            The body, if known, for OBJ_FIT.
        check, seed
            Changes tried on the log, and the seed of the inference.

        Raises
        ------
        ConfigurationError, InvalidArgumentError
            If ``answer`` is no posterior of the nine sizes, or ``truth`` is no body.
        """
        from eea.infer.answer import Answer  # with scipy, which makes `import eea` slow

        sizes = fish_problem().models
        instance("answer", answer, Answer)
        finite("answer.model", answer.model, (len(sizes),))
        body = None if truth is None else Morphology.coerce(truth).to_array()
        return cls(None, seed, sizes, body, belief=answer, check=check)

    @property
    def morphology(self) -> Morphology:
        """The best model; joint inference rounds it to 1e-4 of each range.

        So the same seed gives the same body, and the same gait, on every processor.
        """
        return Morphology.from_array(self.body)

    def interval(self, mass: float = 0.9) -> tuple[Floats, Floats]:
        """Return the ends (9,) of each size's interval, which holds the size in ``morphology``.

        See ``eea.core.result.Result.interval``.
        """
        low, high = super().interval(mass)
        point = self.morphology.to_array()
        return np.minimum(low, point), np.maximum(high, point)

    def __str__(self) -> str:
        return "\n".join(statement(self))

    def __repr__(self) -> str:
        found = self.objective_fitness
        text = "logs"
        if self.config is not None:
            done = f"{len(self.rounds)} rounds of {self.config.steps} steps"
            text = f"{self.config.condition}, {done}"
        fitness = "" if found is None else f", OBJ_FIT {found:.3f}"
        return f"MorphologyEstimate({text}, seed {self.seed}{fitness})"


@own_errors
def fish_eea(
    target: Target,
    config: Config | None = None,
    seed: int = 0,
    truth: Morphology | ArrayLike | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> Session[Any]:
    """Return a session of the method of ``config.condition`` with a target and the fish.

    Parameters
    ----------
    target
        Performs commands: an ``EngineTarget``, or a robot in a tank.
    config
        Settings; None for joint inference from three trials.
    seed
        The replicate's seed.
    truth
        The target's body, if known, for OBJ_FIT in the records: a ``Morphology``, fin ->
        (x, y, z), or nine numbers.
    **simulator
        See ``EngineSimulator``. ``EngineSimulator`` and ``EEA`` state the errors.
    """
    config = checked_config(config)
    engine = EngineSimulator(config.steps, **simulator)
    problem = fish_problem()
    body = None if truth is None else Morphology.coerce(truth).to_array()
    if isinstance(config, JointConfig):
        # scipy.stats is imported here to keep `import eea` quick.
        from eea.fish.joint import fish_robot
        from eea.infer.session import JointInference

        return JointInference(target, fish_robot(engine), problem, config, seed, body)
    return EEA(target, engine, problem, config, seed, body)


def estimate_morphology_of(
    target: Target,
    config: Config | None = None,
    seed: int = 0,
    progress: Callable[[RoundRecord], None] | None = None,
    truth: Morphology | ArrayLike | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> MorphologyEstimate:
    """Infer the body of any target that performs commands, such as a physical robot.

    To keep the complete rounds of an interrupted run, or to continue it, iterate over ``fish_eea``.

    Parameters
    ----------
    target
        Implements ``perform(command)``, which returns a log with ``gyro`` of shape (steps, 3) or
        (1, steps, 3). If it executed another command, it returns ``eea.Performed(log, command)``.
    progress
        Called with each round's record.
    config, seed, truth, **simulator
        See ``fish_eea``.
    """
    callback("progress", progress)
    session = fish_eea(target, config, seed, truth, **simulator)
    return MorphologyEstimate(**vars(session.run(progress)))


@own_errors
def estimate_morphology(
    target_morphology: Morphology | ArrayLike | None = None,
    damage: Damage | str | None = None,
    config: Config | None = None,
    seed: int = 0,
    progress: Callable[[RoundRecord], None] | None = None,
    *,
    target_engine: str = "auto",
    **simulator: Unpack[SimulatorOptions],
) -> MorphologyEstimate:
    """Let a simulated, damaged fish infer its own body from a few trials.

    Parameters
    ----------
    target_morphology
        The body before the damage; None is the nominal one.
    damage
        The damage, such as ``"left_pectoral:length=0.5"``; None is no damage.
    config
        Settings; None for joint inference from three trials. ``PaperConfig()`` has the paper's:
        Out-of-Band Inference from 25 trials.
    seed, progress
        The seed of everything random; see ``estimate_morphology_of``.
    target_engine
        The target's engine; "auto" is PyBullet where it is installed.
    **simulator
        See ``EngineSimulator``. The current and the substeps hold for the target too.
    """
    settings = checked_config(config)
    callback("progress", progress)
    target = EngineTarget(
        target_morphology,
        damage,
        streams(seed)["target"],
        settings.steps,
        target_engine,
        simulator.get("current", (0.0, 0.0, 0.0)),
        simulator.get("substeps", 1),
    )
    return estimate_morphology_of(target, settings, seed, progress, target.morphology, **simulator)
