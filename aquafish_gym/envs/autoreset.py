"""Gymnasium's modes in which a batch begins new episodes, also where it has no name for them."""

from __future__ import annotations

from enum import Enum

from aquafish_gym.utils.validation import one_of

try:
    from gymnasium.vector import AutoresetMode
except ImportError:  # Gymnasium 1.0, whose own batches know the first mode only

    class AutoresetMode(Enum):  # type: ignore[no-redef]
        """When a robot whose episode is over begins the next one."""

        NEXT_STEP = "NextStep"
        SAME_STEP = "SameStep"
        DISABLED = "Disabled"


__all__ = ["AutoresetMode", "check_mode"]


def check_mode(value: object) -> AutoresetMode:
    """Return a mode, which may be given by its name."""
    name = getattr(value, "value", value)
    return AutoresetMode(one_of("autoreset_mode", name, [mode.value for mode in AutoresetMode]))
