"""The bridge: the algorithm meets the fish of ``aquafish_gym``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.command import COMMAND_HIGH, COMMAND_LOW, SERVOS
from aquafish_gym.damage import Damage
from aquafish_gym.engines.base import simulate
from aquafish_gym.imu import ImuLog, unwrap_rpy
from aquafish_gym.morphology import DIMENSIONS, Morphology
from aquafish_gym.physics.attitude import attitude
from eea.core.algorithm import EEA, Result, RoundRecord, streams
from eea.core.behavior import BehaviorConfig
from eea.core.bits import BitLayout, Coding, action_layout, model_layout
from eea.core.checks import choice, instance
from eea.core.config import EEAConfig
from eea.core.experiment import Floats, Target, Trials
from eea.core.laboratory import Comparer

Progress = Callable[[RoundRecord], None]
Orientation = Literal["upright", "heading", "attitude"]


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
        ``"attitude"`` to log the gyroscope with roll, pitch and yaw, or ``"rpy"`` for these alone.

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
        record: str = "attitude",
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

    def comparer(self, behavior: BehaviorConfig, steps: int) -> Comparer | None:
        """Return what compares behaviours in the engine itself, if this one can."""
        # A subclass that simulates otherwise, with noise say, must be asked; and trials of
        # another length than is wanted must be refused.
        as_here = type(self).simulate is EngineSimulator.simulate and steps == self.steps
        if self.engine != "numba" or not as_here:
            return None
        # numba comes with it: importing this package stays quick.
        from eea.aquafish.spectral import SpectralComparer, can_compare

        return SpectralComparer(self, behavior) if can_compare(behavior, steps) else None


def rotations(rpy: Floats) -> Floats:
    """Return the matrices (T, 3, 3) from body to world of roll, pitch and yaw (T, 3), rad."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy).T, np.sin(rpy).T
    rows = [
        [cy * cr - sy * sp * sr, -sy * cp, cy * sr + sy * sp * cr],
        [sy * cr + cy * sp * sr, cy * cp, sy * sr - cy * sp * cr],
        [-cp * sr, sp, cp * cr],
    ]
    matrices: Floats = np.moveaxis(np.array(rows), -1, 0)
    return matrices


def random_orientation(orientation: str, rng: np.random.Generator) -> Floats:
    """Return a matrix (3, 3) from body to world, drawn as ``EngineTarget`` says."""
    if orientation == "upright":
        return np.eye(3)
    if orientation == "heading":
        level: Floats = rotations(np.array([[0.0, 0.0, rng.uniform(-np.pi, np.pi)]]))[0]
        return level
    # The directions of normal numbers are uniform, and so are the bases that they span.
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    uniform: Floats = q * np.sign(np.linalg.det(q))
    return uniform


def turn_log(log: ImuLog, start: Floats) -> ImuLog:
    """Return the log of attitudes and rates of one fish that had begun in another orientation.

    Neither the water nor the neutrally buoyant fish knows up from down, so to begin turned is to
    do the same, turned.

    Parameters
    ----------
    log
        Of a trial from the upright start, (1, T, 3).
    start
        The other start, a matrix (3, 3) from body to world.
    """
    if log.diverged.any():
        return log  # no attitude is left to turn
    turned = start @ rotations(np.asarray(log.rpy[0], dtype=np.float64))
    rpy = np.array([attitude(r) for r in [start.tolist(), *turned.tolist()]])
    return replace(log, rpy=unwrap_rpy(rpy)[None, 1:])


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
    orientation
        How the body itself lies at the start: ``"upright"``, facing +y, as the models do;
        ``"heading"``, level and facing anywhere; ``"attitude"``, anyhow. The log is of the
        attitude in the world. The hidden angles are the same for all three. Only the attitude
        signal, or a current, lets the models feel it: still water knows no direction, and the
        gyroscope reads the same in it.

    Raises
    ------
    InvalidArgumentError, UnknownNameError, EngineUnavailableError
        If the body, the damage or the engine is not to be had.
    ConfigurationError
        If the orientation is unknown.
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
        orientation: Orientation = "upright",
    ) -> None:
        choice("orientation", orientation, ("upright", "heading", "attitude"))
        self.morphology: Morphology = Damage.coerce(damage).apply(Morphology.coerce(morphology))
        self._rng = np.random.default_rng() if rng is None else rng
        # In the compiled engine too the target is computed in double precision: it plays nature.
        self._simulator = EngineSimulator(
            steps, engine, "float64", current, substeps, record="attitude"
        )
        self._current = np.asarray(current, dtype=np.float64)
        self._orientation = orientation
        self._fin_angles = np.zeros(3)

    def perform(self, command: Floats) -> ImuLog:
        """Hold a command (3,) from fin angles drawn anew; return the log of that one trial."""
        self._fin_angles = self._rng.uniform(-np.pi, np.pi, size=3)
        body = self.morphology.to_array()
        trial = Trials(body[None], np.asarray(command)[None], self._fin_angles[None])
        if self._orientation == "upright":
            return self._simulator.simulate(trial)
        # From a hash of the angles: they stay the same whatever else is random, and there is no
        # second stream whose state would have to be saved.
        rng = np.random.default_rng(self._fin_angles.view(np.uint64))
        start = random_orientation(self._orientation, rng)
        self._simulator.current = start.T @ self._current  # the water, as seen from that start
        return turn_log(self._simulator.simulate(trial), start)

    def save_state(self) -> dict[str, Any]:
        """Return where the stream of hidden angles stands."""
        return {"stream": dict(self._rng.bit_generator.state)}

    def restore_state(self, saved: dict[str, Any]) -> None:
        """Hide the same angles from now on as after ``save_state``."""
        self._rng.bit_generator.state = saved["stream"]

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
        Implements ``perform(command)``, which returns a log with ``gyro`` (or, if
        ``config.behavior.signal`` is "attitude", ``rpy``) of shape (steps, 3) or (1, steps, 3).
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
    target_orientation: Orientation = "upright",
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
    target_orientation
        How the target's body lies when a trial begins; see ``EngineTarget``.
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
        target_orientation,
    )
    return estimate_morphology_of(target, settings, seed, progress, target.morphology, **simulator)
