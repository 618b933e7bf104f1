"""Arrays of the compiled closed loop: observation faults, policy memory, task."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aquafish_gym.engines.compiled import episode


class ClosedLoop:
    """The state of policies that observe, and of their task, for B robots.

    Parameters
    ----------
    batch, width, dtype
        B, how many robots share a register, and the type of their numbers.
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

    def __init__(self, batch: int, width: int, dtype: type[np.floating], scratch: int) -> None:
        self.functions: Any = None
        self.task: Any = ()
        self.broken = False
        self._batch = batch
        groups, rows = -(-batch // width), episode.EPISODE_ROWS + scratch
        self._episodes = np.zeros((groups, rows * width), dtype)
        self._view = self._episodes.reshape(groups, rows, width)
        self._noise = np.zeros((groups, 0), dtype)
        self["alive"] = 1.0

    @property
    def program(self) -> tuple[Any, ...]:
        """What the kernel takes of it."""
        return self._episodes, self._noise, self.broken

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return the rows (n, B) of a field; ``episode.EPISODE_FIELDS`` has the names."""
        found = self._view[:, episode.EPISODE_FIELDS[name]].transpose(1, 0, 2)
        return found.reshape(found.shape[0], -1)[:, : self._batch].astype(np.float64)

    def __setitem__(self, name: str, rows: ArrayLike) -> None:
        """Set rows (n, B) of the table; robots that fill up the last register stay as they are."""
        view = self._view[:, episode.EPISODE_FIELDS[name]]
        groups, count, width = view.shape
        table = np.broadcast_to(rows, (count, self._batch))
        whole = self._batch // width
        view[:whole] = table[:, : whole * width].reshape(count, whole, width).transpose(1, 0, 2)
        if whole < groups:
            view[whole, :, : self._batch - whole * width] = table[:, whole * width :]

    def set_noise(self, noise: NDArray[np.float64]) -> None:
        """Set what is added to the gyroscopes in each control step (K, 3, B), rad/s."""
        groups, _, width = self._view.shape
        table = np.zeros((noise.shape[0] * 3, groups * width), self._episodes.dtype)
        table[:, : self._batch] = noise.reshape(-1, self._batch)
        by_group = table.reshape(-1, groups, width).transpose(1, 0, 2)
        self._noise = np.ascontiguousarray(by_group).reshape(groups, -1)
