"""Importing a package stays light: the heavy libraries come when they are used."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("matplotlib", "pybullet", "stable_baselines3", "torch")


@pytest.mark.parametrize("package", ["aquafish_gym", "eea", "gait"])
def test_importing_a_package_loads_nothing_heavy(package: str) -> None:
    code = f"import sys, {package}; print(*sorted({set(HEAVY)!r} & set(sys.modules)))"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert result.stdout.split() == []
