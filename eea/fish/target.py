"""The damaged fish itself, simulated: what the algorithm asks and may not look into."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.command import check_commands
from aquafish_gym.damage import Damage
from aquafish_gym.engines.api import MAXIMUM_SUBSTEPS, simulate_scenario
from aquafish_gym.engines.packages import resolve_engine
from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.attitude import rotations
from aquafish_gym.scenario import Scenario, check_row
from aquafish_gym.utils.validation import finite_array, integer
from eea.core.angles import Floats
from eea.core.checks import choice, instance
from eea.fish.broken_trial import apply_sensor_faults, initial_angles, rpy_of
from eea.fish.gap import RealityGap

Orientation = Literal["upright", "heading", "attitude"]
NO_GAP = RealityGap()


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
    """Return a log (1, T, 3) from the upright start as it is from another, a matrix (3, 3).

    Neither the water nor the neutrally buoyant fish knows up from down, so to begin turned is to
    do the same, turned.
    """
    if log.rpy is None or log.diverged.any():
        return log  # there is no attitude to turn
    turned = start @ rotations(np.asarray(log.rpy[0], dtype=np.float64))
    return replace(log, rpy=rpy_of([start, *turned]))


class EngineTarget:
    """A damaged fish that begins every command with its fins anywhere and does not say where.

    Parameters
    ----------
    morphology
        The body before the damage: a ``Morphology``, fin -> (x, y, z), nine numbers, or None
        for the nominal one.
    damage
        A ``Damage``, its text, a list of them, or None, of which nothing is left to chance. Each
        trial is an episode: it begins at 0 s, so that what strikes at 1 s does so in every trial,
        and all is whole again when the next begins. A seized servo without an angle stands in
        every trial where it stood in the first, a dead one anywhere. Of a broken sensor every
        sample of the log is an observation. What is broken comes on top of the ``gap``.
    rng
        Draws the hidden angles: the pectorals' over the whole turn, the caudal fin's phase over
        the whole cycle.
    steps, engine, current, substeps
        As ``aquafish_gym.simulate``.
    orientation
        How the body itself lies at the start: ``"upright"``, facing +y, as the models do;
        ``"heading"``, level and facing anywhere; ``"attitude"``, anyhow. The log is of the
        attitude in the world. The hidden angles are the same for all three. Only the attitude
        signal, or a current, lets the models feel it: still water knows no direction, and the
        gyroscope reads the same in it.
    gap
        How the target differs from the world that its models swim in, which ``current`` and
        ``substeps`` are of. The hidden angles are the same for all gaps, but for a seized servo's.
        Noise and bias are the gyroscope's; they leave the attitude alone.

    Attributes
    ----------
    damage
        What is broken.
    morphology
        The body with every fault of its fins, whenever they begin.
    engine
        The engine's own name, never ``"auto"``.

    Raises
    ------
    InvalidArgumentError, UnknownNameError, EngineUnavailableError, ConfigurationError
        If a body, damage, engine or orientation is not to be had.

    Examples
    --------
    >>> fish = EngineTarget(None, "left_pectoral:length=0.5", steps=64, engine="numba")
    >>> fish.perform(np.array([0.4, -0.3, 0.8])).gyro.shape
    (1, 64, 3)

    A tail that fails half a second into each trial:

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
        orientation: Orientation = "upright",
        gap: RealityGap = NO_GAP,
    ) -> None:
        instance("gap", gap, RealityGap)
        choice("orientation", orientation, ("upright", "heading", "attitude"))
        self.damage, whole = Damage.coerce(damage), Morphology.coerce(morphology)
        self.morphology: Morphology = self.damage.body(whole)
        self.engine: str = resolve_engine("engine", engine)
        self._rng = np.random.default_rng() if rng is None else rng
        self._gap = gap
        shared = finite_array("current", current, (3,), unit="units/s")
        integer("substeps", substeps, 1, MAXIMUM_SUBSTEPS)
        self._substeps = integer("substeps", substeps * gap.substeps, 1, MAXIMUM_SUBSTEPS)
        self._world, self._steps = gap.edit(Scenario.create(whole, current=shared)), steps
        check_row("current", self._world.current[0])
        broken = self.damage.edit(self._world)
        for stage in (broken, *(change.to for change in broken.schedule)):
            check_row("servo_gain", stage.servo_gain[0])
        self._simulate(np.zeros(3), replace(broken, fin_angles=np.zeros((1, 3))))  # may refuse
        self._orientation = orientation
        self._start_angles = np.zeros(3)
        self._first_angles: Floats | None = None

    def perform(self, command: Floats) -> ImuLog:
        """Hold a command (3,) from fin angles drawn anew; return the log of that one trial."""
        drawn = self._rng.uniform(-np.pi, np.pi, size=3)
        # From a hash of the angles: they stay the same whatever else is random.
        entropy = drawn.view(np.uint64)
        start = random_orientation(self._orientation, np.random.default_rng(entropy))
        noise, faults = (
            np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(i,))) for i in (1, 2)
        )
        angles = self._gap.placed(drawn)
        if self._first_angles is None:
            self._first_angles = angles
        angles = self._start_angles = initial_angles(angles, self._first_angles, self.damage)
        water = start.T @ self._world.current[0]  # as seen from that start
        broken = self.damage.edit(replace(self._world, current=water[None]))
        log = self._simulate(command, replace(broken, fin_angles=angles[None]))
        if self._orientation != "upright":
            log = turn_log(log, start)
        log = self._gap.felt(log, noise)
        return apply_sensor_faults(log, broken, start, self._gap.gyro_bias, faults)

    def _simulate(self, command: Floats, scenario: Scenario) -> ImuLog:
        # In the compiled engine too the target is computed in double precision: it plays nature.
        return simulate_scenario(
            scenario, check_commands(command), self._steps, self.engine, "float64", self._substeps
        )

    @property
    def start_angles(self) -> Floats:
        """The fins' angles (3,) in rad at which the last command began.

        Hidden from every condition but Ideal; the records note them for analysis.
        """
        return self._start_angles.copy()
