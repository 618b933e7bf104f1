"""One question to every engine: what do these robots feel when they are told these commands?"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pkgutil import resolve_name

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import check_commands
from aquafish_gym.engines.packages import check_engine as check_engine
from aquafish_gym.engines.packages import resolve_engine as resolve_engine
from aquafish_gym.imu import ImuLog
from aquafish_gym.morphology import MAXIMA, Morphology
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, flag, integer, one_of

TIMESTEP = 0.01  # s, Sec. 4; the interval of the IMU's samples
MAXIMUM_CURRENT = 20.0  # units/s: 1 m/s
MAXIMUM_SUBSTEPS = 64
MAXIMUM_THREADS = 1024
MAXIMUM_STEPS = 1_000_000  # 10,000 s
# How many numbers a sample has.
RECORDS: dict[str, int] = {"rpy": 3, "attitude": 6, "pose": 16}


@dataclass(frozen=True)
class Trials:
    """B trials: a body, a command and initial fin angles each."""

    morphologies: NDArray[np.float64]  # (B, 9) sizes in the order of ``DIMENSIONS``
    commands: NDArray[np.float64]  # (B, 3) rev/s, rev/s, Hz; held for the whole trial
    fin_angles: NDArray[np.float64]  # (B, 3) left and right pectoral angle, caudal phase, rad

    def __len__(self) -> int:
        return len(self.morphologies)


@dataclass(frozen=True)
class Settings:
    """How to simulate: the keywords of :func:`simulate`, which checks them."""

    steps: int
    substeps: int = 1
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    dtype: type[np.floating] = np.float32
    threads: int | None = None
    record: str = "attitude"
    reactive: bool = False


# Whatever turns trials into logs. It trusts its caller; :func:`simulate` is the checked door.
Engine = Callable[[Trials, Settings], ImuLog]

# Loaded when first asked for: importing the package stays quick, and works without them.
ENGINES: dict[str, str] = {
    "numba": "aquafish_gym.engines.compiled.lanes:simulate_lanes",
    "pybullet": "aquafish_gym.engines.bullet.world:simulate_bullet",
}


def find_engine(name: str) -> Engine:
    """Return an engine by name, if it can be used here; see :func:`check_engine`."""
    found: Engine = resolve_name(ENGINES[check_engine(name)])
    return found


def check_trials(morphologies: object, commands: object, fin_angles: object) -> Trials:
    """Return trials from whatever describes them; a batch of one is spread over the others."""
    if morphologies is None or isinstance(morphologies, Morphology | dict):
        morphologies = Morphology.coerce(morphologies).to_array()
    elif isinstance(morphologies, list | tuple) and any(
        isinstance(m, Morphology) for m in morphologies
    ):
        morphologies = [Morphology.coerce(m).to_array() for m in morphologies]
    bodies = finite_array("morphologies", morphologies, (None, 9), 0.0, MAXIMA, flat=True)  # type: ignore[arg-type]
    speeds = check_commands(commands)  # type: ignore[arg-type]
    angles = finite_array("fin_angles", fin_angles, (None, 3), unit="rad", flat=True)  # type: ignore[arg-type]
    lengths = {len(bodies), len(speeds), len(angles)}
    batch = 0 if 0 in lengths else max(lengths)
    if lengths - {1, batch}:
        raise InvalidArgumentError(
            "morphologies, commands and fin_angles must be equally many, or one for all; "
            f"got {len(bodies)}, {len(speeds)} and {len(angles)}"
        )
    spread = (np.broadcast_to(a, (batch, a.shape[1])) for a in (bodies, speeds, angles))
    return Trials(*map(np.ascontiguousarray, spread))


def simulate(
    morphologies: object,
    commands: object,
    fin_angles: object = (0.0, 0.0, 0.0),
    steps: int = 512,
    engine: str = "numba",
    dtype: str = "float32",
    current: ArrayLike = (0.0, 0.0, 0.0),
    substeps: int = 1,
    threads: int | None = None,
    record: str = "attitude",
    reactive: bool = False,
) -> ImuLog:
    """Swim B robots from rest and return what their IMUs log.

    Every robot starts at the origin, upright and facing +y, and holds its command throughout.

    Parameters
    ----------
    morphologies
        (B, 9) sizes in units of 5 cm, or a :class:`Morphology`, or a list of them, or None for
        the nominal body. One body serves for all trials.
    commands
        (B, 3) servo speeds in rev/s, rev/s, Hz, or (3,) for all.
    fin_angles
        (B, 3) initial left and right pectoral angle and caudal phase in rad, or (3,) for all;
        zero is arms back.
    steps
        Samples of 0.01 s, at most 1,000,000.
    engine
        ``"numba"`` (all robots at once), ``"pybullet"`` (one after another) or ``"auto"``
        (PyBullet where it is installed).
    dtype
        ``"float32"`` or ``"float64"``, for the compiled engine; PyBullet always computes in
        double precision.
    current
        (3,) the water's own velocity in the world, units/s.
    substeps
        Physics steps a sample.
    threads
        For the compiled engine: how many; None takes every core. No result depends on it.
    record
        ``"rpy"``, ``"attitude"`` (rpy and gyro) or ``"pose"`` (these, position,
        quaternion and fin angles).
    reactive
        Whether the water also resists acceleration (added mass of fins and body) and leaves the
        tail's edge with momentum; see ``docs/physics.md``. The paper's experiments need it not.

    Returns
    -------
    ImuLog
        Samples taken after each step.

    Raises
    ------
    InvalidArgumentError, UnknownNameError
        The message names the argument, what was expected and what came.
    EngineUnavailableError
        If the engine's package is missing.

    Examples
    --------
    >>> log = simulate(None, (0.4, 0.4, 0.5), steps=100)
    >>> log.rpy.shape
    (1, 100, 3)
    """
    engine = resolve_engine("engine", engine)
    answer = find_engine(engine)
    trials = check_trials(morphologies, commands, fin_angles)
    water = finite_array("current", current, (3,), -MAXIMUM_CURRENT, MAXIMUM_CURRENT, "units/s")
    settings = Settings(
        steps=integer("steps", steps, 1, MAXIMUM_STEPS),
        substeps=integer("substeps", substeps, 1, MAXIMUM_SUBSTEPS),
        current=(float(water[0]), float(water[1]), float(water[2])),
        dtype=getattr(np, one_of("dtype", dtype, ("float32", "float64"))),
        threads=None if threads is None else integer("threads", threads, 1, MAXIMUM_THREADS),
        record=one_of("record", record, RECORDS),
        reactive=flag("reactive", reactive),
    )
    _check_log_fits(len(trials), settings, engine)
    return answer(trials, settings)


def available_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1  # macOS and Windows bind no process to cores


def _check_log_fits(batch: int, settings: Settings, engine: str) -> None:
    """Refuse a log that is larger than this machine's memory."""
    sample = RECORDS[settings.record] * np.dtype(settings.dtype).itemsize
    if engine == "pybullet":  # keeps everything, in double precision, until the end
        sample = RECORDS["pose"] * 8
    wanted = batch * settings.steps * sample
    try:
        memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # this system does not say
        return
    if wanted > memory:
        raise InvalidArgumentError(
            f"a log of {settings.steps} steps of {batch} robots would take {wanted / 2**30:,.0f} "
            f"GiB, and this machine has {memory / 2**30:,.0f} GiB of memory; take fewer steps or "
            'robots at a time, or record="rpy"'
        )
