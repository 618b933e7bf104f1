"""Imports: light, and without cycles."""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from importlib import import_module
from pathlib import Path

import grimp
import pytest

PACKAGES = ("aquafish", "aquafish_gym", "eea", "gait")
IN_A_CLONE = ("experiments", "instruments")  # packages that the wheel does not contain
LAZY = ("eea", "eea.fish", "gait")
HEAVY = ("matplotlib", "mujoco", "pybullet", "stable_baselines3", "torch")
# What is installed with the package and the environments do without.
NOT_OF_ENVIRONMENTS = (
    *HEAVY, "PIL", "aquafish_gym.runs", "cma", "neat", "pandas", "rich", "tyro", "viser"
)  # fmt: skip
# Programs and modules that use a heavy library only when they are asked to.
MODULES = (
    "aquafish_gym",
    "aquafish_gym.engines.bullet.world",
    "aquafish_gym.envs.env",
    "eea",
    "eea.__main__",
    "gait",
    "gait.__main__",
    "gait.learning.train",
    "gait.plots",
)


@pytest.mark.parametrize("module", MODULES)
def test_importing_loads_nothing_heavy(module: str) -> None:
    code = f"import sys, {module}; print(*sorted({set(HEAVY)!r} & set(sys.modules)))"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )
    assert result.stdout.split() == []


def test_environments_load_numpy_gymnasium_and_numba_alone() -> None:
    code = f"""
import sys, gymnasium, aquafish_gym
for name in ("AquaFish-v0", "AquaFishRecovery-v0"):
    env = gymnasium.make(name, engine="numba")
    env.reset(seed=0)
    env.step(env.action_space.sample())
gymnasium.make_vec("AquaFish-v0", num_envs=2).reset(seed=0)
print(*sorted({set(NOT_OF_ENVIRONMENTS)!r} & set(sys.modules)))
"""
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=300
    )
    assert result.stdout.split() == []


def stub(package: str) -> list[ast.ImportFrom]:
    """Return the imports in a package's stub, all of which are relative."""
    path = Path(__file__).parents[1] / package.replace(".", "/") / "__init__.pyi"
    return [line for line in ast.parse(path.read_text()).body if isinstance(line, ast.ImportFrom)]


@pytest.mark.parametrize("package", LAZY)
def test_a_stub_has_the_names_that_are_imported_when_first_used(package: str) -> None:
    lazy, names = import_module(package), set()
    for line in stub(package):
        module = import_module(f"{package}.{line.module}")
        found = [alias.name for alias in line.names]
        for name in module.__all__ if found == ["*"] else found:
            assert getattr(lazy, name) is getattr(module, name)
            names.add(name)
    assert sorted(names) == sorted(lazy.__all__)


# An answer makes what is known (``answer.known()``), and what is known an answer: deferred.
VERBS = {"eea.infer.answer": {"eea.infer.known"}}


def test_no_imports_form_a_cycle() -> None:
    """Deferred and type-only imports included but for VERBS; the error names the cycle."""
    graph = grimp.build_graph(*PACKAGES, *IN_A_CLONE, cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    imports = {name: found - VERBS.get(name, set()) for name, found in imports.items()}
    for package in LAZY:  # grimp reads no stubs
        imports[package] = imports[package] | {f"{package}.{line.module}" for line in stub(package)}
    TopologicalSorter(imports).prepare()
