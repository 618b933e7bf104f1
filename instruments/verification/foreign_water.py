"""The same robot in MuJoCo's water: how far from ours it takes the robot, and which term does it.

Nothing here should agree. MuJoCo's ellipsoid model is a world whose physics nobody here wrote, and
these are its distances from ours.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP, simulate
from aquafish_gym.morphology import Morphology
from aquafish_gym.scenario import Scenario
from instruments.verification.convergence import attitude_gap
from instruments.verification.mujoco_world import STEPS, MujocoWorld
from instruments.verification.tables import Report, Table
from instruments.verification.trials import Trials

Array = NDArray[np.float64]

SECONDS = 2.56  # of a trial; the tails beat for longer
BEATING = 10.0
FINER = (1, 2)  # what MuJoCo's step is divided by, against this:
FINEST = 8
THIN = 0.05  # the thin tail's thickness; its other sizes are the nominal ones
# What is left out of MuJoCo's water, by the columns of its ``geom_fluid``.
OURS, REACTIVE, WHOLE = "ours", "ours, reactive", "MuJoCo's"
WITHOUT: dict[str, slice] = {
    WHOLE: slice(0, 0),
    "without added mass": slice(6, 12),
    "without Kutta's lift": slice(4, 5),
    "without Magnus' lift": slice(5, 6),
    "without angular drag": slice(3, 4),
    "without slender drag": slice(2, 3),
}


def swim_there(
    body: Array,
    command: Array,
    angles: Array,
    seconds: float,
    substeps: int = 1,
    without: slice = WITHOUT[WHOLE],
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Return gyro (T, 3), quaternion (T, 4) and last position (3,) of one robot in MuJoCo."""
    world = MujocoWorld(substeps=substeps)
    world.start(Scenario.create(body, fin_angles=angles))
    world.model.geom_fluid[:, without] = 0.0
    one, other, tail = command.tolist()
    states = []
    for _ in range(round(seconds / TIMESTEP)):
        world.advance((one, other, tail))
        states.append(world.state())
    gyro, turned = (np.array([s[i] for s in states]) for i in (3, 0))
    return gyro, turned, np.array(states[-1].position)


def beating_tails() -> tuple[Array, Array]:
    """Return the nominal body and that with a thin tail (2, 9), and a command, 1 Hz."""
    bodies = np.tile(Morphology.nominal().to_array(), (2, 1))
    bodies[1, 6] = THIN
    return bodies, np.array([0.0, 0.0, 1.0])


def study(trials: Trials, seconds: float = SECONDS, beating: float = BEATING) -> Iterator[Report]:
    """Yield a row a water: what it makes of the same trials, against our water."""
    bodies, beat = beating_tails()

    def ours(reactive: bool) -> tuple[Array, Array, Array]:
        swim = partial(simulate, dtype="float64", record="pose", reactive=reactive)
        steps = round(seconds / TIMESTEP)
        log = swim(trials.morphologies, trials.commands, trials.fin_angles, steps)
        far = swim(bodies, beat, steps=round(beating / TIMESTEP))
        gyro, turned = (np.asarray(found, np.float64) for found in (log.gyro, log.quaternion))
        assert far.position is not None
        return gyro, turned, far.position[:, -1, 1].astype(np.float64)

    reference = ours(False)
    yield _row(OURS, reference, reference)
    yield _row(REACTIVE, ours(True), reference)
    for name, without in WITHOUT.items():
        logs = [
            swim_there(body, command, angles, seconds, without=without)
            for body, command, angles in zip(
                trials.morphologies, trials.commands, trials.fin_angles, strict=True
            )
        ]
        far = [swim_there(b, beat, np.zeros(3), beating, without=without)[2][1] for b in bodies]
        gyro, turned = (np.array([log[i] for log in logs]) for i in (0, 1))
        yield _row(name, (gyro, turned, np.array(far)), reference)


def _row(
    name: str, found: tuple[Array, Array, Array], reference: tuple[Array, Array, Array]
) -> Report:
    (gyro, turned, far), (our_gyro, our_turned, _) = found, reference
    flat, ours = (g.reshape(len(g), -1) for g in (gyro, our_gyro))
    ratios = np.linalg.norm(flat, axis=1) / np.linalg.norm(ours, axis=1)
    alike = [np.corrcoef(a, b)[0, 1] for a, b in zip(flat, ours, strict=True)]
    gaps = np.linalg.norm(flat - ours, axis=1) / np.linalg.norm(ours, axis=1)
    return {
        "water": name,
        "strength": {"median": float(np.median(ratios)), "least": float(ratios.min()),
                     "greatest": float(ratios.max())},
        "correlation": float(np.median(alike)),
        "gap": float(np.median(gaps)),
        "attitude": float(np.median(attitude_gap(turned[:, -1], our_turned[:, -1]))),
        "tails": far.tolist(),
    }  # fmt: skip


def convergence(trials: Trials, robots: int, seconds: float = SECONDS) -> Iterator[list[float]]:
    """Yield, for the first robots, the largest error of the gyro (rad/s) at each of ``FINER``."""
    each_trial = zip(trials.morphologies, trials.commands, trials.fin_angles, strict=True)
    for each in islice(each_trial, robots):
        limit = swim_there(*each, seconds, FINEST)[0]
        paths = [swim_there(*each, seconds, finer)[0] for finer in FINER]
        yield [float(np.linalg.norm(path - limit, axis=1).max()) for path in paths]


def step_rows(gaps: Sequence[Sequence[float]]) -> list[Report]:
    """Return what :func:`convergence` found, by MuJoCo's step."""
    return [
        {
            "step": TIMESTEP / (STEPS * finer),
            "robots": len(gaps),
            "median": float(np.median(gap)),
            "maximum": max(gap),
        }
        for finer, gap in zip(FINER, zip(*gaps, strict=True), strict=True)
    ]


def water_table(report: Report) -> Table:
    """Return the waters against ours."""
    return Table(
        f"the same {report['robots']} trials of {report['seconds']:g} s in other waters: medians "
        f"(least, greatest), and how far a tail of 1 Hz swims in {report['beating']:g} s",
        ("water", "gyro, of ours", "correlation", "gap", "attitude (rad)", "nominal tail", "thin"),
        [
            (r["water"], "{median:.2f} ({least:.2f}, {greatest:.2f})".format(**r["strength"]),
             f"{r['correlation']:.2f}", f"{r['gap']:.2f}", f"{r['attitude']:.2f}",
             *(f"{far + 0.0:+.1f}" for far in r["tails"]))
            for r in report["rows"]
        ],
    )  # fmt: skip


def steps_table(report: Report) -> Table:
    """Return the error of MuJoCo's gyro at each step."""
    return Table(
        f"MuJoCo's gyro (rad/s) against that of a step of {TIMESTEP / (STEPS * FINEST):g} s",
        ("step (s)", "median", "maximum"),
        [(f"{r['step']:g}", f"{r['median']:.1e}", f"{r['maximum']:.1e}") for r in report["steps"]],
    )


def make_tables(report: Report) -> dict[str, Table]:
    """Return every table of the study."""
    return {"foreign_water": water_table(report), "foreign_steps": steps_table(report)}
