"""Importing a package stays light: the heavy libraries come when they are used."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("matplotlib", "mujoco", "pybullet", "stable_baselines3", "torch")


# Programs and modules that use a heavy library only when they are asked to.
MODULES = (
    "aquafish_gym",
    "aquafish_gym.engines.bullet.world",
    "aquafish_gym.envs.env",
    "eea",
    "eea.__main__",
    "gait",
    "gait.__main__",
    "gait.learning",
    "gait.plots",
)


@pytest.mark.parametrize("module", MODULES)
def test_importing_loads_nothing_heavy(module: str) -> None:
    code = f"import sys, {module}; print(*sorted({set(HEAVY)!r} & set(sys.modules)))"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert result.stdout.split() == []
