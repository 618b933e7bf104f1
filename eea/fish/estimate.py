"""The algorithm bound to the fish: from commands and IMU logs to a body."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from html import escape
from typing import TYPE_CHECKING, Any, Unpack

from numpy.typing import ArrayLike

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW, SERVOS, check_commands
from aquafish_gym.damage import Damage
from aquafish_gym.morphology import DIMENSIONS, FINS, Morphology
from eea.core.algorithm import EEA
from eea.core.behavior import Log, gyro_samples
from eea.core.checks import at_most
from eea.core.config import Config, JointConfig, checked_config
from eea.core.experiment import Target
from eea.core.genome import BitLayout, action_layout, model_layout
from eea.core.problem import Problem
from eea.core.replay import ReplayTarget
from eea.core.result import Result, RoundRecord
from eea.core.session import Session, streams
from eea.fish.gap import RealityGap
from eea.fish.simulator import EngineSimulator, SimulatorOptions
from eea.fish.target import NO_GAP, EngineTarget, Orientation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Progress = Callable[[RoundRecord], None]


def fish_models() -> BitLayout:
    """Return the 45-bit genome of the fish's nine dimensions."""
    return model_layout((d.name, d.maximum, d.bits) for d in DIMENSIONS)


def fish_actions() -> BitLayout:
    """Return the 18-bit genome of the fish's three servo speeds."""
    bounds = zip(SERVOS, COMMAND_LOW.tolist(), COMMAND_HIGH.tolist(), strict=True)
    return action_layout(bounds)


def fish_problem() -> Problem:
    """Return the fish as the algorithm sees it: nine sizes, three servos, fins, and IMU axes."""
    return Problem(fish_models(), fish_actions(), hidden=FINS, axes=3)


@dataclass(repr=False)
class MorphologyEstimate(Result):
    """A run's result, with its conclusion as a body.

    Examples
    --------
    >>> from eea.core.config import PaperConfig
    >>> from eea.core.estimation import EstimationConfig
    >>> quick = PaperConfig(condition="none", steps=32, rounds=1, estimation=EstimationConfig(4, 2))
    >>> estimate = estimate_morphology(None, "caudal:missing", quick, target_engine="numba")
    >>> estimate.morphology.caudal  # doctest: +SKIP
    (0.13, 1.43, 0.52)
    >>> str(estimate).startswith("MorphologyEstimate(none, 1 round of 32 steps, seed 0; MOD_FIT")
    True
    """

    @property
    def morphology(self) -> Morphology:
        """The last round's best model."""
        return Morphology.from_array(self.model)

    def plot(self) -> Figure:
        """Return a matplotlib figure of OBJ_FIT, where the truth is known, and MOD_FIT by round."""
        from eea.fish.run_figure import fitness_figure

        return fitness_figure(self)

    def plot_posterior(self) -> Figure:
        """Return a matplotlib figure of what is believed of sizes and nuisances.

        The condition joint alone has it; others raise ConfigurationError.
        """
        from eea.fish.posterior_figure import posterior_figure

        return posterior_figure(self)

    def __repr__(self) -> str:
        config, done = self.config, len(self.rounds)
        said = f"{config.condition}, {done} round{'' if done == 1 else 's'} of {config.steps} steps"
        said += f", seed {self.seed}"
        if self.rounds:
            said += f"; MOD_FIT {self.rounds[-1].model_fitness:.3f}"
        if self.objective_fitness is not None:
            said += f", OBJ_FIT {self.objective_fitness:.3f}"
        if self.belief is not None:
            said += f", 90% intervals {100 * self.width():.2g}% of the ranges wide"
        return f"MorphologyEstimate({said})"

    def _repr_html_(self) -> str:
        """Return the sizes found as a table, with how sure they are and the truth where known."""
        columns: dict[str, list[str]] = {}
        if self.rounds:
            columns["found"] = [f"{size:.3f}" for size in self.model]
        if self.belief is not None:
            ends = zip(*self.interval(), strict=True)
            columns["90% interval"] = [f"{low:.3f} to {high:.3f}" for low, high in ends]
        if self.truth is not None:
            columns["true"] = [f"{size:.3f}" for size in self.truth]
        head = "".join(f"<th>{name}</th>" for name in ["units of 5 cm", *columns])
        rows = "".join(
            f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>"
            for row in zip(self.layout.names, *columns.values(), strict=True)
        )
        said = [] if self.belief is None else [*self.belief.findings, self.belief.verdict]
        words = "".join(f"<p>{escape(sentence)}</p>" for sentence in dict.fromkeys(said))
        return f"<p>{escape(repr(self))}</p><table><tr>{head}</tr>{rows}</table>{words}"


