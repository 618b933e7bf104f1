"""Lanes of which each robot that diverges leaves a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aquafish_gym.command import servo_speeds
from aquafish_gym.engines.compiled.lanes import LaneBatch, Selection
from aquafish_gym.engines.divergence import Recording
from aquafish_gym.physics.arithmetic import Vector
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Flags, Floats, Observations


class RecordedLanes(LaneBatch):
    """Robots without a lag; see :mod:`aquafish_gym.engines.divergence`."""

    def __init__(
        self, scenario: Scenario, dtype: type[np.floating], threads: int | None, folder: Path
    ) -> None:
        super().__init__(scenario, dtype, threads=threads)
        self._recording = Recording(folder, "numba", dtype, self.substeps, resumes=True)
        self._recording.start(scenario)

    def start(self, scenario: Scenario, rows: Selection | None = None) -> None:
        super().start(scenario, rows)
        everyone = np.arange(self.batch)
        self._recording.start(scenario, everyone if rows is None else everyone[rows])

    def update(
        self, scenario: Scenario, rows: Selection | None = None, keep_current: bool = False
    ) -> None:
        super().update(scenario, rows, keep_current)
        everyone = np.arange(self.batch)
        self._recording.update(scenario, everyone if rows is None else everyone[rows])

    def set_current(self, current: Floats) -> None:
        super().set_current(current)
        self._recording.set_current(current)

    def act(
        self,
        action: Floats,
        followed: Vector,
        steps: int = 1,
        task: Any = None,
        memory: Floats | None = None,
    ) -> tuple[Flags, Observations, Floats | None]:
        self._recording.note(self.states, np.transpose(servo_speeds(followed)), steps)
        found = super().act(action, followed, steps, task, memory)
        self._recording.judge(found[0])
        return found
