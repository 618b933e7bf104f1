"""Compiled kernels: when they are compiled anew, where they are kept, and how that ends."""

from __future__ import annotations

import ctypes
import functools
import importlib
import importlib.util
import os
import pathlib
import signal
import subprocess
import sys
import time
import types
import zipfile
from typing import Any

import numba
import pytest
from numba.core import event
from numba.core.caching import IndexDataCacheFile

import aquafish_gym
from aquafish_gym.physics import compiling, hydrodynamics
from aquafish_gym.utils import kernel_cache

ROOT = pathlib.Path(str(aquafish_gym.__file__)).parents[1]
# A kernel that compiles in a moment, and says from where it came.
SMALL = """
from aquafish_gym.physics.compiling import compiled
def double(x):
    return 2 * x
kernel = compiled(double, slow=True)
assert kernel(21) == 42
print(sum(kernel.stats.cache_hits.values()))
"""
# What an installation that was copied, zipped or shared must do without its own folder.
SWIM = """
import gymnasium, aquafish_gym
from aquafish.online.gaits import load_library
from eea.fish.joint import discrepancy_table
assert load_library() and discrepancy_table()
env = gymnasium.make("AquaFish-v0", engine="numba")
env.reset(seed=0)
print(aquafish_gym.__file__, env.step([0.0, 0.0, 0.0])[0].shape)
"""


def python(code: str, **changes: str | None) -> subprocess.CompletedProcess[str]:
    """Run code in a process whose environment has no NUMBA_CACHE_DIR, and is changed."""
    changed = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": None} | changes
    environment = {name: value for name, value in changed.items() if value is not None}
    words = [sys.executable, "-P", *(["-c", code] if "\n" in code else [code])]
    return subprocess.run(words, env=environment, capture_output=True, text=True, check=True)


def compile_small(number: int = 1) -> Any:
    return compiling.compiled(lambda: number)


@pytest.fixture
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path) -> pathlib.Path:
    """Return where this process keeps kernels during a test."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    return tmp_path / "aquafish"


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the variable is Linux's")
def test_kernels_are_kept_in_the_users_cache(tmp_path: pathlib.Path) -> None:
    (tmp_path / "code").mkdir()
    script = tmp_path / "code" / "small.py"
    script.write_text(SMALL)
    cache = str(tmp_path / "cache")
    first, second = (
        python(str(script), XDG_CACHE_HOME=cache, PYTHONDONTWRITEBYTECODE="1") for _ in "ab"
    )
    assert (first.stdout, second.stdout) == ("0\n", "1\n"), "the second process finds the kernel"
    assert first.stderr == f"{compiling.NOTICE}\n"
    assert list((tmp_path / "cache" / "aquafish" / "kernels").glob("*.nbc"))
    assert list((tmp_path / "code").iterdir()) == [script], "nothing is written beside the source"


def test_where_nothing_can_be_kept_every_process_says_what_helps() -> None:
    nowhere = f"{os.devnull}/none"
    done = python(SMALL, HOME=nowhere, XDG_CACHE_HOME=nowhere, LOCALAPPDATA=nowhere)
    assert done.stdout == "0\n"
    assert "once" not in done.stderr
    assert "in every process" in done.stderr
    assert "set NUMBA_CACHE_DIR to a folder that can be written" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
def test_the_packages_swim_from_a_zip(tmp_path: pathlib.Path) -> None:
    """As dask's upload_file, PySpark and zipapp ship them."""
    with zipfile.ZipFile(tmp_path / "fish.zip", "w") as archive:
        for package in ("aquafish", "aquafish_gym", "eea", "gait"):
            for path in sorted((ROOT / package).rglob("*")):
                if path.is_file() and "__pycache__" not in path.parts:
                    archive.write(path, path.relative_to(ROOT))
    kept = {"NUMBA_CACHE_DIR": os.environ.get("NUMBA_CACHE_DIR")}  # the sources are the same
    done = python(SWIM, PYTHONPATH=str(tmp_path / "fish.zip"), **kept)
    assert "fish.zip" in done.stdout
    assert "(9,)" in done.stdout


