"""The damaged fish itself, simulated: what the algorithm asks and may not look into."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.damage import Damage
from aquafish_gym.engines.base import MAXIMUM_SUBSTEPS, simulate
from aquafish_gym.engines.packages import resolve_engine
from aquafish_gym.imu import ImuLog, unwrap_rpy
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.attitude import attitude, rotations
from aquafish_gym.utils.validation import finite_array, integer
from eea.aquafish.gap import RealityGap
from eea.core.angles import Floats
from eea.core.checks import choice, instance

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
    morphology
        The body after the damage.
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
        self.morphology: Morphology = Damage.coerce(damage).apply(Morphology.coerce(morphology))
        self.engine: str = resolve_engine("engine", engine)
        self._rng = np.random.default_rng() if rng is None else rng
        self._gap = gap
        shared = finite_array("current", current, (3,), unit="units/s")
        world: dict[str, Any] = dict(
            vars(gap.world(shared, integer("substeps", substeps, 1, MAXIMUM_SUBSTEPS)))
        )
        self._current = np.array(world.pop("current"))
        # In the compiled engine too the target is computed in double precision: it plays nature.
        self._how = {"steps": steps, "engine": self.engine, "dtype": "float64", **world}
        self._swim(np.zeros(9), np.zeros(3), np.zeros(3), self._current)  # refuses wrong settings
        self._orientation = orientation
        self._start_angles = np.zeros(3)

    def perform(self, command: Floats) -> ImuLog:
        """Hold a command (3,) from fin angles drawn anew; return the log of that one trial."""
        drawn = self._rng.uniform(-np.pi, np.pi, size=3)
        # From a hash of the angles: they stay the same whatever else is random.
        entropy = drawn.view(np.uint64)
        start = random_orientation(self._orientation, np.random.default_rng(entropy))
        noise = np.random.default_rng(np.random.SeedSequence(entropy, spawn_key=(1,)))
        angles = self._start_angles = self._gap.placed(drawn)
        water = start.T @ self._current  # as seen from that start
        log = self._swim(self.morphology.to_array(), command, angles, water)
        if self._orientation != "upright":
            log = turn_log(log, start)
        return self._gap.felt(log, noise)

    def _swim(self, body: Floats, command: Floats, angles: Floats, current: Floats) -> ImuLog:
        return simulate(body, command, angles, current=current, **self._how)

    @property
    def start_angles(self) -> Floats:
        """The fins' angles (3,) in rad at which the last command began.

        Hidden from every condition but Ideal; the records note them for analysis.
        """
        return self._start_angles.copy()