def fish_eea(
    target: Target,
    config: Config,
    seed: int = 0,
    truth: Morphology | ArrayLike | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> Session[Any]:
    """Return the method of ``config.condition``, ready to iterate, bound to a target and the fish.

    Parameters
    ----------
    target
        Whatever performs commands: an ``EngineTarget`` or a robot in a tank.
    config, seed
        Settings, and the replicate's seed.
    truth
        The target's body, if known, for OBJ_FIT in the records: a ``Morphology``, fin ->
        (x, y, z), or nine numbers.
    **simulator
        engine, dtype, current, substeps, threads of the candidates; see ``EngineSimulator``,
        and it and ``EEA`` for the errors.
    """
    config = checked_config(config)
    engine, problem = EngineSimulator(config.steps, **simulator), fish_problem()
    body = None if truth is None else Morphology.coerce(truth).to_array()
    if isinstance(config, JointConfig):
        # scipy's statistics come with it: importing this room stays quick.
        from eea.fish.joint import fish_joint
        from eea.joint.session import JointInference

        return JointInference(target, fish_joint(problem, engine), config, seed, body)
    return EEA(target, engine, problem, config, seed, body)


def estimate_morphology_of(
    target: Target,
    config: Config | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    truth: Morphology | ArrayLike | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> MorphologyEstimate:
    """Model any target that performs commands, a physical robot for example.

    Ctrl-C passes through as KeyboardInterrupt, and nothing is returned then; ``progress`` has
    been given every completed round. To keep the result, or to go on later, iterate over
    ``fish_eea`` instead: its ``.result`` is readable after every round.

    Parameters
    ----------
    target
        Implements ``perform(command)``, which returns a log with ``gyro`` of shape (steps, 3) or
        (1, steps, 3).
        If it executed another command than it was asked for, it returns
        ``eea.Performed(log, command)``.
    progress
        Called with each round's record.
    config
        Settings; None for those recommended, joint inference from three trials.
    seed, truth, **simulator
        See ``fish_eea``.
    """
    session = fish_eea(target, checked_config(config), seed, truth, **simulator)
    result = session.run(progress)
    return MorphologyEstimate(**{f.name: getattr(result, f.name) for f in fields(result)})


def estimate_from_logs(
    commands: ArrayLike,
    logs: Sequence[Log],
    config: Config | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    truth: Morphology | ArrayLike | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> MorphologyEstimate:
    """Model a robot from a recorded session, without the robot.

    Parameters
    ----------
    commands
        What the robot executed, shape (E, 3), rev/s, rev/s and Hz.
    logs
        What it logged, one trial each; see ``estimate_morphology_of``. ``SwimLog.trials``
        gives both of a file.
    config
        Settings; None for joint inference, with as many rounds as logs, of the logs' length.
    seed, progress, truth, **simulator
        See ``estimate_morphology_of``.

    Raises
    ------
    ConfigurationError
        If there are more rounds than logs, or commands and logs are not equally many.
    InvalidArgumentError
        If a command is none of the fish's.
    """
    target = ReplayTarget(check_commands(commands), logs)
    if config is None:
        samples = gyro_samples(logs[0], source="the first of logs")
        config = JointConfig(rounds=len(target), steps=samples.shape[1])
    config = checked_config(config)
    at_most("config.rounds", config.rounds, "the number of logs", len(target))
    return estimate_morphology_of(target, config, seed, progress, truth, **simulator)


def estimate_morphology(
    target_morphology: Morphology | ArrayLike | None = None,
    damage: Damage | str | None = None,
    config: Config | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    target_engine: str = "auto",
    target_orientation: Orientation = "upright",
    gap: RealityGap = NO_GAP,
    **simulator: Unpack[SimulatorOptions],
) -> MorphologyEstimate:
    """Let a damaged fish work out its own body, from blind trials only.

    Parameters
    ----------
    target_morphology
        The body before the damage; None is the nominal one.
    damage
        What broke, as ``"left_pectoral:length=0.5"``; None is nothing.
    config
        Settings; None for those recommended, joint inference from three trials. The paper's are
        ``PaperConfig()``, Out-of-Band Inference from 25.
    seed, progress
        Everything random follows from the seed; see ``estimate_morphology_of``.
    target_engine
        Where the target swims, "auto" being PyBullet where it is installed; the candidates swim
        in ``engine``.
    target_orientation
        How the target's body lies when a trial begins; see ``EngineTarget``.
    gap
        How the target's world differs from the candidates'.
    **simulator
        engine, dtype, current, substeps, threads; see ``EngineSimulator``. The current and the
        substeps hold for the target too.

    """
    settings = checked_config(config)
    target = EngineTarget(
        target_morphology,
        damage,
        streams(seed)["target"],
        settings.steps,
        target_engine,
        simulator.get("current", (0.0, 0.0, 0.0)),
        simulator.get("substeps", 1),
        target_orientation,
        gap,
    )
    return estimate_morphology_of(target, settings, seed, progress, target.morphology, **simulator)
