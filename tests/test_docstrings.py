"""Every example in a docstring runs, and every public class has one."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

PACKAGES = ("aquafish_gym", "eea", "gait", "aquafish")
ROOMS = (
    "aquafish_gym",
    "aquafish_gym.envs",
    "aquafish_gym.rendering",
    "eea",
    "eea.core",
    "gait",
)
# What can only be imported with a heavy extra.
NEEDS_EXTRAS = ("gait.learning.sb3_env",)


def modules(package: str) -> list[str]:
    root = importlib.import_module(package)
    found = [m.name for m in pkgutil.walk_packages(root.__path__, f"{package}.")]
    return [package, *(name for name in found if not name.endswith("__main__"))]


def has_examples(name: str) -> bool:
    """Return whether a module's source has examples that are not skipped."""
    found = find_spec(name)
    assert found is not None
    lines = Path(str(found.origin)).read_text(encoding="utf-8").splitlines()
    return any(">>> " in line and "+SKIP" not in line for line in lines)


NAMES = [
    name
    for package in PACKAGES
    for name in modules(package)
    if name not in NEEDS_EXTRAS and has_examples(name)
]


#: Nightly: their examples take seconds.
LONG = ("aquafish.online.agent", "eea.fish.log_checks")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n in LONG else ()) for n in NAMES]
)
def test_examples_run(name: str, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(name)
    with np.printoptions(legacy=False):
        failed, tried = doctest.testmod(
            module, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
        )
    assert not failed
    assert tried


def public_classes(module: ModuleType) -> list[type]:
    named = (getattr(module, name) for name in module.__all__)
    return [one for one in named if inspect.isclass(one)]


@pytest.mark.parametrize("package", ROOMS)
def test_every_public_class_has_an_example(package: str) -> None:
    without = [
        one.__name__
        for one in public_classes(importlib.import_module(package))
        # Protocols and dictionaries of options are made by others; a run makes records, beliefs.
        if not issubclass(one, Exception | dict)
        and not getattr(one, "_is_protocol", False)
        and one.__name__ not in ("RoundRecord", "Answer")
        and ">>>" not in (one.__doc__ or "")
    ]
    assert not without
