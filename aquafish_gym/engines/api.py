"""``simulate``: the IMU logs of robots for given commands, on either engine."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.command import check_series
from aquafish_gym.engines.packages import MAXIMUM_THREADS, machine_memory, refuse_threads
from aquafish_gym.engines.packages import check_engine as check_engine
from aquafish_gym.engines.packages import resolve_engine as resolve_engine
from aquafish_gym.imu import ImuLog
from aquafish_gym.plans import PlanLike, check_plan, plan_of
from aquafish_gym.scenario import TIMESTEP as TIMESTEP
from aquafish_gym.scenario import Scenario, broadcast, check_field
from aquafish_gym.utils.validation import InvalidArgumentError, flag, integer, one_of
from aquafish_gym.world_config import MAXIMUM_SUBSTEPS as MAXIMUM_SUBSTEPS

MAXIMUM_STEPS = 1_000_000  # 10,000 s
# How many numbers a sample has, without the fins' angles of a pose.
RECORDS: dict[str, int] = {"rpy": 3, "gyro": 3, "attitude": 6, "pose": 13}


def simulate(
    morphologies: object,
    commands: object,
    fin_angles: object = None,
    steps: int = 512,
    engine: str = "numba",
    dtype: str | None = None,
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
    plan: PlanLike | None = None,
) -> ImuLog:
    """Return what the IMUs of B robots log while they swim.

    Every robot starts at the origin, upright and facing +y, at rest by default, and holds its
    command throughout, or performs a series of commands.

    Parameters
    ----------
    morphologies
        (B, S) sizes in units of 5 cm, or a :class:`Morphology`, or a list of them, or None for
        the nominal body. One body serves for all trials. S is 9 and F is 3 for the paper's robot.
    commands
        (B, F) speeds of the F servos in rev/s or Hz, or (F,) for all. Or series of K commands,
        (B, K, F); each is held for ``interval`` samples, and the last to the end.
    fin_angles
        (B, F) initial angles in rad, or phases of fins that sweep, or (F,) for all. None is 0 for
        each: arms back.
    steps
        Samples of 0.01 s, at most 1,000,000.
    engine
        ``"numba"`` (all robots at once), ``"cuda"`` (the same on a GPU, to the same bits; the
        extra ``gpu``), ``"pybullet"`` (one after another) or ``"auto"`` (PyBullet where it is
        installed).
    dtype
        ``"float32"``, the compiled engines' default, or ``"float64"``, in which PyBullet always
        computes: it refuses the other.
    current
        (3,) or (B, 3) the water's own velocity in the world, units/s, up to 20 each way.
    substeps
        Physics steps a sample.
    threads
        For the engine numba: how many; None takes every core. No result depends on it. Refused
        with the others.
    record
        ``"rpy"``, ``"gyro"``, ``"attitude"`` (both) or ``"pose"`` (these, position, quaternion
        and fin angles). What is not recorded is None in the log.
    reactive
        Whether the water also resists acceleration (added mass of fins and body) and takes momentum
        at the tail's edge; see ``docs/physics.md``. The paper's experiments do without it.
    drag
        (2,) or (B, 2) factors on the drag of the fins and on that of the body, 0 to 10.
    servo_gain
        A number, (F,) or (B, F), -2 to 2: servo speed over command. A seized servo has gain 0, a
        reversed one -1.
    lag
        A number or (B,), 0 to 1 s: the delay from a command to the servos' motion. A servo's speed
        is constant within a sample: in the sample in which a lag ends, it is the mean.
    interval
        How many samples each command of a series is held: 5 for one at 20 Hz. Refused with
        commands that are held throughout.
    begun
        How many samples of the series had passed when the trial began, in mid-swim. Its servos
        turn already then. Refused with PyBullet.
    velocity
        (3,) or (B, 3) velocity at the start, units/s in body axes, up to 20 each way.
    spin
        (3,) or (B, 3) angular velocity at the start, rad/s in body axes, up to 100.
    plan
        The robots' body plan, or its name in ``PLANS``. None is that of the morphologies, else
        the paper's.

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
    plan = check_plan(plan_of(morphologies) if plan is None else plan)
    angles = np.zeros(len(plan.fins)) if fin_angles is None else fin_angles
    tables = {
        "morphologies": check_field("body", morphologies, plan, "morphologies"),
        "commands": check_series(plan, commands),  # type: ignore[arg-type]
        "fin_angles": check_field("fin_angles", angles, plan),
        "current": check_field("current", current, plan),
        "drag": check_field("drag", drag, plan),
        "servo_gain": check_field("servo_gain", servo_gain, plan),
        "lag": check_field("servo_lag", lag, plan, "lag"),
        "velocity": check_field("velocity", velocity, plan),
        "spin": check_field("spin", spin, plan),
    }
    rows = broadcast(tables)
    series = rows.pop("commands")
    rows |= {"body": rows.pop("morphologies"), "servo_lag": rows.pop("lag")}
    return simulate_scenario(
        Scenario.fill(rows, flag("reactive", reactive), plan),
        series, steps, engine, dtype, substeps, threads, record, interval, begun,
    )  # fmt: skip


