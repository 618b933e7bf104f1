"""The compiled engine's promises: no result depends on lanes, threads, batches or the cache."""

from __future__ import annotations

import importlib
import importlib.util
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import aquafish_gym
from aquafish_gym import simulate
from aquafish_gym.morphology import MAXIMA
from aquafish_gym.physics import compiling, hydrodynamics
from aquafish_gym.utils.validation import InvalidArgumentError
from instruments.verification.trials import lane_batch

Trial = tuple[np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def trials() -> Trial:
    rng = np.random.default_rng(0)
    n = 150
    bodies = rng.uniform(0, 1, (n, 9)) * MAXIMA
    bodies[0], bodies[1] = 0.0, MAXIMA
    commands = rng.uniform([-0.5, -0.5, 0], [0.5, 0.5, 1], (n, 3))
    return bodies, commands, rng.uniform(-np.pi, np.pi, (n, 3))


def test_a_run_in_parts_is_the_run_in_one(trials: Trial) -> None:
    bodies, commands, angles = trials
    whole = lane_batch(bodies, angles).log(commands, 100, "pose")
    parts = lane_batch(bodies, angles)
    logs = [parts.log(commands, n, "pose") for n in (1, 37, 62)]
    assert_array_equal(np.concatenate([log.rpy for log in logs], axis=1), whole.rpy)
    for name in ("gyro", "position", "quaternion"):
        joined = np.concatenate([getattr(log, name) for log in logs], axis=1)
        assert_array_equal(joined, getattr(whole, name))


def test_an_empty_batch_gives_an_empty_log() -> None:
    log = aquafish_gym.simulate(np.empty((0, 9)), np.empty((0, 3)), np.empty((0, 3)), steps=5)
    assert log.rpy.shape == (0, 5, 3)


def test_the_cache_is_tied_to_the_physics_sources(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A change in any physics file gives another stamp; kernels close over it."""
    before = compiling.source_stamp()
    changed = tmp_path / "hydrodynamics.py"
    source = pathlib.Path(str(hydrodynamics.__file__))
    changed.write_text(source.read_text() + "\n# a change\n")
    monkeypatch.setattr(hydrodynamics, "__file__", str(changed))
    assert compiling.source_stamp() != before


@pytest.mark.parametrize("module", ["aquafish_gym.command", "gait.controllers.network"])
def test_the_cache_is_tied_to_all_that_a_policy_imports(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, module: str
) -> None:
    """A network freezes the servos' bounds, which another file states."""
    from aquafish_gym.engines.compiled.kernel import compile_kernel
    from gait.controllers.network import respond

    stamps = compiling.source_stamp(compile_kernel, respond), compiling.source_stamp()
    frozen = sys.modules[module]
    changed = tmp_path / "changed.py"
    changed.write_text(pathlib.Path(str(frozen.__file__)).read_text() + "\n# a change\n")
    monkeypatch.setattr(frozen, "__file__", str(changed))
    assert compiling.source_stamp(compile_kernel, respond) != stamps[0]
    assert compiling.source_stamp() == stamps[1], "the physics itself imports neither"


def test_a_kernel_stays_valid_when_functions_import_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise a kernel is compiled again after a film, or beside PyBullet."""
    from aquafish_gym.engines.compiled.kernel import compile_kernel

    stamp = compiling.source_stamp(compile_kernel)
    lazy = ["aquafish_gym.rendering.caster", "aquafish_gym.engines.compiled.lanes"]
    for module in lazy:
        importlib.import_module(module)
    assert compiling.source_stamp(compile_kernel) == stamp
    for module in lazy:
        monkeypatch.delitem(sys.modules, module)
        assert compiling.source_stamp(compile_kernel) == stamp


def test_a_kernel_is_tied_to_the_constants_that_a_program_has_set(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Otherwise all later programs load a kernel of one program's constants."""
    before = compiling.source_stamp()
    monkeypatch.setattr(hydrodynamics, "NORMAL_DRAG", 1.5)
    assert compiling.source_stamp() != before


@pytest.mark.parametrize(
    "source",
    [
        "LIMIT = {}\ndef f(x): return x + LIMIT",
        "def f(x): return x + {}",
        "def f(x, y={}): return x + y",
        "class Task:\n    @staticmethod\n    def act(x): return x + {}\ndef f(x): return x",
        "def outer(k):\n    def f(x): return x + k\n    return f\nf = outer({})",
    ],
)
def test_a_kernel_is_tied_to_the_sources_that_were_imported(
    tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch, source: str
) -> None:
    """A file may be edited between its import and the first call of a kernel."""
    path = tmp_path / "edited_physics.py"
    path.write_text(source.format("1.25"))
    spec = importlib.util.spec_from_file_location("edited_physics", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "edited_physics", module)
    spec.loader.exec_module(module)
    path.write_text(source.format("2.75"))
    os.utime(path, ns=(0, 0))  # so that no bytecode of the first is taken for the second's
    before = compiling.source_stamp(module.f)
    spec.loader.exec_module(module)
    after = compiling.source_stamp(module.f)
    assert before != after, "a kernel of the imported functions counts as one of the edited file"
    spec.loader.exec_module(module)
    assert compiling.source_stamp(module.f) == after


SCRIPT = """
import numpy as np
from aquafish_gym.engines.compiled import kernel, lanes
from aquafish_gym.physics import compiling
from aquafish_gym.scenario import Scenario
if {stamp!r}:
    compiling.source_stamp = lambda *_: {stamp!r}
    kernel.source_stamp = compiling.source_stamp
used, inner = [], lanes.compile_kernel
lanes.compile_kernel = lambda *a, **k: used.append(inner(*a, **k)) or used[-1]
lanes.LaneBatch(Scenario.create()).advance(np.zeros((1, 3)), 1)
k = used[-1]
print(sum(k.stats.cache_hits.values()), sum(k.stats.cache_misses.values()))
"""


@pytest.mark.slow  # it compiles kernels of its own
def test_a_kernel_of_other_physics_is_not_taken_from_the_cache(tmp_path: pathlib.Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}

    def run(stamp: str) -> str:
        return subprocess.run(
            [sys.executable, "-c", SCRIPT.format(stamp=stamp)],
            env=environment, check=True, capture_output=True, text=True,
        ).stdout.strip()  # fmt: skip

    assert run("") == "0 1", "a first run compiles"
    assert run("") == "1 0", "a second takes it from the cache"
    assert run("other physics") == "0 1", "changed sources compile anew"


def test_a_batch_refuses_commands_for_another_number_of_robots() -> None:
    """They would be read beyond their end."""
    lanes = lane_batch(np.ones((5, 9)) * 0.3, np.zeros((5, 3)))
    for call in (lambda c: lanes.advance(c, 8), lambda c: lanes.spectra(c, 8)):
        with pytest.raises(ValueError, match="commands must be those of 5 robots; got 1"):
            call(np.zeros((1, 3)))


def test_a_log_larger_than_the_memory_is_refused_before_it_is_made() -> None:
    commands = np.broadcast_to((0.1, 0.1, 0.5), (100_000, 3))
    with pytest.raises(InvalidArgumentError, match=r"would take [\d,]+ GiB"):
        simulate(None, commands, steps=10**6, record="pose")
