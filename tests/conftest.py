"""Tests that need PyBullet are left out where it has no wheel (Python 3.12 and later, macOS)."""

from __future__ import annotations

from collections.abc import Generator
from importlib.util import find_spec

import pytest

from aquafish_gym.utils.validation import EngineUnavailableError


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, None, None]:
    try:
        return (yield)
    except (EngineUnavailableError, ModuleNotFoundError) as error:
        if "pybullet" in str(error) and find_spec("pybullet") is None:
            pytest.skip(f"PyBullet is not installed: {error}")
        raise
