"""The damaged fish itself, simulated: what the algorithm asks and may not look into."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from aquafish_gym.damage import Damage
from aquafish_gym.engines.base import simulate
from aquafish_gym.engines.packages import resolve_engine
from aquafish_gym.imu import ImuLog, unwrap_rpy
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.attitude import attitude, rotations
from eea.core.angles import Floats
from eea.core.checks import choice

Orientation = Literal["upright", "heading", "attitude"]


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
    ) -> None:
        choice("orientation", orientation, ("upright", "heading", "attitude"))
        self.morphology: Morphology = Damage.coerce(damage).apply(Morphology.coerce(morphology))
        self.engine: str = resolve_engine("engine", engine)
        self._rng = np.random.default_rng() if rng is None else rng
        # In the compiled engine too the target is computed in double precision: it plays nature.
        self._swim = partial(
            simulate, steps=steps, engine=self.engine, dtype="float64", substeps=substeps
        )
        self._swim(np.zeros(9), np.zeros(3), current=current)  # refuses wrong settings here
        self._current = np.asarray(current, dtype=np.float64)
        self._orientation = orientation
        self._start_angles = np.zeros(3)

    def perform(self, command: Floats) -> ImuLog:
        """Hold a command (3,) from fin angles drawn anew; return the log of that one trial."""
        angles = self._start_angles = self._rng.uniform(-np.pi, np.pi, size=3)
        body = self.morphology.to_array()
        if self._orientation == "upright":
            return self._swim(body, command, angles, current=self._current)
        # From a hash of the angles: they stay the same whatever else is random.
        start = random_orientation(self._orientation, np.random.default_rng(angles.view(np.uint64)))
        water = start.T @ self._current  # as seen from that start
        return turn_log(self._swim(body, command, angles, current=water), start)

    @property
    def start_angles(self) -> Floats:
        """The fins' angles (3,) in rad at which the last command began.

        Hidden from every condition but Ideal; the records note them for analysis.
        """
        return self._start_angles.copy()
