"""The bridge: the algorithm meets the fish of ``aquafish_gym``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW, SERVOS
from aquafish_gym.damage import Damage
from aquafish_gym.engines.base import simulate
from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import DIMENSIONS, Morphology
from eea.algorithm import EEA, Result, RoundRecord, streams
from eea.bits import BitLayout, Coding, action_layout, model_layout
from eea.checks import instance
from eea.config import EEAConfig
from eea.experiment import Floats, Target, Trials

Progress = Callable[[RoundRecord], None]


def fish_models(coding: Coding = "gray") -> BitLayout:
    """Return the 45-bit genome of the fish's nine dimensions."""
    return model_layout(((d.name, d.maximum, d.bits) for d in DIMENSIONS), coding)


def fish_actions(coding: Coding = "gray") -> BitLayout:
    """Return the 18-bit genome of the fish's three servo speeds."""
    bounds = zip(SERVOS, COMMAND_LOW.tolist(), COMMAND_HIGH.tolist(), strict=True)
    return action_layout(bounds, coding)


class SimulatorOptions(TypedDict, total=False):
    """The candidates' simulator, as keywords; ``EngineSimulator`` says what they mean."""

    engine: str
    dtype: str
    current: ArrayLike
    substeps: int
    threads: int | None


class EngineSimulator:
    """Candidate fish in one of ``aquafish_gym``'s engines, a batch a call.

    Parameters
    ----------
    steps
        Length of a trial in steps of 0.01 s.
    engine, dtype, current, substeps, threads
        As ``aquafish_gym.simulate``. The compiled engine's single precision is the fastest, and
        no result depends on the threads.
    record
        ``"rpy"``, or ``"attitude"`` to log the gyroscope too.

    Raises
    ------
    InvalidArgumentError, UnknownNameError, EngineUnavailableError
        If a setting is wrong or the engine is not to be had.
    """

    def __init__(
        self,
        steps: int,
        engine: str = "numba",
        dtype: str = "float32",
        current: ArrayLike = (0.0, 0.0, 0.0),
        substeps: int = 1,
        threads: int | None = None,
        record: str = "rpy",
    ) -> None:
        self.steps = steps
        self.engine = engine
        self.dtype = dtype
        self.current = current
        self.substeps = substeps
        self.threads = threads
        self.record = record
        # One motionless robot, so that a wrong setting is refused here and not in mid-run.
        self.simulate(Trials(np.zeros((1, 9)), np.zeros((1, 3)), np.zeros((1, 3))))

    def simulate(self, trials: Trials) -> ImuLog:
        """Run B trials of bodies (B, 9), commands (B, 3) and fin angles (B, 3)."""
        return simulate(
            trials.morphologies,
            trials.commands,
            trials.fin_angles,
            steps=self.steps,
            engine=self.engine,
            dtype=self.dtype,
            current=self.current,
            substeps=self.substeps,
            threads=self.threads,
            record=self.record,
        )


class EngineTarget:
    """A damaged fish that begins every command with its fins anywhere and does not say where.

    Parameters
    ----------
    morphology
        The body before the damage: a ``Morphology``, fin -> (x, y, z), nine numbers, or None
        for the nominal one.
    damage
        A ``Damage``, its text, a list of them, or None.
    rng
        Draws the hidden angles: the pectorals' over the whole turn, the caudal fin's phase over
        the whole cycle.
    steps
        Length of a trial in steps of 0.01 s.
    engine, current, substeps
        As ``aquafish_gym.simulate``.

    Raises
    ------
    InvalidArgumentError, UnknownNameError, EngineUnavailableError
        If the body, the damage or the engine is not to be had.
    """

    def __init__(
        self,
        morphology: Morphology | ArrayLike | None = None,
        damage: Damage | str | None = None,
        rng: np.random.Generator | None = None,
        steps: int = 256,
        engine: str = "pybullet",
        current: ArrayLike = (0.0, 0.0, 0.0),
        substeps: int = 1,
    ) -> None:
        self.morphology: Morphology = Damage.coerce(damage).apply(Morphology.coerce(morphology))
        self._rng = np.random.default_rng() if rng is None else rng
        # In the compiled engine too the target is computed in double precision: it plays nature.
        self._simulator = EngineSimulator(
            steps, engine, "float64", current, substeps, record="attitude"
        )
        self._fin_angles = np.zeros(3)

    def perform(self, command: Floats) -> ImuLog:
        """Hold a command (3,) from fin angles drawn anew; return the log of that one trial."""
        self._fin_angles = self._rng.uniform(-np.pi, np.pi, size=3)
        body = self.morphology.to_array()
        return self._simulator.simulate(
            Trials(body[None], np.asarray(command)[None], self._fin_angles[None])
        )

    @property
    def last_fin_angles(self) -> Floats:
        """The angles (3,) in rad at which the last command began.

        Hidden from every condition but Ideal; the records note them for analysis.
        """
        return self._fin_angles.copy()


