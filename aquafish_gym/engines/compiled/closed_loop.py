"""Arrays of the compiled closed loop: observation faults, policy memory, task."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.compiled import episode
from aquafish_gym.utils.array_types import Observations, Reals


class ClosedLoop:
    """The state of policies that observe, and of their task, for B robots.

    Parameters
    ----------
    batch, fins, width, dtype
        B, how many fins a robot has, how many robots share a register, and the type of numbers.
    scratch
        How many numbers a robot the policy may ``put``.

    Attributes
    ----------
    functions, task
        A task's functions and a named tuple of its numbers (``envs.tasks.compiled_task``); None
        where there is no task, or where it is judged outside.
    broken
        Whether any sensor is faulty.
    """

    def __init__(
        self, batch: int, fins: int, width: int, dtype: type[np.floating], scratch: int
    ) -> None:
        self.functions: Any = None
        self.task: Any = ()
        self.broken = False
        self._batch = batch
        self._width = width
        self._fields = episode.episode_fields(fins)
        groups, rows = -(-batch // width), self._fields["action"].stop + scratch
        self._episodes = np.zeros((groups, rows * width), dtype)
        self._noise = np.zeros((groups, 0), dtype)
        self["alive"] = 1.0

    @property
    def program(self) -> tuple[Any, ...]:
        """What the kernel takes of it."""
        return self._episodes, self._noise, self.broken

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return the rows (n, B) of a field; ``episode.episode_fields`` has the names."""
        found = self._view(name).transpose(1, 0, 2)
        return found.reshape(found.shape[0], -1)[:, : self._batch].astype(np.float64)

    def __setitem__(self, name: str, rows: ArrayLike) -> None:
        """Set rows (n, B) of the table; robots that fill up the last register stay as they are."""
        view = self._view(name)
        groups, count, width = view.shape
        table = np.broadcast_to(rows, (count, self._batch))
        full = self._batch // width
        view[:full] = table[:, : full * width].reshape(count, full, width).transpose(1, 0, 2)
        if full < groups:
            view[full, :, : self._batch - full * width] = table[:, full * width :]

    def _view(self, name: str) -> Reals:
        """View a field as (groups, n, width); a copy of this object has views of its own."""
        table = self._episodes.reshape(len(self._episodes), -1, self._width)
        return table[:, self._fields[name]]

    def observed(self) -> Observations:
        """Return what the sensors observed last, (B, 9)."""
        rows = self._view("observed").transpose(0, 2, 1)
        found: Observations = np.empty(rows.shape, np.float32)
        found[:] = rows
        return found.reshape(-1, episode.OBSERVED_CHANNELS)[: self._batch]

    def set_memory(self, memory: NDArray[np.float64]) -> None:
        """Set what a task remembers (M, B); the numbers that it does not use are 0."""
        table = np.zeros((episode.MEMORY_NUMBERS, self._batch))
        table[: len(memory)] = memory
        self["memory"] = table

    def set_noise(self, noise: NDArray[np.float64]) -> None:
        """Set what is added to the gyroscopes in each control step (K, 3, B), rad/s."""
        groups, width = len(self._episodes), self._width
        table = np.zeros((noise.shape[0] * 3, groups * width), self._episodes.dtype)
        table[:, : self._batch] = noise.reshape(-1, self._batch)
        by_group = table.reshape(-1, groups, width).transpose(1, 0, 2)
        self._noise = np.ascontiguousarray(by_group).reshape(groups, -1)
