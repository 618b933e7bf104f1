"""The version names the commit that runs, also in an editable installation."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import aquafish_gym
from aquafish_gym.runs import version as module
from aquafish_gym.runs.command_line import run_command_line
from aquafish_gym.runs.version import clone_version, is_clone, other_clone_here, version

ROOT = Path(__file__).parents[2]


def git(folder: Path, *words: str) -> str:
    identity = ("-c", "user.name=A", "-c", "user.email=a@b.c")
    command = ["git", "-C", str(folder), *identity, *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def commit(folder: Path, content: str) -> str:
    """Commit a new content of the package; return the commit's first nine digits."""
    (folder / "aquafish_gym" / "__init__.py").write_text(content)
    git(folder, "add", ".")
    git(folder, "commit", "-q", "-m", content)
    return git(folder, "rev-parse", "--short=9", "HEAD")


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    folder = tmp_path / "clone"
    (folder / "aquafish_gym").mkdir(parents=True)
    (folder / "docs").mkdir()
    (folder / "docs" / "page.txt").write_text("a page")
    (folder / "pyproject.toml").write_bytes((ROOT / "pyproject.toml").read_bytes())
    git(folder, "init", "-q")
    commit(folder, "one")
    return folder


def by_setuptools_scm(clone: Path) -> str:
    command = [sys.executable, "-m", "setuptools_scm"]
    done = subprocess.run(command, cwd=clone, capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_the_version_is_that_of_setuptools_scm(clone: Path) -> None:
    pytest.importorskip("setuptools_scm")
    head = commit(clone, "two")
    assert clone_version(clone) == by_setuptools_scm(clone) == f"0.1.dev2+g{head}"
    git(clone, "tag", "-a", "v0.1.0", "-m", "0.1.0")
    assert clone_version(clone) == by_setuptools_scm(clone) == "0.1.0"
    head = commit(clone, "three")
    assert clone_version(clone) == by_setuptools_scm(clone) == f"0.1.1.dev1+g{head}"
    git(clone, "tag", "-a", "v0.2.0rc1", "-m", "0.2.0rc1")
    head = commit(clone, "four")
    assert clone_version(clone) == by_setuptools_scm(clone) == f"0.2.0rc2.dev1+g{head}"


def test_changed_code_is_dirty_and_changed_results_are_not(clone: Path) -> None:
    (clone / "docs" / "page.txt").write_text("another page")
    assert not clone_version(clone).endswith(".dirty")
    (clone / "aquafish_gym" / "__init__.py").write_text("changed")
    assert clone_version(clone).endswith(".dirty")
    git(clone, "checkout", "aquafish_gym")
    git(clone, "tag", "v0.1.0")
    assert clone_version(clone) == "0.1.0"
    (clone / "aquafish_gym" / "__init__.py").write_text("changed")
    assert clone_version(clone).startswith("0.1.1.dev0+g")


def test_a_hook_of_another_clone_does_not_lead_git_there(
    clone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = clone_version(clone)
    git(tmp_path, "init", "-q", "other")
    monkeypatch.setenv("GIT_DIR", str(tmp_path / "other" / ".git"))
    monkeypatch.setenv("GIT_INDEX_FILE", str(tmp_path / "other" / ".git" / "index"))
    assert before is not None
    assert clone_version(clone) == before


def test_what_git_cannot_compare_does_not_pass_for_unchanged(clone: Path) -> None:
    (clone / ".git" / "index").write_bytes(b"damaged")
    assert git(clone, "rev-parse", "HEAD")
    assert clone_version(clone) is None


def test_a_clones_settings_start_no_program(clone: Path) -> None:
    (clone / "started.sh").write_text("#!/bin/sh\ntouch started\n")
    (clone / "started.sh").chmod(0o755)
    git(clone, "config", "core.fsmonitor", str(clone / "started.sh"))
    assert clone_version(clone) is not None
    assert not (clone / "started").exists()
    git(clone, "status")
    assert (clone / "started").exists()  # as it would have been


def test_without_git_a_clone_has_no_known_commit(
    clone: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "HERE", clone)
    monkeypatch.setenv("PATH", "")
    assert version.__wrapped__().endswith("+unknown")
    assert "+g" not in version.__wrapped__()


def test_an_installed_copy_has_the_version_that_it_was_built_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "HERE", tmp_path)
    monkeypatch.setattr(module, "installed_version", lambda name: f"0.1.0 of {name}")
    assert version.__wrapped__() == "0.1.0 of aquafish-gym"


def test_the_package_has_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert aquafish_gym.__version__ == version()
    assert run_command_line("gait", {}, ["--version"]) == 0
    assert capsys.readouterr().out == f"gait {version()}\n"
    with pytest.raises(AttributeError, match="has no attribute '__versions__'"):
        _ = aquafish_gym.__versions__


def test_a_command_says_that_it_runs_another_version_than_the_clone_around_it(
    clone: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(clone / "docs")
    assert is_clone(clone)
    assert run_command_line("aquafish", {}, ["--version"]) == 0
    said = capsys.readouterr().err
    assert said.startswith(f"aquafish: this folder is a clone of {clone_version(clone)}, but")
    assert said.endswith('"pip install -e ." in the clone changes that\n')
    monkeypatch.setattr(module, "version", lambda: clone_version(clone))
    assert other_clone_here() is None
    monkeypatch.chdir(clone.parent)
    assert other_clone_here() is None
