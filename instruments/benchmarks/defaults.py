"""The defaults on which measured figures depend, and the commit of a measurement."""

from __future__ import annotations

import inspect
import subprocess
import textwrap
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import aquafish_gym
from aquafish_gym.envs.batching import NUMBA_PRECISION
from aquafish_gym.envs.env import AquaFishEnv
from aquafish_gym.envs.vector import AquaFishVectorEnv
from gait.search.evolve import EvolveConfig

# Arguments that set how much work is done for one unit of a figure.
_WORK: dict[str, tuple[Callable[..., Any], tuple[str, ...]]] = {
    "simulate": (aquafish_gym.simulate, ("substeps",)),
    "AquaFish-v0": (AquaFishEnv, ("frame_skip", "task", "observe_fins", "reactive")),
    "make_vec": (AquaFishVectorEnv, ("frame_skip", "dtype", "task", "observe_fins", "reactive")),
    "EvolveConfig": (EvolveConfig, ("poses",)),
}
# Whose defaults the figures of a group depend on; of the others, those of ``simulate``.
_OF_GROUPS = {
    "environments": ("AquaFish-v0", "make_vec"),
    "resets": ("make_vec",),
    "learning": ("AquaFish-v0", "make_vec"),
    "training": ("AquaFish-v0", "make_vec"),
    "neat": ("EvolveConfig",),
    "tasks": ("AquaFish-v0", "make_vec"),
    "pictures": ("AquaFish-v0",),
}


def work_defaults(groups: Iterable[str]) -> dict[str, Any]:
    """Return the defaults that groups' figures depend on, by names like ``make_vec.dtype``."""
    found: dict[str, Any] = {}
    for group in groups:
        for name in _OF_GROUPS.get(group, ("simulate",)):
            function, arguments = _WORK[name]
            known = inspect.signature(function).parameters
            found |= {f"{name}.{one}": known[one].default for one in arguments}
    if "make_vec.dtype" in found:  # None, by its signature
        found["make_vec.dtype"] = NUMBA_PRECISION
    return found


def say_defaults(groups: Iterable[str]) -> str:
    """Return the sentence that states the present defaults of groups."""
    every = (f"{name}={value!r}" for name, value in work_defaults(groups).items())
    return textwrap.fill(f"Defaults: {', '.join(every)}.", 120)


def present_commit() -> str:
    """Return the checkout's commit, with ``-dirty`` if files differ from it."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=9", "--exclude=*"]
    try:
        done = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return done.stdout.strip()
