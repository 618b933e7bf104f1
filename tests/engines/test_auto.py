"""The engine "auto": PyBullet where it is installed, else the compiled one."""

from __future__ import annotations

import subprocess
import sys

import pytest

from aquafish_gym.engines.api import check_engine, resolve_engine

# As if PyBullet were not installed.
WITHOUT = "import sys; sys.modules['pybullet'] = None\n"


def run(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)


@pytest.mark.pybullet
def test_pybullet_is_taken_where_it_is() -> None:
    assert resolve_engine("engine", "auto") == check_engine("auto") == "pybullet"


def test_without_pybullet_the_compiled_one_is_taken() -> None:
    code = (
        "import gymnasium as gym, aquafish_gym\n"
        "from aquafish_gym.engines.api import check_engine, resolve_engine\n"
        "env = gym.make('AquaFish-v0')\n"
        "env.reset(seed=1), env.step(env.action_space.sample())\n"
        "print(check_engine('auto'), resolve_engine('target_engine', 'auto'))"
    )
    done = run(WITHOUT + code)
    assert done.stdout == "numba numba\n"