@dataclass
class MorphologyEstimate(Result):
    """A run's result, with its conclusion as a body."""

    @property
    def morphology(self) -> Morphology:
        """The last round's best model."""
        return Morphology.from_array(self.model)


def fish_eea(
    target: Target,
    config: EEAConfig,
    seed: int = 0,
    truth: Morphology | ArrayLike | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> EEA:
    """Return the algorithm, ready to iterate, bound to a target and the fish's simulator.

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
        engine, dtype, current, substeps, threads of the candidates; see ``EngineSimulator``.

    Raises
    ------
    ConfigurationError, TargetError
        As ``EEA``.
    InvalidArgumentError, UnknownNameError, EngineUnavailableError
        As ``EngineSimulator``, and if the truth is no body.
    """
    instance("config", config, EEAConfig)
    record = "rpy" if config.behavior.signal == "attitude" else "attitude"
    return EEA(
        target,
        EngineSimulator(config.steps, record=record, **simulator),
        fish_models(config.genetic.coding),
        fish_actions(config.genetic.coding),
        config,
        seed,
        None if truth is None else Morphology.coerce(truth).to_array(),
    )


def estimate_morphology_of(
    target: Target,
    config: EEAConfig | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    truth: Morphology | ArrayLike | None = None,
    **simulator: Unpack[SimulatorOptions],
) -> MorphologyEstimate:
    """Model any target that performs commands, a physical robot for example.

    Parameters
    ----------
    target
        Implements ``perform(command)``, which returns a log with ``rpy`` (and ``gyro``, if the
        behaviour is of body rates) of shape (steps, 3) or (1, steps, 3).
    progress
        Called with each round's record.
    config, seed, truth, **simulator
        See ``fish_eea``.

    Returns
    -------
    MorphologyEstimate
        ``.morphology``, ``.rounds``, ``.to_json()``.

    Notes
    -----
    Ctrl-C passes through as KeyboardInterrupt, and nothing is returned then; ``progress`` has
    been given every completed round. To keep the result, or to go on later, iterate over
    ``fish_eea`` instead: its ``.result`` is readable after every round.
    """
    eea = fish_eea(target, EEAConfig() if config is None else config, seed, truth, **simulator)
    result = eea.run(progress)
    return MorphologyEstimate(**{f.name: getattr(result, f.name) for f in fields(result)})


def estimate_morphology(
    target_morphology: Morphology | ArrayLike | None = None,
    damage: Damage | str | None = None,
    config: EEAConfig | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    target_engine: str = "pybullet",
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
        Settings; None for the defaults, Out-of-Band Inference.
    seed
        Everything random follows from it; the angles that the target hides are the same under
        every condition.
    progress
        Called with each round's record.
    target_engine
        Where the target swims; the candidates swim in ``engine``.
    **simulator
        engine, dtype, current, substeps, threads; see ``EngineSimulator``. The current and the
        substeps hold for the target too.

    Returns
    -------
    MorphologyEstimate
        ``.morphology``, ``.rounds``, ``.to_json()``.

    Notes
    -----
    For Ctrl-C, see ``estimate_morphology_of``.
    """
    settings = EEAConfig() if config is None else config
    instance("config", settings, EEAConfig)
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
