"""The examples in the docstrings of aquafish_gym run, and its public classes have one."""

from __future__ import annotations

import doctest
import importlib
import pkgutil

import pytest

import aquafish_gym
import aquafish_gym.envs
import aquafish_gym.rendering

MODULES = [
    module.name
    for module in pkgutil.walk_packages(aquafish_gym.__path__, "aquafish_gym.")
    if not module.name.startswith("aquafish_gym.runs")
]
PUBLIC = [
    getattr(package, name)
    for package in (aquafish_gym, aquafish_gym.envs, aquafish_gym.rendering)
    for name in package.__all__
    if isinstance(getattr(package, name), type)
]


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_run(name: str) -> None:
    failed, _ = doctest.testmod(importlib.import_module(name))
    assert failed == 0


@pytest.mark.parametrize("public", PUBLIC, ids=lambda c: c.__name__)
def test_a_public_class_has_an_example(public: type) -> None:
    assert ">>>" in (public.__doc__ or "")
