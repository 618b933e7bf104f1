"""Compiled kernels are kept in the user's cache, never in the installation."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
import time
import zipfile
from typing import Any

import numba
import pytest
from numba.core.caching import IndexDataCacheFile

import aquafish_gym
from aquafish_gym.physics import compiling
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


@pytest.mark.parametrize(
    ("name", "place"), [("XDG_CACHE_HOME", "aquafish/kernels"), ("NUMBA_CACHE_DIR", "aquafish")]
)
@pytest.mark.skipif(sys.platform != "linux", reason="the variable is Linux's")
def test_kernels_are_kept_in_the_users_cache(tmp_path: pathlib.Path, name: str, place: str) -> None:
    (tmp_path / "code").mkdir()
    script = tmp_path / "code" / "small.py"
    script.write_text(SMALL)
    cache = str(tmp_path / "cache")
    first, second = (
        python(str(script), **{name: cache, "PYTHONDONTWRITEBYTECODE": "1"}) for _ in "ab"
    )
    assert (first.stdout, second.stdout) == ("0\n", "1\n"), "the second process finds the kernel"
    assert first.stderr == f"{compiling.NOTICE}\n"
    assert list((tmp_path / "cache" / place).glob("*.nbc"))
    assert list((tmp_path / "code").iterdir()) == [script], "nothing is written beside the source"


def test_where_nothing_can_be_kept_every_process_says_what_helps() -> None:
    nowhere = f"{os.devnull}/none"
    done = python(SMALL, HOME=nowhere, XDG_CACHE_HOME=nowhere, LOCALAPPDATA=nowhere)
    assert done.stdout == "0\n"
    assert "once" not in done.stderr
    assert "in every process" in done.stderr
    assert "set NUMBA_CACHE_DIR to a folder that can be written" in done.stderr
    assert done.stderr.count("\n") == 1


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
