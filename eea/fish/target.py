"""The simulated target: a damaged fish whose initial fin angles are hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.command import check_commands
from aquafish_gym.damage import CHANNELS, Damage
from aquafish_gym.damage.sensors import ONLY_ROBOT, sensor_columns
from aquafish_gym.damage.side import Side
from aquafish_gym.engines.api import simulate_scenario
from aquafish_gym.engines.packages import resolve_engine
from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import Morphology
from aquafish_gym.plans import BodyPlan, PlanLike
from aquafish_gym.scenario import GYRO_CHANNELS, TIMESTEP, Scenario, check_row
from aquafish_gym.utils.validation import InvalidArgumentError, integer
from aquafish_gym.world_config import MAXIMUM_SUBSTEPS
from eea.core.angles import Floats, wrap
from eea.core.checks import instance
from eea.fish.gap import RealityGap

NO_GAP = RealityGap()


class EngineTarget:
    """A damaged fish that performs each command from random, hidden fin angles.

    Parameters
    ----------
    morphology
        The body before the damage: a ``Morphology``, fin -> (x, y, z), the sizes (S,), or None
        for the nominal one.
    damage
        A ``Damage`` without random parts, its text, a list of them, or None. Each trial is an
        episode: a fault with an onset of 1 s begins at 1 s of every trial, before the trial's end.
        Without a given angle a seized servo keeps its angle of the first trial; a dead servo starts
        each trial at random. Every sample of the log is an observation of the sensor. The ``gap``
        adds to the damage.
    rng
        Draws the hidden angles over the whole turn, the phases of fins that sweep over the whole
        cycle.
    steps, engine, current, substeps, reactive
        See ``aquafish_gym.simulate``.
    gap
        Differences of the target's world from the models' world; ``current``, ``substeps`` and
        ``reactive`` describe the latter. The hidden angles are the same for all gaps.
    plan
        The body plan; None for that of a ``Morphology``, else the paper's.

    Raises
    ------
    InvalidArgumentError, UnknownNameError, EngineUnavailableError, ConfigurationError
        If an argument is wrong or the engine is not installed.

    Examples
    --------
    >>> fish = EngineTarget(None, "caudal:dead@0.5; gyro_z:bias=0.1", steps=64, engine="numba")
    >>> fish.perform(np.array([0.4, -0.3, 0.8])).gyro.shape
    (1, 64, 3)
    """

    def __init__(
        self,
        morphology: Morphology | ArrayLike | None = None,
        damage: Damage | str | None = None,
        rng: np.random.Generator | None = None,
        steps: int = 256,
        engine: str = "auto",
        current: ArrayLike = (0.0, 0.0, 0.0),
        substeps: int = 1,
        gap: RealityGap = NO_GAP,
        plan: PlanLike | None = None,
        reactive: bool = False,
    ) -> None:
        instance("gap", gap, RealityGap)
        if rng is not None:
            instance("rng", rng, np.random.Generator)
        integer("substeps", substeps, 1, MAXIMUM_SUBSTEPS)
        intact = Morphology.coerce(morphology, plan)
        self.plan: BodyPlan = intact.plan
        self.damage = Damage.coerce(damage)
        #: The body with every fault of its fins, whenever they begin.
        self.morphology: Morphology = self.damage.body(intact)
        self.engine: str = resolve_engine("engine", engine)  #: The engine's name, never "auto".
        self._rng = np.random.default_rng() if rng is None else rng
        self._gap = gap
        self._steps = steps
        self._substeps = substeps * gap.substeps
        world = gap.edit(
            Scenario.create(intact, current=current, reactive=reactive, plan=self.plan)
        )
        check_row("current", world.current[0])
        self._scenario = self.damage.edit(world)
        for gain in self._scenario.servo_gain:
            check_row("servo_gain", gain, self.plan)
        if self._scenario.has("servo_delay", "servo_hold"):
            raise InvalidArgumentError(
                "damage of a target must not be delay or hold of a servo, whose command is the "
                f"same throughout a trial: use RealityGap(lag=...); got {self.damage}"
            )
        none = np.zeros(len(self.plan.fins))
        self._simulate(none, none)  # raises for wrong settings
        for fault in self.damage.faults:
            if fault.span[0] >= steps * TIMESTEP:
                raise InvalidArgumentError(
                    f"damage must begin within the trial, which lasts {steps * TIMESTEP:g} s; "
                    f"got {fault}"
                )
        #: The initial fin angles (F,) in rad of the last command. Only the condition Ideal uses
        #: them; the records note them for analysis.
        self.start_angles: Floats = none
        self._first_angles: Floats | None = None

    def perform(self, command: Floats) -> ImuLog:
        """Hold a command (F,) from random fin angles; return the trial's log, with ``gyro``."""
        drawn = self._rng.uniform(-np.pi, np.pi, size=len(self.plan.fins))
        # The angles seed the noise, because they do not depend on other random choices.
        noise, faults = (
            np.random.default_rng(np.random.SeedSequence(drawn.view(np.uint64), spawn_key=(i,)))
            for i in (1, 2)
        )
        self.start_angles = self._initial_angles(drawn)
        log = self._simulate(command, self.start_angles)
        assert log.gyro is not None
        white = self._gap.gyro_noise * noise.standard_normal(log.gyro.shape)
        gyro: Floats = log.gyro + np.array(self._gap.gyro_bias) + white
        return replace(log, gyro=self._observed(gyro, faults) if self.damage.faults else gyro)

    def _simulate(self, command: Floats, angles: Floats) -> ImuLog:
        # In double precision, also in the compiled engine: the target stands for a real robot.
        return simulate_scenario(
            replace(self._scenario, fin_angles=angles[None]),
            check_commands(self.plan, command),
            self._steps,
            self.engine,
            "float64",
            self._substeps,
            record="gyro",
        )

    def _initial_angles(self, drawn: Floats) -> Floats:
        """Return the fin angles (F,) in rad at which a trial begins.

        A fin begins at its ``drawn`` angle (F,) if its servo turns or is dead. The fin of a seized
        servo begins at the given angle, or else at its angle of the first trial.
        """
        if self._first_angles is None:
            self._first_angles = drawn
        first = self._first_angles
        fields = {"body": np.zeros((1, len(self.plan.dimensions))), "fin_angles": first[None]}
        broken = self.damage.edit(Scenario.fill(fields, plan=self.plan))
        found = broken.fin_angles[0]  # NaN without power
        seized = (broken.servo_gain[0] == 0.0) & ~np.isnan(found)
        return np.where(seized, np.where(found == first, first, wrap(found)), drawn)

    def _observed(self, gyro: Floats, rng: np.random.Generator) -> Floats:
        """Return angular velocities (1, T, 3) as the damaged gyroscope records them."""
        truth = np.zeros((gyro.shape[1] + 1, len(CHANNELS)))
        truth[0, GYRO_CHANNELS] = self._gap.gyro_bias  # the trial begins at rest
        truth[1:, GYRO_CHANNELS] = gyro[0]
        sensors = Side(1, len(CHANNELS), TIMESTEP)
        sensors.remember(self._scenario.sensor_delay)
        sensors.update(ONLY_ROBOT, sensor_columns(self._scenario.beginning.columns()))
        observed = []
        for begin, end, _, to in self._scenario.segments(len(truth)):
            if to is not None:
                sensors.update(ONLY_ROBOT, sensor_columns(to.columns()))
            observed.append(sensors.record(truth[begin:end], rng))
        return np.concatenate(observed, dtype=np.float64)[None, 1:, GYRO_CHANNELS]
