"""One question to every engine: what do these robots feel when they are told these commands?"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from numbers import Real
from pkgutil import resolve_name

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.bodies import body_array
from aquafish_gym.command import check_series
from aquafish_gym.engines.packages import check_engine as check_engine
from aquafish_gym.engines.packages import resolve_engine as resolve_engine
from aquafish_gym.imu import ImuLog
from aquafish_gym.utils.validation import InvalidArgumentError, finite_array, flag, integer, one_of

TIMESTEP = 0.01  # s, Sec. 4; the interval of the IMU's samples
MAXIMUM_CURRENT = 20.0  # units/s: 1 m/s
MAXIMUM_DRAG = 10.0  # times the law's
MAXIMUM_GAIN = 2.0  # either way: a servo that is reversed has -1
MAXIMUM_LAG = 1.0  # s
MAXIMUM_SUBSTEPS = 64
MAXIMUM_THREADS = 1024
MAXIMUM_SPIN = 100.0  # rad/s
MAXIMUM_STEPS = 1_000_000  # 10,000 s
# How many numbers a sample has.
RECORDS: dict[str, int] = {"rpy": 3, "gyro": 3, "attitude": 6, "pose": 16}


@dataclass(frozen=True)
class Trials:
    """B trials: a body, a command and initial fin angles each, and what differs from the model.

    Of the latter there may be one for all; :func:`simulate` says what they are.
    """

    morphologies: NDArray[np.float64]  # (B, 9) sizes in the order of ``DIMENSIONS``
    commands: NDArray[np.float64]  # (B, 3) rev/s, rev/s, Hz, held throughout; or series (B, K, 3)
    fin_angles: NDArray[np.float64]  # (B, 3) left and right pectoral angle, caudal phase, rad
    current: ArrayLike = (0.0, 0.0, 0.0)  # (3,) or (B, 3) units/s
    drag: ArrayLike = (1.0, 1.0)  # (2,) or (B, 2) scales of the fins' and of the body's
    servo_gain: ArrayLike = (1.0, 1.0, 1.0)  # (3,) or (B, 3)
    lag: ArrayLike = 0.0  # () or (B,) s
    velocity: ArrayLike = (0.0, 0.0, 0.0)  # (3,) or (B, 3) units/s, at the beginning
    spin: ArrayLike = (0.0, 0.0, 0.0)  # (3,) or (B, 3) rad/s, at the beginning

    def __len__(self) -> int:
        return len(self.morphologies)


@dataclass(frozen=True)
class Settings:
    """How to simulate: the keywords of :func:`simulate`, which checks them."""

    steps: int
    substeps: int = 1
    dtype: type[np.floating] = np.float32
    threads: int | None = None
    record: str = "attitude"
    reactive: bool = False
    interval: int = 1
    begun: int = 0


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


def check_trials(
    morphologies: object,
    commands: object,
    fin_angles: object,
    current: ArrayLike = (0.0, 0.0, 0.0),
    drag: ArrayLike = (1.0, 1.0),
    servo_gain: object = 1.0,
    lag: ArrayLike = 0.0,
    velocity: ArrayLike = (0.0, 0.0, 0.0),
    spin: ArrayLike = (0.0, 0.0, 0.0),
) -> Trials:
    """Return trials from whatever describes them; a batch of one is spread over the others."""
    gain = [servo_gain] * 3 if isinstance(servo_gain, Real | Decimal) else servo_gain
    rows = {
        "morphologies": body_array(morphologies),  # type: ignore[arg-type]
        "commands": check_series(commands),  # type: ignore[arg-type]
        "fin_angles": _rows("fin_angles", fin_angles, (3,), -np.inf, np.inf, "rad"),
        "current": _rows("current", current, (3,), -MAXIMUM_CURRENT, MAXIMUM_CURRENT, "units/s"),
        "drag": _rows("drag", drag, (2,), 0.0, MAXIMUM_DRAG),
        "servo_gain": _rows("servo_gain", gain, (3,), -MAXIMUM_GAIN, MAXIMUM_GAIN),
        "lag": _rows("lag", lag, (), 0.0, MAXIMUM_LAG, "s"),
        "velocity": _rows("velocity", velocity, (3,), -MAXIMUM_CURRENT, MAXIMUM_CURRENT, "units/s"),
        "spin": _rows("spin", spin, (3,), -MAXIMUM_SPIN, MAXIMUM_SPIN, "rad/s"),
    }
    lengths = {len(table) for table in rows.values()}
    batch = 0 if 0 in lengths else max(lengths)
    if lengths - {1, batch}:
        *most, last = rows
        raise InvalidArgumentError(
            f"{', '.join(most)} and {last} must be equally many, or one for all; "
            f"got {', '.join(str(len(table)) for table in rows.values())}"
        )
    spread = (np.broadcast_to(table, (batch, *table.shape[1:])) for table in rows.values())
    return Trials(*map(np.ascontiguousarray, spread))


def _rows(
    name: str, value: object, row: tuple[int, ...], low: ArrayLike, high: ArrayLike, unit: str = ""
) -> NDArray[np.float64]:
    """Return an argument with a row for each trial; that of one may be given without its axis."""
    return finite_array(name, value, (None, *row), low, high, unit, flat=True)  # type: ignore[arg-type]


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
    drag: ArrayLike = (1.0, 1.0),
    servo_gain: ArrayLike = 1.0,
    lag: ArrayLike = 0.0,
    interval: int = 1,
    begun: int = 0,
    velocity: ArrayLike = (0.0, 0.0, 0.0),
    spin: ArrayLike = (0.0, 0.0, 0.0),
) -> ImuLog:
    """Swim B robots and return what their IMUs log.

    Every robot starts at the origin, upright and facing +y, at rest unless told otherwise, and
    holds its command throughout, or performs a series of commands.

    Parameters
    ----------
    morphologies
        (B, 9) sizes in units of 5 cm, or a :class:`Morphology`, or a list of them, or None for
        the nominal body. One body serves for all trials.
    commands
        (B, 3) servo speeds in rev/s, rev/s, Hz, or (3,) for all. Or series of K commands,
        (B, K, 3), of which each is held for ``interval`` samples, and the last to the end.
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
        (3,) or (B, 3) the water's own velocity in the world, units/s, up to 20 each way.
    substeps
        Physics steps a sample.
    threads
        For the compiled engine: how many; None takes every core. No result depends on it.
    record
        ``"rpy"``, ``"gyro"``, ``"attitude"`` (both) or ``"pose"`` (these, position, quaternion
        and fin angles). What is not recorded is None in the log.
    reactive
        Whether the water also resists acceleration (added mass of fins and body) and leaves the
        tail's edge with momentum; see ``docs/physics.md``. The paper's experiments need it not.
    drag
        (2,) or (B, 2) what the drag of the fins, and that of the body, is multiplied by: 0 to 10.
    servo_gain
        A number, (3,) or (B, 3), -2 to 2: the servos' speeds are gain times command. One that is
        seized has gain 0, one that is reversed -1.
    lag
        A number or (B,), 0 to 1 s: the servos begin to move so late. A servo's speed is steady
        within a sample: in the one in which a lag ends it is the share of it that then remains.
    interval
        How many samples each command of a series is held: 5 for one at 20 Hz.
    begun
        For the compiled engine, as the two that follow: how many samples of the series had passed
        when the trial began, in mid-swim. Its servos turn already then.
    velocity
        (3,) or (B, 3) the robot's at the beginning, units/s in body axes, up to 20 each way.
    spin
        (3,) or (B, 3) its angular velocity at the beginning, rad/s in body axes, up to 100.

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
    >>> simulate(None, (0.4, 0.4, 0.5), steps=100, servo_gain=(1, 0, 1), record="gyro")
    ImuLog(B=1, T=100: gyro)
    """
    engine = resolve_engine("engine", engine)
    answer = find_engine(engine)
    trials = check_trials(
        morphologies, commands, fin_angles, current, drag, servo_gain, lag, velocity, spin
    )
    settings = Settings(
        steps=integer("steps", steps, 1, MAXIMUM_STEPS),
        substeps=integer("substeps", substeps, 1, MAXIMUM_SUBSTEPS),
        dtype=getattr(np, one_of("dtype", dtype, ("float32", "float64"))),
        threads=None if threads is None else integer("threads", threads, 1, MAXIMUM_THREADS),
        record=one_of("record", record, RECORDS),
        reactive=flag("reactive", reactive),
        interval=integer("interval", interval, 1, MAXIMUM_STEPS),
        begun=integer("begun", begun, 0, MAXIMUM_STEPS),
    )
    if engine != "numba" and (settings.begun or np.any(trials.velocity) or np.any(trials.spin)):
        raise InvalidArgumentError(
            f'begun, velocity and spin must be 0 for the engine "{engine}", whose trials begin at '
            'rest; engine="numba" begins in mid-swim'
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
    if engine != "numba":  # the others keep everything, in double precision, until the end
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
