"""Lanes of which each robot that diverges leaves a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from aquafish_gym.engines.compiled.lanes import LaneBatch, Selection
from aquafish_gym.engines.divergence import Recording
from aquafish_gym.engines.worlds import diverged_states
from aquafish_gym.scenario import Scenario
from aquafish_gym.utils.array_types import Floats


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

    def advance(
        self, command: Floats, steps: int = 1, after: Callable[[int, int], None] | None = None
    ) -> None:
        self._recording.note(self.states, command, steps)
        super().advance(command, steps, after)
        self._recording.judge(diverged_states(self.states))
