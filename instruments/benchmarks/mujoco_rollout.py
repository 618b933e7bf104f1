"""Rows of many different bodies at once, beside MuJoCo's own way of doing that.

MuJoCo has no drag law of ours. It is given its own cheapest water, the inertia-box model, which
takes each body for one box: less work than our strips. There are no contacts, no gravity and no
geometry to draw, and both write down each robot's whole pose at every step.
"""

from __future__ import annotations

from contextlib import ExitStack
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aquafish_gym.engines.api import TIMESTEP, simulate
from aquafish_gym.morphology import Morphology
from aquafish_gym.physics.arithmetic import TAU
from instruments.benchmarks.rows import Group, Row, Settings, missing_mujoco
from instruments.verification.mujoco_model import hinge_angles, load_mujoco, mujoco_model
from instruments.verification.trials import Trials, random_trials

BODIES = 256
WATER = 1.0  # density, in the robot's units


def against_mujoco(settings: Settings, cleanup: ExitStack) -> Group:
    """Return ``mujoco.rollout`` and the lanes on the same bodies, commands and steps."""
    count = min(BODIES, settings.robots)
    trials, amount = random_trials(count, settings.seed), count * settings.steps
    rows: list[Row] = []
    notes = missing_mujoco()
    several = sorted({1, settings.cores})
    peers: dict[int, Row] = {}  # by threads
    if not notes:
        wet = [("rollout, box fluid", WATER, threads) for threads in several]
        for what, density, threads in [*wet, ("rollout, no fluid", 0.0, 1)]:
            work = Rollout(trials, settings.steps, density, threads, cleanup)
            row = Row(what, "mujoco", "float64", count, threads, amount, work.run, peers.get(1))
            rows.append(row)
            if density:
                peers[threads] = row
            if work.broken_off:
                notes.append(f"MuJoCo broke off {work.broken_off} of {count} robots: {what}")
    for dtype in ("float32", "float64"):
        for threads in several:

            def call(dtype: str = dtype, threads: int = threads) -> object:
                return simulate(
                    trials.morphologies, trials.commands, trials.fin_angles,
                    steps=settings.steps, dtype=dtype, threads=threads, record="pose",
                )  # fmt: skip

            rows.append(Row("our law, pose", "numba", dtype, count, threads, amount, call,
                            peers.get(threads)))  # fmt: skip
    return Group(f"{count} bodies: robot-steps", "robot-step", rows, notes)


class Rollout:
    """``mujoco.rollout`` of B different bodies under prescribed servo speeds.

    Parameters
    ----------
    trials
        The bodies, commands and starting fin angles.
    steps
        Of 0.01 s.
    density
        Of the fluid, in the robot's units; 0 for none.
    threads
        How many.
    cleanup
        Stops the threads.

    Attributes
    ----------
    broken_off
        How many robots MuJoCo stopped simulating, because it warned of them.
    """

    def __init__(
        self, trials: Trials, steps: int, density: float, threads: int, cleanup: ExitStack
    ) -> None:
        mujoco = load_mujoco()
        self._models = [
            mujoco_model(Morphology.from_array(b), TIMESTEP) for b in trials.morphologies
        ]
        for model in self._models:
            model.opt.density = density
        self._data = [mujoco.MjData(self._models[0]) for _ in range(threads)]
        turned = TAU * trials.commands[:, None] * TIMESTEP * np.arange(1, steps + 1)[:, None]
        self._control = hinge_angles(trials.fin_angles[:, None] + turned)
        # A pool of one would run beside the caller, who waits: none at all is what MuJoCo means
        # by one thread.
        self._rollout = import_module("mujoco.rollout").Rollout(
            nthread=threads if threads > 1 else None
        )
        cleanup.callback(self._rollout.close)
        self._start = self._starting_states(mujoco, trials)
        times = self.run()[:, -1, 0]
        self.broken_off = int((times < (steps - 0.5) * TIMESTEP).sum())

    def _starting_states(self, mujoco: Any, trials: Trials) -> NDArray[np.float64]:
        """Return (B, S) states at rest."""
        everything = mujoco.mjtState.mjSTATE_FULLPHYSICS
        model, data = self._models[0], self._data[0]
        states = np.empty((len(trials.commands), mujoco.mj_stateSize(model, everything)))
        for state, angles in zip(states, hinge_angles(trials.fin_angles), strict=True):
            mujoco.mj_resetData(model, data)
            data.qpos[-3:] = angles
            mujoco.mj_getState(model, data, state, everything)
        return states

    def run(self) -> NDArray[np.float64]:
        """Return the states (B, T, 20): time, positions and velocities."""
        states: NDArray[np.float64]
        states, _ = self._rollout.rollout(self._models, self._data, self._start, self._control)
        return states
