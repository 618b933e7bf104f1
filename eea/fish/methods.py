"""The methods bound to the fish: from a target that performs commands to a body."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Unpack

from numpy.typing import ArrayLike

from aquafish_gym.damage import Damage
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import BodyPlan, PlanLike
from eea.core.algorithm import EEA
from eea.core.checks import callback
from eea.core.config import Config, JointConfig, checked_config
from eea.core.experiment import Target
from eea.core.floating import own_errors
from eea.core.result import RoundRecord
from eea.core.session import Session, streams
from eea.fish.estimate import MorphologyEstimate
from eea.fish.simulator import EngineSimulator, SimulatorOptions, fish_problem
from eea.fish.target import EngineTarget


@own_errors
def fish_eea(
    target: Target,
    config: Config | None = None,
    seed: int = 0,
    truth: Morphology | ArrayLike | None = None,
    plan: PlanLike | None = None,
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
        (x, y, z), or its sizes (S,).
    plan
        The body plan; None for that of an ``EngineTarget`` or of ``truth``, else the paper's.
    **simulator
        See ``EngineSimulator``. ``EngineSimulator`` and ``EEA`` state the errors.
    """
    config = checked_config(config)
    plan = _plan_of(target, truth, plan)
    engine = EngineSimulator(config.steps, plan=plan, **simulator)
    problem = fish_problem(plan)
    body = None if truth is None else Morphology.coerce(truth, plan).to_array()
    if isinstance(config, JointConfig):
        # scipy.stats is imported here to keep `import eea` quick.
        from eea.fish.joint import fish_robot
        from eea.infer.session import JointInference

        return JointInference(target, fish_robot(engine), problem, config, seed, body)
    return EEA(target, engine, problem, config, seed, body)


def _plan_of(target: object, truth: object, plan: PlanLike | None) -> BodyPlan:
    """Return a plan as given, or else that of a target or its body."""
    if isinstance(target, EngineTarget):
        return Morphology.coerce(target.morphology, plan).plan  # raises for another plan
    return Morphology.coerce(truth if isinstance(truth, Morphology) else None, plan).plan


def estimate_morphology_of(
    target: Target,
    config: Config | None = None,
    seed: int = 0,
    progress: Callable[[RoundRecord], None] | None = None,
    truth: Morphology | ArrayLike | None = None,
    plan: PlanLike | None = None,
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
    config, seed, truth, plan, **simulator
        See ``fish_eea``.
    """
    callback("progress", progress)
    session = fish_eea(target, config, seed, truth, plan, **simulator)
    result = session.run(progress)
    return MorphologyEstimate(**vars(result), plan=_plan_of(target, truth, plan))


@own_errors
def estimate_morphology(
    target_morphology: Morphology | ArrayLike | None = None,
    damage: Damage | str | None = None,
    config: Config | None = None,
    seed: int = 0,
    progress: Callable[[RoundRecord], None] | None = None,
    *,
    target_engine: str = "auto",
    plan: PlanLike | None = None,
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
    plan
        The body plan; None for that of a ``Morphology``, else the paper's.
    **simulator
        See ``EngineSimulator``. The current, the substeps and ``reactive`` hold for the target too.
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
        plan=plan,
        reactive=simulator.get("reactive", False),
    )
    return estimate_morphology_of(target, settings, seed, progress, target.morphology, **simulator)