def simulate_scenario(
    scenario: Scenario,
    commands: NDArray[np.float64],
    steps: int = 512,
    engine: str = "numba",
    dtype: str | None = None,
    substeps: int = 1,
    threads: int | None = None,
    record: str = "attitude",
    interval: int = 1,
    begun: int = 0,
) -> ImuLog:
    """Return what the IMUs of a scenario's B robots log: without the faults of its sensors.

    ``commands`` are (B, F) or (B, K, F), checked; for the rest see :func:`simulate`.
    """
    engine = check_engine(engine, batch=True)
    steps = integer("steps", steps, 1, MAXIMUM_STEPS)
    substeps = integer("substeps", substeps, 1, MAXIMUM_SUBSTEPS)
    if dtype is None:
        dtype = "float64" if engine == "pybullet" else "float32"
    kind = getattr(np, one_of("dtype", dtype, ("float32", "float64")))
    threads = None if threads is None else integer("threads", threads, 1, MAXIMUM_THREADS)
    record = one_of("record", record, RECORDS)
    interval = integer("interval", interval, 1, MAXIMUM_STEPS)
    begun = integer("begun", begun, 0, MAXIMUM_STEPS)
    if interval != 1 and commands.ndim == 2:
        raise InvalidArgumentError(
            "interval must be 1 for commands that are held throughout; for a series commands must "
            f"have shape (B, K, {commands.shape[-1]}); got {interval} with {commands.shape}"
        )
    if engine == "pybullet" and (dtype != "float64" or threads is not None):
        raise InvalidArgumentError(
            f'dtype must be "float64" and threads None for the engine "{engine}", which computes '
            f"in double precision on one thread; got {dtype!r} and {threads}"
        )
    refuse_threads(engine, threads)
    _check_log_fits(scenario, steps, record, kind)
    # The engines are imported here: importing the package stays quick, and works without PyBullet.
    if engine != "pybullet":
        from aquafish_gym.engines.compiled.simulate import simulate_lanes

        return simulate_lanes(
            scenario, commands, steps, kind, substeps, threads, record, interval, begun, engine
        )
    if begun:
        raise InvalidArgumentError(
            f'begun must be 0 for the engine "{engine}", whose fins are still when a trial begins; '
            f'engine="numba" begins in mid-series; got {begun}'
        )
    from aquafish_gym.engines.bullet.simulate import simulate_bullet

    return simulate_bullet(scenario, commands, steps, substeps, record, interval)


def _check_log_fits(scenario: Scenario, steps: int, record: str, dtype: type[np.floating]) -> None:
    """Refuse a log that is larger than this machine's memory: the system might kill the process."""
    batch = len(scenario)
    numbers = RECORDS[record] + len(scenario.plan.fins) * (record == "pose")
    wanted = batch * steps * numbers * np.dtype(dtype).itemsize
    memory = machine_memory()
    if memory is not None and wanted > memory:
        raise InvalidArgumentError(
            f"a log of {steps} steps of {batch} robots would take {wanted / 2**30:,.0f} GiB, and "
            f"this machine has {memory / 2**30:,.0f} GiB of memory; take fewer steps or robots"
        )
