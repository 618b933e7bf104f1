"""Gymnasium's modes in which a batch begins new episodes, also where it has no name for them."""

from __future__ import annotations

from enum import Enum

try:
    from gymnasium.vector import AutoresetMode
except ImportError:  # Gymnasium 1.0, whose own batches know the first mode only

    class AutoresetMode(Enum):  # type: ignore[no-redef]
        """When a robot whose episode is over begins the next one."""

        NEXT_STEP = "NextStep"
        SAME_STEP = "SameStep"
        DISABLED = "Disabled"


__all__ = ["AutoresetMode"]
