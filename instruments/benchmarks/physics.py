"""Rows of the physics alone: commands held for a whole trial."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from aquafish_gym.engines.api import simulate
from aquafish_gym.scenario import Scenario
from instruments.benchmarks.rows import Group, Row, Settings, missing_pybullet
from instruments.verification.trials import Trials, random_trials

BULLET_ROBOTS = 8
SMALL_BATCHES = (1, 16, 256)


def open_loop(settings: Settings, cleanup: ExitStack) -> Group:
    """Return PyBullet, pushed by our law, and the lanes in both precisions, large and small."""
    trials = random_trials(max(settings.robots, BULLET_ROBOTS), settings.seed)

    def row(what: str, engine: str, dtype: str, robots: int, threads: int, record: str) -> Row:
        few = slice(robots)

        def call() -> object:
            return simulate(
                trials.morphologies[few], trials.commands[few], trials.fin_angles[few],
                steps=settings.steps, engine=engine, dtype=dtype, record=record,
                threads=threads if engine == "numba" else None,
            )  # fmt: skip

        return Row(what, engine, dtype, robots, threads, robots * settings.steps, call)

    notes = missing_pybullet()
    rows: list[Row] = []
    if not notes:
        robots = min(BULLET_ROBOTS, settings.robots)
        # Without a log, since what writes it is ours and in Python: PyBullet at its best.
        alone = _bullet(trials, robots, settings.steps, cleanup)
        rows.append(Row("our law, no log", "pybullet", "float64", robots, 1,
                        robots * settings.steps, alone))  # fmt: skip
        logged = row("attitude", "pybullet", "float64", robots, 1, "attitude")
        rows.append(replace(logged, against=rows[0]))
    bare, logged_too = (rows[0], rows[1]) if rows else (None, None)
    for dtype in ("float32", "float64"):
        silent = Row("our law, no log", "numba", dtype, settings.robots, 1,
                     settings.robots * settings.steps, _lanes(trials, settings, dtype))  # fmt: skip
        rows.append(replace(silent, against=bare))
        for record in ("rpy", "attitude"):
            one = replace(
                row(record, "numba", dtype, settings.robots, 1, record), against=logged_too
            )
            rows.append(one)
            if settings.cores > 1:
                every = row(record, "numba", dtype, settings.robots, settings.cores, record)
                rows.append(replace(every, against=one))
    for robots in SMALL_BATCHES:
        if robots < settings.robots:
            few_of_them = row("attitude", "numba", "float32", robots, 1, "attitude")
            rows.append(replace(few_of_them, against=logged_too))
    return Group("open loop: robot-steps", "robot-step", rows, notes)


def _lanes(trials: Trials, settings: Settings, dtype: str) -> Callable[[], object]:
    """Return what swims a batch without logging anything."""
    from aquafish_gym.engines.compiled.lanes import LaneBatch

    few = slice(settings.robots)
    scenario = Scenario.create(trials.morphologies[few], fin_angles=trials.fin_angles[few])

    def call() -> object:
        lanes = LaneBatch(scenario, getattr(np, dtype), threads=1)
        lanes.advance(trials.commands[few], settings.steps)
        return lanes

    return call


def lane_widths(settings: Settings, cleanup: ExitStack) -> Group:  # noqa: ARG001
    """Return the lanes as they are on machines with narrower registers."""
    from aquafish_gym.engines.compiled.lanes import LaneBatch, lane_width
    from aquafish_gym.engines.compiled.recording import WIDTHS

    trials = random_trials(settings.robots, settings.seed)
    scenario = Scenario.create(trials.morphologies, fin_angles=trials.fin_angles)
    rows: list[Row] = []
    for dtype in (np.float32, np.float64):
        widest = lane_width(dtype)
        reference = None
        for width in sorted((w for w in WIDTHS if w <= widest), reverse=True):

            def call(dtype: type[np.floating] = dtype, width: int = width) -> object:
                lanes = LaneBatch(scenario, dtype, threads=1, width=width)
                return lanes.log(trials.commands, settings.steps, "rpy")

            amount = settings.robots * settings.steps
            name = np.dtype(dtype).name
            row = Row(f"rpy, {width} robots a register", "numba", name, settings.robots, 1,
                      amount, call, against=reference)  # fmt: skip
            reference = reference or row
            rows.append(row)
    return Group("lane widths: robot-steps", "robot-step", rows)


def _bullet(trials: Trials, robots: int, steps: int, cleanup: ExitStack) -> Callable[[], object]:
    """Return what swims some robots in a world, one after another."""
    from aquafish_gym.engines.bullet.world import BulletWorld

    world = BulletWorld()
    cleanup.callback(world.close)
    scenario = Scenario.create(trials.morphologies, fin_angles=trials.fin_angles)
    starts, commands = [scenario.take(i) for i in range(robots)], trials.commands.tolist()

    def call() -> None:
        for robot, command in zip(starts, commands, strict=False):
            world.start(robot)
            world.advance(tuple(command), steps)

    return call