def test_a_full_disk_costs_the_kernel_in_the_cache_only(
    folder: pathlib.Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(IndexDataCacheFile, "_save_data", fail)
    assert [compile_small(n)() for n in (1, 2)] == [1, 2]
    said = capsys.readouterr().err
    assert said.count("No space left on device") == 1, "said once"
    assert str(folder) in said
    assert "NUMBA_CACHE_DIR" in said


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
@pytest.mark.parametrize("content", [b"", b"\x80\x04nonsense", b"cos\nabort\n."])
def test_a_damaged_kernel_is_compiled_and_written_again(
    folder: pathlib.Path, suffix: str, content: bytes
) -> None:
    assert compile_small()() == 1
    (path,) = folder.glob(f"*.{suffix}")
    path.write_bytes(content)
    assert compile_small()() == 1
    again = compile_small()
    assert again() == 1
    assert again.stats.cache_hits


def test_kernels_of_another_version_of_numba_are_left_alone(
    folder: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for version in ("0.1", "0.2"):
        monkeypatch.setattr(numba, "__version__", version)
        assert compile_small()() == 1
    assert len(list(folder.glob("*.nbc"))) == 2


def test_a_kernel_that_is_used_counts_as_new(folder: pathlib.Path) -> None:
    assert compile_small()() == 1
    for path in folder.iterdir():
        os.utime(path, (1.0, 1.0))
    assert compile_small()() == 1
    assert all(path.stat().st_mtime > time.time() - 60 for path in folder.iterdir())


def test_what_was_not_used_for_the_longest_time_is_removed(tmp_path: pathlib.Path) -> None:
    now = time.time()
    for name, age in {"old": 9e4, "older": 9e5, "recent": 8e3, "new": 0.0}.items():
        path = tmp_path / f"{name}.nbc"
        path.write_bytes(bytes(100))
        os.utime(path, (now - age, now - age))
    kernel_cache.prune(tmp_path, 400)
    assert len(list(tmp_path.iterdir())) == 4
    kernel_cache.prune(tmp_path, 250)
    assert sorted(path.stem for path in tmp_path.iterdir()) == ["new", "recent"]
    kernel_cache.prune(tmp_path, 0)
    assert [path.stem for path in tmp_path.iterdir()] == ["new"], "it may be about to be read"
    kernel_cache.prune(tmp_path / "missing", 0)


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
    from aquafish_gym.plans import AQUAFISH
    from gait.controllers.network import responder

    respond = responder(AQUAFISH)
    stamps = compiling.source_stamp(compile_kernel, respond), compiling.source_stamp()
    key = compile_kernel(AQUAFISH, respond, 2)._cache._cache_file._source_stamp
    assert stamps[0] in key
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


OTHER_PHYSICS = """
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
            [sys.executable, "-c", OTHER_PHYSICS.format(stamp=stamp)],
            env=environment, check=True, capture_output=True, text=True,
        ).stdout.strip()  # fmt: skip

    assert run("") == "0 1", "a first run compiles"
    assert run("") == "1 0", "a second takes it from the cache"
    assert run("other physics") == "0 1", "changed sources compile anew"


NOTICE = f"{compiling.NOTICE}\n"
# Enough robots that the engine takes several threads.
MANY_SWIM = """
import numpy as np, aquafish_gym
aquafish_gym.simulate(np.full((4000, 9), 0.3), (0.1, 0.1, 0.5), steps=512, threads=4)
"""
PREPARE = """
import aquafish_gym, multiprocessing
from aquafish_gym.engines.compiled.kernel import PERFORM, compile_kernel
from aquafish_gym.engines.compiled.lanes import lane_width
from aquafish_gym.plans import AQUAFISH
import numpy as np

def misses(_):
    aquafish_gym.simulate(None, (0.1, 0.1, 0.5), steps=4)
    width = lane_width(np.float32)
    kernel = compile_kernel(AQUAFISH, PERFORM, width, False, None, False, True)
    return sum(kernel.stats.cache_misses.values())

if __name__ == "__main__":
    found = misses(0)
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        print(found, *pool.map(misses, range(2)))
"""


@pytest.fixture
def cold(tmp_path: pathlib.Path) -> dict[str, str]:
    """Return the environment of a process that finds nothing compiled."""
    return {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}


@pytest.mark.slow
def test_ctrl_c_ends_a_cold_compile_within_seconds(cold: dict[str, str]) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", MANY_SWIM], env=cold, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        assert process.stderr.readline() == NOTICE
        time.sleep(2)
        assert process.poll() is None, "it should still compile"
        begun = time.monotonic()
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
        process.wait()
    assert process.returncode == -signal.SIGINT
    assert rest.rstrip().endswith("KeyboardInterrupt")
    assert time.monotonic() - begun < 20  # 2 s on an idle machine; its pool took 40


def test_no_ctrl_c_is_lost_in_llvms_callbacks() -> None:
    """ctypes drops what is raised in a callback, and LLVM makes some while it generates code."""
    dropping = ctypes.CFUNCTYPE(None)(functools.partial(signal.raise_signal, signal.SIGINT))
    compiling._listen()
    usual = sys.unraisablehook
    begun = {"dispatcher": types.SimpleNamespace(py_func=None)}

    def compile_something() -> None:
        with event.trigger_event("numba:compile", begun):
            dropping()
            time.sleep(20.0)

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        compile_something()
    assert time.monotonic() - start < 10  # within the sleep
    assert sys.unraisablehook is usual


@pytest.mark.slow  # it compiles kernels of its own
def test_what_one_process_prepared_its_workers_find(
    cold: dict[str, str], tmp_path: pathlib.Path
) -> None:
    script = tmp_path / "prepare.py"
    script.write_text(PREPARE)
    done = subprocess.run(
        [sys.executable, str(script)], env=cold, capture_output=True, text=True, check=True
    )
    assert done.stdout == "1 0 0\n"
    assert done.stderr == NOTICE, "printed once, and not by the workers"


def test_kernels_that_two_processes_compile_at_once_are_not_mixed_up(
    monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def kernel(number: int) -> Any:
        return compiling.compiled(lambda: number)

    save = IndexDataCacheFile._save_data
    first, second = kernel(1), kernel(2)

    def save_after_second(cache: IndexDataCacheFile, name: str, data: Any) -> None:
        monkeypatch.setattr(IndexDataCacheFile, "_save_data", save)
        assert second() == 2
        save(cache, name, data)

    with monkeypatch.context() as race:  # neither sees what the other has added to an index
        race.setattr(IndexDataCacheFile, "_load_index", lambda _: {})
        race.setattr(IndexDataCacheFile, "_save_data", save_after_second)
        assert first() == 1
    found = [kernel(1), kernel(2)]  # as in a new process
    assert [one() for one in found] == [1, 2]
    assert all(one.stats.cache_hits for one in found)
